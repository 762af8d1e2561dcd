"""Diagrams of sweeps: what they draw of made-up and of computed datasets, what they refuse."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import golden
import h5py
import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from typer.testing import CliRunner

from delam_fem import diagram
from delam_fem.api import CaseError, preset, settling as at
from delam_fem.cli.app import app
from delam_fem.results.figures.style import edges, styled
from delam_fem.studies.diagrams import POINT_STYLE, UNSETTLED_COLOUR, DiagramName, save_diagram

N_STROBES = 64
FREQUENCIES = np.array([3.0, 3.2, 3.4, 3.6, 3.8])
SWEEP = """
base = "paper"
engine = "petsc"
order = "both"
set = { mesh.elements = 2, time = { steps_per_period = 40, periods = 3 }, output.fields_per_period = 0 }
[[axis]]
key = "excitation.frequency"
values = [3.0, 3.5]
"""  # noqa: E501


FLAT = ("plane", "basins")
"""Diagrams over two axes."""


def axis(name: str, values: np.ndarray, key: str, units: str) -> xr.DataArray:
    attributes = {"key": key, "long_name": key.replace(".", " "), "units": units}
    return xr.DataArray(values, dims=name, attrs=attributes)


def lines() -> xr.Dataset:
    """Return a sweep up and down over five frequencies, bistable at the third; the last failed."""
    shape = (2, 5)
    amplitude = np.ones((*shape, 2)) * np.array([0.02, 0.01])
    amplitude[1, 2] *= 0.5
    strobes = np.tile(FREQUENCIES[None, :, None, None] * 1e-3, (2, 1, 2, N_STROBES))
    strobes[..., ::2] *= -1.0
    outcome = np.full(shape, "completed", dtype=object)
    outcome[:, -1] = "failed"
    amplitude[:, -1], strobes[:, -1] = np.nan, np.nan
    grid = ("direction", "frequency")
    return xr.Dataset(
        {
            "outcome": (grid, outcome),
            "tip_amplitude": ((*grid, "lamina"), amplitude),
            "strobe_displacement": ((*grid, "lamina", "strobe"), strobes),
            "lyapunov_exponent": (grid, np.linspace(-1.0, 1.0, 10).reshape(shape)),
        },
        coords={
            "direction": ["up", "down"],
            "frequency": axis("frequency", FREQUENCIES, "excitation.frequency", "Hz"),
            "lamina": ["thick", "thin"],
        },
        attrs={"case": preset("paper").to_toml()},
    )


def plane() -> xr.Dataset:
    """Return a plane of 2 × 3 points: period 1, 2 and none, of two amplitudes, one diverged."""
    shape = (2, 3)
    k = np.arange(N_STROBES)
    periodicity = np.array([[1.0, 2.0, np.nan], [1.0, 1.0, np.nan]])
    strobes = np.zeros((*shape, 2, N_STROBES))
    strobes[0, 1] = 0.01 * (-1.0) ** k
    strobes[0, 2] = 0.01 * np.sin(2.0 * np.pi * 0.618 * k)
    amplitude = np.full((*shape, 2), 0.02)
    outcome = np.full(shape, "completed", dtype=object)
    outcome[1, 2], strobes[1, 2], amplitude[1, 2] = "diverged", np.nan, np.nan
    grid = ("restitution", "penalty_stiffness")
    e, k_con = np.array([0.0, 0.1]), np.array([10.0, 100.0, 1000.0])
    return xr.Dataset(
        {
            "outcome": (grid, outcome),
            "periodicity": (grid, periodicity),
            "tip_min": ((*grid, "lamina"), -amplitude),
            "tip_max": ((*grid, "lamina"), amplitude),
            "strobe_displacement": ((*grid, "lamina", "strobe"), strobes),
            "lyapunov_exponent": (grid, np.linspace(-1.0, 0.5, 6).reshape(shape)),
        },
        coords={
            "restitution": axis("restitution", e, "contact.restitution", "1"),
            "penalty_stiffness": axis(
                "penalty_stiffness", k_con, "contact.penalty_stiffness", "N/m"
            ),
            "lamina": ["thick", "thin"],
        },
        attrs={"case": preset("paper").to_toml()},
    )


def unsettled(data: xr.Dataset, *places: tuple[int, ...]) -> xr.Dataset:
    """Return the dataset with a verdict: all points have settled but those at some places."""
    verdicts = np.ones(data["outcome"].shape)
    for place in places:
        verdicts[place] = 0.0
    data = data.assign(settled=(data["outcome"].dims, verdicts))
    if "periodicity" in data:
        data["periodicity"] = data["periodicity"].where(verdicts != 0.0)
    return data


def test_unsettled_points_are_hatched_and_of_no_order() -> None:
    """One cell of a higher order is not settled; the cell that diverged keeps its colour."""
    data = unsettled(plane(), (0, 1), (1, 2))
    for kind in ("plane", "basins", "lyapunov"):
        figure = diagram(kind, data)
        panel = figure.axes[0]
        assert "not settled (17 %)" in legend(figure), kind
        (hatched,) = [c for c in panel.collections if c.get_hatch()]
        is_hatched = np.isfinite(np.ma.filled(hatched.get_array(), np.nan))
        assert np.flatnonzero(is_hatched).size == 1, kind
        others = diagram(kind, unsettled(plane())).axes[0].collections
        assert not [c for c in others if c.get_hatch()]
    texts = legend(diagram("plane", data))
    assert not any(text.startswith("higher order") for text in texts)
    assert any(text.startswith("diverged") for text in texts)


def test_unsettled_points_over_one_axis_are_grey() -> None:
    data = unsettled(lines(), (0, 1))
    figure = diagram("bifurcation", data)
    grey = [line for line in figure.axes[0].get_lines() if line.get_color() == UNSETTLED_COLOUR]
    points = [line for line in grey if len(line.get_xdata()) >= N_STROBES]
    assert [set(line.get_xdata()) for line in points] == [{FREQUENCIES[1]}]
    assert "not settled" in legend(figure)
    for kind in ("response", "lyapunov"):
        drawn = {line.get_label(): line for line in diagram(kind, data).axes[0].get_lines()}
        assert drawn["not settled"].get_xdata().tolist() == [FREQUENCIES[1]]
    assert "not settled" not in legend(diagram("bifurcation", unsettled(lines())))


def legend(figure: Figure) -> list[str]:
    """Return the labels of the legend of the first panel."""
    return [text.get_text() for text in figure.axes[0].get_legend().get_texts()]


def test_response_draws_both_directions_and_the_linear_motion() -> None:
    figure = diagram("response", lines())
    first = figure.axes[0]
    drawn = {line.get_label(): line for line in first.get_lines()}
    assert drawn["up"].get_ydata()[2] == pytest.approx(20.0)
    assert drawn["down"].get_ydata()[2] == pytest.approx(10.0)
    linear = drawn["linear, no contact"]
    at_resonance = linear.get_xdata()[np.argmax(linear.get_ydata())]
    assert at_resonance == pytest.approx(3.165, abs=0.01)
    assert drawn["not completed"].get_xdata().tolist() == [3.8]
    assert first.get_ylim()[1] < 30.0, "the resonance sets the range"
    assert figure.axes[1].get_xlabel() == "excitation frequency  [Hz]"


def test_what_depends_on_the_direction_is_shaded() -> None:
    figure = diagram("bifurcation", lines())
    data = lines()
    data["tip_amplitude"][1, 2, 0] = data["tip_amplitude"][0, 2, 0]  # the other lamina is enough
    assert len(diagram("bifurcation", data).axes[0].patches) == 1
    (band,) = figure.axes[0].patches
    assert [band.get_x(), band.get_x() + band.get_width()] == pytest.approx([3.3, 3.5])


def test_points_that_have_not_settled_decide_nothing() -> None:
    """Neither do they depend on the direction, nor are they of an attractor."""
    for place in ((0, 2), (1, 2)):
        assert not diagram("bifurcation", unsettled(lines(), place)).axes[0].patches
    assert diagram("bifurcation", unsettled(lines(), (0, 1))).axes[0].patches
    before, after = (diagram("basins", data) for data in (plane(), unsettled(plane(), (0, 1))))
    meshes = [next(c for c in f.axes[0].collections if isinstance(c, QuadMesh)) for f in
              (before, after)]  # fmt: skip
    numbers = [mesh.get_array().reshape(3, 2).T for mesh in meshes]
    none = meshes[1].cmap.N - 1
    assert numbers[0][0, 1] != meshes[0].cmap.N - 1 and numbers[1][0, 1] == none
    assert (numbers[1] == none).sum() == 1 + (numbers[0] == meshes[0].cmap.N - 1).sum()


def test_bifurcation_draws_every_strobe() -> None:
    figure = diagram("bifurcation", lines())
    points = [line for line in figure.axes[1].get_lines() if len(line.get_xdata()) > 5]
    assert len(points) == len(POINT_STYLE)
    up = points[0]
    assert len(up.get_xdata()) == 5 * N_STROBES
    assert set(np.round(up.get_ydata()[:N_STROBES], 9)) == {3.0, -3.0}


def test_lyapunov_over_one_and_over_two_axes() -> None:
    one = diagram("lyapunov", lines())
    assert one.axes[0].get_ylabel().startswith("largest Lyapunov exponent [1/s]")
    data = lines()
    data["lyapunov_error"] = 0.0 * data["lyapunov_exponent"] + 0.25
    (up, _) = diagram("lyapunov", data).axes[0].containers
    (bars,) = up.lines[2]
    first = bars.get_segments()[0]
    assert first[:, 1].tolist() == [-1.5, -0.5], "two standard errors on either side"
    two = diagram("lyapunov", plane())
    (mesh,) = [c for c in two.axes[0].collections if isinstance(c, QuadMesh)]
    assert mesh.get_array().ravel().tolist() == plane().lyapunov_exponent.T.values.ravel().tolist()
    assert (mesh.norm.vmin, mesh.norm.vmax) == (-1.0, 1.0)
    for values, bound in ((np.nan, 1.0), (0.0, 1.0), (-0.25, 0.25)):
        data = plane()
        data["lyapunov_exponent"] = np.nan * data["lyapunov_exponent"]
        data["lyapunov_exponent"][0, 0] = values
        (mesh,) = [
            c for c in diagram("lyapunov", data).axes[0].collections if isinstance(c, QuadMesh)
        ]
        assert (mesh.norm.vmin, mesh.norm.vmax) == (-bound, bound)


def test_plane_colours_by_kind_and_writes_the_period() -> None:
    figure = diagram("plane", plane())
    panel = figure.axes[0]
    (mesh,) = [c for c in panel.collections if isinstance(c, QuadMesh)]
    kinds = mesh.get_array().reshape(3, 2).T
    assert kinds.tolist() == [
        [at.PERIOD_1, at.HIGHER, at.QUASI_PERIODIC],
        [at.PERIOD_1, at.PERIOD_1, at.DIVERGED],
    ]
    assert [text.get_text() for text in panel.texts] == ["2"]
    assert (panel.get_xscale(), panel.get_yscale()) == ("linear", "log")
    assert "10 %" in figure.get_supxlabel(), "the thresholds are stated"
    labels = [text.get_text() for text in panel.get_legend().get_texts()]
    assert labels[0] == "period 1 (50 %)"


def test_basins_name_the_attractors() -> None:
    figure = diagram("basins", plane())
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert labels[0] == "period 1, 20.0 / 20.0 mm (50 %)"
    assert labels[-1] == "not completed (17 %)"


def test_undecided_points_of_a_plane_are_a_kind_and_have_no_number() -> None:
    data = plane()
    decided = np.ones((2, 3))
    decided[0, 1] = 0.0
    data["is_decided"] = (("restitution", "penalty_stiffness"), decided)
    figure = diagram("plane", data)
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert labels[-1] == "undecided (17 %)"
    assert not figure.axes[0].texts


def test_a_cell_amid_others_is_no_attractor() -> None:
    number = np.zeros((4, 5), dtype=np.int64)
    number[:2, 3:], number[3, 0], number[2, 2], number[3, 4] = 1, 2, -1, 2
    assert np.argwhere(at.is_isolated(number)).tolist() == [[3, 0], [3, 4]]
    assert not at.is_isolated(np.array([[0, 0], [1, 1]])).any()
    data = plane().isel(penalty_stiffness=[0, 1, 1])
    data["tip_max"][0, 0] = 0.04
    figure = diagram("basins", data)
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert labels[-1] == "isolated cells: not decided (17 %)"
    assert len(labels) == 3, labels


@pytest.mark.parametrize("kind", get_args(DiagramName))
def test_diagrams_have_the_stored_words(kind: DiagramName, stored: Callable[[str], None]) -> None:
    drawn = [unsettled(lines(), (0, 1)), unsettled(plane(), (1, 0))]
    fits = [data for data in drawn if kind == "lyapunov" or (data is drawn[1]) == (kind in FLAT)]
    with styled():
        stored("\n\n".join(golden.describe(diagram(kind, data)) for data in fits))


REFUSED: list[tuple[DiagramName, xr.Dataset, str]] = [
    ("plane", lines(), "expected a sweep over 2 axes, given frequency"),
    ("response", plane(), "expected a sweep over 1 axis, given restitution, penalty_stiffness"),
    ("bifurcation", lines().drop_vars("strobe_displacement"), r"compute it with record\.strobes"),
    ("lyapunov", lines().drop_vars("lyapunov_exponent"), r"with record\.lyapunov = 200"),
    ("plane", plane().isel(strobe=slice(0, 8)), r"at least 64 strobes .* record\.strobes = 128"),
    ("basins", plane().expand_dims(direction=["up"]), r'select it: data\.sel\(direction="up"\)'),
]


@pytest.mark.parametrize(("kind", "data", "words"), REFUSED)
def test_refused_with_a_remedy(kind: DiagramName, data: xr.Dataset, words: str) -> None:
    with pytest.raises(CaseError, match=words):
        diagram(kind, data)


def test_an_axis_of_words_has_them_at_its_ticks() -> None:
    data = plane()
    law = xr.DataArray(
        ["newton@newmark", "newton@moreau-jean"],
        dims="restitution",
        attrs={"key": "contact.law", "long_name": "law"},
    )
    panel = diagram("plane", data.assign_coords(restitution=law)).axes[0]
    assert [text.get_text() for text in panel.get_xticklabels()] == [
        "newton@newmark",
        "newton@moreau-jean",
    ]


def test_a_figure_is_complete_or_absent(tmp_path: Path) -> None:
    path = save_diagram("plane", plane(), tmp_path / "new" / "plane.png")
    assert path.read_bytes()[:4] == b"\x89PNG"
    assert [p.name for p in path.parent.iterdir()] == ["plane.png"]


def run(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(a) for a in arguments])
    return done.exit_code, done.output


@pytest.mark.slow
def test_the_command_computes_once_and_draws(tmp_path: Path) -> None:
    file, out = tmp_path / "two.toml", tmp_path / "out"
    file.write_text(SWEEP)
    status, text = run("sweep", file, "-o", out, "--executor", "serial")
    assert status == 0 and "completed" in text
    assert "warning: 4 of 4 completed points have not settled; try more time.periods" in text
    computed = (out / "sweep.nc").stat().st_mtime_ns
    for kind, source in (("response", file), ("bifurcation", out), ("response", out / "sweep.nc")):
        status, text = run("show", "diagram", kind, source, "-o", out, "--executor", "serial", "-q")
        assert (status, text) == (0, "")
        assert (out / f"{kind}.png").is_file()
    assert (out / "sweep.nc").stat().st_mtime_ns == computed
    with xr.open_dataset(out / "sweep.nc", engine="h5netcdf") as data:
        assert data.attrs["outcome"] == "completed"
    part = shutil.copytree(out, tmp_path / "part")
    with h5py.File(part / "sweep.nc", "a") as file:
        file.attrs["n_missing"], file.attrs["n_completed"] = 1, 3
    _, text = run("show", "diagram", "response", tmp_path / "part")
    assert "the diagram shows 3 of 4 points" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("sweep", "no.toml"), "no such file"),
        (("show", "diagram", "plane", "no_folder"), "expected a sweep file (.toml) or a result"),
    ],
)
def test_bad_input_leaves_with_2_and_no_traceback(arguments: tuple[str, ...], words: str) -> None:
    status, text = run(*arguments)
    assert status == 2
    assert words in text and "Traceback" not in text


def test_a_sweep_none_of_whose_points_works_leaves_with_1(tmp_path: Path) -> None:
    file = tmp_path / "bad.toml"
    file.write_text(SWEEP.replace("mesh.elements = 2", 'mesh.elements = 2, time.scheme = "x"'))
    assert run("sweep", file, "-o", tmp_path / "a")[0] == 2
    scheme = ("--set", "time.scheme=central-difference")
    file.write_text(SWEEP)
    status, text = run("sweep", file, "-o", tmp_path / "b", "--executor", "serial", *scheme)
    assert status == 1
    assert "none of the 4 points was completed; the first: time.steps_per_period" in text


@pytest.mark.parametrize(
    ("places", "is_logarithmic", "expected"),
    [
        ([1.0, 2.0, 4.0], False, [0.5, 1.5, 3.0, 5.0]),
        ([10.0, 100.0, 1000.0], True, [10**0.5, 10**1.5, 10**2.5, 10**3.5]),
        ([50.0], False, [49.5, 50.5]),
    ],
)
def test_a_cell_of_a_map_ends_between_its_place_and_the_next(
    places: list[float], is_logarithmic: bool, expected: list[float]
) -> None:
    borders = edges(np.array(places), is_logarithmic=is_logarithmic)
    assert borders.tolist() == pytest.approx(expected, rel=1e-6)
