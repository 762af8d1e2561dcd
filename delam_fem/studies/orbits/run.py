"""Find the periodic orbit of a case, and report it in numbers, sentences and figures.

In Python:

    import delam_fem as df
    found = df.orbit(df.preset("paper", {"excitation.frequency": 3.5}))
    found.stability, found.numbers["multipliers"]
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from delam_fem.api import (
    Case,
    CaseError,
    CaseSource,
    Finding,
    FloatArray,
    Report,
    RunContext,
    Table,
    find_case,
    identity,
    record,
    require,
    style,
    versions,
    write_arrays,
)
from delam_fem.studies.orbits.maps import FREQUENCY, KeptMap, MapInfo, PeriodMap, Trajectory
from delam_fem.studies.orbits.newton import EXACT, Perturbations
from delam_fem.studies.orbits.search import (
    RESETTLE,
    SETTLE,
    Coarse,
    Exact,
    Stability,
    coarse_orbit,
    columns_of,
    default_perturbations,
    exact_orbit,
    kicks,
    map_of,
    mean_of_motion,
    seen_channels,
    settled,
    settled_map,
    stability_of,
    start_of,
)
from delam_fem.studies.orbits.study import Orbit as Options

LEAST_REACH = 1.15
"""Half the width of the plane of multipliers that is always shown."""
SHOWN = 60
"""Largest number of bootstrap samples that are drawn as small points, about."""


def orbit_figure(found: PeriodicOrbit) -> Figure:
    """Return a figure with channels over the orbit's periods, and the multipliers."""
    units = list(dict.fromkeys(found.channels.values()))
    figure = Figure(figsize=(style.WIDTH, max(4.3, 1.4 + 2.4 * len(units))), layout="constrained")
    grid = figure.add_gridspec(len(units), 2, width_ratios=(1.25, 1.0))
    motions = [figure.add_subplot(grid[row, 0]) for row in range(len(units))]
    plane = figure.add_subplot(grid[:, 1])
    colours = style.lamina_colours(len(found.channels))
    for (name, values), colour in zip(found.histories.items(), colours, strict=True):
        motion = motions[units.index(found.channels[name])]
        unit, factor = style.shown_unit(found.channels[name])
        t = found.periods * np.arange(1, values.size + 1) / values.size
        motion.plot(t, factor * values, color=colour, label=name)
        motion.plot(t[-1], factor * values[-1], "o", color=colour, markersize=4.0)
        motion.set_ylabel(f"[{unit}]")
        motion.legend(loc="best")
    for motion in motions[:-1]:
        motion.tick_params(labelbottom=False)
    motions[-1].set_xlabel("time / period of the drive  t/T  [–]")
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    plane.fill(np.cos(angle), np.sin(angle), color=style.GAP_COLOUR, zorder=0)
    plane.plot(np.cos(angle), np.sin(angle), color=style.BASE_COLOUR, linewidth=1.0)
    reach = LEAST_REACH
    m = found.coarse.multipliers
    cloud = m.samples[:: max(len(m.samples) // SHOWN, 1)].ravel()
    plane.plot(cloud.real, cloud.imag, ".", color=style.BLUE, markersize=1.5, alpha=0.35)
    plane.plot(
        m.values.real, m.values.imag, "o", color=style.BLUE, markersize=5.0, markerfacecolor="none",
        label=f"kicks of {100.0 * found.coarse.kick:.3g} %",
    )  # fmt: skip
    reach = max(reach, 1.1 * float(np.abs(m.values).max()))
    if found.exact is not None:
        mu = found.exact.values
        plane.plot(mu.real, mu.imag, "x", color=style.BLACK, markersize=5.0, label="derivative")
        reach = max(reach, 1.1 * float(np.abs(mu).max()))
    plane.set(
        xlim=(-reach, reach),
        ylim=(-reach, reach),
        aspect="equal",
        xlabel="Re μ  [–]",
        ylabel="Im μ  [–]",
    )
    plane.legend(loc="upper right", fontsize=8.0)
    numbers = found.numbers
    is_closed = found.exact is not None or found.coarse.solved.is_solved
    figure.suptitle(
        f"{found.case.title}\n{found.info.name}: {found.kind if is_closed else 'no'} orbit of "
        f"{found.periods} period{'s' * (found.periods > 1)}, residual {numbers['residual']:.1e} ± "
        f"{numbers['residual_error']:.1e}: {found.stability}"
    )
    return figure


LEFT = 0.1
"""Distance from an orbit, relative to the state, at which a motion has left it."""
LISTED = 0.05
"""Modulus below which multipliers of an exact orbit are not listed."""


@dataclass(frozen=True)
class PeriodicOrbit(Finding):
    """A periodic orbit of a case.

    Attributes:
        case: the case.
        periods: P, number of periods of the drive in one of the orbit.
        coarse: the orbit of the mean map.
        exact: the orbit of the map itself; None: there is none.
        best_residual: smallest residual of the exact search.
        scatter: rms distance of the settled motion from its mean state, relative to it.
        info: what the map is of.
        trajectory: the motion from the state of the orbit through its periods.
        channels: units of the channels that are shown, by their names.
        seconds: processor time of the search [s].
        evaluations: periods that were computed.
        phase: where in a period of the drive the orbit begins, 0 to 1.
    """

    case: Case
    periods: int
    coarse: Coarse
    exact: Exact | None
    best_residual: float
    scatter: float
    info: MapInfo
    trajectory: Trajectory
    channels: Mapping[str, str]
    seconds: float
    evaluations: int
    phase: float = 0.0

    @property
    def histories(self) -> dict[str, FloatArray]:
        """Channels that are shown at each step of the orbit, each of shape (n_steps,)."""
        columns = columns_of(self.trajectory.history, self.channels, self.case)
        return dict(zip(self.channels, columns.T, strict=False))  # of a map of one's own

    @property
    def kind(self) -> str:
        """Kind of the orbit, "exact" or "coarse"."""
        return "coarse" if self.exact is None else "exact"

    @property
    def state(self) -> FloatArray:
        """The state at the beginning of a period, see `info.parts`."""
        return self.coarse.solved.state if self.exact is None else self.exact.root.state

    @property
    def stability(self) -> Stability:
        """Stability by the decay of kicks; undecided where the mean map has no solved orbit.

        The derivative of an exact orbit has to agree where the map is not stepped: that of a
        stepped one sees no shift of an impact to another step. An orbit is never stable if a motion
        from beside it leaves it, or becomes one of a multiple of P. Where such a motion leaves it
        and kicks leave the stability open, the orbit is unstable.
        """
        coarse = self.coarse
        if not coarse.solved.is_solved:
            return "undecided"
        votes = {coarse.stability}
        if self.exact is not None and not self.info.is_stepped:
            largest = float(abs(self.exact.values[0]))
            votes.add(stability_of(largest, largest))
        if coarse.away > LEFT:
            return "undecided" if "stable" in votes else "unstable"
        if len(votes) > 1 or (coarse.multiple is not None and votes == {"stable"}):
            return "undecided"
        return votes.pop()

    @property
    def numbers(self) -> dict[str, Any]:
        """Content of orbit.json."""
        solution = self.coarse.solved
        m = self.coarse.multipliers
        values, errors = m.values, m.errors
        if self.exact is not None and not self.info.is_stepped:
            is_listed = np.abs(self.exact.values) > LISTED
            values = self.exact.values[is_listed]
            errors = self.exact.errors[is_listed]
        return {
            "kind": self.kind,
            "model": self.info.name,
            "residual": solution.residual if self.exact is None else self.exact.root.residual,
            "residual_error": solution.residual_error if self.exact is None else 0.0,
            "period": self.periods * self.case.period,
            "drive_periods": self.periods,
            "phase": self.phase,
            "multipliers": np.column_stack([values.real, values.imag]).tolist(),
            "multipliers_error": errors.tolist(),
            "stability": self.stability,
            "largest_multiplier": list(self.coarse.multipliers.largest),
            "coarse": {
                "residual": solution.residual,
                "residual_error": solution.residual_error,
                "is_solved": solution.is_solved,
                "iterations": solution.iterations,
                "kick": self.coarse.kick,
                "stability": self.coarse.multipliers.stability,
            },
            "exact_search": {
                "smallest_residual": self.best_residual,
                "needed": EXACT,
                "grid_shift": None if self.exact is None else self.exact.root.shift,
            },
            "settled_scatter": self.scatter,
            "runs_on_away": self.coarse.away,
            "runs_on_to": None if self.coarse.multiple is None else asdict(self.coarse.multiple),
            "smallest_tip_gap": self.trajectory.smallest_gap,
            "tip_strobe": self.trajectory.strobes.tolist(),
            "tip_min": self.trajectory.low.tolist(),
            "tip_max": self.trajectory.high.tolist(),
            "channels": {
                name: record.measures_of(values, self.channels[name])
                for name, values in self.histories.items()
            },
            "says": self.words,
            "evaluations": self.evaluations,
            "processor_seconds": self.seconds,
            "versions": versions(),
        }

    @property
    def words(self) -> list[str]:
        """Sentences on what the numbers mean."""
        solution = self.coarse.solved
        known = f"{solution.residual:.2g} ± {solution.residual_error:.2g} of the state"
        if self.exact is not None:
            grid = f" on a grid of time steps shifted by {self.exact.root.shift:g} of a step"
            first = (
                f"An exact orbit: it closes to {self.exact.root.residual:.1e}"
                f"{grid * self.info.is_stepped}."
            )
        elif solution.is_solved:
            first = (
                f"A coarse orbit: the mean map closes within its error ({known}). The map itself "
                f"has no orbit that was found; it closes to {self.best_residual:.1e} at best."
            )
        else:
            first = (
                f"No orbit: the mean map does not close within its error ({known}), and the map "
                f"itself closes to {self.best_residual:.1e} at best."
            )
        m = self.coarse.multipliers
        low, high = m.largest
        lines = [
            first,
            f"Decay of kicks of {100.0 * self.coarse.kick:.3g} % of the state: largest multiplier "
            f"{low:.3f} to {high:.3f} (95 %{', with these steps' * self.info.is_stepped}), "
            f"{m.stability}.",
        ]
        if self.exact is not None:
            blind = " It sees no shift of an impact to another time step, and has no say."
            lines.append(
                f"Its derivative: largest multiplier {abs(self.exact.values[0]):.4f}."
                f"{blind * self.info.is_stepped}"
            )
        lines.append(
            f"A motion from beside the orbit runs on to {100.0 * self.coarse.away:.2g} % of the "
            "state away."
            + " It stays, and larger kicks decay: the steps hold the small ones."
            * (self.coarse.stability != m.stability)
        )
        if (multiple := self.coarse.multiple) is not None:
            lines.append(
                f"The motion repeats after {multiple.times * self.periods} periods; its states "
                f"{self.periods} apart differ by {100.0 * multiple.distance:.2g} % of the state, "
                "so that this orbit is not called stable."
            )
        return [*lines, f"Together: {self.stability}."]

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        units = {
            "kind": "", "model": "", "residual": "", "residual_error": "", "period": "s",
            "stability": "", "largest_multiplier": "", "settled_scatter": "",
            "smallest_tip_gap": "m", "processor_seconds": "s",
        }  # fmt: skip
        numbers = self.numbers
        rows = [
            (name.replace("_", " "), f"{_shown(numbers[name])} {unit}".strip())
            for name, unit in units.items()
            if numbers[name] != np.inf  # no gap is seen
        ]
        return Report(
            name="orbit",
            numbers=numbers,
            case=self.case,
            tables=[Table(f"orbit of {self.case.name}", ("", "value"), rows)],
            sentences=self.words,
            pictures={"orbit": (lambda: orbit_figure(self), "")},
        )

    def save(self, directory: str | Path) -> list[Path]:
        """Write case.toml, orbit.json, orbit.png and orbit.npz to a folder.

        Raises:
            OSError: the folder cannot be written.
        """
        written = super().save(directory)
        path = Path(directory) / "orbit.npz"
        arrays = {"tip_displacement": self.trajectory.history, **self.info.split(self.state)}
        arrays |= self.histories
        return [*written, write_arrays(path, arrays)]


def _shown(value: object) -> str:
    """Return a value as text."""
    if isinstance(value, list):
        return ", ".join(_shown(entry) for entry in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)


MOST_PERIODS = 64
"""Largest period of an orbit, in periods of the drive."""


def orbit(
    case: CaseSource,
    *,
    periods: int = 1,
    settle: int = SETTLE,
    perturbations: Perturbations | None = None,
    map_: PeriodMap | None = None,
    start: FloatArray | None = None,
    kept: Path | None = None,
    channels: Sequence[str] = (),
) -> PeriodicOrbit:
    """Find the orbit near where the motion of a case settles, and judge its stability.

    The search starts from the mean of the settled motion. So it also finds an unstable orbit in the
    middle of that motion.

    Args:
        case: the case; its drive must be periodic.
        periods: P, number of periods of the drive in one of the orbit.
        settle: periods that are computed first.
        perturbations: what the mean is taken over, and the size of kicks; None: what suits the
            case.
        map_: map of the case, with the parameter excitation.frequency, and `start` near its orbit;
            None: that of the model, whose periods begin where the gap is wide.
        start: state to start from, see `maps.MapInfo`; None: that of the case.
        kept: folder for results of the map, with which the same search goes on; None: none are
            kept.
        channels: names of the channels that are shown; none: those of the reference probes.

    Raises:
        CaseError: the drive is not periodic, the motion diverges, P is out of range, or there is no
            such channel.
    """
    case = find_case(case)
    require(map_ is None or not channels, "channels", "none with a map of one's own", channels)
    units = seen_channels(case, channels)
    require(1 <= periods <= MOST_PERIODS, "period", f"1 to {MOST_PERIODS} periods", periods)
    began = time.process_time()
    parameter = 1.0 / case.period
    try:
        if map_ is None:
            period_map = map_of(case, FREQUENCY, channels)
            if kept is not None:
                period_map = KeptMap(period_map, kept / "map", identity(case))
            map_, start = settled_map(
                period_map, parameter, settle, start_of(case) if start is None else start
            )
        at_end = settled(map_, parameter, start, RESETTLE)
        guess, scatter, multiple = mean_of_motion(map_, parameter, at_end, periods)
        coarse = coarse_orbit(
            map_, parameter, guess, periods, perturbations or default_perturbations(case), multiple
        )
        exact, best = exact_orbit(map_, parameter, at_end, periods)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise CaseError(f"case {case.name}: no orbit is found: {error}") from None
    state = coarse.solved.state if exact is None else exact.root.state
    return PeriodicOrbit(
        case,
        periods,
        coarse,
        exact,
        best.residual,
        scatter,
        map_.info,
        map_.trajectory(state, parameter, periods),
        units,
        time.process_time() - began,
        getattr(map_, "evaluations", 0),
        getattr(map_, "phase", 0.0),
    )


def compute(case: Case, options: Options, context: RunContext) -> PeriodicOrbit:
    """Find the orbit of a case with the options of a user."""
    return orbit(
        case,
        periods=options.period,
        settle=options.settle,
        perturbations=kicks(options, case),
        kept=context.checkpoints,
        channels=options.channel,
    )
