import base64
from html.parser import HTMLParser
from pathlib import Path

import pytest
from stack import three_laminae
from synthetic import small_case, synthetic_history

from delam_fem import Case
from delam_fem.results import diagnostics
from delam_fem.results.figures import run as figures
from delam_fem.results.pages import report


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
            if attributes.get(name) and not str(attributes[name]).startswith("data:"):
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


def written(case: Case, directory: Path) -> Page:
    history = synthetic_history(case)
    summary = diagnostics.summary(history, case) | {"outcome": "completed", "thd": None}
    path = report.write_report(history, summary, case, directory)
    assert path == directory / "report.html"
    return Page(path.read_text("utf-8"))


def test_the_page_is_well_formed_and_loads_nothing(case: Case, tmp_path: Path) -> None:
    figures.save_figures(synthetic_history(case), case, tmp_path / "figures")
    page = written(case, tmp_path)
    assert page.open == []
    assert page.loaded == []
    assert len(page.images) == len(figures.FIGURES)
    for image in page.images:
        assert image["alt"]
        data = str(image["src"]).removeprefix("data:image/png;base64,")
        assert base64.b64decode(data, validate=True).startswith(b"\x89PNG")
    assert not list(tmp_path.glob("part-*"))


def test_every_figure_has_a_caption() -> None:
    assert set(report.CAPTIONS) == {*figures.FIGURES, "laminae"}


def test_the_case_can_be_taken_from_the_page(case: Case, tmp_path: Path) -> None:
    assert Case.from_toml(written(case, tmp_path).text["pre"]) == case


def test_numbers_and_versions_stand_in_the_tables(case: Case, tmp_path: Path) -> None:
    cells = written(case, tmp_path).text["td"]
    for expected in ("periodicity1", "thd–", "completed", "delam_fem0.1.0", "impacts-0.05-0.001"):
        assert expected in cells


def test_energy_rows_add_up(case: Case) -> None:
    rows = report.energy_rows(synthetic_history(case))
    assert sum(float(last) for _, _, last in rows) == pytest.approx(0.0, abs=1e-12)
    assert [label for label, _, _ in rows if "dampers" in label] == []  # nothing flowed there


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
    figures.save_figures(history, case, tmp_path / "figures")
    summary = diagnostics.summary(history, case)
    page = Page(report.page(history, summary, case, tmp_path / "figures"))
    assert page.open == []
    assert len(page.images) == len(figures.FIGURES)
    assert "laminae from bottom to top: thick, thin, top." in page.text["p"]
    largest = ", ".join(f"{value:.4g}" for value in summary["tip_max"])
    assert f"tip max{largest}m" in page.text["td"]
    assert 'name = "top"' in page.text["pre"]
