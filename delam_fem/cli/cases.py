"""Define the commands about cases: `new`, `check`, `reduce` and `show operators`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from delam_fem.cli.console import (
    BAD_INPUT,
    CaseArgument,
    Folder,
    Overrides,
    Overwrite,
    Quiet,
    Rows,
    case_of,
    overrides_in,
    require_one,
    say,
    table,
    tell,
)
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    from delam_fem.case.definition import Case
    from delam_fem.engines.session import EngineName
    from delam_fem.model.reduction import Reduction
    from delam_fem.studies.sweeps.grid import Sweep


SUFFIX = ".toml"


def new_command(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="Name of the case, or of its file (default: beam)."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="Write this file (default: NAME.toml)."
        ),
    ] = None,
    *,
    kind: Annotated[
        Literal["apart", "paper", "layered", "edge"] | None,
        typer.Option(
            help="apart (the default): two laminae, clamped together at one end; paper: with the "
            "paper's literal law; layered: a bonded beam with a delamination inside; edge: one at "
            "its free end."
        ),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option("--from", metavar="PRESET", help="Take a preset; without NAME, print it."),
    ] = None,
    presets: Annotated[
        bool, typer.Option("--list", help="Print the names of the presets instead.")
    ] = False,
    schema: Annotated[
        bool,
        typer.Option(
            "--schema",
            help="Print the JSON schema of a case file instead, with which editors check and "
            "complete it.",
        ),
    ] = False,
) -> None:
    """Write a commented case file with every key: its unit, its default, its meaning."""
    from delam_fem.case.definition import Case
    from delam_fem.case.files import PRESETS, preset_text
    from delam_fem.case.keys import case_schema, case_text
    from delam_fem.system.files import write_text

    way = require_one(**{"kind": kind, "from": source, "list": presets, "schema": schema})
    file = name or "beam"
    path = Path(file if file.endswith(SUFFIX) else file + SUFFIX)
    if way in ("list", "schema"):
        if name is not None:
            raise CaseError(f"new {name}: no NAME goes with --{way}; leave it out")
        schema_text = json.dumps(case_schema(), indent=1, ensure_ascii=False)
        lines = "\n".join(PRESETS) if presets else schema_text
        typer.echo(lines if output is None else write_text(output, lines + "\n"))
        return
    text = case_text(kind or "apart", path.stem) if source is None else preset_text(source)
    if source is not None and name is not None:
        text = text.replace(f'name = "{source}"', f"name = {json.dumps(path.stem)}", 1)
    Case.from_toml(text)  # refuses a name that is none
    if source is not None and (name or output) is None:
        typer.echo(text, nl=False)
        return
    path = output or path
    if path.exists():
        raise CaseError(f"new {path}: exists; give another NAME, or remove the file")
    if not path.parent.is_dir():
        raise CaseError(f"new {path}: expected an existing folder, given {path.parent}")
    write_text(path, text)
    typer.echo(path)


def check_command(
    names: Annotated[
        list[str], typer.Argument(metavar="CASE…", help="Presets, case files, or sweep files.")
    ],
    overrides: Overrides = None,
    *,
    engine: Annotated[
        Literal["petsc", "compiled"], typer.Option(help="Engine that is to compute the steps.")
    ] = "petsc",
) -> None:
    """Check cases and sweeps as a run would before its first step, and show what they are."""
    failed = 0
    for name in names:
        try:
            _show(name, overrides, engine)
        except CaseError as error:
            tell(f"delam-fem: {error}")
            failed += 1
    if failed:
        raise typer.Exit(BAD_INPUT)


def _show(name: str, overrides: list[str] | None, engine: EngineName) -> None:
    """Check a case or a sweep and show its table.

    Raises:
        CaseError: the case or the sweep cannot be computed, or needs too much.
    """
    from delam_fem.engines.cost import require_affordable, run_cost

    path = Path(name)
    if path.suffix == SUFFIX and path.is_file():
        from delam_fem.case.toml import read_toml

        if "axis" in read_toml(path):
            from delam_fem.studies.sweeps.grid import load_sweep
            from delam_fem.studies.sweeps.run import sweep_cost

            sweep = load_sweep(path, overrides_in(overrides))
            what, cost = f"sweep {sweep.file.name}", sweep_cost(sweep)
            require_affordable(cost, what, is_confirmed=False)
            show_sweep(sweep)
            return
    case = case_of(name, overrides)
    require_affordable(run_cost(case, engine), f"case {case.name}", is_confirmed=False)
    show_case(case, engine)


def show_case(case: Case, engine: EngineName) -> None:
    """Check a case and show its table, with what a run needs.

    Raises:
        CaseError: the case cannot be computed.
    """
    from delam_fem.engines.cost import run_cost
    from delam_fem.pipeline import checked

    structure, warnings = checked(case, engine)
    rows = [*_about(case), ("unknowns", str(structure.operators.n_dofs))]
    rows.append(("pairs that may touch", str(structure.operators.gap0.size)))
    table(f"case {case.name}", ("", ""), [*rows, ("needs", str(run_cost(case, engine)))])
    for text in warnings:
        tell(f"warning: {text}")


def show_sweep(sweep: Sweep, workers: int | None = None) -> None:
    """Check the first point of a sweep and show its table, with what the sweep needs.

    Raises:
        CaseError: it cannot be computed.
    """
    from delam_fem.studies.sweeps.run import sweep_cost

    rows = [
        (d.key, f"{len(d.values)} values, {d.values[0]} … {d.values[-1]} {d.units}")
        for d in sweep.dimensions
    ]
    rows += [("points", str(sweep.n_points)), *_about(sweep.case(0))]
    rows.append(("needs", str(sweep_cost(sweep, workers))))
    table(f"sweep {sweep.file.name}", ("", ""), rows)


def _about(case: Case) -> list[tuple[str, str]]:
    """Return rows that say what a case is."""
    from delam_fem.contact.laws import LAWS, combined_name

    laminae = [
        (
            f"lamina {own.name}",
            f"{1e3 * own.length:g} × {1e3 * own.width:g} × {1e3 * own.thickness:g} mm, "
            f"EI {own.flexural_rigidity:.4g} N m², {own.mass_per_length:.4g} kg/m, "
            f"D {own.damping_ratio:g}",
        )
        for own in case.lamina
    ]
    law, scheme = case.contact.law, case.time.scheme
    rows = [
        *laminae,
        ("structure", _structure(case)),
        ("excitation", case.excitation.words),
        ("contact", f"{combined_name(law, scheme)}: {LAWS[law].meaning}"),
        ("time", _time(case)),
        ("window", _window(case)),
    ]
    if case.unread:
        rows.append(("given, but not read", ", ".join(case.unread)))
    return rows


def _time(case: Case) -> str:
    """Return in words how long a run is, and its steps."""
    if case.time.step is None:
        number = f"{case.n_periods} periods of {case.steps_per_period}"
    else:
        n_steps = case.n_periods * case.steps_per_period
        number = f"{n_steps * case.time_step:g} s, {n_steps}"
    return f"{number} steps of {case.time_step:.4g} s"


def _window(case: Case) -> str:
    """Return in words what of a run is recorded at every step."""
    if case.n_window_periods == case.n_periods:
        return "the whole run"
    if case.time.step is None:
        return f"the last {case.n_window_periods} periods"
    return f"the last {case.n_window_periods * case.period:g} s"


def _structure(case: Case) -> str:
    """Return in words how the laminae are joined, held and divided."""
    mesh = f"{case.mesh.elements} elements" if case.mesh.file is None else case.mesh.file.name
    if case.is_apart:
        return f"apart, clamped at x = 0, {mesh} each"
    delaminated = ", ".join(f"{1e3 * d.start:g} to {1e3 * d.end:g} mm" for d in case.delamination)
    return (
        f"bonded, delaminated at {delaminated or 'no place'}; start {case.support.start}, end "
        f"{case.support.end}; {mesh}"
    )


def reduce_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    modes: Annotated[
        int,
        typer.Option(min=1, metavar="N", help="Normal modes of each lamina, or bonded structure."),
    ] = 20,
    coordinates: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Coordinates at most; the stiffest residual shapes are left out.",
        ),
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Reduce a model to modes and residual flexibility, for every other command."""
    from delam_fem.model.reduction import reduced_case
    from delam_fem.system.files import claimed

    case = case_of(case_name, overrides)
    folder = output or Path("runs") / f"{case.name}-reduction"
    with claimed(folder, inputs=case.files.values(), may_hold_results=overwrite) as directory:
        found = reduced_case(case, modes, coordinates=coordinates)
        paths = found.save(directory)
    say(quiet, paths, tables=_reduced(found, paths[0]))


def _reduced(found: Reduction, path: Path) -> Iterator[Rows]:
    """Yield tables of what a reduction keeps, how exact it is, and what it costs."""
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
    yield f"case {found.case.name}, reduced", ("", "value"), rows
    full, own = found.frequencies
    yield (
        "lowest frequencies",
        ("mode", "full [Hz]", "reduced [Hz]", "relative difference"),
        [
            (str(k + 1), f"{f:.6g}", f"{g:.6g}", f"{(g - f) / f if f else 0.0:+.1e}")
            for k, (f, g) in enumerate(zip(full, own, strict=True))
        ],
    )


def operators_command(
    case_name: CaseArgument,
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="FILE", help="A file that ends in .npz or .mat."),
    ],
    overrides: Overrides = None,
    *,
    quiet: Quiet = False,
) -> None:
    """Write M, C, K, H, g0 and the vectors of the base for other programs (NumPy or MATLAB)."""
    from delam_fem.results.export import operators

    say(quiet, [operators(case_of(case_name, overrides), output)])
