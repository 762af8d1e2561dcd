"""Files and folders appear under their names when they are complete, or not at all."""

import errno
import resource
import signal
from pathlib import Path

import h5py
import numpy as np
import pytest

from delam_fem.api import atomic, atomic_file, write_text


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_file_appears_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "numbers.npz"
    with atomic(path) as temporary:
        temporary.write_text("new")
        assert not path.exists()
        assert (temporary.parent, temporary.suffix) == (tmp_path, ".npz")
    assert path.read_text() == "new"
    assert names(tmp_path) == {"numbers.npz"}


def test_a_file_of_the_user_is_no_temporary_one(tmp_path: Path) -> None:
    user_file = tmp_path / "part-table.csv"
    user_file.write_text("mine")
    write_text(tmp_path / "table.csv", "new")
    assert user_file.read_text() == "mine"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_failure_keeps_the_earlier_file_and_leaves_no_other(
    error: type[BaseException], tmp_path: Path
) -> None:
    path = write_text(tmp_path / "table.csv", "earlier")
    with pytest.raises(error), atomic(path) as temporary:
        temporary.write_text("half")
        raise error
    assert path.read_text() == "earlier"
    assert names(tmp_path) == {"table.csv"}


def test_a_folder_replaces_an_earlier_one(tmp_path: Path) -> None:
    path = tmp_path / "fields.bp"
    for name in ("first", "second"):
        with atomic(path) as temporary:
            temporary.mkdir()
            (temporary / name).touch()
    assert names(path) == {"second"}
    assert names(tmp_path) == {"fields.bp"}


def test_a_folder_of_a_block_that_fails_is_removed(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no"), atomic(tmp_path / "fields.bp") as temporary:
        temporary.mkdir()
        (temporary / "half").touch()
        raise ValueError("no")
    assert names(tmp_path) == set()


def test_what_a_killed_process_left_is_overwritten(tmp_path: Path) -> None:
    with atomic(tmp_path / "fields.bp") as temporary:
        temporary.mkdir()
    left = temporary
    left.mkdir()
    (left / "half").touch()
    with atomic(tmp_path / "fields.bp") as temporary:
        temporary.mkdir()
    assert names(tmp_path / "fields.bp") == set()


def test_a_block_that_writes_nothing_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"could not be written.*x\.vtu"), atomic(tmp_path / "x.vtu"):
        pass


def test_text_is_utf8_and_its_folder_is_made(tmp_path: Path) -> None:
    path = write_text(tmp_path / "new" / "folder" / "a.txt", "µ\n")
    assert path.read_bytes() == b"\xc2\xb5\n"


def test_a_file_takes_everything_and_says_what_failed(tmp_path: Path) -> None:
    """HDF5 must not see the failure; the user must."""
    path = write_text(tmp_path / "data.nc", "earlier")
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limit[1]))
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        with pytest.raises(OSError, match=r"data\.nc") as caught, atomic_file(path) as file:
            assert file.write(bytes(600)) == 600
            assert file.write(bytes(600)) == 600  # 400 of them are on the disk
            assert file.error is not None
            assert file.truncate(5000) == 5000
            file.seek(900)
            assert file.read(200) == bytes(200)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        signal.signal(signal.SIGXFSZ, before)
    assert caught.value.errno == errno.EFBIG
    assert path.read_text() == "earlier"
    assert names(tmp_path) == {"data.nc"}


def test_hdf5_writes_through_such_a_file(tmp_path: Path) -> None:
    with atomic_file(tmp_path / "a.h5") as temporary, h5py.File(temporary, "w") as file:
        file["x"] = np.arange(1000.0)
    with h5py.File(tmp_path / "a.h5") as file:
        assert np.array_equal(file["x"], np.arange(1000.0))


def test_an_error_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"No space.*result\.nc"), atomic(tmp_path / "result.nc"):
        raise OSError(errno.ENOSPC, "No space left on device")
