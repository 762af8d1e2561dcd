"""Pictures of solids: what is drawn where, the stated factors, the frames of the film."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image
from typer.testing import CliRunner

import delam_fem as df
from delam_fem.api import Result, load_numbers
from delam_fem.cli.app import app
from delam_fem.results.fields import animation, pictures
from delam_fem.results.fields.vtkhdf import Series
from delam_fem.results.folder import save_views

KEYS = {
    "excitation.frequency": 3.25,
    "model.kind": "plane-stress",
    "contact.law": "newton@moreau-jean",
    "mesh.elements": 6,
    "time.steps_per_period": 200,
    "time.periods": 2,
    "output.window_periods": 2,
    "output.fields_per_period": 10,
}
THICKNESS = 0.003


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run")
    df.run(df.preset("paper", KEYS)).save(path, figures=False)
    return path


@pytest.fixture(scope="module")
def result(folder: Path) -> Result:
    return df.run(df.preset("paper", KEYS))


def test_the_file_gives_the_fields_back(folder: Path, result: Result) -> None:
    series, frames = Series.read(folder / "fields" / "solid.vtkhdf"), result.solid
    assert frames is not None
    np.testing.assert_array_equal(series.times, frames.times)
    for name in ("displacement", "von_mises"):
        np.testing.assert_allclose(
            series.field(name, 3), frames.fields(3)[name], rtol=1e-4, atol=1e-9
        )
    assert series.thickness == pytest.approx(THICKNESS)


@pytest.mark.parametrize(("thick", "deflection"), [(1.0, 1.0), (20.0, 1.0), (20.0, 5.0)])
def test_thickness_and_gaps_have_their_factors(
    folder: Path, result: Result, thick: float, deflection: float
) -> None:
    series, frames = Series.read(folder / "fields" / "solid.vtkhdf"), result.solid
    assert frames is not None
    u = series.field("displacement", 7)
    drawn, shape = series.drawn(u, thick, deflection), frames.shape
    gap = (
        result.history["gap0"].to_numpy()
        + np.diff(result.history["displacement"].to_numpy()[:, 7], axis=0).ravel()
    )
    x = result.history["x"].to_numpy()
    sides = []
    for lamina, layer in enumerate(result.case.lamina):
        of = np.flatnonzero(shape.lamina == lamina)
        y = shape.points[of, 1]
        low, high = (of[np.abs(y - level) < 1e-12] for level in (y.min(), y.max()))
        low, high = (k[np.argsort(shape.points[k, 0])][::2] for k in (low, high))
        np.testing.assert_allclose(
            drawn[high, 1] - drawn[low, 1], thick * layer.thickness, rtol=2e-3
        )
        sides.append((low, high))
        middle = 0.5 * (drawn[high, 0] + drawn[low, 0])
        np.testing.assert_allclose(middle, x, atol=1e-4)
        slope = deflection * result.history["slope"].to_numpy()[lamina, 7]
        turned = -(drawn[high, 0] - drawn[low, 0]) / (thick * layer.thickness)
        np.testing.assert_allclose(turned, slope, atol=0.02 * np.abs(slope).max())
    between = drawn[sides[1][0], 1] - drawn[sides[0][1], 1]
    np.testing.assert_allclose(between, deflection * gap, atol=1e-6 * deflection)


def test_factor_of_thicknesses(folder: Path) -> None:
    series = Series.read(folder / "fields" / "solid.vtkhdf")
    assert animation.thickening(series) == 20.0, "0.1 L over 3 mm is 22.8"
    assert "thickness × 20" in animation.scales(20.0, 1.0)
    assert animation.scales(20.0, 1.0).endswith("true to scale")
    assert "× 50" in animation.scales(1.0, 50.0)


@pytest.mark.parametrize(
    ("largest", "shown"), [(7.5e6, (7.5, "MPa")), (6940.0, (6.94, "kPa")), (20.0, (20.0, "Pa"))]
)
def test_units_of_stress(largest: float, shown: tuple[float, str]) -> None:
    assert animation._scaled(largest, "von_mises")[:2] == shown


@pytest.mark.slow
def test_picture_and_page(folder: Path) -> None:
    case, history, summary = load_numbers(folder)
    written = save_views(history, summary, case, folder)
    path = folder / "figures" / "solid.png"
    assert path in written
    picture = imread(path)[..., :3]
    assert picture.shape[:2] == animation.STILL_SIZE[::-1]
    upper, lower = np.vsplit(picture, 2)
    is_blue, is_red = (lower[..., 2] - lower[..., 0] > 0.3), (lower[..., 0] - lower[..., 2] > 0.3)
    assert min(is_blue.sum(), is_red.sum()) > 1000, "tension and compression"
    dark = np.abs(upper - [0.267, 0.005, 0.329]).max(axis=-1) < 0.05
    assert dark.sum() > 1000, "no stress at the tips"
    page = (folder / "report.html").read_text()
    assert "Von Mises stress" in page and "solid.vtkhdf" in page
    shorter = history.isel(frame=slice(0, 5))
    assert animation.render_solid(folder / "fields" / "solid.vtkhdf", shorter, case, path) is None


def test_colours_show_the_stress_after_the_strike(folder: Path, result: Result) -> None:
    """The frame that the picture shows contains the strongest impulse."""
    frame = pictures.strike_frame(result.history, result.case) + 1
    assert result.solid is not None
    sums = result.solid.impulses.sum(axis=1)
    assert sums[frame] > 0.5 * sums.max()


@pytest.mark.slow
def test_film(folder: Path, tmp_path: Path) -> None:
    files = [str(tmp_path / name) for name in ("a.gif", "b.mp4")]
    arguments = ["show", "film", str(folder), "--solid", "--periods", "0.5"]
    done = CliRunner().invoke(app, [*arguments, "-o", files[0], "-o", files[1]])
    assert done.exit_code == 0, done.output
    with Image.open(files[0]) as film:
        assert (film.n_frames, film.size) == (5, animation.SOLID_SIZE)
        first = np.asarray(film.convert("RGB"), dtype=float)
        film.seek(4)
        last = np.asarray(film.convert("RGB"), dtype=float)
    assert np.abs(first - last)[100:-60, :-200].max() > 100.0
    assert Path(files[1]).stat().st_size > 1000


def test_films_of_beams_are_no_solids(tmp_path: Path) -> None:
    keys = {"time.periods": 1, "output.window_periods": 1}
    df.run(df.preset("paper", keys)).save(tmp_path, figures=False)
    done = CliRunner().invoke(app, ["show", "film", str(tmp_path), "--solid"])
    assert done.exit_code == 2
    assert "expected the run of a solid" in " ".join(done.output.split())
