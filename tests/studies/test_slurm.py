"""The script for SLURM, run with stand-ins for `sbatch` and `scontrol`."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from project import ROOT
from typer.testing import CliRunner

from delam_fem import load_sweep
from delam_fem.api import CaseError
from delam_fem.cli.app import app
from delam_fem.studies.sweeps.dataset import open_result
from delam_fem.studies.sweeps.run import PointCost, array_script, measured_cost

SWEEP = """
base = "paper"
{more}
[set]
mesh.elements = {elements}
time.steps_per_period = 40
time.periods = 4
output.fields_per_period = 0
[[axis]]
key = "excitation.amplitude"
start = 0.001
stop = 0.002
count = {count}
"""
SBATCH = """#!/bin/bash
# Runs at once what is submitted: the tasks of an array as often as they are put back.
echo "sbatch $*" >> "$CALLS"
if [ "$1" = --parsable ]; then
    for SLURM_ARRAY_TASK_ID in $(seq 1 $(sed -n 's/^#SBATCH --array=1-//p' "$2")); do
        export SLURM_ARRAY_TASK_ID SLURM_ARRAY_JOB_ID=4711 SLURM_CPUS_PER_TASK=1
        bash "$2" >&2 || exit 1
    done
    echo "4711;cluster"
else
    while [ "$1" != --wrap ]; do shift; done
    sh -c "$2" >&2
fi
"""
SCONTROL = """#!/bin/bash
echo "scontrol $*" >> "$CALLS"
"""
SECONDS = 120.0


def sweep_file(folder: Path, count: int, *, elements: int = 1, more: str = "") -> Path:
    path = folder / "many.toml"
    path.write_text(SWEEP.format(count=count, elements=elements, more=more))
    return path


def script(*arguments: object) -> str:
    result = CliRunner().invoke(app, ["sweep", *map(str, arguments)])
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture
def cluster(tmp_path: Path) -> dict[str, str]:
    """Return the environment with the stand-ins."""
    for name, text in (("sbatch", SBATCH), ("scontrol", SCONTROL)):
        path = tmp_path / "bin" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        path.chmod(0o755)
    here = {"PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}", "CALLS": str(tmp_path / "calls")}
    return {**os.environ, **here, "PYTHONPATH": str(ROOT)}


@pytest.mark.slow
def test_the_script_computes_and_merges(tmp_path: Path, cluster: dict[str, str]) -> None:
    out = tmp_path / "a folder" / "out"
    file = tmp_path / "job.sh"
    file.write_text(
        script(sweep_file(tmp_path, 5), "-o", out, "--slurm", 2, "--set", "contact.restitution=0.3")
    )
    done = subprocess.run(
        ["bash", str(file)], env=cluster, capture_output=True, text=True, timeout=SECONDS
    )
    assert done.returncode == 0, done.stderr
    first, second = (tmp_path / "calls").read_text().splitlines()
    assert first == f"sbatch --parsable {file}"
    assert "--dependency=afterok:4711 --kill-on-invalid-dep=yes" in second
    data = open_result(out / "sweep.nc")
    assert data.attrs["n_completed"] == 5
    assert "restitution = 0.3" in data.attrs["case"]
    data.close()


@pytest.mark.slow
def test_a_job_whose_time_is_up_goes_back_into_the_queue(
    tmp_path: Path, cluster: dict[str, str]
) -> None:
    out, file = tmp_path / "out", tmp_path / "job.sh"
    file.write_text(script(sweep_file(tmp_path, 4000, elements=40), "-o", out, "--slurm", 2))
    task = {"SLURM_ARRAY_TASK_ID": "2", "SLURM_ARRAY_JOB_ID": "47"}
    job = subprocess.Popen(
        ["bash", str(file)], env=cluster | task, stdout=subprocess.PIPE, text=True
    )
    end = time.monotonic() + SECONDS
    while not list(out.glob("sweep.journal/2-of-2.*")) and time.monotonic() < end:
        assert job.poll() is None
        time.sleep(0.02)
    job.send_signal(signal.SIGTERM)  # to the shell alone, as --signal=B: does
    text, _ = job.communicate(timeout=SECONDS)
    assert job.returncode == 130
    assert "shard 2: not finished; back into the queue" in text
    assert (tmp_path / "calls").read_text() == "scontrol requeue 47_2\n"


def cost(mean: float, most: float | None = None) -> PointCost:
    return PointCost(mean, most or mean, 10)


def directives(text: str) -> dict[str, str]:
    return dict(re.findall(r"^#SBATCH --([\w-]+)=(.*)$", text, re.MULTILINE))


def made(folder: Path, measured: PointCost, n_shards: int = 4, hours: float = 24.0) -> str:
    sweep = load_sweep(sweep_file(folder, 4000))
    return array_script(sweep, ["run it"], n_shards, measured, most_hours=hours, interrupted=130)


def test_times_follow_from_the_cost_of_a_point(tmp_path: Path) -> None:
    short = made(tmp_path, cost(0.6))
    assert directives(short)["time"] == "00:18:00"  # 120 s + 60 s + 1.5 * 1000 points * 0.6 s
    assert directives(short)["array"] == "1-4"
    assert directives(short)["signal"] == "B:TERM@60"
    assert "1000 points a shard, 600 ms a point" in short and "work in one job" in short
    long = made(tmp_path, cost(36.0, 100.0), hours=5.0)
    assert directives(long)["time"] == "05:00:00"
    assert directives(long)["signal"] == "B:TERM@300"  # the longest point, three times
    assert "10:00:00 of work in about 4 jobs one after the other" in long
    assert all(f"{name}_NUM_THREADS=1" in long for name in ("OMP", "OPENBLAS", "MKL"))


def test_bad_numbers_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=r"expected 1 to 4000 shards, .* 4000 points, given 4001"):
        made(tmp_path, cost(1.0), n_shards=4001)
    with pytest.raises(CaseError, match=r"jobs of at least 1.7 h, as a point takes up to 1e\+03 s"):
        made(tmp_path, cost(1.0, 1000.0), hours=1.0)
    track = load_sweep(sweep_file(tmp_path, 10, more='order = "both"'))
    with pytest.raises(CaseError, match=r"expected 1 to 2 shards, as the sweep has 2 tracks"):
        array_script(track, [], 3, cost(1.0), most_hours=1.0, interrupted=130)


def test_the_cost_is_measured(tmp_path: Path) -> None:
    estimate = measured_cost(load_sweep(sweep_file(tmp_path, 3)), seconds=60.0)
    assert estimate.n_points == 3 and 0.0 < estimate.mean <= estimate.most


def test_the_script_is_clean(tmp_path: Path) -> None:
    file = tmp_path / "job.sh"
    file.write_text(made(tmp_path, cost(1.0)))
    subprocess.run(["bash", "-n", str(file)], check=True)
    if shutil.which("shellcheck") is None:
        pytest.skip("shellcheck is not installed")
    done = subprocess.run(["shellcheck", str(file)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_the_interpreter_is_that_of_the_command(tmp_path: Path) -> None:
    text = script(sweep_file(tmp_path, 3), "-o", tmp_path / "out", "--slurm", 1)
    assert f"sweep=({sys.executable} -m delam_fem sweep {tmp_path / 'many.toml'} -o " in text
    assert not (tmp_path / "out").exists()
