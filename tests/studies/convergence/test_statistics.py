"""How periods become statistics."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from delam_fem import Decision
from delam_fem.api import LEDGER, N_BASE
from delam_fem.simulation.recorder import Jumps
from delam_fem.studies.convergence.level import PeriodRow, row_of, statistics


def row(low: float, phase: float) -> PeriodRow:
    """Return a period of which low and the first amplitude depend on the cycle."""
    harmonics = np.array([[np.exp(1j * phase), 0.2], [2.0, 0.1]])
    return {
        "tip_min": np.array([low, -1.0]),
        "tip_max": np.array([1.0, 1.0]),
        "harmonics": harmonics,
        "modal_impulse": -low,
        "impacts": 3.0,
        "contact_work": 1.0,
        "impact_gain": 0.0,
        "steps": 900.0,
    }


def test_alternating_cycles_are_no_scatter() -> None:
    rows = [row(low, 0.0) for low in (-1.0, -2.0) * 4]
    strobe = np.array([[0.0, 1.0] * 4] * 2)
    values = statistics(rows, strobe)
    assert values["periodicity"] == (2.0, 0.0)
    assert values["tip_min_1"] == (-1.5, 0.0)
    assert values["modal_impulse"] == (1.5, 0.0)
    assert values["blocks"] == (4.0, 0.0)


def test_scatter_of_an_irregular_motion() -> None:
    rows = [row(low, 0.0) for low in (-1.0, -2.0, -1.5, -1.1)]
    values = statistics(rows, np.array([[0.0, 1.0, 0.3, 0.9]] * 2))
    assert values["periodicity"] == (0.0, 0.0)
    assert values["tip_min_1"] == pytest.approx((-1.4, np.std([1.0, 2.0, 1.5, 1.1])))


def test_amplitudes_over_a_block_respect_the_phase() -> None:
    """What changes sign from cycle to cycle is a subharmonic, no harmonic of the excitation."""
    rows = [row(-1.0, phase) for phase in (0.0, np.pi) * 4]
    values = statistics(rows, np.array([[0.0, 1.0] * 4] * 2))
    assert values["amplitude_1_1"][0] == pytest.approx(0.0, abs=1e-15)
    assert values["amplitude_2_1"] == pytest.approx((2.0, 0.0))


def recorded(u: np.ndarray, ledger: dict[str, float]) -> SimpleNamespace:
    """Return what a recorder holds after its second period, of one step less than the others."""
    n_steps, n_tips = len(u) - 1, u.shape[1]
    samples = np.full((n_steps + 3, N_BASE + n_tips + 1), 77.0)
    samples[: n_steps + 1, N_BASE : N_BASE + n_tips] = u
    rows = np.full((2, len(LEDGER)), 55.0)
    rows[1] = [ledger.get(name, 0.0) for name in LEDGER]
    envelope = np.full((2, 2, n_tips + 1), 44.0)
    envelope[1, 0, :n_tips], envelope[1, 1, :n_tips] = u.min(axis=0), u.max(axis=0)
    jumps = Jumps()
    jumps.append(3, Decision(np.array([2, 0]), np.array([0.25, 0.5]), *np.zeros((2, 2))), 0.0)
    return SimpleNamespace(
        window=[None, SimpleNamespace(u=samples, n_steps=n_steps, jumps=jumps)],
        n_closed=2,
        ledger=rows,
        envelope=envelope,
        impulse=np.array([[9.0, 9.0, 9.0], [0.5, 7.0, 0.25]]),
        effort=np.array([[9, 9, 9, 9, 9], [40, 5, 3, 2, 1]]),
    )


def test_contact_takes_what_impacts_and_dampers_lose_less_what_springs_release() -> None:
    phase = 2.0 * np.pi * np.arange(51) / 50
    u = np.stack([0.3 * np.cos(phase) + 0.1 * np.sin(3.0 * phase), 2.0 - 0.2 * np.sin(phase)], 1)
    ledger = {
        "impact_loss": 4.0, "contact_damping_loss": 2.0, "spring_released": 1.0,
        "damping_loss": 16.0, "base_work": 32.0,
    }  # fmt: skip
    values = row_of(recorded(u, ledger), 2, np.array([0.5, 9.0, 4.0]))  # type: ignore[arg-type]
    assert values["contact_work"] == 4.0 + 2.0 - 1.0
    assert (values["impacts"], values["impact_gain"]) == (7.0, 0.25)
    assert values["modal_impulse"] == 0.25 * 4.0 + 0.5 * 0.5
    assert values["steps"] == 40 + 5 + 3
    assert values["tip_min"].tolist() == u.min(axis=0).tolist()
    assert values["tip_max"].tolist() == u.max(axis=0).tolist()
    assert values["harmonics"].shape == (2, 24)  # below Nyquist of 50 steps
    # the samples begin one step after the start of the period
    turn = np.exp(2j * np.pi * np.arange(1, 25) / 50)
    expected = np.zeros((2, 24), complex)
    expected[0, 0], expected[0, 2], expected[1, 0] = 0.3, -0.1j, 0.2j
    assert values["harmonics"] == pytest.approx(expected * turn, abs=1e-14)


@pytest.mark.parametrize(("scatter", "expected"), [(0.099, 1.0), (0.101, 0.0)])
def test_scatter_of_strobes_is_relative_to_half_the_range(scatter: float, expected: float) -> None:
    """Of all cycles: the deepest low and the highest high are 3 apart, far from 0."""
    ends = [(10.0, 12.0), (11.0, 13.0), (10.5, 12.0), (11.0, 12.5)] * 3
    harmonics = np.array([[1.0, 0.2], [2.0, 0.1]])
    rows = [
        {"tip_min": np.full(2, low), "tip_max": np.full(2, high), "harmonics": harmonics}
        for low, high in ends
    ]
    drift = 1.5 * scatter * np.arange(12.0)
    assert statistics(rows, np.stack([drift, 0.0 * drift]))["periodicity"] == (expected, 0.0)


def test_blocks_of_a_doubled_motion_end_with_the_last_period() -> None:
    rows = [row(low, 0.0) for low in (-9.0, *(-1.0, -2.0) * 4)]
    values = statistics(rows, np.array([[1.0, *[0.0, 1.0] * 4]] * 2))
    assert values["periodicity"] == (2.0, 0.0)
    assert values["blocks"] == (4.0, 0.0)
    assert values["tip_min_1"] == (-1.5, 0.0)
    assert values["impacts"] == (3.0, 0.0)
    assert values["contact_work"] == (1.0, 0.0)
    assert values["impact_gain"] == (0.0, 0.0)
    assert values["tip_max_2"] == (1.0, 0.0)
    assert values["amplitude_2_2"] == pytest.approx((0.1, 0.0))
    assert values["distortion_factor_1"] == pytest.approx((np.sqrt(1.04) - 1.0, 0.0))
    assert values["distortion_factor_2"] == pytest.approx((np.sqrt(1.0025) - 1.0, 0.0))
