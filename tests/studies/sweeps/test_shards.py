"""Shards and their merge: who has which point, kills, duplicates, missing points, equal bytes."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from project import ROOT
from typer.testing import CliRunner

from delam_fem import Sweep, load_sweep, run_sweep
from delam_fem.api import CaseError
from delam_fem.cli.app import app
from delam_fem.studies.sweeps.dataset import merge_sweep
from delam_fem.studies.sweeps.grid import sweep_of
from delam_fem.studies.sweeps.journal import Journal
from delam_fem.studies.sweeps.point import Chunk, ChunkResult, Point
from delam_fem.studies.sweeps.run import run_shard, share_size
from delam_fem.studies.sweeps.schedule import WHOLE, Shard, owners, parse_shard

TINY = """
base = "paper"
{more}
[set]
mesh.elements = 1
time.steps_per_period = 4
time.periods = 1
output.window_periods = 1
output.fields_per_period = 0
contact.law = "none"
[[axis]]
key = "excitation.amplitude"
start = 0.001
stop = 0.002
count = {count}
[[axis]]
key = "contact.restitution"
values = [0.1, 0.2, 0.3]
[record]
summary = false
strobes = 1
"""
SECONDS = 120.0
"""Time after which a process counts as hanging [s]."""
FILES = ("sweep.nc", "case.toml", "sweep.toml", "report.html")
"""What is equal byte by byte, however the points were computed."""


def tiny(folder: Path, count: int, more: str = "") -> Path:
    path = folder / "tiny.toml"
    path.write_text(TINY.format(count=count, more=more))
    return path


def sweep(**keys: object) -> Sweep:
    small = {"mesh.elements": 1, "time.steps_per_period": 40, "time.periods": 4}
    data = {"name": "s", "base": "paper", "set": small | {"output.fields_per_period": 0}}
    amplitude = {"key": "excitation.amplitude", "start": 1e-3, "stop": 3e-3, "count": 9}
    law = {"key": "contact.law", "values": ["none", "newton", "penalty"]}
    return sweep_of({**data, "axis": [amplitude, law], **keys})


@pytest.mark.parametrize(("count", "of"), [(0, 3), (1, 2), (5, 7), (1000, 16), (999, 2)])
def test_every_point_has_one_shard_and_shards_are_even(count: int, of: int) -> None:
    shares = [np.asarray(Shard(k, of).items(count)) for k in range(1, of + 1)]
    assert sorted(np.concatenate(shares).tolist()) == list(range(count))
    assert max(s.size for s in shares) - min(s.size for s in shares) <= 1
    assert all((np.diff(share) > 0).all() for share in shares)
    for k, share in enumerate(shares, start=1):
        assert (owners(share, of) == k).all()


def test_shares_stay_the_same_for_ever() -> None:
    assert np.asarray(Shard(2, 5).items(40)).tolist() == SHARE
    assert np.asarray(Shard(1, 1).items(4)).tolist() == [0, 1, 2, 3]


SHARE = [1, 6, 10, 15, 23, 26, 34, 36]
"""The second of five shares of 40 points. Journals of shards on disk depend on it."""


@pytest.mark.parametrize("inner", [15, 16, 17, 32])
def test_a_shard_gets_all_values_of_an_inner_axis_alike(inner: int) -> None:
    """Interleaving alone would give a shard of 16 the same of 16 values again and again."""
    values = np.asarray(Shard(3, 16).items(300 * inner)) % inner
    assert np.bincount(values, minlength=inner).max() < 3 * values.size / inner


def test_tracks_stay_whole() -> None:
    made = sweep(order="both")
    assert len(made.tracks) == 6
    sizes = [share_size(made, Shard(k, 4)) for k in range(1, 5)]
    assert sorted(sizes) == [9, 9, 18, 18]
    assert share_size(sweep(), Shard(1, 1)) == 27


@pytest.mark.parametrize("text", ["0/3", "4/3", "1", "a/b", "1/2/3", "-1/2", "1/0", "1/1000000"])
def test_a_bad_shard_is_refused(text: str) -> None:
    with pytest.raises(CaseError, match=r"shard: .*given '"):
        parse_shard(text)


def test_a_shard_is_read() -> None:
    assert parse_shard("3/16") == Shard(3, 16)
    assert parse_shard("1/1") == WHOLE and WHOLE.is_whole


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name in FILES}


@pytest.mark.slow
@pytest.mark.parametrize("order", ["independent", "up", "both"])
def test_shards_merge_to_the_bytes_of_one_run(tmp_path: Path, order: str) -> None:
    made = sweep(order=order)
    run_sweep(made, tmp_path / "one", "serial").close()
    for k in (2, 3, 1):
        result = run_shard(made, tmp_path / "many", Shard(k, 3), "serial")
        assert result.n_done == result.n_points == share_size(made, Shard(k, 3))
    merge_sweep(made, tmp_path / "many").close()
    assert contents(tmp_path / "many") == contents(tmp_path / "one")
    assert not (tmp_path / "many" / "sweep.journal").exists()
    again = run_shard(made, tmp_path / "many", Shard(1, 3), "serial", resume=True)
    assert again.n_done == again.n_points  # a shard that is started again after the merge


def test_missing_points_are_told_by_shard(tmp_path: Path) -> None:
    made = sweep()
    for k in (1, 3):
        run_shard(made, tmp_path, Shard(k, 4), "serial")
    with pytest.raises(CaseError, match=r"14 points are missing: 7 of shard 2/4, 7 of shard 4/4;"):
        merge_sweep(made, tmp_path)
    data = merge_sweep(made, tmp_path, is_partial=True)
    assert (data.attrs["n_missing"], data.attrs["outcome"]) == (14, "interrupted")
    is_there = np.zeros(27, dtype=np.bool_)
    for k in (1, 3):
        is_there[Shard(k, 4).items(27)] = True
    assert ((data.outcome.to_numpy().ravel() == "completed") == is_there).all()
    assert (np.isfinite(data.tip_min[..., 0].to_numpy().ravel()) == is_there).all()
    data.close()
    run_sweep(made, tmp_path, "serial", resume=True).close()  # computes what the shards have not
    run_sweep(made, tmp_path / "one", "serial").close()
    assert contents(tmp_path) == contents(tmp_path / "one")


def test_missing_tracks_are_told_by_shard(tmp_path: Path) -> None:
    made = sweep(order="up")
    run_shard(made, tmp_path, Shard(1, 2), "serial")
    left = 27 - share_size(made, Shard(1, 2))
    with pytest.raises(CaseError, match=rf"{left} points are missing: {left} of shard 2/2;"):
        merge_sweep(made, tmp_path)


def test_there_is_nothing_to_merge(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=r"has no journal of a sweep; .* --shard K/N"):
        merge_sweep(sweep(), tmp_path)


def added(path: Path, row: float, outcome: str = "completed") -> None:
    """Add point 0 to a shard's journal, as another process would."""
    with Journal(path, "s", resume=True, shard=Shard(1, 2)) as journal:
        values = np.array([row, np.nan]) if outcome == "completed" else None
        error = "" if values is not None else "the worker process died"
        points = (Point(0, outcome, error, values), Point(1, "failed", "no", None))
        journal.add([ChunkResult(Chunk(-1, (0, 1)), points, None, 1.0, 0.0)])


@pytest.mark.parametrize(
    ("second", "n_disagreeing"), [((1.0, "completed"), 0), ((2.0, "completed"), 1)]
)
def test_a_point_that_was_computed_twice_is_there_once(
    tmp_path: Path, second: tuple[float, str], n_disagreeing: int
) -> None:
    path = tmp_path / "sweep.journal"
    added(path, 1.0)
    added(path, *second)
    assert len(list(path.glob("*.points"))) == 2
    with Journal(path, "s", resume=True) as journal, journal.merged() as merged:
        assert merged.n_disagreeing == n_disagreeing
        block = merged.block(0, 10, 2)
        assert block.numbers.tolist() == [0, 1]
        assert block.rows[0, 0] == 1.0 and np.isnan(block.rows[1]).all()
        assert block.errors == {1: "no"}
        assert merged.counts() == {"completed": 1, "diverged": 0, "failed": 1}


def test_a_result_is_preferred_to_a_dead_worker(tmp_path: Path) -> None:
    path = tmp_path / "sweep.journal"
    added(path, 0.0, "failed")
    added(path, 7.0)
    with Journal(path, "s", resume=True) as journal, journal.merged() as merged:
        assert merged.block(0, 1, 2).rows[0, 0] == 7.0
        assert merged.n_disagreeing == 1


def test_two_processes_on_one_shard_do_no_harm(tmp_path: Path) -> None:
    made, shard = sweep(), Shard(1, 2)
    path = tmp_path / "two" / "sweep.journal"
    path.parent.mkdir()
    with Journal(path, made.identity, resume=False, shard=shard):  # lives while the other computes
        run_shard(made, tmp_path / "two", shard, "serial")
    assert run_shard(made, tmp_path / "two", shard, "serial", resume=True).n_done == 13
    for k in (1, 2):
        run_shard(made, tmp_path / "one", Shard(k, 2), "serial")
    for part in (tmp_path / "one" / "sweep.journal").glob("*.points"):
        (path / f"copy-of-{part.name}").write_bytes(part.read_bytes())
    merge_sweep(made, tmp_path / "two").close()
    merge_sweep(made, tmp_path / "one").close()
    assert contents(tmp_path / "two") == contents(tmp_path / "one")


def command(folder: Path, *arguments: object) -> list[str]:
    """Return the command of a sweep; it runs in `folder`, so that the page names equal folders."""
    line = [sys.executable, "-m", "delam_fem", "sweep", "../tiny.toml", "-o", "out", "-q"]
    return [*line, *map(str, arguments)]


def start(folder: Path, *arguments: object) -> subprocess.Popen[str]:
    folder.mkdir(exist_ok=True)
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        command(folder, *arguments),
        cwd=folder,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def finished(process: subprocess.Popen[str]) -> tuple[int, str]:
    try:
        _, errors = process.communicate(timeout=SECONDS)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    return process.returncode, errors


def points_of(journal: Path, shard: str) -> int:
    """Return the bytes in the parts of a shard; more than the first record means points."""
    return sum(part.stat().st_size for part in journal.glob(f"{shard}.*.points"))


def killed(folder: Path, k: int, of: int, rng: random.Random) -> int:
    """Start a shard and kill it a moment after its first points; return its status."""
    process = start(folder, "--shard", f"{k}/{of}", "--resume", "-j", 1)
    journal = folder / "out" / "sweep.journal"
    before, end = points_of(journal, f"{k}-of-{of}"), time.monotonic() + SECONDS
    while points_of(journal, f"{k}-of-{of}") == before and time.monotonic() < end:
        if process.poll() is not None:
            break
        time.sleep(0.005)
    time.sleep(rng.uniform(0.0, 0.1))
    os.killpg(process.pid, signal.SIGKILL)
    return finished(process)[0]


def survived(
    folder: Path,
    *,
    count: int,
    of: int,
    n_kills: int,
    where: tuple[object, ...],
    is_at_once: bool = False,
) -> int:
    """Kill shards, resume all, merge, and compare with one run; return how many kills hit.

    One shard after the other is killed until `n_kills` have hit; on a busy machine some end before.
    The working directory changes, because the page names the folder of the sweep.
    """
    tiny(folder, count)
    rng = random.Random(5)
    hit = k = 0
    while hit < n_kills and k < of:
        hit += killed(folder / "many", 1 + 3 * k % of, of, rng) == -signal.SIGKILL
        k += 1
    line = ("../tiny.toml", "-o", "out", "-q")
    os.chdir(folder / "many")
    if is_at_once:
        going_on = [("--shard", f"{k}/{of}", "--resume", "-j", 1) for k in range(1, of + 1)]
        processes = [start(folder / "many", *options) for options in going_on]
        assert [finished(process) for process in processes] == [(0, "")] * of
    for k in range(1, of + 1):
        assert run(*line, *where, "--shard", f"{k}/{of}", "--resume") == (0, "")
    assert run(*line, "--merge") == (0, "")
    (folder / "one").mkdir()
    os.chdir(folder / "one")
    assert run(*line, *where) == (0, "")
    merged, one = contents(folder / "many" / "out"), contents(folder / "one" / "out")
    assert set(merged) == set(FILES) and merged == one
    return hit


@pytest.mark.slow
def test_killed_shards_merge_to_the_bytes_of_one_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    serial = ("--executor", "serial")
    assert survived(tmp_path, count=600, of=4, n_kills=1, where=serial) == 1


@pytest.mark.nightly
def test_many_killed_shards_merge_to_the_bytes_of_one_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert survived(tmp_path, count=10_000, of=8, n_kills=8, where=("-j", 2), is_at_once=True) > 4


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["sweep", *map(str, arguments)])
    return result.exit_code, result.output


def test_the_command_computes_and_merges(tmp_path: Path) -> None:
    file, out = tiny(tmp_path, 4), tmp_path / "out"
    serial = ("-o", out, "--executor", "serial")
    status, text = run(file, *serial, "--shard", "2/2")
    assert status == 0 and "6 of 6" in text
    status, text = run(file, "-o", out, "--merge")
    assert status == 2 and "6 points are missing: 6 of shard 1/2" in text
    assert run(file, "-o", out, "--merge", "--partial", "-q")[0] == 0
    assert run(file, *serial, "--shard", "1/2", "-q")[0] == 0
    status, text = run(file, "-o", out, "--merge")
    assert status == 0 and "report.html" in text
    assert load_sweep(out / "sweep.toml").n_points == 12


def test_a_diagram_of_shards_says_that_they_are_not_merged(tmp_path: Path) -> None:
    run(tiny(tmp_path, 4), "-o", tmp_path / "out", "--executor", "serial", "--shard", "2/2", "-q")
    result = CliRunner().invoke(app, ["show", "diagram", "response", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert "has shards that are not merged; delam-fem sweep FILE --merge" in result.output


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--shard", "1/2", "--merge"), "expected one of --shard and --merge"),
        (("--shard", "1/2", "--overwrite"), "--overwrite: does not go with --shard"),
        (("--merge", "--dry-run"), "--dry-run: does not go with --merge"),
        (("--partial",), "--partial: only goes with --merge"),
        (("--merge",), "no such folder"),
        (("--hours", "3"), "--hours: only goes with --slurm"),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    status, text = run(tiny(tmp_path, 2), "-o", tmp_path / "out", *options)
    assert status == 2 and words in " ".join(text.split())
    assert not (tmp_path / "out").exists()
