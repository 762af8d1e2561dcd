"""Define `delam-fem reduce` and `show operators`: modes, and matrices for others."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from delam_fem.cli.console import reported, say_files, table
from delam_fem.cli.inputs import (
    CaseArgument,
    Folder,
    Overrides,
    Overwrite,
    Quiet,
    case_of,
    inputs_of,
)

if TYPE_CHECKING:
    from delam_fem.model.reduction import Reduction

NormalModes = Annotated[
    int, typer.Option(min=1, metavar="N", help="Normal modes of each lamina, or bonded structure.")
]
Coordinates = Annotated[
    int | None,
    typer.Option(
        min=1, metavar="N", help="Coordinates at most; the stiffest residual shapes are left out."
    ),
]


def reduce_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    modes: NormalModes = 20,
    coordinates: Coordinates = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Reduce a model to modes and residual flexibility, for every other command."""
    with reported(quiet):
        from delam_fem.model.reduction import reduced_case
        from delam_fem.system.files import claimed

        case = case_of(case_name, overrides)
        folder = output or Path("runs") / f"{case.name}-reduction"
        with claimed(folder, inputs=inputs_of(case), may_hold_results=overwrite) as directory:
            found = reduced_case(case, modes, coordinates=coordinates)
            paths = found.save(directory)
        if not quiet:
            _show(found, paths[0])
            say_files(paths)


def _show(found: Reduction, path: Path) -> None:
    """Show what a reduction keeps, how well, and what it costs."""
    o, reduced, basis = found.full.operators, found.structure.operators, found.basis
    normal = int(basis.is_mode.sum())
    rows = [
        ("unknowns of the full model", str(o.n_dofs)),
        ("coordinates", str(reduced.n_dofs)),
        ("normal modes", f"{normal} of {basis.body.max() + 1} bodies"),
        ("residual shapes", f"{reduced.n_dofs - normal}, {basis.dropped} left out"),
        ("pairs that may touch", str(o.n_pairs)),
        ("highest frequency of a normal mode", f"{found.highest_mode:.5g} Hz"),
        ("highest frequency of all", f"{found.highest:.5g} Hz"),
        ("largest error of the residual flexibility", f"{basis.compliance_error:.1e}"),
        ("assembly, reduction", f"{found.seconds[0]:.2g} s, {found.seconds[1]:.2g} s"),
        ("size of the file", f"{path.stat().st_size / 1e6:.2g} MB"),
    ]
    table(f"case {found.case.name}, reduced", ("", "value"), rows)
    full, own = found.frequencies
    table(
        "lowest frequencies",
        ("mode", "full [Hz]", "reduced [Hz]", "relative difference"),
        [
            (str(k + 1), f"{f:.6g}", f"{g:.6g}", f"{(g - f) / f if f else 0.0:+.1e}")
            for k, (f, g) in enumerate(zip(full, own, strict=True))
        ],
    )


File = Annotated[
    Path, typer.Option("-o", "--output", metavar="FILE", help="A file that ends in .npz or .mat.")
]


def operators_command(
    case_name: CaseArgument,
    output: File,
    overrides: Overrides = None,
    *,
    quiet: Quiet = False,
) -> None:
    """Write M, C, K, H, g0 and the vectors of the base for other programs (NumPy or MATLAB)."""
    with reported(quiet):
        from delam_fem.results.export import operators

        path = operators(case_of(case_name, overrides), output)
        if not quiet:
            say_files([path])
