"""Compare the numbers of two states of the package bit by bit.

    .venv/bin/python tests/unchanged_numbers.py against REVISION
    .venv/bin/python tests/unchanged_numbers.py record FOLDER
    .venv/bin/python tests/unchanged_numbers.py compare BEFORE AFTER [--tolerance 1e-12]

`record` computes a set of short cases (all laws, both engines, both masses, a mesh file, a swept
sine, a resumed run), a sweep and a refinement study with the package that Python finds, and writes
every result to a folder. `compare` reads two such folders: each variable of the first must be
in the second, with the same dimensions and the same bits. `against` records a revision of the
repository in a temporary work tree, then the working tree, and compares both.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

ROOT = Path(__file__).resolve().parents[1]
SHORT: dict[str, object] = {
    "time.periods": 5,
    "time.steps_per_period": 500,
    "output.window_periods": 3,
    "output.fields_per_period": 10,
}
CONSISTENT = {"contact.impulse": "consistent"}
LUMPED = {"time.mass": "lumped"}
GRADED = {"mesh.file": str(ROOT / "meshes" / "laminae_graded.msh")}
MOREAU: dict[str, object] = {"contact.law": "newton", "time.scheme": "moreau-jean", **CONSISTENT}
CASES: dict[str, tuple[str, str, dict[str, object]]] = {
    "paper-petsc": ("paper", "petsc", {}),
    "paper-compiled": ("paper", "compiled", {}),
    "refined-petsc": ("default", "petsc", {"time.mass": "lumped"}),
    "refined-compiled": ("default", "compiled", {}),
    "moreau-petsc": ("paper", "petsc", {**MOREAU, "mesh.elements": 40}),
    "moreau-compiled": ("paper", "compiled", MOREAU),
    "newton-petsc": ("paper", "petsc", {"contact.law": "newton", **LUMPED}),
    "newton-compiled": ("paper", "compiled", {"contact.law": "newton", **CONSISTENT}),
    "penalty-petsc": (
        "paper",
        "petsc",
        {"contact.law": "penalty", "contact.penalty_damping": 0.5},
    ),
    "central-difference-compiled": (
        "paper",
        "compiled",
        {"mesh.elements": 4, "time.scheme": "central-difference", **LUMPED},
    ),
    "none-compiled": ("paper", "compiled", {"contact.law": "none"}),
    "mesh-file-petsc": ("paper", "petsc", {**GRADED, **CONSISTENT}),
    "swept-sine-petsc": (
        "paper",
        "petsc",
        {
            "excitation.kind": "sweep",
            "excitation.start_frequency": 3.0,
            "excitation.end_frequency": 3.6,
            "excitation.duration": 1.5,
        },
    ),
}
INTERRUPTED_AFTER = 2
"""Periods after which the resumed case is interrupted."""
SWEEP: dict[str, Any] = {
    "name": "numbers",
    "base": "paper",
    "order": "both",
    "set": {**SHORT, "output.fields_per_period": 20},
    "axis": [{"key": "excitation.frequency", "values": [3.2, 3.5, 3.65]}],
    "record": {
        "strobes": 3,
        "harmonics": 5,
        "node_distortion": True,
        "energies": True,
        "lyapunov": 4,
    },
}
MEASURED = ("wall_seconds", "microseconds_per_step", "busy_seconds", "scheduling_overhead")
"""Numbers that no two runs share."""


def translated(overrides: Mapping[str, object]) -> dict[str, object]:
    """Return overrides as the package named them before laws and schemes were two things."""
    older = dict(overrides)
    if older.get("time.scheme") == "moreau-jean":
        del older["time.scheme"]
        older["contact.law"] = "moreau"
    return older


def case_of(preset: str, overrides: Mapping[str, object]) -> Any:
    """Return a case in the words of this package, or of an older one."""
    import delam_fem as df

    settings = {**SHORT, **overrides}
    try:
        return df.preset(preset, settings)
    except df.CaseError:
        return df.preset(preset, translated(settings))


def record(folder: Path) -> None:
    """Compute everything and write it to a folder."""
    import delam_fem as df

    folder.mkdir(parents=True, exist_ok=True)
    for name, (preset, engine, overrides) in CASES.items():
        keep(folder / name, df.run(case_of(preset, overrides), engine))
    case, checkpoints = case_of("paper", CONSISTENT), folder / "resumed-checkpoint"
    checkpoints.mkdir(exist_ok=True)
    first = df.run(case, directory=checkpoints, progress=interrupt)
    assert first.history.attrs["outcome"] == "interrupted", first.history.attrs["outcome"]
    keep(folder / "resumed-petsc", df.run(case, directory=checkpoints, resume=True))
    sweep = sweep_of(SWEEP)
    data = df.run_sweep(sweep, folder / "sweep", "serial").load()
    data.close()
    store(folder / "sweep-serial", data, {})
    record_refinement(folder)


def interrupt(period: int, n_periods: int) -> None:
    """Send this process what Ctrl-C sends, once."""
    if period == INTERRUPTED_AFTER:
        os.kill(os.getpid(), signal.SIGINT)


def sweep_of(data: dict[str, Any]) -> Any:
    """Return a sweep, wherever the package has the function."""
    for home in ("studies.sweeps.grid", "studies.sweeps.grid", "sweepgrid"):  # the last is oldest
        try:
            return importlib.import_module(f"delam_fem.{home}").sweep_of(data)
        except (ImportError, AttributeError):
            continue
    raise AssertionError("no sweep_of")


def record_refinement(folder: Path) -> None:
    """Write the numbers of a short refinement study over two laws."""
    command = ["converge", "paper", "--steps", "250,500", "--periods", "4", "--elements", "5,10"]
    command += ["--limit-steps", "1000", "-j", "1", "-q", "--set", "time.periods=4"]
    delam_fem = [sys.executable, "-m", "delam_fem", *command, "-o", str(folder / "refinement")]
    both = (["--laws", "newton@moreau-jean,newton"], ["--laws", "moreau,newton"])
    if subprocess.run([*delam_fem, *both[0]], capture_output=True, check=False).returncode:
        subprocess.run([*delam_fem, *both[1]], check=True)


def keep(stem: Path, result: Any) -> None:
    """Write the numbers of a result."""
    store(stem, result.history, result.summary)


def store(stem: Path, data: xr.Dataset, summary: Mapping[str, Any]) -> None:
    """Write a dataset without its attributes, and a summary."""
    bare = data.drop_attrs() if hasattr(data, "drop_attrs") else data
    bare.to_netcdf(stem.with_suffix(".nc"), engine="h5netcdf")
    content = {key: value for key, value in summary.items() if key not in MEASURED}
    stem.with_suffix(".json").write_text(json.dumps(content, indent=1), encoding="utf-8")


def compare(before: Path, after: Path, tolerance: float = 0.0) -> list[str]:
    """Return what differs between two folders, a line each; none if all is the same."""
    differences = []
    stems = sorted(path.stem for path in before.glob("*.nc"))
    if not stems:
        return [f"{before}: no recorded numbers"]
    for stem in stems:
        differences += _compared(before / f"{stem}.nc", after / f"{stem}.nc", tolerance)
        differences += _summaries(before / f"{stem}.json", after / f"{stem}.json", tolerance)
    return differences + _refinements(before / "refinement", after / "refinement", tolerance)


def _compared(before: Path, after: Path, tolerance: float) -> list[str]:
    """Return the variables of one dataset that differ in the other."""
    if not after.is_file():
        return [f"{after}: missing"]
    with xr.open_dataset(before) as a, xr.open_dataset(after) as b:
        return [
            f"{after.name}: {name}: {text}"
            for name in a.variables
            if (text := _difference(a.variables[name], b.variables.get(name), tolerance))
        ]


def _difference(a: xr.Variable, b: xr.Variable | None, tolerance: float) -> str:
    """Return how two variables differ, nothing where they are the same."""
    if b is None:
        return "missing"
    if a.dims != b.dims or a.shape != b.shape:
        return f"{a.dims} {a.shape} became {b.dims} {b.shape}"
    if a.dtype != b.dtype:
        return f"{a.dtype} became {b.dtype}"
    x, y = a.to_numpy(), b.to_numpy()
    if x.tobytes() == y.tobytes() or (x.dtype.kind not in "fiu" and (x == y).all()):
        return ""
    if x.dtype.kind not in "fiu":
        return "differs"
    distance = float(np.nanmax(np.abs(x.astype(float) - y.astype(float))))
    scale = float(np.nanmax(np.abs(x), initial=0.0))
    if np.array_equal(np.isnan(x), np.isnan(y)) and distance <= tolerance * scale:
        return ""
    return f"differs by up to {distance:.3g} of {scale:.3g}"


def _summaries(before: Path, after: Path, tolerance: float) -> list[str]:
    """Return the numbers of one summary that differ in the other."""
    a, b = (json.loads(path.read_text(encoding="utf-8")) for path in (before, after))
    return [
        f"{after.name}: {key}: {value!r} became {b.get(key)!r}"
        for key, value in a.items()
        if not _alike(value, b.get(key), tolerance)
    ]


def _alike(a: Any, b: Any, tolerance: float) -> bool:
    """Return whether two entries of a summary agree; texts may change their words."""
    if isinstance(a, list):
        return (
            isinstance(b, list)
            and len(a) == len(b)
            and all(map(_alike, a, b, [tolerance] * len(a)))
        )
    if isinstance(a, float) and isinstance(b, float):
        return a == b or abs(a - b) <= tolerance * abs(a)
    return isinstance(a, str) or bool(a == b)


def _refinements(before: Path, after: Path, tolerance: float) -> list[str]:
    """Return the levels whose statistics differ; levels are matched by their order."""
    a, b = (_statistics(folder) for folder in (before, after))
    if len(a) != len(b):
        return [f"refinement: {len(a)} levels became {len(b)}"]
    return [
        f"refinement: level {i}: {name}: {value!r} became {y.get(name)!r}"
        for i, (x, y) in enumerate(zip(a, b, strict=True))
        for name, value in x.items()
        if not _alike(value, y.get(name), tolerance)
    ]


def _statistics(folder: Path) -> list[dict[str, Any]]:
    """Return the statistics of the levels of a refinement, in an order that no name changes."""
    data = json.loads(next(folder.glob("*.json")).read_text(encoding="utf-8"))
    return sorted(_tables(data), key=lambda table: json.dumps(table, sort_keys=True))


def _tables(data: Any) -> list[dict[str, Any]]:
    """Return every table `statistics` within nested data."""
    if isinstance(data, list):
        return [table for entry in data for table in _tables(entry)]
    if not isinstance(data, dict):
        return []
    tables = [data["statistics"]] if isinstance(data.get("statistics"), dict) else []
    return tables + [table for value in data.values() for table in _tables(value)]


def against(revision: str) -> list[str]:
    """Record a revision and the working tree, and return what differs."""
    with tempfile.TemporaryDirectory() as temporary:
        tree, before, after = (Path(temporary) / name for name in ("tree", "before", "after"))
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--detach", str(tree), revision], check=True)
        try:

            def record_with(root: Path, folder: Path) -> None:
                command = [sys.executable, str(Path(__file__).resolve()), "record", str(folder)]
                environment = {**os.environ, "PYTHONPATH": str(root)}
                subprocess.run(command, check=True, env=environment, cwd=temporary)

            with ThreadPoolExecutor() as side_by_side:
                list(side_by_side.map(record_with, (tree, ROOT), (before, after)))
            return compare(before, after)
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)


def main() -> int:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("against").add_argument("revision")
    commands.add_parser("record").add_argument("folder", type=Path)
    two = commands.add_parser("compare")
    two.add_argument("before", type=Path)
    two.add_argument("after", type=Path)
    two.add_argument("--tolerance", type=float, default=0.0)
    options = parser.parse_args()
    if options.command == "record":
        record(options.folder)
        return 0
    if options.command == "against":
        differences = against(options.revision)
    else:
        differences = compare(options.before, options.after, options.tolerance)
    print("\n".join(differences) or "all numbers are the same, bit for bit")
    return bool(differences)


if __name__ == "__main__":
    raise SystemExit(main())
