"""Periods of reduced problems: a mass at a stop, statics, energy."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import brentq

from delam_fem.api import BaseCoupling, Operators, Periods, Reduced, reduce
from delam_fem.contact.complementarity import solve


def mass_at_stop(compliance: float, creep: float, gap: float = 0.0) -> Reduced:
    """Return a free mass of 1 kg above a stop with a spring 1/compliance and a dashpot."""
    return Reduced(
        squares=np.array([1e-12]), damping=np.zeros(1),
        creep=np.array([creep]), gap_modes=np.ones((1, 1)),
        compliance=np.full((1, 1, 1), compliance),
        gap0=np.array([gap]), gap_drive=np.zeros((1, 1)), loads=np.zeros((3, 1)),
        force_loads=np.zeros((0, 1)), base_mass=0.0, base_damping=0.0,
        probes=sp.csr_matrix((0, 1)), shapes=np.ones((1, 1)), residual=np.zeros((1, 1, 1)),
        drive=np.zeros((1, 1)), sag=np.zeros(1), sag_energy=0.0,
    )  # fmt: skip


def rebound(ratio: float) -> float:
    """Return -v1/v0 of a unit mass that leaves a spring and dashpot when its force is 0."""
    wd = np.sqrt(1.0 - ratio**2)

    def motion(t: float) -> tuple[float, float]:
        x = np.exp(-ratio * t) * np.sin(wd * t) / wd
        return x, np.exp(-ratio * t) * np.cos(wd * t) - ratio * x

    def force(t: float) -> float:
        x, v = motion(t)
        return x + 2.0 * ratio * v

    return -motion(brentq(force, 0.5, 1.001 * np.pi / wd))[1]


@pytest.mark.parametrize("ratio", [0.0, 0.2, 0.6])
def test_a_mass_rebounds_from_the_flexible_stop_exactly(ratio: float) -> None:
    omega = 2.0e3
    stop = mass_at_stop(1.0 / omega**2, 2.0 * ratio / omega, gap=1e-3)
    errors = []
    for refine in (16, 64):
        periods = Periods(stop, 1e-3 / 8.0, refine)
        end = periods.advance(np.array([0.0, -0.5, 0.0]), periods.drive(np.zeros((81, 3))))
        errors.append(abs(end[1] / 0.5 - rebound(ratio)))
    assert errors[1] < 5e-3
    assert errors[1] < 0.4 * errors[0]  # first order in the fine steps


def chain(n: int = 6) -> Operators:
    """Return masses in a row between springs, held at one end, with two stops."""
    K = sp.diags([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1]) * 1e4
    K = K.tolil()
    K[n - 1, n - 1] = 1e4
    K, M = K.tocsr(), sp.diags(np.linspace(1.0, 2.0, n)).tocsr()
    H = sp.csr_matrix((np.array([-1.0, -1.0]), ([0, 1], [2, n - 1])), shape=(2, n))
    load = np.zeros(n)
    load[-1] = 1.0
    probes = sp.csr_matrix(np.eye(n))
    return Operators(
        M, 0.2 * M + 0.05 * K, K, BaseCoupling.force(load), H, np.array([5e-4, 2e-3]), probes=probes
    )


@pytest.mark.parametrize("modes", [1, 3])
def test_a_steady_force_gives_the_static_contact_of_all_dofs(modes: int) -> None:
    o = chain()
    reduced = reduce(o, modes)
    periods = Periods(reduced, 0.01, 4)
    states = np.zeros((1001, 3))
    states[:, 0] = 50.0
    record = periods.record(np.zeros(reduced.n_state), periods.drive(states))
    K = o.stiffness.toarray()
    H, free = o.gap_matrix.toarray(), np.linalg.solve(K, -o.base.stiffness * 50.0)
    forces = solve(H @ np.linalg.solve(K, H.T), H @ free + o.gap0)
    u = reduced.displacement(record.trace.q, record.trace.s, states[:, :1])[-1]
    assert (forces > 0.0).all()
    np.testing.assert_allclose(record.trace.impulse[-1] / 0.01, forces, rtol=1e-6)
    np.testing.assert_allclose(u, free + np.linalg.solve(K, H.T @ forces), rtol=1e-6)


@pytest.mark.parametrize("creep", [0.0, 0.002])
def test_the_ledger_adds_up_and_contact_only_takes_energy(creep: float) -> None:
    o = chain()
    o = replace(o, damping=0.2 * o.mass + creep * o.stiffness)
    reduced = reduce(o, 3)
    assert reduced.creep == pytest.approx([creep], abs=1e-9)
    periods = Periods(reduced, 0.002, 8)
    t = 0.002 * np.arange(501)
    states = np.column_stack([60.0 * np.sin(20.0 * t), np.zeros((501, 2))])
    state = np.zeros(reduced.n_state)
    for _ in range(4):
        before = sum(periods.energies(state))
        record = periods.record(state, periods.drive(states))
        state = record.end
        work, modal, creeping, closing = record.exchanged
        assert (record.trace.impulse > 0.0).any()
        assert min(modal, creeping, closing) > 0.0
        change = sum(periods.energies(state)) - before
        assert change == pytest.approx(work - modal - creeping - closing, abs=1e-10 * modal)
        assert record.lowest.min() > -1e-12


def test_coarse_and_fine_steps_agree_without_contact() -> None:
    o = chain()
    far = replace(o, gap0=o.gap0 + 1.0)
    t = 0.01 * np.arange(201)
    states = np.column_stack([50.0 * np.sin(20.0 * t), np.zeros((201, 2))])
    runs = []
    for _ in range(2):
        periods = Periods(reduce(far, 3), 0.01, 16)
        start = np.zeros(periods.reduced.n_state)
        runs.append(periods.record(start, periods.drive(states)))
        far = replace(far, gap0=far.gap0 - runs[0].lowest + 4e-4)  # next time it nearly touches
    assert runs[0].effort[1] == 0
    assert runs[1].effort[1] > 0
    assert not runs[1].trace.impulse.any()
    np.testing.assert_allclose(runs[1].end, runs[0].end, rtol=1e-9, atol=1e-12)


def test_a_motion_that_diverges_is_not_a_number() -> None:
    stop = mass_at_stop(1e-6, 1e-4, gap=1.0)
    periods = Periods(stop, 1e-3, 4)
    end = periods.advance(np.array([1.0, np.inf, 0.0]), periods.drive(np.zeros((11, 3))))
    assert np.isnan(end).all()


def test_steps_must_have_a_length() -> None:
    with pytest.raises(ValueError, match="time step above 0"):
        Periods(mass_at_stop(1.0, 0.0), 0.0, 4)
