"""The command: exit statuses, messages, progress. The run itself is a stand-in here."""

from __future__ import annotations

import errno
import logging
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from rich.console import Console
from support import invoke
from typer.testing import CliRunner

import delam_fem
from delam_fem.api import Case, CaseError, load_case, preset, save_case
from delam_fem.cli.app import app, commands
from delam_fem.cli.console import LONGEST, PlainProgress, progress, shortened

PERIODS = 20


class FakeRun:
    """Stands for `delam_fem.run`: ends as it is told, and remembers how it was called."""

    def __init__(self) -> None:
        """End well by default."""
        self.outcome = "completed"
        self.error: BaseException | None = None
        self.save_error: OSError | None = None
        self.calls: list[tuple[Case, str, Path | None, bool]] = []
        self.overwrites: list[bool] = []
        self.figures: list[bool] = []
        self.extensions: list[int] = []

    def __call__(
        self,
        case: Case,
        engine: str = "petsc",
        *,
        directory: Path | None = None,
        resume: bool = False,
        progress: Callable[[int, int], None] | None = None,
        comm: object = None,
        overwrite: bool = False,
        extend: int = 0,
    ) -> SimpleNamespace:
        """Pretend to compute a case."""
        self.overwrites.append(overwrite)
        self.extensions.append(extend)
        self.calls.append((case, engine, directory, resume))
        if self.error is not None:
            raise self.error
        assert progress is not None
        assert comm is not None
        for done in range(1, PERIODS + 1):
            progress(done, PERIODS)
        logging.getLogger("delam_fem.simulation.loop").info("note of the run")
        summary = {"outcome": self.outcome, "tip_min": [-0.0213, -0.011], "periodicity": None}
        history = SimpleNamespace(attrs={"outcome": self.outcome})

        def save(target: Path, *, figures: bool = True) -> list[Path]:
            self.figures.append(figures)
            if self.save_error is not None:
                raise self.save_error
            return [save_case(case, target)]

        return SimpleNamespace(history=history, summary=summary, save=save)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> FakeRun:
    """Put a stand-in in the place of the run, in a working directory of its own."""
    stand_in, module = FakeRun(), ModuleType("delam_fem.pipeline")
    module.run = stand_in  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "delam_fem.pipeline", module)
    monkeypatch.chdir(tmp_path)
    return stand_in


def test_run_of_a_preset(fake: FakeRun) -> None:
    result = invoke("run", "paper", "--set", "excitation.frequency=3.65")
    assert result.exit_code == 0, result.output
    case = preset("paper", {"excitation.frequency": 3.65})
    assert fake.calls == [(case, "petsc", Path("runs/paper"), False)]
    assert load_case("runs/paper/case.toml") == case
    assert "thick −21.3, thin −11\xa0mm" in result.stdout
    assert str(Path("runs/paper/case.toml")) in result.stdout
    assert "period 20 of 20" in result.stderr
    assert "note of the run" in result.stderr


def test_run_of_a_file_with_options(fake: FakeRun, tmp_path: Path) -> None:
    path = save_case(preset("default", {"name": "mine"}), tmp_path / "in")
    options = ("-o", "out", "--engine", "compiled", "--resume", "-q")
    result = invoke("run", path, *options)
    assert (result.exit_code, result.output) == (0, "")
    assert fake.calls == [(load_case(path), "compiled", Path("out"), True)]


@pytest.mark.parametrize(("outcome", "status"), [("diverged", 1), ("interrupted", 130)])
def test_status_of_a_run_that_ends_early(fake: FakeRun, outcome: str, status: int) -> None:
    fake.outcome = outcome
    result = invoke("run", "paper")
    assert result.exit_code == status
    assert f"delam-fem: {outcome}" in result.stderr
    assert "results so far are in runs/paper" in result.stderr
    assert Path("runs/paper/case.toml").is_file()  # what was computed is kept


def test_a_folder_with_results_is_refused_unless_told(fake: FakeRun) -> None:
    assert invoke("run", "paper").exit_code == 0
    refused = invoke("run", "paper")
    assert refused.exit_code == 2
    assert "runs/paper: is not empty (case.toml)" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
    assert invoke("run", "paper", "--overwrite").exit_code == 0
    assert fake.overwrites == [False, True]


def test_a_finished_run_is_extended_in_its_folder(fake: FakeRun) -> None:
    assert invoke("run", "paper").exit_code == 0
    assert invoke("run", "paper", "--extend", "40", "-q").exit_code == 0
    assert fake.extensions == [0, 40]
    refused = invoke("run", "paper", "--extend", "0")
    assert (refused.exit_code, len(fake.extensions)) == (2, 2)


@pytest.mark.slow
def test_report_is_made_again_without_computing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = {"mesh.elements": 3, "time.steps_per_period": 40, "time.periods": 3}
    small = {**keys, "output.window_periods": 2, "output.fields_per_period": 2}
    sets = [f"--set={key}={value}" for key, value in small.items()]
    folder = tmp_path / "run"
    assert invoke("run", "paper", *sets, "-q", "-o", folder).exit_code == 0
    made = {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}
    assert Path("fields/fields.pvd") in made
    shutil.rmtree(folder / "figures")
    shutil.rmtree(folder / "fields")
    (folder / "report.html").unlink()
    before = (folder / "result.nc").read_bytes()
    monkeypatch.setitem(sys.modules, "delam_fem.pipeline", None)  # cannot be imported
    again = invoke("run", "paper", *sets, "-q", "-o", folder, "--resume")
    assert (again.exit_code, again.output) == (0, "")  # complete: nothing to compute
    result = invoke("show", "page", folder)
    assert result.exit_code == 0, result.output
    assert {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()} == made
    assert (folder / "result.nc").read_bytes() == before


@pytest.mark.parametrize(("content", "word"), [(None, "found no"), (b"no", "damaged")])
def test_report_of_what_is_no_run(content: bytes | None, word: str, tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / "result.nc").write_bytes(content)
    missing = tmp_path / "none"
    for folder, words in ((tmp_path, ["result.nc", word]), (missing, ["none"])):
        result = invoke("show", "page", folder)
        assert (result.exit_code, result.stdout) == (2, "")
        assert all(text in result.stderr for text in [str(folder), *words])
        assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("error", "status", "text"),
    [
        (CaseError("mesh.file: node 3 is not opposite"), 2, "mesh.file: node 3 is not"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (OSError(errno.ENOSPC, "No space left on device", "x.nc"), 1, "x.nc: No space left"),
    ],
)
def test_status_of_a_run_that_fails(
    fake: FakeRun, error: BaseException, status: int, text: str
) -> None:
    fake.error = error
    result = invoke("run", "paper")
    assert result.exit_code == status
    assert f"delam-fem: {text}" in result.stderr
    assert "Traceback" not in result.output


def test_disk_full_while_saving(fake: FakeRun) -> None:
    fake.save_error = OSError(errno.ENOSPC, "No space left on device", "result.nc")
    result = invoke("run", "paper")
    assert result.exit_code == 1
    assert "delam-fem: result.nc: No space left on device" in result.stderr


@pytest.mark.parametrize(
    ("override", "text"),
    [
        ("contact.restitutoin=0.1", "contact.restitutoin: unknown key; did you mean restitution?"),
        ("lamina.thick.length=-1", "lamina.thick.length: "),
        ("contact.restitution=1.5", "contact.restitution: "),
        ("mesh.elements=0", "mesh.elements: "),
        ("time.steps_per_period=0", "time.steps_per_period: "),
        ("gap.file=none.csv", "gap.file: no such file"),
        ("gap.tip=nan", "gap.tip: "),
        ("frequency", "expected KEY=VALUE"),
    ],
)
def test_bad_key_is_told_before_the_run(fake: FakeRun, override: str, text: str) -> None:
    result = invoke("run", "paper", "--set", override)
    assert (result.exit_code, result.stdout, fake.calls) == (2, "", [])
    assert result.stderr.startswith("delam-fem: ")
    assert text in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("case", "text"),
    [
        ("pape", "case 'pape': neither a file nor a preset; .* paper, default"),
        ("none.toml", "case file none.toml: no such file"),
        ("runs/none", "case file runs/none: no such file"),
    ],
)
@pytest.mark.parametrize("command", ["run", "compare", "modes"])
def test_missing_case(command: str, case: str, text: str) -> None:
    result = invoke(command, case)
    assert result.exit_code == 2
    with pytest.raises(ValueError, match=text):
        raise ValueError(result.stderr)


def test_output_folder_that_cannot_be_written(fake: FakeRun) -> None:
    Path("file").write_text("in the way")
    result = invoke("run", "paper", "-o", "file/below")
    assert (result.exit_code, fake.calls) == (2, [])
    assert "output folder file/below: cannot be written (Not a directory)" in result.stderr


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        ("0,0\n0.3,nan\n0.685,0.012\n", "line 2: "),
        ("0,0\n0.3,-1e-3\n0.685,0.012\n", "line 2: the gap starts closed beyond the clamp"),
    ],
)
def test_bad_gap_table_ends_a_real_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: str, text: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("gap.csv").write_text(rows)
    result = invoke("modes", "paper", "--set", "gap.file=gap.csv")
    assert result.exit_code == 2, result.output
    assert text in result.stderr


MESH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
1 1 "thick"
1 2 "thin"
$EndPhysicalNames
$Nodes
6
1 0 0 0
2 {first} 0 0
3 0.685 0 0
4 0 0.01 0
5 {second} 0.01 0
6 0.685 0.01 0
$EndNodes
$Elements
4
1 1 2 1 1 1 2
2 1 2 1 1 2 3
3 1 2 2 2 4 5
4 1 2 2 2 5 6
$EndElements
"""


def test_mesh_with_and_without_opposite_nodes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mesh.msh").write_text(MESH.format(first=0.3, second=0.3))
    result = invoke("modes", "paper", "--set", "mesh.file=mesh.msh", "-n", "1", "-o", "m")
    assert result.exit_code == 0, result.output
    assert "exact [Hz]" in result.stdout
    assert Path("m/modes.json").is_file()
    Path("mesh.msh").write_text(MESH.format(first=0.3, second=0.31))
    result = invoke("modes", "paper", "--set", "mesh.file=mesh.msh")
    assert result.exit_code == 2, result.output
    assert "expected opposite nodes" in result.stderr
    assert "0.3 m on the first and 0.31 m on the second" in result.stderr


def test_comparison_is_shown_and_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke("compare", "paper", "--set", "mesh.elements=4", "--periods", "1", "-o", "c")
    assert result.exit_code == 0, result.stderr
    assert "largest differences" in result.output
    assert list((tmp_path / "c").iterdir())
    quiet = invoke("compare", "paper", "--set", "mesh.elements=4", "--periods", "1", "-q")
    assert (quiet.exit_code, quiet.stdout) == (0, "")
    assert (tmp_path / "runs" / "paper-compare").is_dir()


def test_presets_are_listed_and_shown() -> None:
    assert invoke("new", "--list").stdout.split() == ["paper", "default", "embedded", "edge"]
    result = invoke("new", "--from", "paper")
    assert Case.from_toml(result.stdout) == preset("paper")
    unknown = invoke("new", "--from", "x")
    assert (unknown.exit_code, unknown.stderr.count("preset 'x': unknown")) == (2, 1)


def test_a_preset_or_the_schema_is_written_to_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert invoke("new", "mine", "--from", "edge").stdout.split() == ["mine.toml"]
    assert load_case("mine.toml") == preset("edge", {"name": "mine"})
    assert invoke("new", "--from", "edge", "-o", "mine.toml").exit_code == 2  # never replaced
    assert invoke("new", "--schema", "-o", "s.json").exit_code == 0
    assert Path("s.json").read_text("utf-8") == invoke("new", "--schema").stdout
    for words, told in {
        ("x", "--list"): "no NAME goes with --list",
        ("--kind", "edge", "--from", "edge"): "expected one of --kind and --from, given both",
    }.items():
        refused = invoke("new", *words)
        assert (refused.exit_code, refused.stderr.count(told)) == (2, 1)
    assert {path.name for path in tmp_path.iterdir()} == {"mine.toml", "s.json"}


def test_help_shows_the_groups() -> None:
    text = invoke("--help").stdout
    assert all(f"─ {group} ─" in text for group in commands())
    command_names = {line.split()[1] for line in text.splitlines() if line.startswith("│ ")}
    today = {name.split()[0] for group in commands().values() for name in group}
    assert today <= command_names
    for first in ("orbit", "measure", "identify", "detect", "show"):
        told = invoke(first, "--help").stdout
        seconds = {
            n.split()[1] for g in commands().values() for n in g if n.startswith(f"{first} ")
        }
        assert seconds <= set(told.split())


def test_version_and_usage() -> None:
    assert invoke("--version").stdout.strip() == delam_fem.__version__
    assert invoke("run", "paper", "--engine", "steam").exit_code == 2
    assert invoke("run").exit_code == 2


def test_help_loads_nothing_heavy() -> None:
    code = (
        "import sys; from typer.testing import CliRunner; from delam_fem.cli.app import app;"
        "assert CliRunner().invoke(app, ['--help']).exit_code == 0;"
        "import delam_fem; delam_fem.CaseError;"
        "print({'dolfinx', 'matplotlib', 'xarray', 'petsc4py'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_only_public_names_are_attributes_of_the_package() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        delam_fem.nothing  # noqa: B018
    assert set(delam_fem.__all__) == set(dir(delam_fem))


def test_plain_progress_speaks_each_tenth_and_after_silence() -> None:
    lines: list[str] = []
    now = [100.0]
    report = PlainProgress(lines.append, 1000, clock=lambda: now[0])
    for done in range(101, 201):  # resumed at 100 of 200
        report(done, 200)
        now[0] += 0.5
    assert [line.split(",")[0] for line in lines] == [
        f"period {done} of 200" for done in range(120, 201, 20)
    ]
    assert lines[0] == "period 120 of 200, 2,000 steps/s, 40 s left"
    slow: list[str] = []
    report = PlainProgress(slow.append, 1000, clock=lambda: now[0])
    for done in range(1, 4):
        now[0] += 11.0
        report(done, 1000)
    assert slow == [
        "period 2 of 1000, 91 steps/s, 10978 s left",
        "period 3 of 1000, 91 steps/s, 10967 s left",
    ]


def test_bar_on_a_terminal(tmp_path: Path) -> None:
    with (tmp_path / "screen").open("w+", encoding="utf-8") as screen:
        with progress(Console(file=screen, force_terminal=True, width=100), 1000) as report:
            for done in range(1, 6):
                report(done, 5)
        screen.seek(0)
        assert "period 5 of 5" in screen.read()


def test_a_note_is_written_once_whatever_other_packages_log(
    fake: FakeRun, capfd: pytest.CaptureFixture[str]
) -> None:
    handler = logging.StreamHandler()  # as FFCx gives the root logger one
    logging.getLogger().addHandler(handler)
    try:
        result = CliRunner().invoke(app, ["run", "paper"])
    finally:
        logging.getLogger().removeHandler(handler)
    both = result.output + capfd.readouterr().err
    assert both.count("note of the run") == 1


@pytest.mark.parametrize(("given", "number"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")])
def test_the_command_gives_blas_one_thread(given: dict[str, str], number: str) -> None:
    """Another that waits for work would cost as much as the one that works."""
    program = (
        "import os, delam_fem.cli, numpy as np; np.ones((500, 500)) @ np.ones((500, 500))\n"
        "print(os.environ['OPENBLAS_NUM_THREADS'], len(os.listdir('/proc/self/task')))"
    )
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    process = subprocess.run(
        [sys.executable, "-c", program],
        env=environment | given,
        capture_output=True,
        text=True,
        check=True,
    )
    told, threads = process.stdout.split()
    assert told == number
    assert 1 <= int(threads) <= int(number)


def test_a_very_long_line_loses_its_middle() -> None:
    short, long = 300 * "ab ", 10 * "0123456789" + 3000 * "x" + "end"
    assert shortened(short) == short
    told = shortened(long)
    assert len(told) == LONGEST + 3
    assert told.startswith("0123") and told.endswith("xend") and " … " in told
