"""Modes of solids are named for what they are; openings are those of the surfaces."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import delam_fem as df
from delam_fem.studies.modes.frequencies import StructureModes

WIDTH, THICKNESS = 0.02, 0.008
LAMINA = {
    "length": 0.3, "width": WIDTH, "density": 2700.0, "young_modulus": 7e10, "damping_ratio": 0.01,
}  # fmt: skip


def split_beam(kind: str) -> df.Case:
    """Return a cantilever of 5 mm and 3 mm, not bonded over a third of its length."""
    return df.Case.model_validate(
        {
            "name": "split",
            "lamina": [
                LAMINA | {"name": "low", "thickness": 0.005},
                LAMINA | {"name": "up", "thickness": 0.003},
            ],
            "delamination": [{"between": ["low", "up"], "start": 0.1, "end": 0.2}],
            "mesh": {"elements": 15}, "model": {"kind": kind, "poisson": 0.3},
            "excitation": {"kind": "harmonic", "amplitude": 1e-3, "frequency": 5.0},
            "contact": {"law": "none"},
        }
    )  # fmt: skip


def test_modes_of_a_solid_bend_turn_and_move_sideways(tmp_path: Path) -> None:
    result = df.modes(split_beam("solid"), 8)
    assert isinstance(result, StructureModes)
    by_motion = {
        name: result.frequencies[np.array(result.motions) == name] for name in result.motions
    }
    bending, sideways, torsion = (by_motion[m] for m in ("bending", "sideways", "torsion"))
    # both ways a cantilever: EI goes with the square of the height beside that of the width
    assert sideways[0] / bending[0] == pytest.approx(WIDTH / THICKNESS, rel=0.03)
    assert sideways[1] / sideways[0] == pytest.approx((4.6941 / 1.8751) ** 2, rel=0.04)
    # a quarter wave of torsion, with J = k b h³ of rectangles (Timoshenko): of the whole section,
    # and of both layers without a bond; the delamination over a third lies between
    bonded_section, layers = (
        0.249 * 8.0**3,
        0.281 * 5.0**3 + 0.302 * 3.0**3,
    )  # k at b/h = 2.5, 4, 6.7; mm³
    polar = WIDTH * THICKNESS * (WIDTH**2 + THICKNESS**2) / 12.0
    bonded, apart = (
        np.sqrt(7e10 / 2.6 * 1e-9 * J * WIDTH / (2700.0 * polar)) / (4.0 * 0.3)
        for J in (bonded_section, layers)
    )
    assert apart < torsion[0] < bonded
    assert np.isfinite(result.openings).all()
    assert result.openings.max() <= 2.0  # both sides move by 1 at most
    assert np.abs(result.shapes).max() <= 1.0 + 1e-12
    paths = result.save(tmp_path)
    written = json.loads(next(path for path in paths if path.suffix == ".json").read_text())
    assert written["motion"] == list(result.motions)


def test_modes_of_beams_all_bend_and_need_no_word() -> None:
    result = df.modes(split_beam("beam"), 5)
    assert isinstance(result, StructureModes)
    assert set(result.motions) == {"bending"}
    assert "motion" not in result.report.tables[-1].heading
