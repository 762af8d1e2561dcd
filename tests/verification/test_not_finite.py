"""No number that is not finite passes a judge of quality."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from stack import three_laminae
from synthetic import PERIODS, small_case

import delam_fem as df
from delam_fem.api import (
    LEDGER,
    CaseError,
    EngineName,
    Recorder,
    assemble,
    is_lost,
    solve,
    statistics,
)
from delam_fem.numerics.settling import judge
from delam_fem.numerics.statistics import Simulations
from delam_fem.results import quality
from delam_fem.results.diagnostics import gain_warning
from delam_fem.results.pages.report import sentence
from delam_fem.results.quality import quality_warnings
from delam_fem.studies.convergence.level import compute as compute_level
from delam_fem.studies.convergence.refinement import RefinementStudy, method
from delam_fem.studies.detection.detect import Measurement, detect
from delam_fem.studies.detection.study import Modulate
from delam_fem.studies.orbits.newton import is_zero
from delam_fem.studies.orbits.search import stability_of
from delam_fem.studies.signals.alignment import Alignment
from delam_fem.studies.signals.comparison import ChannelComparison, findings
from delam_fem.studies.sweeps.grid import sweep_of
from delam_fem.studies.sweeps.point import PointRunner

BAD = (np.nan, np.inf, -np.inf)
SMALL = {
    "mesh.elements": 4, "time.steps_per_period": 100, "time.periods": 2,
    "output.window_periods": 2, "output.fields_per_period": 0,
}  # fmt: skip


def apart() -> df.Operators:
    """Return two oscillators of 1 kg that know nothing of one another; one probe, of the first."""
    zero, unit = np.zeros(2), sp.identity(2, format="csr")
    base = df.BaseCoupling(zero, zero, np.array([-1.0, 0.0]))
    none = sp.csr_matrix((0, 2))
    probe = sp.csr_matrix([[1.0, 0.0]])
    return df.Operators(unit, 0.1 * unit, unit, base, none, np.zeros(0), probes=probe)


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
@pytest.mark.parametrize("bad", [*BAD, 1e200])
def test_a_motion_with_an_infinite_energy_is_not_completed(bad: float, engine: EngineName) -> None:
    """Only the second mass moves so; the probe sees nothing of it. (1e200 m)² overflows."""
    start = np.zeros((3, 2))
    start[0, 1] = bad
    solution = solve(
        apart(), df.Law("none"), df.SCHEMES["newmark"], df.HarmonicMotion(1e-3, 1.0),
        steps_per_period=50, periods=2, engine=engine,
        initial=df.State(start, np.zeros(0, np.bool_)),
    )  # fmt: skip
    assert np.isfinite(solution.displacement).all()
    assert solution.outcome == "diverged"
    assert is_lost(solution.recorder.energy_residual())


@pytest.mark.parametrize("column", LEDGER)
@pytest.mark.parametrize("bad", BAD)
def test_no_column_of_the_ledger_hides(bad: float, column: str) -> None:
    stack = three_laminae()
    stack.recorder.ledger[1, LEDGER.index(column)] = bad
    residual = Recorder.energy_residual(stack.recorder)
    assert np.isnan(residual)
    case = df.preset("default", SMALL)
    (text,) = quality_warnings(case, assemble(case, needs_dolfinx=False), residual)
    assert "not finite" in text


def test_a_residual_of_nothing_and_one_of_a_free_motion() -> None:
    """Nothing is exchanged: round-off of 1 J stored passes, a thousandth of it does not."""
    ledger = np.zeros((1, len(LEDGER)))
    still = np.zeros((1, 2, 1))
    recorder: Any = SimpleNamespace(ledger=ledger, n_closed=1, envelope=still, round_off=0.0)
    assert Recorder.energy_residual(recorder) == 0.0
    ledger[0, -1] = 1e-18
    assert is_lost(Recorder.energy_residual(recorder))
    ledger[0, 0] = 1.0
    assert Recorder.energy_residual(recorder) < 1e-9
    ledger[0, -1] = 1e-3
    assert is_lost(Recorder.energy_residual(recorder))


@pytest.mark.parametrize("restitution", [1.0, 0.9])
def test_round_off_of_elastic_impacts_is_no_gain(restitution: float) -> None:
    case = df.preset(
        "default",
        {**SMALL, "contact.restitution": restitution, "mesh.elements": 10, "time.periods": 15},
    )
    result = df.run(case, "compiled", structure=assemble(case, needs_dolfinx=False))
    assert result.history.sizes["event"] > 0
    assert not [text for text in result.summary["warnings"] if "impacts added" in text]


def test_a_gain_of_elastic_impacts_is_told() -> None:
    ledger = np.zeros((2, len(LEDGER)))
    ledger[:, LEDGER.index("base_work")] = 1e-3
    ledger[1, LEDGER.index("impact_loss")] = -1e-9
    impulse = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 1e-9]])
    recorder: Any = SimpleNamespace(n_closed=2, impulse=impulse, ledger=ledger)
    text = gain_warning(recorder, may_add=False)
    assert text is not None and "impacts added 1e-09 J" in text


@pytest.mark.parametrize("bad", BAD)
def test_strobes_that_are_not_finite_have_not_settled(bad: float) -> None:
    strobes = np.ones((2, 2, 60)) + 1e-3 * np.sin(np.arange(60.0))
    assert judge(strobes, 1, 0.1, is_linear=False).word == "settled"
    assert judge(strobes, 1, bad, is_linear=False).word == "not settled"
    strobes[1, 0, 40] = bad
    assert judge(strobes, 1, 0.1, is_linear=False).word == "not settled"


def test_a_speed_between_the_strobes_counts() -> None:
    stack = three_laminae()
    before = quality.verdict_of(stack.recorder, 3, 0.5)
    stack.recorder.window[-1].v[1, 0] = np.nan
    after = quality.verdict_of(stack.recorder, 3, 0.5)
    assert after.word == "not settled" and np.isnan(after.transient)
    assert before.periods_judged == after.periods_judged == min(PERIODS, before.periods_judged)


@pytest.mark.parametrize("bad", BAD)
def test_no_limit_has_an_infinite_error(bad: float) -> None:
    sizes, values = [1.0, 0.5, 0.25, 0.125], [1.5, 1.25, 1.125, 1.0625]
    assert statistics.limit(sizes, values, np.zeros(4)).value == pytest.approx(1.0)
    assert np.isnan(statistics.limit(sizes, values, [0.0, 0.0, 0.0, bad]).value)


def channel(**changed: float) -> ChannelComparison:
    values = {
        "gain": 1.0, "gain_error": 0.01, "delay": 0.0, "delay_error": 1e-6, "correlation": 1.0,
        "unlike": 0.0,
        "mean_difference": 0.0, "residual": 0.0,
    }  # fmt: skip
    return ChannelComparison("tip", "m", False, **(values | changed))  # type: ignore[arg-type]


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("name", ["gain", "gain_error", "delay", "delay_error", "unlike"])
def test_a_channel_without_numbers_does_not_agree(name: str, bad: float) -> None:
    all_findings = [
        findings([channel(), other], Alignment(0.0, 0.0, 1.0), 3.0)
        for other in (channel(), channel(**{name: bad}))
    ]
    assert [[finding.kind for finding in each] for each in all_findings] == [[], ["numbers"]]
    clock = findings([channel()], Alignment(0.0, 0.0, bad), 3.0)
    assert [finding.kind for finding in clock] == ["clock"]


@pytest.mark.parametrize("bad", BAD)
def test_no_orbit_is_solved_or_stable_by_an_infinite_error(bad: float) -> None:
    assert is_zero(0.1, 0.06) and not is_zero(0.1, 0.04)
    assert not is_zero(0.1, bad) and not is_zero(abs(bad), 0.06)
    assert (stability_of(0.8, 0.9), stability_of(1.1, 1.2)) == ("stable", "unstable")
    assert stability_of(0.9, 1.1) == "undecided"
    assert stability_of(np.nan, 0.9) == stability_of(1.1, np.nan) == "undecided"


@pytest.mark.parametrize("bad", BAD)
def test_no_scan_with_such_a_sample_calls_nothing(bad: float) -> None:
    times, x = np.arange(4000) / 4000.0, np.linspace(0.0, 0.4, 12)
    field = np.random.default_rng(1).normal(size=(times.size, x.size))
    field[7, 3] = bad
    with pytest.raises(CaseError, match="finite numbers, given 1 others among 48000"):
        detect(df.preset("embedded"), measured=Measurement(times, x, field, 63.7), repetitions=2)


def test_noise_without_a_size_is_refused() -> None:
    with pytest.raises(CaseError, match=r"noise_db: .*given nan"):
        Modulate(pump_frequency=30.0, pump_amplitude=1e-6, periods=1, noise_db=np.nan)


@pytest.mark.parametrize("bad", BAD)
def test_no_posterior_of_such_an_observation(bad: float) -> None:
    rng = np.random.default_rng(0)
    table = Simulations(
        rng.uniform(size=(200, 1)), rng.normal(size=(200, 2)), np.array([[0.0, 1.0]])
    )
    with pytest.raises(ValueError, match="finite statistics"):
        table.posterior(np.array([0.0, bad]))


def test_tips_without_a_gap_are_not_said_to_be_apart() -> None:
    history = three_laminae().history()
    said = {"tip_contacts_per_period": 0.0, "minimum_tip_gap": 1e-3}
    assert "never meet" in sentence(history, said, small_case())
    for gap in (None, np.nan):
        assert "never meet" not in sentence(history, {**said, "minimum_tip_gap": gap}, small_case())


@pytest.mark.parametrize("residual", [np.nan, 0.5])
def test_points_and_levels_with_an_open_ledger_are_not_completed(
    residual: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    axis = {"key": "excitation.frequency", "values": [3.0]}
    sweep = sweep_of({"name": "s", "base": "default", "set": SMALL, "axis": [axis]})
    rigid = method("newton@moreau-jean")
    refinement = RefinementStudy(
        df.preset("default", SMALL), (rigid,), meshes=(4,), steps=(100,), periods=2
    )
    level = next(level for level in refinement.levels() if level.method == rigid.name)
    monkeypatch.setattr(Recorder, "energy_residual", lambda _: residual)
    point, _ = PointRunner(sweep).point(0, None)
    level_result = compute_level(level, "compiled")
    assert point.outcome == level_result.outcome == "diverged"
    assert "does not close" in point.error and "does not close" in level_result.error
