"""Files beside a case that comes from somebody else run no code and change no setting."""

import json
import sys
from pathlib import Path

import pytest
from attack.processes import command, ended, sweep_text

RUN = {
    "mesh.elements": 4,
    "time.steps_per_period": 50,
    "time.periods": 2,
    "output.window_periods": 1,
    "contact.impulse": "consistent",
}
INTRUDER = "open({!r}, 'a').close()\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder whose files leave a trace in `traces` when they are read."""
    traces, arch = tmp_path / "traces", tmp_path / "arch"
    traces.mkdir()
    arch.mkdir()
    (tmp_path / ".petscrc").write_text(f"-log_view :{traces / 'petscrc'}\n")
    (tmp_path / "petsc.cfg").write_text(f"PETSC_ARCH = {arch}\n")
    (arch / "PETSc.py").write_text(INTRUDER.format(str(traces / "petsc.cfg")))
    (tmp_path / ".numba_config.yaml").write_text(f"cache_dir: {traces / 'numba'}\n")
    (tmp_path / "matplotlibrc").write_text("no.such.key: 1\n")  # matplotlib logs a warning
    for name in ("parameters", "options"):  # whoever reads them fails
        (tmp_path / f"dolfinx_jit_{name}.json").write_text("[1")
        (tmp_path / f"ffcx_{name}.json").write_text("[1")
    for name in ("multiprocessing", "pickle", "random", "socket"):
        (tmp_path / f"{name}.py").write_text(INTRUDER.format(str(traces / name)))
    return tmp_path


@pytest.mark.slow
def test_a_run_reads_no_settings_there(folder: Path) -> None:
    line = [*program(), "run", "paper", "-q", "-o", "out", *command(keys=RUN)[3:]]
    status, errors = ended(line, cwd=folder)
    assert (status, "matplotlibrc" in errors) == (0, False), errors
    assert [*(folder / "traces").iterdir()] == []
    assert json.loads((folder / "out" / "summary.json").read_text())["outcome"] == "completed"


@pytest.mark.slow
def test_the_workers_of_a_sweep_read_none_either(folder: Path) -> None:
    (folder / "s.toml").write_text(sweep_text(periods=5, count=2))
    status, errors = ended([*program(), "sweep", "s.toml", "-j", "1", "-o", "out"], cwd=folder)
    assert (status, "matplotlibrc" in errors) == (0, False), errors
    assert [*(folder / "traces").iterdir()] == []


def program() -> list[str]:
    """Return the installed command; `python -m` would put the working folder on the path."""
    return [str(Path(sys.executable).with_name("delam-fem"))]
