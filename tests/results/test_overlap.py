"""Overlaps of springs that are too soft: depths with a known value, and remedies that work."""

from __future__ import annotations

import re
from typing import Any

import pytest

import delam_fem as df

M, K, GAP = 0.1, 1e4, 1e-3
"""Mass of a free point [kg], stiffness of its contact [N/m], gap to a stop [m]."""
PENALTY = "contact.penalty_stiffness"


def overlaps(case: df.Case) -> list[str]:
    """Return the warnings of a run that are about the penalty."""
    return [text for text in df.run(case, "compiled").summary["warnings"] if PENALTY in text]


def thrown(depth: float, **keys: Any) -> df.Case:
    """Return a free point that flies into a spring, which stops it at v √(m/k) = depth."""
    point = {"name": "one", "mass": M, "stiffness": 0.0, "damping_ratio": 0.0}
    return df.Case(**{
        "name": "thrown", "lamina": [point], "mesh": {"elements": 1},
        "excitation": {"kind": "force", "lamina": "one", "position": 1.0, "amplitude": 0.0,
                       "frequency": 5.0},
        "stop": [{"lamina": "one", "side": "above", "gap": GAP}],
        "initial": [{"velocity": depth * (K / M) ** 0.5}],
        "contact": {"law": "penalty", "penalty_stiffness": K},
        "time": {"steps_per_period": 4000, "periods": 1},
        "output": {"window_periods": 1, "fields_per_period": 4000},
    } | keys)  # fmt: skip


@pytest.mark.parametrize(("share", "count"), [(0.097, 0), (0.103, 1)])
@pytest.mark.parametrize("side", ["above", "below"])
def test_a_tenth_of_the_gap_to_a_stop_is_the_limit(share: float, count: int, side: str) -> None:
    sign = 1.0 if side == "above" else -1.0
    stop = {"lamina": "one", "side": side, "gap": GAP}
    speed = sign * share * GAP * (K / M) ** 0.5
    case = thrown(0.0, stop=[stop], initial=[{"velocity": speed}])
    texts = overlaps(case)
    assert len(texts) == count
    assert all("stop.1" in text and f"{1e3 * share * GAP:.3g} mm" in text for text in texts)


def test_a_stop_with_a_stiffness_of_its_own_is_meant_to_yield() -> None:
    elastic = {"lamina": "one", "side": "above", "gap": GAP, "stiffness": K}
    assert overlaps(thrown(0.5 * GAP))
    assert not overlaps(thrown(0.5 * GAP, stop=[elastic]))


STRIP = {"length": 0.3, "width": 0.02, "damping_ratio": 0.01}
STRIPS = {
    "lamina": [STRIP | {"name": "steel", "thickness": 1e-3, "material": "steel"},
               STRIP | {"name": "alu", "thickness": 2e-3, "material": "aluminium"}],
    "gap.tip": GAP, "contact": {"law": "penalty"}, "time": {"periods": 20},
    "excitation": {"kind": "harmonic", "frequency": 12.0, "acceleration": 2.0},
}  # fmt: skip
"""Strips whose tips clap; the tenth of the gap and of the thinner one is 0.1 mm."""


def told_of(result: df.Result) -> list[str]:
    """Return the warnings that name the stiffness because laminae overlap."""
    return [text for text in result.summary["warnings"] if PENALTY in text and "overlap" in text]


@pytest.mark.parametrize("stiffness", [1e2, 1e3])
def test_the_stiffness_that_the_warning_names_would_do(stiffness: float) -> None:
    case = df.preset("default", STRIPS | {PENALTY: stiffness})
    result = df.run(case, "compiled")
    assert result.summary["minimum_tip_gap"] < -1e-4
    [text] = told_of(result)
    assert "steel and alu" in text
    named = re.search(r"try (\S+) N/m", text)
    assert named is not None
    stiffer = df.run(case.with_overrides({PENALTY: float(named[1])}), "compiled")
    assert stiffer.summary["minimum_tip_gap"] > -1e-4
    assert told_of(stiffer) == []


def test_a_solid_that_is_bonded_everywhere_has_no_overlap() -> None:
    keys = {"model.kind": "plane-stress", "mesh.elements": 6, "contact.law": "penalty@newmark"}
    keys |= {"contact.penalty_stiffness": 1e4, "time.periods": 1, "time.steps_per_period": 50}
    case = df.preset("embedded", keys | {"output.window_periods": 1})
    bonded = df.Case(**case.model_dump(mode="json", exclude_unset=True) | {"delamination": []})
    assert df.run(bonded).summary["outcome"] == "completed"
