"""Files that are whole or not there, numbers for JSON, and folders that one process has."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support import refusal

from delam_fem.api import (
    atomic,
    atomic_file,
    json_ready,
    read_arrays,
    require,
    write_arrays,
    write_json,
    write_text,
)
from delam_fem.system.errors import require_number
from delam_fem.system.files import DiskFile, claimed
from delam_fem.system.written import OUTPUTS, PREFIX


def test_numbers_are_made_ready_for_json(tmp_path: Path) -> None:
    content = {
        1: np.float64(1.23456789), "n": np.int64(3), "b": np.bool_(True), "t": "a",
        "none": None, "x": (np.nan, -np.inf, 2.0), "a": np.array([[1.0, np.inf], [0.25, 2.0]]),
    }  # fmt: skip
    assert json_ready(content) == {
        "1": 1.23456789, "n": 3, "b": True, "t": "a", "none": None, "x": [None, None, 2.0],
        "a": [[1.0, None], [0.25, 2.0]],
    }  # fmt: skip
    assert json_ready({"x": [123456.0, 1e-9 / 3.0, 7]}, 3) == {"x": [123000.0, 3.33e-10, 7]}
    path = write_json(tmp_path / "a" / "b.json", {"x": np.array([1.0])})
    assert path.read_text() == '{\n  "x": [\n    1.0\n  ]\n}\n'
    assert json.loads(path.read_text()) == {"x": [1.0]}


def test_a_file_is_whole_or_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.txt"
    with atomic(path) as temporary:
        assert temporary.parent == path.parent and temporary.name.startswith(PREFIX)
        assert temporary.suffix == ".txt"
        temporary.write_text("one")
    assert path.read_text() == "one" and not temporary.exists()
    with pytest.raises(OSError) as error, atomic(path):
        pass
    assert (error.value.strerror, error.value.filename) == (
        "could not be written; is the disk full?", str(path),
    )  # fmt: skip
    with pytest.raises(ValueError, match="why"), atomic(path) as temporary:
        temporary.write_text("two")
        raise ValueError("why")
    assert path.read_text() == "one" and list(path.parent.iterdir()) == [path]
    with pytest.raises(OSError) as error, atomic(path) as temporary:
        raise OSError(28, "full", str(temporary))
    assert (error.value.errno, error.value.filename) == (28, str(path))
    with pytest.raises(OSError) as error, atomic(path):
        raise OSError(28, "full", "other")
    assert error.value.filename == "other"
    write_text(path, "three ü")
    assert path.read_bytes() == "three ü".encode()


def test_a_folder_takes_the_place_of_another(tmp_path: Path) -> None:
    path = tmp_path / "d"
    for name in ("a", "b"):
        with atomic(path) as temporary:
            temporary.mkdir()
            (temporary / name).touch()
        assert [file.name for file in path.iterdir()] == [name]


def test_after_a_failure_a_file_takes_everything_and_stores_nothing(tmp_path: Path) -> None:
    path = tmp_path / "f"
    with DiskFile(path, "w+") as file:
        assert file.write(b"abcdef") == 6 and file.truncate(4) == 4
        file.error = OSError(28, "full")
        assert file.write(np.arange(3)) == 24 and file.truncate(9) == 9
        assert file.truncate() == 0
        file.seek(2)
        buffer = bytearray(b"xxxxxx")
        assert file.readinto(buffer) == 6
        assert bytes(buffer) == b"cd\x00\x00\x00\x00"
        file.error = None
        file.seek(2)
        assert file.readinto(bytearray(6)) == 2
    assert path.read_bytes() == b"abcd"
    with pytest.raises(OSError) as error, atomic_file(path) as target:
        target.error = OSError(28, "full")
    assert error.value.filename == str(path) and path.read_bytes() == b"abcd"


def test_archives_are_read_back_or_refused(tmp_path: Path) -> None:
    path, arrays = tmp_path / "a.npz", {"b": np.arange(6).reshape(2, 3), "a": np.array("text")}
    write_arrays(path, arrays)
    loaded = read_arrays(path)
    assert set(loaded) == {"a", "b"} and str(loaded["a"]) == "text"
    np.testing.assert_array_equal(loaded["b"], arrays["b"])
    with np.load(path) as archive:
        content = dict(archive)
    b = arrays["b"]
    for change in ({"b": b + 1}, {"b": b.reshape(3, 2)}, {"b": b + 0.0}, {"c": np.zeros(1)}):
        np.savez(path, **content | change)
        with pytest.raises(ValueError, match=r"^changed after it was written$"):
            read_arrays(path)
    np.savez(path, b=arrays["b"])
    with pytest.raises(ValueError, match="digest"):
        read_arrays(path)
    path.write_bytes(b"PK" + b"\n" * 200)
    with pytest.raises(ValueError) as error:
        read_arrays(path)
    assert 0 < len(str(error.value)) <= 80 and "\n" not in str(error.value)


def test_a_folder_with_other_files_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "d"
    folder.mkdir()
    case_file = folder / "case_a.toml"
    case_file.touch()
    (folder / ".hidden").touch()
    with claimed(folder, inputs=[case_file]) as claimed_folder:
        assert claimed_folder == folder
    for names, told in ((["z", "y"], "y, z"), (["z", "y", "x"], "x, y, z"),
                        (["z", "y", "x", "w"], "w, x, y …")):  # fmt: skip
        for name in names:
            (folder / name).touch()
        text = refusal(lambda: claimed(folder, inputs=[case_file]).__enter__())
        assert text == (
            f"output folder {folder}: is not empty ({told}); choose another with -o DIR, go on "
            "with --resume, or replace what is there with --overwrite"
        )
    for options in ({"may_hold_results": True}, {"is_shared": True}):
        with claimed(folder, **options):
            pass


def test_outputs_replace_no_inputs(tmp_path: Path) -> None:
    for name in sorted(OUTPUTS):
        path = tmp_path / name / "inner" if name in ("figures", "points") else tmp_path / name
        text = refusal(lambda path=path: claimed(tmp_path, inputs=[path]).__enter__())
        assert text == (
            f"output folder {tmp_path}: the results would replace {path}, which the case reads; "
            "choose another folder with -o DIR, or rename the file"
        )
    with claimed(tmp_path / "new" / "inner", inputs=[tmp_path / "result.nc"]):
        pass
    assert not (tmp_path / "new").exists()  # nothing was written
    with claimed(tmp_path / "new" / "inner") as folder:
        (folder / "x").touch()
    assert (tmp_path / "new" / "inner" / "x").is_file()


def test_one_process_has_a_folder_and_the_commands_within_it(tmp_path: Path) -> None:
    import fcntl
    import os

    with claimed(tmp_path), claimed(tmp_path / "." / ""):
        pass
    handle = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    try:
        assert refusal(lambda: claimed(tmp_path).__enter__()) == (
            f"output folder {tmp_path}: another process is writing there; wait for it, or choose "
            "another with -o DIR"
        )
        with claimed(tmp_path, is_shared=True):
            pass
    finally:
        os.close(handle)
    with claimed(tmp_path):
        pass


def test_requirements_name_what_was_given() -> None:
    require(True, "a", "b", 1)
    assert refusal(lambda: require(False, "a", "b", "c")) == "a: expected b, given 'c'"
    for value in (0.0, 5.0, 1e300):
        require_number("n", value)
    require_number("n", 2.0, least=2.0, most=2.0)
    assert refusal(lambda: require_number("n", -1e-9)) == (
        "n: expected a number from 0 or more, given -1e-09"
    )
    for value in (1.9, 3.1):
        told = f"n: expected a number from 2 to 3, given {value}"
        assert refusal(lambda value=value: require_number("n", value, least=2.0, most=3.0)) == told
    assert "given inf" in refusal(lambda: require_number("n", float("inf")))
