"""A full disk, made by a small file system in memory, which only root can mount."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import xarray as xr
from attack.processes import (
    CASE,
    command,
    ended,
    history,
    periods_kept,
    require_none_left,
    require_whole_files,
    start,
    sweep_text,
)

import delam_fem as df

SIZES = (4, 40, 80, 120, 200, 300, 450, 600, 800, 1200)
"""Sizes of the disk [kB], from one that takes nothing to one that takes nearly all of a run."""
ENOUGH = 100_000
ROOM_FOR_THE_CHECKPOINT = 300

Resize = Callable[[int], None]
"""Function that gives the disk another size [kB]."""


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[tuple[Path, Resize]]:
    """Mount a disk; skip the test where that is not possible."""
    folder = tmp_path / "disk"
    folder.mkdir()
    line = ["mount", "-t", "tmpfs", "-o", "size=4k", "tmpfs", str(folder)]
    try:
        done = subprocess.run(line, capture_output=True, text=True)
    except FileNotFoundError:
        pytest.skip("needs mount")
    if done.returncode:
        pytest.skip(f"needs the right to mount a file system: {done.stderr.strip()}")

    def resize(size: int) -> None:
        options = f"remount,size={size}k"
        subprocess.run(["mount", "-o", options, str(folder)], check=True, capture_output=True)

    yield folder, resize
    subprocess.run(["umount", "-l", str(folder)], check=True)


def require_few_lines(errors: str, most: int) -> None:
    """Fail if a command said more than it should, or spoke of its inside."""
    lines = errors.splitlines()
    assert 0 < len(lines) <= most, errors
    for word in ("Traceback", "HDF5", "PETSC", "vtk"):
        assert word not in errors, errors


@pytest.mark.slow
@pytest.mark.parametrize(
    "size",
    [
        pytest.param(n, marks=() if n == ROOM_FOR_THE_CHECKPOINT else pytest.mark.nightly)
        for n in SIZES
    ],
)
def test_a_run_on_a_full_disk_is_finished_later(
    size: int, disk: tuple[Path, Resize], tmp_path: Path
) -> None:
    folder, resize = disk
    resize(size)
    line = command(
        "run", "paper", "-o", folder / "run", "--checkpoint-seconds=0.2", "-q", "--yes",
        keys=CASE,
    )  # fmt: skip
    status, errors = ended(line)
    assert status == 1, errors
    require_few_lines(errors, most=40 if size < ROOM_FOR_THE_CHECKPOINT else 3)
    require_whole_files(folder)
    n_kept = periods_kept(folder / "run")
    assert n_kept == CASE["time.periods"] or size < ROOM_FOR_THE_CHECKPOINT
    resize(ENOUGH)
    case = df.preset("paper", CASE)
    if size == ROOM_FOR_THE_CHECKPOINT:
        df.run(case, directory=folder / "run", resume=True).save_numbers(folder / "run")
    else:
        status, errors = ended([*line, "--resume" if n_kept else "--overwrite"])
        assert (status, errors) == (0, "")
        assert not (folder / "run" / "checkpoint.npz").exists()
    xr.testing.assert_equal(history(folder / "run"), df.run(case).history)


@pytest.mark.nightly
@pytest.mark.parametrize("size", [8, 40, 100, 200, 400])
def test_a_sweep_on_a_full_disk_is_finished_later(
    size: int, disk: tuple[Path, Resize], tmp_path: Path
) -> None:
    folder, resize = disk
    resize(size)
    (tmp_path / "s.toml").write_text(sweep_text(periods=8, count=100))
    sweep = tmp_path / "s.toml"
    line = command("sweep", sweep, "-o", folder / "s", "-j", 2, "-q", "--yes")
    process = start(line)
    _, errors = process.communicate(timeout=600)
    assert process.returncode in (0, 1), errors
    require_none_left(process.pid)
    if process.returncode:
        require_few_lines(errors, most=3)
    resize(ENOUGH)
    status, errors = ended([*line, "--resume"])
    assert status == 0, errors
    status, errors = ended(command("sweep", sweep, "-o", tmp_path / "whole", "-j", 2, "-q"))
    assert status == 0, errors
    pair = [
        xr.load_dataset(p / "sweep.nc", engine="h5netcdf")
        for p in (folder / "s", tmp_path / "whole")
    ]
    assert pair[0].drop_attrs().identical(pair[1].drop_attrs())
