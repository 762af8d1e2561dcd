"""Define `delam-fem orbit`, which finds the periodic orbit of a case."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from delam_fem.cli.console.terminal import reported, say_files, table
from delam_fem.cli.inputs import (
    CaseArgument,
    Overrides,
    Overwrite,
    Quiet,
    Resume,
    case_of,
    inputs_of,
)

if TYPE_CHECKING:
    from delam_fem.studies.orbits.ensemble import Perturbations
    from delam_fem.studies.orbits.models import Model

Folder = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="DIR", help="Folder (default: runs/NAME-orbit)."),
]
Period = Annotated[
    int,
    typer.Option("--period", metavar="P", help="Periods of the drive in one of the orbit."),
]
Settle = Annotated[
    int, typer.Option(min=0, metavar="N", help="Periods computed before the search starts.")
]
Seed = Annotated[int, typer.Option(metavar="N", help="Seed of the fixed perturbations.")]
Kick = Annotated[
    float | None,
    typer.Option(
        min=1e-6, max=0.5, metavar="X",
        help="Size of kicks, relative to the state (default: 0.02; reduced model: 0.03).",
    ),
]  # fmt: skip
ModelName = Annotated[
    str, typer.Option("--model", metavar="NAME", help="full, or reduced (docs/reduced.md).")
]
Modes = Annotated[
    int | None,
    typer.Option(metavar="N", help="Modes of each lamina of a reduced model (default: 12)."),
]
Fine = Annotated[
    int | None,
    typer.Option("--refine", metavar="R", help="Its fine steps near contact (default: 64)."),
]


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("orbit")(orbit_command)


def orbit_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    period: Period = 1,
    settle: Settle = 300,
    kick: Kick = None,
    seed: Seed = 0,
    model: ModelName = "full",
    modes: Modes = None,
    refine: Fine = None,
    resume: Resume = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Find the periodic orbit of a case and judge its stability; write DIR/orbit.json."""
    with reported(quiet):
        case = case_of(case_name, overrides)
        from delam_fem.case.claim import claimed
        from delam_fem.simulation.checkpoint import of_study
        from delam_fem.studies.orbits.run import orbit

        options = model_options(model, modes, refine) | {"perturbations": kicks(model, kick, seed)}
        folder = output or Path("runs") / f"{case.name}-orbit"
        claim = claimed(folder, inputs=inputs_of(case), may_hold_results=resume or overwrite)
        with claim as directory, of_study(directory, resume=resume) as kept:
            found = orbit(case, periods=period, settle=settle, kept=kept, **options)
            paths = found.save(directory)
        if not quiet:
            table(f"orbit of {case.name}", ("", "value"), _rows(found.numbers))
            for line in found.words:
                typer.echo(line)
            say_files(paths)


def model_options(model: str, modes: int | None, refine: int | None) -> dict[str, Any]:
    """Return the options of a model as studies of orbits take them."""
    return {"model": model, "modes": modes, "refine": refine}


def kicks(model: str, kick: float | None, seed: int) -> Perturbations:
    """Return the perturbations of a model with the given size of kicks and seed."""
    from delam_fem.studies.orbits.models import usual

    found = replace(usual(cast("Model", model)), seed=seed)
    return found if kick is None else replace(found, kick=kick)


def _rows(numbers: dict[str, object]) -> list[tuple[str, str]]:
    """Return the rows of the table that is shown at the end."""
    shown = (
        "kind", "model", "residual", "residual_error", "period", "stability", "largest_multiplier",
        "settled_scatter", "smallest_tip_gap", "processor_seconds",
    )  # fmt: skip
    units = {"period": "s", "smallest_tip_gap": "m", "processor_seconds": "s"}
    return [
        (name.replace("_", " "), f"{_shown(numbers[name])} {units.get(name, '')}".strip())
        for name in shown
    ]


def _shown(value: object) -> str:
    """Return a value as text."""
    if isinstance(value, list):
        return ", ".join(_shown(entry) for entry in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)
