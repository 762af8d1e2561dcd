from pathlib import Path

import golden
import numpy as np
import pytest
import stack
import xarray as xr
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Text
from stack import three_laminae
from synthetic import AMPLITUDES, PERIODS, STEPS, SWEEP, WINDOW, small_case, synthetic_history

from delam_fem import Case
from delam_fem.api import style
from delam_fem.results.fields.laminae import scalars_of
from delam_fem.results.figures import run as contact_figures, run as figures
from delam_fem.results.figures.style import (
    DPI,
    HISTORY_PERIODS,
    LAMINA_COLOURS,
    WIDTH,
    lamina_colours,
    styled,
)
from delam_fem.results.schema import add

EVERY_LAMINA = ("tip_histories", "phase_portraits", "spectra")


def pixels(path: Path) -> np.ndarray:
    return imread(path)[..., :3]


def share_near(picture: np.ndarray, colour: str) -> float:
    """Return the share of pixels of a colour, up to the rounding to 8 bits."""
    return float((np.abs(picture - to_rgb(colour)).max(axis=-1) < 0.01).mean())


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return the files of all figures."""
    case, folder = small_case(), tmp_path_factory.mktemp("saved")
    return figures.save_figures(synthetic_history(case), case, folder / "new" / "figures")


def test_all_figures_are_written_and_show_something(saved: list[Path]) -> None:
    paths = saved
    assert [path.name for path in paths] == [f"{name}.png" for name in figures.FIGURES]
    for path in paths:
        picture = pixels(path)
        assert picture.shape[1] == round(WIDTH * DPI)
        assert 0.3 < picture.shape[0] / picture.shape[1] < 0.8
        assert 0.01 < (picture.min(axis=-1) < 0.9).mean() < 0.95, path.stem
    for name in EVERY_LAMINA:
        for colour in lamina_colours(2):
            least = 2e-5 if name == "spectra" else 2e-4  # two lines with some harmonics
            assert share_near(pixels(paths[0].with_name(f"{name}.png")), colour) > least, name
    assert not list(paths[0].parents[1].rglob(".delam_fem-*"))


def draw(name: str, history: xr.Dataset, case: Case) -> Figure:
    with styled():
        return figures.FIGURES[name](history, case)


def test_tip_histories_show_positions_of_the_last_periods() -> None:
    case = small_case()
    history = synthetic_history(case)
    axes = draw("tip_histories", history, case).axes[0]
    lines = {line.get_label(): line for line in axes.lines}
    t, y_2 = lines["thin  y₂"].get_data()
    assert t[-1] == pytest.approx(PERIODS)
    assert t.size == HISTORY_PERIODS * STEPS
    q_2 = history["tip_displacement"].to_numpy()[1]
    np.testing.assert_allclose(y_2, 30.0 + 1e3 * q_2, rtol=1e-12)  # the gap at rest is 30 mm
    contact_times = lines["tips in contact"].get_xdata()
    np.testing.assert_allclose(contact_times, PERIODS - WINDOW + np.array([0.5, 1.5, 2.5, 3.5]))


def test_axes_of_periods_have_one_of_seconds_or_hertz() -> None:
    case = small_case()  # of 3.25 Hz
    history = synthetic_history(case)
    for name in ("tip_histories", "contact_line", "energy_ledger", "envelope", "spectra"):
        figure = draw(name, history, case)
        figure.draw_without_rendering()
        (second,) = [axes for panel in figure.axes for axes in panel.child_axes]
        unit = 3.25 if name == "spectra" else 1.0 / 3.25
        panel = figure.axes[1 if name in ("energy_ledger", "envelope", "spectra") else 0]
        np.testing.assert_allclose(second.get_xlim(), unit * np.array(panel.get_xlim()))
        assert second.get_xlabel() == ("frequency [Hz]" if name == "spectra" else "time  t  [s]")
    swept = draw("tip_histories", history, small_case(**SWEEP))
    assert swept.axes[0].child_axes == []  # in seconds already


def test_the_same_figure_is_the_same_file(saved: list[Path], tmp_path: Path) -> None:
    case = small_case()
    again = figures.save_figures(synthetic_history(case), case, tmp_path)
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in saved]


def test_harmonics_are_marked_at_their_amplitudes() -> None:
    case = small_case()
    figure = draw("spectra", synthetic_history(case), case)
    every = [line for line in figure.axes[0].lines if line.get_marker() == "o"]
    for dots, expected in zip(every, AMPLITUDES, strict=True):
        orders, amplitudes = dots.get_data()
        assert orders[:3].tolist() == [1, 2, 3]
        np.testing.assert_allclose(amplitudes[:3], 1e3 * expected, atol=1e-10)
    legend = figure.axes[0].get_legend()
    assert legend is not None
    texts = [text.get_text() for text in legend.get_texts()]
    assert texts[1].startswith("tip_thin: ") and "THD = 25.2 %" in texts[1]  # hypot(3, 0.4) / 12


def test_axes_of_spectra_and_symbols_need_no_mathematical_text() -> None:
    case = small_case()
    figure = draw("spectra", synthetic_history(case), case)
    figure.draw_without_rendering()
    decades = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    values = figure.axes[0].get_yticks()
    assert {"10⁻²", "10⁰", "10¹"} <= set(decades)
    assert decades[values.tolist().index(1e-2)] == "10⁻²"
    assert style.symbol("q", 10) == "q₁₁"
    for name in figures.FIGURES:
        drawing = draw(name, synthetic_history(case), case)
        assert not [t for t in drawing.findobj(Text) if t.get_visible() and "$" in t.get_text()]


def test_titles_stand_above_the_power_of_ten_of_an_axis() -> None:
    case = small_case()
    history = synthetic_history(case)
    history["tip_velocity"] = 1e-9 * history["tip_velocity"]
    figure = draw("phase_portraits", history, case)
    figure.draw_without_rendering()
    for axes in figure.axes:
        power = axes.yaxis.get_offset_text()
        (title,) = (
            text for text in axes.findobj(Text) if text.get_text() == axes.get_title("left")
        )
        assert power.get_text().startswith("1e")
        assert not title.get_window_extent().overlaps(power.get_window_extent())


def test_steps_are_those_of_matplotlib() -> None:
    values, edges, base = np.array([1.0, -2.0, 3.0]), np.arange(4.0), np.array([0.5, -1.0, 0.0])
    ours, theirs = Figure().subplots(1, 2)
    style.steps(ours, values, edges, base, color="red", label="a")
    theirs.stairs(values, edges, baseline=base, fill=True, color="red", label="a")
    assert ours.get_xlim() == theirs.get_xlim() and ours.get_ylim() == theirs.get_ylim()
    for axes in (ours, theirs):
        axes.margins(x=0.0)
    assert ours.get_xlim() == theirs.get_xlim() == (0.0, 3.0)
    (patch,), (other,) = ours.patches, theirs.patches
    np.testing.assert_array_equal(patch.get_path().vertices, other.get_path().vertices)
    assert patch.get_facecolor() == other.get_facecolor() and patch.get_fill()


def test_envelope_shows_the_range_of_every_period() -> None:
    case = small_case()
    history = synthetic_history(case)
    for i, axes in enumerate(draw("envelope", history, case).axes):
        (band,) = axes.patches
        high, edges, low = band.get_data()
        np.testing.assert_allclose(edges, np.arange(PERIODS + 1), rtol=1e-12)
        np.testing.assert_allclose(high, 1e3 * history["envelope_max"][i])
        np.testing.assert_allclose(low, 1e3 * history["envelope_min"][i])


def test_energy_flows_stack_to_what_is_stored() -> None:
    case = small_case()
    history = synthetic_history(case)
    axes = draw("energy_ledger", history, case).axes[0]
    tops = np.array([patch.get_data().values[0] for patch in axes.patches])
    # 3 of the base and 0.5 of springs upwards; 2.5 of damping and 1 of impacts downwards
    np.testing.assert_allclose(tops, [3.0, -2.5, -3.5, 3.5])
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["work of the base", "damping", "impacts", "switching springs"]


def test_impacts_that_add_energy_stack_upwards() -> None:
    case = small_case()
    history = synthetic_history(case)
    history["energy_impact_loss"] = -history["energy_impact_loss"]
    axes = draw("energy_ledger", history, case).axes[0]
    tops = [patch.get_data().values[0] for patch in axes.patches]
    np.testing.assert_allclose(tops, [3.0, -2.5, 4.0, 4.5])


def test_contact_line_marks_the_impacts_of_its_periods() -> None:
    case = small_case()
    history = synthetic_history(case)
    axes = draw("contact_line", history, case).axes[0]
    marks = next(c for c in axes.collections if "impact" in str(c.get_label()))
    t, x = np.asarray(marks.get_offsets()).T
    last = PERIODS - contact_figures.LINE_PERIODS
    np.testing.assert_allclose(np.unique(np.round(t, 2)), [last + 0.5, last + 1.5])
    assert set(np.round(x, 6)) == {685.0, 548.0}
    resting_line = next(line for line in axes.lines if "permanent" in str(line.get_label()))
    assert sorted(set(np.round(resting_line.get_ydata(), 6))) == [137.0, 274.0]


def test_one_step_or_one_event_or_one_frame_is_enough(tmp_path: Path) -> None:
    case = small_case()
    history = synthetic_history(case).isel(
        time=slice(0, 1), period=slice(0, 1), frame=slice(0, 1), event=slice(0, 1)
    )
    (tmp_path / "spectra.png").write_bytes(b"of an earlier run")
    paths = figures.save_figures(history, case, tmp_path)
    assert [path.stem for path in paths] == [name for name in figures.FIGURES if name != "spectra"]
    assert not (tmp_path / "spectra.png").exists()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["none", "sweep", "diverged"])
def test_unusual_runs_are_drawn_without_warnings(tmp_path: Path, kind: str) -> None:
    case = small_case(**SWEEP) if kind == "sweep" else small_case(contact__law="none")
    history = synthetic_history(case)
    if kind == "none":
        history = history.isel(event=slice(0, 0), frame=slice(0, 0))
    if kind == "diverged":
        for name in ("tip_displacement", "tip_velocity", "envelope_max", "displacement"):
            history[name].to_numpy()[..., -1] = np.inf
        history["energy_kinetic"].to_numpy()[-1] = np.nan
        history["strobe_displacement"].to_numpy()[..., -1] = np.nan
    assert len(figures.save_figures(history, case, tmp_path)) == len(figures.FIGURES)


def test_an_unwritable_folder_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "figures").write_text("a file")
    case = small_case()
    with pytest.raises(OSError, match="figures"):
        figures.save_figures(synthetic_history(case), case, tmp_path / "figures")


@pytest.mark.slow
@pytest.mark.usefixtures("pictures")
def test_all_figures_of_three_laminae_are_written(tmp_path: Path) -> None:
    recorded = three_laminae()
    paths = figures.save_figures(recorded.history(), recorded.case, tmp_path)
    assert [path.stem for path in paths] == list(figures.FIGURES)
    for name in EVERY_LAMINA:
        for colour in lamina_colours(3):
            least = 2e-5 if name == "spectra" else 1e-4
            assert share_near(pixels(tmp_path / f"{name}.png"), colour) > least, (name, colour)


def test_colours_of_laminae_differ_and_begin_again() -> None:
    n = len(LAMINA_COLOURS)
    assert len(set(lamina_colours(n))) == n >= 6
    assert lamina_colours(n + 2)[n:] == lamina_colours(2)


def test_histories_of_three_laminae_are_stacked() -> None:
    recorded = three_laminae()
    history = recorded.history()
    axes = draw("tip_histories", history, recorded.case).axes[0]
    lines = {line.get_label(): line for line in axes.lines}
    u = 1e3 * history["tip_displacement"].to_numpy()
    for number, name, below in ((1, "thick", 0.0), (2, "thin", 30.0), (3, "top", 50.0)):
        y = lines[f"{name}  y{'₁₂₃'[number - 1]}"].get_ydata()
        np.testing.assert_allclose(y, below + u[number - 1], rtol=1e-12, atol=1e-12)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels.count("gap") == labels.count("in contact") == 1
    dots = [line.get_xdata() for line in axes.lines if line.get_marker() == "o"]
    for dot_places, phase in zip(dots, stack.STRIKES.values(), strict=True):
        np.testing.assert_allclose(dot_places % 1.0, [phase] * WINDOW)


def test_each_interface_has_its_contact_line() -> None:
    recorded = three_laminae()
    history = recorded.history()
    figure = draw("contact_line", history, recorded.case)
    panels = [axes for axes in figure.axes if axes.get_title(loc="left")]
    assert [axes.get_title(loc="left") for axes in panels] == ["thick – thin", "thin – top"]
    last = stack.PERIODS - contact_figures.LINE_PERIODS
    x = 1e3 * history["x"].to_numpy()
    for interface, axes in enumerate(panels):
        marks = next(c for c in axes.collections if "impact" in str(c.get_label()))
        t, at = np.asarray(marks.get_offsets()).T
        phase, n = stack.STRIKES[interface], len(stack.IMPULSES[interface])
        np.testing.assert_allclose(np.unique(np.round(t, 6)), [last + phase, last + 1 + phase])
        assert sorted(set(np.round(at, 6))) == sorted(np.round(x[stack.NODE - np.arange(n)], 6))
        assert f"at most {(1, 3)[interface]} mN s" in str(marks.get_label())
    areas = [next(c for c in a.collections if "impact" in str(c.get_label())) for a in panels]
    assert areas[0].get_sizes().max() < areas[1].get_sizes().max()  # both have the same scale
    resting_lines = [
        [line for line in a.lines if "permanent" in str(line.get_label())] for a in panels
    ]
    assert not resting_lines[0]
    assert sorted(set(np.round(resting_lines[1][0].get_ydata(), 6))) == [137.0, 274.0]


def test_heat_stands_beside_each_contact_line_and_belongs_to_both_laminae() -> None:
    recorded = three_laminae()
    history = recorded.history()
    heat = history["heat"].to_numpy()
    seconds = stack.WINDOW * recorded.case.period
    assert heat.sum() == pytest.approx(2e-5 * stack.WINDOW / seconds)  # 1e-5 J at each strike
    figure = draw("contact_line", history, recorded.case)
    panels = [axes for axes in figure.axes if axes.get_xlabel() == "heat [mW]"]
    for interface_heat, axes in zip(heat, panels, strict=True):
        (drawn,) = axes.collections
        assert drawn.get_datalim(axes.transData).x1 == pytest.approx(1e3 * interface_heat.max())
    lamina_heat = scalars_of(history, recorded.case)["heat"][:, 0]
    np.testing.assert_allclose(lamina_heat, [heat[0], heat[0] + heat[1], heat[1]])


@pytest.mark.parametrize("name", ["spectra", "contact_line"])
def test_the_layout_is_found_once_and_is_that_of_the_figure(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = small_case()
    history = synthetic_history(case)
    with styled():
        figures.FIGURES[name](history, case).savefig(tmp_path / "itself.png")
    layouts = []
    execute = ConstrainedLayoutEngine.execute
    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", lambda *a: layouts.append(execute(*a)))
    monkeypatch.setattr(figures, "FIGURES", {name: figures.FIGURES[name]})
    figures.save_figures(history, case, tmp_path)
    assert len(layouts) == 1
    difference = np.abs(pixels(tmp_path / f"{name}.png") - pixels(tmp_path / "itself.png"))
    assert difference.mean() < 1e-3


def drawn(history: xr.Dataset, case: Case, names: tuple[str, ...]) -> str:
    """Return the descriptions of some figures."""
    functions = figures.figures_of(history)
    with styled():
        return "\n\n".join(golden.describe(functions[name](history, case)) for name in names)


@pytest.mark.parametrize("size", [3.0, 0.03, 0.0299])
def test_shades_of_gaps_become_finer_by_powers_of_ten(size: float) -> None:
    case = small_case()
    history = synthetic_history(case)
    history["displacement"] = 0.0 * history["displacement"]
    history["gap0"] = 1e-3 * size * history["gap0"] / float(history["gap0"].max())
    image = draw("contact_line", history, case).axes[0].collections[0]
    factor = {3.0: 1.0, 0.03: 0.01, 0.0299: 0.001}[size]
    np.testing.assert_allclose(image.norm.boundaries, factor * contact_figures.GAP_LEVELS)


def test_figures_of_a_run_are_those_that_it_has() -> None:
    case = small_case()
    history = synthetic_history(case)
    assert list(figures.figures_of(history, case)) == list(figures.FIGURES)
    single = history.isel(lamina=[0])
    assert list(figures.figures_of(single, case)) == [
        k for k in figures.FIGURES if k != "contact_line"
    ]
    add(single, stop_number=[1])
    assert list(figures.figures_of(single, case)) == list(figures.FIGURES)
    operators = history.drop_vars("tip_node")
    assert list(figures.figures_of(operators, case)) == list(figures.OF_PROBES)
    nothing = operators.isel(lamina=slice(0, 0))
    assert list(figures.figures_of(nothing, case)) == ["energy_ledger"]
    plots = figures.Plots(history, small_case())
    assert dir(plots) == sorted(figures.FIGURES)
    with pytest.raises(AttributeError) as error:
        plots.nothing  # noqa: B018
    assert str(error.value) == f"no figure 'nothing'; there are {', '.join(figures.FIGURES)}"
    with pytest.raises(AttributeError, match=r"no figure '_x'; there are $"):
        plots._x  # noqa: B018
