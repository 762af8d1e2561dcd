"""Modes beside the exact cantilever: numbers, shapes, files, bad input."""

import json
from pathlib import Path

import numpy as np
import pytest

from delam_fem import modes
from delam_fem.api import Case, CaseError, Structure, assemble, preset
from delam_fem.model import linear
from delam_fem.numerics.beams import cantilever_mode
from delam_fem.studies.modes.frequencies import NaturalModes, modes_of

FIRST = 1e-5  # relative, of f1 at 20 elements; the elements' own error is 5e-8
SHAPE = 1e-4  # of the tip; nodal values of cubic elements converge at order 4, B h = 0.55 here


@pytest.fixture(scope="module")
def paper() -> Case:
    return preset("paper")


@pytest.fixture(scope="module")
def model(paper: Case) -> Structure:
    return assemble(paper, needs_dolfinx=False)


def test_first_frequencies_are_those_of_the_cantilevers(paper: Case, model: Structure) -> None:
    lamina_modes = modes_of(model, paper, 4)
    np.testing.assert_allclose(lamina_modes.exact[:, 0], [3.1649, 1.4357], atol=5e-5)
    assert np.abs(lamina_modes.relative_differences[:, 0]).max() < FIRST
    assert np.all(lamina_modes.relative_differences > 0.0)  # conforming elements are too stiff


def test_shapes_lie_on_the_exact_ones(paper: Case, model: Structure) -> None:
    lamina_modes = modes_of(model, paper, 4)
    for k in range(4):
        exact = cantilever_mode(k + 1, model.layout.x / model.layout.x[-1])
        for i in range(2):
            np.testing.assert_allclose(lamina_modes.shapes[i, k], exact, atol=SHAPE)


def test_iterative_solver_finds_the_same(
    paper: Case, model: Structure, monkeypatch: pytest.MonkeyPatch
) -> None:
    dense = modes_of(model, paper, 6)
    monkeypatch.setattr(linear, "DENSE_DOFS", 0)
    iterative = modes_of(model, paper, 6)
    np.testing.assert_allclose(iterative.frequencies, dense.frequencies, rtol=1e-8)
    np.testing.assert_allclose(iterative.shapes, dense.shapes, atol=1e-6)


def test_all_modes_of_one_element_can_be_had(paper: Case) -> None:
    case = paper.with_overrides({"mesh.elements": 1})
    lamina_modes = modes_of(assemble(case, needs_dolfinx=False), case, 2)
    # Ritz with one cubic: omega1 = 3.533, omega2 = 34.807 for unit length, EI, rho A.
    ratio = lamina_modes.frequencies[0] / lamina_modes.exact[0]
    np.testing.assert_allclose(ratio, [3.5327 / 3.5160, 34.8069 / 22.0345], rtol=1e-4)


def test_rows_name_lamina_mode_and_difference(paper: Case, model: Structure) -> None:
    rows = modes_of(model, paper, 2).report.tables[0].rows
    assert [row[:2] for row in rows] == [
        ("thick", "1"),
        ("thick", "2"),
        ("thin", "1"),
        ("thin", "2"),
    ]
    assert rows[0][2:4] == ("3.16494", "3.16494")
    assert rows[0][4].startswith("+")


def test_save_writes_table_and_picture(paper: Case, model: Structure, tmp_path: Path) -> None:
    lamina_modes = modes_of(model, paper, 3)
    table, picture = lamina_modes.save(tmp_path / "new" / "folder")
    content = json.loads(table.read_text())
    np.testing.assert_array_equal(content["frequency_hz"], lamina_modes.frequencies)
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("n", [0, 41])
def test_impossible_numbers_of_modes_are_refused(paper: Case, model: Structure, n: int) -> None:
    with pytest.raises(CaseError, match=f"expected 1 to 40 .dofs of a lamina., given {n}"):
        modes_of(model, paper, n)


def test_modes_of_the_weak_forms_equal_the_closed_form(paper: Case, model: Structure) -> None:
    pytest.importorskip("dolfinx")
    lamina_modes, expected = modes(paper, 4), modes_of(model, paper, 4)
    assert isinstance(lamina_modes, NaturalModes)
    np.testing.assert_allclose(lamina_modes.frequencies, expected.frequencies, rtol=1e-9)
