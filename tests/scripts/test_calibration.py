"""The page of calibration: how rows are judged, how it is written, and its parts in short forms."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from calibration import detect as healthy, lyapunov as exponents
from calibration.row import OWN, Row
from project import ROOT, script

import delam_fem as df
from delam_fem.studies.detection.detect import intact, simulated
from delam_fem.studies.detection.study import Scan
from delam_fem.studies.signals.scan import shapes_of
from delam_fem.studies.sweeps import point

page = script("calibrate")
PUBLISHED = json.loads((ROOT / "docs" / "evidence" / "calibration.json").read_text("utf-8"))
SHORT = "**falls short**"


def judged(contained: int, *, rig: str = OWN, truths: int = 200, **more: Any) -> str:
    return Row("an interval", rig, 0.9, contained, truths, **more).judgement


def test_the_own_rig_must_lie_in_the_binomial_band() -> None:
    assert Row("an interval", OWN, 0.9, 0, 200).band == (171, 188)
    assert [judged(k) for k in (170, 171, 188, 189)] == [
        SHORT, "holds", "holds", "wider than promised",
    ]  # fmt: skip


def test_other_rigs_may_miss_twice_as_many_or_have_the_mismatch_named() -> None:
    other = "EI + 5 %"
    assert [judged(k, rig=other) for k in (159, 160, 200)] == [SHORT, "holds", "holds"]
    assert judged(100, rig=other, warned=180) == "mismatch named"
    assert judged(100, rig=other, warned=179) == SHORT


def test_a_promise_of_all_allows_no_wrong_one() -> None:
    assert Row("orbit", "finer steps", 1.0, 8, 9, 1).judgement == "holds"
    assert Row("orbit", "finer steps", 1.0, 7, 9, 1).judgement == SHORT


def test_undecided_truths_do_not_count() -> None:
    assert judged(90, undecided=100) == "holds"
    assert judged(90, undecided=50) == SHORT
    assert judged(0, undecided=200) == "undecided"


def test_the_page_is_that_of_its_numbers() -> None:
    assert (ROOT / "docs" / "evidence" / "calibration.md").read_text("utf-8") == page.page(
        PUBLISHED
    )
    assert set(PUBLISHED) == set(page.PARTS)


def test_each_part_has_every_rig_or_says_why_not() -> None:
    assert {name for name in PUBLISHED if page.lacking(PUBLISHED[name]["rows"])} == set(
        page.WHY_NOT
    )


def test_a_part_replaces_its_own_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = tmp_path / "calibration.json"
    numbers.write_text(json.dumps({"other": {"cpu_s": 1, "rows": []}}))
    row = Row("a verdict", OWN, 0.99, 199, 200, note="a note")
    monkeypatch.setitem(sys.modules, "calibration.other", healthy)
    monkeypatch.setattr(healthy, "rows", lambda is_long, folder: [row] if is_long else [])
    assert page.main(["--part", "detect", "-o", str(tmp_path)]) == 0
    content = json.loads(numbers.read_text())
    assert content["detect"]["rows"] == [vars(row)]
    assert content["other"] == {"cpu_s": 1, "rows": []}
    assert "| a verdict | 99 % | 1 | 200 | 100 % |  |" in (tmp_path / "calibration.md").read_text(
        "utf-8"
    )


def falling_short(rows: list[dict[str, Any]]) -> set[tuple[str, str]]:
    return {(row["verdict"], row["rig"]) for row in rows if Row(**row).judgement == SHORT}


@pytest.mark.parametrize("name", page.PARTS)
@pytest.mark.slow
def test_short_forms_hold_where_the_page_says_so(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Motions that are not regular differ with the processor, so that its truths are others."""
    rows, known = page.measured(name, is_long=False), falling_short(PUBLISHED[name]["rows"])
    assert rows
    monkeypatch.setattr("calibration.row.BAND", 0.999)  # of a dozen parts, each with some rows
    assert falling_short(rows) <= known


@pytest.mark.nightly
@pytest.mark.parametrize("name", page.PARTS)
def test_long_forms_hold_where_the_page_says_so(name: str) -> None:
    rows = page.measured(name, is_long=True)
    assert {(r["verdict"], r["rig"]) for r in rows} == {
        (r["verdict"], r["rig"]) for r in PUBLISHED[name]["rows"]
    }
    assert falling_short(rows) <= falling_short(PUBLISHED[name]["rows"])


def test_small_distances_of_motions_have_errors_that_hold_what_steps_hide(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Motions nearer than what moves in a step hit in the same one, at twice the distance too."""

    def is_inside() -> bool:
        drawn = iter((2.4, 0.02, 0.7))  # ω, s, e
        rng = SimpleNamespace(uniform=lambda low, high: next(drawn))
        exponent, exact = exponents.judged(rng, "distance 0.3 %")
        return abs(exponent.value - exact) <= 2.0 * exponent.error

    assert is_inside()
    monkeypatch.setattr(point, "FEW_STEPS", 0)
    assert not is_inside()


@pytest.mark.parametrize("clamp", [math.inf, 10.0])
@pytest.mark.parametrize("frequency", [63.7, 250.0])
def test_the_healthy_plate_moves_as_the_simulated_one(frequency: float, clamp: float) -> None:
    case = df.preset("embedded", {"excitation.frequency": frequency})
    if math.isfinite(clamp):
        EI = 70e9 * 0.02 * 0.002**3 / 12.0
        case = case.with_overrides({"support.rotational_stiffness": clamp * EI / 0.4})
    measurement = simulated(intact(case), Scan())
    shape = shapes_of(measurement.field, measurement.times, frequency, measurement.x).order(1.0)
    velocity = 0.1 * healthy.velocity(
        measurement.x, frequency, healthy.Rig(clamp=clamp)
    )  # 0.1 m/s2
    np.testing.assert_allclose(np.abs(shape), np.abs(velocity), atol=2e-3 * np.abs(velocity).max())
