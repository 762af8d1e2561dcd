"""The page in a browser: no error, no request, a film that plays, on screens and on paper."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from synthetic import small_case, synthetic_history

from delam_fem.api import diagnostics
from delam_fem.results.figures import run as figures
from delam_fem.results.pages import report

BROWSER = Path("/usr/bin/chromium")
playwright = pytest.importorskip("playwright.sync_api", reason="no playwright")
pytestmark = [
    pytest.mark.browser,
    pytest.mark.once,
    pytest.mark.skipif(
        not BROWSER.exists(), reason="no Chromium (Debian: apt-get install chromium)"
    ),
]
A4 = 794
"""Width of A4 in CSS pixels."""
LONGEST = 10_000
"""ms; a film of this page goes on every 40 ms."""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Write a report with its figures; return its address."""
    folder, case = tmp_path_factory.mktemp("run"), small_case()
    history = synthetic_history(case)
    figures.save_figures(history, case, folder / "figures")
    summary = diagnostics.summary(history, case) | {"warnings": ["a warning " * 20]}
    return report.write_report(history, summary, case, folder).as_uri()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=str(BROWSER), args=["--no-sandbox"])
        yield browser
        browser.close()


class Visit:
    """A page that is open, with all that it has said and asked for."""

    def __init__(self, browser: Any, address: str, **options: Any) -> None:
        self.page = browser.new_page(**options)
        self.said: list[str] = []
        self.asked: list[str] = []
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(address)

    @property
    def frame(self) -> int:
        return int(self.page.evaluate("document.querySelector('figure.film').dataset.frame"))

    def plays(self) -> bool:
        """Return whether the film goes on before `LONGEST`."""
        script = "before => Number(document.querySelector('figure.film').dataset.frame) !== before"
        try:
            self.page.wait_for_function(script, arg=self.frame, timeout=LONGEST)
        except playwright.TimeoutError:
            return False
        return True

    def painted(self) -> int:
        """Return the number of different colours in the canvas."""
        return int(
            self.page.evaluate(
                """() => {
                const canvas = document.querySelector("figure.film canvas");
                const [pen, size] = [canvas.getContext("2d"), [canvas.width, canvas.height]];
                return new Set(new Uint32Array(pen.getImageData(0, 0, ...size).data.buffer)).size;
            }"""
            )
        )

    def silent(self) -> bool:
        """Return whether the page had nothing to say and asked for nothing but itself."""
        return not self.said and [a for a in self.asked if not a.startswith("data:")] == [
            self.page.url
        ]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_the_page_shows_itself_and_plays(
    browser: Any, address: str, width: int, scheme: str
) -> None:
    visit = Visit(browser, address, viewport={"width": width, "height": 800}, color_scheme=scheme)
    page = visit.page
    assert visit.plays()
    assert visit.painted() > 10
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    loaded = page.evaluate("[...document.images].map(i => i.complete && i.naturalWidth > 0)")
    assert loaded == [True] * len(figures.FIGURES)
    paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (paper == "rgb(255, 255, 255)") == (scheme == "light")
    assert visit.silent()
    page.close()


@pytest.mark.slow
def test_the_film_pauses_scrubs_and_slows(browser: Any, address: str) -> None:
    visit = Visit(browser, address, reduced_motion="reduce")
    page = visit.page
    page.wait_for_timeout(200)
    assert visit.frame == 0  # a reader who wants no motion gets none
    page.get_by_role("button", name="play").click()
    assert visit.plays()
    page.get_by_role("button", name="pause").click()
    stopped = visit.frame
    page.wait_for_timeout(200)
    assert visit.frame == stopped
    page.get_by_label("frame").fill("33")
    assert visit.frame == 33
    assert page.locator("figure.film output").text_content().startswith("t = 14.6")
    page.get_by_label("speed").select_option("0.01")
    page.get_by_role("button", name="play").click()
    page.wait_for_timeout(300)
    assert visit.frame in (33, 34)  # real time would have done 19 frames
    page.get_by_role("button", name="true to scale").click()
    assert page.get_by_role("button", name="stretch").count() == 1
    assert visit.silent()
    page.close()


@pytest.mark.slow
def test_pictures_can_be_enlarged(browser: Any, address: str) -> None:
    visit = Visit(browser, address, viewport={"width": 390, "height": 800})
    page, picture = visit.page, visit.page.locator(".view img").first
    before = picture.bounding_box()["width"]
    page.get_by_role("button", name="larger").first.click()
    assert picture.bounding_box()["width"] == pytest.approx(1.5 * before, rel=0.02)
    page.get_by_role("button", name="whole picture").first.click()
    assert picture.bounding_box()["width"] <= 390
    assert visit.silent()
    page.close()


@pytest.mark.slow
def test_the_printed_page_is_light_and_fits_the_paper(browser: Any, address: str) -> None:
    visit = Visit(browser, address, viewport={"width": A4, "height": 1123}, color_scheme="dark")
    page = visit.page
    page.emulate_media(media="print")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.locator("nav").is_hidden() and page.locator(".tools").first.is_hidden()
    assert page.evaluate("document.documentElement.scrollWidth") <= A4
    assert page.evaluate("getComputedStyle(document.querySelector('.view img')).filter") == "none"
    assert page.pdf(prefer_css_page_size=True).count(b"/Type /Page\n") in range(3, 12)
    page.close()
