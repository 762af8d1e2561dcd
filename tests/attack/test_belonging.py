"""Kept by A, resumed with B: what differs is refused, what is moved or renamed goes on.

Each command is stopped while it computes. Then its rig is changed in one thing, in the case or in
the content of a file, or it is asked another question. All that must be refused with the key that
differs, and nothing in the folder may change. The same rig under other names, in another folder,
must be taken for the same and give the numbers of a computation that was not stopped.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from project import ROOT
from typer.testing import CliRunner

import delam_fem as df
from delam_fem.cli.app import app
from delam_fem.simulation.checkpoint import Watch
from delam_fem.studies.convergence import run as refinements
from delam_fem.studies.orbits import maps
from delam_fem.studies.orbits.follow import PointJournal
from delam_fem.studies.orbits.maps import KeptMap
from delam_fem.studies.sweeps.journal import Journal

SHORT = {
    "time.steps_per_period": 50, "time.periods": 12, "output.window_periods": 2,
    "output.fields_per_period": 0, "contact.impulse": "consistent",
}  # fmt: skip
APART = {**SHORT, "gap.file": "table.csv", "mesh.file": "mesh.msh"}
BONDED = {
    "mesh.elements": 20, "delamination.1.file": "table.csv", "time.steps_per_period": 100,
    "time.periods": 30, "output.window_periods": 4,
}  # fmt: skip
DRIVEN = {
    **{key: value for key, value in APART.items() if "period" not in key},
    "excitation.kind": "table", "excitation.file": "drive.csv", "excitation.acts_on": "base",
    "time.step": 0.005, "time.duration": 3.0,
}  # fmt: skip
SWEPT = {
    **APART, "excitation.kind": "sweep", "excitation.start_frequency": 2.0,
    "excitation.end_frequency": 6.0, "excitation.duration": 20.0,
}  # fmt: skip
RIGS: dict[str, tuple[str, dict[str, Any]]] = {
    "apart": ("paper", APART),
    "bonded": ("embedded", BONDED),
    "plain": ("embedded", {"time.steps_per_period": 100, "mesh.elements": 20}),
    "driven": ("paper", DRIVEN),
    "swept": ("paper", SWEPT),
    "reduced": ("embedded", {"time.steps_per_period": 100, "time.periods": 30,
                             "output.window_periods": 4}),
}  # fmt: skip
FILES = {
    "table.csv": "table", "mesh.msh": "mesh", "drive.csv": "drive", "reduced.npz": "model",
}  # fmt: skip
"""What the files of rigs are."""
SWEEP = """
name = "s"
base = "case.toml"
engine = "compiled"
[[axis]]
key = "excitation.frequency"
start = 3.0
stop = {stop}
count = 12
"""


@dataclass(frozen=True)
class Command:
    """A command that can be resumed.

    Attributes:
        rig: name of its rig.
        words: its words; CASE is the case file, SWEEP a sweep over it.
        other: options that ask another question.
        resume: options with which it goes on.
        first: options of the first call, in place of `resume`.
        is_cut: whether the first call is stopped.
        marks: marks of its tests.
    """

    rig: str
    words: tuple[str, ...]
    other: tuple[str, ...]
    resume: tuple[str, ...] = ("--resume",)
    first: tuple[str, ...] = ()
    is_cut: bool = True
    marks: tuple[pytest.MarkDecorator, ...] = field(default=())


RUN = ("run", "CASE", "--no-figures")
SERIAL = ("-j", "1")
COMMANDS = {
    "run": Command("apart", RUN, ("--engine", "compiled")),
    "extend": Command("apart", RUN, ("--engine", "compiled"), ("--extend", "5"), is_cut=False),
    "run driven": Command("driven", RUN, ("--engine", "compiled")),
    "run reduced": Command("reduced", RUN, ("--engine", "compiled")),
    "complete": Command("apart", RUN, ("--engine", "compiled"), is_cut=False),
    "sweep": Command("apart", ("sweep", "SWEEP", *SERIAL), ("AXIS",)),
    "shard": Command(
        "apart", ("sweep", "SWEEP", "--shard", "1/2", *SERIAL), ("AXIS",)
    ),
    "merge": Command(
        "apart", ("sweep", "SWEEP"), ("AXIS",), ("--merge", "--partial"),
        ("--shard", "1/2", *SERIAL),
    ),
    "converge": Command(
        "apart",
        ("converge", "CASE", "--laws", "newton@moreau-jean", "--steps", "100,200,400",
         "--limit-steps", "0", *SERIAL, "--periods", "6"),
        ("--periods", "7"),
    ),
    "scan": Command("bonded", ("detect", "scan", "CASE"), ("--spacing", "0.02")),
    "modulate": Command(
        "bonded",
        ("detect", "modulate", "CASE", "--pump-frequency", "49", "--periods", "1",
         "--pump-amplitude", "0.1"),
        ("--pump-amplitude", "0.2"),
    ),
    "excite": Command(
        "bonded", ("detect", "excite", "CASE", "-n", "3", *SERIAL, "--to", "100"), ("--to", "90")
    ),
    "pod": Command(
        "plain",
        ("detect", "pod", "CASE", "--frequencies", "365", "--supports", "clamped", *SERIAL),
        ("--frequencies", "250"),
        marks=(pytest.mark.slow,),
    ),
    "infer": Command(
        "plain", ("detect", "infer", "CASE", *SERIAL, "-n", "100"), ("-n", "101"),
        marks=(pytest.mark.slow,),
    ),
    "keys": Command(
        "apart",
        ("identify", "keys", "CASE", "--unknown", "lamina.thick.damping_ratio=0.004:0.05",
         "--frequency", "3.25", "--simulations", "100", *SERIAL),
        ("--seed", "2"),
    ),
    "resonance": Command("swept", ("identify", "resonance", "CASE"), ("--seed", "2")),
    "orbit": Command("apart", ("orbit", "find", "CASE", "--settle", "20"), ("--settle", "21")),
    "follow": Command(
        "apart",
        ("orbit", "follow", "CASE", "--set", "contact.law=none", "--step", "0.4",
         "--from", "3.7", "--to", "3.8"),
        ("--to", "3.9"),
    ),
}  # fmt: skip
ALL = [pytest.param(name, marks=command.marks) for name, command in COMMANDS.items()]
BROKEN_OFF = 130
OF_THE_OCCASION = ("created", "identity", "command", "evaluations")


def files_of(rig: str) -> list[str]:
    """Return the names of the files of a rig."""
    names = [str(value) for key, value in RIGS[rig][1].items() if key.endswith("file")]
    return [*names, "reduced.npz"] if rig == "reduced" else names


def write_file(path: Path, name: str, rig: str, *, is_other: bool = False) -> None:
    """Write a file of a rig, or one with another content."""
    change = 0.9 if is_other else 1.0
    if name == "mesh.msh":
        text = (ROOT / "meshes" / "laminae_20.msh").read_text()
        moved = text.replace("0.20549", "0.20149")  # a node of each lamina
        assert moved != text
        path.write_text(moved if is_other else text)
    elif name == "drive.csv":
        rows = "".join(f"{0.5 * k},{change * (k % 2)}\n" for k in range(7))
        path.write_text(f"time [s],acceleration [m/s2]\n{rows}")
    elif name == "reduced.npz":
        reduction = df.reduced_case(df.preset(*RIGS["reduced"]), 5 if is_other else 6)
        saved = next(file for file in reduction.save(path.parent / "new") if file.suffix == ".npz")
        saved.rename(path)
        shutil.rmtree(path.parent / "new")
    elif rig == "bonded":
        path.write_text(f"x [m],gap [m]\n0.12,0\n0.2,{1e-5 * change}\n0.28,0\n")
    else:
        path.write_text(f"x [m],gap [m]\n0,0\n0.3,0.004\n0.685,{0.012 * change}\n")


def write_rig(folder: Path, rig: str, prefix: str = "") -> None:
    """Write a case with its files, whose names begin with a prefix, and a sweep over it."""
    folder.mkdir(parents=True)
    for name in files_of(rig):
        write_file(folder / f"{prefix}{name}", name, rig)
    preset, keys = RIGS[rig]
    keys = {
        key: str(folder / f"{prefix}{value}") if key.endswith("file") else value
        for key, value in keys.items()
    }
    if rig == "reduced":
        keys |= {"model.kind": "modes", "model.file": str(folder / f"{prefix}reduced.npz")}
    text = df.preset(preset, keys).to_toml()
    (folder / f"{prefix}case.toml").write_text(text.replace(f"{folder}/", ""))
    sweep = SWEEP.replace("case.toml", f"{prefix}case.toml")
    (folder / f"{prefix}s.toml").write_text(sweep.replace("{stop}", "4.0"))


def called(
    command: Command, rig: Path, output: Path, *options: str, prefix: str = ""
) -> tuple[int, str]:
    """Call a command on a rig; return its status and what it said."""
    places = {"CASE": rig / f"{prefix}case.toml", "SWEEP": rig / f"{prefix}s.toml"}
    words = [str(places.get(word, word)) for word in (*command.words, *options)]
    result = CliRunner().invoke(app, [*words, "-o", str(output), "-q"])
    return result.exit_code, " ".join(result.output.split())


def stop_soon(patch: pytest.MonkeyPatch) -> None:
    """Let computations be interrupted as soon as something is kept."""
    counts = {"map": 0, "level": 0}

    def after(owner: Any, name: str) -> None:
        original = getattr(owner, name)

        def interrupted(self: Any, *arguments: Any) -> Any:
            result = original(self, *arguments)
            signal.raise_signal(signal.SIGINT)
            return result

        patch.setattr(owner, name, interrupted)

    def before(self: Watch, period: int) -> bool:
        signal.raise_signal(signal.SIGINT)
        return watch(self, period)

    def mapped(self: KeptMap, *arguments: Any) -> Any:
        counts["map"] += 1
        if counts["map"] > 3:
            raise KeyboardInterrupt
        return known(self, *arguments)

    def computed(*arguments: Any) -> Any:
        counts["level"] += 1
        if counts["level"] == 2:
            signal.raise_signal(signal.SIGINT)
        return level(*arguments)

    watch, known, level = Watch.__call__, KeptMap.after, refinements.compute
    patch.setattr(Watch, "__call__", before)
    patch.setattr(KeptMap, "after", mapped)
    patch.setattr(refinements, "compute", computed)
    patch.setattr(maps, "CHECKPOINT_SECONDS", 0.0)
    after(Journal, "add")
    after(PointJournal, "keep")


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return a function of a command that returns a folder with its rig and what it has kept."""
    folders: dict[str, Path] = {}

    def of(name: str) -> Path:
        if name not in folders:
            command, folder = COMMANDS[name], tmp_path_factory.mktemp("kept")
            write_rig(folder / "rig", command.rig)
            with pytest.MonkeyPatch.context() as patch:
                if command.is_cut:
                    stop_soon(patch)
                status, said = called(command, folder / "rig", folder / "out", *command.first)
            assert status == (BROKEN_OFF if command.is_cut else 0), said
            folders[name] = folder
        return folders[name]

    return of


def contents(folder: Path) -> dict[str, str]:
    """Return digests of all files in a folder by their paths, without locks."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "lock"
    }


def changed(rig: Path, kind: str, difference: str) -> None:
    """Change one thing in a rig."""
    if difference == "case":
        case = rig / "case.toml"
        text = case.read_text()
        line = next(row for row in text.splitlines() if row.startswith("damping_ratio = "))
        case.write_text(text.replace(line, "damping_ratio = 0.0123"))
        return
    (name,) = (file for file in files_of(kind) if FILES[file] == difference)
    (rig / name).unlink()
    write_file(rig / name, name, kind, is_other=True)


PAIRS = [
    pytest.param(name, difference, id=f"{name}-{difference}", marks=command.marks)
    for name, command in COMMANDS.items()
    for difference in ("case", "options", *(FILES[file] for file in files_of(command.rig)))
    if name != "run reduced" or difference == "model"  # a reduced model refuses other cases itself
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "difference"), PAIRS)
def test_another_rig_or_question_is_refused(
    name: str, difference: str, kept: Callable[[str], Path], tmp_path: Path
) -> None:
    command, folder = COMMANDS[name], tmp_path / "copy"
    shutil.copytree(kept(name), folder)
    options: tuple[str, ...] = ()
    if difference != "options":
        changed(folder / "rig", command.rig, difference)
    elif command.other == ("AXIS",):
        (folder / "rig" / "s.toml").write_text(SWEEP.replace("{stop}", "4.1"))
    else:
        options = command.other
    before = contents(folder / "out")
    status, said = called(command, folder / "rig", folder / "out", *options, *command.resume)
    if (name, difference) == ("converge", "mesh"):  # its levels are known by their mesh
        assert status == 0, said
        levels = json.loads((folder / "out" / "convergence.json").read_text())["rungs"]
        meshes = [level["key"].split()[1] for level in levels]
        assert len(set(meshes)) == 2 and meshes.count(meshes[-1]) == 6
        return
    assert status == 2, said
    assert "belongs to another" in said
    key = {"case": "damping_ratio", "table": ".file", "mesh": "mesh.file",
           "drive": "excitation.file", "model": "model.file"}.get(difference, "")  # fmt: skip
    assert key in said
    assert contents(folder / "out") == before


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(n, marks=c.marks) for n, c in COMMANDS.items()])
def test_what_is_moved_and_renamed_goes_on(
    name: str, kept: Callable[[str], Path], tmp_path: Path
) -> None:
    command = COMMANDS[name]
    shutil.copytree(kept(name) / "out", tmp_path / "moved")
    write_rig(tmp_path / "new", command.rig, prefix="renamed-")
    status, said = called(
        command, tmp_path / "new", tmp_path / "moved", *command.resume, prefix="renamed-"
    )
    assert status == 0, said
    write_rig(tmp_path / "rig", command.rig)
    options = ("--set", "time.periods=17") if name == "extend" else command.first
    if name != "merge":
        status, said = called(command, tmp_path / "rig", tmp_path / "whole", *options)
        assert status == 0, said
        assert results(tmp_path / "moved") == results(tmp_path / "whole")


def results(folder: Path) -> dict[str, object]:
    """Return the numbers of a result that are the same in each computation."""
    by_path: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        if path.name in ("result.nc", "sweep.nc", "branch.nc"):
            data = xr.load_dataset(path, engine="h5netcdf").drop_attrs()
            by_path[path.name] = {
                name: np.asarray(data[name]).tobytes()
                for name in data.variables
                if data[name].dtype.kind in "fiub"
            }
        elif path.suffix == ".json" and path.name not in ("summary.json", "sweep.json"):
            numbers = json.loads(path.read_text())
            for level in numbers.get("rungs", []):
                for name in [n for n in level if "second" in n or "cost" in n or n == "checksum"]:
                    del level[name]
            by_path[path.name] = {
                name: value for name, value in numbers.items()
                if "second" not in name and name not in OF_THE_OCCASION
            }  # fmt: skip
    return by_path
