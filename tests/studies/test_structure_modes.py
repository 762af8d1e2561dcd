"""Modes of whole structures: free and closed delaminations, partners, openings, files, messages."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from delam_fem import modes
from delam_fem.api import Case, CaseError, assemble, preset
from delam_fem.cli.app import app
from delam_fem.model.beams.network import never_opens
from delam_fem.studies.modes.frequencies import NaturalModes, StructureModes, structure_modes

MID_PLANE = {"lamina.lower.thickness": 0.001, "lamina.upper.thickness": 0.001}


@pytest.fixture(scope="module")
def case() -> Case:
    return preset("embedded")


@pytest.fixture(scope="module")
def free(case: Case) -> StructureModes:
    return structure_modes(assemble(case, needs_dolfinx=False), case, 4)


@pytest.fixture(scope="module")
def closed(case: Case) -> StructureModes:
    return structure_modes(assemble(case, needs_dolfinx=False), case, 4, kind="closed")


def test_closed_delaminations_raise_every_frequency(
    free: StructureModes, closed: StructureModes
) -> None:
    assert (closed.frequencies > free.frequencies).all()
    assert free.frequencies[:2] == pytest.approx([63.177, 137.157], abs=1e-3)
    assert closed.frequencies[0] == pytest.approx(64.521, abs=1e-3)


def test_modes_are_paired_by_shape(free: StructureModes, closed: StructureModes) -> None:
    assert free.partners.tolist() == [0, -1, 1, -1]  # the second breathes and has no partner
    assert closed.partners[:2].tolist() == [0, 2]
    assert free.partner_frequencies[0] == pytest.approx(closed.frequencies[0], rel=1e-12)
    f, g = free.frequencies[0], closed.frequencies[0]
    assert free.bilinear_frequencies[0] == pytest.approx(1.0 / (0.5 / f + 0.5 / g), rel=1e-14)
    assert np.isnan(free.bilinear_frequencies[1])


def test_modes_say_how_far_they_open(free: StructureModes, closed: StructureModes) -> None:
    apart = np.abs(free.shapes[:, 1] - free.shapes[:, 0]).max(axis=1)
    assert free.openings[:, 0] == pytest.approx(apart)
    assert np.abs(free.shapes).max(axis=(1, 2)) == pytest.approx(np.ones(4))
    assert closed.openings.max() < 1e-12


def test_mid_plane_delamination_has_the_same_first_modes_free_and_closed() -> None:
    case = preset("embedded", MID_PLANE)
    free = structure_modes(assemble(case, needs_dolfinx=False), case, 2)
    assert free.partner_frequencies == pytest.approx(free.frequencies, rel=1e-12)
    assert free.openings.max() < 1e-8
    assert "never opens" not in str(never_opens(case)) and "ever opens" in str(never_opens(case))


def test_other_depths_and_forces_open() -> None:
    assert never_opens(preset("embedded")) is None
    assert never_opens(preset("paper")) is None
    force = {
        "excitation": {
            "kind": "force",
            "lamina": "upper",
            "position": 0.2,
            "amplitude": 0.01,
            "frequency": 60.0,
        }
    }
    assert never_opens(preset("embedded", MID_PLANE | force)) is None


@pytest.mark.parametrize(("supports", "rigid"), [("free free", 2), ("pinned free", 1)])
def test_floating_structures_have_rigid_modes(case: Case, supports: str, rigid: int) -> None:
    start, end = supports.split()
    floating = case.with_overrides({"support.start": start, "support.end": end})
    for kind in ("free", "closed"):
        computed = structure_modes(
            assemble(floating, needs_dolfinx=False), floating, 4, kind=kind
        ).frequencies
        assert computed[:rigid] == pytest.approx(np.zeros(rigid), abs=1e-3)
        assert computed[rigid] > 10.0
    intact = case.with_overrides(
        {"support.start": start, "support.end": end, "delamination.1.end": 0.1201}
    )
    root = 4.730040744862704 if rigid == 2 else 3.926602312047919
    unit = np.sqrt(70e9 * 0.002**2 / 12 / 2700.0) / (2.0 * np.pi * 0.4**2)
    computed = structure_modes(assemble(intact, needs_dolfinx=False), intact, 3).frequencies[rigid]
    assert computed == pytest.approx(root**2 * unit, rel=1e-4)


@pytest.mark.usefixtures("pictures")
def test_files_and_pictures(free: StructureModes, tmp_path: Path) -> None:
    table, picture = free.save(tmp_path / "new")
    content = json.loads(table.read_text())
    assert content["structure_frequency_hz"] == free.frequencies.tolist()
    assert content["bilinear_frequency_hz"][1] is None
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert len(free.figure().axes) == 4


def test_apart_laminae_have_both(tmp_path: Path) -> None:
    result = modes(preset("paper"), 2, delaminations="closed")
    assert isinstance(result, NaturalModes) and result.structure is not None
    content = json.loads(result.save(tmp_path)[0].read_text())
    # one beam without friction: (EI1 + EI2) / (rhoA1 + rhoA2)
    EI, rhoA = 1.51 + 0.16, 0.04 * (0.002 * 2680.0 + 0.001 * 2760.0)
    exact = (1.8751040687119611 / 0.685) ** 2 * np.sqrt(EI / rhoA) / (2.0 * np.pi)
    assert content["structure_frequency_hz"][0] == pytest.approx(exact, rel=1e-6)
    assert len(content["frequency_hz"]) == 2


def test_command_lists_both_kinds(tmp_path: Path) -> None:
    for kind in ("free", "closed"):
        arguments = ["modes", "embedded", "-n", "2", "-o", str(tmp_path / kind)]
        result = CliRunner().invoke(app, [*arguments, "--delaminations", kind])
        assert result.exit_code == 0, result.output
        assert "bilinear" in result.output
    free, closed = (
        json.loads((tmp_path / kind / "modes.json").read_text())["structure_frequency_hz"]
        for kind in ("free", "closed")
    )
    assert free[0] < closed[0]


def test_impossible_numbers_of_modes_are_refused(case: Case) -> None:
    with pytest.raises(CaseError, match=r"number of modes: .*given 79"):
        structure_modes(assemble(case, needs_dolfinx=False), case, 79)


def test_motions_without_mass_are_no_modes() -> None:
    keys = {"mesh.elements": 4, "time.mass": "massless", "contact.law": "newton"}
    case = preset("default", keys | {"contact.restitution": 0.0})
    structure = assemble(case, needs_dolfinx=False)
    result = structure_modes(structure, case, 6)
    usual = structure_modes(
        assemble(preset("paper", {"mesh.elements": 4}), needs_dolfinx=False), case, 6
    )
    assert result.frequencies[:2] == pytest.approx(usual.frequencies[:2], rel=0.01)
    with pytest.raises(CaseError, match="1 to 4, as no more motions have mass, given 6"):
        structure_modes(structure, case, 6, kind="closed")
