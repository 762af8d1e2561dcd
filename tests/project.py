"""The project's scripts as tests use them: Python scripts as modules, shell scripts by function."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[1]
EVIDENCE = ROOT / "scripts" / "evidence"


def script(name: str) -> ModuleType:
    """Import a script that makes evidence."""
    spec = importlib.util.spec_from_file_location(name, EVIDENCE / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def shell(file: Path, lines: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run lines of bash after the functions of a file are read."""
    return subprocess.run(
        ["bash", "-c", f"source '{file}'\n{lines}"],
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=600,
    )


def peak_memory() -> int:
    """Return the largest memory of this program [B]; `getrusage` counts that of its parent, too."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    [kilobytes] = [line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:")]
    return 1024 * int(kilobytes)
