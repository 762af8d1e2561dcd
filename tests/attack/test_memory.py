"""Small files that claim or unpack to gigabytes are refused, and say how much they would take."""

from __future__ import annotations

import base64
import io
import os
import resource
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from project import peak_memory
from scipy.io import savemat
from support import invoke

from delam_fem import read_measured
from delam_fem.api import CaseError, read_arrays, read_toml
from delam_fem.model.mesh import read_file
from delam_fem.system.footprint import VARIABLE, bounded, require_room

MOST_BYTES = 1_000_000_000
"""Memory that a process may take at most."""


def npz(path: Path) -> None:
    """Write an archive of some kB whose zeros are a gigabyte."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": (2**27,)}
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file, file.open("a.npy", "w") as one:
        one.write(head.getvalue())
        for _ in range(2**10):
            one.write(bytes(2**20))


def mat(path: Path) -> None:
    """Write a MATLAB file whose compressed matrix has a gigabyte of zeros."""
    small = io.BytesIO()
    savemat(small, {"a": np.zeros((2, 2))})
    n = 2**27
    flags = struct.pack("<IIII", 6, 8, 6, 0)
    shape = struct.pack("<IIii", 5, 8, 1, n)
    name = struct.pack("<HH4s", 1, 1, b"a")
    data = struct.pack("<II", 9, 8 * n)
    head = flags + shape + name + data
    packer = zlib.compressobj(9)
    packed = packer.compress(struct.pack("<II", 14, len(head) + 8 * n) + head)
    for _ in range(2**10):
        packed += packer.compress(bytes(2**20))
    packed += packer.flush()
    path.write_bytes(small.getvalue()[:128] + struct.pack("<II", 15, len(packed)) + packed)


def hdf5(path: Path) -> None:
    """Write a NetCDF file that claims a terabyte, none of which is there."""
    with h5py.File(path, "w") as file:
        file.create_dataset("a", (2**37,), "f8", chunks=(2**16,))


def vtu(path: Path) -> None:
    """Write a mesh of 1 MB whose points unpack to a gigabyte."""
    block = zlib.compress(bytes(2**20), 9)
    n = 2**10
    header = struct.pack(f"<{3 + n}I", n, 2**20, 0, *[len(block)] * n)
    text = base64.b64encode(header).decode() + base64.b64encode(block * n).decode()
    path.write_text(
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian" '
        'compressor="vtkZLibDataCompressor"><UnstructuredGrid><Piece NumberOfPoints="44739242" '
        'NumberOfCells="0"><Points><DataArray type="Float64" NumberOfComponents="3" '
        f'format="binary">{text}</DataArray></Points></Piece></UnstructuredGrid></VTKFile>'
    )


def toml(path: Path) -> None:
    """Write a case of 9 MB in many nested tables."""
    path.write_text("".join(f"[t{k}.a.b.c.d.e.f]\n" for k in range(450_000)))


KINDS: dict[str, tuple[str, Callable[[Path], None], Callable[[Path], object]]] = {
    "npz": ("a.npz", npz, read_arrays),
    "mat": ("a.mat", mat, read_measured),
    "hdf5": ("a.nc", hdf5, read_measured),
    "mat of HDF5": ("b.mat", hdf5, read_measured),
    "vtu": ("a.vtu", vtu, read_file),
    "toml": ("a.toml", toml, read_toml),
}


def attempt(name: str, folder: Path) -> None:
    """Read a file of some kind; print its size, the largest memory, and what is said."""
    file, write, read = KINDS[name]
    path = folder / file
    write(path)
    try:
        read(path)
        said = "accepted"
    except ValueError as error:
        said = str(error)
    print(path.stat().st_size, peak_memory(), said, sep="\n")


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_a_small_file_takes_no_gigabyte(tmp_path: Path, name: str) -> None:
    done = subprocess.run(
        [sys.executable, __file__, name, str(tmp_path)],
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
        capture_output=True, text=True, timeout=600, check=True,
    )  # fmt: skip
    size, peak, *said = done.stdout.splitlines()
    assert int(size) < 10_000_000
    assert int(peak) < MOST_BYTES
    message = "\n".join(said)
    assert "GB" in message and "--memory" in message and VARIABLE in message


def test_the_limit_is_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"1")
    with pytest.raises(CaseError, match="--memory"):
        require_room(path, 4e8)
    monkeypatch.setenv(VARIABLE, "0.5")
    require_room(path, 4e8)
    monkeypatch.setenv(VARIABLE, "much")
    with pytest.raises(CaseError, match="much"):
        require_room(path, 4e8)


def test_a_large_file_is_read_without_asking(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with path.open("wb") as file:
        file.truncate(300_000_000)
    require_room(path, 550e6)
    with pytest.raises(CaseError, match=r"0\.7"):
        require_room(path, 700e6)


@pytest.mark.slow
def test_the_bound_ends_with_the_block(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"1")
    before = resource.getrlimit(resource.RLIMIT_AS)
    with pytest.raises(CaseError, match="memory"), bounded(path):
        with bounded(path):
            bytearray(2_000_000_000)
    assert resource.getrlimit(resource.RLIMIT_AS) == before
    bytearray(2_000_000_000)


def test_the_command_takes_the_option(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "0.2")  # is put back
    hdf5(tmp_path / "a.nc")
    done = invoke("--memory", "0.3", "measure", "read", str(tmp_path / "a.nc"))
    assert done.exit_code == 2 and "0.3 GB" in done.output


if __name__ == "__main__":
    attempt(sys.argv[1], Path(sys.argv[2]))
