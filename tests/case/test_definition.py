"""Cases are read back from their files; what contradicts itself is refused."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import pytest

from delam_fem.api import Case, CaseError, preset

Overrides = dict[str, Any]

SWEEP: Overrides = {
    "excitation.kind": "sweep", "excitation.start_frequency": 4.0, "excitation.end_frequency": 0.5,
    "excitation.duration": 10.1,
}  # fmt: skip
HAMMER: Overrides = {
    "excitation": {"kind": "hammer", "lamina": "thin", "position": 0.5, "amplitude": 30.0,
                   "duration": 0.004, "start": 0.01},
    "time.step": 1e-4, "time.duration": 0.1003, "output": {},
}  # fmt: skip
POINT: Overrides = {
    "lamina": [{"name": name, "mass": mass, "stiffness": stiffness, "damping_ratio": 0.02}
               for name, mass, stiffness in (("low", 2.0, 800.0), ("up", 0.5, 450.0))],
    "mesh.elements": 1, "gap": {"tip": 0.01},
}  # fmt: skip
BAR: Overrides = {"lamina.thick.motion": "axial", "lamina.thin.motion": "axial"}
RIGID: Overrides = {"contact": {"law": "newton", "restitution": 0.0}, "time.mass": "massless"}
STOPS: list[Overrides] = [
    {"lamina": "thin", "side": "above", "gap": 0.002, "position": 0.3},
    {"lamina": "thick", "side": "both", "gap": 0.001, "start": 0.1, "end": 0.2},
]
IMPACTOR: Overrides = {"lamina": "thin", "mass": 0.01, "gap": 0.003, "velocity": 0.5}
ELASTIC: Overrides = {"contact": {"law": "penalty", "penalty_stiffness": 4e4,
                                  "penalty_damping": 8.0}}  # fmt: skip
SENSORS: list[Overrides] = [
    {"name": "a", "quantity": "acceleration", "lamina": "thin", "position": 0.2,
     "sampling_rate": 500.0, "seed": 3},
    {"name": "b", "quantity": "contact force", "between": ["thick", "thin"], "noise": "2 mN"},
    {"name": "c", "quantity": "strain", "lamina": "thick", "position": 0.1, "surface": "bottom"},
    {"name": "d", "quantity": "contact force", "stop": 2},
    {"name": "e", "quantity": "contact force", "impactor": 1},
]  # fmt: skip
CASES: dict[str, tuple[str, Overrides]] = {
    "paper": ("paper", {}), "default": ("default", {}), "embedded": ("embedded", {}),
    "edge": ("edge", {}),
    "sweep": ("paper", {**SWEEP, "output": {}}),
    "sweep with a window": ("paper", {**SWEEP, "output": {"window_periods": 7,
                                                         "fields_per_period": 3}}),
    "slow logarithmic sweep": ("paper", {**SWEEP, "excitation.duration": 900.0, "output": {},
                                         "excitation.spacing": "logarithmic"}),
    "acceleration": ("paper", {"excitation.acceleration": 1.25, "damping.rayleigh": "stiffness"}),
    "force": ("paper", {"excitation": {"kind": "force", "lamina": "thick", "position": 0.3,
                                       "amplitude": 0.25, "frequency": 2.5}}),
    "hammer": ("paper", HAMMER),
    "blow and a coarse step": ("paper", {**HAMMER, "time.step": 0.04, "time.duration": 0.06}),
    "settled": ("paper", {"time.periods": "settled", "time.most_periods": 77,
                          "time.scheme": "moreau-jean", "contact.law": "newton"}),
    "most periods of no use": ("paper", {"time.most_periods": 77, "contact.law": "none",
                                         "contact.restitution": 0.3}),
    "few periods": ("paper", {"time.periods": 3, "time.steps_per_period": 40,
                              "output.fields_per_period": 40}),
    "mass": ("paper", {"damping.rayleigh": "mass", "lamina.thin.bending_stiffness": None}),
    "stops": ("paper", {"stop": STOPS, "impactor": [IMPACTOR], "sensor": SENSORS,
                        "initial": [{"shape": "mode", "mode": 2, "velocity": -0.1}]}),
    "elastic stop": ("paper", {**ELASTIC, "stop": [{**STOPS[0], "stiffness": 1e3,
                                                    "damping": 0.2}]}),
    "ball": ("paper", {**ELASTIC, "contact.penalty_damping": 0.0,
                       "impactor": [{**IMPACTOR, "radius": 0.01, "spring": 20.0}]}),
    "single lamina": ("paper", {"lamina": [preset("paper").lamina[1].model_dump(
        exclude_none=True)], "gap": None, "contact": {"law": "penalty"}, "stop": [
        {**STOPS[0], "stiffness": 1e3, "damping": 0.2}], "impactor": [
        {**IMPACTOR, "stiffness": 2e3, "damping": 0.4}]}),
    "points": ("paper", POINT), "free point": ("paper", {**POINT, "lamina.up.stiffness": 0.0}),
    "bars": ("paper", {**BAR, "damping.rayleigh": "every mode"}),
    "massless": ("paper", {**RIGID, "time.refine_velocity": 0.1}),
    "massless modes": ("paper", {**RIGID, "model": {"kind": "modes", "modes": 7}}),
    "plane stress": ("embedded", {"model": {"kind": "plane-stress", "strips": 3, "layers": 2}}),
    "solid": ("edge", {"model": {"kind": "solid", "poisson": 0.3}, "mesh.elements": 30}),
    "pinned": ("embedded", {"support": {"start": "pinned", "end": "pinned"}}),
    "floating": ("embedded", {"support": {"start": "free", "end": "free"}}),
    "one pin": ("embedded", {"support": {"start": "free", "end": "pinned"}}),
    "inner pin": ("embedded", {"support": [{"start": "free"},
                                           {"position": 0.1, "kind": "pinned"}]}),
    "inner springs": ("embedded", {"support": [
        {"start": "free"}, {"position": 0.1, "kind": "spring", "stiffness": 0.0},
        {"position": 0.2, "kind": "spring", "stiffness": 3e3, "damping": 2.0}]}),
    "turning spring": ("embedded", {"support": [{"start": "free"}, {
        "position": 0.1, "kind": "spring", "stiffness": 3e3, "rotational_stiffness": 4.0}]}),
    "clamped inside": ("embedded", {"support": [{"start": "free"},
                                                {"position": 0.1, "kind": "clamped"}]}),
    "soft clamps": ("embedded", {"support": {"start": "clamped", "end": "clamped",
                                             "rotational_stiffness": 55.0}}),
    "open everywhere": ("embedded", {"delamination": [
        {"between": ["lower", "upper"], "start": 0.0, "end": 0.4}]}),
    "without delamination": ("embedded", {"delamination": [], "support": {"end": "pinned"}}),
}  # fmt: skip


def case_of(name: str, overrides: Overrides) -> Case:
    """Return a preset with overrides, whose tables are not changed."""
    return preset(name, deepcopy(overrides))


@pytest.mark.parametrize("name", CASES)
def test_a_case_is_read_back_from_its_file(name: str) -> None:
    preset_name, overrides = CASES[name]
    case = case_of(preset_name, overrides)
    assert Case.from_toml(case.to_toml()) == case


BLOW = HAMMER["excitation"]
SAME = {"start": 0.1, "end": 0.2, "between": ["lower", "upper"]}
REFUSED: list[tuple[str, Overrides]] = [
    ("paper", keys) for keys in (
        {"stop": [STOPS[0], {**STOPS[0], "side": "both"}]},
        {"stop": [STOPS[1], {**STOPS[1], "start": 0.2, "end": 0.3}]},
        {"stop": [STOPS[1], {"lamina": "thick", "side": "below", "gap": 0.0, "position": 0.1}]},
        {"stop": [{**STOPS[0], "lamina": "top"}]}, {"stop": [{**STOPS[0], "position": 0.6851}]},
        {"stop": [{**STOPS[1], "end": 0.7}]}, {"stop": [{**STOPS[1], "start": 0.2}]},
        {"stop": [{**STOPS[0], "end": 0.4}]}, {"stop": [{**STOPS[0], "start": 0.1, "end": 0.4}]},
        {"stop": [{**STOPS[0], "opening": 0.1}]}, {"stop": [{**STOPS[0], "damping": 0.1}]},
        {"stop": [{**STOPS[0], "shape": "power"}]}, {"stop": [{**STOPS[1], "exponent": 2.0}]},
        {"stop": [{**STOPS[0], "stiffness": 1e3}], "contact.law": "newton@moreau-jean"},
        {**ELASTIC, "contact.penalty_stiffness": 0.0, "stop": [{**STOPS[0], "stiffness": 1e3}]},
        {"impactor": [{**IMPACTOR, "radius": 0.1}], "contact.law": "newton@moreau-jean"},
        {"impactor": [{**IMPACTOR, "radius": 0.1, "stiffness": 1.0}]},
        {"impactor": [{**IMPACTOR, "radius": 0.1, "velocity": 0.0}]},
        {"impactor": [{**IMPACTOR, "damping": 0.1}]}, {"impactor": [{**IMPACTOR, "position": 1}]},
        {"point_mass": [{"lamina": "thin", "mass": 0.1, "position": 0.7}]},
        {"initial": [{"shape": "force", "position": 0.7, "lamina": "thin"}]},
        {"initial": [{"shape": "force", "lamina": "thin"}]}, {"initial": [{"position": 0.1}]},
        {"initial": [{"shape": "force", "position": 0.1}]}, {"initial": [{"mode": 2}]},
        {"sensor": [SENSORS[0], SENSORS[0]]}, {"sensor": [{**SENSORS[0], "position": 0.7}]},
        {"sensor": [{**SENSORS[0], "sampling_rate": 3250.1}]}, {"sensor": [SENSORS[3]]},
        {"sensor": [SENSORS[4]]}, {"sensor": [{**SENSORS[1], "between": ["thin", "thick"]}]},
        {"sensor": [{**SENSORS[1], "lamina": "thin"}]}, {"sensor": [{**SENSORS[1], "stop": 1}]},
        {"sensor": [{"name": "b", "quantity": "contact force"}]},
        {"sensor": [{**SENSORS[0], "stop": 1}]}, {"sensor": [{**SENSORS[0], "position": None}]},
        {"sensor": [{**SENSORS[0], "surface": "top"}]},
        {"sensor": [{**SENSORS[1], "noise": "2 mm"}]}, {"sensor": [{**SENSORS[0], "noise": "1 N"}]},
        {"time.step": 0.001}, {"time.duration": 2.0}, {"time.refine": 4097},
        {**SWEEP, "time.step": 0.001, "time.steps_per_period": 10},
        {**SWEEP, "time.duration": 3.0, "time.periods": 10}, {**SWEEP, "time.periods": "settled"},
        {**HAMMER, "time.step": None}, {**HAMMER, "time.duration": None},
        {**HAMMER, "excitation": {**BLOW, "start": 0.097}},
        {**HAMMER, "excitation": {**BLOW, "start": 0.0}, "output": {"window_periods": 50}},
        {**HAMMER, "excitation": {**BLOW, "position": 0.7}},
        {**HAMMER, "excitation": {**BLOW, "lamina": "top"}},
        {"excitation.frequency": None}, {"excitation.amplitude": None},
        {"excitation": {"kind": "harmonic", "frequency": 1.0, "amplitude": 1.0,
                        "acceleration": 1.0}},
        {"excitation": {"kind": "force", "lamina": "thin", "position": 0.1, "amplitude": 1.0}},
        {"excitation": {"kind": "force", "lamina": "thin", "position": 0.1, "amplitude": 1.0,
                        "frequency": 1.0, "end_frequency": 2.0}},
        {"excitation": {"kind": "force", "lamina": "thin", "position": 0.1, "amplitude": 1.0,
                        "start_frequency": 1.0, "end_frequency": 2.0}},
        {"excitation": {"kind": "table", "file": "a.csv", "acts_on": "base", "lamina": "thin"}},
        {"excitation": {"kind": "table", "file": "a.csv", "acts_on": "force", "lamina": "thin"}},
        {"model": {"kind": "modes"}}, {"time.mass": "massless"},
        {**RIGID, "model": {"kind": "solid"}}, {**RIGID, "contact.points_per_element": 2},
        {**RIGID, "contact.restitution": 0.1},
        {**RIGID, "impactor": [IMPACTOR]}, {**RIGID, **BAR},
        {"model": {"kind": "beam", "file": "a.nc"}}, {"model": {"kind": "modes", "file": "a.nc",
         "modes": 3}},
        {"contact.points_per_element": 2}, {"contact.law": "penalty@moreau-jean"},
        {"contact.law": "newton@moreau-jean", "time.scheme": "newmark"},
        {"output.fields_per_period": 1001}, {**BAR, "lamina.thin.motion": "lateral"},
        {"damping.rayleigh": "every mode"}, {**POINT, "mesh.elements": 2},
        {**POINT, "contact.points_per_element": 2}, {**POINT, "model.kind": "solid"},
        {**POINT, "lamina.up.stiffness": None}, {**POINT, "lamina.up.mass": None},
        {**BAR, "model.kind": "plane-stress"}, {**BAR, "contact.points_per_element": 2,
         "contact.impulse": "consistent"}, {**BAR, "sensor": SENSORS[2:3]},
        {"lamina.thin.length": 0.6851, "support.end": "pinned"}, {"gap": None},
        {"delamination": [{**SAME, "between": ["thick", "thin"]}]},
        {"lamina.thin.material": "gold"}, {"gap": {"tip": 0.01, "file": "a.csv"}},
        {"gap": {"root": 0.01, "file": "a.csv"}}, {"gap": {"root": 0.01}},
        {"mesh": {"elements": 3, "file": "a.msh"}}, {"mesh": {}},
        {"lamina.thin.mass_per_length": -0.1, "lamina.thin.density": None},
        {"lamina": [{**preset("paper").lamina[0].model_dump(exclude_none=True),
                     "mass_per_length": 1.0}]},
        {"lamina": [preset("paper").lamina[0].model_dump(exclude_none=True)]},
    )
] + [
    ("embedded", keys) for keys in (
        {"delamination": [{**SAME, "start": 0.2}]}, {"delamination": [{**SAME, "end": 0.4001}]},
        {"delamination": [SAME, {**SAME, "start": 0.2, "end": 0.3}]},
        {"delamination": [{**SAME, "start": 0.3, "end": 0.35}, {**SAME, "end": 0.3}]},
        {"delamination": [{**SAME, "shape": "power"}]}, {"delamination": [{**SAME, "exponent": 2}]},
        {"delamination": [{**SAME, "file": "a.csv", "opening": 0.1}]},
        {"delamination": [{**SAME, "file": "a.csv", "shape": "power"}]},
        {"delamination": [{**SAME, "between": ["upper", "lower"]}]},
        {"delamination": [{**SAME, "start": 0.0, "end": 0.4, "shape": "power"}],
         "support": {"start": "free", "end": "free"}},
        {"support": [{"start": "free"}, {"end": "free"}]},
        {"support": [{"position": 0.4, "kind": "pinned"}]},
        {"support": [{"position": 0.41, "kind": "pinned"}]},
        {"support": [{"position": 0.1, "kind": "pinned"}, {"position": 0.1, "kind": "pinned"}]},
        {"support": [{"position": 0.1, "kind": "pinned", "lamina": "top"}]},
        {"support": [{"position": 0.1, "kind": "spring"}]},
        {"support": [{"position": 0.1, "kind": "pinned", "stiffness": 1.0}]},
        {"support": [{"position": 0.1, "kind": "pinned", "damping": 1.0}]},
        {"support": [{"position": 0.1, "kind": "clamped", "rotational_stiffness": 1.0}]},
        {"support": {"start": "pinned", "end": "free", "rotational_stiffness": 1.0}},
        {"support": {"rotational_stiffness": 1.0}, "model.kind": "plane-stress"},
        {**RIGID, "support": {"start": "free", "end": "pinned"}}, {"gap": {"tip": 0.01}},
    )
]  # fmt: skip


@pytest.mark.parametrize(("name", "overrides"), REFUSED)
def test_what_contradicts_itself_is_refused_with_its_key(name: str, overrides: Overrides) -> None:
    """Which of the keys that contradict each other is named is free; one of them is."""
    with pytest.raises(CaseError) as raised:
        case_of(name, overrides)
    assert any(word in str(raised.value) for word in words_of(overrides))


def words_of(value: Any) -> set[str]:
    """Return the names of all keys and tables in overrides."""
    if isinstance(value, dict):
        names = {name for key in value for name in str(key).split(".")}
        return names.union(*map(words_of, value.values()))
    return set().union(*map(words_of, value)) if isinstance(value, list) else set()


MARGIN = 1e-9 * 0.685
TAKEN: list[tuple[str, Overrides]] = [
    ("paper", {"stop": [STOPS[0], {**STOPS[0], "side": "below"}]}),
    ("paper", {"stop": [STOPS[0], {**STOPS[0], "lamina": "thick"}]}),
    ("paper", {"stop": [STOPS[1], {**STOPS[1], "start": 0.2 + 2.0 * MARGIN, "end": 0.3}]}),
    ("paper", {"stop": [STOPS[1], {**STOPS[1], "start": 0.05, "end": 0.1 - 2.0 * MARGIN}]}),
    ("paper", {**ELASTIC, "stop": [{**STOPS[0], "stiffness": 1e3, "damping": 0.2},
                                   {**STOPS[0], "stiffness": 1e4, "damping": 2.0}]}),
    ("paper", {"stop": [{**STOPS[0], "stiffness": 1e3, "damping": 0.3}]}),
    ("paper", {"impactor": [{**IMPACTOR, "radius": 0.1}]}),
    ("paper", {"stop": [{**STOPS[0], "position": 0.685 * (1.0 + 0.9e-9)}]}),
    ("paper", {"point_mass": [{"lamina": "thin", "mass": 0.1, "position": 0.685}]}),
    ("paper", {"sensor": [{**SENSORS[0], "sampling_rate": 3250.0 * (1.0 + 0.9e-9)}]}),
    ("paper", {"output.fields_per_period": 1000}),
    ("paper", {**HAMMER, "excitation": {**BLOW, "start": 0.0}}),
    ("paper", {**RIGID, "contact.law": "none"}),
    ("paper", {**RIGID, "contact.points_per_element": 2, "model": {"kind": "modes"}}),
    ("paper", {**RIGID, "impactor": [{**IMPACTOR, "spring": 1.0}]}),
    ("paper", {"contact.points_per_element": 2, "contact.impulse": "consistent"}),
    ("paper", {"contact.points_per_element": 2, "contact.law": "penalty"}),
    ("embedded", {"delamination": [SAME, {**SAME, "start": 0.2001, "end": 0.4}]}),
    ("embedded", {"delamination": [{**SAME, "end": 0.4 * (1.0 + 0.9e-9), "shape": "power",
                                    "exponent": 3.0}], "support": {"end": "free"}}),
    ("embedded", {"support": {"start": "pinned", "end": "clamped", "rotational_stiffness": 1.0}}),
]  # fmt: skip


@pytest.mark.parametrize("number", range(len(TAKEN)))
def test_what_just_keeps_a_bound_is_taken(number: int) -> None:
    name, overrides = TAKEN[number]
    assert case_of(name, overrides).name == name


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("paper", {"stop": [{**STOPS[0], "position": 0.685 * (1.0 + 1.1e-9)}]}),
        ("paper", {"sensor": [{**SENSORS[0], "sampling_rate": 3250.0 * (1.0 + 1.1e-9)}]}),
        ("paper", {"point_mass": [{"lamina": "thin", "mass": 0.1, "position": 0.685 + 1e-15}]}),
        ("embedded", {"delamination": [{**SAME, "end": 0.4 * (1.0 + 1.1e-9)}]}),
        ("paper", {"stop": [STOPS[1], {**STOPS[1], "start": 0.2 + 0.9 * MARGIN, "end": 0.3}]}),
        ("paper", {"stop": [STOPS[1], {**STOPS[1], "start": 0.05, "end": 0.1 - 0.9 * MARGIN}]}),
    ],
)
def test_what_just_misses_a_bound_is_refused(name: str, overrides: Overrides) -> None:
    with pytest.raises(CaseError):
        case_of(name, overrides)


def test_words_are_completed_to_keys_of_the_case() -> None:
    case = preset("paper")
    assert case.with_overrides(frequency=3.65).excitation.top_frequency == 3.65
    for word, told in (
        ("length", 'length: say which: {"lamina.thick.length": …} or {"lamina.thin.length": …}'),
        ("frequenzy", "frequenzy: no key of case paper ends in it; did you mean frequency?"),
        ("zzz", 'zzz: no key of case paper ends in it; write {"section.key": …}'),
    ):
        with pytest.raises(CaseError) as error:
            case.with_overrides(**{word: 1.0})
        assert str(error.value) == told
    assert case._repr_html_() == f"<pre>{case.to_toml().replace(chr(34), '&quot;')}</pre>"
