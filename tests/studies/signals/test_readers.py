"""What each reader finds in files: tables, NetCDF, MATLAB, and universal files byte by byte."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import pyuff
import xarray as xr
from scipy.io import savemat

from delam_fem.api import CaseError
from delam_fem.results.netcdf import read_dataset
from delam_fem.studies.signals.channels import Sheet
from delam_fem.studies.signals.readers import (
    blocks_of,
    cleaned,
    netcdf_sheets,
    read_matlab,
    read_text,
    read_universal,
)
from delam_fem.studies.signals.reading import sheets_of

N = 9
TIME = 0.5 + 0.25 * np.arange(N)
ONE, TWO = 2.0 + np.sin(TIME), -1.0 + np.cos(3.0 * TIME) ** 3
"""Values of two columns; neither begins, ends or is scaled like the other."""
FREQUENCY = 4.0 + 2.0 * np.arange(N)
RESPONSE = (1.0 - 0.4j) / (FREQUENCY - 11.5 - 1.0j)


Columns = dict[str, tuple[str | None, np.ndarray]]
"""The unit and the values of each column by its name."""


def columns_of(sheets: list[Sheet]) -> list[tuple[float | None, Columns]]:
    """Return the rate and the columns of each sheet that a reader found."""
    return [
        (sheet.rate, {column.name: (column.unit, column.values) for column in sheet.columns})
        for sheet in sheets
    ]


def assert_same(sheets: list[Sheet], expected: list[tuple[float | None, Columns]]) -> None:
    """Compare what a reader found with what was written, up to the digits of a table."""
    groups = columns_of(sheets)
    assert len(groups) == len(expected)
    for (rate, columns), (expected_rate, expected_columns) in zip(groups, expected, strict=True):
        assert rate == expected_rate
        assert list(columns) == list(expected_columns)
        for name, (unit, values) in expected_columns.items():
            assert columns[name][0] == unit, name
            np.testing.assert_allclose(columns[name][1], values, rtol=1e-6, err_msg=name)


# ---- text


def rows(*columns: np.ndarray, separator: str = ",", n: int = N) -> str:
    """Return columns as rows of a table."""
    return "\n".join(
        separator.join(f"{v:.7g}" for v in row) for row in np.array(columns).T[:n].tolist()
    )


TABLES: dict[str, tuple[str, Columns]] = {
    "names and units": (
        f"time [s],a one (mm), b [m/s]\n{rows(TIME, ONE, TWO)}\n",
        {"time": ("s", TIME), "a one": ("mm", ONE), "b": ("m/s", TWO)},
    ),
    "no heading": (
        rows(TIME, ONE, TWO, separator=" "),
        {"col1": (None, TIME), "col2": (None, ONE), "col3": (None, TWO)},
    ),
    "two rows": (rows(TIME, ONE, n=2), {"col1": (None, TIME[:2]), "col2": (None, ONE[:2])}),
    "lines above": (
        f"Recorder\nNo,17,x,y\nname,place\nt,upper\n(ms),[mm]\n{rows(TIME, ONE)}",
        {"t": ("ms", TIME), "upper": ("mm", ONE)},
    ),
    "long words are no units": (
        f"t,upper\nsecond,millimetres\n{rows(TIME, ONE)}",
        {"second": (None, TIME), "millimetres": (None, ONE)},
    ),
    "five letters are a unit": (
        f"t,upper\ns,metre\n{rows(TIME, ONE)}", {"t": ("s", TIME), "upper": ("metre", ONE)},
    ),
    "a fraction is a unit": (
        f"t,upper\ns,metre/second\n{rows(TIME, ONE)}",
        {"t": ("s", TIME), "upper": ("metre/second", ONE)},
    ),
    "one line of short names": (
        f"t,upper\n{rows(TIME, ONE)}", {"t": (None, TIME), "upper": (None, ONE)},
    ),
    "in a comment": (
        f"# made by hand\n# t [s] a [mm]\n{rows(TIME, ONE, separator=' ')}",
        {"t": ("s", TIME), "a": ("mm", ONE)},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_tables_are_read_with_names_and_units(name: str, tmp_path: Path) -> None:
    text, columns = TABLES[name]
    path = tmp_path / "t.csv"
    path.write_text(text, encoding="utf-8")
    assert_same(read_text(path), [(None, columns)])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,a\n0,1\n", "expected a table with at least two rows of numbers"),
        ("t,a\n0,1\n1,2,3\n", "line 3: expected two numbers, given 3 columns"),
        ("t,a,b\n0,1,2\n1,2,x\n", "line 3: expected three numbers, given a word in column 3"),
        ("1,a,b\n0,1,2\n1,2,3\n", "line 1: expected numbers or names, found both"),
    ],
)
def test_messages_of_tables_are_exact(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CaseError) as error:
        read_text(path)
    assert str(error.value).startswith((f"{path}: {message}", f"{path}, {message}"))


# ---- NetCDF


def test_netcdf_files_are_read_with_their_axes(tmp_path: Path) -> None:
    x, mm = np.array([0.0, 0.1, 0.4]), {"units": "mm"}
    table = np.array([ONE, TWO, ONE * TWO])
    data = xr.Dataset(
        {
            "w": (("lamina", "time"), table, mm),
            "v": (("time", "place"), table[:2].T),
            "base": ("time", np.arange(N)),
            "name": ("time", np.array(list("abcdefghi"))),
            "cube": (("time", "place", "lamina"), np.zeros((N, 2, 3))),
            "h": ("frequency", np.abs(RESPONSE), {"units": "mm/N"}),
            "sensor_a": ("sensor_a_time", ONE[::2], mm),
            "single": ("t", [1.0]),
            "loose": ("f", [1.0, 2.0]),
            "of_no_axis": ("lamina", [1.0, 2.0, 4.0]),
            "gap0": (("interface", "node"), [[0.0, 0.01, 0.04], [0.0, 0.02, 0.03]], mm),
        },
        {
            "time": ("time", TIME, {"units": "ms"}), "frequency": FREQUENCY, "t": [0.0],
            "lamina": ["a", "b", "c"], "sensor_a_time": ("sensor_a_time", TIME[::2]),
            "x": ("node", x, {"units": "cm"}), "time_of_nothing": [1.0, 2.0],
        },
    )  # fmt: skip
    expected: list[tuple[float | None, Columns]] = [
        (None, {"time": ("ms", TIME), "w a": ("mm", ONE), "w b": ("mm", TWO),
                "w c": ("mm", ONE * TWO), "v_1": (None, ONE), "v_2": (None, TWO),
                "base": (None, np.arange(N))}),
        (None, {"frequency": (None, FREQUENCY), "h": ("mm/N", np.abs(RESPONSE))}),
        (None, {"time": (None, TIME[::2]), "sensor_a": ("mm", ONE[::2])}),
        (None, {"x": ("cm", x), "gap0_1": ("mm", data["gap0"].to_numpy()[0]),
                "gap0_2": ("mm", data["gap0"].to_numpy()[1])}),
    ]  # fmt: skip
    path = tmp_path / "m.nc"
    data.drop_vars("name").to_netcdf(path, engine="h5netcdf")
    assert_same(sheets_of(path), expected)
    data.drop_vars("name").to_netcdf(path, engine="scipy")
    by_name = {frozenset(columns) for _, columns in columns_of(sheets_of(path))}
    assert by_name == {frozenset(columns) for _, columns in expected}
    over_x = xr.Dataset({"gap0": ("x", 0.1 * x), "other": ("x", x)}, {"x": x})
    columns = {"x": (None, x), "gap0": (None, 0.1 * x), "other": (None, x)}
    assert_same(netcdf_sheets(over_x, tmp_path / "x.nc"), [(None, columns)])


def test_a_netcdf_file_without_an_axis_or_of_rubbish_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CaseError) as error:
        netcdf_sheets(xr.Dataset({"a": ("time", [1.0])}, {"time": [0.0]}), Path("a.nc"))
    assert str(error.value) == (
        "a.nc: expected variables over a dimension time, frequency or x with its coordinate, found "
        "none"
    )
    path = tmp_path / "b.nc"
    path.write_bytes(b"CDF but no more of it")
    with pytest.raises(CaseError) as error:
        read_dataset(path)
    start = f"{path}: damaged, or no NetCDF file ("
    told = str(error.value)
    assert told.startswith(start) and len(told) <= len(start) + 120 and "\n" not in told


def test_of_the_reasons_of_libraries_a_line_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError(reason + "\nand more")

    (path := tmp_path / "a.mat").write_bytes(b"anything")
    monkeypatch.setattr(h5py, "File", fail)
    monkeypatch.setattr("scipy.io.whosmat", fail)
    for reason in ("in short", 12 * "a word "):
        for read, kind in ((read_dataset, "NetCDF"), (read_matlab, "MATLAB")):
            with pytest.raises(CaseError) as error:
                read(path)  # type: ignore[operator]
            assert f"{path}: damaged, or no {kind} file ({reason[:80]})" in str(error.value)
            assert "and more" not in str(error.value)


# ---- MATLAB


MATLAB: dict[str, tuple[dict[str, Any], list[tuple[float | None, Columns]]]] = {
    "times": (
        {"t": TIME, "a": ONE, "b": np.array([ONE, TWO]), "c": np.array([ONE, TWO]).T,
         "d": np.arange(4.0), "short": ONE[:-1], "n": 7.0, "units": {"t": "ms", "a": "mm"}},
        [(None, {"t": ("ms", TIME), "a": ("mm", ONE), "b_1": (None, ONE), "b_2": (None, TWO),
                 "c_1": (None, ONE), "c_2": (None, TWO)})],
    ),
    "names": (
        {"t": TIME, "laser": np.array([ONE, TWO]).T, "points": np.array(["p 1 ", "q"], object),
         "text": "nothing"},
        [(None, {"t": (None, TIME), "laser p 1": (None, ONE), "laser q": (None, TWO)})],
    ),
    "rates": ({"Fs": 4.0, "a": ONE, "b": TWO[:5]}, [(4.0, {"a": (None, ONE)})]),
    "steps": ({"dt": 0.25, "fs": -1.0, "a": ONE}, [(4.0, {"a": (None, ONE)})]),
    "three names of rates": (
        {"first": {"sample_rate": 8.0, "a": ONE}, "second": {"time_step": 0.5, "a": TWO},
         "third": {"b": ONE}, "samplerate": 2.0},
        [(8.0, {"a": (None, ONE)}), (2.0, {"a": (None, TWO)}), (2.0, {"b": (None, ONE)})],
    ),
    "axes within": (
        {"t": TIME, "outer": TWO, "units": {"t": "s"},
         "scope": {"a": ONE, "units": {"a": "V"}, "deeper": {"b": TWO}}},
        [(None, {"t": ("s", TIME), "outer": (None, TWO)}),
         (None, {"t": ("s", TIME), "a": ("V", ONE)}),
         (None, {"t": (None, TIME), "b": (None, TWO)})],
    ),
    "frequencies": (
        {"frequency": FREQUENCY, "h": RESPONSE, "units": {"h": "mm/N"}},
        [(None, {"frequency": (None, FREQUENCY), "h": ("mm/N", RESPONSE)})],
    ),
    "falling": (
        {"t": TIME[::-1], "time": TIME, "a": ONE},
        [(None, {"time": (None, TIME), "t": (None, TIME[::-1]), "a": (None, ONE)})],
    ),
}  # fmt: skip
"""What a file holds, and the sheets that follow from it."""


@pytest.mark.parametrize("name", MATLAB)
def test_matlab_files_are_read_with_their_axes(name: str, tmp_path: Path) -> None:
    content, expected = MATLAB[name]
    path = tmp_path / "m.mat"
    savemat(path, content)
    assert_same(read_matlab(path), expected)


def test_matlab_files_of_version_7_3_are_read(tmp_path: Path) -> None:
    """They are HDF5: arrays are turned, texts are numbers, cells are references."""
    path = tmp_path / "m.mat"
    with h5py.File(path, "w", userblock_size=512) as file:

        def put(name: str, values: Any, kind: str, **about: int) -> Any:
            dataset = file.create_dataset(name, data=values)
            dataset.attrs["MATLAB_class"] = np.bytes_(kind)
            dataset.attrs.update(about)
            return dataset

        def text(name: str, word: str) -> Any:
            return put(name, np.array([[ord(c)] for c in word], np.uint16), "char")

        put("t", TIME[None, :], "double")
        put("laser", np.array([ONE, TWO]), "double")
        put("none", np.zeros(2, np.uint64), "double", MATLAB_empty=1)
        pair = np.zeros((1, N), [("real", float), ("imag", float)])
        pair["real"], pair["imag"] = ONE, TWO
        put("z", pair, "double")
        words = [text(f"#refs#/{k}", word).ref for k, word in enumerate(("near", "far"))]
        put("points", np.array([words], h5py.ref_dtype).T, "cell")
        text("units/laser", "mm/s")
        put("scope/t", TIME[None, :4], "double")
        put("scope/b", TWO[None, :4], "double")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    outer: Columns = {"t": (None, TIME), "laser near": ("mm/s", ONE), "laser far": ("mm/s", TWO),
                      "z": (None, ONE + 1j * TWO)}  # fmt: skip
    inner: Columns = {"t": (None, TIME[:4]), "b": (None, TWO[:4])}
    assert_same(read_matlab(path), [(None, outer), (None, inner)])


def test_a_matlab_file_that_holds_nothing_says_what_it_has(tmp_path: Path) -> None:
    path = tmp_path / "m.mat"
    start = "expected vectors beside a vector t or time, or a number fs or dt; found "
    for content, listing in (
        ({"y": ONE, "t": TIME[:1], "a": 1.0}, "a, t, y"),
        ({f"name_{k:02d}": 1.0 for k in range(40)}, None),
        ({"fs": 4.0, "y": ONE[:1]}, "fs, y"),
        ({"fs": 0.0, "dt": -1.0, "y": ONE}, "dt, fs, y"),
    ):
        savemat(path, content)
        with pytest.raises(CaseError) as error:
            read_matlab(path)
        wanted = listing or ", ".join(f"name_{k:02d}" for k in range(40))[:200]
        assert str(error.value) == f"{path}: {start}{wanted}"
    path.write_bytes(b"MATLAB 5.0 MAT-file, but no more of it")
    with pytest.raises(CaseError, match=r"m\.mat: damaged, or no MATLAB file \(.{1,80}\);"):
        read_matlab(path)


# ---- universal files

KINDS = {2: "f4", 4: "f8", 5: "f4", 6: "f8"}
"""Values of a binary set by the type of its ordinate."""


def binary(
    values: np.ndarray, *, kind: int, order: str = "<", x: np.ndarray | None = None,
    name: str = "a", end: str = "\n",
) -> tuple[bytes, bytes]:  # fmt: skip
    """Return header and data of a set 58b, as instruments write them."""
    n, parts = values.size, [values.real, values.imag] if kind in (5, 6) else [values.real]
    columns = parts if x is None else [x, *parts]
    data = np.array(columns).T.astype(order + KINDS[kind]).tobytes()
    is_even = int(x is None)
    lines = [
        f"{-1:6d}", f"{58:6d}b{1 if order == '<' else 2:6d}{2:6d}{11:12d}{len(data):12d}{0:6d}"
        f"{0:6d}{0:12d}{0:12d}", f"{name:<80}", *4 * ["NONE"],
        f"{1:5d}{0:10d}{0:5d}{0:10d} {'NONE':>10}{7:10d}{-3:4d} {'NONE':>10}{0:10d}{0:4d}",
        f"{kind:10d}{n:10d}{is_even:10d}{0.5:13.5e}{0.25:13.5e}{0.0:13.5e}",
        f"{17:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}",
        f"{12:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'g':<20}",
        *2 * [f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}"],
    ]  # fmt: skip
    return "".join(line + end for line in lines).encode(), data


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("kind", [2, 4, 5, 6])
@pytest.mark.parametrize("is_even", [True, False])
def test_binary_sets_of_any_width_and_order(
    tmp_path: Path, order: str, kind: int, is_even: bool
) -> None:
    values = ONE + 1j * TWO if kind in (5, 6) else ONE
    x = None if is_even else TIME**2
    path = tmp_path / "m.uff"
    first = b"".join(binary(values, kind=kind, order=order, x=x, name="first"))
    second = b"".join(binary(TWO, kind=4, name="second"))
    path.write_bytes(first + b"    -1\n" + second + b"    -1\n")
    sheets = read_universal(path)
    assert [sheet.label for sheet in sheets] == [f"{path}, set 1", f"{path}, set 2"]
    axis, column = sheets[0].columns
    tolerance = 1e-6 if kind in (2, 5) else 1e-14
    np.testing.assert_allclose(axis.values, TIME if is_even else x, rtol=tolerance)
    np.testing.assert_allclose(column.values, values, rtol=tolerance)
    assert sheets[0].notes == () and column.unit == "g" and column.quantity == "acceleration"
    np.testing.assert_allclose(sheets[1].columns[1].values, TWO, rtol=1e-14)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("stray", [b"\n", b"\r\n", b"\n\n"])
def test_stray_line_ends_are_counted_and_left_out(tmp_path: Path, order: str, stray: bytes) -> None:
    """The values begin or end with a byte that may be a line end; the other side is wrong."""
    path, values = tmp_path / "m.uff", 2.0 ** np.arange(N)  # most bytes are 0: the order tells
    low = b"\n\x00\x00\x00\x00\x00\xf0?"  # least byte first: begins like a line end
    values[0] = np.frombuffer(low, "<f8")[0]
    values[-1] = np.frombuffer(b"?\xf0\x00\x00\x00\x00\x00\n", ">f8")[0]
    header, data = binary(values, kind=4, order=order)
    for pieces in ((stray, data), (data, stray)):
        path.write_bytes(header + b"".join(pieces) + b"    -1\n")
        [sheet] = read_universal(path)
        assert sheet.notes == (f"{len(stray)} stray bytes about its binary data left out",)
        np.testing.assert_array_equal(sheet.columns[1].values, values)


def test_a_binary_set_without_values_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.uff"
    path.write_bytes(b"".join(binary(np.zeros(0), kind=4)) + b"    -1\n")
    with pytest.raises(CaseError) as error:
        read_universal(path)
    assert str(error.value) == f"{path}: set 1 has 0 of 0 values; the file is cut off"


def test_stray_bytes_about_single_precision(tmp_path: Path) -> None:
    """Half of the sets have no multiple of eight bytes; nothing is clear then but the first."""
    path = tmp_path / "m.uff"
    header, data = binary(ONE, kind=2)
    path.write_bytes(header + b"\n" + data + b"\r    -1\n")
    [sheet] = read_universal(path)
    assert sheet.notes == ("2 stray bytes about its binary data left out",)
    np.testing.assert_allclose(sheet.columns[1].values, ONE, rtol=1e-6)


def test_blocks_and_their_bytes(tmp_path: Path) -> None:
    path = tmp_path / "m.uff"
    header, data = binary(ONE, kind=4, end="  \r\n")
    text = b"    -1  \n   151 and more \n model d\n\n    -1\n"
    fifty_eight = b"    -1\n    58\n" + 11 * b"head D \n" + b"\n 1.0D+00 2.0d-01  \r\n    -1"
    path.write_bytes(b"    -1\n\n    -1\r\n" + text + header + data + b"    -1 \n" + fifty_eight)
    empty, plain, of_data, of_text = blocks_of(path)
    assert (empty.number, empty.kind, empty.header) == (1, "empty", b"    -1\n\n")
    assert (plain.number, plain.kind) == (2, "151")
    assert plain.header == b"    -1  \n   151 and more \n model d\n\n"
    assert cleaned(plain) == b"    -1\n   151 and more\n model d\n\n    -1\n"
    assert (of_data.number, of_data.kind, of_data.data, of_data.notes) == (3, "58b", data, ())
    assert of_data.header == b"".join(line.rstrip() + b"\n" for line in header.splitlines())
    assert cleaned(of_data) == of_data.header + data + b"\n    -1\n"
    assert (of_text.number, of_text.kind) == (4, "58")
    head = b"    -1\n    58\n" + 11 * b"head D\n"
    assert cleaned(of_text) == head + b" 1.0E+00 2.0E-01\n    -1\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"nothing", "expected a universal file, found no line '    -1' that begins a set"),
        (b"    -1\n  2411xyz\n", "set 1 (type 2411xy) has no end; the file is cut off"),
        (
            b"    -1\n   151\n    -1\n    -1\n 164\n",
            "set 2 (type 164) has no end; the file is cut off",
        ),
        (b"    -1\n    58b\n", "set 1 (type 58b): its header cannot be read"),
        (
            b"    -1\n   151\n m\n    -1\n    -1\n  9999\n    -1\n",
            "expected a universal file with sets 58 that hold histories, frequency responses or "
            "coherences, found the sets 151, 9999",
        ),
    ],
)
def test_messages_of_universal_files_are_exact(
    tmp_path: Path, content: bytes, message: str
) -> None:
    path = tmp_path / "m.uff"
    path.write_bytes(content)
    with pytest.raises(CaseError) as error:
        read_universal(path)
    assert str(error.value).startswith(f"{path}: {message}")


@pytest.mark.parametrize("kind", [2, 4, 5, 6])
def test_a_binary_set_that_is_cut_off_says_its_size(tmp_path: Path, kind: int) -> None:
    header, data = binary(ONE, kind=kind, x=TIME)
    path = tmp_path / "m.uff"
    path.write_bytes(header + data[:-5])
    size = {2: 72, 4: 144, 5: 108, 6: 216}[kind]
    assert len(data) == size
    with pytest.raises(CaseError) as error:
        read_universal(path)
    assert str(error.value) == (
        f"{path}: set 1 (type 58b): expected {size} bytes of data and its end, found {size - 5} "
        "bytes; the file is cut off"
    )
    path.write_bytes(header.replace(b"%10d" % kind, b"%10d" % 3, 1))
    with pytest.raises(CaseError, match=r"set 1 \(type 58b\): its header cannot be read$"):
        read_universal(path)


def functions(**all_have: Any) -> list[dict[str, Any]]:
    """Return sets 58 of all kinds, quantities and names."""
    of_time = {
        "type": 58, "binary": 0, "func_type": 1, "id1": "NONE", "rsp_node": 1, "rsp_dir": 3,
        "ref_node": 0, "ref_dir": 0, "data": ONE, "x": TIME, "abscissa_spacing": 1,
        "abscissa_spec_data_type": 17, "ordinate_spec_data_type": 8,
        "ordinate_axis_units_lab": "NONE", "orddenom_spec_data_type": 0,
    }  # fmt: skip
    over = of_time | {"x": FREQUENCY, "abscissa_spec_data_type": 18}
    response = over | {"func_type": 4, "data": RESPONSE, "orddenom_spec_data_type": 13}
    mm_by_n = {"ordinate_axis_units_lab": " mm ", "orddenom_axis_units_lab": "N"}
    sets = [
        *(of_time | {"ordinate_spec_data_type": k, "rsp_dir": d, "rsp_node": 10 + k}
          for k, d in ((0, 1), (3, 2), (8, 3), (9, -1), (11, -2), (12, -3), (13, 0), (17, 1))),
        of_time | {"func_type": 0, "abscissa_spec_data_type": 0, "rsp_node": 2,
                   "ordinate_axis_units_lab": "mV"},
        of_time | {"x": TIME**2, "abscissa_spacing": 0, "rsp_node": 3, "data": TWO},
        over | {"rsp_node": 4},
        *(response | {"ordinate_spec_data_type": k, "rsp_node": 20 + k} for k in (8, 11, 12, 3)),
        response | {"rsp_node": 5, "orddenom_spec_data_type": 11},
        response | {"rsp_node": 6, "orddenom_spec_data_type": 0},
        response | mm_by_n | {"rsp_node": 7},
        response | mm_by_n | {"rsp_node": 8, "orddenom_axis_units_lab": "NONE"},
        response | {"rsp_node": 9, "abscissa_spec_data_type": 0},
        of_time | mm_by_n | {"rsp_node": 19},
        over | mm_by_n | {"func_type": 6, "data": TWO, "rsp_node": 7},
        over | {"func_type": 2, "rsp_node": 30},
        of_time | {"abscissa_spec_data_type": 3, "rsp_node": 31},
    ]  # fmt: skip
    return [dataset | all_have for dataset in sets]


def write(path: Path, *sets: dict[str, Any]) -> Path:
    """Write sets with pyuff."""
    for dataset in sets:
        pyuff.UFF(str(path)).write_sets([dataset], "add")
    return path


PLACES = pyuff.prepare_15(
    node_nums=[3, 7, 12], def_cs=[0, 0, 0], disp_cs=[0, 0, 0], color=[0, 0, 0],
    x=[120.0, 240.0, -60.0], y=[1.0, 2.0, 3.0], z=[4.0, 5.0, 6.0],
)  # fmt: skip


def test_sets_are_named_by_what_tells_them_apart(tmp_path: Path) -> None:
    history, other = functions()[0], functions()[16]
    for k, (about, names) in enumerate([
        (({"id1": "a"}, {"id1": "b"}), ["a", "b"]),
        (({"id1": "a"}, {"id1": "a"}), ["a", "a"]),  # of two functions
        (({"id1": "a", "rsp_ent_name": "P"}, {"id1": "", "rsp_ent_name": "Q"}), ["P", "Q"]),
        (({"id1": "a"}, {"id1": "NONE"}), ["node10 +x", "node6 +z"]),
    ]):  # fmt: skip
        sets = [dataset | more for dataset, more in zip((history, other), about, strict=True)]
        sheets = read_universal(write(tmp_path / f"{k}.uff", *sets))
        assert [sheet.columns[1].name for sheet in sheets] == names, k
    same = [history | {"id1": "a"}, history | {"id1": "a", "rsp_node": 4, "rsp_dir": 0}]
    sheets = read_universal(write(tmp_path / "same.uff", *same))
    assert [sheet.columns[1].name for sheet in sheets] == ["node10 +x", "node4"]


def test_a_set_with_fewer_values_than_it_says_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "m.uff", functions()[0])
    text = path.read_text()
    lines = text.splitlines(keepends=True)
    path.write_text("".join([*lines[:-2], lines[-1]]))  # the last of nine values
    with pytest.raises(CaseError) as error:
        read_universal(path)
    assert str(error.value) == f"{path}: set 1 has 8 of 9 values; the file is cut off"


FACTORS = {"displacement": 1e-3, "velocity": 1e-3, "acceleration": 1e-3, "force": 2.0,
           "strain": 1.0, "time": 1.0, "receptance": 0.5e-3, "mobility": 0.5e-3,
           "accelerance": 0.5e-3}  # fmt: skip
"""What a number becomes in SI in a file with 1000 lengths in a metre and half a force in 1 N."""


def test_a_set_of_units_scales_what_has_no_unit_of_its_own(tmp_path: Path) -> None:
    units = pyuff.prepare_164(units_code=9, units_description="own", temp_mode=1, length=1000.0,
                              force=0.5, temp=1.0, temp_offset=0.0)  # fmt: skip
    bare = read_universal(write(tmp_path / "bare.uff", PLACES, *functions()))
    scaled = read_universal(write(tmp_path / "scaled.uff", PLACES, units, *functions()))
    n_scaled = 0
    for sheet, sheet_in_si in zip(bare, scaled, strict=True):
        column, column_in_si = sheet.columns[-1], sheet_in_si.columns[-1]
        if column_in_si.unit == "SI" and column.quantity:
            factor = FACTORS[column.quantity]
            n_scaled += 1
        elif column_in_si.unit != "SI":
            factor = 1.0
        else:
            continue
        np.testing.assert_allclose(column_in_si.values, factor * column.values, rtol=1e-9)
    assert n_scaled >= len(FACTORS)
