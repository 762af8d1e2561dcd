"""Sweep files: what is accepted, what is refused with which words, and the grid they make."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from delam_fem import Sweep, load_sweep
from delam_fem.api import CaseError, preset
from delam_fem.studies.sweeps import grid
from delam_fem.studies.sweeps.grid import sweep_of

FREQUENCY = {"key": "excitation.frequency", "start": 3.0, "stop": 4.0, "count": 5}
RESTITUTION = {"key": "contact.restitution", "values": [0.0, 0.1, 0.3]}


def sweep(*axes: dict[str, object], **keys: object) -> Sweep:
    return sweep_of({"name": "s", "base": "paper", "axis": list(axes or (FREQUENCY,)), **keys})


def test_product_counts_the_last_axis_fastest() -> None:
    made = sweep(FREQUENCY, RESTITUTION)
    assert made.sizes == {"frequency": 5, "restitution": 3}
    assert made.overrides(4) == {"excitation.frequency": 3.25, "contact.restitution": 0.1}
    case = made.case(4)
    assert (case.excitation.frequency, case.contact.restitution) == (3.25, 0.1)
    assert made.tracks == ()


def test_zip_takes_values_together_along_the_first_axis() -> None:
    three = {**FREQUENCY, "count": 3}
    made = sweep(three, RESTITUTION, combine="zip")
    assert made.sizes == {"frequency": 3}
    assert made.overrides(2) == {"excitation.frequency": 4.0, "contact.restitution": 0.3}
    assert [d.along for d in made.dimensions] == ["frequency", "frequency"]


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        ("up", [[0, 2, 4], [1, 3, 5]]),
        ("down", [[4, 2, 0], [5, 3, 1]]),
        ("both", [[0, 2, 4], [1, 3, 5], [10, 8, 6], [11, 9, 7]]),
    ],
)
def test_tracks_follow_the_first_axis(order: str, expected: list[list[int]]) -> None:
    two = {"key": "contact.restitution", "values": [0.0, 0.1]}
    made = sweep({**FREQUENCY, "count": 3}, two, order=order)
    assert [track.tolist() for track in made.tracks] == expected


def test_a_table_over_x_replaces_a_number_of_the_base() -> None:
    upper = {"thickness": {"x": [0.0, 0.2, 0.4], "value": ["0.6 mm", "0.6 mm", "0.6 mm"]}}
    axis = {"key": "lamina.upper.thickness.value.2", "values": ["0.6 mm", "0.5 mm"]}
    made = sweep(axis, set={"lamina": {"upper": upper}}, base="edge")
    thickness = made.case(1).lamina[1].thickness
    assert not isinstance(thickness, float)
    assert tuple(thickness.x) == (0.0, 0.2, 0.4)
    assert tuple(thickness.value) == pytest.approx((6e-4, 5e-4, 6e-4), rel=1e-12)


def test_up_is_by_value_not_by_place() -> None:
    made = sweep({"key": "excitation.frequency", "values": [3.5, 3.0, 4.0]}, order="up")
    assert [track.tolist() for track in made.tracks] == [[1, 0, 2]]


def test_ranges_end_exactly_and_whole_ones_stay_whole() -> None:
    even = sweep({"key": "time.periods", "start": 10, "stop": 30, "count": 3})
    assert even.dimensions[0].values == (10, 20, 30)
    assert all(isinstance(value, int) for value in even.dimensions[0].values)
    log = {"key": "contact.penalty_stiffness", "start": 1.0, "stop": 1e4, "count": 5}
    values = sweep({**log, "spacing": "logarithmic"}).dimensions[0].values
    assert values == pytest.approx([1.0, 10.0, 100.0, 1e3, 1e4])
    assert values[-1] == 1e4


def test_names_and_units_of_coordinates() -> None:
    made = sweep(
        {"key": "lamina.thick.length", "values": [0.685]},
        {"key": "initial.thin.velocity", "values": [0.0, 0.1]},
        {**RESTITUTION, "name": "e"},
    )
    assert [(d.name, d.units) for d in made.dimensions] == [
        ("thick_length", "m"),
        ("thin_velocity", "m/s"),
        ("e", "1"),
    ]


def test_set_takes_nested_and_dotted_keys_and_the_command_line_has_the_last_word() -> None:
    data = {
        "name": "s",
        "base": "paper",
        "set": {"time": {"periods": 20}, "mesh.elements": 5},
        "axis": [FREQUENCY],
    }
    made = sweep_of(data, {"mesh.elements": 4})
    assert (made.base.time.periods, made.base.mesh.elements) == (20, 4)


def test_a_sweep_is_repeated_by_what_it_writes(tmp_path: Path) -> None:
    made = sweep(
        FREQUENCY, RESTITUTION, order="both", initial={"thin": {"velocity": 0.1}},
        record={"harmonics": 3, "summary": False},
    )  # fmt: skip
    (tmp_path / "case.toml").write_text(made.base.to_toml())
    (tmp_path / "sweep.toml").write_text(made.to_toml("case.toml"))
    again = load_sweep(tmp_path / "sweep.toml")
    assert again.identity == made.identity
    assert again.initial(0) == {"thin.velocity": 0.1}


def test_the_identity_tells_sweeps_apart() -> None:
    one = sweep(FREQUENCY)
    assert one.identity == sweep(FREQUENCY).identity
    assert one.identity != sweep({**FREQUENCY, "count": 6}).identity
    assert one.identity != sweep(FREQUENCY, set={"gap.tip": 0.011}).identity


AXIS = "axis.1"
REFUSED = [
    ({"axis": []}, r"axis: expected at least one \[\[axis\]\]"),
    ({"axs": 1}, "axs: unknown key; did you mean axis"),
    ({"order": "upwards"}, "order: expected 'independent', 'up', 'down' or 'both', given 'upw"),
    ({"axis": [{"key": "a.b", "start": 1}]}, f"{AXIS}: expected start, stop and count, or values"),
    ({"axis": [{"key": "frequency", "values": [1]}]}, f"{AXIS}.key: expected a key such as gap"),
    ({"axis": [{**RESTITUTION, "count": 3}]}, f"{AXIS}.values: expected no start, stop"),
    ({"axis": [{"key": "a.b", "values": [1, "x"]}]}, "only numbers or only words, given both"),
    ({"axis": [{"key": "a.b", "values": [True]}]}, "expected a list of at least one number"),
    (
        {"axis": [{**FREQUENCY, "start": 0.0, "spacing": "logarithmic"}]},
        f'{AXIS}.spacing: expected "linear", or start and stop above 0, given 0.0',
    ),
    ({"axis": [FREQUENCY, FREQUENCY]}, "expected different keys, given excitation.frequency twice"),
    ({"axis": [FREQUENCY, RESTITUTION], "combine": "zip"}, r'one length with "zip", given \[5, 3'),
    (
        {"axis": [{"key": "contact.law", "values": ["none"]}], "order": "up"},
        'order: expected "independent", as contact.law of the first axis has no order',
    ),
    (
        {"axis": [{"key": "mesh.elements", "values": [4, 5]}], "order": "up"},
        "a state cannot be carried along mesh.elements",
    ),
    ({"axis": [{"key": "excitation.frequenzy", "values": [1]}]}, "did you mean frequency"),
    (
        {"axis": [{"key": "contact.restitution", "values": [0.1, 1.5]}]},
        "contact.restitution: expected a number from 0 to 1, given 1.5",
    ),
    ({"axis": [{"key": "initial.thick.speed", "values": [1]}]}, "expected one of initial.thick.di"),
    ({"initial": {"thick": {"velocity": "x"}}}, "initial.thick.velocity: expected a number, given"),
    ({"axis": [{**FREQUENCY, "name": "lamina"}]}, "the name lamina is taken"),
    ({"record": {"strobes": -1}}, "record.strobes: expected a whole number of at least 0"),
    (
        {"record": {"node_distortion": True}, "set": {"output.fields_per_period": 30}},
        "expected output.fields_per_period of at least 4 that divides .* = 1000, given 30",
    ),
    (
        {"record": {"node_distortion": True}, "axis": [{"key": "mesh.elements", "values": [4, 5]}]},
        "expected one mesh for all points, given the axis mesh.elements",
    ),
    ({"base": "papper"}, "base 'papper': neither a preset"),
]  # fmt: skip


@pytest.mark.parametrize(("keys", "words"), REFUSED)
def test_refused_with_the_key_and_a_remedy(keys: dict[str, object], words: str) -> None:
    with pytest.raises(CaseError, match=words):
        sweep_of({"name": "s", "base": "paper", "axis": [FREQUENCY]} | keys)


def test_continuation_needs_a_harmonic_base_motion() -> None:
    swept = {
        "excitation.kind": "sweep",
        "excitation.start_frequency": 1.0,
        "excitation.end_frequency": 2.0,
        "excitation.duration": 10.0,
    }
    with pytest.raises(CaseError, match="order: "):
        sweep(RESTITUTION, order="up", set=swept)


def test_an_axis_is_not_overridden() -> None:
    data = {"name": "s", "base": "paper", "axis": [FREQUENCY]}
    with pytest.raises(CaseError, match=r"override excitation\.frequency: is an axis of sweep s"):
        sweep_of(data, {"excitation.frequency": 3.0})


def test_a_missing_file_is_named() -> None:
    with pytest.raises(CaseError, match=r"missing\.toml: no such file"):
        load_sweep("missing.toml")


def test_the_base_is_sought_beside_the_sweep(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text(sweep().base.to_toml())
    text = 'base = "case.toml"\n[[axis]]\nkey = "gap.tip"\nvalues = [0.01]\n'
    (tmp_path / "gaps.toml").write_text(text)
    made = load_sweep(tmp_path / "gaps.toml")
    assert made.file.name == "gaps"
    assert made.case(0).gap.tip == 0.01
    assert np.prod(list(made.sizes.values())) == made.n_points == 1


EXAMPLES = sorted((Path(__file__).parents[3] / "docs" / "examples").glob("*.toml"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_examples_of_the_documentation_are_sweeps(path: Path) -> None:
    made = load_sweep(path)
    assert made.n_points > 100
    kind = {"plane": 2, "basins": 2}.get(path.stem, 1)
    assert len(made.dimensions) == kind


def test_an_axis_of_laws_names_each_with_its_scheme() -> None:
    law: dict[str, object] = {
        "key": "contact.law",
        "values": ["newton-penalty@newmark", "newton@moreau-jean", "none@moreau-jean"],
    }
    made = sweep(law)
    pairs = [(case.contact.law, case.time.scheme) for case in map(made.case, range(3))]
    assert pairs == [
        ("newton-penalty", "newmark"),
        ("newton", "moreau-jean"),
        ("none", "moreau-jean"),
    ]
    assert made.dimensions[0].values == tuple(law["values"])  # type: ignore[arg-type]
    assert made.case(1).unread == (
        "contact.impulse",
        "contact.penalty_stiffness",
    )  # of the base; given, not refused
    with pytest.raises(CaseError, match='the law "penalty" goes with the scheme "newmark"'):
        sweep({"key": "contact.law", "values": ["none", "penalty@moreau-jean"]})


def test_values_of_axes_may_carry_units() -> None:
    tones = {"key": "excitation.frequency", "start": "3000 mHz", "stop": "0.004 kHz", "count": 3}
    sweep = sweep_of(
        {
            "name": "s",
            "base": "paper",
            "axis": [tones, {"key": "gap.tip", "values": ["1 mm", 0.002, "0.3 cm"]}],
        }
    )
    assert sweep.dimensions[0].values == (3.0, 3.5, 4.0)
    assert sweep.dimensions[1].values == (0.001, 0.002, 0.003)
    assert "mm" not in sweep.to_toml("paper")


@pytest.mark.parametrize(
    ("key", "value", "number"),
    [
        ("stop.1.gap", "0.5 mm", 5e-4),
        ("impactor.1.spring", "2 N/cm", 200.0),
        ("support.1.rotational_stiffness", "3 N cm", 0.03),
        ("excitation.start", "5 ms", 5e-3),
        ("delamination.1.start", "5 mm", 5e-3),
        ("excitation.amplitude", "2 mm", 2e-3),
        ("excitation.amplitude", "2 kN", 2000.0),
        ("contact.penalty_stiffness", "1 N/mm", 1000.0),
    ],
)
def test_each_key_has_its_own_unit(key: str, value: str, number: float) -> None:
    assert grid.Axis.model_validate({"key": key, "values": [value]}).values == (number,)


def test_the_unit_of_a_key_is_that_of_its_excitation() -> None:
    assert grid.units_of("excitation.amplitude") == ["m", "N"]
    assert grid.units_of("excitation.amplitude", "hammer") == ["N"]
    assert grid.units_of("excitation.start", "hammer") == ["s"]
    assert grid.unit_of("excitation.amplitude", preset("paper")) == "m"
    assert grid.unit_of("stop.1.gap", preset("paper")) == "m"
    assert grid.unit_of("contact.restitution", preset("paper")) == "1"


@pytest.mark.parametrize("value", ["5 mm", "5 Hzz", "5 rpm"])
def test_a_unit_that_does_not_fit_is_refused(value: str) -> None:
    axis = {"key": "excitation.frequency", "values": [value]}
    with pytest.raises(
        CaseError, match=r"^sweep s: axis\.1\.values: expected a frequency .*, given '5 "
    ):
        sweep_of({"name": "s", "base": "paper", "axis": [axis]})
