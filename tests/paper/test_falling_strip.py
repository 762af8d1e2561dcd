"""A lamina over the ground, and the measures of both experiments."""

from collections.abc import Callable

import golden
import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.sparse.linalg import spsolve

from delam_fem.api import SCHEMES, ImpactTable, Lamina, Law
from delam_fem.numerics.beams import cantilever_roots
from delam_fem.paper import falling_strip as strips, lateral, rigid_ground
from delam_fem.paper.claims import Numbers
from delam_fem.paper.falling_strip import (
    LIFT,
    Energy,
    Rolling,
    RollingStudy,
    TipBlock,
    rolling,
    tip_block,
)
from delam_fem.results.figures.style import styled

ROUND_OFF = 1e-9
"""Relative; K of 10 to 20 elements has a condition number of 1e6."""
FIRST_MODE = 1e-3
"""Relative. Measured: 1e-4, damping over the fall and 40 elements."""
N = 12


# -- operators --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("touching", "pairs"), [("everywhere", np.arange(N)), ("tip", np.array([N - 1]))]
)
def test_each_pair_is_one_node_above_the_ground(touching: rigid_ground.Touching, pairs) -> None:
    operators = rigid_ground.on_ground(rigid_ground.steel_strip(), N, touching)
    heights = np.random.default_rng(3).normal(size=2 * N)
    assert np.diff(operators.gap_matrix.indptr).tolist() == [1] * pairs.size
    assert (operators.gap_matrix @ heights == heights[2 * pairs]).all()
    assert not operators.gap0.any()


def test_strip_has_the_frequency_asked_for() -> None:
    strip = rigid_ground.steel_strip(31.0, thickness=0.002)
    assert strip.angular_frequencies(1)[0] / (2.0 * np.pi) == pytest.approx(31.0, rel=1e-12)


def test_modes_one_and_two_have_the_damping_ratio() -> None:
    strip = rigid_ground.steel_strip(damping_ratio=0.01)
    operators = rigid_ground.on_ground(strip, N, "tip")
    M, C, K = (a.toarray() for a in (operators.mass, operators.damping, operators.stiffness))
    square, modes = np.linalg.eig(np.linalg.solve(M, K))
    for k in np.argsort(square)[:2]:
        mode = modes[:, k]
        ratio = mode @ C @ mode / (2.0 * np.sqrt(square[k]) * (mode @ M @ mode))
        assert ratio == pytest.approx(0.01, rel=1e-4)  # the mesh's error of ω2


def test_gaps_count_from_where_the_strip_would_hang() -> None:
    strip = rigid_ground.steel_strip(length=0.5, thickness=0.001)
    operators = rigid_ground.on_ground(strip, N, "everywhere", gravity=9.81)
    load = np.zeros(2 * N)
    load[::2] = strip.mass_per_length * 9.81 * strip.length / N
    load[-2:] *= 0.5, 0.0
    load[-1] = -strip.mass_per_length * 9.81 * (strip.length / N) ** 2 / 12.0
    hanging = -spsolve(operators.stiffness.tocsc(), load)
    assert operators.gap0 == pytest.approx(hanging[::2], rel=ROUND_OFF)
    assert operators.gap0[-1] == pytest.approx(-rigid_ground.sag(strip, 9.81), rel=ROUND_OFF)
    up = rigid_ground.lifted(strip, N, 0.05, "tip force", gravity=9.81)
    height = operators.gap_matrix @ up + operators.gap0
    assert height[-1] == pytest.approx(0.05, rel=ROUND_OFF)
    assert height.min() > 0.0
    # the end force alone is left when the weight is taken off: K u = P at the tip
    force = operators.stiffness @ up
    assert force[-2] > 0.0
    assert np.abs(np.delete(force, -2)).max() < ROUND_OFF * force[-2] * strip.length


def test_a_strip_that_stays_on_the_ground_is_refused() -> None:
    strip = rigid_ground.steel_strip(length=0.5, thickness=0.001)
    with pytest.raises(ValueError, match=r"a third of its sag of 0\.0343\d* m .* given 0\.005 m"):
        rigid_ground.lifted(strip, N, 0.005, "tip force", gravity=9.81)


@pytest.mark.parametrize("by", ["tip force", "uniform load"])
def test_lifted_shapes_are_in_equilibrium(by: rigid_ground.Lift) -> None:
    strip = rigid_ground.steel_strip()
    operators, h = rigid_ground.on_ground(strip, N, "tip"), strip.length / N
    load = np.zeros(2 * N)
    if by == "tip force":
        load[-2] = 1.0
    else:  # of a constant load on cubic elements
        load[::2] = h
        load[-2:] = h / 2.0, -(h**2) / 12.0
    exact = spsolve(operators.stiffness.tocsc(), load)
    assert rigid_ground.lifted(strip, N, 0.05, by) == pytest.approx(
        0.05 * exact / exact[-2], rel=ROUND_OFF
    )


def test_first_mode_is_lifted_as_a_mode() -> None:
    strip = rigid_ground.steel_strip()
    operators, shape = (
        rigid_ground.on_ground(strip, N, "tip"),
        rigid_ground.lifted(strip, N, 0.05, "first mode"),
    )
    square = shape @ (operators.stiffness @ shape) / (shape @ (operators.mass @ shape))
    assert shape[-2] == pytest.approx(0.05)
    assert np.sqrt(square) == pytest.approx(strip.angular_frequencies(1)[0], rel=1e-5)


def test_strain_of_the_lifted_strip_is_that_of_beam_theory() -> None:
    strip = rigid_ground.steel_strip()
    gauges = np.array([0.0, 0.3 / N, 0.5, 0.777, 1.0]) * strip.length
    operators = rigid_ground.on_ground(strip, N, "tip", gauges=gauges.tolist())
    strain = operators.probes[1:] @ rigid_ground.lifted(strip, N, 0.05, "tip force")
    exact = 1.5 * 0.05 * strip.thickness * (strip.length - gauges) / strip.length**3
    assert strain == pytest.approx(exact, rel=ROUND_OFF, abs=ROUND_OFF * exact[0])


def test_wrong_meshes_are_refused() -> None:
    with pytest.raises(ValueError, match="expected at least 2 elements, given 1"):
        rigid_ground.on_ground(rigid_ground.steel_strip(), 1, "tip")


# -- runs and measures ------------------------------------------------------------------------


def test_without_a_law_the_strip_swings_through_the_ground_and_keeps_its_energy() -> None:
    strip = rigid_ground.steel_strip()
    operators = rigid_ground.on_ground(strip, N, "everywhere")
    start = strips.released(rigid_ground.lifted(strip, N, 0.05, "first mode"), operators)
    out = strips.run(
        Law("none"), SCHEMES["newmark"], operators, start,
        time_step=1e-5, stretch=500, n_stretches=5,
    )  # fmt: skip
    energy = Energy.of(out)
    assert out.displacement[-1, 0] == pytest.approx(-0.05, rel=1e-4)  # half a period of 50 ms
    assert energy.stored == pytest.approx(energy.stored[0], rel=ROUND_OFF)
    assert out.time[-1] == energy.time[-1] == pytest.approx(0.025)
    assert out.frames[-1, 0, -2] == out.displacement[-1, 0]
    assert out.impacts.time.size == 0


@pytest.fixture(scope="module")
def fallen() -> Rolling:
    return rolling(
        rigid_ground.steel_strip(damping_ratio=0.002),
        gravity=0.0,
        n_elements=20,
        steps_per_period=5000,
    )


def front_of(run: Rolling, x: np.ndarray, t: np.ndarray) -> Rolling:
    """Return a run whose nodes at x were pushed at t, in the order of time."""
    order = np.argsort(t)
    pairs = np.searchsorted(run.x, x[order] - 1e-9)
    pushes = ImpactTable(t[order], pairs, np.ones(x.size), -np.ones(x.size))
    return Rolling(**{**vars(run), "impulses": pushes})


@pytest.mark.parametrize("speed", [250.0, -400.0])
def test_front_finds_direction_and_speed(fallen: Rolling, speed: float) -> None:
    t = 0.02 + (fallen.x - fallen.x[0] if speed > 0.0 else fallen.x - fallen.x[-1]) / speed
    direction, front_speed = front_of(fallen, fallen.x, t).front()
    assert direction == pytest.approx(np.sign(speed))
    assert front_speed == pytest.approx(abs(speed))


def test_a_strip_that_lands_at_once_has_no_front(fallen: Rolling) -> None:
    at_once = front_of(fallen, fallen.x, np.full(fallen.x.size, 0.0125))
    assert at_once.front() == (0.0, float("inf"))
    assert at_once.numbers()["front_speed_m_s"] is None


def test_a_node_counts_when_it_is_first_pushed(fallen: Rolling) -> None:
    twice = front_of(fallen, fallen.x[[8, 8, 9]], np.array([0.013, 0.012, 0.014]))
    assert twice.contact_line[[8, 9]].tolist() == [0.012, 0.014]
    assert np.isnan(twice.contact_line[10])


def test_shares_add_up(fallen: Rolling) -> None:
    shares = fallen.shares(0.013)
    assert shares["lost"] == shares["impacts"] + shares["damping"]
    assert shares["lost"] + shares["left"] == pytest.approx(1.0, abs=ROUND_OFF)
    assert fallen.shares(0.010)["impacts"] == 0.0 < shares["impacts"]


@pytest.fixture(scope="module")
def block() -> TipBlock:
    """Return a coarse computation: the figures are drawn, numbers are verified elsewhere."""
    return tip_block(n_elements=40, time_step=2.5e-6, duration=1e-3)


def test_block_pushes_only_while_it_is_pressed(block: TipBlock) -> None:
    force = block.force
    assert (force[block.spring.tip >= 0.0] == 0.0).all()
    assert (force[block.spring.time < 0.0] == 0.0).all()
    late = block.spring.time > 1e-4
    assert trapezoid(force, block.spring.time) == pytest.approx(block.spring.impulse[late][-1])


def test_the_first_mode_has_its_share_of_the_energy_of_the_lifted_strip(block: TipBlock) -> None:
    """A force at the tip gives mode k the share 12 / B_k⁴ of the energy, and free motion keeps it.

    Mode k has 2 P² L³ / (EI B_k⁴), all modes have P² L³ / (6 EI).
    """
    share = 12.0 / cantilever_roots(1)[0] ** 4
    assert share == pytest.approx(0.9707, abs=1e-4)
    energy = block.free.first_mode
    assert energy == pytest.approx(share * block.energy, rel=FIRST_MODE)
    assert np.abs(block.rigid.first_mode - energy)[-1] > 0.1 * energy[-1]  # the block takes it


def test_before_the_touch_all_blocks_are_none(block: TipBlock) -> None:
    early = block.free.time < 0.0
    for motion in (block.spring, block.rigid):
        scale = np.abs(block.free.strain).max()
        assert np.abs(block.wave(motion)[:, early]).max() < 1e-6 * scale
    assert block.free.tip[early].min() > 0.0 > block.free.tip[~early].max() - 1e-9


def test_group_speeds_are_told_in_per_cent_and_kilohertz() -> None:
    numbers = Numbers({
        "mean_wave_speed_m_s": 1703.0, "longitudinal_speed_m_s": 5172.0,
        "timoshenko_lowers_by": [0.6, 0.8], "half_wave_Hz": [6e4, 8e4],
    })  # fmt: skip
    [statement] = (
        candidate
        for candidate in lateral.STRUCK_TIP.statements
        if "wave velocity" in candidate.text
    )
    assert statement.measured(numbers).endswith(
        "lower the group speeds by 60 to 80 % at 60 to 80 kHz"
    )


def level(elements: int, steps: int) -> dict[str, object]:
    """Return a level of the study."""
    shares = {"impacts": 0.2, "damping": 0.7, "left": 0.1}
    grid = {"damping_ratio": 0.002, "elements": elements, "steps_per_period": steps}
    return {"law": lateral.MAIN, **grid, **shares, "outcome": "completed"}


def test_rows_about_the_strip_tell_rolling_from_landing_with_the_tip(block: TipBlock) -> None:
    thin = rolling(n_elements=40, steps_per_period=5000)

    def rows(run: Rolling) -> list[str]:
        study = RollingStudy({lateral.MAIN: run}, thin, {0.05: thin}, [level(40, 5000)])
        claims = lateral.ROLLING_STRIP.judge(lateral.rolling_numbers(study, block))
        return [claim.verdict for claim in claims]

    assert rows(thin) == ["holds"] * 3
    assert rows(rolling(height=0.15, n_elements=20, steps_per_period=5000))[0] == "does not hold"


def landed(
    lamina: Lamina, method: str = lateral.MAIN, *, speed: float = 40.0, height: float = LIFT
) -> Rolling:
    """Return a prescribed fall: the tip falls and rebounds, the contact line runs evenly."""
    period = 2.0 * np.pi / lamina.angular_frequencies(1)[0]
    t, x = period * np.arange(2001) / 4000, rigid_ground.nodes(lamina, 20)
    tip = height * np.where(t < 0.25 * period, np.cos(2.0 * np.pi * t / period), 0.03 * t / period)
    first = 0.26 * period + (x if speed > 0.0 else x - x[-1]) / speed
    order = np.argsort(first)
    times, pairs = np.append(first[order], t[-1]), np.append(order, 3)
    pushes = ImpactTable(times, pairs, np.full(21, 2e-3), np.full(21, -0.4))
    lost = np.clip(t[::8] / period - 0.25, 0.0, 0.2)
    energy = Energy(t[::8], 0.02 * (1.0 - 4.5 * lost), 0.06 * lost, 0.03 * lost, 1e-9)
    return Rolling(
        lamina, method, "tip force", rigid_ground.GRAVITY, x, 4000, t, tip, np.abs(tip[8::8]) * 1.1,
        pushes, energy, "completed",
    )  # fmt: skip


def test_figures_have_the_stored_words(block: TipBlock, stored: Callable[[str], None]) -> None:
    refinement = [
        level(n, steps) | {"law": law, "impacts": 0.1 * k + 1e-3 * n, "left": 500.0 / steps}
        for k, law in enumerate(strips.METHODS)
        for n in (20, 40, 80)
        for steps in (20_000, 5_000)
    ]
    runs = lateral.completed(RollingStudy({}, None, {}, refinement), lateral.MAIN, 0.002, 40)
    assert [run["steps_per_period"] for run in runs] == [5_000, 20_000]
    thin, stiff = strips.thin_strip(), landed(rigid_ground.steel_strip(), speed=-300.0)
    study = RollingStudy(
        {method: landed(thin, method, speed=40.0 + k) for k, method in enumerate(strips.METHODS)},
        stiff,
        {h: landed(thin, height=h, speed=60.0 if h < 0.06 else -90.0) for h in (0.02, 0.05, 0.1)},
        refinement,
    )
    struck = Numbers(block.numbers(), block=block)
    rolling = lateral.rolling_numbers(study, block)
    with styled():
        figures = lateral.ROLLING_STRIP.draw(rolling), lateral.STRUCK_TIP.draw(struck)
    stored("\n\n".join(map(golden.describe, figures)))


def test_figure_says_how_high_the_tip_was() -> None:
    assert LIFT == 0.050
