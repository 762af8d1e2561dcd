import json
from pathlib import Path

import numpy as np
import pytest

from delam_fem.api import CaseError, preset
from delam_fem.studies.identification.resonance import HEADING, identified
from delam_fem.studies.identification.study import Resonance

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


@pytest.mark.slow
@pytest.mark.parametrize("noise", [pytest.param(0.0, marks=pytest.mark.nightly), 1e-4])
def test_a_simulated_sweep_gives_the_rig_back(tmp_path: Path, noise: float) -> None:
    """Steps change the frequencies by 2e-4, elements by 3e-5: both are taken out."""
    case = preset("paper", SWEEP)
    result = identified(case, Resonance(noise=noise))
    for lamina, one in zip(case.lamina, result.resonances, strict=True):
        exact = float(lamina.angular_frequencies(1)[0]) / (2.0 * np.pi)
        assert one.peak - exact > 0.02  # the bias of a sweep that rises
        assert abs(one.frequency - exact) < 2.0 * one.frequency_error < 1e-4
        assert abs(one.damping_ratio - lamina.damping_ratio) < 2.0 * one.damping_error < 1e-5
        EI, error = one.bending_stiffness(lamina)
        assert abs(EI - lamina.flexural_rigidity) < 2.0 * error < 1e-4 * EI
    numbers, *images = result.save(tmp_path)
    assert json.loads(numbers.read_text())["thin"]["peak_hz"] > 1.45
    assert all(image.stat().st_size > 10_000 for image in images)
    assert all(len(row) == len(HEADING) for row in result.report.tables[0].rows)


@pytest.mark.slow
@pytest.mark.parametrize("rayleigh", ["mass", "stiffness", "two-mode"])
def test_a_record_that_begins_with_the_sweep_is_not_said_to_begin_at_another_time(
    rayleigh: str,
) -> None:
    """Damping by mass acts against what rests: its phases look like a delay of 2 D/ω = 2 ms."""
    keys = {"excitation.start_frequency": 2.5, "excitation.duration": 60.0,
            "damping.rayleigh": rayleigh, "lamina.thick.damping_ratio": 0.02}  # fmt: skip
    thick, _ = identified(preset("paper", SWEEP | keys), Resonance()).resonances
    assert abs(thick.late) < 1e-4
    assert not any("begins" in text for text in thick.remarks)


def test_a_harmonic_case_is_refused() -> None:
    with pytest.raises(CaseError, match='expected "sweep" with an amplitude'):
        identified(preset("paper"), Resonance())
