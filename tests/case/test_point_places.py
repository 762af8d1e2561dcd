"""A point has no places: none need be given, and none is taken but the end of its picture."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import delam_fem as df

M, F, FREQUENCY = 0.25, 0.4, 5.0
"""Mass of a free point [kg], amplitude [N] and frequency [Hz] of the force on it."""
POINT = {"name": "one", "mass": M, "stiffness": 0.0, "damping_ratio": 0.0}


def case_of(**sections: Any) -> df.Case:
    """Return a free point under a harmonic force, with sensors, without any place."""
    return df.Case(**{
        "name": "point", "lamina": [POINT], "mesh": {"elements": 1},
        "excitation": {"kind": "force", "lamina": "one", "amplitude": F, "frequency": FREQUENCY},
        "sensor": [{"name": name, "lamina": "one", "quantity": name}
                   for name in ("velocity", "acceleration")],
        "contact": {"law": "none"}, "time": {"steps_per_period": 2000, "periods": 1},
        "output": {"window_periods": 1},
    } | sections)  # fmt: skip


def test_a_force_on_a_point_accelerates_all_of_its_mass() -> None:
    """a = F sin(wt) / m and v = F (1 - cos(wt)) / (m w)."""
    history = df.run(case_of(), "compiled").history
    w = 2.0 * np.pi * FREQUENCY
    t = history["time"].to_numpy()
    a, v = (history[f"sensor_{name}"].to_numpy() for name in ("acceleration", "velocity"))
    a_step = F / M * w * (t[1] - t[0])  # by how much the acceleration changes in a step
    np.testing.assert_allclose(a, F / M * np.sin(w * t), atol=1.1 * a_step)
    np.testing.assert_allclose(v, F / (M * w) * (1.0 - np.cos(w * t)), atol=1e-3 * F / (M * w))


@pytest.mark.parametrize(
    ("section", "table", "keys"),
    [
        (
            "excitation",
            {"kind": "force", "amplitude": F, "frequency": FREQUENCY},
            {"position": 0.5},
        ),
        ("excitation", {"kind": "hammer", "amplitude": F, "duration": 0.01}, {"position": 0.5}),
        ("sensor", {"name": "a", "quantity": "velocity"}, {"position": 0.0}),
        ("point_mass", {"mass": 0.1}, {"position": 0.5}),
        ("stop", {"side": "above", "gap": 1e-3}, {"position": 0.5}),
        ("stop", {"side": "above", "gap": 1e-3}, {"start": 0.2, "end": 1.0}),
        ("impactor", {"mass": 0.1, "velocity": 1.0}, {"position": 0.5}),
        ("initial", {"shape": "force", "displacement": 1e-3}, {"position": 0.5}),
    ],
)
def test_a_place_on_a_point_is_refused(
    section: str, table: dict[str, Any], keys: dict[str, float]
) -> None:
    entry = {"lamina": "one", **table, **keys}
    place = "end" if "end" in keys else "position"
    with pytest.raises(df.CaseError, match=rf"{section}.*{place}: .*point.*{keys[place]}"):
        case_of(**{section: entry if section == "excitation" else [entry]})


def test_the_end_of_a_point_may_be_written() -> None:
    case = case_of()
    assert case == df.Case.from_toml(case.to_toml())
    long = POINT | {"length": "50 mm"}
    assert case_of(lamina=[long]).sensor[0].position == 0.05
