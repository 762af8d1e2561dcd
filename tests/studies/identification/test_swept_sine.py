import json
from pathlib import Path

import numpy as np
import pytest

from delam_fem.case.files import preset
from delam_fem.case.toml import CaseError
from delam_fem.studies.identification.swept_sine import HEADING, identified

SWEEP = {
    "excitation.kind": "sweep",
    "excitation.start_frequency": 1.0,
    "excitation.end_frequency": 4.0,
    "excitation.duration": 300.0,
    "excitation.amplitude": 0.0025,
    "time.steps_per_period": 100,
    "mesh.elements": 4,
    "output.window_periods": 1,
}


def test_a_simulated_sweep_gives_the_rig_back(tmp_path: Path) -> None:
    case = preset("paper", SWEEP)
    found = identified(case, noise=1e-4)
    for lamina, one in zip(case.lamina, found.resonances, strict=True):
        exact = float(lamina.angular_frequencies(1)[0]) / (2.0 * np.pi)
        assert one.peak - exact > 0.02  # the bias of a sweep that rises
        assert one.frequency == pytest.approx(exact, rel=5e-4)
        assert one.damping_ratio == pytest.approx(lamina.damping_ratio, rel=0.03)
        assert one.bending_stiffness(lamina)[0] == pytest.approx(
            lamina.flexural_rigidity, rel=1.5e-3
        )
    numbers, *images = found.save(tmp_path)
    assert json.loads(numbers.read_text())["thin"]["peak_hz"] > 1.45
    assert all(image.stat().st_size > 10_000 for image in images)
    assert all(len(row) == len(HEADING) for row in found.rows())


def test_a_harmonic_case_is_refused() -> None:
    with pytest.raises(CaseError, match='expected "sweep" with an amplitude'):
        identified(preset("paper"))
