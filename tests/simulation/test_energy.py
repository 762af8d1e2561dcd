"""The terms of the ledger against energies of a small system that is integrated here."""

from __future__ import annotations

import numpy as np
import pytest
from support import compiled

from delam_fem.api import SweptMotion
from delam_fem.simulation import recorder
from delam_fem.simulation.recorder import add_rows

base_flows, write_ledger = compiled(recorder.base_flows), compiled(recorder.write_ledger)

N, STEPS, DT = 3, 37, 0.01
"""Free dofs; steps; time step [s]. The base ends at another speed than it began with."""
ROUND_OFF = 1e-12
"""Relative to the largest energy."""
UNDIVIDED = np.zeros(STEPS + 1, np.uint8), np.zeros(4)


def matrix(seed: int) -> np.ndarray:
    """Return a symmetric positive definite matrix of the base and the free dofs."""
    root = np.random.default_rng(seed).normal(size=(N + 1, N + 1))
    return np.asarray(root @ root.T + np.eye(N + 1))


M, C, K = matrix(1), 0.3 * matrix(2), 20.0 * matrix(3)
"""The base is dof 0."""


def moved(base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return u and v of all dofs by average acceleration, shapes (STEPS + 1, N + 1)."""
    u, v, a = np.zeros((3, STEPS + 1, N + 1))
    u[:, 0], v[:, 0], a[:, 0] = base.T
    rng = np.random.default_rng(4)
    u[0, 1:], v[0, 1:] = rng.normal(size=(2, N))
    free = slice(1, None)

    def force(k: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        coupling = M[free, 0] * a[k, 0] + C[free, 0] * v[k, 0] + K[free, 0] * u[k, 0]
        return np.asarray(-coupling - C[free, free] @ y - K[free, free] @ x)

    a[0, free] = np.linalg.solve(M[free, free], force(0, u[0, free], v[0, free]))
    A = M + 0.5 * DT * C + 0.25 * DT**2 * K
    for k in range(1, STEPS + 1):
        x = u[k - 1, free] + DT * v[k - 1, free] + 0.25 * DT**2 * a[k - 1, free]
        y = v[k - 1, free] + 0.5 * DT * a[k - 1, free]
        a[k, free] = np.linalg.solve(A[free, free], force(k, x, y))
        u[k, free], v[k, free] = x + 0.25 * DT**2 * a[k, free], y + 0.5 * DT * a[k, free]
    return u, v


def test_base_work_and_damping_balance_the_energies_of_all_dofs() -> None:
    times = 0.2 + DT * np.arange(STEPS + 1)
    base = SweptMotion(1.0, 4.0, 1.0, 0.5).states(times)
    base += [0.3, 0.0, 0.0]  # away from 0: the stiffness of the corner takes part
    assert abs(base[-1, 1]) > 2.0 * abs(base[0, 1])
    u, v = moved(base)
    columns = np.stack([X[1:, 0] for X in (M, C, K)])
    corner = M[0, 0], C[0, 0], K[0, 0]
    products = u[:, 1:] @ columns.T
    momentum = v[0, 1:] @ M[1:, 0], v[-1, 1:] @ M[1:, 0]
    work, base_damping = base_flows(products, *momentum, base, corner, DT, *UNDIVIDED)
    stored = [0.5 * v[k] @ M @ v[k] + 0.5 * u[k] @ K @ u[k] for k in (0, -1)]
    # displacements change by Δt times the mean velocity, for free dofs; the base moves as it does
    mean = 0.5 * (v[1:] + v[:-1])
    loss = DT * np.einsum("ki,ij,kj->", mean, C, mean)
    free_loss = DT * np.einsum("ki,ij,kj->", mean[:, 1:], C[1:, 1:], mean[:, 1:])
    scale = ROUND_OFF * max(stored)
    assert base_damping == pytest.approx(loss - free_loss, abs=scale)
    assert work == pytest.approx(stored[1] - stored[0] + loss, abs=scale)


def test_the_corner_alone_is_the_work_on_a_rigid_base() -> None:
    """A mass, a damper and a spring that only the base moves: ½ M Δq'² + C ∫ q'² + ½ K Δq²."""
    base = np.array([[1.0, 2.0, 0.0], [1.5, 5.0, 0.0]])
    corner = 0.25, 0.125, 3.0
    work, damping = base_flows(np.zeros((2, 3)), 0.0, 0.0, base, corner, 0.5, *UNDIVIDED)
    assert damping == pytest.approx(0.125 * 0.5 * 3.5**2)
    assert work == pytest.approx(0.5 * 0.25 * (25.0 - 4.0) + damping + 1.5 * (2.25 - 1.0))


def test_stored_and_exchanged_energies_add_up() -> None:
    levels = np.array([[1.0, 2.0, 4.0, 0.0, 0.5, 8.0], [3.0, 1.0, 16.0, 0.0, 1.75, 8.125]])
    row, at_rest = np.zeros(10), np.zeros((2, 3))
    coupling = np.array([0.0, 0.0, 0.0, 0.0])
    write_ledger(row, levels, at_rest, at_rest, coupling, DT, *UNDIVIDED, (-0.5, -2.0))
    residual = (20.0 - 7.0) - (-1.25 - 0.125 - 0.5 - 2.0)
    assert row.tolist() == [3.0, 1.0, 16.0, 0.0, 0.0, 1.25, 0.125, 0.5, -2.0, residual]


def test_the_work_of_a_force_is_told_from_that_of_the_base() -> None:
    """E3 for a force from 2 to 5 N at a point that moves from 0.5 to 0.75 m; k·u = -f·u."""
    row, levels = np.zeros(10), np.array([[0.0] * 6, [0.0, -3.75, 0.0, 0.0, 0.0, 0.0]])
    products = np.array([[0.0, 0.0, -0.5], [0.0, 0.0, -0.75]])
    force = np.array([[2.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    coupling = np.array([0.0, 0.0, 0.0, 1.0])
    write_ledger(row, levels, products, force, coupling, DT, *UNDIVIDED, (0.0, 0.0))
    assert row[1] == -3.75 + 5.0 * 0.75  # V = (V - F f·u) + F f·u
    assert row[3:5].tolist() == [0.0, 0.5 * (2.0 + 5.0) * 0.25]


def test_rows_of_small_steps_add_up_to_the_work_over_the_same_steps() -> None:
    rng = np.random.default_rng(3)
    products, states = rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    corner, momentum, dt, parts = (0.0, 1.7, 0.0), (0.3, -0.2), 0.5, 4
    total = base_flows(products, *momentum, states, corner, dt, *UNDIVIDED)
    sums = np.zeros(4)
    add_rows(sums, np.column_stack([products, states, np.full(5, 1.0 / parts)]))
    ends, is_divided = np.array([0, 4]), np.array([0, 1], np.uint8)
    of_ends = products[ends], *momentum, states[ends]
    divided = base_flows(*of_ends, corner, parts * dt, is_divided, sums)
    assert divided == pytest.approx(total, rel=1e-12)
