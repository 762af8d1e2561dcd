"""A film holds positions and contacts, quantised."""

import base64
from typing import Any

import numpy as np
import pytest
from stack import NODE, three_laminae
from synthetic import FRAMES, NODES, PERIODS, WINDOW, small_case, synthetic_history

from delam_fem.case.sections import Support
from delam_fem.results.fields.laminae import contact_lights
from delam_fem.results.fields.pictures import middle_lines
from delam_fem.results.pages import report as films
from delam_fem.results.pages.report import film


def numbers(text: str, kind: str, *shape: int) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype=kind).reshape(shape)


def test_positions_are_those_of_the_middle_lines() -> None:
    recorded = three_laminae()
    history, case = recorded.history(), recorded.case
    data = film(history, case).data
    y = data["unit"] * numbers(data["y"], "<i2", FRAMES * WINDOW, 3, NODES)
    expected = middle_lines(history, case)[:, None] + history["displacement"].to_numpy()
    expected = 1e3 * expected.transpose(1, 0, 2)
    np.testing.assert_allclose(y, expected, atol=0.5001 * data["unit"])
    assert data["unit"] < 3e-3  # mm; the farthest lamina is 90 mm away
    assert data["thickness"] == [2.0, 1.0, 1.5] and data["names"] == ["thick", "thin", "top"]
    np.testing.assert_allclose(data["x"], 1e3 * history["x"].to_numpy())
    np.testing.assert_allclose(data["time"], history["frame"].to_numpy(), rtol=1e-6)
    assert data["period"] == case.period


def test_pairs_are_lit_when_they_were_hit_since_the_frame_before_or_rest() -> None:
    case = small_case()
    history = synthetic_history(case)
    data = film(history, case).data
    lit = numbers(data["lit"], "u1", FRAMES * WINDOW, 1, NODES)[:, 0]
    half = FRAMES // 2 - 1
    assert lit[half].tolist() == [0, 0, 0, 0, 0, 1]  # hit at half of the period, at the frame
    assert lit[half + 1].tolist() == [0, 0, 0, 0, 1, 0]  # hit just after it
    assert lit[FRAMES].tolist() == [0, 1, 1, 1, 0, 0]  # in contact at the frame
    assert lit[1].tolist() == [0, 2, 2, 0, 0, 0]


def test_supports_hold_the_ends() -> None:
    recorded = three_laminae()
    history, case = recorded.history(), recorded.case
    assert film(history, case).data["held"] == [True, False]
    turned = case.model_copy(update={"support": Support(start="free", end="pinned")})
    assert film(history, turned).data["held"] == [False, True]


def drawn_gaps(data: dict[str, Any]) -> np.ndarray:
    """Return the gaps that a film shows [mm]."""
    y = data["unit"] * numbers(data["y"], "<i2", -1, 3, NODES)
    thickness = np.array(data["thickness"])
    return y[:, 1:] - y[:, :-1] - ((thickness[1:] + thickness[:-1]) / 2.0)[:, None]


def test_small_deflections_are_drawn_larger() -> None:
    recorded = three_laminae()
    history, case = recorded.history(), recorded.case
    assert "times as large" not in film(history, case).caption
    gaps = drawn_gaps(film(history, case).data)
    history["displacement"] = 1e-6 * history["displacement"]
    assert "times as large" not in film(history, case).caption  # the gap says how large they are
    history["gap0"] = 1e-6 * history["gap0"]
    data = film(history, case).data
    assert data["factor"] > 1e4
    np.testing.assert_allclose(  # so laminae touch where they do
        drawn_gaps(data), 1e-6 * data["factor"] * gaps, atol=4.0 * data["unit"]
    )
    assert f"are drawn {data['factor']:g} times as large" in film(history, case).caption


def test_long_and_fine_motions_are_thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    recorded = three_laminae()
    history, case = recorded.history(), recorded.case
    monkeypatch.setattr(films, "MOST_NODES", 3)
    monkeypatch.setattr(films, "MOST_NUMBERS", 3 * 3 * 25)
    data = film(history, case).data
    assert len(data["time"]) == 25
    np.testing.assert_allclose(data["time"], history["frame"].to_numpy()[-25:], rtol=1e-6)
    x = 1e3 * history["x"].to_numpy()
    np.testing.assert_allclose(data["x"], x[[0, 2, 5]])
    lit = numbers(data["lit"], "u1", 25, 2, 3)
    full = contact_lights(history)[-25:]
    # nodes 0 and 1 are shown by the first, 2 and 3 by the second, 4 and 5 by the last one
    for column, nodes in enumerate(([0, 1], [2, 3], [4, 5])):
        np.testing.assert_array_equal(lit[..., column], full[..., nodes].max(axis=-1))
    assert full[..., NODE].any()


def test_a_motion_that_is_never_finite_has_no_film() -> None:
    case = small_case()
    history = synthetic_history(case)
    assert film(history.isel(frame=slice(0, 0)), case) is None
    history["velocity"][0, :, 2] = np.inf
    assert film(history, case) is None
    history = synthetic_history(case)
    history["velocity"][0, -5:, 2] = np.nan
    assert len(film(history, case).data["time"]) == FRAMES * WINDOW - 5
    assert history["frame"].to_numpy()[-6] < PERIODS * case.period


def test_a_motion_at_rest_is_a_film_too() -> None:
    case = small_case()
    history = synthetic_history(case)
    for name in ("displacement", "gap0"):
        history[name][:] = 0.0
    data = film(history, case).data
    assert data["unit"] > 0.0
