import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from stack import three_laminae
from synthetic import small_case, synthetic_history

from delam_fem import Case
from delam_fem.api import diagnostics
from delam_fem.results.figures import run as figures
from delam_fem.results.pages import report

ABOUT_MID = {"units": "m/s", "long_name": "velocity of thin at 0.2 m"}


class Page(HTMLParser):
    """Collects what a browser would see."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.loaded: list[str] = []
        self.text: dict[str, str] = {}
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = dict(attrs)
        if tag == "img":
            self.images.append(attributes)
        for name in ("src", "href"):
            if attributes.get(name) and not str(attributes[name]).startswith(("data:", "#")):
                self.loaded.append(str(attributes[name]))
        if tag not in ("img", "meta"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        tag = self.open[-1] if self.open else ""
        self.text[tag] = self.text.get(tag, "") + data


@pytest.fixture
def case() -> Case:
    return small_case()


def draw_figures(directory: Path) -> None:
    """Write pictures that hold nothing in place of the figures of a run."""
    directory.mkdir()
    for name in figures.FIGURES:
        (directory / f"{name}.png").write_bytes(b"\x89PNG" + bytes(50))


def written(case: Case, directory: Path) -> Page:
    history = synthetic_history(case)
    summary = diagnostics.summary(history, case) | {"outcome": "completed", "thd": None}
    path = report.write_report(history, summary, case, directory)
    assert path == directory / "report.html"
    return Page(path.read_text("utf-8"))


def test_the_page_is_well_formed_and_loads_nothing(case: Case, tmp_path: Path) -> None:
    draw_figures(tmp_path / "figures")
    page = written(case, tmp_path)
    assert page.open == []
    assert page.loaded == ["figures"]  # a link, which nothing loads
    assert len(page.images) == len(figures.FIGURES)
    for image in page.images:
        assert image["alt"]
        data = str(image["src"]).removeprefix("data:image/png;base64,")
        assert b"PNG" in base64.b64decode(data, validate=True)
    assert not list(tmp_path.glob(".delam_fem-*"))
    assert (tmp_path / "report.html").stat().st_size < 5_000_000


def test_a_page_says_outcome_and_warnings(tmp_path: Path) -> None:
    recorded = three_laminae()
    history, case = recorded.history(), recorded.case
    history["sensor_mid"] = ("sensor_mid_time", np.array([3.0, -4.0, 0.0]), ABOUT_MID)
    history.attrs = {"delam_fem": "0.1.0", "engine": "compiled", "outcome": "completed"}
    draw_figures(tmp_path / "figures")
    summary = diagnostics.summary(history, case) | {"outcome": "completed", "energy_residual": 2e-9}
    text = report.page(history, summary | {"warnings": ["too <soft>"]}, case, tmp_path)
    for word in ("completed", "too &lt;soft&gt;", ABOUT_MID["long_name"]):
        assert word in text


def test_a_notebook_shows_a_fragment_with_the_warnings() -> None:
    recorded = three_laminae()
    history, case = recorded.history(), recorded.case
    summary = diagnostics.summary(history, case) | {"warnings": ["too soft", "too <long>"]}
    text = report.of_result(history, summary, case)
    assert "<style" not in text and "<script" not in text
    assert "too soft" in text and "too &lt;long&gt;" in text


def test_files_beside_the_page_are_linked_if_they_are_there(case: Case, tmp_path: Path) -> None:
    for name in report.FILES:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert written(case, tmp_path).loaded == list(report.FILES)


def test_every_figure_has_a_caption() -> None:
    of_fields = {"laminae", "solid"}
    assert set(report.CAPTIONS) == {
        *figures.FIGURES, *figures.OF_PROBES, *figures.OF_CHANNELS, *figures.OF_MANY_LINES,
        *of_fields,
    }  # fmt: skip


def test_the_case_can_be_taken_from_the_page(case: Case, tmp_path: Path) -> None:
    assert Case.from_toml(written(case, tmp_path).text["pre"]) == case


def test_numbers_and_versions_stand_in_the_tables(case: Case, tmp_path: Path) -> None:
    page = written(case, tmp_path)
    cells = page.text["td"]
    for expected in ("periodicity1", "thd–", "completed", "delam_fem0.1.0", "impacts−50−1"):
        assert expected in cells
    assert "Energy" in page.text["a"]  # in the contents


def test_warnings_stand_above_and_not_in_the_table(case: Case, tmp_path: Path) -> None:
    summary = {"warnings": ["too soft"], "message": "diverged at once"}
    page = Page(report.page(synthetic_history(case), summary, case, tmp_path))
    assert "diverged at once" in page.text["p"] and "too soft" in page.text["p"]
    assert "too soft" not in page.text["td"] and "warnings" not in page.text["td"]


def test_without_frames_the_page_says_why_there_is_no_film(case: Case, tmp_path: Path) -> None:
    history = synthetic_history(case).isel(frame=slice(0, 0))
    text = report.page(history, {}, case, tmp_path)
    assert "fields_per_period is 0" in text and "<canvas" not in text


def test_energy_rows_add_up(case: Case) -> None:
    rows = report.energy_rows(synthetic_history(case))
    assert sum(float(last.replace("−", "-")) for _, _, last in rows) == pytest.approx(0.0, abs=1e-9)
    assert [label for label, _, _ in rows if "dampers" in label] == []  # nothing flowed there


def test_channels_have_their_extremes_and_rms(case: Case, tmp_path: Path) -> None:
    history = synthetic_history(case)
    history["sensor_mid"] = ("sensor_mid_time", np.array([3.0, -4.0, 0.0]), ABOUT_MID)
    rows = {row[0]: row[1:] for row in report.channel_rows(history, case)}
    assert rows["mid"] == ("velocity of thin at 0.2 m", "−4 m/s", "3 m/s", "2.887 m/s")
    assert [*rows][:4] == ["tip_thick", "tip_thick_velocity", "tip_thin", "tip_thin_velocity"]
    size = 1e3 * float(np.abs(history["base_displacement"]).max())
    assert rows["base"][2] == f"{size:.4g} mm"
    assert "<h2>Channels</h2>" in re.sub(
        r"<h2[^>]*>", "<h2>", report.page(history, {}, case, tmp_path)
    )


def test_names_are_escaped(tmp_path: Path) -> None:
    case = small_case()
    history = synthetic_history(case)
    history = history.assign_coords(lamina=["<b>thick", "thin & light"])
    page = Page(report.page(history, {"note": "<script>"}, case, tmp_path))
    assert "<b>thick, thin & light" in page.text["p"]
    assert "<script>" in page.text["td"]
    assert "script" not in page.open


def test_a_report_of_three_laminae_shows_all_of_them(tmp_path: Path) -> None:
    recorded = three_laminae()
    history, case = recorded.history(), recorded.case
    draw_figures(tmp_path / "figures")
    summary = diagnostics.summary(history, case)
    page = Page(report.page(history, summary, case, tmp_path))
    assert page.open == []
    assert len(page.images) == len(figures.FIGURES)
    assert "laminae from bottom to top: thick, thin, top." in page.text["p"]
    largest = [f"{1e3 * value:.4g}" for value in summary["tip_max"]]
    assert "tip maxthick {}, thin {}, top {}\u00a0mm".format(*largest) in page.text["td"]
    assert 'name = "top"' in page.text["pre"]
