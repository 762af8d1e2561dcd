"""Overdamped waves of the paper's laminae, and the warnings of a refinement below them."""

import logging
import math
from pathlib import Path

import numpy as np
import pytest

from delam_fem import preset
from delam_fem.studies.convergence.refinement import (
    RefinementStudy,
    method,
    refinement_warnings,
    short_waves,
)
from delam_fem.studies.convergence.run import run_refinement


@pytest.mark.parametrize(
    ("damping", "thick", "thin", "length"),
    [("stiffness", 395.6, 179.5, 0.2053), ("two-mode", 2874.9, 1304.1, 0.07616)],
)
def test_the_longest_overdamped_wave(
    damping: str, thick: float, thin: float, length: float
) -> None:
    case = preset("paper", {"damping.rayleigh": damping})
    waves = short_waves(case)
    assert [frequency for _, frequency in waves] == pytest.approx([thick, thin], rel=1e-3)
    assert [wave for wave, _ in waves] == pytest.approx([length] * 2, rel=1e-3)
    for i, (wave, frequency) in enumerate(waves):
        omega, (alpha, beta) = 2.0 * math.pi * frequency, case.rayleigh(i)
        assert 0.5 * (alpha / omega + beta * omega) == pytest.approx(1.0)
        lamina = case.lamina[i]
        k = 2.0 * math.pi / wave
        dispersion = np.sqrt(lamina.flexural_rigidity / lamina.mass_per_length) * k**2
        assert dispersion == pytest.approx(omega)


@pytest.mark.parametrize(
    ("damping", "points", "first"),
    [
        ("stiffness", (4, 6), None),
        ("stiffness", (4, 7, 20), 7),
        ("two-mode", (17,), None),
        ("two-mode", (10, 18), 18),
        ("mass", (10, 342), None),
    ],
)
def test_a_mesh_that_holds_overdamped_waves_is_told(
    damping: str, points: tuple[int, ...], first: int | None
) -> None:
    texts = refinement_warnings(preset("paper", {"damping.rayleigh": damping}), points)
    assert len(texts) == (first is not None)
    if first is not None:
        assert texts[0].startswith(f"meshes from {first} points") and damping in texts[0]


def test_points_nearer_than_the_thickness_are_told() -> None:
    case = preset("paper", {"damping.rayleigh": "mass"})
    assert not refinement_warnings(case, (342,))
    (text,) = refinement_warnings(case, (20, 343, 400))
    assert text.startswith("meshes from 343 points") and "thickness 2 mm of thick" in text


def test_a_refinement_warns_before_it_computes(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    case = preset("paper", {"damping.rayleigh": "two-mode", "contact.impulse": "consistent"})
    few = case.model_copy(
        update={"contact": case.contact.model_copy(update={"points_per_element": 10})}
    )
    with caplog.at_level(logging.WARNING):
        run_refinement(
            RefinementStudy(case, (), (2,), (40,), 1, 0), tmp_path / "a", "serial", workers=1
        )
    assert "overdamped" not in caplog.text
    with caplog.at_level(logging.WARNING):
        chosen = RefinementStudy(few, (method("newton@newmark"),), (2,), (40,), 1, 0)
        run_refinement(chosen, tmp_path / "b", "serial", workers=1)
    assert "meshes from 20 points along the laminae on (34.2 mm apart)" in caplog.text
