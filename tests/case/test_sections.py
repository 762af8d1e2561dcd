"""Every key of a case: its bounds, its default and its meaning; and numbers that follow."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from delam_fem.api import Lamina, Sensor, preset
from delam_fem.case.keys import case_schema
from delam_fem.case.materials import MATERIALS
from delam_fem.case.sections import (
    SENSOR_UNITS,
    Delamination,
    Impactor,
    Model,
    PointSupport,
    Stop,
    Support,
    open_ends,
)


def without_words(schema: Any) -> Any:
    """Return a schema without what its keys mean."""
    if isinstance(schema, list):
        return [without_words(entry) for entry in schema]
    if not isinstance(schema, dict):
        return schema
    words = isinstance(schema.get("description"), str)
    return {
        k: without_words(entry) for k, entry in schema.items() if not (words and k[:5] == "descr")
    }


def test_bounds_and_defaults_of_all_keys_are_the_stored_ones(stored: Callable[..., None]) -> None:
    stored(json.dumps(without_words(case_schema()), indent=1, ensure_ascii=False))


def lamina(**given: Any) -> Lamina:
    values = {"name": "a", "length": 0.5, "width": 0.03, "thickness": 0.002, "damping_ratio": 0.01}
    return Lamina(**values | given)


LAMINAE: dict[str, dict[str, Any]] = {
    "numbers": {"density": 1500.0, "young_modulus": 20e9},
    "a stiffness": {"density": 1500.0, "bending_stiffness": 0.7},
    "both": {"density": 1500.0, "young_modulus": 20e9, "bending_stiffness": 0.7},
    "a mass": {"mass_per_length": "200 g/m", "young_modulus": "20 GPa"},
    "units": {"mass_per_length": 0.2, "bending_stiffness": "0.7 N m2", "width": "3 cm"},
    "axial": {"density": 1500.0, "young_modulus": 20e9, "motion": "axial"},
    "a point": {"mass": 0.3, "stiffness": 120.0},
    **{name: {"material": name} for name in MATERIALS},
    "a material with a mass": {"material": "steel", "mass_per_length": 0.4},
    "a material with a stiffness": {"material": "steel", "bending_stiffness": 3.0},
}


def test_frequencies_are_those_of_cantilevers_bars_and_points() -> None:
    beam = lamina(**LAMINAE["both"])
    speed = np.sqrt(0.7 / (1500.0 * 0.03 * 0.002))
    wanted = np.array([1.8751040687, 4.6940911330, 7.8547574382]) ** 2 / 0.25 * speed
    np.testing.assert_allclose(beam.angular_frequencies(3), wanted, rtol=1e-9)
    bar = lamina(**LAMINAE["axial"])
    wanted = np.pi * np.array([0.5, 1.5]) / 0.5 * np.sqrt(20e9 / 1500.0)
    np.testing.assert_allclose(bar.angular_frequencies(2), wanted, rtol=1e-12)
    assert lamina(mass=0.3, stiffness=120.0).angular_frequencies(2).tolist() == [20.0, 20.0]


@pytest.mark.parametrize("end", [0.0, 0.4])
def test_an_edge_is_at_an_end_within_its_tolerance(end: float) -> None:
    for share, is_there in ((0.9, True), (1.1, False)):
        shift = share * 1e-9 * 0.4
        start, stop = (shift, 0.4) if end == 0.0 else (0.0, 0.4 - shift)
        delamination = Delamination(between=("a", "b"), start=start, end=stop)
        assert delamination.reaches(end, 0.4) == is_there
        assert delamination.reaches(0.4 - end, 0.4)
        assert delamination.spans(0.4) == is_there
        for support, ends in (
            (Support(start="free", end="free"), {0.0: "start", 0.4: "end"}),
            (Support(start="pinned"), {0.4: "end"}), (Support(start="free", end="pinned"),
            {0.0: "start"}), (Support(end="clamped"), {}),
        ):  # fmt: skip
            open_names = tuple(name for x, name in ends.items() if x != end or is_there)
            assert open_ends(delamination, 0.4, support) == open_names


def test_words_of_sensors() -> None:
    told = []
    for quantity, unit in SENSOR_UNITS.items():
        if quantity != "contact force":
            sensor = Sensor(name="s", quantity=quantity, lamina="a", position=0.125)  # type: ignore[arg-type]
            told.append(sensor.words)
            assert sensor.unit == unit
    told.append(
        Sensor(name="s", quantity="strain", lamina="a", position=0.1, surface="bottom").words
    )
    for about in ({"between": ("a", "b")}, {"stop": 3}, {"impactor": 2}):
        told.append(Sensor(name="s", quantity="contact force", **about).words)  # type: ignore[arg-type]
    assert told == [
        "displacement of a at 0.125 m", "velocity of a at 0.125 m", "acceleration of a at 0.125 m",
        "strain at the top of a at 0.125 m", "strain at the bottom of a at 0.1 m",
        "contact force between a and b", "contact force of stop 3", "contact force of impactor 2",
    ]  # fmt: skip


def test_reaches_and_elastic_keys() -> None:
    stop = Stop(lamina="a", side="both", gap=0.0)
    assert stop.reach(0.7) == (0.7, 0.7) and stop.elastic_by is None
    assert Stop(lamina="a", side="both", gap=0.0, position=0.0).reach(0.7) == (0.0, 0.0)
    stretch = Stop(lamina="a", side="both", gap=0.0, start=0.0, end=0.2, stiffness=3.0)
    assert stretch.reach(0.7) == (0.0, 0.2) and stretch.elastic_by == "stiffness"
    blow = {"lamina": "a", "mass": 1.0, "velocity": 1.0}
    assert [Impactor(**blow | keys).elastic_by for keys in (  # type: ignore[arg-type]
        {}, {"stiffness": 1.0}, {"radius": 1.0})] == [None, "stiffness", "radius"]  # fmt: skip
    pin, spring = (
        PointSupport(position=0.1, kind="pinned"),
        PointSupport(position=0.2, kind="spring", stiffness=1.0),
    )
    support = Support.model_validate([{"start": "free"}, pin.model_dump(), spring.model_dump()])
    assert support.held == (pin,)


@pytest.mark.parametrize(
    ("kind", "is_continuum"),
    [("beam", False), ("plane-stress", True), ("solid", True), ("modes", False)],
)
def test_solids_are_computed_in_two_or_three_dimensions(kind: Any, is_continuum: bool) -> None:
    assert Model(kind=kind).is_continuum == is_continuum


def test_supports_are_written_as_they_are_read() -> None:
    tables_ = [{"start": "free"}, {"position": 0.1, "kind": "pinned"}]
    case = preset("embedded", {"support": tables_})
    written = case.model_dump(exclude_unset=True)["support"]
    assert written == tables_
    alone = preset("embedded", {"support": tables_[1:]})
    assert alone.model_dump(exclude_unset=True)["support"] == tables_[1:]
