"""What a notebook sees: results, cases and sweeps as HTML, figures as methods, runs read back."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from project import ROOT
from synthetic import small_case, synthetic_history

import delam_fem as df
from delam_fem import compare, diagram, modes
from delam_fem.api import diagnostics
from delam_fem.results.figures.run import FIGURES
from delam_fem.studies.convergence import run as refinements


@pytest.fixture
def result() -> df.Result:
    case = small_case()
    history = synthetic_history(case)
    summary = diagnostics.summary(history, case) | {"outcome": "completed", "warnings": ["<soft>"]}
    return df.Result(case, history, summary, None)


def test_a_result_shows_its_verdict_and_numbers(result: df.Result) -> None:
    text = result._repr_html_()
    assert "One-periodic, one tip strike a period" in text
    assert "&lt;soft&gt;" in text and "<soft>" not in text
    assert "<td>periodicity</td><td>1</td>" in text
    assert "<html" not in text and "<script" not in text


def test_cases_and_sweeps_show_themselves() -> None:
    case = small_case()
    assert case._repr_html_().startswith("<pre>name = &quot;paper&quot;")
    sweep = df.load_sweep(ROOT / "docs" / "examples" / "plane.toml")
    text = sweep._repr_html_()
    assert "sweep plane: 400 points" in text
    assert "<td>contact.penalty_stiffness</td><td>20</td><td>10.0 … 1000.0</td><td>N/m</td>" in text


def test_figures_are_methods(result: df.Result) -> None:
    assert dir(result.plot) == sorted(FIGURES)
    assert isinstance(result.plot.envelope(), Figure)
    with pytest.raises(AttributeError, match="no figure 'nothing'; there are tip_histories"):
        result.plot.nothing()


def test_a_figure_is_a_picture_without_a_backend_of_the_notebook(result: df.Result) -> None:
    for draw in (result.plot.spectra, result.plot.tip_histories):
        assert draw()._repr_png_().startswith(b"\x89PNG")


def test_a_result_is_one_line(result: df.Result) -> None:
    line = repr(result)
    assert len(line) < 300
    assert result.case.title in line
    assert "completed" in line


def test_a_result_is_read_back(result: df.Result, tmp_path: Path) -> None:
    result.save_numbers(tmp_path)
    loaded = df.load_result(tmp_path)
    assert loaded.case == result.case and loaded.summary == result.summary
    assert loaded.state is None
    np.testing.assert_array_equal(
        loaded.history["tip_displacement"], result.history["tip_displacement"]
    )
    assert loaded._repr_html_() == result._repr_html_()
    assert set(loaded.groups) == {"history", "periods", "fields", "events", "shape"}
    with pytest.raises(df.CaseError, match=r"found no result\.nc"):
        df.load_result(tmp_path / "nothing")


def test_studies_are_functions_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert df.compare is compare and df.modes is modes and df.diagram is diagram
    asked = []
    monkeypatch.setattr(refinements, "run_refinement", lambda *a, **keys: asked.append((a, keys)))
    case = df.preset("paper", {"mesh.elements": 5})
    df.converge(case, tmp_path, laws=["newton@moreau-jean"], steps=[100, 200], workers=1)
    df.converge(case, tmp_path, elements=[5, 10], limit_steps=0, resume=True)
    (first, directory), keys = asked[0]
    assert (first.case, first.meshes, first.steps) == (case, (5,), (100, 200))
    assert [m.name for m in first.methods] == ["newton@moreau-jean"]
    assert directory == tmp_path and keys == {"workers": 1, "resume": False, "progress": None}
    (second, _), keys = asked[1]
    assert (second.meshes, second.steps, second.limit_steps) == ((5, 10), (1000,), 0)
    assert keys["resume"] is True
