"""Films read back by other readers: their length, their lights, their time bar."""

from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image, ImageSequence
from synthetic import FRAMES, WINDOW, small_case, synthetic_history

from delam_fem import animate, run
from delam_fem.api import Case, CaseError, save_case
from delam_fem.results.fields import animation
from delam_fem.results.fields.animation import LIGHTS, SIZE, write_film
from delam_fem.results.figures.style import lamina_colours
from delam_fem.simulation.recorder import HIT, RESTING

PERIODS = 0.3
"""Length of the films: frames 14 to 19 of the last period."""


def pictures(path: Path) -> np.ndarray:
    """Return the pictures of a GIF, as another program reads them."""
    with Image.open(path) as film:
        return np.stack([np.array(p.convert("RGB")) for p in ImageSequence.Iterator(film)])


def share(picture: np.ndarray, colour: str, tolerance: float = 0.02) -> float:
    return float((np.abs(picture / 255.0 - to_rgb(colour)).max(axis=-1) < tolerance).mean())


@pytest.mark.slow
def test_gif_and_mp4_show_the_last_periods(tmp_path: Path) -> None:
    case = small_case()
    history = synthetic_history(case, tip_strikes=(0.5, 1.5, 2.5, 3.8))
    paths = [tmp_path / "a.gif", tmp_path / "b.mp4"]
    told: list[tuple[int, int]] = []
    written = write_film(
        history, case, paths, periods=PERIODS, progress=lambda *done: told.append(done)
    )
    assert written == paths and sorted(tmp_path.iterdir()) == paths
    n = round(PERIODS * FRAMES)
    assert told == [(k + 1, n) for k in range(n)]
    film = pictures(paths[0])
    assert film.shape == (n, SIZE[1], SIZE[0], 3)
    scene = film[:, 100:-100]
    for colour in lamina_colours(2):  # shaded, so that the colours differ a little
        assert share(scene[0], colour, 0.25) > 3e-3
    lit = [share(picture[:, : SIZE[0] * 3 // 4], LIGHTS[HIT], 0.05) > 1e-4 for picture in scene]
    # the strike at 3.8 is at the second frame of 3.75, 3.8, …; the weaker one follows it
    assert lit == [False, True, True, False, False, False]
    assert not np.array_equal(scene[0], scene[-1])
    bars = film[:, animation.BAR.start + 4, animation.EDGE : -animation.EDGE, 0]
    done = (bars < 128).mean(axis=-1)
    np.testing.assert_allclose(done, np.arange(n) / (n - 1), atol=0.02)
    count, seconds = imageio_ffmpeg.count_frames_and_secs(str(paths[1]))
    assert count == n and seconds == pytest.approx(n / 20.0, abs=0.051)


def test_resting_pairs_are_lit_where_they_are(tmp_path: Path) -> None:
    case = small_case()
    history = synthetic_history(case).isel(event=slice(0, 0))
    history["contact_state"][:] = 0
    history["contact_state"][-1, 3] = RESTING
    (path,) = write_film(history, case, [tmp_path / "a.gif"], periods=0.1, stretch=1.0)
    film = pictures(path)
    assert set(np.unique(film[:, animation.BAR, animation.EDGE : -animation.EDGE])) == {60, 215}
    before, after = film[-2:, 100:-130, : SIZE[0] * 3 // 4].astype(float)
    dark = (after.max(axis=-1) < 60) & (before.max(axis=-1) > 80)
    rows = np.flatnonzero(dark.any(axis=1))
    assert dark.sum() > 50 and np.ptp(rows) < 40
    height = 1.0 - (rows.mean() + 100) / SIZE[1]
    # x = 0.6 L; the picture spans 1.24 L about the middle, seen from a little above
    assert height == pytest.approx(0.5 + 0.1 / 1.24, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("state", [HIT, RESTING])
def test_stops_are_lit_where_they_touch(tmp_path: Path, state: int) -> None:
    """One after the other, 0.4 L apart along the lamina, and none before."""
    thin = {"name": "one", "length": 0.5, "width": 0.02, "thickness": 0.002, "density": 2500.0,
            "young_modulus": 7e10, "damping_ratio": 0.01}  # fmt: skip
    stop = {"lamina": "one", "side": "below", "gap": 1e-3}
    case = Case(
        name="lights", lamina=[thin], mesh={"elements": 10},
        stop=[stop | {"position": 0.2}, stop | {"position": 0.4}],
        excitation={"kind": "harmonic", "amplitude": 1e-5, "frequency": 20.0},
        contact={"law": "newton"}, time={"steps_per_period": 100, "periods": 1},
        output={"window_periods": 1, "fields_per_period": 20},
    )  # fmt: skip
    history = run(case, engine="compiled").history
    assert not history["stop_state"].any()
    history["stop_state"][-2, 0] = state
    history["stop_state"][-1, 1] = state
    (path,) = write_film(history, case, [tmp_path / "a.gif"], periods=0.15, stretch=1.0)
    film = pictures(path)[-3:, 100:-130, : SIZE[0] * 3 // 4]
    lit = np.abs(film / 255.0 - to_rgb(LIGHTS[state])).max(axis=-1) < 0.05
    first, second = (np.argwhere(now & ~lit[0]).mean(axis=0) for now in lit[1:])
    length = SIZE[1] / 1.24  # of the lamina, in pixels
    assert np.hypot(*(second - first)) == pytest.approx(0.4 * length, rel=0.05)


def test_a_motion_without_finite_frames_has_no_film(tmp_path: Path) -> None:
    case = small_case()
    history = synthetic_history(case).isel(frame=slice(0, 0))
    assert write_film(history, case, [tmp_path / "a.gif"]) == []
    assert not list(tmp_path.iterdir())


def test_a_film_is_at_most_the_window(tmp_path: Path) -> None:
    case = small_case()
    history = synthetic_history(case).isel(frame=slice(0, 2))
    (path,) = write_film(history, case, [tmp_path / "a.gif"], periods=1e9)
    assert len(pictures(path)) == 2 < FRAMES * WINDOW


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"periods": 0.0}, "--periods: expected a positive number, given 0"),
        ({"rate": -1.0}, "--rate: expected a positive number, given -1"),
        ({"stretch": float("inf")}, "--stretch: expected a positive number, given inf"),
        ({"output": ["a.avi"]}, "--output: expected a file that ends in .gif or .mp4, given a.avi"),
        ({"output": ["a.gif", "a.gif"]}, "--output: expected different files, given one of them "
         "twice"),
    ],
)  # fmt: skip
def test_bad_options_are_refused(tmp_path: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises(CaseError) as error:
        animate(tmp_path, **options)  # type: ignore[arg-type]
    assert str(error.value) == message


def test_a_run_with_nothing_to_show_is_refused(tmp_path: Path) -> None:
    case = small_case()
    save_case(case, tmp_path)
    history = synthetic_history(case)
    for dataset, message in (
        (history.isel(frame=slice(0, 0)), "frames.*output.fields_per_period"),
        (history, "--solid: expected .*model.kind.*fields/solid.vtkhdf"),
    ):
        dataset.to_netcdf(tmp_path / "result.nc", engine="h5netcdf")
        with pytest.raises(CaseError, match=f"{tmp_path}: .*{message}"):
            animate(tmp_path, solid=True)
    history["displacement"][:] = np.nan
    history.attrs["outcome"] = "diverged"
    history.to_netcdf(tmp_path / "result.nc", engine="h5netcdf")
    with pytest.raises(CaseError, match=f"{tmp_path}: no frame .*finite"):
        animate(tmp_path)


def test_clamps_move_with_the_held_ends() -> None:
    case = small_case()
    history = synthetic_history(case)
    history["displacement"][0, -1, 0] = 1e-3
    last = history.sizes["frame"] - 1
    plotter = animation.pv.Plotter(off_screen=True)
    scene = animation._Scene(plotter, history, case, list(range(last + 1)), (1.0, 1.0))
    scene.show(last)
    [(end, clamp, at_rest)] = scene.clamps  # of a cantilever
    moved = np.outer(np.ones(len(at_rest)), [0.0, 1e-3 * scene.deflection, 0.0])
    np.testing.assert_allclose(clamp.points - at_rest, moved, atol=1e-7)
    plotter.close()
    assert end == 0
