"""Every rigid law gives back the e that it was given, wherever the time grid lies.

One free mass meets a wall at a time that is anywhere within a step: a thousand masses, each a
little later. A forced oscillator and the laminae show the same in motions that repeat.
"""

import numpy as np
import pytest
import scipy.sparse as sp
from calibration.oscillator import forcing, impact_phase, orbit, oscillator
from problems import Law, simulate
from support import covering

from delam_fem.api import (
    COMBINATIONS,
    LEDGER,
    BaseCoupling,
    Operators,
    assemble,
    combined_name,
    preset,
    session_of,
)

RESTITUTIONS = (0.0, 0.1, 0.5, 0.9, 1.0)
RIGID = [combined_name(law, scheme) for law, scheme in COMBINATIONS if law == "newton"]
OFFSETS = 1000
HONOURED = 1e-3
"""Difference of the mean rebound from e; seen: 1e-15."""
EXACT_SPEED = 3e-3
"""Relative error of the impact speed with 100 steps per period, refined 64 times near contact."""


def masses(gaps: np.ndarray) -> Operators:
    """Return free masses of 1 kg in front of a wall, at different distances."""
    n = gaps.size
    zero = sp.csr_matrix((n, n))
    return Operators(
        mass=sp.identity(n, format="csr"),
        damping=zero,
        stiffness=zero,
        base=BaseCoupling.none(n),
        gap_matrix=sp.identity(n, format="csr"),
        gap0=gaps,
        lumped_mass=np.ones(n),
        probes=sp.identity(n, format="csr"),
    )


@pytest.mark.parametrize(("name", "e", "refine"), covering(RIGID, RESTITUTIONS, [1, 8]))
def test_a_free_mass_leaves_with_e(name: str, e: float, refine: int) -> None:
    n = 100  # a few at a time: each block of masses meets the wall in a step of its own
    rebounds = []
    for block in range(OFFSETS // n):
        offset = (np.arange(n) + n * block) / OFFSETS
        law = Law(name, e, refine=refine)
        gaps = 1e-3 * (3.0 + 10.0 * offset)
        motion = simulate(masses(gaps), law, (np.zeros(n), -np.ones(n)), time_step=1e-3, n_steps=16)
        rebounds.append(motion.v[-1])
    assert np.mean(rebounds) == pytest.approx(e, abs=HONOURED)
    assert np.abs(np.concatenate(rebounds) - e).max() < HONOURED


ORBITS = [(2.0, 0.0), (2.0, 0.1), (2.0, 0.5), (2.0, 0.9), (2.2, 0.5)]
QUICK = {(orbit, RIGID[k % len(RIGID)]) for k, orbit in enumerate(ORBITS)}
"""Each orbit once, each method at least once; all of both together take half a minute."""


@pytest.mark.parametrize(
    ("omega", "e", "name"),
    [
        pytest.param(*orbit, name, marks=() if (orbit, name) in QUICK else pytest.mark.nightly)
        for orbit in ORBITS
        for name in RIGID
    ],
)
def test_an_oscillator_strikes_with_the_exact_speed(omega: float, e: float, name: str) -> None:
    """Start on the orbit with one impact per period, on grids that are shifted against it."""
    phase = impact_phase(omega, 0.0, e)
    V = orbit(omega, e, phase)[0]
    dt = 2.0 * np.pi / omega / 100
    for shift in (0.15, 0.4, 0.85):
        motion = simulate(
            oscillator(0.0),
            Law(name, e, refine=64),
            (np.array([-e * V * shift * dt]), np.array([-e * V])),
            time_step=dt,
            n_steps=100 * 150,
            motion=forcing(omega, phase + omega * shift * dt),
        )
        assert np.abs(-motion.rate_pre[-30:] / V - 1.0).max() < EXACT_SPEED


@pytest.mark.parametrize("e", RESTITUTIONS)
def test_impacts_of_the_laminae_take_energy_unless_e_is_one(e: float) -> None:
    keys = {"contact.restitution": e, "mesh.elements": 6, "time.periods": 3}
    case = preset("default", {**keys, "output.fields_per_period": 0, "time.refine": 16})
    with session_of(case, assemble(case, needs_dolfinx=False).operators) as opened:
        opened.run()
    ledger = opened.recorder.ledger
    loss, work = (np.abs(ledger[:, LEDGER.index(k)]).sum() for k in ("impact_loss", "base_work"))
    assert loss < 1e-12 * work if e == 1.0 else loss > 1e-3 * work
