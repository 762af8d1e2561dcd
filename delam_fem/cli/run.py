"""Define the commands `run`, `show page` and `show film`; a run may have several processes."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from delam_fem.cli.cases import show_case
from delam_fem.cli.console import (
    CaseArgument,
    DryRun,
    Folder,
    Overrides,
    Overwrite,
    OverwriteFile,
    Quiet,
    Yes,
    case_of,
    error_console,
    fail,
    progress,
    say,
)
from delam_fem.cli.endings import DONE, FAILED, INTERRUPTED, entered_by_first
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from delam_fem.case.definition import Case
    from delam_fem.engines.session import EngineName
    from delam_fem.results.folder import Result


def film_command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of the results of a run.")],
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="File that ends in .gif or .mp4; repeatable (default: RUN/laminae.gif and .mp4, "
            "or RUN/solid.gif and .mp4).",
        ),
    ] = None,
    *,
    overwrite: OverwriteFile = False,
    periods: Annotated[
        float, typer.Option(metavar="N", help="Length of the film: the last periods.")
    ] = 2.0,
    rate: Annotated[float, typer.Option(metavar="N", help="Pictures per second.")] = 20.0,
    stretch: Annotated[
        float, typer.Option(metavar="N", help="Factor of lateral lengths; 1: true to scale.")
    ] = 3.0,
    solid: Annotated[
        bool,
        typer.Option(
            "--solid", help="Show solids coloured by their stress, their thickness drawn larger."
        ),
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Write a film of the laminae, with the pairs that touch lit."""
    from delam_fem.results.fields.animation import animate
    from delam_fem.system.files import require_replaceable

    require_replaceable(output or [], is_overwriting=overwrite)
    with progress(error_console(quiet)) as report:
        written = animate(
            run, output, periods=periods, rate=rate, stretch=stretch, solid=solid,
            progress=report,
        )  # fmt: skip
    say(quiet, written)


STATUS = {"completed": DONE, "diverged": FAILED, "interrupted": INTERRUPTED, "failed": FAILED}
"""Exit status by the outcome of a run."""

HINT = {"diverged": "", "interrupted": "; --resume goes on from there", "failed": ""}
"""Advice for each outcome; for a run that diverged or failed, the log has reason and advice."""

_log = logging.getLogger(__name__)


def run_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    engine: Annotated[
        Literal["petsc", "compiled"] | None,
        typer.Option(
            help="Engine that computes the steps (default: petsc, or that of what goes on)."
        ),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue an interrupted run.")] = False,
    extend: Annotated[
        int | None,
        typer.Option(
            min=1, show_default=False, metavar="N", help="Go on from a completed run by N periods."
        ),
    ] = None,
    overwrite: Overwrite = False,
    seconds: Annotated[
        float | None,
        typer.Option(
            "--checkpoint-seconds",
            min=0.0,
            metavar="S",
            help="Least time between two checkpoints (default: 30).",
        ),
    ] = None,
    figures: Annotated[
        bool,
        typer.Option(
            "--figures/--no-figures",
            help="Draw figures, fields and page, or write the numbers alone; `show page` draws "
            "later.",
        ),
    ] = True,
    dry_run: DryRun = False,
    yes: Yes = False,
    quiet: Quiet = False,
) -> None:
    """Compute a case and write the results to DIR (default: runs/NAME)."""
    from delam_fem.engines.cost import require_affordable, run_cost
    from delam_fem.model.sharing import shared
    from delam_fem.results.reading import is_complete
    from delam_fem.simulation.checkpoint import path_in
    from delam_fem.system.files import claimed
    from delam_fem.system.mpi import MPI

    comm = MPI.COMM_WORLD
    is_first = comm.rank == 0  # mpirun may have started several processes
    if not is_first:
        logging.getLogger("delam_fem").setLevel(logging.CRITICAL)
    case = case_of(case_name, overrides)
    file = Path(case_name)
    folder = output or Path("runs") / case.name
    chosen = engine or engine_in(folder, resume=resume, extend=extend is not None)
    cost = run_cost(case, chosen)
    require_affordable(cost, f"case {case.name}", is_confirmed=yes, folder=folder)
    # the case may have come from a file; case.toml may be an output
    case_files = [file] if file.is_file() and file.name != "case.toml" else []
    claim = claimed(
        folder,
        inputs=[*case.files.values(), *case_files],
        may_hold_results=resume or overwrite or bool(extend),
        is_replacing=overwrite,
    )
    if dry_run:
        shared(comm, lambda: _show(case, chosen, claim))
        return
    with entered_by_first(comm, claim):
        if resume and not path_in(folder).exists() and is_complete(folder, case, engine):
            outcome = "completed"
            _log.info("%s has the complete result: nothing is left to do", folder)
        else:
            from delam_fem.pipeline import run
            from delam_fem.results.schema import contact_heading, contact_rows, rows

            wished = {"extend": extend, "checkpoint_seconds": seconds}
            options: dict[str, Any] = {k: v for k, v in wished.items() if v is not None}
            options |= {"engine": chosen, "resume": resume, "overwrite": overwrite}
            is_silent = quiet or not is_first
            with progress(error_console(is_silent), case.steps_per_period) as report:
                result = run(case, directory=folder, progress=report, comm=comm, **options)
            paths = _saved(result, folder, figures) if is_first else []
            numbers = rows(result.summary, [lamina.name for lamina in case.lamina])
            tables: list[Any] = [(f"case {case.name}", ("", "value"), [row[:2] for row in numbers])]
            if touched := contact_rows(result.summary):
                tables.append(("contacts", contact_heading(), touched))
            say(is_silent, paths, tables=tables)
            outcome = str(result.history.attrs["outcome"])
    if outcome != "completed" and not is_first:
        raise typer.Exit(STATUS[outcome])
    if outcome != "completed":
        fail(f"{outcome}; the results so far are in {folder}{HINT[outcome]}", STATUS[outcome])


def _show(case: Case, engine: EngineName, claim: AbstractContextManager[object]) -> None:
    """Show a case, and check that its folder may be written to."""
    show_case(case, engine)
    with claim:
        pass


def engine_in(directory: Path, *, resume: bool, extend: bool) -> EngineName:
    """Return the engine of the run that another goes on from; petsc if there is none."""
    from delam_fem.simulation import checkpoint

    path = checkpoint.path_in(directory) if resume else checkpoint.final_in(directory)
    name = checkpoint.engine_in(path) if resume or extend else None
    return "compiled" if name == "compiled" else "petsc"


def _saved(result: Result, directory: Path, figures: bool) -> list[Path]:
    """Write the results and return their paths; if that fails, say what is left to go on with."""
    from delam_fem.simulation.checkpoint import path_in

    try:
        return result.save(directory, figures=figures)
    except KeyboardInterrupt:
        _log.warning("%s: the results are not complete; --resume writes them", directory)
        raise
    except OSError as error:
        if path_in(directory).exists():
            raise OSError(
                error.errno or 0,
                f"{error.strerror or error}; everything that was computed is in "
                f"{path_in(directory)}: make room, then --resume writes the results",
                error.filename,
            ) from error
        raise


def page_command(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a run, or a sweep.")],
    *,
    channel: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Channel of a run of which histories, spectrum and portrait are drawn; "
            "repeatable.",
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Make figures, fields and page of a run or a sweep from its numbers, without computing."""
    from delam_fem.results.folder import save_views
    from delam_fem.results.reading import load_numbers
    from delam_fem.studies.diagrams import write_page
    from delam_fem.studies.sweeps.dataset import RESULT, open_result
    from delam_fem.system.files import claimed

    if not directory.is_dir():
        raise CaseError(
            f"show page {directory}: no such folder; expected the folder of a run or a sweep"
        )
    with claimed(directory, may_hold_results=True):
        if (directory / RESULT).is_file():
            if channel:
                raise CaseError(
                    f"show page {directory}: expected the folder of a run beside --channel, given "
                    "that of a sweep; record.channels of a sweep file keeps measures of channels"
                )
            with open_result(directory / RESULT, is_loaded=True) as data:
                paths = [write_page(data, directory)]
        else:
            case, history, summary = load_numbers(directory)
            paths = save_views(history, summary, case, directory, channel or ())
    say(quiet, paths)
