"""Files of loggers and lists of series: TDMS, HDF5, WAV, SEP 005, written by their libraries."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import wavfile

import delam_fem as df
from delam_fem import CaseError
from delam_fem.studies.signals.reading import as_sep005, record

RATE, N = 2000.0, 400
TIME = np.arange(N) / RATE
THICK = np.sin(40.0 * TIME)
THIN = np.cos(70.0 * TIME)


def test_a_tdms_file_has_the_channels_of_its_groups(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    file = tmp_path / "run.tdms"
    steps = {"wf_increment": 1.0 / RATE, "wf_start_offset": 0.0}
    channels = [
        nptdms.ChannelObject("Laser", name, 1e3 * values, steps | {"unit_string": "mm"})
        for name, values in (("tip thick", THICK), ("tip thin", THIN))
    ]
    with nptdms.TdmsWriter(str(file)) as writer:
        writer.write_segment([nptdms.RootObject({}), nptdms.GroupObject("Laser"), *channels])
    data = df.read_measured(file)
    np.testing.assert_allclose(data["tip_displacement"], [THICK, THIN], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(np.diff(data["time"]), 1.0 / RATE, rtol=1e-9)


def test_a_tdms_file_may_have_a_channel_of_times(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    file = tmp_path / "times.tdms"
    channels = [
        nptdms.ChannelObject("a", "time", TIME, {"unit_string": "s"}),
        nptdms.ChannelObject("a", "acc", THICK, {"unit_string": "g"}),
    ]
    with nptdms.TdmsWriter(str(file)) as writer:
        writer.write_segment(channels)
    data = df.read_measured(file)
    np.testing.assert_allclose(data["sensor_acc"], 9.80665 * THICK, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("unit", ["°C", "degC", "[°C]", "deg C", "°F", "K", "℃", "%RH"])
def test_temperature_and_humidity_are_left_out_with_a_note(unit: str, tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    rows = "".join(f"{t},{a},{20.0 + t}\n" for t, a in zip(TIME, THICK, strict=True))
    file.write_text(f"time,acc,room\ns,g,{unit}\n{rows}", encoding="utf-8")
    data = df.read_measured(file)
    np.testing.assert_allclose(data["sensor_acc"], 9.80665 * THICK, rtol=1e-12, atol=1e-14)
    assert "sensor_room" not in data
    (note,) = [text for text in data.attrs["notes"].splitlines() if "room" in text]
    what = "a humidity" if unit == "%RH" else "a temperature"
    assert what in note and str(file) in note
    with pytest.raises(CaseError, match=f"column 'room'.*{what}"):
        df.read_measured(file, channels={"room": "room"})
    data = df.read_measured(file, channels={"room": "room:V"})  # a thermometer that says volts
    np.testing.assert_allclose(data["sensor_room"], 20.0 + TIME, rtol=1e-12)


def test_temperatures_alone_are_refused(tmp_path: Path) -> None:
    file, other = tmp_path / "room.csv", tmp_path / "acc.csv"
    file.write_text("time [s],room [°C]\n0,20\n1,21\n2,22\n", encoding="utf-8")
    with pytest.raises(CaseError, match=r"room\.csv: expected a channel, found temperatures"):
        df.read_measured(file)
    other.write_text("time [s],acc [g]\n0,1\n1,2\n2,3\n", encoding="utf-8")
    assert "sensor_acc" in df.read_measured(file, other)


@pytest.mark.parametrize("form", ["attribute", "dataset", "fields"])
def test_an_hdf5_file_of_a_logger_is_read(tmp_path: Path, form: str) -> None:
    file = tmp_path / "log.h5"
    with h5py.File(file, "w") as hdf:
        group = hdf.create_group("daq/run 1")
        if form == "fields":
            table = np.zeros(N, dtype=[("time", "f8"), ("mid", "f8")])
            table["time"], table["mid"] = TIME, THICK
            group["table"] = table
        else:
            group["mid"] = 1e3 * THICK
            group["mid"].attrs["units"] = "mm/s"
        if form == "attribute":
            group.attrs["fs"] = RATE
        elif form == "dataset":
            group["time"] = TIME
    units = "m/s" if form == "fields" else None
    data = df.read_measured(file, units=units)
    np.testing.assert_allclose(data["sensor_mid"], THICK, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(data["time"], TIME, atol=1e-12)


@pytest.mark.parametrize(("kind", "scale"), [("i2", 2**15), ("i4", 2**31), ("f4", 1.0)])
def test_a_sound_file_is_in_shares_of_its_full_scale(tmp_path: Path, kind: str, scale: int) -> None:
    file = tmp_path / "run.wav"
    values = np.column_stack([0.5 * THICK, 0.25 * THIN])
    wavfile.write(file, int(RATE), (values * scale).astype(kind))
    sources = {"mid": "channel 1:m/s", "end": "channel 2:m/s"}
    data = df.read_measured(file, channels=sources)
    np.testing.assert_allclose(data["sensor_mid"], 0.5 * THICK, atol=1.5 / 2**15)
    np.testing.assert_allclose(data["sensor_end"], 0.25 * THIN, atol=1.5 / 2**15)
    with pytest.raises(CaseError, match="unit"):
        df.read_measured(file)


def test_series_after_sep_005_go_out_and_come_in() -> None:
    """A record of a run is the same after it has been such a list; uneven times are kept."""
    result = df.run(df.preset("paper", {"time.periods": 2, "time.steps_per_period": 100}))
    channels = result.record
    series = as_sep005(channels)
    assert {"name", "data", "unit_str", "fs"} <= set(series[0])
    tips = [entry for entry in series if entry["name"] in ("tip_thick", "tip_thin")]
    back = record(df.read_measured(tips))
    for entry in tips:
        np.testing.assert_allclose(back[entry["name"]], channels[entry["name"]], rtol=1e-12)
    uneven = [{"name": "mid", "data": THICK, "unit_str": "mm", "time": TIME**1.1}]
    data = df.read_measured(uneven)
    np.testing.assert_allclose(data["sensor_mid"], 1e-3 * THICK, rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(data["time"], TIME**1.1, rtol=1e-12)


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ({"name": "a", "data": THICK}, "series 1: expected unit_str"),
        ({"name": "a", "data": THICK, "unit_str": "m"}, "expected fs or time"),
        ({"name": "a", "data": THICK, "unit_str": "m", "time": TIME[1:]}, "times as long"),
    ],
)
def test_series_that_lack_something_are_told(entry: dict[str, object], expected: str) -> None:
    with pytest.raises(CaseError, match=expected):
        df.read_measured([entry])


@pytest.mark.parametrize("suffix", [".tdms", ".h5", ".wav"])
def test_a_damaged_file_is_told(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"bad{suffix}"
    file.write_bytes(b"no such thing" * 20)
    with pytest.raises(CaseError, match=r"damaged|npTDMS"):
        df.read_measured(file)


@pytest.mark.parametrize(
    ("series", "expected"),
    [([], "at least one series, given an empty list"), (["a.csv"], "a dictionary, given 'a.csv'")],
)
def test_lists_of_something_else_are_told(series: list[object], expected: str) -> None:
    with pytest.raises(CaseError, match=expected):
        df.read_measured(series)  # type: ignore[arg-type]
