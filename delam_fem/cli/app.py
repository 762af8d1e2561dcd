"""Define the command `delam-fem`: read the case, call the package, report, set the exit status.

Each command imports heavy modules (dolfinx, matplotlib) itself, so that the others start fast.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from delam_fem.cli.cases import new_command, schema_command, show_case, validate_command
from delam_fem.cli.console import reported, with_messages
from delam_fem.cli.inputs import (
    CaseArgument,
    DryRun,
    Folder,
    Overrides,
    Overwrite,
    Quiet,
    Yes,
    case_of,
)
from delam_fem.cli.measured import (
    export_command,
    measure_command,
    overlay_command,
)
from delam_fem.cli.paper import paper_command
from delam_fem.cli.reduction import operators_command, reduce_command, reduced_command
from delam_fem.cli.run import animate_command, engine_in, report_in_folder, run_in_folder
from delam_fem.cli.studies import study_command
from delam_fem.cli.sweep import diagram_command, sweep_command

app = typer.Typer(
    no_args_is_help=True,
    invoke_without_command=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Figures = Annotated[
    bool,
    typer.Option(
        "--figures/--no-figures",
        help="Draw figures, fields and page, or write the numbers alone; `report` draws later.",
    ),
]

Extend = Annotated[
    int | None,
    typer.Option(
        min=1, show_default=False, metavar="N", help="Go on from a completed run by N periods."
    ),
]


@app.callback()
def main(
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
) -> None:
    """Simulate delaminated layers that clap under base motion or forces, by finite elements."""
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
        Literal["petsc", "compiled"] | None,
        typer.Option(
            help="Engine that computes the steps (default: petsc, or that of what goes on)."
        ),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue an interrupted run.")] = False,
    extend: Extend = None,
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
    figures: Figures = True,
    dry_run: DryRun = False,
    yes: Yes = False,
    quiet: Quiet = False,
) -> None:
    """Compute a case and write the results to DIR (default: runs/NAME)."""
    with reported(quiet):
        case = case_of(case_name, overrides)
        from delam_fem.engines.cost import require_affordable, run_cost

        folder = output or Path("runs") / case.name
        if engine is None:
            engine = engine_in(folder, resume=resume, extend=extend is not None)
        cost = run_cost(case, engine)
        require_affordable(cost, f"case {case.name}", is_confirmed=yes, folder=folder)
        options: dict[str, Any] = {"engine": engine, "resume": resume}
        wished = {"extend": extend, "checkpoint_seconds": seconds}
        options |= {key: value for key, value in wished.items() if value is not None}
        if dry_run:
            show_case(case, engine)
        run_in_folder(
            case,
            Path(case_name),
            folder,
            quiet=quiet,
            overwrite=overwrite,
            figures=figures,
            dry_run=dry_run,
            **options,
        )


@app.command("report")
def report_command(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a run, or a sweep.")],
    *,
    quiet: Quiet = False,
) -> None:
    """Make figures, fields and page of a run or a sweep from its numbers, without computing."""
    with reported(quiet):
        report_in_folder(directory, quiet=quiet)


@app.command("presets")
def presets_command(
    show: Annotated[
        str | None, typer.Option(metavar="NAME", help="Print this preset as a case file.")
    ] = None,
) -> None:
    """List the presets, or print one as a template for a case file."""
    with reported():
        from delam_fem.case.files import PRESETS, preset_text

        typer.echo("\n".join(PRESETS) if show is None else preset_text(show), nl=show is None)


COMMANDS: dict[str, Callable[..., None]] = {
    "modes": study_command("modes"),
    "new": new_command,
    "validate": validate_command,
    "sweep": sweep_command,
    "diagram": diagram_command,
    "compare": study_command("compare"),
    "orbit": study_command("orbit"),
    "continue": study_command("continue"),
    "paper": paper_command,
    "converge": study_command("converge"),
    "animate": animate_command,
    "schema": schema_command,
    "detect": study_command("detect"),
    "resonance": study_command("resonance"),
    "identify": study_command("identify"),
    "excite": study_command("excite"),
    "pod": study_command("pod"),
    "infer": study_command("infer"),
    "modulate": study_command("modulate"),
    "measure": measure_command,
    "overlay": overlay_command,
    "export": export_command,
    "reduced": reduced_command,
    "operators": operators_command,
    "reduce": reduce_command,
}
"""Commands in the order of the help, behind those that this module defines."""

for _name, _function in COMMANDS.items():
    app.command(_name)(_function)
for command in app.registered_commands:
    assert command.callback is not None
    command.callback = with_messages(command.callback)

if __name__ == "__main__":
    app()
