"""Lateral impact of a strip: exact beams, weak form, other engine, where the energy goes."""

import numpy as np
import pytest
import ufl
from mpi4py import MPI
from problems import Law, simulate
from scipy.optimize import brentq

from delam_fem.api import SCHEMES, State
from delam_fem.contact import laws
from delam_fem.contact.laws import SchemeName
from delam_fem.model.beams.forms import BENDING_DEGREE, MASS_DEGREE, Hermite
from delam_fem.numerics.beams import cantilever_roots
from delam_fem.paper import falling_strip as strips, rigid_ground
from delam_fem.paper.falling_strip import LIFT, Rolling, TipBlock, rolling, thin_strip, tip_block

ROUND_OFF = 1e-12
"""Relative, of assembled matrices."""
SPEED = 5e-3
"""Of the tip: the steps of the fall do not resolve the modes beyond 100 kHz that ripple it."""
FORCE = 0.01
"""Of peak force and impulses: the speed of the tip ripples by 0.5 %, which the exact beam leaves
out, and 200 elements carry waves up to 100 kHz well."""
WAVES = 0.10
"""Of strains at the second gauge, rms: what comes back from the clamp early, and the damping."""
ARRIVAL = 0.05
"""Of half waves: at the lower end of the band they are one wave of a dispersive train."""
SAME_STEPS = 1e-9
"""Of two engines up to the first impacts: their rounding times the number of steps [m]."""


# -- (ii) the tip on a block ------------------------------------------------------------------


@pytest.fixture(scope="module")
def block() -> TipBlock:
    return tip_block(time_step=5e-7, duration=0.6e-3)


def test_tip_falls_as_the_exact_cantilever(block: TipBlock) -> None:
    # w(L, t) = δ Σ 12/B⁴ cos ω t for a strip let go by a tip force
    B = cantilever_roots(300)
    omega = block.lamina.angular_frequencies(300)
    touch = brentq(lambda t: float(np.sum(12.0 / B**4 * np.cos(omega * t))), 0.011, 0.0135)
    after = touch + np.linspace(0.0, 30e-6, 61)
    speed = LIFT * (12.0 / B**4 * omega * np.sin(np.outer(after, omega))).sum(axis=1).mean()
    assert block.fall_time == pytest.approx(touch, rel=1e-4)
    assert block.speed == pytest.approx(speed, rel=SPEED)


def test_force_is_that_of_the_exact_beam(block: TipBlock) -> None:
    numbers = block.numbers()
    assert numbers["lowest_period_ms"] == pytest.approx(50.0)
    assert numbers["peak_duration_us"] == pytest.approx(30.0, rel=0.02)
    assert numbers["peak_force_N"] == pytest.approx(numbers["peak_force_exact_N"], rel=FORCE)


def test_rigid_block_gives_the_impulse_of_the_exact_beam(block: TipBlock) -> None:
    numbers = block.numbers()
    exact = numbers["rigid_impulse_of_peak_exact_N_s"]
    assert numbers["rigid_impulse_of_peak_N_s"] == pytest.approx(exact, rel=FORCE)


def test_tip_stays_on_the_block_after_the_peak(block: TipBlock) -> None:
    assert abs(block.numbers()["restitution_after_peak"]) < 0.02
    early = (block.spring.time > 0.0) & (block.spring.time < 1e-4)
    assert (block.force[early] > 0.0).all()


def test_strain_before_the_release_is_that_of_beam_theory(block: TipBlock) -> None:
    numbers = block.numbers()
    assert numbers["static_strain"] == pytest.approx(numbers["static_strain_exact"], rel=1e-9)


def test_wave_at_the_second_gauge_is_the_exact_chirp(block: TipBlock) -> None:
    assert block.numbers()["wave_misfit_second_gauge"] < WAVES


def test_half_waves_arrive_by_the_dispersion_relation(block: TipBlock) -> None:
    numbers = block.numbers()
    frequency = np.array(numbers["half_wave_Hz"])
    assert frequency.size >= 3
    assert (np.diff(frequency) < 0.0).all()  # the higher ones first
    exact = numbers["half_wave_arrival_exact_us"]
    assert numbers["half_wave_arrival_us"] == pytest.approx(exact, rel=ARRIVAL)
    assert numbers["mean_wave_speed_m_s"] < 0.5 * numbers["longitudinal_speed_m_s"]


# -- single impacts ---------------------------------------------------------------------------


def impact_loss(n: int, restitution: float) -> float:
    """Return the loss when the tip of a strip that moves downwards as a whole meets the ground."""
    operators = rigid_ground.on_ground(rigid_ground.steel_strip(), n, "tip")
    motion = np.zeros((3, 2 * n))
    motion[1, ::2] = -1.0
    out = strips.run(
        laws.Law("newton", restitution),
        SCHEMES["newmark"],
        operators,
        State(motion, np.zeros(1, dtype=np.bool_)),
        time_step=1e-9,  # before anything else moves
        stretch=1,
        n_stretches=1,
    )
    return float(out.energy["impact_loss"].sum())


def test_loss_of_a_rigid_impact_vanishes_with_the_mesh() -> None:
    # ½ (1 - e²) U̇² / W, and 1/W is a mass of the order of ρA h
    coarse, fine = impact_loss(40, 0.0), impact_loss(80, 0.0)
    assert coarse / fine == pytest.approx(2.0, rel=1e-3)
    assert impact_loss(40, 0.5) / coarse == pytest.approx(0.75, rel=1e-3)


# -- (i) the whole strip on the ground --------------------------------------------------------


@pytest.fixture(scope="module", params=sorted(strips.METHODS))
def by_step(request: pytest.FixtureRequest) -> list[Rolling]:
    return [
        rolling(method=request.param, n_elements=40, steps_per_period=n) for n in (5_000, 20_000)
    ]


def test_nearly_all_energy_goes_whatever_the_step(by_step: list[Rolling]) -> None:
    lost = [run.shares(0.5 * run.period)["lost"] for run in by_step]
    assert min(lost) > 0.94
    assert abs(lost[1] - lost[0]) < 0.03


def test_impacts_lose_less_and_damping_more_with_smaller_steps(by_step: list[Rolling]) -> None:
    coarse, fine = (run.shares(0.5 * run.period) for run in by_step)
    assert fine["impacts"] < 0.97 * coarse["impacts"]
    assert fine["damping"] > coarse["damping"]


def test_ledger_of_the_fall_closes(by_step: list[Rolling]) -> None:
    assert max(run.numbers()["energy_residual"] for run in by_step) < 1e-9


def test_a_thin_strip_rolls_down_from_the_clamp_and_stays_down(by_step: list[Rolling]) -> None:
    for run in by_step:
        direction, speed = run.front()
        assert direction > 0.95  # Spearman's rank correlation of place and time
        assert 50.0 < speed < 75.0
    numbers = by_step[1].numbers()
    assert numbers["shares_after_landing"]["lost"] > 0.95
    assert numbers["rebound_of_tip"] < 0.05


@pytest.mark.parametrize(
    ("height", "gravity", "direction"), [(0.02, 9.81, 1), (0.15, 9.81, -1), (0.02, 0.0, -1)]
)
def test_height_over_sag_decides_how_the_strip_lands(
    height: float, gravity: float, direction: int
) -> None:
    run = rolling(height=height, gravity=gravity, n_elements=40, steps_per_period=10_000)
    assert direction * run.front()[0] > 0.95


def test_strips_with_the_same_height_over_sag_land_alike() -> None:
    thin, thick = thin_strip(), rigid_ground.steel_strip(damping_ratio=0.002)
    height = (
        LIFT
        * rigid_ground.sag(thick, rigid_ground.GRAVITY)
        / rigid_ground.sag(thin, rigid_ground.GRAVITY)
    )
    runs = [
        rolling(lamina, height=h, n_elements=20, steps_per_period=5_000)
        for lamina, h in ((thin, LIFT), (thick, height))
    ]
    begins = [run.landing[0] / run.period for run in runs]
    assert begins[0] == pytest.approx(begins[1], abs=2.0 / 5_000)
    assert runs[0].front()[0] == pytest.approx(runs[1].front()[0], abs=0.02)


@pytest.mark.parametrize(("lift", "direction"), [("tip force", -1), ("uniform load", 1)])
def test_without_weight_the_second_mode_decides(lift: rigid_ground.Lift, direction: int) -> None:
    # at a quarter of the period of mode 1 mode 2 has turned: cos(ω2 T1/4) = -0.91
    run = rolling(rigid_ground.steel_strip(damping_ratio=0.002), lift=lift, gravity=0.0)
    front_speed, speed = run.front()
    assert direction * front_speed > 0.99
    assert 300.0 < speed < 600.0


def test_a_first_mode_lands_at_once_and_loses_all_at_impacts() -> None:
    run = rolling(
        rigid_ground.steel_strip(damping_ratio=0.002), lift="first mode", gravity=0.0, n_elements=40
    )
    begin, end = run.landing
    assert end - begin <= 2.0 * run.period / run.steps_per_period
    assert run.shares(end + 1e-3)["impacts"] > 0.95


def test_wave_of_the_peak_alone_decays(block: TipBlock) -> None:
    near, far = block.exact_peak_waves()
    assert near < 0.8 * far < 0.8 * 600e-6


# -- equivalences -----------------------------------------------------------------------------


def test_matrices_are_those_of_the_weak_form() -> None:
    strip, n = rigid_ground.steel_strip(damping_ratio=0.002), 8
    x = np.linspace(0.0, strip.length, n + 1)
    cells = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    line = Hermite.on_line(MPI.COMM_SELF, x, cells)
    trial, test = ufl.TrialFunction(line.space), ufl.TestFunction(line.space)
    EI, rhoA = strip.flexural_rigidity, strip.mass_per_length
    forms = {
        "mass": rhoA
        * line.value(trial)
        * line.value(test)
        * ufl.dx(metadata={"quadrature_degree": MASS_DEGREE}),
        "stiffness": EI
        * line.curvature(trial)
        * line.curvature(test)
        * ufl.dx(metadata={"quadrature_degree": BENDING_DEGREE}),
    }
    operators = rigid_ground.on_ground(strip, n, "tip")
    for name, form in forms.items():
        weak = line.assemble(form)[2:, 2:]
        assert abs(weak - getattr(operators, name)).max() <= ROUND_OFF * abs(weak).max()


@pytest.mark.parametrize("scheme", ["moreau-jean", "newmark"])
def test_both_engines_land_alike(scheme: SchemeName) -> None:
    strip, n, step, n_steps = rigid_ground.steel_strip(damping_ratio=0.002), 10, 2e-5, 630
    operators = rigid_ground.on_ground(strip, n, "everywhere")
    shape = rigid_ground.lifted(strip, n, LIFT, "tip force")
    out = strips.run(
        laws.Law("newton", 0.1),
        SCHEMES[scheme],
        operators,
        strips.released(shape, operators),
        time_step=step,
        stretch=n_steps,
        n_stretches=1,
    )
    other = simulate(
        operators,
        Law(f"newton@{scheme}", 0.1),
        (shape, 0.0 * shape),
        time_step=step,
        n_steps=n_steps,
    )
    assert other.impact_pair.tolist() == out.impacts.pair.tolist()
    assert other.impact_pair.size >= 3
    assert np.abs(other.u - out.displacement).max() < SAME_STEPS
