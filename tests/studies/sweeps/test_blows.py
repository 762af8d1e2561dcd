"""Sweeps tell at which points blows on contact springs have too few steps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from delam_fem.cli.app import app
from delam_fem.studies.sweeps.dataset import open_result

STIFFNESSES = (1e-2, 1e4, 1e6)
TEXT = """
base = "paper"
[set]
"mesh.elements" = 3
"time.steps_per_period" = 400
"time.periods" = 3
"contact.law" = "{law}"
"output.window_periods" = 2
"output.fields_per_period" = 0
[record]
strobes = 0
[[axis]]
key = "contact.penalty_stiffness"
values = {values}
"""


@pytest.mark.slow
@pytest.mark.parametrize("law", ["penalty", "newton"])
def test_a_sweep_tells_unresolved_blows(law: str, tmp_path: Path) -> None:
    path, folder = tmp_path / "s.toml", tmp_path / "out"
    path.write_text(TEXT.format(law=law, values=list(STIFFNESSES)))
    done = CliRunner().invoke(app, ["sweep", str(path), "-o", str(folder), "-j", "1", "-q"])
    assert done.exit_code == 0, done.output
    page = (folder / "report.html").read_text()
    with open_result(folder / "sweep.nc") as data:
        counts = data["blow_steps"].to_numpy()
    if law == "newton":
        assert np.isnan(counts).all() and "blow" not in done.stderr + page
        return
    assert counts * np.sqrt(STIFFNESSES) == pytest.approx(counts[0] * np.sqrt(STIFFNESSES[0]))
    assert counts[0] > 10.0 > counts[1]
    text = "at 2 of 3 completed points a blow on a contact spring has fewer than 10 steps"
    assert f"warning: {text}, {counts[2]:.2g} at the fewest" in " ".join(done.stderr.split())
    assert text in page and "blow steps" in page
