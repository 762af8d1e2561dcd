"""Studies that other packages add: found by their entry points, in Python and as commands."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from project import ROOT

import delam_fem as df
from delam_fem.api import CaseError, Kinds, Study
from delam_fem.plugins.discovery import GROUP, homes, studies

EXAMPLE = ROOT / "docs" / "examples" / "plugin"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_all_studies_of_this_package_are_found() -> None:
    declared = PROJECT["entry-points"][GROUP]
    assert declared.items() <= {name: point.value for name, point in homes().items()}.items()
    assert all(isinstance(getattr(df, name), object) for name in declared)
    assert len({study.words for study in studies().values()}) == len(studies())


def installed(folder: Path, points: str) -> dict[str, str]:
    """Return an environment in which the package of the example is installed."""
    metadata = folder / "delam_fem_deflection-0.1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: delam_fem_deflection\n")
    (metadata / "entry_points.txt").write_text(f"[{GROUP}]\n{points}\n")
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), str(EXAMPLE)])}


def test_a_study_of_another_package_is_a_command_and_a_name_of_python(tmp_path: Path) -> None:
    points = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]["entry-points"]
    ((name, value),) = points[GROUP].items()
    environment = installed(tmp_path, f"{name} = {value}")
    command = [sys.executable, "-m", "delam_fem", "deflection"]
    told = subprocess.run(
        [*command, "--help"], env=environment, capture_output=True, text=True, check=True
    )
    assert "Show how far each lamina bends" in " ".join(told.stdout.split())
    code = (
        "import delam_fem as df; print(*df.deflection(df.preset('paper', {'mesh.elements': 4}), "
        "force=2.0).ends)"
    )
    ends = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    stiffness = np.array([1.51, 0.16])  # EI of the paper's laminae, N m2
    expected = 2.0 * 0.685**3 / (3.0 * stiffness)
    assert np.array(ends.stdout.split(), dtype=float) == pytest.approx(expected, rel=1e-9)


def test_a_study_that_cannot_be_loaded_stops_no_other(tmp_path: Path) -> None:
    environment = installed(tmp_path, "broken = no_such_module:STUDY\nnot_one = math:pi")
    told = subprocess.run(
        [sys.executable, "-m", "delam_fem", "modes", "--help"],
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert told.returncode == 0, told.stderr


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"takes": Kinds(("solid",), "it needs a surface")}, "model.kind"),
        ({"needs": "delamination"}, "delamination"),
    ],
)
def test_a_study_refuses_what_it_does_not_take(changes: dict[str, object], key: str) -> None:
    from delam_fem.studies.modes.study import Modes

    study: Study[Modes, object] = Study(Modes, "math:nothing", "Compute", "modes", **changes)
    with pytest.raises(CaseError, match=key):
        study("paper")
