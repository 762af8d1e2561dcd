"""Refinement studies as a whole: durable, resumable, analysed on sequences with known limits."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from delam_fem.api import CaseError, preset
from delam_fem.studies.convergence import run as run_module
from delam_fem.studies.convergence.analysis import (
    FREE_FLOOR,
    NO_LIMIT,
    Convergence,
    exact_free_motion,
    limit_over_meshes,
    overview,
    page,
    pictures,
    tables,
    verdict,
)
from delam_fem.studies.convergence.level import LevelResult, converging, extrema
from delam_fem.studies.convergence.refinement import (
    FREE,
    LIMIT,
    EngineName,
    Level,
    RefinementStudy,
    method,
)
from delam_fem.studies.convergence.run import RESULT, load_results, run_refinement

CASE, LAW = preset("default"), "newton@moreau-jean"
STEPS, MESHES = (500, 1000, 2000, 4000), (5, 10, 20, 40)
LIMITS = {"tip_min_1": -0.02, "tip_max_1": 0.015, "tip_min_2": 0.002, "tip_max_2": 0.032}


def refinement(**settings: object) -> RefinementStudy:
    values: dict[str, object] = {"meshes": MESHES, "steps": STEPS, "limit_steps": 64000}
    laws = settings.pop("laws", "newton@moreau-jean,newton")
    assert isinstance(laws, str)
    methods = tuple(method(law) for law in laws.split(","))
    return RefinementStudy(CASE, methods, **(values | settings))  # type: ignore[arg-type]


def synthetic(level: Level, engine: EngineName) -> LevelResult:
    """Return values that converge in order 1/2 in Δt and 1 in h, and 2 and 4 without contact."""
    if level.method == FREE.name:
        frequencies, amplitudes = exact_free_motion(level.case)
        error = 4.0 / level.steps**2 + 3.0 / level.elements**4
        entries = {
            f"frequency_{i + 1}": (f * (1.0 + error), 0.0) for i, f in enumerate(frequencies)
        }
        entries |= {f"amplitude_{i + 1}": (a * (1 - error), 0.0) for i, a in enumerate(amplitudes)}
        return LevelResult(level.key, "completed", "", entries, 0.5, 100)
    if level.method == "newton@newmark" and level.elements == 40:
        return LevelResult(level.key, "diverged", "diverged in period 7", {}, 0.5, 7)
    in_time = 0.0 if level.method == LIMIT.name else 3.0 / math.sqrt(level.steps)
    values = {q.name: 1e-3 * (1.0 + in_time) for q in converging(2)}
    values |= {
        name: value * (1.0 + in_time + 0.5 / level.elements) for name, value in LIMITS.items()
    }
    entries = {name: (value, 1e-9) for name, value in values.items()}
    entries |= {"blocks": (30.0, 0.0), "periodicity": (1.0, 0.0)}
    return LevelResult(level.key, "completed", "", entries, 0.5, 60)


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Compute levels by `synthetic` and note them."""
    keys: list[str] = []

    def compute(level: Level, engine: EngineName) -> LevelResult:
        keys.append(level.key)
        return synthetic(level, engine)

    monkeypatch.setattr(run_module, "compute", compute)
    return keys


def whole(on: RefinementStudy) -> Convergence:
    return Convergence(on, {level.key: synthetic(level, "compiled") for level in on.levels()})


def test_order_and_limit_of_a_refinement() -> None:
    convergence = whole(refinement())
    levels = convergence.refinement.along_steps(convergence.refinement.methods[0], 20)
    told = convergence.limit(levels, "tip_min_1")
    assert told.reason == "Richardson"
    assert told.orders == pytest.approx([0.5, 0.5], abs=1e-3)
    assert told.value == pytest.approx(-0.02 * 1.025, rel=1e-5)
    levels = convergence.refinement.along_meshes(LIMIT, 64000)
    told = convergence.limit(levels, "tip_max_2", by="elements")
    assert told.orders == pytest.approx([1.0, 1.0], abs=1e-3)
    assert told.value == pytest.approx(0.032, rel=1e-5)


def test_without_a_limit_the_last_method_stands_for_it() -> None:
    laws = "newton@newmark,newton@moreau-jean,penalty"
    for limit, words in ((64000, "newton@moreau-jean, 64000"), (0, "penalty@newmark, 4000")):
        figure = limit_over_meshes(whole(refinement(laws=laws, limit_steps=limit)))
        assert f"\n{words} steps per period" in figure.get_suptitle()


def test_error_is_relative_to_half_the_range_of_the_limit() -> None:
    convergence = whole(refinement())
    level = convergence.refinement.level(convergence.refinement.methods[0], 20, 1000)
    excess = 3.0 / math.sqrt(1000)
    both = {1: 0.02 / (0.035 / 2.0), 2: 0.032 / (0.030 / 2.0)}
    assert convergence.error(level) == pytest.approx(excess / 1.025 * both[2], rel=1e-9)
    assert both[2] > both[1]


def test_numbers_of_any_size_may_be_judged() -> None:
    """Amplitudes are in half the range of their lamina, an impulse in its own size."""
    on = refinement()
    level, excess = on.level(on.methods[0], 20, 1000), 3.0 / math.sqrt(1000)
    of = {name: whole(replace(on, judged=(name,))) for name in ("amplitude", "modal_impulse")}
    half = 0.030 / 2.0 * 1.025
    assert of["amplitude"].error(level) == pytest.approx(1e-3 * excess / half, rel=0.03)
    assert of["modal_impulse"].error(level) == pytest.approx(excess, rel=1e-9)
    assert [q.name for q in of["amplitude"].judged] == ["amplitude_1_1", "amplitude_2_1"]


@pytest.mark.parametrize("name", ["contact_work", "amplitude_1_2", "ampli", "tip"])
def test_what_has_no_known_interval_is_not_judged(name: str) -> None:
    with pytest.raises(CaseError, match=rf"judge: expected some of tip_min_1.* given '{name}'"):
        whole(refinement(judged=(name,)))


def test_missing_and_diverged_levels_are_no_numbers() -> None:
    convergence = whole(refinement())
    diverged = convergence.refinement.level(convergence.refinement.methods[1], 40, 1000)
    assert math.isnan(convergence.error(diverged))
    assert math.isnan(convergence.standard_error(diverged, "tip_min_1"))
    del convergence.results[diverged.key]
    assert math.isnan(convergence.cost(diverged))
    assert not convergence.is_complete


def test_tables_tell_orders_limits_and_failures() -> None:
    convergence = whole(refinement())
    texts = {table.title: table.markdown() for table in tables(convergence)}
    free = texts["without contact, 20 elements: relative errors against the exact cantilever"]
    assert free.count("| 500 |") == 1
    steps = texts["newton@moreau-jean, 20 elements: what it tends to in steps"]
    assert "| y1 min [mm] | -21.45 | 0.50, 0.50 | -20.5 ± " in steps
    assert "diverged in period 7" in texts["newton@newmark, 40 elements"]
    assert "members are missing" in texts["newton@newmark, 40 elements: what it tends to in steps"]
    over_meshes = texts["rigid limit over meshes: what it tends to in elements"]
    assert "| y2 max [mm] | 32.4 | 1.00, 1.00 | 32 ± " in over_meshes
    for table in (*tables(convergence), *overview(convergence)):
        assert {len(row) for row in table.rows} == {len(table.heading)}


def test_overview_shows_all_methods_side_by_side() -> None:
    convergence = whole(refinement(meshes=(20, 40), steps=(1000, 2000)))
    by_title = {table.title: table for table in overview(convergence)}
    title = (
        "distance of the tip extremes from the rigid limit of the mesh ± what is left beyond [%]"
    )
    title = f"{title}, 40 elements"
    assert by_title[title].heading == ("steps", "newton@moreau-jean", "newton@newmark")
    assert by_title[title].rows[0][2] == "diverged"
    assert (
        by_title["y1 min [mm], 20 elements"].rows[1][1] == f"{-20.0 * (1.025 + 3 / 2000**0.5):.2f}"
    )


def test_the_interval_contains_the_limit_and_finer_runs() -> None:
    """Errors of order 1/2 in time and 1 in space: what is left beyond the finest is known."""
    convergence = whole(refinement(limit_steps=0))
    law = convergence.refinement.methods[0]
    scale = 15.0 * (1.0 + 3.0 / 4000**0.5 + 0.5 / 20.0)
    line = convergence.refinement.along_steps(law, 20)
    away, left = convergence.interval(line[0], line, "steps")
    assert away == pytest.approx(96.0 * (500**-0.5 - 4000**-0.5) / scale, rel=1e-6)
    assert left == pytest.approx(96.0 * 4000**-0.5 / scale, rel=0.1)  # each in its own scale
    line = convergence.refinement.along_meshes(law, 4000)
    away, left = convergence.interval(line[1], line, "elements")
    assert left == pytest.approx(16.0 / 40.0 / (15.0 * (1.0 + 3.0 / 4000**0.5 + 0.0125)), rel=0.05)
    assert away == pytest.approx(16.0 / 10.0 * 0.75 / 15.0, rel=0.06)
    assert math.isnan(
        convergence.interval(line[2], line, "elements")[1]
    )  # one finer run is too few


def test_errors_that_do_not_shrink_have_no_interval() -> None:
    convergence = whole(refinement(limit_steps=0))
    line = convergence.refinement.along_steps(convergence.refinement.methods[0], 20)
    for level, value in zip(line, (0.010, 0.012, 0.014, 0.016), strict=True):
        convergence.results[level.key].statistics["tip_max_1"] = (value, 1e-9)
    assert math.isinf(convergence.interval(line[0], line, "steps")[1])
    assert "errors do not shrink from level to level" in verdict(
        Convergence(refinement(laws=LAW, meshes=(20,), limit_steps=0), convergence.results)
    )


def test_scatter_widens_the_interval() -> None:
    convergence = whole(refinement(limit_steps=0))
    line = convergence.refinement.along_steps(convergence.refinement.methods[0], 20)
    narrow = convergence.interval(line[0], line, "steps")
    mean, _ = convergence.results[line[-1].key].statistics["tip_max_2"]
    convergence.results[line[-1].key].statistics["tip_max_2"] = (mean, 3e-4)
    away, left = convergence.interval(line[0], line, "steps")
    half = 15.0 * (1.0 + 3.0 / 4000**0.5 + 0.5 / 20.0)
    assert away == narrow[0]
    assert left == pytest.approx(narrow[1] + 2.0 * 0.3 / 30**0.5 / half, rel=1e-3)


def test_the_verdict_names_the_cheapest_run_within_one_per_cent() -> None:
    convergence = whole(
        refinement(meshes=(20, 40, 80, 160, 320, 640), steps=(4000,), limit_steps=0)
    )
    assert verdict(convergence) == (
        "Within 1 % of the limit of the tip extremes, and cheapest: newton@moreau-jean, 160 "
        "elements, 4000 steps per period (2 ms of processor time per period), 0.48 ± 0.16 %; only "
        "elements were refined."
    )
    by_title = {table.title: table for table in overview(convergence)}
    title = "distance of the tip extremes from the finest elements of each method ± what is left"
    table = by_title[f"{title} beyond [%], 4000 steps per period"]
    assert table.rows[3][:2] == ("160", "0.48 ± 0.16")


def test_the_verdict_says_why_no_run_is_near() -> None:
    far = "No run is known to be within 1 % of the limit of the tip extremes: "
    assert verdict(whole(refinement(limit_steps=0))).startswith(
        f"{far}the nearest that is judged, newton@moreau-jean, 10 elements, 1000 steps per period"
    )
    few = f"{far}none that was completed has two finer ones"
    assert verdict(whole(refinement(meshes=(20, 40), steps=(1000,)))).startswith(few)
    assert verdict(whole(refinement(laws="newton", meshes=(40,)))).startswith(few)


def test_verdict_on_elastic_impacts_names_no_limit() -> None:
    on = refinement(meshes=(20,))
    elastic = replace(on, case=on.case.with_overrides({"contact.restitution": 1.0}))
    convergence = whole(elastic)
    convergence.results[elastic.limit_of(20).key].statistics["impacts"] = (2551.4, 0.0)
    said = "with e = 1 contact takes nothing"
    assert said in verdict(convergence) and "(2551 at T/64000) grow with 1/Δt" in verdict(
        convergence
    )
    assert said not in verdict(whole(on))


def test_figures_show_what_is_above_round_off() -> None:
    convergence = whole(refinement())
    axes = pictures(convergence)["free_steps"](convergence).axes[0]
    drawn = [line for line in axes.lines if not str(line.get_label()).startswith("order")]
    assert drawn and all((line.get_ydata() > FREE_FLOOR).all() for line in drawn)
    one = whole(refinement(meshes=(20,), limit_steps=0))
    assert set(one.report.pictures) == {"figures/free_steps", "figures/work_over_steps"}


def test_without_a_limit_nothing_is_compared_with_it() -> None:
    convergence = whole(refinement(limit_steps=0))
    assert math.isnan(convergence.error(convergence.refinement.levels()[-1]))
    for table in (*tables(convergence), *overview(convergence)):
        assert "error [%]" not in table.heading
        assert "rigid limit" not in table.title
        assert {len(row) for row in table.rows} == {len(table.heading)}
    begin = f"# Convergence of case default\n\nfar\n\n{NO_LIMIT}\n\n**without"
    assert page(convergence, "far").startswith(begin)
    assert NO_LIMIT not in page(whole(refinement()), "far")


def test_every_finished_level_is_kept(
    tmp_path: Path, counted: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    on = refinement(meshes=(20, 40), steps=(1000,))
    stages = []

    def look(done: int, total: int) -> None:
        stages.append((len(load_results(tmp_path / RESULT)[0]), done, total))

    convergence = run_refinement(on, tmp_path, workers=1, progress=look)
    assert convergence.is_complete
    assert stages == [(k, k, 8) for k in range(9)] + [(8, 8, 8)]
    assert [level.key for level in on.levels()] == counted
    content = json.loads((tmp_path / RESULT).read_text("utf-8"))
    assert content["delam_fem"]
    caplog.clear()
    assert load_results(tmp_path / RESULT)[0] == convergence.results
    assert "damaged" not in caplog.text
    assert convergence.results["newton@newmark 40 1000"].outcome == "diverged"


def test_a_refinement_goes_on_and_grows(tmp_path: Path, counted: list[str]) -> None:
    run_refinement(
        refinement(meshes=(20,), steps=(1000,), laws="newton@moreau-jean"), tmp_path, workers=1
    )
    assert len(counted) == 3
    counted.clear()
    grown = refinement(meshes=(20,), steps=(1000, 2000), laws="newton@moreau-jean,newton")
    with pytest.raises(CaseError, match="holds 3 levels of a refinement study"):
        run_refinement(grown, tmp_path, workers=1)
    convergence = run_refinement(grown, tmp_path, workers=1, resume=True)
    assert sorted(counted) == [
        "newton@moreau-jean 20 2000",
        "newton@newmark 20 1000",
        "newton@newmark 20 2000",
        "none 20 2000",
    ]
    assert convergence.is_complete
    content = json.loads((tmp_path / RESULT).read_text("utf-8"))
    content["identity"] = content["identity"].replace('motion = "lateral"\n', "")  # a default
    (tmp_path / RESULT).write_text(json.dumps(content), "utf-8")
    counted.clear()
    assert run_refinement(grown, tmp_path, workers=1, resume=True).is_complete and not counted
    other = refinement(meshes=(20,), steps=(1000,), periods=7)
    with pytest.raises(CaseError, match=r"periods: .* there, 7 here"):
        run_refinement(other, tmp_path, workers=1, resume=True)


def test_a_file_that_is_no_refinement_is_refused(tmp_path: Path) -> None:
    (tmp_path / RESULT).write_text("{}", "utf-8")
    with pytest.raises(CaseError, match="expected the results of a refinement study"):
        run_refinement(refinement(), tmp_path, workers=1, resume=True)


def test_an_interrupted_refinement_keeps_what_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def compute(level: Level, engine: EngineName) -> LevelResult:
        done.append(level.key)
        if len(done) == 2:
            import signal

            signal.raise_signal(signal.SIGTERM)
        return synthetic(level, engine)

    monkeypatch.setattr(run_module, "compute", compute)
    convergence = run_refinement(refinement(meshes=(20,), steps=(1000,)), tmp_path, workers=1)
    assert not convergence.is_complete
    assert list(load_results(tmp_path / RESULT)[0]) == done == list(convergence.results)


def test_processes_compute_a_refinement(tmp_path: Path) -> None:
    on = refinement(
        meshes=(5,), steps=(250, 500), laws="newton@moreau-jean", limit_steps=1000, periods=2
    )
    convergence = run_refinement(on, tmp_path, workers=2)
    assert {result.outcome for result in convergence.results.values()} == {"completed"}
    assert np.isfinite(convergence.error(on.levels()[-2]))
    assert convergence.error(on.limit_of(5)) == 0.0
    assert all(convergence.cost(level) > 0.0 for level in on.levels())


def test_extremes_have_a_pair_for_each_tip() -> None:
    assert [q.name for q in extrema(2)] == list(LIMITS)
