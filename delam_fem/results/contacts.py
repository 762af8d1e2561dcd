"""What each contact of a run does: strikes, speeds of approach, impulses, forces.

A contact is an interface, a stop or an impactor. It is closed where one of its pairs is closed: its
gap is not positive, or it is hit within the step. Closures less than
`diagnostics.GROUP_PERIODS` apart are one strike. An interface is judged at the reference probes,
because near a clamp some of its pairs touch all the time; its impulses and forces are those of all
its pairs.

The gaps of stops and impactors are recorded at each step: `stops_sensors.with_sensors`. Those of
interfaces are, if a sensor reads contact forces. Otherwise the springs of interfaces are known at
the frames alone, because to record all gaps takes as long as the steps themselves.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.unread import is_elastic
from delam_fem.contact.laws import LAWS
from delam_fem.model.contacts import tables_of
from delam_fem.model.layout import Layout, Structure
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.results.diagnostics import (
    GROUP_PERIODS,
    ProbeMotion,
    count_contacts,
    group_begins,
    of_interface,
)
from delam_fem.simulation.recorder import RESTING, Recorder
from delam_fem.simulation.signals import (
    contact_forces,
    frames_of,
    law_numbers,
    recorded_gaps,
    spring_forces,
)

if TYPE_CHECKING:
    import xarray as xr

Kind = Literal["interface", "stop", "impactor"]


@dataclass(frozen=True)
class ContactSummary:
    """What a contact did in the window of a run; an entry of `contacts` in summary.json.

    Attributes:
        name: name of the interface, or "stop 1", "impactor 1", as the case counts them.
        kind: "interface", "stop" or "impactor".
        strikes_per_period: strikes per period of the window; None: not known.
        approach_velocity: mean speed of approach of the strikes [m/s]; None: there are none.
        impulse: mean impulse of a strike, by impacts and by springs [N s]; None: no strikes, or
            forces are not known.
        peak_force: largest force at the end of a step, or at a frame, positive in compression [N];
            None: impacts are impulses and have no force, or it is not known.
        closed_share: share of the steps at which the contact is closed [-]; None: not known.
    """

    name: str
    kind: Kind
    strikes_per_period: float | None
    approach_velocity: float | None
    impulse: float | None
    peak_force: float | None
    closed_share: float | None


@dataclass(frozen=True)
class _Histories:
    """Gaps, spring forces and impacts of a window of k steps.

    Attributes:
        first: number of the first pair whose gaps are known; those of all later ones are.
        gap: gaps at the start of the window and after each step, shape (k + 1, n_known) [m].
        rate: gap rates, likewise [m/s].
        force: forces of contact springs after each step, shape (k, n_known) [N].
        hit: pair of each impulse, shape (n,).
        step: step of each impulse, from 0, shape (n,).
        impulse: the impulses, shape (n,) [N s].
        approach: speeds of approach before them, shape (n,) [m/s].
        has_springs: whether pairs may carry a spring, shape (n_pairs,).
        is_elastic: whether they are springs whenever they are closed, shape (n_pairs,).
    """

    first: int
    gap: FloatArray
    rate: FloatArray
    force: FloatArray
    hit: IntArray
    step: IntArray
    impulse: FloatArray
    approach: FloatArray
    has_springs: BoolArray
    is_elastic: BoolArray

    @property
    def n_steps(self) -> int:
        """Number of steps."""
        return len(self.force)

    def knows(self, pairs: IntArray) -> bool:
        """Return whether the gaps of some pairs are known at each step."""
        return bool(pairs.size and pairs[0] >= self.first)

    def is_closed(self, pairs: IntArray) -> BoolArray:
        """Return after which steps one of some pairs is closed, shape (k,)."""
        closed = (self.gap[1:, pairs - self.first] <= 0.0).any(axis=1)
        closed[self.step[np.isin(self.hit, pairs)]] = True
        return np.asarray(closed)

    def approach_at(self, step: int, pairs: IntArray) -> float | None:
        """Return the speed at which the first of some pairs closes within a step [m/s].

        It is that before the impact; of a spring that of the instant at which the gap is 0, by
        linear interpolation. It is None if all of them were closed before.
        """
        is_impact = (self.step == step) & np.isin(self.hit, pairs)
        if is_impact.any():
            return float(self.approach[is_impact].max())
        columns = pairs - self.first
        before, after = self.gap[step, columns], self.gap[step + 1, columns]
        closes = (after <= 0.0) & (before > 0.0)
        if not closes.any():
            return None
        share = before[closes] / (before - after)[closes]
        start = self.rate[step, columns][closes]
        end = self.rate[step + 1, columns][closes]
        return float(-(start + share * (end - start)).min())

    def impulses(self, pairs: IntArray) -> FloatArray:
        """Return the sum of the impulses on some pairs within each step, shape (k,) [N s]."""
        is_here = np.isin(self.hit, pairs)
        return np.bincount(
            self.step[is_here], weights=self.impulse[is_here], minlength=self.n_steps
        ).astype(np.float64)


def of_run(
    recorder: Recorder, structure: Structure, case: Case, history: xr.Dataset
) -> list[dict[str, Any]]:
    """Return the entry `contacts` of a summary: what each contact did, from `ContactSummary`.

    Args:
        recorder: recorder of the run, after at least one period.
        structure: structure that moved.
        case: its case.
        history: dataset of the run.

    Returns:
        Interfaces, stops and impactors in this order; empty with the law "none".
    """
    layout = structure.layout
    N = case.steps_per_period
    if case.contact.law == "none" or not layout.touching:
        return []
    known = _histories(recorder, structure, case)
    motion = ProbeMotion.of(history)
    at_frames: FloatArray | None = None
    if layout.interfaces and known.has_springs[: layout.interfaces[-1].pairs.stop].any():
        at_frames = _forces_at_frames(recorder, structure, case)
    at_references = layout.pairs_at_references()
    entries = []
    for number, interface in enumerate(layout.interfaces):
        pairs = np.arange(interface.pairs.start, interface.pairs.stop)
        if at_references[number] is not None:
            closed = motion.is_closed[number]
            strikes = of_interface(history, N, number)
            speeds = [strikes.approach] if strikes.step.size else []
            about = _strikes(closed, speeds, N)
        else:
            about = {}
        contact = _contact(interface.name, "interface", known, pairs, case, about, at_frames)
        entries.append(contact)
    for kind, name, pairs in stops_of(layout, case):
        closed = known.is_closed(pairs)
        begins = group_begins(closed, GROUP_PERIODS * N).tolist()
        speeds = [speed for step in begins if (speed := known.approach_at(step, pairs)) is not None]
        about = _strikes(closed, speeds, N)
        entries.append(_contact(name, kind, known, pairs, case, about))
    return [asdict(contact) for contact in entries]


def stops_of(layout: Layout, case: Case) -> Iterator[tuple[Kind, str, IntArray]]:
    """Yield kind, name and pairs of each stop and impactor."""
    for number in dict.fromkeys(stop.number for stop in layout.stops):
        sides = [stop.pairs for stop in layout.stops if stop.number == number]
        pairs = np.concatenate([np.arange(rows.start, rows.stop) for rows in sides])
        yield *named(number, case), pairs


def pairs_of(layout: Layout, case: Case) -> dict[str, IntArray]:
    """Return the pairs of each contact by its name: of interfaces, stops and impactors."""
    of_interfaces = {
        interface.name: np.arange(interface.pairs.start, interface.pairs.stop)
        for interface in layout.interfaces
    }
    return of_interfaces | {name: pairs for _, name, pairs in stops_of(layout, case)}


def histories(
    recorder: Recorder, structure: Structure, case: Case, *, of_springs: bool = False
) -> dict[str, tuple[str, FloatArray]]:
    """Return the forces, or impulses, of all contacts that have a history, by name.

    Args:
        recorder: recorder of the run, after at least one period.
        structure: structure that moved.
        case: its case.
        of_springs: only contacts with springs that are recorded at each step.

    Returns:
        Unit, see `force_unit`, and springs' forces and impulses over Δt, positive in compression
        [N], or the impulses of each step [N s]; each of shape (k,).
    """
    layout = structure.layout
    numbers = law_numbers(case, structure.operators)
    n_pairs = structure.operators.n_pairs
    has_springs = layout.gap_row is not None and bool(numbers.has_springs(n_pairs).any())
    if case.contact.law == "none" or not layout.touching or (of_springs and not has_springs):
        return {}
    known = _histories(recorder, structure, case)
    result = {}
    for name, rows in pairs_of(layout, case).items():
        is_recorded = known.knows(rows)
        unit = force_unit(case, name, is_recorded=is_recorded)
        if of_springs and not is_recorded:
            continue
        force = _spring_force(known, rows, case, None)
        if unit == "N s":
            result[name] = unit, known.impulses(rows)
        elif unit and force is not None:
            result[name] = unit, force + known.impulses(rows) / case.time_step
    return result


def force_unit(case: Case, name: str, *, is_recorded: bool) -> str:
    """Return the unit of the history of a contact, N or N s; empty: it has none.

    Args:
        case: case of the run.
        name: name of the contact.
        is_recorded: whether its gaps, and so the forces of its springs, are recorded at each step.
    """
    law = case.contact.law
    if law == "none":
        return ""
    elastic = [is_elastic(case, table) for table in tables_of(case, name)] or [law == "penalty"]
    if is_recorded or not (LAWS[law].spring or any(elastic)):
        return "N"
    return "" if all(elastic) else "N s"


def named(number: int, case: Case) -> tuple[Kind, str]:
    """Return the kind and the name of a stop; impactors count on behind all stops, from 0."""
    if number < len(case.stop):
        return "stop", f"stop {number + 1}"
    return "impactor", f"impactor {number - len(case.stop) + 1}"


def _histories(recorder: Recorder, structure: Structure, case: Case) -> _Histories:
    """Return gaps, forces and impacts of the window."""
    o = structure.operators
    impacts = recorder.impacts()
    gap, rate = recorded_gaps(recorder, structure)
    forces = [spring_forces(record, structure, case) for record in recorder.window]
    numbers = law_numbers(case, o)
    return _Histories(
        first=o.n_pairs - gap.shape[1],
        gap=gap,
        rate=rate,
        force=np.concatenate(forces),
        hit=impacts.hit,
        step=impacts.steps(recorder.refine),
        impulse=impacts.impulses,
        approach=-impacts.rate_pre,
        has_springs=numbers.has_springs(o.n_pairs),
        is_elastic=numbers.closes_springs(o.n_pairs),
    )


def _strikes(closed: BoolArray, speeds: list[float], N: int) -> dict[str, float | None]:
    """Return the entries that follow from when a contact is closed.

    Args:
        closed: whether it is closed after each step, shape (k,).
        speeds: speeds of approach of its strikes [m/s].
        N: steps per period.
    """
    count = count_contacts(closed, GROUP_PERIODS * N)
    return {
        "strikes_per_period": count * N / closed.size,
        "approach_velocity": float(np.mean(speeds)) if speeds else None,
        "closed_share": float(closed.mean()),
    }


def _contact(
    name: str,
    kind: Kind,
    known: _Histories,
    pairs: IntArray,
    case: Case,
    about: Mapping[str, float | None],
    at_frames: FloatArray | None = None,
) -> ContactSummary:
    """Return what a contact did, with its forces.

    Args:
        name: its name.
        kind: its kind.
        known: histories of the window.
        pairs: its pairs.
        case: case of the run.
        about: what `_strikes` returns; empty: not known.
        at_frames: forces of the springs of all pairs at the frames, shape (n_frames, n_pairs) [N];
            None: there are no frames.
    """
    duration = known.n_steps * case.time_step
    impulses = known.impulses(pairs)
    force = _spring_force(known, pairs, case, at_frames)
    if force is None:
        total, peak = None, None
    else:  # the impulses of massless contact points are contact forces times the step
        total = float(impulses.sum() + force.mean() * duration)
        force = force + impulses / case.time_step if case.is_massless else force
        has_force = case.is_massless or bool(known.is_elastic[pairs].all())
        peak = float(force.max()) if has_force else None
    strikes = about.get("strikes_per_period")
    count = (strikes or 0.0) * known.n_steps / case.steps_per_period
    return ContactSummary(
        name,
        kind,
        strikes,
        about.get("approach_velocity"),
        None if total is None or not count else total / count,
        peak,
        about.get("closed_share"),
    )


def _spring_force(
    known: _Histories, pairs: IntArray, case: Case, at_frames: FloatArray | None
) -> FloatArray | None:
    """Return the force of springs on some pairs at even instants of the window; None: not known.

    Args:
        known: histories of the window.
        pairs: the pairs.
        case: case of the run.
        at_frames: forces of the springs of all pairs at the frames, shape (n_frames, n_pairs) [N];
            None: there are no frames.
    """
    if not known.has_springs[pairs].any():
        return np.zeros(known.n_steps)
    if known.knows(pairs):
        return np.asarray(known.force[:, pairs - known.first].sum(axis=1))
    return None if at_frames is None else np.asarray(at_frames[:, pairs].sum(axis=1))


def _forces_at_frames(recorder: Recorder, structure: Structure, case: Case) -> FloatArray | None:
    """Return the forces of the springs of all pairs at the frames, shape (n_frames, n_pairs) [N].

    They are None without frames. Ranks that share the dofs add them up (collective).
    """
    o = structure.operators
    frames = frames_of(recorder)
    if not frames.states:
        return None
    u, v = np.array(frames.states).swapaxes(0, 1)
    gap = o.gap0 + o.total(u @ o.gap_matrix.T)
    rate = o.total(v @ o.gap_matrix.T)
    numbers = law_numbers(case, o)
    carries = np.where(numbers.closes_springs(o.n_pairs), gap <= 0.0, frames.contact == RESTING)
    spring = numbers.stiffness, numbers.dampings(o.n_pairs)
    return contact_forces(spring, gap, rate, carries, o.pair_weights)
