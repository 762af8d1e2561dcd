"""Define `delam-fem reduced` and `delam-fem operators`: reduced runs, and matrices for others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from delam_fem.cli.console.terminal import FAILED, fail, reported, say_files, summary_rows, table
from delam_fem.cli.inputs import CaseArgument, Overrides, Overwrite, Quiet, case_of, inputs_of

Folder = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="DIR", help="Folder (default: runs/NAME-reduced)."),
]
File = Annotated[
    Path, typer.Option("-o", "--output", metavar="FILE", help="A file that ends in .npz or .mat.")
]
Modes = Annotated[int, typer.Option(min=1, metavar="N", help="Modes of each lamina.")]
Fine = Annotated[
    int, typer.Option("--refine", min=1, metavar="R", help="Fine steps in a step near contact.")
]


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    app.command("reduced")(reduced_command)
    app.command("operators")(operators_command)


def reduced_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    modes: Modes = 12,
    refine: Fine = 64,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Compute a case with a few modes of each lamina and rigid contact; see docs/reduced.md."""
    with reported(quiet):
        from rich.console import Console

        from delam_fem.case.claim import claimed
        from delam_fem.cli.console.progress import progress
        from delam_fem.studies.reduced.motion import reduced

        case = case_of(case_name, overrides)
        motion = reduced(case, modes, refine=refine)
        folder = output or Path("runs") / f"{case.name}-reduced"
        with claimed(folder, inputs=inputs_of(case), may_hold_results=overwrite) as directory:
            with progress(Console(stderr=True, quiet=quiet), case.steps_per_period) as report:
                result = motion.run(progress=report)
            paths = result.save(directory)
        if not quiet:
            title = f"case {case.name}, {modes} modes of each lamina"
            table(title, ("", "value"), summary_rows(result.summary))
            say_files(paths)
        if result.summary["outcome"] != "completed":
            fail(f"{result.summary['outcome']}; the results so far are in {folder}", FAILED)


def operators_command(
    case_name: CaseArgument,
    output: File,
    overrides: Overrides = None,
    *,
    quiet: Quiet = False,
) -> None:
    """Write M, C, K, H, g0 and the vectors of the base for other programs (NumPy or MATLAB)."""
    with reported(quiet):
        from delam_fem.model.discretise import assemble, require_kind
        from delam_fem.model.export import write_operators

        case = case_of(case_name, overrides)
        require_kind(case, "operators")
        path = write_operators(assemble(case, needs_dolfinx=False), case, output)
        if not quiet:
            say_files([path])
