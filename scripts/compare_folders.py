"""Compare the folders that each command writes in two trees of the sources.

    .venv/bin/python scripts/compare_folders.py BEFORE [--now TREE] [--only detect,orbit]

Each command runs in both trees with few elements and steps. The names of files, numbers in JSON,
text, variables of NetCDF, arrays and the pixels of pictures must be the same. Left out are what
differs from run to run: durations, dates, the folder's own path. The status is 1 if anything
differs.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import matplotlib.image
import numpy as np
import xarray as xr

TREE = Path(__file__).parents[1]
COARSE = "--set mesh.elements=4 --set time.steps_per_period=100 --set time.periods=3"
LAYERED = "embedded --set mesh.elements=20 --set time.steps_per_period=100"
PAIR = "--set mesh.elements=20 -j 1"
SWEPT = (
    "--set excitation.kind=sweep --set excitation.start_frequency=2 --set "
    "excitation.end_frequency=6 --set excitation.duration=60 --set time.steps_per_period=50"
)
COMMANDS = {
    "run": f"run paper {COARSE}",
    "sweep": "sweep {home}/sweep.toml -j 1",
    "modes": "modes default --set mesh.elements=4 -n 3",
    "modes-bonded": f"modes {LAYERED} --delaminations closed",
    "detect": f"detect scan {LAYERED}",
    "detect-index": f"detect scan {LAYERED} --index V2 --spacing 0.02 "
    "--quantity displacement --seed 3",
    "excite": f"detect excite embedded {PAIR} --from 80 --to 110 -n 2",
    "excite-open": f"detect excite embedded {PAIR} --from 80 --to 90 -n 2 "
    "--set delamination.lower-upper.opening=1e-5",
    "pod": f"detect pod embedded {PAIR} --frequencies 365 --supports clamped --noise-db 40",
    "infer": f"detect infer embedded {PAIR} -n 110 --frequency 365",
    "modulate": f"detect modulate {LAYERED} --set excitation.frequency=350 --pump-frequency 60 "
    "--pump-amplitude 0.1 --periods 1",
    "resonance": f"identify resonance paper --set mesh.elements=6 {SWEPT}",
    "identify": "identify keys paper --set mesh.elements=2 --set time.steps_per_period=60 --set "
    "time.periods=12 --set output.window_periods=4 --unknown gap.tip=0.010:0.014 "
    "--unknown contact.restitution=0.05:0.3 --frequency 3.25 "
    "--simulations 120 --calibrate 5 -j 1",
    "orbit": "orbit find paper --set excitation.frequency=1.25 --set contact.law=penalty --set "
    "mesh.elements=4 --set time.steps_per_period=200 --settle 150",
    "continue": "orbit follow paper --set mesh.elements=3 --set time.steps_per_period=50 --step "
    "0.4 --set contact.law=none --from 3.7 --to 3.8",
    "converge": "converge default --laws newton@moreau-jean -j 1 --periods 2 --limit-steps 1000 "
    "--in both --elements 5,10 --steps 250,500",
    "compare": "compare paper --set mesh.elements=4 --periods 1",
    "compare-models": "compare default --set mesh.elements=4 --models beam,modes --modes 4 "
    "--set time.steps_per_period=100 --periods 4 --at 3.25",
    "reduce": "reduce default --set mesh.elements=6 --modes 4",
    "massless": f"run default {COARSE} --set model.kind=modes --set model.modes=3 --set "
    "time.mass=massless --set time.refine=4 --set contact.law=newton --set contact.restitution=0",
    "overlay": "measure overlay {home}/run/result.nc {home}/run",
}  # fmt: skip
"""Commands by name; "{home}" is the folder of all results. "overlay" takes that of "run"."""
SWEEP = f"""base = "paper"
[[axis]]
key = "excitation.frequency"
values = [3.0, 3.5]
[set]
{"".join(f'"{key}" = {n}' + chr(10) for key, n in {"mesh.elements": 4, "time.periods": 3}.items())}
"""
CHANGING = re.compile(
    r"seconds|per_step|per_period_ms|wall|created|history|date|versions|hours|_s$|cost|command|revision|checksum"
)
"""Names of numbers and attributes that differ from run to run."""
LEFT_OUT = {
    "sweep.json",
    "report.html",
    "tables.md",
    "error_over_cost.png",
}
"""Files with times in them; pages hold the pictures and numbers of the other files."""


def written(tree: Path, name: str, home: Path) -> Path:
    """Run a command with the sources of a tree, and return the folder of its results."""
    folder = home / name
    words = COMMANDS[name].replace("{home}", str(home)).split()
    line = [sys.executable, "-m", "delam_fem", *words, "-o", str(folder)]
    known = {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1", "COLUMNS": "120"}
    done = subprocess.run(line, cwd=home, env=os.environ | known, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{tree}: {name} fails ({done.returncode}):\n{done.stderr[-2000:]}")
    (home / f"{name}.txt").write_text(done.stdout.replace(str(home), ""), encoding="utf-8")
    return folder


def without_times(value: object) -> object:
    """Return the content of a JSON file without numbers that differ from run to run."""
    if isinstance(value, dict):
        return {k: without_times(v) for k, v in value.items() if not CHANGING.search(k)}
    return [without_times(entry) for entry in value] if isinstance(value, list) else value


def is_same(first: Path, second: Path, homes: tuple[Path, Path]) -> bool:
    """Return whether two files have the same content, as far as that is the same in each run."""
    if first.suffix == ".png":
        a, b = (matplotlib.image.imread(path) for path in (first, second))
        return a.shape == b.shape and bool((a == b).all())
    if first.suffix == ".nc":
        with (
            xr.open_dataset(first, engine="h5netcdf") as one,
            xr.open_dataset(second, engine="h5netcdf") as two,
        ):
            names = [v for v in one.variables if CHANGING.search(str(v))]
            attributes = [without_times(dict(data.attrs)) for data in (one, two)]
            return one.drop_vars(names).equals(two.drop_vars(names)) and repr(
                attributes[0]
            ).replace(str(homes[0]), "") == repr(attributes[1]).replace(str(homes[1]), "")
    if first.suffix == ".npz":
        with np.load(first) as one, np.load(second) as two:
            return set(one) == set(two) and all(
                np.array_equal(one[k], two[k], equal_nan=True)
                for k in one
                if one[k].dtype.kind in "fiu"
            )
    if first.suffix in (".vtkhdf", ".vtu", ".h5"):
        return first.stat().st_size == second.stat().st_size
    texts = [
        path.read_text(encoding="utf-8").replace(str(home), "")
        for path, home in zip((first, second), homes, strict=True)
    ]
    if first.suffix == ".json":
        one, two = (without_times(json.loads(text)) for text in texts)
        return one == two
    return texts[0] == texts[1]


def differences(name: str, homes: tuple[Path, Path]) -> Iterator[str]:
    """Yield in which files the folders of a command differ."""
    first, second = (
        {path.relative_to(home / name) for path in (home / name).rglob("*") if path.is_file()}
        for home in homes
    )
    yield from (f"only before: {path}" for path in sorted(first - second))
    yield from (f"only now: {path}" for path in sorted(second - first))
    for path in sorted(first & second):
        pair = homes[0] / name / path, homes[1] / name / path
        if path.name not in LEFT_OUT and not is_same(*pair, homes):
            yield f"differs: {path}"


def main() -> int:
    """Run the commands in both trees, and print what differs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("before", type=Path, help="tree of the sources before a change")
    parser.add_argument("--now", type=Path, default=TREE, help="tree after it (default: this one)")
    parser.add_argument("--only", default=",".join(COMMANDS), help="names of commands, with commas")
    parser.add_argument("--keep", type=Path, help="folder for the results (default: removed)")
    options = parser.parse_args()
    n_different = 0
    with tempfile.TemporaryDirectory() as scratch:
        root = options.keep or Path(scratch)
        homes = (root / "before", root / "now")
        for home in homes:
            home.mkdir(parents=True, exist_ok=True)
            (home / "sweep.toml").write_text(SWEEP, encoding="utf-8")
        for name in options.only.split(","):
            for tree, home in zip((options.before, options.now), homes, strict=True):
                if not (home / f"{name}.txt").exists():  # of an earlier comparison that was kept
                    written(tree.resolve(), name, home)
            texts = list(differences(name, homes))
            n_different += bool(texts)
            print(f"{name:16} {'same' if not texts else '; '.join(texts)}", flush=True)
    return int(n_different > 0)


if __name__ == "__main__":
    sys.exit(main())
