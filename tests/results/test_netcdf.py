"""NetCDF files: what is written is read back, damage is seen, and no other file is read."""

from __future__ import annotations

import random
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from synthetic import small_case, synthetic_history

from delam_fem.api import CaseError, load_numbers, save_case, write_dataset
from delam_fem.results.netcdf import read_dataset


@pytest.fixture(scope="module")
def history() -> xr.Dataset:
    return synthetic_history(small_case()).isel(frame=slice(0, 2), time=slice(0, 40))


def test_a_dataset_is_read_back_as_it_was(tmp_path: Path, history: xr.Dataset) -> None:
    data = history.assign(flag=("event", history["event_node"].to_numpy() > 4)).assign_attrs(
        number=1.5, count=3, words=["one", "zwölf"], empty=""
    )
    dataset = read_dataset(write_dataset(data, tmp_path / "a.nc"))
    xr.testing.assert_identical(dataset, data)


@pytest.mark.slow
def test_no_changed_bit_changes_a_number(tmp_path: Path, history: xr.Dataset) -> None:
    content = write_dataset(history, tmp_path / "a.nc").read_bytes()
    rng = random.Random(50)
    refused = 0
    for _ in range(60):
        damaged = bytearray(content)
        damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        (tmp_path / "b.nc").write_bytes(damaged)
        try:
            xr.testing.assert_identical(read_dataset(tmp_path / "b.nc"), history)
        except CaseError as error:
            assert "b.nc" in str(error)
            refused += 1
    assert refused > 30  # most bits of the file are content


def test_every_attribute_and_name_counts(tmp_path: Path, history: xr.Dataset) -> None:
    write_dataset(history, tmp_path / "a.nc")
    for change in (
        lambda file: file["tip_displacement"].attrs.modify("units", "mm"),
        lambda file: file.attrs.modify("outcome", "diverged"),
        lambda file: file["lamina"].__setitem__(0, "other"),
        lambda file: file.__delitem__("energy_residual"),
        lambda file: file.move("event_impulse", "event_pulse"),
    ):
        (tmp_path / "b.nc").write_bytes((tmp_path / "a.nc").read_bytes())
        with h5py.File(tmp_path / "b.nc", "a") as file:
            change(file)
        with pytest.raises(CaseError, match=r"b\.nc.*digest"):
            read_dataset(tmp_path / "b.nc")


def secret_in(path: Path) -> Path:
    """Write a file of somebody else, 64 bytes long."""
    path.write_bytes(np.arange(8.0).tobytes())
    return path


@pytest.mark.parametrize("way", ["storage", "link", "virtual"])
def test_a_file_that_names_another_is_refused(tmp_path: Path, way: str) -> None:
    secret = secret_in(tmp_path / "secret")
    time = np.arange(8.0)
    path = tmp_path / "a.nc"
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["v"] = time
    with h5py.File(path, "w") as file:
        file["time"] = time
        if way == "storage":
            file.create_dataset("v", (8,), "f8", external=[(str(secret), 0, 64)])
        elif way == "link":
            file["v"] = h5py.ExternalLink("other.h5", "v")
        else:
            layout = h5py.VirtualLayout((8,), "f8")
            layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "v", (8,))
            file.create_virtual_dataset("v", layout)
    with pytest.raises(CaseError, match=r"a\.nc.*'v'.*another file"):
        read_dataset(path)


def test_a_loop_of_groups_ends(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.nc", "w") as file:
        file["a/b/c"] = file["/"]
    with pytest.raises(CaseError, match=r"a\.nc"):
        read_dataset(tmp_path / "a.nc")


WRONG = {
    "no lamina": lambda h: h.drop_vars("lamina"),
    "no moment": lambda h: h.drop_vars("moment"),
    "no x": lambda h: h.drop_vars("x"),
    "one axis less": lambda h: h.assign(moment=h["moment"][0]),
    "swapped axes": lambda h: h.assign(tip_velocity=h["tip_velocity"].T),
    "words for numbers": lambda h: h.assign(energy_residual=("period", ["a"] * h.sizes["period"])),
    "numbers for names": lambda h: h.assign_coords(lamina=[1.0, 2.0]),
    "twice the same name": lambda h: h.assign_coords(lamina=["thick", "thick"]),
    "other laminae": lambda h: h.assign_coords(lamina=["a", "b"]),
    "not a number": lambda h: h.assign(base_displacement=h["base_displacement"] * np.nan),
    "infinite": lambda h: h.assign(gap0=h["gap0"] * np.inf),
    "a node too far": lambda h: h.assign(tip_node=((), h.sizes["node"])),
    "half a node": lambda h: h.assign(event_node=h["event_node"] + 0.5),
    "a node before the first": lambda h: h.assign(event_node=h["event_node"] - 10),
    "time that stands": lambda h: h.assign_coords(time=0.0 * h["time"]),
    "no time": lambda h: h.isel(time=slice(0, 0)),
    "an unknown variable": lambda h: h.assign(other=h["gap0"]),
    "an unknown outcome": lambda h: h.assign_attrs(outcome="fine"),
    "a number as title": lambda h: h.assign_attrs(title=3),
    "a sensor without a unit": lambda h: h.assign(sensor_a=("time", h["time"].to_numpy())),
    "a third lamina": lambda h: h.reindex(lamina=["thick", "thin", "c"], fill_value=0.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_result_of_a_run_is_refused(
    tmp_path: Path, history: xr.Dataset, name: str
) -> None:
    save_case(small_case(), tmp_path)
    write_dataset(history, tmp_path / "result.nc")
    load_numbers(tmp_path)
    write_dataset(WRONG[name](history), tmp_path / "result.nc")
    with pytest.raises(CaseError, match=r"result\.nc"):
        load_numbers(tmp_path)


SUMMARIES = (
    "[]", "3", "null", "{", '"a"', "[" * 5000, '{"tip_min": 3}', '{"tip_min": ["a", "b"]}',
    '{"tip_min": [1, 2, 3]}', '{"settled": 3}', '{"settling": []}', '{"settling": {"decay": []}}',
    '{"warnings": "a"}',
    '{"warnings": null}', '{"warnings": [1]}', '{"intervals": {"tip_min": 3}}', '{"steps": NaN}',
    '{"steps": 1e999}', '{"periodicity": "two"}', '{"strobe_scatters": []}', '{"outcome": {}}',
)  # fmt: skip


@pytest.fixture(scope="module")
def of_run(tmp_path_factory: pytest.TempPathFactory, history: xr.Dataset) -> Path:
    """Return a folder with a case and its result."""
    folder = tmp_path_factory.mktemp("run")
    save_case(small_case(), folder)
    write_dataset(history, folder / "result.nc")
    load_numbers(folder)
    return folder


@pytest.mark.parametrize("text", SUMMARIES)
def test_a_summary_of_another_form_is_refused(of_run: Path, text: str) -> None:
    (of_run / "summary.json").write_text(text)
    with pytest.raises(CaseError, match=r"summary\.json"):
        load_numbers(of_run)


def test_a_text_that_is_no_text_is_refused(tmp_path: Path, history: xr.Dataset) -> None:
    write_dataset(history, tmp_path / "a.nc")
    with h5py.File(tmp_path / "a.nc", "a") as file:
        file.attrs.create("title", np.bytes_(b"\xff\xfe"), dtype=h5py.string_dtype("utf-8", 2))
    with pytest.raises(CaseError, match=r"a\.nc"):
        read_dataset(tmp_path / "a.nc")
