"""Groups of the dataset have tables, and hold every variable once."""

from pathlib import Path

import numpy as np
import xarray as xr
from stack import three_laminae
from synthetic import FRAMES, NODES, STEPS, WINDOW, small_case, synthetic_history

from delam_fem.api import Result
from delam_fem.results.dataset import grouped


def test_every_variable_is_in_one_group() -> None:
    history = three_laminae().history()
    groups = grouped(history)
    names = sorted(str(name) for group in groups.values() for name in group.data_vars)
    assert names == sorted(map(str, history.data_vars))
    assert "event_impulse" in groups["events"] and "gap0" in groups["shape"]
    assert groups["fields"].attrs == history.attrs


def test_groups_have_tables() -> None:
    groups = grouped(synthetic_history(small_case()))
    table = groups["history"].to_dataframe()
    assert len(table) == 2 * STEPS * WINDOW
    assert table["tip_displacement"].xs("thin", level="lamina").size == STEPS * WINDOW
    fields = groups["fields"].to_dataframe()
    assert len(fields) == 2 * FRAMES * WINDOW * NODES
    assert {"displacement", "moment", "contact_state", "x"} <= set(fields.columns)
    events = groups["events"].to_dataframe()
    assert len(events) == 2 * WINDOW and "event_time" in events
    assert "energy_kinetic" in groups["periods"].to_dataframe()


def test_groups_keep_the_values() -> None:
    history = synthetic_history(small_case())
    group = grouped(history)["fields"]
    np.testing.assert_array_equal(group["displacement"], history["displacement"])
    assert "time" not in group.coords and "frame" in group.coords


def test_groups_are_read_from_one_file(tmp_path: Path) -> None:
    case = small_case()
    result = Result(case, synthetic_history(case), {}, None)
    path = result.save_groups(tmp_path / "grouped.nc")
    for name, group in result.groups.items():
        with xr.open_dataset(path, group=name, engine="h5netcdf") as dataset:
            assert list(dataset.data_vars) == list(group.data_vars)
            for variable in group.data_vars:
                np.testing.assert_array_equal(dataset[variable], group[variable])
    with xr.open_dataset(path, group="events", engine="h5netcdf") as events:
        assert len(events.to_dataframe()) == events.sizes["event"]
        assert events["event_impulse"].attrs["units"] == "N s"
