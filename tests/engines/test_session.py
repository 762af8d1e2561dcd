"""Runs without a case: exact solutions, laws of one's own, what is refused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sp

import delam_fem as df
from delam_fem import Decision
from delam_fem.api import SCHEMES, EngineName, Kinematics, LawContext, Scheme, solve
from delam_fem.engines import session as session_module
from delam_fem.engines.session import ENGINES

STEPS = 2000
NEWMARK, MOREAU = SCHEMES["newmark"], SCHEMES["moreau-jean"]


def two_masses(gap: float = 1e9) -> df.Operators:
    """Return masses of 1 and 0.5 kg in a row: base, spring, mass, spring, mass, gap, stop."""
    M, K = np.diag([1.0, 0.5]), np.array([[300.0, -100.0], [-100.0, 100.0]])
    base = df.BaseCoupling(np.zeros(2), np.zeros(2), np.array([-200.0, 0.0]), (0.0, 0.0, 200.0))
    return df.Operators(
        mass=sp.csr_matrix(M),
        damping=sp.csr_matrix(0.02 * M),
        stiffness=sp.csr_matrix(K),
        base=base,
        gap_matrix=sp.csr_matrix([[0.0, -1.0]]),
        gap0=np.array([gap]),
        probes=sp.csr_matrix([[0.0, 1.0], [1.0, -1.0]]),  # the outer mass, and a difference
    )


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("scheme", [NEWMARK, MOREAU], ids=["newmark", "moreau-jean"])
def test_linear_motion_is_the_exact_one(engine: EngineName, scheme: Scheme) -> None:
    o, motion = two_masses(), df.HarmonicMotion(frequency=1.0, amplitude=0.01)
    omega = 2.0 * np.pi
    dynamic = o.stiffness + 1j * omega * o.damping - omega**2 * o.mass
    U = np.linalg.solve(dynamic.toarray(), -o.base.stiffness * 0.01)
    start = np.array([U.imag, omega * U.real, -(omega**2) * U.imag])
    solution = solve(
        o,
        df.Law("none"),
        scheme,
        motion,
        steps_per_period=STEPS,
        periods=2,
        initial=df.State(start, np.zeros(1, dtype=bool)),
        engine=engine,
    )
    expected = (np.outer(np.exp(1j * omega * solution.time), o.probes @ U)).imag
    assert solution.outcome == "completed"
    assert solution.displacement == pytest.approx(expected, abs=2e-5 * np.abs(expected).max())
    assert solution.velocity[:, 1] == pytest.approx(
        np.gradient(solution.displacement[:, 1], solution.time), abs=1e-4
    )
    assert np.abs(solution.energy["residual"]).max() < 1e-12


@pytest.mark.parametrize("engine", ENGINES)
def test_an_impact_leaves_with_its_restitution(engine: EngineName) -> None:
    """One impact of a free mass on a stop: rate, time, impulse and energy are exact."""
    o = df.Operators(
        mass=sp.csr_matrix([[2.0]]),
        damping=sp.csr_matrix([[0.0]]),
        stiffness=sp.csr_matrix([[0.0]]),
        base=df.BaseCoupling.none(1),
        gap_matrix=sp.csr_matrix([[-1.0]]),
        gap0=np.array([0.5]),
        probes=sp.csr_matrix([[1.0]]),
    )
    start = df.State(np.array([[0.0], [1.0], [0.0]]), np.zeros(1, dtype=bool))
    solution = solve(
        o,
        df.Law("newton", restitution=0.4),
        NEWMARK,
        time_step=1e-3,
        steps_per_period=1000,
        periods=1,
        initial=start,
        engine=engine,
    )
    assert solution.impacts.time == pytest.approx([0.5], abs=1.1e-3)
    assert solution.impacts.rate_pre == pytest.approx([-1.0])
    assert solution.impacts.impulse == pytest.approx([2.0 * 1.4])
    assert solution.velocity[-1] == pytest.approx([-0.4])
    assert solution.energy["impact_loss"] == pytest.approx([0.5 * 2.0 * (1.0 - 0.4**2)])


@dataclass(frozen=True)
class Sticky:
    """A law of one's own: what touches stays, by an impulse that stops it."""

    name: str = "sticky"
    spring: tuple[float, float] = (0.0, 0.0)
    is_coupled: bool = True

    def supervisor(self, scheme: Scheme, setting: LawContext) -> Sticky:
        assert setting.n_pairs == 1
        return self

    def examine(self, seen: Kinematics) -> Decision | None:
        rate = seen.rate_pre()
        if seen.gap[0] > 0.0 or rate[0] >= 0.0:
            return None
        return Decision(np.array([0]), -rate / 2.0, rate, 0.0 * rate)  # 1/m = 2


def test_a_law_of_ones_own() -> None:
    solution = solve(
        two_masses(gap=0.01),
        Sticky(),
        NEWMARK,
        df.HarmonicMotion(1.0, 0.01),
        steps_per_period=STEPS,
        periods=2,
    )
    assert solution.impacts.time.size > 0
    assert solution.displacement[:, 0].max() < 0.0101
    assert solution.energy["impact_loss"].sum() > 0.0
    assert np.abs(solution.energy["residual"]).max() < 1e-12


def problems() -> Iterator[pytest.ParameterSet]:
    newton = df.Law("newton")
    yield pytest.param(Sticky(), NEWMARK, "compiled", {}, "expected one of the laws none", id="own")
    yield pytest.param(
        df.Law("penalty"), MOREAU, "petsc", {}, 'goes with the scheme "newmark"', id="pair"
    )
    yield pytest.param(
        df.Law("penalty"), MOREAU, "compiled", {}, "goes with the scheme", id="pair, compiled"
    )
    yield pytest.param(newton, NEWMARK, "petsc", {"time_step": None}, "time_step: missing", id="dt")
    explicit = SCHEMES["central-difference"]
    slow = {"time_step": 0.5}
    yield pytest.param(newton, explicit, "petsc", slow, "time step of at most", id="stability")
    lumped = df.Law("newton", impulse="lumped")
    for engine in ENGINES:
        yield pytest.param(lumped, NEWMARK, engine, {}, "lumped_mass is missing", id=engine)


@pytest.mark.parametrize(("law", "scheme", "engine", "more", "text"), list(problems()))
def test_what_cannot_be_solved_is_refused(
    law: df.Law, scheme: Scheme, engine: EngineName, more: dict[str, float | None], text: str
) -> None:
    settings: dict[str, float | None] = {"time_step": 1e-3} | more
    with pytest.raises(df.CaseError, match=text):
        solve(two_masses(), law, scheme, steps_per_period=10, periods=1, engine=engine, **settings)


def test_a_run_stops_when_it_is_asked_to_and_goes_on_from_its_state() -> None:
    o, law, motion = two_masses(gap=0.01), df.Law("newton", restitution=0.5), None
    start = df.State(np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 0.0]]), np.zeros(1, dtype=bool))
    settings = {"time_step": 1e-3, "steps_per_period": 100, "engine": "compiled"}
    complete_run = solve(o, law, NEWMARK, motion, periods=4, initial=start, **settings)
    first = solve(
        o, law, NEWMARK, motion, periods=4, initial=start, stop=lambda done: done == 2, **settings
    )
    assert first.outcome == "interrupted"
    resumed = solve(o, law, NEWMARK, motion, periods=2, initial=first.state, **settings)
    assert resumed.displacement[1:] == pytest.approx(complete_run.displacement[201:], abs=1e-12)


def test_a_motion_that_repeats_has_one_table_for_all_periods() -> None:
    span = session_module.Span(1e-3, 1000, 2)
    twice = session_module._states(df.HarmonicMotion(2.0, 1.0), span)
    assert twice(0) is twice(5)
    off = session_module._states(df.HarmonicMotion(1.5, 1.0), span)
    assert off(1)[0, 0] == pytest.approx(np.sin(2.0 * np.pi * 1.5), abs=1e-12)
    swept = session_module._states(df.SweptMotion(1.0, 2.0, 10.0, 1.0), span)
    assert swept(1)[0, 0] != swept(0)[0, 0]
