"""Lyapunov exponents against exact ones; the fold and the period doubling of the paper's case."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from problems import Law, oscillator
from test_impact_oscillator import forcing, impact_phase, orbit

from delam_fem.engines.session import session
from delam_fem.simulation.span import Span
from delam_fem.studies.lyapunov import largest_exponent
from delam_fem.studies.sweeps.grid import sweep_of
from delam_fem.studies.sweeps.run import run_sweep

LINEAR = 2e-3
"""Relative: the distance pulses within a cycle of the mode, which is no multiple of the period;
over 200 periods that averages out to 1e-3."""
IMPACTING = 0.05
"""Relative: the exponent is that of the linearised map, and the distance is 3 % of the motion."""
SETTLE, FOLLOW = 60, 100
"""Periods until the orbit is steady, and over which the distance is followed."""
ONE_CONTACT = 0.1 + 1e-9
"""Contacts per period: one in the window of 10 periods, where a strike falls on its edge; when that
is so depends on round-off."""


def test_a_damped_linear_motion_contracts_as_its_slowest_mode(tmp_path: Path) -> None:
    """The largest exponent is -Dω of the thin lamina's first mode, where no contact adds any."""
    data = {
        "name": "linear",
        "base": "paper",
        "engine": "petsc",
        "set": {
            "contact.law": "none",
            "mesh.elements": 4,
            "time.steps_per_period": 200,
            "time.periods": 20,
        },
        "axis": [{"key": "excitation.frequency", "values": [2.0, 3.25]}],
        "record": {"lyapunov": 400},
    }
    sweep = sweep_of(data)
    found = run_sweep(sweep, tmp_path, "serial").lyapunov_exponent.to_numpy()
    thin = sweep.base.lamina[1]
    exact = -thin.damping_ratio * float(thin.angular_frequencies(1)[0])
    assert found == pytest.approx(exact, rel=LINEAR)


def multipliers(omega: float, s: float, e: float) -> np.ndarray:
    """Return the eigenvalues of the linearised map from before one impact to before the next.

    With the acceleration a = cos φ - s at the impact and V before it,

        J = [[-e, 0], [(1 + e) a / V, -e]]  at the impact,  R(T) = [[C, S], [-S, C]]  between.
    """
    phase = impact_phase(omega, s, e)
    V, _ = orbit(omega, e, phase)
    T = 2.0 * math.pi / omega
    C, S = math.cos(T), math.sin(T)
    J = np.array([[-e, 0.0], [(1.0 + e) * (math.cos(phase) - s) / V, -e]])
    found: np.ndarray = np.linalg.eigvals(np.array([[C, S], [-S, C]]) @ J)
    return found


def exponent(omega: float, s: float, e: float, *, n_steps: int, perturbation: float) -> float:
    """Return the largest exponent of the impact oscillator as the program finds it."""
    T = 2.0 * math.pi / omega
    operators, dt = oscillator(s), T / n_steps
    span = Span(dt, n_steps, SETTLE, limit=1e6)
    table = forcing(omega, 0.0)(dt * np.arange(n_steps + 1))
    law = Law("newton", restitution=e)
    with session(
        operators, law.contact, law.scheme, lambda period: table, span, engine="petsc"
    ) as opened:
        assert opened.run() == "completed"
        return largest_exponent(
            opened,
            operators,
            direction=np.ones(1),
            period=T,
            periods=FOLLOW,
            perturbation=perturbation,
        )


@pytest.mark.parametrize(("omega", "s", "e"), [(1.8, 0.2, 0.5), (2.2, 0.0, 0.5), (2.5, 0.0, 0.5)])
def test_an_impact_oscillator_contracts_by_its_restitution(
    omega: float, s: float, e: float
) -> None:
    """Complex multipliers have the modulus e, as their product is e² without damping."""
    mu = multipliers(omega, s, e)
    assert np.abs(mu) == pytest.approx(e)
    exact = math.log(e) * omega / (2.0 * math.pi)
    found = exponent(omega, s, e, n_steps=2000, perturbation=0.03)
    assert found == pytest.approx(exact, rel=IMPACTING)


def test_a_distance_below_a_step_of_motion_misses_the_shift_of_the_impact() -> None:
    """Both motions then hit in the same step: the reason for the default perturbation."""
    exact = math.log(0.5) * 1.8 / (2.0 * math.pi)
    found = exponent(1.8, 0.2, 0.5, n_steps=400, perturbation=1e-6)
    assert abs(found) < 0.1 * abs(exact)


@pytest.mark.slow
def test_the_fold_and_the_period_doubling(tmp_path: Path) -> None:
    """Between 3.47 and 3.56 Hz two motions live, one contact a period or one in two."""
    data = {
        "name": "fold",
        "base": "paper",
        "order": "both",
        "set": {"time.periods": 100, "output.fields_per_period": 0},
        "axis": [
            {"key": "excitation.frequency", "values": [3.40, 3.45, 3.50, 3.52, 3.60, 3.65, 3.70]}
        ],
    }
    found = run_sweep(sweep_of(data), tmp_path, "serial")
    assert found.attrs["n_completed"] == 14
    contacts = found.tip_contacts_per_period
    up, down = (contacts.sel(direction=name).values for name in ("up", "down"))
    assert up == pytest.approx([1.0] * 4 + [0.5] * 3, abs=ONE_CONTACT)
    assert down == pytest.approx([1.0] * 2 + [0.5] * 5, abs=ONE_CONTACT)
    doubled = found.sel(frequency=3.65)
    assert doubled.periodicity.values.tolist() == [2.0, 2.0]
    assert (doubled.strobe_scatter < 0.02).all()
    thick = found.tip_amplitude.sel(lamina="thick", frequency=3.52).to_numpy()
    assert thick[0] > 1.5 * thick[1]
