"""Follow the orbits of a case over one of its keys; each accepted point survives a kill.

Follow the orbits of a case over one of its keys, with the branches that leave at doublings.

In Python:

    import delam_fem as df
    data = df.follow(df.preset("paper"), "excitation.frequency", 3.3, 4.0, "runs/branch")
    data.parameter, data.stability, data.event_kind, data.event_parameter
"""

from __future__ import annotations

import dataclasses
import json
import logging
import shutil
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic_core import PydanticCustomError

from delam_fem.case.definition import Case
from delam_fem.case.files import CaseSource, find_case, save_case
from delam_fem.case.values import in_si
from delam_fem.numerics.types import FloatArray
from delam_fem.results.folder import write_dataset
from delam_fem.simulation.checkpoint import stop_signals
from delam_fem.studies.branches import diagram
from delam_fem.studies.branches.continuation import Path as Way
from delam_fem.studies.branches.continuation import (
    Point,
    doubled_point,
    events_of,
    first_point,
    followed,
    turns,
    why_lost,
)
from delam_fem.studies.branches.diagram import Branch
from delam_fem.studies.findings import Finding, Report, Table
from delam_fem.studies.options import Continue
from delam_fem.studies.orbits.maps import PeriodMap
from delam_fem.studies.orbits.newton import USUAL, Ensemble, Perturbations
from delam_fem.studies.orbits.search import (
    SETTLE,
    kicks,
    map_of,
    mean_of_motion,
    settled_map,
    usual,
)
from delam_fem.studies.study import Place, Study
from delam_fem.studies.sweeps.dataset import open_result
from delam_fem.studies.sweeps.grid import unit_of
from delam_fem.system.errors import CaseError
from delam_fem.system.files import read_arrays, write_arrays, write_text

if TYPE_CHECKING:
    import xarray as xr

FOLDER = "points"
"""Name of the folder of the points in the folder of a continuation."""
EVERY = 10
"""Points between two lines of progress."""
_ABOUT = "about.txt"
_NUMBERS = ("parameter", "residual", "residual_error", "parameter_error", "step", "doubled")

_log = logging.getLogger(__name__)


class PointJournal:
    """The points of all branches of a continuation, one file each.

    Attributes:
        folder: where they are.
    """

    def __init__(self, directory: Path, identity: str, *, resume: bool) -> None:
        """Open the journal of a continuation, or begin one.

        Args:
            directory: folder of the continuation.
            identity: text that is equal only for the same continuation.
            resume: whether to go on with the points in the folder.

        Raises:
            CaseError: the points belong to another continuation.
        """
        self.folder = directory / FOLDER
        if not resume and self.folder.exists():
            shutil.rmtree(self.folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        about = self.folder / _ABOUT
        if not about.is_file():
            write_text(about, identity)
        elif about.read_text("utf-8") != identity:
            raise CaseError(
                f"resume: {self.folder} belongs to another continuation; run it with the settings "
                "of the interrupted one, or choose another folder with -o DIR"
            )

    def points(self, branch: int) -> list[Point]:
        """Return the points of a branch, up to the first that is missing or damaged."""
        found: list[Point] = []
        while (point := self._read(branch, len(found))) is not None:
            found.append(point)
        return found

    def keep(self, branch: int, number: int, point: Point) -> None:
        """Write a point and wait until it is on the disk.

        Raises:
            OSError: the file cannot be written.
        """
        write_arrays(self._path(branch, number), dataclasses.asdict(point))

    def _path(self, branch: int, number: int) -> Path:
        return self.folder / f"{branch:02d}-{number:04d}.npz"

    def _read(self, branch: int, number: int) -> Point | None:
        path = self._path(branch, number)
        if not path.is_file():
            return None
        try:
            values = read_arrays(path)
            numbers = {name: float(values[name]) for name in _NUMBERS}
            return Point(**{**values, **numbers, "iterations": int(values["iterations"])})
        except (ValueError, KeyError, TypeError) as error:
            _log.warning("%s: computed anew (%s)", path, error)
            return None


RESULT = "branch.nc"
"""Name of the dataset in the folder of a continuation."""
Progress = Callable[[int, int, float], None]
"""Called with the number of the branch, its number of points and λ after each point."""


@dataclass(frozen=True)
class Plan:
    """What a continuation does.

    Attributes:
        key: key of the case that is the parameter.
        way: range of the key, and length of steps.
        periods: P of the first branch.
        doublings: how often a branch of twice the period is followed from a doubling of another.
        settle: periods that are computed before the first orbit is sought.
        perturbations: what the mean is taken over, and the size of kicks.
    """

    key: str
    way: Way
    periods: int = 1
    doublings: int = 1
    settle: int = SETTLE
    perturbations: Perturbations = USUAL


def follow(
    case: CaseSource,
    key: str,
    start: float,
    stop: float,
    directory: str | Path,
    *,
    periods: int = 1,
    doublings: int = 1,
    settle: int = SETTLE,
    perturbations: Perturbations | None = None,
    step: float = Way.step,
    resume: bool = False,
    report: Progress = lambda branch, count, parameter: None,
) -> xr.Dataset:
    """Follow the orbit of a case over a key, and the branches of twice the period.

    Args:
        case: the case; its drive must be periodic.
        key: a key of numbers, for example "excitation.frequency".
        start: where the first branch begins.
        stop: the other end of the range.
        directory: folder for case.toml, the accepted points and branch.nc.
        periods: P of the first branch, in periods of the drive.
        doublings: how often a branch of twice the period is followed from a doubling of another.
        settle: periods that are computed before the first orbit is sought.
        perturbations: what the mean is taken over, and the size of kicks; None: what suits the
            case.
        step: length of the first steps, relative to the state and the range.
        resume: whether to go on with the points in the folder.
        report: called after each point.

    Returns:
        The dataset; `attrs["outcome"]` is "completed" or "interrupted".

    Raises:
        CaseError: the drive is not periodic, the key or its range is not valid, or the folder has
            points of another continuation.
        ArithmeticError: there is no orbit at the start.
        OSError: the folder cannot be written.
    """
    case = find_case(case)
    if not start != stop:
        raise CaseError(f"{key}: expected a range to follow, given {start:g} to {stop:g}")
    perturbations = perturbations or usual(case)
    plan = Plan(key, Way(start, stop, step), periods, doublings, settle, perturbations)
    for value in (stop, start):
        case = case.with_overrides({key: value})
    family = map_of(case, key)
    directory, begin = Path(directory), time.process_time()
    about = {"plan": asdict(plan), "model": family.nature.name, "case": case.to_toml()}
    identity = json.dumps(about, indent=1)
    journal = PointJournal(directory, identity, resume=resume)
    save_case(case, directory)
    map_, state = settled_map(family, start, settle)
    with stop_signals() as is_stopped:
        branches = _branches(_Origin(map_, state), plan, journal, is_stopped, report)
    seconds = time.process_time() - begin
    attributes = {
        "title": f"orbits of {case.name}, {family.nature.name}",
        "key": key, "model": family.nature.name, "processor_seconds": seconds,
        "seed": perturbations.seed,
    }  # fmt: skip
    data = diagram.of(branches, case, plan.way.span, attributes)
    write_dataset(data, directory / RESULT)
    return data


@dataclass(frozen=True)
class _Origin:
    """A map and a settled state of it at the start of the range."""

    map: PeriodMap
    state: FloatArray


def _branches(
    origin: _Origin,
    plan: Plan,
    journal: PointJournal,
    is_stopped: Callable[[], bool],
    report: Progress,
) -> list[Branch]:
    """Return all branches; each doubling of one begins another, up to `plan.doublings`."""
    ready = [_First(plan.periods, 0)]
    branches: list[Branch] = []
    while ready and (not branches or branches[-1].ending != "interrupted"):
        first, number = ready.pop(0), len(branches)
        ensemble = Ensemble(origin.map, first.periods, plan.perturbations)
        points = journal.points(number)

        def keep(point: Point, count: int, number: int = number) -> None:
            journal.keep(number, count - 1, point)
            report(number, count, point.parameter)

        if not points:
            try:
                points = [first.point(ensemble, plan, origin.state)]
            except (ArithmeticError, np.linalg.LinAlgError) as error:
                if not branches:
                    raise ArithmeticError(f"no orbit at the start of the range: {error}") from None
                _log.warning("a doubling is not followed: %s", error)
                continue
            keep(points[0], 1)
        found, ending = followed(ensemble, points, plan.way, keep=keep, is_stopped=is_stopped)
        events = events_of(found, plan.way.span)
        for low, high in turns(found, plan.way.span):
            _log.warning(
                "between %s = %.6g and %.6g a bubble of period %d may be missed: look at a run "
                "there, or take a shorter --step", plan.key, low, high, 2 * first.periods,
            )  # fmt: skip
        if ending == "lost":
            _log.warning(
                "branch %d is lost behind %s = %.6g, after %d points: at the shortest step %s; try "
                "another --seed, a shorter --step, or --from the other side",
                number, plan.key, found[-1].parameter, len(found),
                why_lost(ensemble, found[-1], plan.way),
            )  # fmt: skip
        branches.append(Branch(first.periods, tuple(found), tuple(events), ending))
        if first.doubled < plan.doublings:
            ready += [
                _First(2 * first.periods, first.doubled + 1, found[event.index], event.parameter)
                for event in events
                if event.kind == "period doubling" and plan.way.has(event.parameter)
            ]
    return branches


@dataclass(frozen=True)
class _First:
    """Where a branch begins: at the start of the range, or at a doubling of another branch.

    Attributes:
        periods: P.
        doubled: number of doublings on the way here.
        near: the point of the other branch behind the doubling; None: the start of the range.
        parameter: λ at the doubling.
    """

    periods: int
    doubled: int
    near: Point | None = None
    parameter: float = 0.0

    def point(self, ensemble: Ensemble, plan: Plan, state: FloatArray) -> Point:
        """Return the first point of the branch; `state` is settled at the start of the range.

        Raises:
            ArithmeticError: there is none.
        """
        if self.near is not None:
            return doubled_point(ensemble, self.near, self.parameter, plan.way)
        guess, *_ = mean_of_motion(ensemble.map, plan.way.start, state, self.periods)
        return first_point(ensemble, guess, plan.way)


@dataclass(frozen=True)
class Branches(Finding):
    """Branches that were followed, in the folder that holds their dataset.

    Attributes:
        data: the dataset of `follow`.
        swept: a sweep that is drawn behind; None: none.
    """

    data: xr.Dataset
    swept: xr.Dataset | None

    @property
    def report(self) -> Report:
        """What it says on the terminal."""
        from delam_fem.studies.branches.diagram import branch_diagram

        data, unit = self.data, _behind(self.data["parameter"].attrs["units"])
        names = ("branch", "kind", "parameter", "low", "high")
        columns = (data[f"event_{name}"].values for name in names)
        rows = [
            (str(int(branch)), str(kind), f"{at:.5g}{unit}", f"{low:.5g} to {high:.5g}{unit}")
            for branch, kind, at, low, high in zip(*columns, strict=True)
        ]
        title, n = f"on the branches over {data.attrs['key']}", data.sizes["point"]
        return Report(
            name="branch",
            numbers=None,
            files=[RESULT],
            tables=[Table(title, ("branch", "", "at", "95 %"), rows)],
            sentences=[
                f"{n} points, {data.attrs['processor_seconds']:.0f} processor seconds; "
                f"the branches end: {data.attrs['endings']}"
            ],
            pictures={"branch": (lambda: branch_diagram(data, self.swept), "")},
            left=f"after {n} points" * (data.attrs["outcome"] == "interrupted"),
        )


def _number(unit: str, option: str, text: str) -> float:
    """Return a number of the user in a unit, which it may carry, or another one.

    Raises:
        CaseError: the text is no number, or its unit does not fit.
    """
    try:
        return float(str(in_si(text, unit)))
    except (PydanticCustomError, ValueError) as error:
        reason = error.message() if isinstance(error, PydanticCustomError) else "expected a number"
        raise CaseError(f"{option}: {reason}, given {text!r}") from None


def _behind(unit: str) -> str:
    """Return what stands behind a number: a unit, or nothing behind a pure number."""
    return "" if unit == "1" else f" {unit}"


def _follow(case: Case, given: Continue, place: Place) -> Branches:
    """Follow with options of a user, who is told every tenth point."""
    unit = unit_of(given.key, case)
    swept = None
    if given.over is not None:
        path = given.over / "sweep.nc" if given.over.is_dir() else given.over
        swept = open_result(path, is_loaded=True)

    def tell(branch: int, count: int, parameter: float) -> None:
        if count == 1 or count % EVERY == 0:
            at = f"{given.key} = {parameter:.5g}{_behind(unit)}"
            _log.info("branch %d: point %d, %s", branch, count, at)

    try:
        data = follow(
            case, given.key, _number(unit, "--from", given.start),
            _number(unit, "--to", given.stop), place.folder, periods=given.period,
            doublings=given.doublings, perturbations=kicks(given, case), step=given.step,
            resume=place.resume, report=tell,
        )  # fmt: skip
    except ArithmeticError as error:
        raise CaseError(f"case {case.name}: {error}") from None
    return Branches(data, swept)


STUDY = Study(Continue, _follow, takes_impactors=True)
