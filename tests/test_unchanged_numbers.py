"""The comparison of two states of the package sees a single bit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from unchanged_numbers import CASES, compare, store, translated

from delam_fem.api import LAWS


def recorded(folder: Path, **changed: object) -> Path:
    """Write a small record, with some of its numbers changed."""
    folder.mkdir()
    values = changed.get("values", np.array([0.1, np.nan, 3.0]))
    data = xr.Dataset({"tip": (changed.get("dims", "time"), values)})
    store(folder / "case", data, {"steps": changed.get("steps", 7), "outcome": "completed"})
    level = {"statistics": {"y1": changed.get("y1", [0.5, 0.25])}}
    (folder / "refinement").mkdir()
    (folder / "refinement" / "convergence.json").write_text(json.dumps({"rungs": [level]}))
    return folder


def test_equal_records_have_no_difference(tmp_path: Path) -> None:
    assert compare(recorded(tmp_path / "a"), recorded(tmp_path / "b")) == []


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"values": np.nextafter([0.1, np.nan, 3.0], 4.0)}, "tip: differs by up to"),
        ({"values": np.array([0.1, 2.0, 3.0])}, "tip: differs"),
        ({"values": np.array([0.1, np.nan])}, "(3,) became"),
        ({"dims": "period"}, "('time',) (3,) became ('period',)"),
        ({"steps": 8}, "steps: 7 became 8"),
        ({"y1": [0.5, 0.2500001]}, "y1"),
    ],
)
def test_every_change_is_told(changed: dict[str, object], text: str, tmp_path: Path) -> None:
    (line,) = compare(recorded(tmp_path / "a"), recorded(tmp_path / "b", **changed))
    assert text in line


def test_a_tolerance_allows_another_order_of_operations(tmp_path: Path) -> None:
    a = recorded(tmp_path / "a")
    b = recorded(tmp_path / "b", values=np.nextafter([0.1, np.nan, 3.0], 4.0))
    assert compare(a, b, tolerance=1e-12) == []


def test_nothing_recorded_is_no_agreement(tmp_path: Path) -> None:
    assert compare(tmp_path, tmp_path) == [f"{tmp_path}: no recorded numbers"]


def test_all_laws_and_both_engines_are_among_the_cases() -> None:
    laws = {keys.get("contact.law") for _, _, keys in CASES.values()}
    assert set(LAWS) - laws == {"newton-penalty"}  # that of a preset
    assert {engine for _, engine, _ in CASES.values()} == {"petsc", "compiled"}
    assert {keys.get("time.mass") for _, _, keys in CASES.values()} == {None, "lumped"}


def test_older_packages_are_asked_in_their_words() -> None:
    keys = {"contact.law": "newton", "time.scheme": "moreau-jean", "mesh.elements": 5}
    assert translated(keys) == {"contact.law": "moreau", "mesh.elements": 5}
