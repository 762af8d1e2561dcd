"""Refinement studies: what they refuse, what their levels compute."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from delam_fem.api import Case, CaseError, load_case, preset
from delam_fem.numerics.statistics import orders_of_errors
from delam_fem.studies.convergence import level as level_module
from delam_fem.studies.convergence.analysis import Convergence, page
from delam_fem.studies.convergence.level import compute, fitted_frequency
from delam_fem.studies.convergence.refinement import (
    FREE,
    LIMIT,
    METHODS,
    Level,
    PointMesh,
    RefinementStudy,
    method,
    usual_methods,
)
from delam_fem.studies.convergence.study import Converge
from delam_fem.studies.linear import first_frequencies

CASE = preset("default", {"damping.rayleigh": "stiffness"})
DECAYING = preset("default", {f"lamina.{name}.damping_ratio": 0.05 for name in ("thick", "thin")})
OTHERS = Path(__file__).parents[3] / "docs" / "examples" / "others"
MESH_FILE = Path(__file__).parents[3] / "meshes" / "laminae_20.msh"
ORDER_IN_TIME, ORDER_IN_SPACE = 0.1, 0.15
"""Windows around 2 and 4. Measured: 2.000 to 2.006; 3.89 from 2 to 4 elements, 3.98 from 4 to 8."""
ENGINES_AGREE = 1e-11
"""Relative; light contact scatters little. Measured: 3e-13."""
SPECIFIED, SPECIFIED_COARSE = 0.02, 0.05
"""Relative, from N = 4000 on, and at N = 1000, where cycles scatter."""


def refinement(
    case: Case = CASE, laws: str = "newton@moreau-jean", **settings: object
) -> RefinementStudy:
    values: dict[str, object] = {"meshes": (10,), "steps": (1000,), "limit_steps": 0, "periods": 4}
    methods = tuple(method(law) for law in laws.split(","))
    return RefinementStudy(case, methods, **(values | settings))  # type: ignore[arg-type]


def computed(levels: list[Level], on: RefinementStudy) -> Convergence:
    results = [compute(level, on.engine) for level in levels]
    assert [result.error for result in results] == [""] * len(levels)
    return Convergence(on, {result.key: result for result in results})


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"steps": (1000, 500)}, "steps: .*given 1000"),
        ({"steps": ()}, "steps: .*given none"),
        ({"meshes": (20, 10)}, "elements: "),
        ({"meshes": ()}, "elements: "),
        ({"periods": 0}, "periods: "),
        ({"steps": (2,)}, "time.steps_per_period: "),
        ({"meshes": (Path("missing.msh"),)}, "mesh.file: no such file"),
    ],
)
def test_bad_refinements_are_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(CaseError, match=message):
        refinement(**settings)


def test_swept_excitation_is_refused() -> None:
    swept = {"start_frequency": 1.0, "end_frequency": 4.0, "duration": 10.0}
    keys = {"excitation.kind": "sweep", **{f"excitation.{k}": v for k, v in swept.items()}}
    with pytest.raises(CaseError, match=r'expected excitation\.kind = "harmonic"'):
        refinement(CASE.with_overrides(keys))


@pytest.mark.parametrize(
    "text",
    [
        "none",
        "newton/soft",
        "coulomb",
        "newton/",
        "newton@euler",
        "penalty@moreau-jean",
        "newton:x",
    ],
)
def test_unknown_laws_are_refused(text: str) -> None:
    with pytest.raises(CaseError, match=rf"laws: expected one of newton, .* given {text!r}"):
        method(text)


@pytest.mark.parametrize("text", ["", "10,,20", "0", "a", "-5", "1.5"])
def test_lists_of_numbers(text: str) -> None:
    assert Converge(elements=" 5, 10,20").elements == (5, 10, 20)  # type: ignore[arg-type]
    with pytest.raises(CaseError, match="elements: "):
        Converge(elements=text)  # type: ignore[arg-type]


def test_levels_of_a_refinement() -> None:
    on = refinement(
        laws="newton/lumped,newton@moreau-jean",
        meshes=(10, 20),
        steps=(500, 1000),
        limit_steps=4000,
    )
    levels = on.levels()
    assert len(levels) == len({level.key for level in levels}) == 3 * 4 + 2
    assert [level.method for level in levels[:4]] == ["none"] * 4
    assert {level.steps for level in levels if level.method == LIMIT.name} == {4000}
    assert all(level.case.n_periods == 2 * level.periods == 8 for level in levels)
    by_key = {level.key: level.case for level in levels}
    literal = by_key["newton@newmark/lumped 20 500"]
    assert (literal.contact.law, literal.contact.impulse) == ("newton", "lumped")
    assert (literal.mesh.elements, literal.time.steps_per_period) == (20, 500)
    assert by_key["newton@moreau-jean 20 500"].time.scheme == "moreau-jean"


def test_few_periods_are_enough_with_many_steps() -> None:
    on = refinement(periods=100, steps=(1000,), limit_steps=64000)
    assert [level.periods for level in on.levels()] == [100, 100, 10]
    assert [level.case.n_periods for level in on.levels()] == [130, 130, 40]


def test_meshes_may_have_contact_points_inside_their_elements() -> None:
    meshes = tuple(PointMesh(10, p) for p in (1, 2, 4))
    study = refinement(meshes=meshes, limit_steps=2000)
    assert study.refines == "points" and refinement().refines == "elements"
    clapping = study.along_meshes(study.methods[0], 1000)
    assert [level.points for level in clapping] == [10, 20, 40]
    assert [level.case.contact.points_per_element for level in clapping] == [1, 2, 4]
    assert {level.elements for level in clapping} == {10}
    assert clapping[2].key == "newton@moreau-jean 10x4 1000"
    assert clapping[2].mesh_text == "10 elements with 4 points each"
    free = [level for level in study.levels() if level.method == FREE.name]
    assert [level.key for level in free] == ["none 10 1000"]  # points make no difference
    assert study.identity == refinement(meshes=meshes[:2]).identity
    with pytest.raises(CaseError, match="points: "):
        refinement(meshes=meshes[::-1])


def test_mesh_files() -> None:
    on = refinement(meshes=(10, MESH_FILE))
    level = on.levels()[1]
    assert level.elements == 20
    uniform = on.level(FREE, 20, 1000)
    amplitudes = [
        compute(entry, "compiled").statistics["amplitude_1"][0] for entry in (level, uniform)
    ]
    assert amplitudes[0] == pytest.approx(amplitudes[1], rel=1e-9)


def test_identity_ignores_sizes_and_methods_alone() -> None:
    assert refinement().identity == refinement(laws="newton", meshes=(20,), steps=(500,)).identity
    assert refinement().identity != refinement(periods=5).identity
    assert refinement().identity != refinement(preset("default")).identity


def test_order_in_time_without_contact() -> None:
    on = refinement(DECAYING, meshes=(40,), steps=(250, 500, 1000))
    levels = on.along_steps(FREE, 40)
    convergence = computed(levels, on)
    errors = np.array([convergence.free_errors(level) for level in levels])
    for column in errors.T:
        orders = orders_of_errors([1.0 / level.steps for level in levels], column)
        assert orders == pytest.approx(2.0, abs=ORDER_IN_TIME)
    assert np.abs(errors[-1]).max() < 1e-4


def test_order_in_space_without_contact() -> None:
    on = refinement(DECAYING, meshes=(2, 4, 8), steps=(16000,))
    levels = on.along_meshes(FREE, 16000)
    convergence = computed(levels, on)
    errors = np.array([convergence.free_errors(level) for level in levels])
    for column in errors.T[[0, 2]]:
        orders = orders_of_errors([1.0 / level.elements for level in levels], column)
        assert orders == pytest.approx(4.0, abs=ORDER_IN_SPACE)
    assert np.abs(errors[-1]).max() < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("law", ["newton", "newton@moreau-jean:8"])
def test_engines_agree_before_they_scatter(law: str) -> None:
    gentle = CASE.with_overrides({"excitation.frequency": 1.25})
    on = refinement(gentle, laws=law, meshes=(5,), steps=(500,), periods=2)
    first, second = (
        compute(on.levels()[-1], engine).statistics for engine in ("compiled", "petsc")
    )
    assert first["impacts"] == second["impacts"]
    for name in ("tip_min_1", "tip_max_2", "amplitude_2_2", "modal_impulse", "contact_work"):
        assert first[name][0] == pytest.approx(second[name][0], rel=ENGINES_AGREE)


@pytest.mark.parametrize(
    ("law", "steps", "expected"),
    [
        ("newton@moreau-jean", 1000, -21.9),
        ("newton@moreau-jean", 4000, -20.3),
        ("newton@moreau-jean", 16000, -20.1),
        ("newton@moreau-jean", 64000, -19.8),
        ("newton-penalty", 1000, -22.7),
        ("newton-penalty", 4000, -21.5),
        ("newton-penalty", 16000, -20.5),
        ("newton-penalty", 64000, -21.4),
    ],
)
def test_what_converges_to_what(law: str, steps: int, expected: float) -> None:
    """Smallest y1 in mm of trials with independent code; no impact may add energy."""
    on = refinement(laws=law, meshes=(20,), steps=(steps,), periods=20)
    level = on.levels()[-1]
    convergence = computed([level], on)
    tolerance = SPECIFIED if steps >= 4000 else SPECIFIED_COARSE
    assert 1e3 * convergence.value(level, "tip_min_1") == pytest.approx(expected, rel=tolerance)
    assert convergence.value(level, "energy_residual") < 1e-9
    assert 0.0 < convergence.value(level, "contact_work") < 3e-3


def test_a_level_that_fails_says_why() -> None:
    level = refinement(laws="newton@central-difference").levels()[-1]
    result = compute(level, "compiled")
    assert result.outcome == "failed"
    assert "the scheme needs a time step of at most" in result.error
    assert not result.statistics


def test_a_level_that_diverges_says_when() -> None:
    """The literal scheme with mass damping, from T/1000 on."""
    wild = CASE.with_overrides({"damping.rayleigh": "mass"})
    on = refinement(wild, laws="newton/lumped", meshes=(20,), periods=150)
    result = compute(on.levels()[-1], "compiled")
    assert result.outcome == "diverged"
    assert result.error == f"diverged in period {result.periods}"
    assert 50 < result.periods < 300


def test_a_free_level_that_diverges_has_no_numbers() -> None:
    """A base that moves by a metre moves the tips beyond ten lengths."""
    case = CASE.with_overrides({"excitation.amplitude": 1.0})
    result = compute(refinement(case, steps=(100,)).level(FREE, 10, 100), "compiled")
    assert (result.outcome, result.statistics) == ("diverged", {})
    assert result.error == f"diverged in period {result.periods}"


def test_free_vibrations_that_diverge_give_no_frequency(monkeypatch: pytest.MonkeyPatch) -> None:
    """A motion that begins beyond the limit of a run is none."""
    lengths = {f"lamina.{name}.length": 0.05 for name in ("thick", "thin")}
    case = CASE.with_overrides({**lengths, "excitation.frequency": 300.0})
    on = refinement(case, steps=(100,))
    monkeypatch.setattr(level_module, "RING_SHARE", 10.0)
    result = compute(on.level(FREE, 10, 100), "compiled")
    assert (result.outcome, result.statistics) == ("failed", {})
    assert "free vibrations diverged in period 1" in result.error


def test_weight_changes_neither_frequencies_nor_amplitudes_of_level_beams() -> None:
    """Linear beams vibrate about the shape that their weight gives them."""
    of_case = {}
    for name, keys in {"without": {}, "with": {"gravity.acceleration": 9.81}}.items():
        case = DECAYING.with_overrides(keys)
        of_case[name] = compute(refinement(case, steps=(200,)).level(FREE, 10, 200), "compiled")
        assert of_case[name].error == ""
    for name, value in of_case["without"].statistics.items():
        assert of_case["with"].statistics[name] == pytest.approx(value, rel=1e-6), name


def test_levels_say_how_many_steps_their_blows_have() -> None:
    """A blow on a spring lasts π √(m/k), whatever the steps are."""
    case = preset("paper", {"contact.penalty_stiffness": 1e4})
    on = refinement(case, laws="penalty@newmark,newton@moreau-jean", steps=(200, 400), meshes=(4,))
    convergence = computed([level for level in on.levels() if level.method != FREE.name], on)
    elastic, rigid = (on.along_steps(law, 4) for law in on.methods)
    counts = [convergence.value(level, "blow_steps") for level in elastic]
    assert counts[1] == pytest.approx(2.0 * counts[0], rel=1e-12)
    assert counts[0] < 10.0 and all(
        np.isnan(convergence.value(level, "blow_steps")) for level in rigid
    )
    (warning,) = [text for text in convergence.report.remarks if "blow" in text]
    assert f"At {sum(count < 10.0 for count in counts)} of 4 levels" in warning
    assert "penalty@newmark, 4 elements, 200 steps per period" in warning
    text = page(convergence, "")
    assert warning in text and text.count("steps in a blow") == 2


@pytest.mark.parametrize("name", ["rod", "sdnd102"])
def test_elastic_stops_are_refined_by_their_springs(name: str) -> None:
    """By the law of the case, without a rigid limit; the extremes converge at order 2."""
    case = load_case(OTHERS / f"{name}.toml").with_overrides({"output.fields_per_period": 0})
    methods = usual_methods(case)
    assert [entry.name for entry in methods] == ["penalty@newmark"]
    study = RefinementStudy(case, methods, (case.mesh.elements,), (100, 200, 1600), periods=5)
    assert not study.has_limit
    results = computed(study.levels(), study).results.values()
    values = [
        result.statistics["tip_max_1"][0] for result in results if "tip_max_1" in result.statistics
    ]
    errors = np.abs(np.array(values[:-1]) / values[-1] - 1.0)
    assert errors[1] < 0.35 * errors[0] < 0.1
    with pytest.raises(CaseError, match=r"stop\.1\.stiffness: "):
        RefinementStudy(
            case, (method("newton@moreau-jean"),), (case.mesh.elements,), (100,)
        ).levels()


def test_explicit_springs_and_massless_points_keep_their_methods() -> None:
    explicit = load_case(OTHERS / "rod.toml").with_overrides({"time.scheme": "central-difference"})
    assert [entry.name for entry in usual_methods(explicit)] == ["penalty@central-difference"]
    assert [entry.name for entry in usual_methods(CASE)] == list(METHODS)


def test_the_frequency_of_a_point_is_exact() -> None:
    """It has one element, which is not refined."""
    mass = load_case(OTHERS / "sdnd102.toml")
    assert first_frequencies(mass) == pytest.approx([np.sqrt(98696.0 / 25.0)], rel=1e-9)


def test_frequency_of_a_sampled_cosine() -> None:
    t = np.linspace(0.0, 4.0, 900)
    omega = 2.0 * np.pi * 1.4357
    u = 0.3 * np.cos(omega * t) - 0.1 * np.sin(omega * t)
    assert fitted_frequency(t, u, 1.003 * omega) == pytest.approx(omega, rel=1e-13)
