"""The page of a sweep: its sentence, its map, and commands and links to runs of its points."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from delam_fem import load_sweep
from delam_fem.api import preset
from delam_fem.case.toml import parse_override
from delam_fem.results.figures.style import ORANGE, SKY
from delam_fem.studies import diagrams
from delam_fem.studies.diagrams import FAILED, IRREGULAR, points, sentence, write_page

FREQUENCIES, STIFFNESSES = np.array([3.0, 3.5]), np.array([10.0, 100.0, 1000.0])
CELL = re.compile(r'<td style="background:([^"]*)"><a href="([^"]*)" title="([^"]*)">([^<]*)</a>')


def axis(name: str, values: np.ndarray, key: str) -> xr.DataArray:
    return xr.DataArray(values, dims=name, attrs={"key": key, "units": "1"})


def plane(*, directions: bool = False, second: str = "contact.penalty_stiffness") -> xr.Dataset:
    """Return 2 × 3 points: of period 1, 1, 2 and 1, none, diverged."""
    periodicity = np.array([[1.0, 1.0, 2.0], [1.0, np.nan, np.nan]])
    outcome = np.full((2, 3), "completed", dtype=object)
    outcome[1, 2] = "diverged"
    grid: tuple[str, ...] = ("frequency", "second")
    coords: dict[str, object] = {
        "frequency": axis("frequency", FREQUENCIES, "excitation.frequency"),
        "second": axis("second", STIFFNESSES, second),
    }
    if directions:
        grid, coords = ("direction", *grid), {"direction": ["up", "down"], **coords}
        periodicity, outcome = np.stack([periodicity] * 2), np.stack([outcome] * 2)
    about = {
        "title": "sweep test",
        "sweep": 'base = "case.toml"',
        "case": preset("paper").to_toml(),
    }
    data = {"outcome": (grid, outcome), "periodicity": (grid, periodicity)}
    return xr.Dataset(data, coords=coords, attrs=about)


def test_the_sentence_counts_outcomes_and_periods() -> None:
    expected = "6 points: 5 completed, 1 diverged; of these 3 of period 1, 1 of period 2"
    assert sentence(plane()) == f"{expected}, 1 without a period."
    moving = plane().assign(settled=(plane()["outcome"].dims, np.ones((2, 3))))
    moving["settled"][1, 1] = 0.0
    assert sentence(moving) == f"{expected}, 1 not settled."
    moving["settled"][:] = 0.0
    assert sentence(moving).endswith("; of these 5 not settled.")
    assert sentence(plane().drop_vars("periodicity")) == "6 points: 5 completed, 1 diverged."


def test_commands_run_the_cases_of_their_points(tmp_path: Path) -> None:
    folder = tmp_path / "a sweep"
    sweep_points = list(points(plane(), folder))
    assert [point.number for point in sweep_points] == list(range(6))
    words = shlex.split(sweep_points[4].command)
    assert words[:3] == ["delam-fem", "run", str(folder / "case.toml")]
    assert words[-2:] == ["-o", str(folder / "points" / "4")]
    keys = dict(parse_override(text) for text in words[4:-2:2])
    assert keys == {"excitation.frequency": 3.5, "contact.penalty_stiffness": 100.0}
    assert preset("paper", keys).excitation.frequency == 3.5


def test_points_with_initial_states_have_no_command(tmp_path: Path) -> None:
    sweep_points = list(points(plane(second="initial.thick.displacement"), tmp_path))
    assert {point.command for point in sweep_points} == {""}


def test_cells_have_their_colours_and_lead_to_their_runs(tmp_path: Path) -> None:
    report = tmp_path / "points" / "4" / "report.html"
    report.parent.mkdir(parents=True)
    report.touch()
    text = write_page(plane(), tmp_path).read_text("utf-8")
    # from top to bottom: the last value of the second axis first
    assert CELL.findall(text) == [
        (ORANGE, "#point-2", "frequency = 3, second = 1000: 2", "2"),
        (FAILED, "#point-5", "frequency = 3.5, second = 1000: diverged", "×"),
        (SKY, "#point-1", "frequency = 3, second = 100: 1", "1"),
        (IRREGULAR, "points/4/report.html", "frequency = 3.5, second = 100", "–"),
        (SKY, "#point-0", "frequency = 3, second = 10: 1", "1"),
        (SKY, "#point-3", "frequency = 3.5, second = 10: 1", "1"),
    ]
    for number in range(6):
        assert f'<tr id="point-{number}">' in text
        assert (f"points/{number}</code>" in text) == (number != 4)


def test_a_sweep_up_and_down_has_a_map_of_each(tmp_path: Path) -> None:
    text = write_page(plane(directions=True), tmp_path).read_text("utf-8")
    assert text.count('<table class="map">') == 2
    assert "second over frequency, up" in text and "second over frequency, down" in text
    assert len(CELL.findall(text)) == 12


def test_a_page_of_two_axes_names_a_diagram_of_two_axes_that_can_be_drawn(tmp_path: Path) -> None:
    """A plane needs 64 strobes, basins any."""
    assert "show diagram" not in write_page(plane(), tmp_path).read_text("utf-8")
    for count, kind in ((64, "plane"), (40, "basins")):
        strobes = np.zeros((2, 3, 2, count))
        data = plane().assign(
            strobe_displacement=(("frequency", "second", "lamina", "strobe"), strobes)
        )
        text = write_page(data, tmp_path).read_text("utf-8")
        assert f"delam-fem show diagram {kind}" in text


def test_a_plane_can_be_drawn_of_a_sweep_that_says_nothing_of_its_record(tmp_path: Path) -> None:
    file = tmp_path / "s.toml"
    axes = ("excitation.frequency", "gap.tip")
    text = "".join(f'[[axis]]\nkey = "{key}"\nvalues = [0.01, 0.02]\n' for key in axes)
    file.write_text(f'base = "paper"\n{text}', encoding="utf-8")
    diagrams.require_drawable("plane", load_sweep(file))


def test_a_line_has_no_map_and_shows_its_diagrams(tmp_path: Path) -> None:
    line = plane().isel(second=0, drop=True)
    assert "delam-fem show diagram response" in write_page(line, tmp_path).read_text("utf-8")
    (tmp_path / "response.png").write_bytes(b"\x89PNG")
    text = write_page(line, tmp_path).read_text("utf-8")
    assert 'class="map"' not in text and text.count("<img") == 1
    assert 'id="point-1"' in text


def test_too_many_points_are_not_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagrams, "MOST_POINTS", 5)
    text = write_page(plane(), tmp_path).read_text("utf-8")
    assert "6 points are too many for a page" in text and "point-0" not in text
