"""Models of one case side by side."""

import dataclasses
import json
import math

import numpy as np
import pytest

from delam_fem import compare_models
from delam_fem.api import CaseError, preset
from delam_fem.studies.models import ModelComparison, Motion, difference_until

CASE = preset("default", {"mesh.elements": 8, "time.steps_per_period": 500, "time.refine": 4})


@pytest.fixture(scope="module")
def found() -> ModelComparison:
    return compare_models(CASE, ["beam", "modes"], frequencies=[3.25], periods=4, modes=6)


def test_a_reduced_beam_is_the_beam(found: ModelComparison) -> None:
    beam, reduced = found.models
    assert (beam.name, reduced.name) == ("beam", "beam, 6 modes")
    np.testing.assert_allclose(reduced.frequencies, beam.frequencies, rtol=1e-8)
    np.testing.assert_allclose(reduced.compliance, beam.compliance, rtol=1e-8)
    L, EI = 0.685, np.array([1.51, 0.16])
    np.testing.assert_allclose(beam.compliance, L**3 / (3 * EI), rtol=1e-9)
    end, apart = difference_until(reduced.motions[0], beam.motions[0])
    assert 0.3 < end < 0.5 and apart < 0.01
    assert beam.labels == (
        "f1, thick",
        "f2, thick",
        "f3, thick",
        "f1, thin",
        "f2, thin",
        "f3, thin",
    )


def test_the_ledger_explains_where_the_work_goes(found: ModelComparison) -> None:
    """Over whole runs: the means of the second half do not contain what is stored meanwhile."""
    for model in found.models:
        e = model.motions[0].energies
        assert e["base_work"] > 0 and e["damping_loss"] > 0 and e["impact_loss"] > 0
        assert model.motions[0].residual < 1e-9


def test_rows_have_a_column_for_each_model(found: ModelComparison) -> None:
    rows = found.linear_rows() + found.motion_rows(0)
    assert all(len(row) == 3 for row in rows)
    text = {name: (first, second) for name, first, second in rows}
    assert text["f1, thin [Hz]"] == ("1.43571", "1.43571 (+0.00%)")
    assert text["difference until then"][0] == "0.00%"


def test_files(found: ModelComparison, tmp_path) -> None:
    table, image = found.save(tmp_path)
    numbers = json.loads(table.read_text())["models"]
    assert [entry["name"] for entry in numbers] == ["beam", "beam, 6 modes"]
    assert numbers[0]["motions"][0]["frequency"] == 3.25
    assert image.stat().st_size > 10_000


def motion(tips: list[float], strike: float) -> Motion:
    time = np.arange(1.0, len(tips) + 1)
    return Motion(1.0, time, np.array([tips]), strike, {}, {}, 0.0, time, time, (1.0, 1.0))


def test_the_difference_counts_until_the_first_strike_of_either() -> None:
    first = motion([1.0, -2.0, 3.0, 50.0], math.inf)
    other = motion([1.0, -2.2, 3.0, 0.0], 4.0)
    assert difference_until(other, first) == (4.0, pytest.approx(0.2 / 3.0))
    assert difference_until(first, first) == (math.inf, 0.0)
    late = dataclasses.replace(first, strike=2.0)
    assert difference_until(other, late) == (2.0, 0.0)
    at_rest = motion([0.0, 0.0, 0.0], math.inf)
    assert difference_until(other, at_rest) == (4.0, 0.0), "a tip that does not move sets no scale"


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["beam", "shell"], "expected some of beam, plane-stress, solid, modes, given 'shell'"),
        (["modes"], "expected a model before modes"),
    ],
)
def test_unknown_models_are_refused(names: list[str], words: str) -> None:
    with pytest.raises(CaseError, match=words):
        compare_models(CASE, names)


def test_motions_must_repeat_and_nothing_may_float() -> None:
    sweep = preset("default", {
        "excitation": {"kind": "sweep", "start_frequency": 1.0, "end_frequency": 2.0,
                       "duration": 10.0, "amplitude": 0.001},
    })  # fmt: skip
    with pytest.raises(CaseError, match="models are compared by periodic motions"):
        compare_models(sweep, ["beam"])
    with pytest.raises(CaseError, match=r"periods: .*given 1"):
        compare_models(CASE, ["beam"], periods=1)
    blow = {"impactor": [{"lamina": "thin", "mass": 0.01, "gap": 0.001}]}
    with pytest.raises(CaseError, match="compare: "):
        compare_models(CASE.with_overrides(blow), ["beam"])


def test_any_channels_are_compared(tmp_path) -> None:
    """An accelerometer and the base: its motion is that of the drive in every model."""
    sensor = {"name": "a1", "lamina": "thin", "position": 0.3, "quantity": "acceleration"}
    case = CASE.with_overrides({"sensor": [sensor]})
    models = compare_models(
        case, ["beam", "modes"], frequencies=[3.25], periods=4, modes=6,
        channels=["a1", "base"],
    )  # fmt: skip
    numbers = models.report.numbers["models"][0]["motions"][0]["channels"]
    assert numbers["base"]["amplitude"] == pytest.approx(case.excitation.amplitude, rel=1e-4)
    rows = {name: row for name, *row in models.motion_rows(0)}
    assert "a1 [m/s²]" in rows and "base [mm]" in rows
    labels = [axes.get_ylabel() for axes in models.figure().axes]
    assert labels == ["a1 [m/s²]", "impulse [mN s/m per period]", "base [mm]"]
    with pytest.raises(CaseError, match=r"channel: expected some of .*a1, given a2"):
        compare_models(case, ["beam"], periods=2, channels=["a2"])
