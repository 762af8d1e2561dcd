"""Files as instruments and people write them: each is read with its SI values, or refused.

The values are known by construction: the same signal is written in another unit, format or form.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import pyuff
import xarray as xr
from scipy.io import savemat

from delam_fem import read_measured
from delam_fem.api import CaseError
from delam_fem.studies.signals.reading import lines

N, RATE = 40, 200.0
TIME = np.arange(N) / RATE
SIGNAL = 2.0 + np.sin(40.0 * TIME) + 0.3 * np.cos(3.0 * np.arange(N))
OTHER = -1.0 + np.cos(25.0 * TIME)
DIGITS = 2e-5
"""Tolerance of times and values relative to the largest: universal files have six digits."""


def close(found: object, wanted: np.ndarray) -> bool:
    """Return whether values are the wanted ones, up to the digits of the formats."""
    return np.allclose(np.asarray(found), wanted, rtol=0.0, atol=DIGITS * np.abs(wanted).max())


# ---- one signal beside one axis, in each format


def as_csv(path: Path, axis: tuple[str, str, np.ndarray], unit: str) -> Path:
    name, axis_unit, points = axis
    rows = [f"{p!r},{v!r}" for p, v in zip(points.tolist(), SIGNAL.tolist(), strict=True)]
    text = "\n".join([f"{name} [{axis_unit}],a [{unit}]", *rows])
    return written(path.with_suffix(".csv"), text)


def written(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_text(text, encoding=encoding)
    return path


def as_universal(path: Path, axis: tuple[str, str, np.ndarray], unit: str, binary: int = 0) -> Path:
    name, axis_unit, points = axis
    dataset = {
        "type": 58, "binary": binary, "func_type": 1 if name == "time" else 4, "id1": "a",
        "rsp_node": 1, "rsp_dir": 3, "ref_node": 2, "ref_dir": 3, "data": SIGNAL, "x": points,
        "abscissa_spacing": 1, "abscissa_spec_data_type": 17 if name == "time" else 18,
        "abscissa_inc": points[1] - points[0], "abscissa_min": points[0],
        "abscissa_axis_units_lab": axis_unit, "ordinate_spec_data_type": 0,
        "ordinate_axis_units_lab": unit, "orddenom_spec_data_type": 0,
    }  # fmt: skip
    return universal(path.with_suffix(".uff"), dataset)


def universal(path: Path, *sets: dict[str, Any]) -> Path:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for dataset in sets:
            pyuff.UFF(str(path)).write_sets([dataset], "add")
    return path


def as_binary(path: Path, axis: tuple[str, str, np.ndarray], unit: str) -> Path:
    return as_universal(path, axis, unit, binary=1)


def as_matlab_5(path: Path, axis: tuple[str, str, np.ndarray], unit: str) -> Path:
    name, axis_unit, points = axis
    content = {name: points, "a": SIGNAL, "units": {name: axis_unit, "a": unit}}
    savemat(path.with_suffix(".mat"), content)
    return path.with_suffix(".mat")


def as_matlab_7(path: Path, axis: tuple[str, str, np.ndarray], unit: str) -> Path:
    name, axis_unit, points = axis
    path = path.with_suffix(".mat")
    with h5py.File(path, "w", userblock_size=512) as file:
        for key, values in ((name, points), ("a", SIGNAL)):
            file.create_dataset(key, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_(
                "double"
            )
        for key, text in ((name, axis_unit), ("a", unit)):
            codes = np.array([[ord(c)] for c in text], np.uint16)
            node = file.create_dataset(f"units/{key}", data=codes)
            node.attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


def as_netcdf(path: Path, axis: tuple[str, str, np.ndarray], unit: str) -> Path:
    name, axis_unit, points = axis
    data = xr.Dataset(
        {"a": (name, SIGNAL, {"units": unit})}, {name: (name, points, {"units": axis_unit})}
    )
    data.to_netcdf(path.with_suffix(".nc"), engine="h5netcdf")
    return path.with_suffix(".nc")


FORMATS: dict[str, Callable[..., Path]] = {
    "csv": as_csv, "universal": as_universal, "binary": as_binary, "matlab 5": as_matlab_5,
    "matlab 7.3": as_matlab_7, "netcdf": as_netcdf,
}  # fmt: skip
READ = {"mg": 9.80665e-3, "Gs": 9.80665, "g pk": 9.80665, "mils": 25.4e-6, "m/s²": 1.0,
        "µm": 1e-6, "ips": 0.0254}  # fmt: skip
REFUSED = {
    "V/V": "no strain", "counts": "sensitivity", "?m": "not understood", "mm$": "not understood",
    "EU": "engineering", "a.u.": "arbitrary", "MM": "mm would be", "kg": "no channel",
    "g rms": "no amplitude",
}  # fmt: skip


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("unit", READ)
def test_units_that_instruments_write(tmp_path: Path, form: str, unit: str) -> None:
    data = read_measured(FORMATS[form](tmp_path / "m", ("time", "s", TIME), unit))
    assert close(data["sensor_a"], READ[unit] * SIGNAL) and close(data["time"], TIME)


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("unit", REFUSED)
def test_units_that_are_none(tmp_path: Path, form: str, unit: str) -> None:
    path = FORMATS[form](tmp_path / "m", ("time", "s", TIME), unit)
    with pytest.raises(CaseError) as error:
        read_measured(path)
    told = str(error.value)
    assert str(path) in told and "'a'" in told and repr(unit) in told and REFUSED[unit] in told


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(
    ("name", "unit", "factor"),
    [("time", "ms", 1e-3), ("time", "min", 60.0), ("frequency", "kHz", 1e3),
     ("frequency", "rad/s", 0.5 / np.pi), ("frequency", "cpm", 1.0 / 60.0)],
)  # fmt: skip
def test_units_of_axes_count(
    tmp_path: Path, form: str, name: str, unit: str, factor: float
) -> None:
    points = 10.0 + np.arange(N)
    data = read_measured(FORMATS[form](tmp_path / "m", (name, unit, points), "mm"))
    assert close(data[name], factor * points)


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(
    ("name", "unit"), [("time", "mm"), ("time", "Hz"), ("time", "g"), ("frequency", "s")]
)
def test_an_axis_of_another_quantity_is_refused(
    tmp_path: Path, form: str, name: str, unit: str
) -> None:
    path = FORMATS[form](tmp_path / "m", (name, unit, 10.0 + np.arange(N)), "mm")
    with pytest.raises(CaseError, match=f"expected the {name} in a unit"):
        read_measured(path)


# ---- tables


def rows(*columns: object, separator: str = ",", end: str = "") -> str:
    """Return columns of numbers or texts as rows."""
    cells = [[c if isinstance(c, str) else repr(float(c)) for c in column] for column in columns]  # type: ignore[attr-defined]
    return "\n".join(separator.join(row) + end for row in zip(*cells, strict=True))


CLOCK = [
    f"23:59:59.{900 + 5 * k:03d}" if k < 20 else f"00:00:00.{5 * k - 100:03d}" for k in range(N)
]
"""A clock that passes midnight after 20 of the steps of 5 ms."""
NEXT = ["2024-02-29" if k < 20 else "2024-03-01" for k in range(N)]
QUOTED = [f'"{v:.8f}"' for v in SIGNAL]
COMMAS = [f'"{v:.8f}"'.replace(".", ",") for v in SIGNAL]
TABLES = {
    "separator at the end": rows(TIME, SIGNAL, end=",") + "\n",
    "separator at the end, also of the heading": "t [s],a [mm],\n" + rows(TIME, SIGNAL, end=","),
    "semicolon at the end": "t [s];a [mm];\n" + rows(TIME, SIGNAL, separator=";", end=";"),
    "quoted numbers": "t [s],a [mm]\n" + rows(TIME, QUOTED),
    "quoted numbers with decimal commas": "t [s],a [mm]\n" + rows(TIME, COMMAS),
    "all quoted": '"t [s]","a [mm]"\n' + rows([f'"{t}"' for t in TIME], QUOTED),
    "number in the header": "Rate,200\n17\n3 channels of 5\nt [s],a [mm]\n" + rows(TIME, SIGNAL),
    "row of numbers in the header": "200,2\nt [s],a [mm]\n" + rows(TIME, SIGNAL),
    "a number sign in a comment": "# t and a\nt [s],a [mm]\n" + rows(TIME, SIGNAL),
    "clock": "Clock,a [mm]\n" + rows(CLOCK, SIGNAL),
    "date and clock": "Date;Clock;a [mm]\n" + rows(NEXT, CLOCK, SIGNAL, separator=";"),
    "date and clock in one": "When,a [mm]\n"
    + rows([f"{d} {c}" for d, c in zip(NEXT, CLOCK, strict=True)], SIGNAL),
    "date and clock with T": "When,a [mm]\n"
    + rows([f"{d}T{c}Z" for d, c in zip(NEXT, CLOCK, strict=True)], SIGNAL),
    "German date and commas": "Datum;Uhr;a [mm]\n"
    + rows([f"{d[8:]}.{d[5:7]}.{d[:4]}" for d in NEXT], CLOCK, SIGNAL, separator=";").replace(
        ".", ",").replace(",02,2024", ".02.2024").replace(",03,2024", ".03.2024"),
    "index beside a time": "sample,t [s],a [mm]\n" + rows(np.arange(N), TIME, SIGNAL),
    "tabs": "t [s]\ta [mm]\n" + rows(TIME, SIGNAL, separator="\t"),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_forms_of_tables(tmp_path: Path, name: str) -> None:
    path = written(tmp_path / "m.csv", TABLES[name])
    options: dict[str, Any] = {} if "[mm]" in TABLES[name] else {"channels": {"a": "col2:mm"}}
    data = read_measured(path, **options)
    assert close(data["sensor_a"], 1e-3 * SIGNAL) and close(data["time"], TIME)
    assert data["channel"].to_numpy().tolist() == ["a"]


def test_a_comma_in_the_quotes_of_a_heading_and_a_number_sign(tmp_path: Path) -> None:
    text = '"t [s]","Acc, top #1 [g]","Acc, tip #2 [mm]"\n' + rows(TIME, OTHER, SIGNAL)
    data = read_measured(written(tmp_path / "m.csv", text))
    assert data["channel"].to_numpy().tolist() == ["Acc, top #1", "Acc, tip #2"]
    assert close(data["sensor_Acc_top_1"], 9.80665 * OTHER)


@pytest.mark.parametrize("encoding", ["cp1252", "latin-1", "utf-8-sig", "utf-16"])
def test_tables_in_any_encoding(tmp_path: Path, encoding: str) -> None:
    text = "Zeit [s],Träger [m/s²],d [µm]\n" + rows(TIME, SIGNAL, OTHER)
    path = written(tmp_path / "m.csv", text, encoding)
    data = read_measured(path)
    assert close(data["sensor_Träger"], SIGNAL) and close(data["sensor_d"], 1e-6 * OTHER)
    assert ("1252" in data.attrs["notes"]) == (encoding in ("cp1252", "latin-1"))


@pytest.mark.parametrize("binary", [0, 1])
def test_universal_files_in_latin_1(tmp_path: Path, binary: int) -> None:
    path = as_universal(tmp_path / "m", ("time", "s", TIME), "m/s2", binary)
    content = path.read_bytes()
    assert content.count(b"m/s2") == 1
    path.write_bytes(content.replace(b"m/s2", b"m/s\xb2"))
    assert close(read_measured(path)["sensor_a"], SIGNAL)
    path.write_bytes(content.replace(b"m/s2", b"\xb5m  "))
    assert close(read_measured(path)["sensor_a"], 1e-6 * SIGNAL)


BAD_TABLES = {
    "samples": ("sample,a [mm]\n" + rows(np.arange(N), SIGNAL), ["'sample'", "counts", "--rate"]),
    "counted without a heading": (rows(np.arange(N), SIGNAL), ["'col1'", "counts", "--rate"]),
    "another unit first": ("d [mm],a [mm]\n" + rows(TIME, SIGNAL), ["'d'", "mm", "--rate"]),
    "no unit first": ("d,a [mm]\n" + rows(TIME, SIGNAL), ["'d'", "none", "--channel"]),
    "clock in whole seconds": ("c,a [mm]\n" + rows(["12:00:00"] * N, SIGNAL), ["row 2", "--rate"]),
    "dates alone": ("c,a [mm]\n" + rows(["2024-05-01"] * N, SIGNAL), ["clock", "line 2"]),
    "dates with slashes": ("c,a [mm]\n" + rows([f"01/{1 + k // 20:02d}/2024 {c}" for k, c in
                           enumerate(CLOCK)], SIGNAL), ["slashes", "column 1", "2024-05-31"]),
    "heading too long": ("t [s],a [mm],b [mm]\n" + rows(TIME, SIGNAL), ["line 1", "2 names", "3"]),
    "heading with a comma": ("t [s],a, [mm],b [mm]\n" + rows(TIME, SIGNAL, OTHER),
                             ["line 1", "quotes"]),
    "words in each row": ("t [s],a [mm],n\n" + rows(TIME, SIGNAL, ["ok"] * N),
                          ["line 2", "word in column 3", "two rows"]),
    "empty unit": ("t [s],a []\n" + rows(TIME, SIGNAL), ["'a'", "no unit"]),
    "two of a name": ("t [s],a b [mm],a_b [mm]\n" + rows(TIME, SIGNAL, OTHER), ["twice", "a_b"]),
    "binary": ("t [s],a [mm]\n\x00\x01\n", ["text file"]),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_TABLES)
def test_tables_that_are_refused(tmp_path: Path, name: str) -> None:
    text, words = BAD_TABLES[name]
    path = written(tmp_path / "m.csv", text)
    with pytest.raises(CaseError) as error:
        read_measured(path)
    for word in (str(path), *words):
        assert word in str(error.value)


# ---- the rate, and holes


def test_the_rate_wins_with_a_note(tmp_path: Path) -> None:
    rounded = [f"{t:.2f}" for t in TIME]  # steps of 5 ms in hundredths of a second
    path = written(tmp_path / "m.csv", "time [s],a [mm]\n" + rows(rounded, SIGNAL))
    with pytest.raises(CaseError, match="--rate"):
        read_measured(path)
    data = read_measured(path, rate=RATE)
    assert close(data["time"], TIME) and close(data["sensor_a"], 1e-3 * SIGNAL)
    assert "'time'" in data.attrs["notes"] and "200" in data.attrs["notes"]
    path = written(tmp_path / "n.csv", "sample,a [mm]\n" + rows(np.arange(N), SIGNAL))
    data = read_measured(path, rate=RATE)
    assert close(data["time"], TIME) and data["channel"].to_numpy().tolist() == ["a"]


FINE = np.arange(400) / 2000.0
SMOOTH = np.sin(60.0 * FINE)


@pytest.mark.parametrize(
    ("missing", "words"),
    [(slice(100, 104), ["1 hole", "4 samples", "0.0495", "0.052"]),
     (slice(9, None, 10), ["39 hole", "39 samples", "0.004", "0.005"])],
)  # fmt: skip
def test_holes_are_said_and_filled_when_asked_for(
    tmp_path: Path, missing: slice, words: list[str]
) -> None:
    t, a = (np.delete(samples, missing) for samples in (FINE, SMOOTH))
    path = written(tmp_path / "m.csv", "time [s],a [mm]\n" + rows(t, a))
    data = read_measured(path)
    assert data.sizes["time"] == t.size
    for word in words:
        assert word in data.attrs["notes"]
    assert any("2000 per second" in line for line in lines(data))
    filled = read_measured(path, fill=True)
    assert close(filled["time"], FINE[: filled.sizes["time"]])
    # cubic splines over at most five steps h: error below (5 h)^4 times the fourth derivative
    error = np.abs(filled["sensor_a"].to_numpy() - 1e-3 * SMOOTH[: filled.sizes["time"]]).max()
    assert error < 1e-3 * (5 * 60.0 / 2000.0) ** 4
    assert "interpolated" in filled.attrs["notes"]


def test_a_long_hole_is_not_filled_and_can_be_left_out(tmp_path: Path) -> None:
    t, a = (np.delete(samples, slice(100, 150)) for samples in (FINE, SMOOTH))
    path = written(tmp_path / "m.csv", "time [s],a [mm]\n" + rows(t, a))
    with pytest.raises(CaseError) as error:
        read_measured(path, fill=True)
    assert "50 from 0.0495 to 0.075 s" in str(error.value) and "--between" in str(error.value)
    data = read_measured(path, between=(0.0, 0.0495))
    assert close(data["sensor_a"], 1e-3 * SMOOTH[:100]) and "hole" not in data.attrs["notes"]
    with pytest.raises(CaseError, match="--between: "):
        read_measured(path, between=(1.0, 2.0))


# ---- sets and columns


def of_three_references(path: Path, **about: object) -> Path:
    sets = [
        {
            "type": 58, "binary": 0, "func_type": 4, "id1": "H", "rsp_node": 7, "rsp_dir": 3,
            "ref_node": node, "ref_dir": 3, "data": node * SIGNAL, "x": 5.0 + TIME * RATE,
            "abscissa_spacing": 1, "abscissa_spec_data_type": 18, "ordinate_spec_data_type": 8,
            "ordinate_axis_units_lab": "mm", "orddenom_spec_data_type": 13,
            "orddenom_axis_units_lab": "N",
        } | about
        for node in (1, 2, 3)
    ]  # fmt: skip
    return universal(path, *sets)


def test_responses_to_three_references_are_three(tmp_path: Path) -> None:
    data = read_measured(of_three_references(tmp_path / "m.uff"))
    assert data.sizes["output"] == 3
    for node in (1, 2, 3):
        response = data["response"].sel(output=f"node7 +z to node{node} +z")
        assert close(response, 1e-3 * node * SIGNAL)
    same = read_measured(of_three_references(tmp_path / "n.uff", ref_node=1))
    assert same.sizes["output"] == 3


def test_files_with_the_same_heading_are_not_one(tmp_path: Path) -> None:
    heading = "frequency [Hz],a [mm/N]\n"
    paths = [
        written(tmp_path / f"{k}.csv", heading + rows(5.0 + TIME * RATE, signal))
        for k, signal in enumerate((SIGNAL, OTHER))
    ]
    with pytest.raises(CaseError, match="twice") as error:
        read_measured(*paths)
    assert "0.csv" in str(error.value) and "1.csv" in str(error.value)
    with pytest.raises(CaseError, match="--channel b") as error:
        read_measured(*paths, channels={"b": "a"})
    assert "0.csv" in str(error.value) and "1.csv" in str(error.value)


def test_what_is_beside_the_parts_of_a_response_is_kept(tmp_path: Path) -> None:
    heading = "frequency [Hz],p real [mm/N],p imag [mm/N],p mag [mm/N]\n"
    path = written(tmp_path / "m.csv", heading + rows(5.0 + TIME * RATE, SIGNAL, OTHER, SIGNAL))
    data = read_measured(path)
    assert data["output"].to_numpy().tolist() == ["p", "p mag"]
    assert close(data["response"].sel(output="p"), 1e-3 * (SIGNAL + 1j * OTHER))


@pytest.mark.parametrize("name", ["x", "f", "pos", "seconds"])
def test_names_of_axes_beside_a_time_are_signals(tmp_path: Path, name: str) -> None:
    for k, values in enumerate((SIGNAL, 0.1 + TIME**2)):  # the second increases, too
        content = {"t": TIME, name: values, "a": OTHER, "units": {name: "mm", "a": "N"}}
        savemat(tmp_path / f"{k}.mat", content)
        data = read_measured(tmp_path / f"{k}.mat")
        assert close(data[f"sensor_{name}"], 1e-3 * values) and close(data["sensor_a"], OTHER)


@pytest.mark.parametrize("rate", [{"fs": RATE}, {"dt": 1.0 / RATE}, {"Ts": 1.0 / RATE}])
def test_one_matrix_beside_a_rate(tmp_path: Path, rate: dict[str, float]) -> None:
    for k, matrix in enumerate((np.array([SIGNAL, OTHER]), np.array([SIGNAL, OTHER]).T)):
        savemat(tmp_path / f"{k}.mat", {**rate, "data": matrix, "gain": [1.0, 2.0, 3.0]})
        data = read_measured(tmp_path / f"{k}.mat", units="mm")
        assert close(data["time"], TIME)
        assert close(data["sensor_data_1"], 1e-3 * SIGNAL)
        assert close(data["sensor_data_2"], 1e-3 * OTHER)
        assert "gain" in data.attrs["notes"]


@pytest.mark.parametrize(
    ("number", "name"),
    [
        (2, "auto spectrum"),
        (9, "power spectral density"),
        (12, "spectrum"),
        (5, "transmissibility"),
    ],
)
def test_other_functions_of_universal_files_are_named(
    tmp_path: Path, number: int, name: str
) -> None:
    path = of_three_references(tmp_path / "m.uff")
    responses = path.read_bytes()
    others = re.sub(rb"^    4(?= {9}\d)", b"%5d" % number, responses, flags=re.MULTILINE)
    assert others != responses
    path.write_bytes(others)
    with pytest.raises(CaseError) as error:
        read_measured(path)
    assert name in str(error.value) and str(path) in str(error.value)
    path.write_bytes(responses + others)
    data = read_measured(path)
    assert name in data.attrs["notes"] and data.sizes["output"] == 3


# ---- other formats

LABVIEW = """LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t.
Multi_Headings\tNo
X_Columns\tCOLUMNS
Time_Pref\tRelative
***End_of_Header***\t
\t
Channels\t2\t\t
Samples\tN\tN\t
Date\t2024/05/01\t2024/05/01\t
Time\t12:00:00\t12:00:00\t
Y_Unit_Label\tmm\tN\t
X_Dimension\tTime\tTime\t
X0\t0.0E+0\t0.0E+0\t
Delta_X\t0.005\t0.005\t
***End_of_Header***\t\t\t
X_Value\ta\tb\tComment
"""


@pytest.mark.parametrize("columns", ["One", "No"])
def test_text_files_of_labview(tmp_path: Path, columns: str) -> None:
    head = LABVIEW.replace("COLUMNS", columns).replace("N\tN", f"{N}\t{N}")
    first = TIME if columns == "One" else [""] * N
    path = written(tmp_path / "m.lvm", head + rows(first, SIGNAL, OTHER, separator="\t"))
    data = read_measured(path)
    assert close(data["time"], TIME)
    assert close(data["sensor_a"], 1e-3 * SIGNAL) and close(data["sensor_b"], OTHER)
    with pytest.raises(CaseError, match="LabVIEW"):
        read_measured(written(tmp_path / "n.lvm", "nothing"))


@pytest.mark.parametrize("start", [b"CDF\x01", b"\x89HDF\r\n\x1a\n"])
def test_a_damaged_netcdf_file_shows_no_other_path_and_no_warning(
    tmp_path: Path, start: bytes
) -> None:
    path = tmp_path / "m.nc"
    path.write_bytes(start + bytes(range(200)))
    with pytest.raises(CaseError) as error:  # warnings are errors in tests
        read_measured(path)
    assert str(error.value).count("/") == str(path).count("/")


@pytest.mark.parametrize("unit", ["seconds since 2024-05-01", "milliseconds since 1970-01-01"])
def test_times_of_conventions(tmp_path: Path, unit: str) -> None:
    path = as_netcdf(tmp_path / "m", ("time", unit, TIME), "mm")
    if unit.startswith("milli"):
        with pytest.raises(CaseError, match="milliseconds"):
            read_measured(path)
    else:
        assert close(read_measured(path)["time"], TIME)


def test_si_is_not_guessed(tmp_path: Path) -> None:
    path = written(tmp_path / "m.csv", "t [s],a\n" + rows(TIME, SIGNAL))
    with pytest.raises(CaseError, match="says what it measures"):
        read_measured(path, units="SI")


@pytest.mark.parametrize(("source", "factor"), [("a:V/(100 mV/g)", 98.0665), ("a:0.5 mm", 5e-4)])
def test_a_sensitivity_and_a_factor_in_an_assignment(
    tmp_path: Path, source: str, factor: float
) -> None:
    path = as_csv(tmp_path / "m", ("time", "s", TIME), "V")
    data = read_measured(path, channels={"b": source})
    assert close(data["sensor_b"], factor * SIGNAL)
