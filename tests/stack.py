"""Three laminae of prescribed motion as a recorder keeps them, with all results known exactly.

The reference probes are not at the last node, and a fourth probe measures something else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Annotated

import numpy as np
import scipy.sparse as sp
import xarray as xr
from pydantic import Field
from synthetic import FRAMES, LEDGER, NODES, STEPS, WINDOW, small_case

from delam_fem import Case, Decision
from delam_fem.api import N_BASE, Lamina, PeriodRecord, Structure, assemble
from delam_fem.case.sections import Stop
from delam_fem.model.layout import Probe
from delam_fem.results import dataset
from delam_fem.results.schema import add
from delam_fem.simulation import recorder
from delam_fem.simulation.recorder import Jumps

PERIODS = 10
NODE = 4
"""Node of the reference probes."""
AMPLITUDES = np.array([0.016, 0.004, 0.006])
"""Amplitudes of the laminae at the probes [m]."""
PHASES = np.array([0.0, 0.5, 1.1])
GAPS = np.array([0.030, 0.020])
"""Gaps at rest at the probes [m]."""
STRIKES = {0: 0.25, 1: 0.75}
"""Phase within the period at which the pair at the probes of each interface is hit."""
IMPULSES = {0: (1e-3,), 1: (3e-3, 1e-3)}
"""Impulses at the probe and, on the upper interface, at the node before it [N s]."""
STOPS = (
    Stop(lamina="thin", side="above", gap=0.002, position=0.2),
    Stop(lamina="thick", side="below", gap=0.003, position=0.3, on="ground"),
)
"""The stops of `with_stops`."""
PAIRS = NODES - 1
"""Pairs of an interface; pair k of it is at node k + 1."""


class Stack(Case):
    """A case with any number of laminae."""

    lamina: Annotated[tuple[Lamina, ...], Field()]


class Kept(SimpleNamespace):
    """What a recorder holds after a run."""

    impacts = recorder.Recorder.impacts


@dataclass(frozen=True)
class Recorded:
    """A case, its structure and the record of its motion."""

    case: Case
    structure: Structure
    recorder: Kept

    def history(self) -> xr.Dataset:
        """Return the dataset of the motion."""
        attributes = {"outcome": "completed", "engine": "compiled"}
        return dataset.history(self.recorder, self.structure, self.case, attributes)


def three_laminae(**overrides: object) -> Recorded:
    """Return three laminae that move as (x / x_probe)^2 A_i sin(2 pi t + phase_i)."""
    case = _case(overrides)
    structure = _structure(case)
    window = [_record(case, structure, PERIODS - WINDOW + j) for j in range(WINDOW)]
    at_ends = np.stack([q(np.arange(1.0, PERIODS + 1)), q_rate(case, np.arange(1.0, PERIODS + 1))])
    probes = np.concatenate([at_ends, np.full((2, 1, PERIODS), 77.0)], axis=1)
    strobe = probes.transpose(2, 0, 1)
    ledger = np.tile([LEDGER[name] for name in recorder.LEDGER], (PERIODS, 1))
    return Recorded(
        case,
        structure,
        Kept(
            window=window,
            steps_per_period=STEPS,
            refine=1,
            is_forced=False,
            n_forces=0,
            time_step=case.time_step,
            n_closed=PERIODS,
            strobe=strobe,
            envelope=strobe[:, :1] + np.array([-0.01, 0.01])[:, None],
            impulse=np.tile([5e-3, 3.0, 0.0], (PERIODS, 1)),
            ledger=ledger,
            energy_residual=lambda: 0.0,
        ),
    )


def with_stops(history: xr.Dataset) -> xr.Dataset:
    """Return a history with two stops, an impactor on two springs, and a stop of the top lamina.

    The numbers of stops are 1 and 2, that of the impactor is 3. Some of them are struck.
    """
    time = history["time"].to_numpy()
    add(history, base_displacement=0.003 * np.cos(time))
    add(history, stop_lamina=[1, 0, 2, 2, 1], stop_node=[2, 3, 5, 5, 4])
    add(history, stop_number=[1, 2, 3, 3, 1], stop_on_base=[1, 0, 0, 0, 1])
    add(history, stop_height=[0.002, -0.003, 0.004, 0.0045, -0.001])
    state = np.zeros((history.sizes["frame"], 5), dtype=np.int8)
    state[-5:, 1], state[-3:, 4], state[-9:, 0], state[-4:, 2] = 2, 2, 1, 1
    add(history, stop_state=state, stop_heat=[0.0, 2e-3, 1e-3, 1e-4, 4e-3])
    flown = np.array([0.1 * np.sin(time) + np.where(time > time[-20], 9.0, 0.0)])
    add(history, impactor_displacement=flown)
    n = history.sizes["event"]
    add(history, event_stop=np.resize([-1, 0, 1, 2, 3, 4], n))
    add(history, event_interface=np.where(history["event_stop"] < 0, 1, -1))
    history["event_time"].to_numpy()[:] = np.linspace(0.8, 0.999, n) * time[-1]
    return history


def q(t: np.ndarray) -> np.ndarray:
    """Return displacements of the probes at times in periods, shape (3, n) [m]."""
    return AMPLITUDES[:, None] * np.sin(2.0 * np.pi * t + PHASES[:, None])


def q_rate(case: Case, t: np.ndarray) -> np.ndarray:
    """Return velocities of the probes at times in periods, shape (3, n) [m/s]."""
    omega = 2.0 * np.pi / case.period
    return omega * AMPLITUDES[:, None] * np.cos(2.0 * np.pi * t + PHASES[:, None])


def shape(x: np.ndarray) -> np.ndarray:
    """Return the shape of all laminae and gaps along x, 1 at the probes."""
    return (x / x[NODE]) ** 2


def _case(overrides: dict[str, object]) -> Case:
    """Return a case of three laminae, which no case file allows yet."""
    two = small_case(time__periods=PERIODS, **overrides)
    thick, thin = two.lamina
    top = thin.model_copy(update={"name": "top", "thickness": 0.0015, "width": 0.030})
    fields = {name: getattr(two, name) for name in Case.model_fields} | {"lamina": ()}
    return Stack.model_construct(**fields).model_copy(update={"lamina": (thick, thin, top)})


def _structure(case: Case) -> Structure:
    """Return the structure with its reference probes at `NODE` and one further probe."""
    made = assemble(case, needs_dolfinx=False)
    layout, o = made.layout, made.operators
    probes = (*(Probe("tip", i, NODE) for i in range(3)), Probe("mid", 1, 2))
    gap0 = np.concatenate([gap * shape(layout.x)[1:] for gap in GAPS])
    rows = sp.csr_matrix((len(probes), o.n_dofs))
    return Structure(replace(o, gap0=gap0, probes=rows), replace(layout, probes=probes))


def _record(case: Case, structure: Structure, period: int) -> PeriodRecord:
    """Return the record of one period."""
    layout = structure.layout
    t = period + np.arange(STEPS + 1) / STEPS
    u = np.full((STEPS + 1, N_BASE + 4), 77.0)
    v = np.full((STEPS + 1, 4), 77.0)
    u[:, N_BASE : N_BASE + 3], v[:, :3] = q(t).T, q_rate(case, t).T
    frame_steps = np.arange(1, FRAMES + 1) * (STEPS // FRAMES)
    state = np.zeros((FRAMES, 2, structure.operators.n_dofs))
    x = layout.x[1:]
    for part, now, rate in zip(
        layout.parts, q(t[frame_steps]), q_rate(case, t[frame_steps]), strict=True
    ):
        dofs, along = part.dofs[1:], np.stack([x**2, 2.0 * x], axis=1) / layout.x[NODE] ** 2
        state[:, 0, dofs] = now[:, None, None] * along
        state[:, 1, dofs] = rate[:, None, None] * along
    return PeriodRecord(
        np.zeros((STEPS + 1, 3)), u, v, frame_steps, (None, 0.0, 0.0), list(state[:, :2]),
        _contact(structure), _jumps(), n_steps=STEPS,
        damped=np.zeros(structure.operators.n_pairs),
    )  # fmt: skip


def _contact(structure: Structure) -> list[np.ndarray]:
    """Return contact states: nodes 1 to 3 below, then 1 and 2 above, then node 2 of both."""
    states = np.zeros((FRAMES, structure.operators.n_pairs), dtype=np.int8)
    states[0, 0:3] = 1
    states[1, PAIRS : PAIRS + 2] = 2
    states[2, [1, PAIRS + 1]] = 1, 2
    return list(states)


def _jumps() -> Jumps:
    """Return the impacts of one period."""
    jumps = Jumps()
    for interface, phase in STRIKES.items():
        impulses = np.array(IMPULSES[interface])
        hit = interface * PAIRS + NODE - 1 - np.arange(impulses.size)
        rates = np.full(impulses.size, -0.5)
        jumps.append(round(phase * STEPS), Decision(hit, impulses, rates, -0.1 * rates), -1e-5)
    return jumps
