"""Follow branches of orbits: the study, its dataset and its diagram.

The orbits of a case are followed over one of its keys, with the branches that leave at doublings.
Each accepted point is on the disk at once, so that a killed continuation goes on.

In Python:

    import delam_fem as df
    data = df.follow(df.preset("paper"), "excitation.frequency", 3.3, 4.0, "runs/branch")
    data.parameter, data.stability, data.event_kind, data.event_parameter
"""

from __future__ import annotations

import dataclasses
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydantic_core import PydanticCustomError

from delam_fem.api import (
    Case,
    CaseError,
    CaseSource,
    Finding,
    FloatArray,
    Report,
    RunContext,
    Table,
    Variable,
    belong,
    find_case,
    identity,
    in_si,
    provenance,
    read_arrays,
    remove_kept,
    rewritten,
    save_case,
    stop_signals,
    style,
    write_arrays,
    write_dataset,
)
from delam_fem.studies.orbits.continuation import (
    BranchEvent,
    BranchPoint,
    Path as BranchPath,
    doubled_point,
    events_of,
    first_point,
    followed,
    turns,
    why_lost,
)
from delam_fem.studies.orbits.maps import PeriodMap
from delam_fem.studies.orbits.newton import Ensemble, Perturbations, is_zero
from delam_fem.studies.orbits.search import (
    SETTLE,
    default_perturbations,
    kicks,
    map_of,
    mean_of_motion,
    seen_channels,
    settled_map,
    start_of,
)
from delam_fem.studies.orbits.study import Follow
from delam_fem.studies.sweeps.dataset import open_result
from delam_fem.studies.sweeps.grid import unit_of

_log = logging.getLogger(__name__)


_POINT = ("point",)
_SLOW = ("point", "slow")
_CYCLE = ("point", "cycle")
_PROBE = ("point", "probe")
_OF_KEY = ("parameter", "parameter_error", "event_parameter", "event_low", "event_high")
"""Variables in the unit of the key."""
_BEGIN = "at the beginning of each period of the drive"
VARIABLES: Mapping[str, Variable] = {
    row.name: row
    for row in (
        Variable("branch", _POINT, "1", "number of the branch"),
        Variable("periods", _POINT, "1", "periods of the drive in it"),
        Variable("parameter", _POINT, "", "the key that is followed"),
        Variable("parameter_error", _POINT, "", "its standard error"),
        Variable("residual", _POINT, "1", "residual of the mean map"),
        Variable("residual_error", _POINT, "1", "its standard error"),
        Variable("is_solved", _POINT, "1", "residual is 0 within its error"),
        Variable("stability", _POINT, "", "by the 95 % interval of |μ|, and by what runs on"),
        Variable("largest_low", _POINT, "1", "lower end of the 95 % interval of max |μ|"),
        Variable("largest_high", _POINT, "1", "upper end of the 95 % interval of max |μ|"),
        Variable("multiplier_real", _SLOW, "1", "real part of the multipliers"),
        Variable("multiplier_imaginary", _SLOW, "1", "imaginary part of the multipliers"),
        Variable("multiplier_error", _SLOW, "1", "standard error"),
        Variable(
            "strobe_displacement", (*_CYCLE, "probe"), "m", f"displacement of the probes {_BEGIN}"
        ),
        Variable(
            "smallest_gap", _CYCLE, "m",
            "smallest gap at the probed pair in each period of the drive",
        ),
        Variable("low", _PROBE, "m", "smallest displacement of the probes"),
        Variable("high", _PROBE, "m", "largest displacement of the probes"),
        Variable("iterations", _POINT, "1", "evaluations of the mean map"),
        Variable("state", ("point", "coordinate"), "", "state at the beginning of the orbit"),
        Variable("event_kind", ("event",), "", "what happens"),
        Variable("event_parameter", ("event",), "", "where"),
        Variable("event_low", ("event",), "", "lower end of its 95 % interval"),
        Variable("event_high", ("event",), "", "upper end of its 95 % interval"),
        Variable("event_branch", ("event",), "", "number of the branch"),
        Variable("event_point", ("event",), "", "number of the point behind it"),
    )
}  # fmt: skip
"""All variables of branches by name."""


@dataclass(frozen=True)
class Branch:
    """A branch of orbits.

    Attributes:
        periods: P, number of periods of the drive in one of the orbit.
        points: its points in order.
        events: events on it.
        ending: why it ends: "range", "points", "lost" or "interrupted".
    """

    periods: int
    points: tuple[BranchPoint, ...]
    events: tuple[BranchEvent, ...]
    ending: str


def of(
    branches: Sequence[Branch],
    case: Case,
    span: float,
    channels: Mapping[str, str],
    attributes: Mapping[str, Any],
) -> xr.Dataset:
    """Return the dataset of branches.

    Args:
        branches: at least one, each with points.
        case: the case at the start.
        span: range of λ.
        channels: units of the channels that are seen beside the probes, by their names.
        attributes: of the dataset beside case, versions and outcome.
    """
    key = str(attributes["key"])
    every = [(n, branch, point) for n, branch in enumerate(branches) for point in branch.points]
    points = [point for *_, point in every]
    multipliers = [point.multipliers for point in points]
    cycles = max(branch.periods for branch in branches)

    def padded(rows: list[Any]) -> Any:
        """Return rows of different numbers of periods with NaN behind the shorter ones."""
        arrays = [np.asarray(row, dtype=np.float64) for row in rows]
        result = np.full((len(arrays), cycles, *arrays[0].shape[1:]), np.nan)
        for row, array in zip(result, arrays, strict=True):
            row[: len(array)] = array
        return result

    strobes = padded([p.strobes for p in points])
    low = np.array([p.low for p in points])
    high = np.array([p.high for p in points])
    probes = slice(0, low.shape[1] - len(channels))
    values = np.array([m.values for m in multipliers])
    solved = [is_zero(p.residual, p.residual_error) for p in points]
    largest = np.array([m.largest for m in multipliers])
    events = [(n, event) for n, branch in enumerate(branches) for event in branch.events]
    offsets = np.cumsum([0, *(len(branch.points) for branch in branches)])
    columns: dict[str, Any] = {
        "branch": [n for n, *_ in every],
        "periods": [branch.periods for _, branch, _ in every],
        "parameter": [p.parameter for p in points],
        "parameter_error": [p.parameter_error for p in points],
        "residual": [p.residual for p in points],
        "residual_error": [p.residual_error for p in points],
        "is_solved": np.array(solved, dtype=np.int8),
        "stability": [p.stability for p in points],
        "largest_low": largest[:, 0],
        "largest_high": largest[:, 1],
        "multiplier_real": values.real,
        "multiplier_imaginary": values.imag,
        "multiplier_error": np.array([m.errors for m in multipliers]),
        "strobe_displacement": strobes[..., probes],
        "smallest_gap": padded([p.gaps for p in points]),
        "low": low[:, probes],
        "high": high[:, probes],
        "iterations": [p.iterations for p in points],
        "state": np.array([p.state for p in points]),
        "event_kind": np.array([e.kind for _, e in events], dtype=object),
        "event_parameter": np.array([e.parameter for _, e in events]),
        "event_low": np.array([e.low for _, e in events]),
        "event_high": np.array([e.high for _, e in events]),
        "event_branch": np.array([n for n, _ in events], np.int64),
        "event_point": np.array([offsets[n] + e.index for n, e in events], np.int64),
    }
    of_key = {"units": unit_of(key, case)}
    endings = [branch.ending for branch in branches]
    data = xr.Dataset(
        attrs={
            "title": f"orbits of {case.name}",
            "case": case.to_toml(),
            "span": span,
            "outcome": "interrupted" if "interrupted" in endings else "completed",
            "endings": ", ".join(endings),
            **provenance(),
            **attributes,
        }
    )
    for name, content in columns.items():
        row = VARIABLES[name]
        labels = of_key if name in _OF_KEY else {"units": row.units} if row.units else {}
        data[name] = (row.dims, np.asarray(content), {"long_name": row.long_name} | labels)
    data["parameter"].attrs["long_name"] = key
    for number, (name, units) in enumerate(channels.items(), start=probes.stop):
        about = {"units": units}
        data[f"{name}_{STROBE}"] = (_CYCLE, strobes[..., number], about)
        data[f"{name}_min"] = (_POINT, low[:, number], about)
        data[f"{name}_max"] = (_POINT, high[:, number], about)
    return data


COLOURS = {"stable": style.BLUE, "unstable": style.VERMILLION, "undecided": style.ORANGE}
MARKS = {"period doubling": "D", "fold": "s", "Neimark-Sacker": "o", "grazing": "x"}
EVENT_COLOURS = {
    "period doubling": style.GREEN,
    "fold": style.BLACK,
    "Neimark-Sacker": style.PURPLE,
    "grazing": style.BLACK,
}
STROBE = "strobe"
"""End of the name of a channel's variable with its values at the beginning of periods."""
SHOWN_MULTIPLIER = 3.0
"""Largest modulus in the panel of multipliers."""


def branch_diagram(data: xr.Dataset, swept: xr.Dataset | None = None) -> Figure:
    """Return the diagram of branches.

    Args:
        data: branches, as `follow` returns them.
        swept: dataset of a sweep over the same key, drawn behind; None: none.

    Raises:
        CaseError: the sweep is not one over this key with stroboscopic points.
    """
    drawn = _drawn(data)
    count = len(drawn)
    figure, (*panels, lowest) = style.stacked(count + 1, 3.1 * count + 2.6, sharex=True)
    for panel, (title, values, of_sweep) in zip(panels, drawn, strict=True):
        unit, factor = style.shown_unit(str(values.attrs["units"]))
        if swept is not None:
            _swept(panel, swept, of_sweep, factor, str(data.attrs["key"]))
        _strobes(panel, data, factor * values.to_numpy())
        if values.name != "strobe_displacement":
            _extremes(panel, data, title, factor)
        panel.set_title(title, loc="left")
        panel.set(ylabel=f"at t = nT  [{unit}]")
    _moduli(lowest, data)
    _legend(panels[0], data, swept)
    key = str(data.attrs["key"])
    units = str(data["parameter"].attrs.get("units", "1"))
    unit = "–" if units == "1" else units
    style.label_x([*panels, lowest], f"{key}  [{unit}]")
    low = float(data["parameter"].min())
    high = float(data["parameter"].max())
    margin = 0.02 * (high - low or abs(low) or 1.0)  # there may be one point alone
    lowest.set_xlim(low - margin, high + margin)
    figure.suptitle(f"{data.attrs['title']}, stability by 95 % intervals")
    return figure


def _drawn(data: xr.Dataset) -> list[tuple[str, xr.DataArray, tuple[str, int | None]]]:
    """Return titles and strobes, shape (n_points, P), of what is drawn: channels, or laminae.

    The third entry is the variable of a sweep that has the same, and the number of the lamina.
    """
    end = f"_{STROBE}"
    names = [str(name) for name in data.data_vars if str(name).endswith(end)]
    if names:
        return [(name.removesuffix(end), data[name], (name, None)) for name in names]
    laminae = [lamina.name for lamina in Case.from_toml(data.attrs["case"]).lamina]
    strobes = data["strobe_displacement"]
    return [
        (f"{name}, displacement", strobes.isel(probe=i), (str(strobes.name), i))
        for i, name in enumerate(laminae[: data.sizes["probe"]])
    ]


def _strobes(panel: Axes, data: xr.Dataset, q: FloatArray) -> None:
    """Draw the points q of all branches in a panel, shape (n_points, P), and the events on them."""
    parameter = data["parameter"].to_numpy()
    branch = data["branch"].to_numpy()
    stability = data["stability"].to_numpy()
    for number in np.unique(branch):
        is_drawn = branch == number
        for cycle in q[is_drawn].T:
            panel.plot(parameter[is_drawn], cycle, color=style.BASE_COLOUR, linewidth=0.8, zorder=2)
    for name, colour in COLOURS.items():
        is_drawn = stability == name
        panel.plot(
            np.repeat(parameter[is_drawn], q.shape[1]), q[is_drawn].ravel(), "o", color=colour,
            markerfacecolor=colour if name == "stable" else "white", markersize=3.2,
            markeredgewidth=0.9, zorder=3,
        )  # fmt: skip
    for k in range(data.sizes["event"]):  # at the height of the points beside it
        kind = str(data["event_kind"][k].item())
        point = int(data["event_point"][k])
        at = float(data["event_parameter"][k])
        low = float(data["event_low"][k])
        high = float(data["event_high"][k])
        heights = 0.5 * (q[point] + q[point - 1])
        for height in heights[np.isfinite(heights)]:
            panel.errorbar(
                at, height, xerr=[[max(at - low, 0.0)], [max(high - at, 0.0)]], fmt=MARKS[kind],
                color=EVENT_COLOURS[kind], markersize=6.0, markerfacecolor="none", capsize=2.0,
                elinewidth=0.9, zorder=4,
            )  # fmt: skip


def _extremes(panel: Axes, data: xr.Dataset, channel: str, factor: float) -> None:
    """Draw smallest and largest value of a channel on each branch."""
    parameter = data["parameter"].to_numpy()
    branch = data["branch"].to_numpy()
    for number in np.unique(branch):
        is_drawn = branch == number
        for end in ("min", "max"):
            values = factor * data[f"{channel}_{end}"].to_numpy()
            label = None if number or end == "max" else "min, max"
            panel.plot(
                parameter[is_drawn], values[is_drawn], ":", color=style.BLACK, linewidth=1.2,
                label=label,
            )  # fmt: skip


def _swept(
    panel: Axes, swept: xr.Dataset, shown: tuple[str, int | None], factor: float, key: str
) -> None:
    """Draw the stroboscopic points of a sweep over the same key."""
    variable, lamina = shown
    names = [str(n) for n in swept.coords if swept[n].attrs.get("key") == key]
    if not names or variable not in swept:
        raise CaseError(f"over: expected a sweep over {key} with stroboscopic points ({variable})")
    strobes = swept[variable] if lamina is None else swept[variable].isel(lamina=lamina)
    q = factor * strobes.transpose(names[0], ...).to_numpy()
    x = swept[names[0]].to_numpy()
    q = q.reshape(len(x), -1)
    panel.plot(np.repeat(x, q.shape[1]), q.ravel(), ".", color="#bbbbbb", markersize=3.0, zorder=1)


def _moduli(panel: Axes, data: xr.Dataset) -> None:
    """Draw the interval of the largest multiplier of each point."""
    panel.axhspan(0.0, 1.0, color=style.GAP_COLOUR, zorder=0)
    stability = data["stability"].to_numpy()
    low = data["largest_low"].to_numpy()
    high = data["largest_high"].to_numpy()
    for name, colour in COLOURS.items():
        is_drawn = stability == name
        middle = 0.5 * (low + high)[is_drawn]
        half = 0.5 * (high - low)[is_drawn]
        panel.errorbar(
            data["parameter"].to_numpy()[is_drawn], middle, yerr=half, fmt="o", color=colour,
            markersize=3.0, markerfacecolor=colour if name == "stable" else "white",
            elinewidth=0.9, capsize=1.5,
        )  # fmt: skip
    panel.set(ylim=(0.0, SHOWN_MULTIPLIER), ylabel="largest |μ|  [–]")


def _legend(panel: Axes, data: xr.Dataset, swept: xr.Dataset | None) -> None:
    """Put a legend of the stabilities and events that occur above the panels."""
    entries: list[tuple[str, dict[str, Any]]] = [
        (name, {"color": colour, "marker": "o", "linestyle": "",
                "markerfacecolor": colour if name == "stable" else "white"})
        for name, colour in COLOURS.items()
        if (data["stability"] == name).any()
    ]  # fmt: skip
    entries += [
        (kind, {"color": EVENT_COLOURS[kind], "marker": mark, "linestyle": "",
                "markerfacecolor": "none"})
        for kind, mark in MARKS.items()
        if (data["event_kind"] == kind).any()
    ]  # fmt: skip
    if swept is not None:
        entries.append(("swept", {"color": "#bbbbbb", "marker": ".", "linestyle": ""}))
    for label, line_style in entries:
        panel.plot([], [], label=label, **line_style)
    panel.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, frameon=False, borderaxespad=0.1
    )


FOLDER = "points"
"""Name of the folder of the points in the folder of a continuation."""
EVERY = 10
"""Points between two lines of progress."""
_NUMBERS = (
    "parameter", "residual", "residual_error", "parameter_error", "step", "doubled", "alternation",
)  # fmt: skip


class PointJournal:
    """The points of all branches of a continuation, one file each.

    Attributes:
        folder: folder of the files.
    """

    def __init__(
        self, directory: Path, plan: Mapping[str, object], case: Case, *, resume: bool
    ) -> None:
        """Open the journal of a continuation, or begin one.

        Args:
            directory: folder of the continuation.
            plan: values that are equal only for the same continuation of a case.
            case: the case.
            resume: whether to go on with the points in the folder.

        Raises:
            CaseError: the points belong to another continuation.
        """
        self.folder = directory / FOLDER
        if not resume:
            remove_kept(self.folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        belong(self.folder, identity(case, **plan))

    def points(self, branch: int, n_state: int) -> list[BranchPoint]:
        """Return the points of a branch, up to the first that is missing or damaged.

        Args:
            branch: number of the branch.
            n_state: number of entries of a state of the map.
        """
        points: list[BranchPoint] = []
        while (path := self._path(branch, len(points))).is_file():
            try:
                values = read_arrays(path)
                numbers = {name: float(values[name]) for name in _NUMBERS}
                point = BranchPoint(
                    **{**values, **numbers, "iterations": int(values["iterations"])}
                )
                _require_fitting(point, n_state)
                points.append(point)
            except (ValueError, KeyError, TypeError) as error:
                _log.warning("%s: computed anew (%s)", path, error)
                break
        return points

    def keep(self, branch: int, number: int, point: BranchPoint) -> None:
        """Write a point and wait until it is on the disk.

        Raises:
            OSError: the file cannot be written.
        """
        write_arrays(self._path(branch, number), dataclasses.asdict(point))

    def _path(self, branch: int, number: int) -> Path:
        return self.folder / f"{branch:02d}-{number:04d}.npz"


def _require_fitting(point: BranchPoint, n_state: int) -> None:
    """Require that the arrays of a point have the shapes of `BranchPoint` and are finite.

    Raises:
        ValueError: they do not.
    """
    m = point.slow.size
    shapes: dict[str, tuple[int, ...]] = {
        "state": (n_state,),
        "slow": (m,),
        "by_parameter": (m,),
        "tangent": (m + 1,),
        "derivatives": (point.derivatives.shape[0], m, m),
        "decays": (*point.decays.shape[:3], m),
        "strobes": (len(point.gaps), len(point.low)),
        "low": (len(point.low),),
        "high": (len(point.low),),
        "gaps": (len(point.gaps),),
    }
    for name, shape in shapes.items():
        values = getattr(point, name)
        if values.shape != shape or values.dtype.kind != "f":
            raise ValueError(f"{name} of another size or type")
    if not all(np.isfinite(values).all() for values in (point.state, point.slow, point.tangent)):
        raise ValueError("numbers that are not finite")


RESULT = "branch.nc"
"""Name of the dataset in the folder of a continuation."""
Progress = Callable[[int, int, float], None]
"""Called with the number of the branch, its number of points and λ after each point."""


@dataclass(frozen=True)
class Plan:
    """Settings of a continuation.

    Attributes:
        key: key of the case that is the parameter.
        way: range of the key, and length of steps.
        periods: P of the first branch.
        doublings: how often a branch of twice the period is followed from a doubling of another.
        settle: periods that are computed before the first orbit is sought.
        perturbations: what the mean is taken over, and the size of kicks.
    """

    key: str
    way: BranchPath
    periods: int
    doublings: int
    settle: int
    perturbations: Perturbations


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
    step: float = BranchPath.step,
    channels: Sequence[str] = (),
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
        channels: names of the channels that are shown; none: those of the reference probes.
        resume: whether to go on with the points in the folder.
        report: called after each point.

    Returns:
        The dataset; `attrs["outcome"]` is "completed" or "interrupted".

    Raises:
        CaseError: the drive is not periodic, the key or its range is not valid, there is no such
            channel, or the folder has points of another continuation.
        ArithmeticError: there is no orbit at the start.
        OSError: the folder cannot be written.
    """
    case = find_case(case)
    if not start != stop:
        raise CaseError(f"{key}: expected a range to follow, given {start:g} to {stop:g}")
    perturbations = perturbations or default_perturbations(case)
    plan = Plan(key, BranchPath(start, stop, step), periods, doublings, settle, perturbations)
    for value in (stop, start):
        case = case.with_overrides({key: value})
    units = seen_channels(case, channels) if channels else {}
    family = map_of(case, key, channels)
    directory = Path(directory)
    begin = time.process_time()
    about = {"plan": asdict(plan), "model": family.info.name, "channels": list(units)}
    journal = PointJournal(directory, about, case, resume=resume)
    map_, state = settled_map(family, start, settle, start_of(case))
    with stop_signals() as is_stopped:
        branches = _branches(map_, state, plan, journal, is_stopped, report)
    attributes = {
        "title": f"orbits of {case.name}, {family.info.name}",
        "key": key, "model": family.info.name, "processor_seconds": time.process_time() - begin,
        "seed": perturbations.seed,
    }  # fmt: skip
    data = of(branches, case, plan.way.span, units, attributes)
    with rewritten(directory):
        save_case(case, directory)
        write_dataset(data, directory / RESULT)
    return data


def _branches(
    map_: PeriodMap,
    state: FloatArray,
    plan: Plan,
    journal: PointJournal,
    is_stopped: Callable[[], bool],
    report: Progress,
) -> list[Branch]:
    """Return all branches from a settled state of a map at the start of the range.

    Each doubling on a branch begins another one, up to `plan.doublings` times in a row.
    """

    def first(ensemble: Ensemble) -> BranchPoint:
        guess, *_ = mean_of_motion(map_, plan.way.start, state, plan.periods)
        return first_point(ensemble, guess, plan.way)

    ready: list[tuple[int, int, Callable[[Ensemble], BranchPoint]]] = [(plan.periods, 0, first)]
    branches: list[Branch] = []
    while ready and (not branches or branches[-1].ending != "interrupted"):
        (periods, doubled, begin), number = ready.pop(0), len(branches)
        ensemble = Ensemble(map_, periods, plan.perturbations)
        points = journal.points(number, state.size)

        def keep(point: BranchPoint, count: int, number: int = number) -> None:
            journal.keep(number, count - 1, point)
            report(number, count, point.parameter)

        if not points:
            try:
                points = [begin(ensemble)]
            except (ArithmeticError, np.linalg.LinAlgError) as error:
                if not branches:
                    raise ArithmeticError(f"no orbit at the start of the range: {error}") from None
                _log.warning("a doubling is not followed: %s", error)
                continue
            keep(points[0], 1)
        branch_points, ending = followed(
            ensemble, points, plan.way, keep=keep, is_stopped=is_stopped
        )
        events = events_of(branch_points, plan.way.span)
        for low, high in turns(branch_points, plan.way.span):
            _log.warning(
                "between %s = %.6g and %.6g a bubble of period %d may be missed: look at a run "
                "there, or take a shorter --step", plan.key, low, high, 2 * periods,
            )  # fmt: skip
        if ending == "lost":
            _log.warning(
                "branch %d is lost behind %s = %.6g, after %d points: at the shortest step %s; try "
                "another --seed, a shorter --step, or --from the other side",
                number, plan.key, branch_points[-1].parameter, len(branch_points),
                why_lost(ensemble, branch_points[-1], plan.way),
            )  # fmt: skip
        branches.append(Branch(periods, tuple(branch_points), tuple(events), ending))
        for event in events if doubled < plan.doublings else ():
            if event.kind == "period doubling" and plan.way.has(event.parameter):
                begin = partial(
                    doubled_point,
                    near=branch_points[event.index],
                    parameter=event.parameter,
                    path=plan.way,
                )
                ready.append((2 * periods, doubled + 1, begin))
    return branches


@dataclass(frozen=True)
class Branches(Finding):
    """Branches that were followed, as a finding.

    Attributes:
        data: the dataset of `follow`.
        swept: a sweep that is drawn behind; None: none.
    """

    data: xr.Dataset
    swept: xr.Dataset | None

    @property
    def report(self) -> Report:
        """Report of the finding on the terminal."""
        data, unit = self.data, _behind(self.data["parameter"].attrs["units"])
        names = ("branch", "kind", "parameter", "low", "high")
        columns = (data[f"event_{name}"].values for name in names)
        rows = [
            (str(int(branch)), str(kind), f"{at:.5g}{unit}", f"{low:.5g} to {high:.5g}{unit}")
            for branch, kind, at, low, high in zip(*columns, strict=True)
        ]
        title = f"on the branches over {data.attrs['key']}"
        n = data.sizes["point"]
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
    """Return the number in a text of the user in a unit; the text may name a unit that fits.

    Raises:
        CaseError: the text is no number, or its unit does not fit.
    """
    try:
        return float(str(in_si(text, unit)))
    except (PydanticCustomError, ValueError) as error:
        reason = error.message() if isinstance(error, PydanticCustomError) else "expected a number"
        raise CaseError(f"{option}: {reason}, given {text!r}") from None


def _behind(unit: str) -> str:
    """Return the unit as a text behind a number; empty behind a pure number."""
    return "" if unit == "1" else f" {unit}"


def compute(case: Case, options: Follow, context: RunContext) -> Branches:
    """Follow with options of a user, who is told every tenth point."""
    unit = unit_of(options.key, case)
    swept = None
    if options.over is not None:
        path = options.over / "sweep.nc" if options.over.is_dir() else options.over
        swept = open_result(path, is_loaded=True)

    def tell(branch: int, count: int, parameter: float) -> None:
        if count == 1 or count % EVERY == 0:
            at = f"{options.key} = {parameter:.5g}{_behind(unit)}"
            _log.info("branch %d: point %d, %s", branch, count, at)

    try:
        data = follow(
            case, options.key, _number(unit, "--from", options.start),
            _number(unit, "--to", options.stop), context.folder, periods=options.period,
            doublings=options.doublings, perturbations=kicks(options, case), step=options.step,
            channels=options.channel, resume=context.resume, report=tell,
        )  # fmt: skip
    except ArithmeticError as error:
        raise CaseError(f"case {case.name}: {error}") from None
    return Branches(data, swept)
