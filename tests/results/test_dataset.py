"""The dataset of a run has the variables of the schema and no others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import stack
import xarray as xr
from stack import three_laminae
from synthetic import WINDOW

import delam_fem as df
from delam_fem.results.dataset import grouped
from delam_fem.results.schema import DIMENSIONS, FORCE_PLACE, INTERFACE, SCAN_POINT, VARIABLES

NAMES = ("lamina", "interface", "probe", "contact", "impactor")
"""Coordinates that hold names."""
OF_A_FORCE = ("force", *(name for name, row in VARIABLES.items() if FORCE_PLACE in row.dims))
"""Variables of runs that forces drive."""
OF_STOPS = (
    "event_stop", "contact_force",
    *(name for name in VARIABLES if name.startswith(("stop_", "impactor_"))),
)  # fmt: skip
"""Variables of runs with stops."""
OF_OTHERS = (
    "event_pair", "dof_displacement", "dof_velocity", "end",
    *(name for name, row in VARIABLES.items() if SCAN_POINT in row.dims),
)  # fmt: skip
"""Variables of runs without a case, of laminae of unequal lengths, and of scans of plates."""


@pytest.fixture(scope="module")
def run() -> xr.Dataset:
    """Return the history of a short run of two laminae."""
    keys = {"time.periods": 2, "output.window_periods": 1, "output.fields_per_period": 4}
    return df.run(df.preset("paper", keys), "compiled").history


def described(history: xr.Dataset) -> list[tuple[object, ...]]:
    """Return name, dimensions, unit and meaning of each variable in the order of the dataset."""
    return [
        (name, values.dims, values.attrs["units"], values.attrs["long_name"])
        for name, values in history.variables.items()
        if name not in NAMES
    ]


def test_two_laminae_have_all_variables_without_the_dimension_of_interfaces(
    run: xr.Dataset,
) -> None:
    assert described(run) == [
        (row.name, tuple(d for d in row.dims if d != INTERFACE), row.units, row.long_name)
        for row in VARIABLES.values()
        if row.name not in ("event_interface", *OF_A_FORCE, *OF_STOPS, *OF_OTHERS)
        and not row.name.startswith("probe_")
    ]
    assert set(run.dims) == DIMENSIONS.keys() - {
        INTERFACE,
        "probe",
        "stop",
        "impactor",
        "contact",
        "dof",
        SCAN_POINT,
        FORCE_PLACE,
    }
    assert "interface" not in run.variables


def test_a_run_under_a_force_has_the_force() -> None:
    keys = {"excitation.kind": "force", "excitation.lamina": "thin", "excitation.position": 0.5}
    few = {"time.periods": 1, "output.window_periods": 1, "output.fields_per_period": 0}
    case = df.preset(
        "paper", {**keys, **few, "excitation.amplitude": 0.01, "excitation.frequency": 3.0}
    )
    history = df.run(case, "compiled").history
    expected = 0.01 * np.sin(2.0 * np.pi * case.excitation.frequency * history["time"].values)
    np.testing.assert_allclose(history["force"], expected, atol=1e-9)
    assert not history["base_displacement"].values.any()


def test_three_laminae_have_all_variables() -> None:
    history = three_laminae().history()
    assert described(history) == [
        (row.name, row.dims, row.units, row.long_name)
        for row in VARIABLES.values()
        if row.name not in (*OF_A_FORCE, *OF_STOPS, *OF_OTHERS)
    ]
    absent = {"stop", "impactor", "contact", "dof", FORCE_PLACE, SCAN_POINT}
    assert set(history.dims) == DIMENSIONS.keys() - absent
    assert history["lamina"].values.tolist() == ["thick", "thin", "top"]
    assert history["interface"].values.tolist() == ["thick-thin", "thin-top"]


def test_only_reference_probes_are_shown_as_tips() -> None:
    history = three_laminae().history()
    assert int(history["tip_node"]) == stack.NODE
    for name in ("tip_displacement", "tip_velocity", "strobe_displacement", "envelope_max"):
        assert history[name].shape[0] == 3
        assert float(history[name].max()) < 77.0, name  # the value of the fourth probe


def test_further_probes_are_shown_by_their_names() -> None:
    history = three_laminae().history()
    assert history["probe"].values.tolist() == ["mid"]
    assert (history["probe_displacement"].values == 77.0).all()
    assert (history["probe_velocity"].values == 77.0).all()
    assert (int(history["probe_lamina"][0]), int(history["probe_node"][0])) == (1, 2)


def test_events_name_interface_and_node() -> None:
    history = three_laminae().history()
    assert history["event_interface"].values.tolist() == [0, 1, 1] * WINDOW
    assert history["event_node"].values.tolist() == [4, 4, 3] * WINDOW
    np.testing.assert_array_equal(history["event_impulse"], [1e-3, 3e-3, 1e-3] * WINDOW)
    np.testing.assert_allclose(history["event_energy"][:3], [-1e-5, -0.75e-5, -0.25e-5])


@pytest.mark.parametrize(
    ("preset", "keys"), [("paper", {}), ("embedded", {"delamination.1.opening": 1e-3})]
)
def test_beside_a_stop_within_an_element_the_gap_is_that_of_the_laminae(
    preset: str, keys: dict[str, object]
) -> None:
    """It was 0 at such a point, which is a pair of the stop and none of the laminae."""
    keys = keys | {
        "time.periods": 1, "output.window_periods": 1, "output.fields_per_period": 1,
        "contact.impulse": "consistent", "time.mass": "consistent",
    }  # fmt: skip
    case = df.preset(preset, keys)
    places = [share * case.length for share in (0.17, 0.365, 0.485)]
    stop = {"lamina": case.lamina[-1].name, "side": "above", "gap": 1.0, "on": "base"}
    stops = [stop | {"position": x} for x in places]
    history = df.run(df.Case(**case.model_dump() | {"stop": stops}), "compiled").history
    x, gaps = history["x"].to_numpy(), history["gap0"].to_numpy()
    added = np.isin(x, places)
    assert added.sum() == len(places)
    expected = np.interp(x[added], x[~added], gaps[~added])
    np.testing.assert_allclose(gaps[added], expected, atol=0.02 * gaps.max())
    assert expected.max() > 0.1 * gaps.max()


FEW = {
    "time.periods": 2, "time.steps_per_period": 60, "output.window_periods": 1, "mesh.elements": 5,
    "output.fields_per_period": 3, "excitation.amplitude": 0.02, "contact.impulse": "consistent",
}  # fmt: skip
STOPS = [
    {"lamina": "thin", "side": "both", "gap": 0.0015, "position": 0.274},
    {"lamina": "thick", "side": "below", "gap": 0.001, "start": 0.411, "end": 0.685,
     "opening": 0.002, "shape": "power", "on": "ground"},
]  # fmt: skip
SENSORS = [
    {"name": "a", "quantity": "acceleration", "lamina": "thin", "position": 0.3},
    {"name": "s", "quantity": "contact force", "stop": 2},
    {"name": "slow", "quantity": "strain", "lamina": "thick", "position": 0.1,
     "sampling_rate": 40.0},
]  # fmt: skip
RUNS: dict[str, dict[str, Any]] = {
    "stops": {**FEW, "stop": STOPS, "sensor": SENSORS, "impactor": [
        {"lamina": "thin", "mass": 0.02, "gap": 0.002, "velocity": 0.3, "position": 0.548},
        {"lamina": "thick", "mass": 0.03, "side": "below", "gap": 0.001, "spring": 40.0,
         "on": "base"}]},
    "penalty": {**FEW, "contact.law": "penalty", "contact.penalty_stiffness": 400.0,
                "contact.penalty_damping": 2.0, "contact.points_per_element": 2},
    "force": {**FEW, "excitation": {"kind": "force", "lamina": "thin", "position": 0.4,
                                    "amplitude": 0.3, "frequency": 2.0}},
}  # fmt: skip


ABSENT = {
    "stops": OF_A_FORCE,
    "penalty": (*OF_A_FORCE, *OF_STOPS, "event_interface"),
    "force": (*OF_STOPS, "event_interface"),
}
"""Variables that do not apply to a run."""


@pytest.mark.parametrize("name", RUNS)
def test_datasets_have_the_variables_that_apply(name: str) -> None:
    """With the dimensions and units of the schema, which docs/results.md shows."""
    history = df.run(df.preset("paper", RUNS[name]), "compiled").history
    sensors = {row[:3] for row in described(history) if str(row[0]).startswith("sensor_")}
    assert len(sensors) == (4 if name == "stops" else 0)  # one has times of its own
    assert {row[:3] for row in described(history)} - sensors == {
        (row.name, tuple(d for d in row.dims if d != INTERFACE), row.units)
        for row in VARIABLES.values()
        if row.name not in (*ABSENT[name], *OF_OTHERS)
        and FORCE_PLACE not in row.dims
        and not row.name.startswith("probe_")
    }


def test_every_variable_stands_in_one_group() -> None:
    history = df.run(df.preset("paper", RUNS["stops"]), "compiled").history
    names = [str(name) for group in grouped(history).values() for name in group.data_vars]
    assert sorted(names) == sorted(map(str, history.data_vars))
