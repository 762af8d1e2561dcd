"""Measured files of every format: what is written is read back in SI, bad files are refused."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import pyuff
import xarray as xr
from scipy.io import savemat
from support import refusal
from synthetic import small_case, synthetic_history

import delam_fem as df
from delam_fem import read_measured
from delam_fem.api import CaseError
from delam_fem.case.gap import read_gap_table
from delam_fem.studies.signals.channels import Channel
from delam_fem.studies.signals.reading import (
    EQUAL,
    assigned,
    dataset,
    lines,
    rows,
    scan,
    variable_of,
)
from delam_fem.studies.signals.units import unit_of
from delam_fem.studies.signals.writing import write_all, write_measured

RATE, N = 512.0, 301
"""Samples per second and samples: no multiple of 4 or 6, the numbers in a line of a UFF."""
TIME = np.arange(N) / RATE
THICK = 0.011 * np.sin(2.0 * np.pi * 3.25 * TIME)
THIN = 0.014 * np.cos(2.0 * np.pi * 3.25 * TIME) + 0.002
TEXT_DIGITS = 6e-6
"""Tolerance of values that are written with six digits, relative to the largest."""


def is_close(found: object, wanted: np.ndarray, tolerance: float = 1e-12) -> bool:
    return bool(np.all(np.abs(np.asarray(found) - wanted) <= tolerance * np.abs(wanted).max()))


def table(path: Path, heading: str, *columns: np.ndarray, separator: str = ",") -> Path:
    body = "\n".join(
        separator.join(repr(float(v)) for v in row) for row in zip(*columns, strict=True)
    )
    path.write_text(f"{heading}\n{body}\n" if heading else f"{body}\n", encoding="utf-8")
    return path


def uff_set(name: str, values: np.ndarray, **about: object) -> dict[str, object]:
    record: dict[str, object] = {
        "type": 58, "binary": 0, "func_type": 1, "id1": name, "rsp_node": 1, "rsp_dir": 3,
        "ref_node": 0, "ref_dir": 0, "data": values, "x": TIME, "abscissa_spacing": 1,
        "abscissa_inc": 1.0 / RATE, "abscissa_spec_data_type": 17, "ordinate_spec_data_type": 8,
        "ordinate_axis_units_lab": "mm", "orddenom_spec_data_type": 0,
    }  # fmt: skip
    return record | about


def write_uff(path: Path, *sets: dict[str, object], double: bool = True) -> Path:
    file = pyuff.UFF(str(path))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for record in sets:
            if not double:
                record["ord_data_type"] = 5 if np.iscomplexobj(record["data"]) else 2
            file.write_sets([record], "add", force_double=double)
    return path


# ---- text


def test_a_table_in_mm_becomes_tips_in_metres(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "time [s],tip thick [mm],tip thin (um)", TIME, 1e3 * THICK,
                 1e6 * THIN)  # fmt: skip
    data = df.read_measured(path)
    assert data["lamina"].to_numpy().tolist() == ["thick", "thin"]
    assert is_close(data["tip_displacement"], np.array([THICK, THIN]))
    assert is_close(data["time"], TIME)
    assert data["tip_displacement"].attrs["units"] == "m"
    assert data["channel_source"][0].item().endswith("[mm]")


@pytest.mark.parametrize(
    ("unit", "factor", "quantity", "si"),
    [
        ("mm/s", 1e-3, "velocity", "m/s"), ("m/s²", 1.0, "acceleration", "m/s2"),
        ("m/s2", 1.0, "acceleration", "m/s2"), ("g", 9.80665, "acceleration", "m/s2"),
        ("N", 1.0, "force", "N"), ("µm/m", 1e-6, "strain", "1"), ("mV", 1e-3, "voltage", "V"),
        ("in", 0.0254, "displacement", "m"),
    ],
)  # fmt: skip
def test_units_of_sensors(tmp_path: Path, unit: str, factor: float, quantity: str, si: str) -> None:
    data = read_measured(table(tmp_path / "m.csv", f"t,mid [{unit}]", TIME, THIN))
    assert is_close(data["sensor_mid"], factor * THIN)
    assert data["channel_quantity"].item() == quantity
    assert data["sensor_mid"].attrs["units"] == si


def test_measured_channels_have_the_attributes_of_a_record(tmp_path: Path) -> None:
    columns = (TIME, THICK, THIN, THIN, THICK, 9.81 * THIN)
    path = table(tmp_path / "m.csv", "", *columns)
    channels = {
        "tip thick": "col2:m", "tip thin": "col3:m", "mid": "col4:mm/s@120mm/thin",
        "cell": "col5:N", "base": "col6:g",
    }  # fmt: skip
    data = read_measured(path, channels=channels)
    again = read_measured(write_measured(data, tmp_path / "measured.nc"))
    for measured in (data, again):
        expected = {"units": "m/s", "quantity": "velocity", "lamina": "thin", "x": 0.12}
        assert expected.items() <= measured["sensor_mid"].attrs.items()
        assert "0.12 m" in measured["sensor_mid"].attrs["place"]
        assert measured["sensor_base"].attrs["quantity"] == "base acceleration"
        assert measured["tip_displacement"].attrs["quantity"] == "displacement"
        cell = measured["sensor_cell"].attrs
        assert (cell["quantity"], cell["place"], cell["units"]) == ("force", "cell", "N")
        assert "x" not in cell and "lamina" not in cell


def test_columns_without_names_are_assigned(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "", TIME, 1e3 * THICK, THIN)
    data = read_measured(
        path, channels={"tip thick": "col2", "mid": "col3:m/s@120mm/thin"}, units="mm"
    )
    assert is_close(data["tip_displacement"].sel(lamina="thick"), THICK)
    assert is_close(data["sensor_mid"], THIN)
    assert float(data["channel_position"].sel(channel="mid")) == pytest.approx(0.12)
    assert data["channel_lamina"].sel(channel="mid").item() == "thin"


def test_a_table_without_times_takes_the_rate(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "thick [mm],thin [mm]", 1e3 * THICK, 1e3 * THIN)
    data = read_measured(path, rate=RATE)
    assert is_close(data["time"], TIME) and is_close(data["sensor_thick"], THICK)


def test_a_table_of_a_spreadsheet_with_decimal_commas(tmp_path: Path) -> None:
    rows = (f"{t:.6f};{1e3 * q:.6f}".replace(".", ",") for t, q in zip(TIME, THIN, strict=True))
    path = tmp_path / "m.csv"
    path.write_text("time [s];tip thin [mm]\n" + "\n".join(rows), encoding="utf-8")
    assert is_close(read_measured(path)["tip_displacement"][0], THIN, 1e-6)


def test_a_heading_in_a_comment(tmp_path: Path) -> None:
    path = tmp_path / "m.txt"
    np.savetxt(path, np.array([TIME, 1e3 * THIN]).T, delimiter=",", header="time [s],tip thin [mm]")
    assert is_close(read_measured(path)["tip_displacement"][0], THIN)


def test_lines_above_the_table_and_a_line_of_units(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    table(path, "Recorder XY\nSerial,17\ntime,tip thin\n[s],[mm]", TIME, 1e3 * THIN)
    assert is_close(read_measured(path)["tip_displacement"][0], THIN)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("t,thick\n0,1\n1,2\n", {}, "no unit; expected one in the heading, as in 'thick [mm]'"),
        ("t,thick [mmm]\n0,1\n1,2\n", {}, "expected a unit such as mm"),
        ("t,thick [mm]\n0,1\n0,2\n", {}, "expected the time to increase, given 0 after 0"),
        ("t,thick [mm]\n0,1\n1\n", {}, "line 3: expected two numbers, given 1 column"),
        ("t,thick [mm]\n0,1\n1,x\n", {}, "line 3: expected two numbers, given a word in column 2"),
        ("t,thick [mm]\n0,1\n1,nan\n", {}, "line 3: expected finite numbers, given 1.0, nan"),
        ("t,a [mm]\n0,x\n1,2\n2,3\n", {}, "line 2: expected numbers or names, found both"),
        ("t,thick [mm]\n", {}, "at least two rows of numbers"),
        ("t,a [mm]\n0,1\n1,2\n", {"channels": {"tip thin": "b"}}, "there is no column"),
        ("t,a [mm]\n0,1\n1,2\n", {"rate": -1.0}, "expected a positive number of samples"),
        ("x [mm],a [N]\n0,1\n1,2\n", {}, "expected a gap in a unit of length over x"),
        ("t,a [mm],a [mm]\n0,1,1\n1,2,1\n", {}, "expected different names"),
    ],
)  # fmt: skip
def test_bad_tables_are_refused(
    tmp_path: Path, text: str, options: dict[str, object], message: str
) -> None:
    path = tmp_path / "m.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CaseError, match=message.replace("[", r"\[")):
        read_measured(path, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("suffix", [".uff", ".mat", ".nc", ".csv"])
def test_files_of_noise_are_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"m{suffix}"
    path.write_bytes(np.random.default_rng(1).bytes(2000))
    with pytest.raises(CaseError, match="m" + suffix):
        read_measured(path)


def test_missing_and_unknown_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="there is no such file"):
        read_measured(tmp_path / "none.csv")
    (tmp_path / "m.xyz").write_text("1")
    with pytest.raises(CaseError, match=r"expected a file that ends in .csv"):
        read_measured(tmp_path / "m.xyz")


def test_a_gap_in_mm_is_one_that_a_case_reads(tmp_path: Path) -> None:
    x = np.linspace(0.0, 0.685, 30)
    gap = 0.012 * (x / 0.685) ** 2
    data = read_measured(table(tmp_path / "g.csv", "x [mm],gap [mm]", 1e3 * x, 1e3 * gap))
    assert is_close(data["gap0"], gap) and is_close(data["x"], x)
    written = write_all(data, tmp_path)
    assert [path.name for path in written] == ["measured.nc", "gap.csv"]
    assert is_close(read_gap_table(tmp_path / "gap.csv", 0.685)[1], gap)


def test_amplitude_and_phase_become_a_complex_response(tmp_path: Path) -> None:
    f, h = np.linspace(1.0, 20.0, 40), np.linspace(1.0, 20.0, 40) * np.exp(0.3j)
    heading = "frequency [Hz],tip amplitude [mm/N],tip phase [deg],tip coherence [1]"
    columns = f, abs(h), np.degrees(np.angle(h)), 0.0 * f + 0.9
    path = table(tmp_path / "h.csv", heading, *columns)
    data = read_measured(path)
    assert is_close(data["response"].sel(output="tip"), 1e-3 * h)
    assert is_close(data["coherence"].sel(output="tip"), np.full(f.size, 0.9))
    again = read_measured(write_measured(data, tmp_path / "measured.nc"))
    xr.testing.assert_allclose(again, data)
    assert again["response"].dtype.kind == "c"


# ---- universal files


@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("double", [True, False])
def test_universal_files(tmp_path: Path, binary: int, double: bool) -> None:
    if binary and not double:
        pytest.skip("pyuff writes binary data in double precision only")
    path = write_uff(
        tmp_path / "m.uff",
        uff_set("tip thick", 1e3 * THICK, binary=binary),
        uff_set("tip thin", 1e3 * THIN, binary=binary, rsp_node=2),
        double=double,
    )
    data = read_measured(path)
    assert data.sizes["time"] == N
    assert is_close(data["time"], TIME, 1e-5)  # the format has six digits for the step
    assert is_close(
        data["tip_displacement"], np.array([THICK, THIN]), 1e-10 if double else TEXT_DIGITS
    )


def trailing_blanks(content: bytes) -> bytes:
    return b"".join(line.ljust(90) + b"\n" for line in content.splitlines())


def windows_lines(content: bytes) -> bytes:
    return content.replace(b"\n", b"\r\n")


def fortran_exponents(content: bytes) -> bytes:
    head, body = content.split(b"\n")[:13], content.split(b"\n")[13:]
    return b"\n".join(head + [line.replace(b"e", b"D") for line in body])


def empty_lines(content: bytes) -> bytes:
    return content[:-7] + b"\n\n" + content[-7:] + b"\n"


@pytest.mark.parametrize("damage", [trailing_blanks, windows_lines, fortran_exponents, empty_lines])
@pytest.mark.parametrize("double", [True, False])
def test_what_text_sets_of_real_files_contain(
    tmp_path: Path, damage: Callable[[bytes], bytes], double: bool
) -> None:
    path = write_uff(tmp_path / "m.uff", uff_set("tip thin", 1e3 * THIN), double=double)
    path.write_bytes(damage(path.read_bytes()))
    assert is_close(read_measured(path)["tip_displacement"][0], THIN, TEXT_DIGITS)


@pytest.mark.parametrize("stray", [b"\n", b"\r\n"])
@pytest.mark.parametrize("is_before", [True, False])
@pytest.mark.parametrize("last", [0.001, np.frombuffer(b"\x00\x00\x00\x00\n\n\n?", "<f8")[0]])
def test_stray_line_ends_about_binary_data(
    tmp_path: Path, stray: bytes, is_before: bool, last: float
) -> None:
    values = 1e3 * np.r_[THIN[:-1], last]
    values[0] = np.frombuffer(b"\n\x00\x00\x00\x00\x00\xf0?", "<f8")[0]  # begins like a line end
    path = write_uff(tmp_path / "m.uff", uff_set("a", values, binary=1), uff_set("b", 1e3 * THICK))
    content, data = path.read_bytes(), values.astype("<f8").tobytes()
    assert data in content
    path.write_bytes(content.replace(data, stray + data if is_before else data + stray))
    measured = read_measured(path)
    assert is_close(measured["sensor_a"], 1e-3 * values) and is_close(
        measured["sensor_b"], THICK, 1e-9
    )
    assert "stray" in measured.attrs["notes"]


def test_binary_data_that_looks_like_the_end_of_a_set(tmp_path: Path) -> None:
    values = THIN.copy()
    values[100] = np.frombuffer(b"\n    -1\n", "<f8")[0]
    path = write_uff(tmp_path / "m.uff", uff_set("a", values, binary=1), uff_set("b", 1e3 * THICK))
    with pytest.raises(CaseError, match="set 1"):
        read_measured(path)


def test_units_and_positions_from_other_sets(tmp_path: Path) -> None:
    none = {"ordinate_axis_units_lab": "NONE"}
    path = tmp_path / "m.uff"
    write_uff(
        path,
        pyuff.prepare_151(model_name="m", description="d", db_app="a", program="p",
                          return_full_dict=True) | {"type": 151},
        pyuff.prepare_164(units_code=5, units_description="mm", temp_mode=1, length=1000.0,
                          force=1.0, temp=1.0, temp_offset=0.0),
        pyuff.prepare_15(node_nums=[1, 2], def_cs=[0, 0], disp_cs=[0, 0], color=[0, 0],
                         x=[120.0, 240.0], y=[0.0, 0.0], z=[0.0, 0.0]),
        uff_set("v2", 1e3 * THIN, rsp_node=2, ordinate_spec_data_type=11, **none),
        uff_set("v1", 1e3 * THICK, rsp_node=1, ordinate_spec_data_type=11, **none),
    )  # fmt: skip
    data = read_measured(path)
    assert is_close(data["sensor_v2"], THIN, 1e-9)
    assert data["channel_position"].to_numpy() == pytest.approx([0.24, 0.12])
    field = scan(data, "velocity")
    assert field.dims == ("time", "point")
    assert field["position"].to_numpy() == pytest.approx([0.12, 0.24])
    assert is_close(field[:, 0], THICK, 1e-9) and field.attrs["units"] == "m/s"
    with pytest.raises(CaseError, match="expected channels of strain"):
        scan(data, "strain")


def test_a_universal_file_without_units_asks_for_them(tmp_path: Path) -> None:
    record = uff_set("a", THIN, ordinate_axis_units_lab="NONE", ordinate_spec_data_type=12)
    path = write_uff(tmp_path / "m.uff", record)
    with pytest.raises(CaseError, match="no unit"):
        read_measured(path)
    data = read_measured(path, units="SI")
    assert is_close(data["sensor_a"], THIN, 1e-9) and data["sensor_a"].attrs["units"] == "m/s2"


def test_a_frequency_response_and_its_coherence(tmp_path: Path) -> None:
    f = np.arange(N) * 0.25
    h = (1.0 + 0.5j) * np.exp(0.01j * f)
    about = {"x": f, "abscissa_inc": 0.25, "abscissa_spec_data_type": 18}
    path = write_uff(
        tmp_path / "m.uff",
        uff_set("h", h, func_type=4, ordinate_axis_units_lab="mm", orddenom_axis_units_lab="N",
                orddenom_spec_data_type=13, **about),
        uff_set("h", 0.0 * f + 0.75, func_type=6, **about),
    )  # fmt: skip
    data = read_measured(path)
    assert is_close(data["response"].sel(output="h"), 1e-3 * h, 1e-9)
    assert is_close(data["coherence"].sel(output="h"), np.full(N, 0.75))
    assert is_close(data["frequency"], f) and data["response"].attrs["units"] == "m/N"


def test_sets_at_other_rates_are_interpolated_and_said_so(tmp_path: Path) -> None:
    slow = uff_set("slow", 1e3 * THIN[::2], x=TIME[::2], abscissa_inc=2.0 / RATE, rsp_node=2)
    data = read_measured(write_uff(tmp_path / "m.uff", uff_set("fast", 1e3 * THICK), slow))
    assert is_close(data["sensor_slow"], THIN, 1e-4)
    assert "interpolated" in "\n".join(lines(data))


def test_sets_of_other_lengths_keep_what_they_share(tmp_path: Path) -> None:
    some = slice(32, 97, 2)  # files hold their first time with six digits
    late = uff_set("late", 1e3 * THIN[some], x=TIME[some], abscissa_inc=2.0 / RATE,
                   abscissa_min=TIME[32], rsp_node=2)  # fmt: skip
    data = read_measured(write_uff(tmp_path / "m.uff", uff_set("fast", 1e3 * THICK), late))
    first, n = round(float(data["time"][0]) * RATE), data.sizes["time"]
    assert 32 <= first <= 33 and 96 <= first + n <= 97  # ends may differ in the seventh digit
    assert is_close(data["time"], TIME[first : first + n], 1e-5)
    assert is_close(data["sensor_fast"], THICK[first : first + n], 1e-4)


@pytest.mark.parametrize("keep", [0.4, 0.9])
@pytest.mark.parametrize("binary", [0, 1])
def test_files_that_are_cut_off_are_refused(tmp_path: Path, keep: float, binary: int) -> None:
    path = write_uff(tmp_path / "m.uff", uff_set("a", THIN, binary=binary))
    path.write_bytes(path.read_bytes()[: int(keep * path.stat().st_size)])
    with pytest.raises(CaseError, match=r"set 1 .*cut off"):
        read_measured(path)


# ---- MATLAB and NetCDF


def test_matlab_files(tmp_path: Path) -> None:
    savemat(
        tmp_path / "m.mat",
        {"t": TIME, "tip_thick": 1e3 * THICK, "laser": np.array([THICK, THIN]).T,
         "units": {"tip_thick": "mm", "laser": "m/s"}, "comment": "a test"},
    )  # fmt: skip
    data = read_measured(tmp_path / "m.mat")
    assert is_close(data["tip_displacement"].sel(lamina="thick"), THICK)
    assert is_close(data["sensor_laser_2"], THIN)


def test_matlab_structures_with_a_rate(tmp_path: Path) -> None:
    savemat(tmp_path / "m.mat", {"scope": {"fs": RATE, "thin": 1e3 * THIN}})
    data = read_measured(tmp_path / "m.mat", channels={"tip thin": "thin"}, units="mm")
    assert is_close(data["tip_displacement"][0], THIN) and is_close(data["time"], TIME)


def test_matlab_files_of_version_7_3(tmp_path: Path) -> None:
    path = tmp_path / "m.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in {"t": TIME[None, :], "thin": 1e3 * THIN[None, :]}.items():
            file.create_dataset(name, data=values).attrs["MATLAB_class"] = np.bytes_("double")
        scan_data = file.create_dataset("laser", data=np.array([THICK, THIN]))  # (n, 2) in MATLAB
        scan_data.attrs["MATLAB_class"] = np.bytes_("double")
        group = file.create_group("units")
        text = group.create_dataset("thin", data=np.array([[109], [109]], np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    data = read_measured(path, units="m")
    assert is_close(data["sensor_thin"], THIN)
    assert is_close(data["sensor_laser_1"], THICK)


def test_a_matlab_file_without_times_says_what_it_has(tmp_path: Path) -> None:
    savemat(tmp_path / "m.mat", {"y": THIN})
    with pytest.raises(CaseError, match=r"expected vectors beside a vector t or time.*found y"):
        read_measured(tmp_path / "m.mat")


def test_the_result_of_a_run_is_read_under_its_own_names(tmp_path: Path) -> None:
    history = synthetic_history(small_case())
    history.to_netcdf(tmp_path / "result.nc", engine="h5netcdf")
    data = read_measured(tmp_path / "result.nc")
    for name in ("tip_displacement", "tip_velocity", "base_displacement", "gap0"):
        np.testing.assert_array_equal(data[name], history[name])
        assert data[name].dims == history[name].dims


def test_other_netcdf_files(tmp_path: Path) -> None:
    content = xr.Dataset(
        {"w": (("time",), 1e3 * THIN, {"units": "mm"})}, {"time": ("time", TIME, {"units": "s"})}
    )
    content.to_netcdf(tmp_path / "m.nc", engine="scipy")
    data = read_measured(tmp_path / "m.nc", channels={"tip thin": "w"})
    assert is_close(data["tip_displacement"][0], THIN)


def test_several_files_become_one_dataset(tmp_path: Path) -> None:
    a = table(tmp_path / "a.csv", "t,tip thick [mm]", TIME, 1e3 * THICK)
    b = table(tmp_path / "b.csv", "t,tip thin [mm]", TIME, 1e3 * THIN)
    data = read_measured(a, b)
    assert is_close(data["tip_displacement"], np.array([THICK, THIN]))
    assert [row[0] for row in rows(data)] == ["tip thick", "tip thin"]
    again = read_measured(write_measured(data, tmp_path / "measured.nc"))
    xr.testing.assert_identical(again, data)


def test_the_ends_of_frequencies_and_places_are_told() -> None:
    data = xr.Dataset(coords={"frequency": [1.0, 2.5, 7.0], "x": [0.1, 0.2, 0.4]})
    assert list(lines(data)) == [
        "frequency: 3 values, 1 to 7 Hz",
        "x: 3 values, 0.1 to 0.4 m",
    ]


# ---- datasets


def channel(
    name: str,
    values: np.ndarray,
    unit: str = "mm",
    axis: str = "time",
    points: np.ndarray | None = None,
    **about: object,
) -> Channel:
    """Return a channel of 8 samples, or of more points."""
    si = unit_of(unit, name)
    points = 0.5 + 0.25 * np.arange(len(values)) if points is None else points
    return Channel(
        name=name, values=values * si.factor, axis=axis, points=points, si=si,
        source=f"file, {name}", **about,  # type: ignore[arg-type]
    )  # fmt: skip


A, B = 2.0 + np.sin(np.arange(8.0)), np.cos(3.0 * np.arange(8.0)) - 1.0


@pytest.mark.parametrize(
    ("name", "unit", "variable"),
    [
        ("tip a", "mm", "tip_displacement"), ("tip_a", "m/s", "tip_velocity"),
        ("tip a", "g", "sensor_tip_a"), ("tips", "mm", "sensor_tips"), ("Base", "mm",
        "base_displacement"), ("base", "m/s", "sensor_base"), ("Base_Displacement", "um",
        "base_displacement"), ("force", "N", "force"), ("force", "V", "sensor_force"),
        (" a b/c@0.1-d ", "N", "sensor_a_b_c@0.1-d"), ("sensor_a", "N", "sensor_a"),
    ],
)  # fmt: skip
def test_variables_of_histories(name: str, unit: str, variable: str) -> None:
    assert variable_of(channel(name, A, unit)) == variable


def test_messages_of_datasets_are_exact() -> None:
    a = channel("a", A)
    assert refusal(lambda: dataset([a, a])) == (
        "channel 'a': expected different names, given it twice: file, a and file, a; --channel "
        "NAME=… renames one"
    )
    late = channel("late", A, points=2.4 + 0.25 * np.arange(8))
    assert refusal(lambda: dataset([a, late])) == (
        "file, a and other channels: expected a common range of time, given none"
    )
    for unit, words in (("N", "force"), ("1", "quantity in 1")):
        gap = channel("gap", A, unit, "x")
        assert refusal(lambda gap=gap: dataset([gap])) == (
            f"file, gap: expected a gap in a unit of length over x, given a {words}"
        )
    for step in (0.99e-12, 1.01e9):
        wrong = channel("w", A, points=step * np.arange(8))
        assert refusal(lambda wrong=wrong: dataset([wrong])) == (
            "file, w: expected steps of time between 1e-12 and 1e+09 in SI units, given "
            f"{step:g}; is the unit right?"
        )
    for step in (1.01e-12, 0.99e9):
        assert dataset([channel("w", A, points=step * np.arange(8))]).sizes["time"] == 8
    assert refusal(read_measured) == "expected at least one file of measurements, given none"
    for rate in (0.0, -1.0, np.inf):
        told = f"--rate: expected a positive number of samples per second, given {rate:g}"
        assert refusal(lambda rate=rate: read_measured("a.csv", rate=rate)) == told
    assert refusal(lambda: read_measured("a.csv", rate=0.5)) == "a.csv: there is no such file"


def test_axes_within_a_millionth_of_a_step_are_the_same() -> None:
    first, points = channel("a", A), 0.5 + 0.25 * np.arange(8)
    for share, is_same in ((0.9, True), (1.1, False)):
        for k, sign in ((0, 1.0), (7, -1.0), (3, 1.0)):
            moved = points.copy()
            moved[k] += sign * share * EQUAL * 0.25
            notes = dataset([first, channel("b", B, points=moved)]).attrs["notes"]
            assert (notes == "") == is_same, (share, k)
    [note] = dataset([first, channel("b", B[:7], points=points[:7])]).attrs["notes"].splitlines()
    assert note == (
        "channels over different values of time: interpolated to a step of 0.25 from 0.5 to 2"
    )


def test_channels_are_interpolated_to_the_finest_step_that_all_have() -> None:
    """Cubics are exact by cubic splines; ends within a millionth of a step belong to the range."""

    def cubic(t: np.ndarray) -> np.ndarray:
        return 2.0 - t + 0.5 * t**3

    coarse, fine = 1.0 + 0.5 * np.arange(7), 0.4 + 0.2 * np.arange(15)
    for shift, n in ((0.9 * EQUAL * 0.2, 14 - 2), (1.1 * EQUAL * 0.2, 14 - 3)):
        moved = fine.copy()
        moved[3] -= shift  # 1 less a little, where the coarse one begins
        data = dataset([
            channel("a", cubic(coarse), "m", points=coarse),
            channel("b", 3.0 * cubic(moved), "m", points=moved),
        ])  # fmt: skip
        time = data["time"].to_numpy()
        assert time.size == n and time[-1] == pytest.approx(3.2)
        np.testing.assert_array_equal(time, moved[-n:])
        np.testing.assert_allclose(data["sensor_a"], cubic(np.maximum(time, 1.0)), rtol=1e-12)
        np.testing.assert_allclose(data["sensor_b"], 3.0 * cubic(time), rtol=1e-12)
    points = np.arange(8.0)
    for end, n in ((7.0 - EQUAL, 8), (7.0 - 2.0 * EQUAL, 7)):
        other = channel("b", B[:5], points=np.r_[0.0, 2.0, 4.0, 6.0, end])
        assert dataset([channel("a", A, points=points), other]).sizes["time"] == n
    other = channel("b", B, points=np.r_[6.0, 7.0, 8.2, np.arange(9.0, 14.0)])  # one step shared
    assert dataset([channel("a", A, points=points), other]).sizes["time"] == 2
    shared = coarse[1:3] + 1e-3  # half a second in common with b, more than its step
    data = dataset([channel("a", A[:3], points=np.r_[coarse[:2], 2.0]),
                    channel("b", B, points=shared[0] - 0.3 + 0.1 * np.arange(8))])  # fmt: skip
    assert data.sizes["time"] == 8


def test_scans_are_sorted_and_of_one_lamina() -> None:
    data = dataset([
        channel("c", A, "mm/s", position=0.3, lamina="low"),
        channel("a", B, "mm/s", position=0.1, lamina="up"),
        channel("b", A + B, "mm/s", position=0.2, lamina="low"),
        channel("d", A, "mm", position=0.05, lamina="low"), channel("e", A, "mm/s"),
        channel("h", A, "m/s", "frequency", position=0.4, kind="response"),
    ])  # fmt: skip
    field = scan(data, "velocity")
    assert field.name == "velocity" and field.attrs == {"units": "m/s", "long_name": "velocity"}
    assert field["channel"].to_numpy().tolist() == ["a", "b", "c"]
    assert field["lamina"].to_numpy().tolist() == ["up", "low", "low"]
    assert field["position"].to_numpy().tolist() == [0.1, 0.2, 0.3]
    np.testing.assert_allclose(field, 1e-3 * np.array([B, A + B, A]).T)
    low = scan(data, "velocity", "low")
    np.testing.assert_array_equal(low, field[:, 1:])
    assert refusal(lambda: scan(data, "displacement", "up")) == (
        "measurement: expected channels of displacement with a position on the lamina 'up', found "
        "none; --channel NAME=SOURCE:UNIT@POSITION/LAMINA gives one"
    )
    assert "position, found none" in refusal(lambda: scan(data, "strain"))


def test_assigned_channels() -> None:
    assert assigned(None) == {} and assigned({"a": "b"}) == {"a": "b"}
    assert assigned([" a = col2:mm", "b=c=d"]) == {"a": "col2:mm", "b": "c=d"}
    for text in ("a", "a=", "=b", " =b", "a= "):
        told = f"--channel: expected NAME=SOURCE, given {text!r}"
        assert refusal(lambda text=text: assigned([text])) == told
    told = "--channel: expected different names, given 'a' twice"
    assert refusal(lambda: assigned(["a=b", " a =c"])) == told


def test_measurements_come_back_from_their_files(tmp_path: Path) -> None:
    """Whatever the suffix; with assignments they are files like others."""
    data = dataset([channel("a", A), channel("h", A + 1j * B, "mm/N", "frequency")])
    for suffix in (".nc", ".nc4"):
        path = write_measured(data, tmp_path / f"m{suffix}")
        xr.testing.assert_identical(read_measured(path), data)
        assert read_measured(path)["response"].attrs == data["response"].attrs
    again = read_measured(path, channels={"b": "sensor_a:m"})
    np.testing.assert_allclose(again["sensor_b"], data["sensor_a"])
    plain = dataset([channel("a", A)])
    assert write_all(plain, tmp_path / "out") == [tmp_path / "out" / "measured.nc"]
    assert (tmp_path / "out" / "measured.nc").is_file()


def test_each_gap_has_a_table_of_its_own(tmp_path: Path) -> None:
    data = dataset([channel("gap a/b", A[:2], axis="x"), channel("gap c", B[:2], axis="x")])
    names = ["measured.nc", "gap-gap a_b.csv", "gap-gap c.csv"]
    assert [path.name for path in write_all(data, tmp_path)] == names
    text = (tmp_path / names[2]).read_text(encoding="utf-8")
    assert text == f"x [m],gap [m]\n0.5,0.0\n0.75,{float(data['gap0'][1, 1])!r}\n"
