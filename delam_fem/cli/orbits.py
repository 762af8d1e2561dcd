"""Define `delam-fem orbit` and `continue`, which find periodic orbits and follow them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from delam_fem.cli.console import FAILED, INTERRUPTED, fail, reported, say_files, table
from delam_fem.cli.inputs import (
    CaseArgument,
    Folder,
    Overrides,
    Overwrite,
    Quiet,
    Resume,
    case_of,
    inputs_of,
)

if TYPE_CHECKING:
    import xarray as xr

    from delam_fem.case.definition import Case
    from delam_fem.studies.orbits.newton import Perturbations
    from delam_fem.studies.orbits.search import Model

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
        from delam_fem.simulation.checkpoint import of_study
        from delam_fem.studies.orbits.run import orbit
        from delam_fem.system.files import claimed

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
    from delam_fem.studies.orbits.search import usual

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


Key = Annotated[str, typer.Option("--key", metavar="KEY", help="Key of the case to vary.")]
Start = Annotated[
    str, typer.Option("--from", metavar="X", help='Value where to start, as 9.5 or "9.5 Hz".')
]
Stop = Annotated[str, typer.Option("--to", metavar="X", help="Other end of the range.")]
Over = Annotated[
    Path | None,
    typer.Option(metavar="SWEEP", help="Result of a sweep over the key, drawn behind: its folder."),
]
EVERY = 10
"""Points between two lines of progress."""


def continue_command(
    case_name: CaseArgument,
    start: Start,
    stop: Stop,
    key: Key = "excitation.frequency",
    output: Folder = None,
    *,
    overrides: Overrides = None,
    period: Annotated[int, typer.Option(help="Periods of the drive in one of the orbit.")] = 1,
    doublings: Annotated[
        int, typer.Option(min=0, help="How often branches of twice the period are followed.")
    ] = 1,
    step: Annotated[
        float, typer.Option(min=1e-4, max=0.5, help="First steps, relative to state and range.")
    ] = 0.04,
    kick: Kick = None,
    seed: Seed = 0,
    model: ModelName = "full",
    modes: Modes = None,
    refine: Fine = None,
    over: Over = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the points there.")] = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Follow the orbits of a case over a key; write DIR/branch.nc and its diagram."""
    with reported(quiet):
        from delam_fem.studies.sweeps.grid import unit_of
        from delam_fem.system.files import claimed

        case = case_of(case_name, overrides)
        unit = unit_of(key, case)
        over_key = key, _number(unit, "--from", start), _number(unit, "--to", stop)
        options = {
            "periods": period, "doublings": doublings, "step": step, "resume": resume,
            "perturbations": kicks(model, kick, seed), "report": _Progress(key, unit, quiet),
            **model_options(model, modes, refine),
        }  # fmt: skip
        swept = None if over is None else _swept(over)
        folder = output or Path("runs") / f"{case.name}-branch"
        claim = claimed(folder, inputs=inputs_of(case), may_hold_results=resume or overwrite)
        with claim as directory:
            _follow(case, over_key, directory, swept, quiet=quiet, options=options)


def _follow(
    case: Case,
    over: tuple[str, float, float],
    directory: Path,
    swept: xr.Dataset | None,
    *,
    quiet: bool,
    options: dict[str, Any],
) -> None:
    """Follow the branches, draw them, and show what happens on them."""
    from delam_fem.studies.branches.follow import RESULT, follow

    try:
        data = follow(case, *over, directory, **options)
    except ArithmeticError as error:
        fail(f"case {case.name}: {error}", FAILED)
    image = _draw(data, swept, directory)
    if not quiet:
        _tell(data)
        say_files([directory / RESULT, image])
    if data.attrs["outcome"] == "interrupted":
        fail(f"interrupted after {data.sizes['point']} points; --resume goes on", INTERRUPTED)


def _number(unit: str, option: str, text: str) -> float:
    """Return a number of the user in a unit, which it may carry, or another one.

    Raises:
        CaseError: the text is no number, or its unit does not fit.
    """
    from pydantic_core import PydanticCustomError

    from delam_fem.case.values import in_si
    from delam_fem.system.errors import CaseError

    try:
        return float(str(in_si(text, unit)))
    except (PydanticCustomError, ValueError) as error:
        reason = error.message() if isinstance(error, PydanticCustomError) else "expected a number"
        raise CaseError(f"{option}: {reason}, given {text!r}") from None


def _behind(unit: str) -> str:
    """Return what stands behind a number: a unit, or nothing behind a pure number."""
    return "" if unit == "1" else f" {unit}"


class _Progress:
    """Print a line at every tenth point."""

    def __init__(self, key: str, unit: str, quiet: bool) -> None:
        self._key, self._quiet, self._unit = key, quiet, _behind(unit)

    def __call__(self, branch: int, count: int, parameter: float) -> None:
        """Count a point."""
        if not self._quiet and (count == 1 or count % EVERY == 0):
            typer.echo(
                f"branch {branch}: point {count}, {self._key} = {parameter:.5g}{self._unit}",
                err=True,
            )


def _swept(path: Path) -> xr.Dataset:
    """Return the result of a sweep."""
    from delam_fem.studies.sweeps.dataset import open_result

    return open_result(path / "sweep.nc" if path.is_dir() else path, is_loaded=True)


def _draw(data: xr.Dataset, swept: xr.Dataset | None, directory: Path) -> Path:
    """Draw the diagram and return its path."""
    from delam_fem.results.figures.style import styled
    from delam_fem.studies.branches.diagram import branch_diagram
    from delam_fem.system.files import atomic

    path = directory / "branch.png"
    with styled(), atomic(path) as temporary:
        branch_diagram(data, swept).savefig(temporary)
    return path


def _tell(data: xr.Dataset) -> None:
    """Show what happens on the branches, and why they end."""
    unit = _behind(data["parameter"].attrs["units"])
    rows = [
        (str(int(branch)), str(kind), f"{at:.5g}{unit}", f"{low:.5g} to {high:.5g}{unit}")
        for branch, kind, at, low, high in zip(
            *(data[f"event_{name}"].values for name in ("branch", "kind", "parameter", "low",
                                                        "high")),
            strict=True,
        )
    ]  # fmt: skip
    table(f"on the branches over {data.attrs['key']}", ("branch", "", "at", "95 %"), rows)
    typer.echo(
        f"{data.sizes['point']} points, {data.attrs['processor_seconds']:.0f} processor seconds; "
        f"the branches end: {data.attrs['endings']}"
    )
