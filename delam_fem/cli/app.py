"""The command `delam-fem`: reads the case, calls the package, reports, sets the exit status.

Modules with heavy imports (dolfinx, matplotlib) are imported by the command that needs them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from delam_fem.cli.converge import register as register_convergence
from delam_fem.cli.inputs import case_of, writable
from delam_fem.cli.paper import register as register_paper
from delam_fem.cli.sweep import register as register_sweeps
from delam_fem.cli.terminal import (
    DONE,
    FAILED,
    INTERRUPTED,
    fail,
    reported,
    say_files,
    summary_rows,
    table,
)

STATUS = {"completed": DONE, "diverged": FAILED, "interrupted": INTERRUPTED}
"""Exit status by the outcome of a run."""

HINT = {"diverged": "", "interrupted": "; --resume goes on from there"}
"""What a user can do about an outcome; why a run diverged is in its log."""

app = typer.Typer(
    no_args_is_help=True,
    invoke_without_command=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

CaseArgument = Annotated[
    str, typer.Argument(metavar="CASE", help="A preset by name, or a case file (.toml).")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Override a key of the case, e.g. excitation.frequency=3.65; repeatable. "
        "KEY= alone removes an optional key.",
    ),
]
Folder = Annotated[
    Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder of the results.")
]
Verbose = Annotated[
    bool, typer.Option("-v", "--verbose", help="Say more, e.g. which given keys nothing reads.")
]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="No progress, no table.")]


@app.callback()
def main(
    version: Annotated[bool, typer.Option("--version", help="Show the version and leave.")] = False,
) -> None:
    """Two delaminated laminae that clap under base motion, by finite elements."""
    if version:
        from delam_fem import __version__

        typer.echo(__version__)
        raise typer.Exit()


@app.command("run")
def run_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    engine: Annotated[
        Literal["petsc", "compiled"], typer.Option(help="What computes the steps.")
    ] = "petsc",
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted run.")
    ] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Compute a case; results go to DIR (runs/NAME)."""
    with reported(quiet, verbose):
        case = case_of(case_name, overrides)
        directory = writable(output or Path("runs") / case.name)
        from mpi4py import MPI
        from rich.console import Console

        from delam_fem.cli.progress import progress
        from delam_fem.pipeline import run

        is_first = MPI.COMM_WORLD.rank == 0  # of the processes that mpirun may have started
        quiet = quiet or not is_first
        with progress(Console(stderr=True, quiet=quiet), case.time.steps_per_period) as report:
            result = run(
                case,
                engine,
                directory=directory,
                resume=resume,
                progress=report,
                comm=MPI.COMM_WORLD,
            )
        paths = result.save(directory) if is_first else []
        if not quiet:
            table(f"case {case.name}", ("", "value"), summary_rows(result.summary))
            say_files(paths)
        outcome = result.history.attrs["outcome"]
        if outcome != "completed":
            fail(
                f"{outcome}; the results so far are in {directory}{HINT[outcome]}", STATUS[outcome]
            )


@app.command("compare")
def compare_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    impacts: Annotated[
        int, typer.Option(metavar="N", help="Compare the tip histories up to the N-th impact.")
    ] = 20,
    periods: Annotated[int, typer.Option(metavar="N", help="Length of both runs.")] = 3,
    quiet: Quiet = False,
) -> None:
    """Compare dolfinx and PETSc with the independent reference."""
    with reported(quiet):
        case = case_of(case_name, overrides)
        directory = writable(output or Path("runs") / f"{case.name}-compare")
        from delam_fem.reference.compare import compare

        comparison = compare(case, impacts=impacts, periods=periods)
        paths = comparison.save(directory)
        if not quiet:
            table("largest differences", ("what", "difference"), comparison.rows())
            say_files(paths)


@app.command("modes")
def modes_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    count: Annotated[
        int, typer.Option("-n", "--number", metavar="N", help="Modes per lamina.")
    ] = 6,
    quiet: Quiet = False,
) -> None:
    """List natural frequencies beside those of the exact cantilever."""
    with reported(quiet):
        case = case_of(case_name, overrides)
        directory = writable(output or Path("runs") / f"{case.name}-modes")
        from delam_fem.studies.modes import modes

        found = modes(case, count)
        paths = found.save(directory)
        if not quiet:
            heading = ("lamina", "mode", "computed [Hz]", "exact [Hz]", "relative difference")
            table(f"modes of case {case.name}", heading, found.rows())
            say_files(paths)


@app.command("presets")
def presets_command(
    show: Annotated[
        str | None, typer.Option(metavar="NAME", help="Print this preset as a case file.")
    ] = None,
) -> None:
    """List the presets, or print one as a start for a case file."""
    with reported():
        from delam_fem.case.files import PRESETS, preset_text

        typer.echo("\n".join(PRESETS) if show is None else preset_text(show), nl=show is None)


register_sweeps(app)
register_paper(app)
register_convergence(app)

if __name__ == "__main__":
    app()
