"""Define `delam-fem continue`, which follows the orbits of a case over one of its keys."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from delam_fem.cli.console.terminal import FAILED, INTERRUPTED, fail, reported, say_files, table
from delam_fem.cli.inputs import CaseArgument, Overrides, Overwrite, Quiet, case_of, inputs_of
from delam_fem.cli.orbits.find import Fine, Kick, ModelName, Modes, Seed, kicks, model_options

if TYPE_CHECKING:
    import xarray as xr

    from delam_fem.case.definition import Case

Folder = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="DIR", help="Folder (default: runs/NAME-branch)."),
]
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


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("continue")(continue_command)


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
        from delam_fem.case.claim import claimed
        from delam_fem.studies.sweeps.grid import unit_of

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

    from delam_fem.case.toml import CaseError
    from delam_fem.case.units import in_si

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
    from delam_fem.studies.sweeps.reading import open_result

    return open_result(path / "sweep.nc" if path.is_dir() else path, is_loaded=True)


def _draw(data: xr.Dataset, swept: xr.Dataset | None, directory: Path) -> Path:
    """Draw the diagram and return its path."""
    from delam_fem.case.atomic import atomic
    from delam_fem.results.figures.style import styled
    from delam_fem.studies.branches.diagram import branch_diagram

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
