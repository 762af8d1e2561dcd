"""The figures of the paper: their tight numbers, their measures, and the files written of them."""

import csv
import json
import re
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import paper_docs
import pytest
from paper_docs import README_MARKS, between, markdown_table, write_docs
from PIL import Image
from prescribed import Prescribed
from typer.testing import CliRunner

from delam_fem.api import CaseError, json_ready
from delam_fem.cli.app import app
from delam_fem.paper import (
    histories,
    parameters,
    portraits,
    reproduce,
    responses,
    runs as paper_lab,
    shapes,
)
from delam_fem.paper.claims import HEADING, Claim, rough_part, settling, tip_positions
from delam_fem.paper.reproduce import entries, tally, write_page
from delam_fem.paper.runs import (
    BAND,
    Effort,
    Laboratory,
    laboratory,
    motion_case,
    peak_frequencies,
    swept_case,
    swept_envelope,
)
from delam_fem.studies.executors import Serial
from delam_fem.system.written import LIST

PLAN = Effort(
    plane_points=2, plane_periods=200, response_step=0.875, response_periods=40, thresholds=2,
    has_long_refinements=False,
)  # fmt: skip
SHORT = Effort(
    periods=45, plane_points=2, plane_periods=200, response_step=0.875, response_periods=12,
    thresholds=3, gap_exponents=(1.0, 2.0),
)  # fmt: skip
"""For prescribed motions."""
THICK_HZ, THIN_HZ = 3.1649, 1.4357
"""Natural frequencies from the given EI."""
PRINTED = 5e-5
"""Half of their last digit."""


@pytest.fixture(scope="module")
def lab() -> Iterator[Laboratory]:
    yield Laboratory(PLAN, Serial())


def test_natural_frequencies_and_mass_ratio(lab: Laboratory) -> None:
    numbers = shapes.measure(lab)
    first = [f[0] for f in numbers.natural_frequencies_hz]
    assert first == pytest.approx([THICK_HZ, THIN_HZ], abs=PRINTED)
    assert numbers.mass_ratio == pytest.approx(1.942, abs=5e-4)


def test_thirty_minute_sweep_peaks_where_the_paper_reads_its_frequency(lab: Laboratory) -> None:
    case = swept_case("linear", BAND, "none", 250)
    (result,) = lab.motions([case])
    f, amplitude = swept_envelope(result)
    thick, thin = peak_frequencies(f, amplitude)
    assert 1.455 <= thin <= 1.465
    assert THICK_HZ < thick < THICK_HZ + 0.03
    exact = motion_case(3.25, PLAN).linear_amplitude(0, f)
    far = (f > 1.0) & (f < 2.5)
    assert amplitude[0, far] == pytest.approx(exact[far], rel=0.05)  # a cycle lasts 3 mHz


@pytest.mark.usefixtures("pictures")
@pytest.mark.parametrize(
    "name", [name for name in reproduce.FIGURES if name not in ("6", "7", "15")]
)
def test_figures_have_the_stored_words(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (paper_lab, responses):
        monkeypatch.setattr(module, "SWEEP_SECONDS", 120.0)
    monkeypatch.setattr(responses, "LINEAR_PERIODS", 20)
    monkeypatch.setattr(shapes, "FILM_FRAMES", 4)
    reproduce.reproduce(Prescribed(SHORT, Serial()), tmp_path, [name])
    content = json.loads((tmp_path / f"{reproduce.file_stem(name)}.json").read_text("utf-8"))
    assert content["seconds"] > 0.0


@pytest.mark.slow
def test_shapes_are_drawn_and_filmed_over_a_period(lab: Laboratory, tmp_path: Path) -> None:
    reproduce.reproduce(lab, tmp_path, ["4"])
    content = json.loads((tmp_path / "fig04.json").read_text("utf-8"))
    assert content["animation"] == "fig04.gif"
    assert content["claims"][0]["verdict"] == "holds"
    with Image.open(tmp_path / "fig04.gif") as film:
        assert film.n_frames == 50
        assert film.info["duration"] == pytest.approx(1000.0 / 12.0, abs=10.0)


def test_distortion_of_the_thin_lamina_grows_with_each_derivative_at_every_node(
    lab: Laboratory,
) -> None:
    numbers = portraits.measure(lab)
    d, thd = numbers.d_at_nodes, numbers.thd_at_nodes
    assert d["displacement"].shape == (2, 21)
    for order in portraits.ORDERS:
        assert np.sqrt(1.0 + thd[order][:, 1:] ** 2) - 1.0 == pytest.approx(d[order][:, 1:])
    for i, j in (("displacement", "velocity"), ("velocity", "acceleration")):
        assert (d[i][:, 1:] < d[j][:, 1:]).all()
    assert d["displacement"][1, -1] == pytest.approx(numbers.d["displacement"][1], rel=0.02)
    assert set(numbers.d_by_gap_exponent) == {"1", "1.5", "2", "2.5", "3"}


def test_every_recorded_decision_follows_the_corrected_partition(lab: Laboratory) -> None:
    (result,) = lab.motions([shapes.detailed_case(lab)])
    state, violations = shapes.decisions(result)
    assert violations == 0
    assert state.size == (2 * 1000 - 1) * 20
    hits = np.count_nonzero((state == shapes.STRUCK) | (state == shapes.BEGUN))
    assert hits == pytest.approx(result.history.sizes["event"], abs=1)
    assert (state == shapes.BEGUN).any()
    shifted = result.history.copy()
    shifted["contact_state"] = shifted["contact_state"].roll(frame=7)
    broken = type(result)(result.case, shifted, result.summary, result.state)
    assert shapes.decisions(broken)[1] > 0


def test_restitution_of_the_computed_strikes_is_near_the_given_one(lab: Laboratory) -> None:
    numbers = histories.measure_velocities(lab)
    assert numbers.restitution.size == 10
    assert numbers.restitution.mean() == pytest.approx(0.1, abs=0.05)


def test_scatter_of_a_doubled_motion_is_that_of_its_two_points() -> None:
    strobes = np.tile([1.0, -1.0], (2, 50))
    assert parameters.one_period_scatter(strobes, np.array([2.0, 4.0])) == pytest.approx(1.0)


def test_main_effects_share_the_variance() -> None:
    e, k = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 5), indexing="ij")
    values = np.stack([3.0 * e + k, k], axis=-1)
    by_e, by_k = (parameters.main_effect(values, axis) for axis in (0, 1))
    assert by_e == pytest.approx([0.9, 0.0]) and by_k == pytest.approx([0.1, 1.0])


def test_best_decade_has_the_most_one_periodic_points() -> None:
    damping = np.geomspace(0.01, 10.0, 7)
    kind = np.array([[1, 1], [1, 1], [0, 1], [0, 0], [0, 1], [0, 0], [1, 1]])
    amplitude = np.ones((7, 2, 2))
    amplitude[3, 0] = 3.0, 1.0
    best = parameters.best_decade(damping, kind, amplitude)
    assert best.kept["from"] == pytest.approx(damping[3])  # 5 of 6, as many as nowhere else
    assert best.one_periodic == pytest.approx(5.0 / 6.0)
    chosen = [3.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    assert best.amplitude_spread == pytest.approx([np.std(chosen) / np.mean(chosen), 0.0])


def test_jumps_are_told_from_slopes() -> None:
    f = np.arange(10.0)
    assert responses.jumps(f, np.array([1, 1.1, 1.2, 1.3, 5, 5.1, 5.2, 5.3, 5.4, 5.5])) == [3.5]
    assert responses.jumps(f, 2.0**f) == []


def test_rough_part_keeps_what_is_above_the_limit() -> None:
    t = np.arange(2000) / 1000.0
    low, high = np.sin(2 * np.pi * 20 * t), np.cos(2 * np.pi * 21 * t)
    assert rough_part(low + high, 2) == pytest.approx(high, abs=1e-12)


def test_settling_is_the_last_period_away_from_the_cycle() -> None:
    strobe = np.tile([1.0, -1.0], (2, 100))
    strobe[0, 150:] += 0.1  # within the scatter
    strobe[1, 57] = 3.0
    assert settling(strobe, np.ones(2), 2, 0.2) == 58
    assert settling(strobe, np.ones(2), 2, 5.0) == 0
    assert settling(strobe[:, 60:140], np.ones(2), 2, 0.2) == 0
    assert settling(strobe[:, 60:140], np.ones(2), 1, 0.2) == 80
    short = np.array([[0.0, 0.0, 0.28], [0.0, 0.0, 0.0]])  # the last is 0.19 from the mean
    assert settling(short, np.ones(2), 1, 0.16) == 3


def test_positions_begin_at_the_gap(lab: Laboratory) -> None:
    (result,) = lab.motions([motion_case(1.25, PLAN)])
    t, y = tip_positions(result, 4)
    assert t[-1] == 4.0 and y.shape == (2, 4000)
    assert (y[1] - y[0]).min() == pytest.approx(1e3 * result.summary["minimum_tip_gap"], rel=0.2)


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ([], list(reproduce.FIGURES)),
        (["2"], ["2a", "2b"]),
        (["fig05", "fig02a.png"[:6]], ["2a", "5"]),
    ],
)
def test_figures_are_chosen_as_users_name_them(given: list[str], names: list[str]) -> None:
    assert reproduce.chosen(given) == names


def test_unknown_figures_and_workers_are_told() -> None:
    with pytest.raises(CaseError, match="figure '99': "):
        reproduce.chosen(["99"])
    with pytest.raises(CaseError, match=r"workers: .*given 0"):
        next(iter([laboratory(PLAN, workers=0).__enter__()]))


def test_names_of_files() -> None:
    assert [reproduce.file_stem(n) for n in ("1", "2a", "15", "gamma")] == [
        "fig01", "fig02a", "fig15", "gamma",
    ]  # fmt: skip


def test_numbers_become_json() -> None:
    numbers = {1.5: np.array([[1.0, np.nan]]), "b": (np.int64(2), np.True_, None, 1 / 3)}
    assert json_ready(numbers, 7) == {"1.5": [[1.0, None]], "b": [2, True, None, 0.3333333]}


class Diverging(Serial):
    """Returns results that diverged, whatever it is given."""

    def submit(self, *_: object, **__: object) -> "Future[SimpleNamespace]":  # type: ignore[override]
        future: Future[SimpleNamespace] = Future()
        history = SimpleNamespace(attrs={"outcome": "diverged"})
        future.set_result(SimpleNamespace(case=SimpleNamespace(name="paper"), history=history))
        return future


def test_a_motion_that_diverges_is_told() -> None:
    with pytest.raises(RuntimeError, match="case paper diverged; the case is"):
        Laboratory(PLAN, Diverging()).motions([motion_case(3.25, PLAN)])


@pytest.fixture()
def folder(tmp_path: Path) -> Path:
    """A folder with two figures, without their computation."""
    claims = [
        Claim("1", "a | b", "sec. 1", "1 < 2", "holds", "1"),
        Claim("1", "c", "sec. 2", "no", "does not hold", "2"),
    ]
    for name, figure_claims in (("1", claims), ("2a", [])):
        stem = reproduce.file_stem(name)
        (tmp_path / f"{stem}.png").write_bytes(b"picture")
        (tmp_path / f"{stem}.gif").write_bytes(b"film")
        content = {
            "name": name, "title": f"title {name}", "caption": "what & what",
            "animation": "fig02a.gif" if name == "2a" else None,
            "claims": [vars(claim) for claim in figure_claims], "numbers": {},
        }  # fmt: skip
        (tmp_path / f"{stem}.json").write_text(json.dumps(content), "utf-8")
    return tmp_path


def test_page_links_to_what_is_there(folder: Path) -> None:
    figures = entries(folder, ["fig01", "fig02a", "fig02b"])
    page = write_page(folder, figures).read_text("utf-8")
    targets = set(re.findall(r'(?:src|href)="([^"]+)"', page))
    assert {t for t in targets if not t.startswith("#")} == {
        "fig01.png", "fig01.json", "fig02a.png", "fig02a.gif", "fig02a.json",
    }  # fmt: skip


def test_documentation_is_written_from_the_numbers(folder: Path, tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    (root / "README.md").write_text(f"head\n{README_MARKS[0]}\noutdated\n{README_MARKS[1]}\ntail\n")
    figures = entries(folder, ["fig01", "fig02a"])
    paths = write_docs(folder, root, figures)
    readme, docs = (root / name for name in ("README.md", "docs/paper.md"))
    assert {readme, docs} <= set(paths)
    text = readme.read_text("utf-8")
    assert "outdated" not in text and text.startswith("head") and text.endswith("tail\n")
    assert re.search(r"\d+ statements: \d+ hold", text)
    assert "a | b" in (root / "docs" / paper_docs.TABLE).read_text("utf-8")
    pictures = re.findall(r"\((figures/\S+)\)", docs.read_text("utf-8"))
    assert "figures/paper_fig02a.gif" in pictures
    for picture in pictures:
        assert (root / "docs" / picture).is_file()
    write_docs(folder, root, figures)
    assert readme.read_text("utf-8") == text


def test_readme_counts_the_claims_of_the_page() -> None:
    root = Path(__file__).parents[2]
    page, readme = ((root / name).read_text("utf-8") for name in ("docs/paper.md", "README.md"))
    with (root / "docs" / paper_docs.TABLE).open(encoding="utf-8", newline="") as file:
        heading, *rows = csv.reader(file)
    assert tuple(heading) == HEADING
    claims = [Claim(*row[:4], row[5], row[4]) for row in rows]  # type: ignore[arg-type]
    assert all(claim.margin for claim in claims)
    assert tally(claims) in page and tally(claims) in readme
    assert paper_docs.markdown_table(claims) in page


def test_script_of_the_documentation_wants_all_figures(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        paper_docs.main([str(folder)])
    assert "no figure 2b, 3, 4" in capsys.readouterr().err


def test_marks_must_be_there() -> None:
    with pytest.raises(ValueError, match="expected A and then B"):
        between("B text A", ("A", "B"), "")


def test_tables_count_and_columns() -> None:
    claim = Claim("1", "t", "s", "m", "open", "–")
    assert tally([claim]) == "1 statements: 0 hold, 0 do not, 0 are undecided, 1 are open."
    assert markdown_table([claim]).splitlines()[2].startswith("| 1 | t |")


def test_command_writes_figures_numbers_and_page(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["paper", "1", "-o", str(tmp_path), "-j", "1", "--fast"])
    assert result.exit_code == 0, result.output
    assert {path.name for path in tmp_path.iterdir() if path.name != LIST} == {
        "fig01.png", "fig01.json", "index.html",
    }  # fmt: skip
    assert "does not hold" in result.output


def test_command_tells_unknown_figures(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["paper", "17", "-o", str(tmp_path)])
    assert result.exit_code == 2
