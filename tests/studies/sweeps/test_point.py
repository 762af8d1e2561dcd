"""Cases share a model exactly if nothing differs that enters the assembly."""

from typing import Any

import numpy as np
import pytest

import delam_fem as df
from delam_fem import Sweep
from delam_fem.api import Case, CaseError, Section, preset
from delam_fem.studies.sweeps.grid import sweep_of
from delam_fem.studies.sweeps.point import PointRunner, _may_assemble, assembly_key, quantities

SMALL = {"mesh.elements": 3}
SHARED: list[dict[str, object]] = [
    {"name": "another"},
    {"excitation.frequency": 2.0, "excitation.amplitude": 0.001},
    {"contact.law": "penalty", "contact.penalty_stiffness": 7.0, "contact.penalty_damping": 1.0},
    {"contact.law": "newton", "contact.restitution": 0.5, "contact.impulse": "consistent"},
    {"time.steps_per_period": 77, "time.periods": 3, "output.fields_per_period": 0},
    {"time.periods": "settled", "time.most_periods": 7},
    {"time.scheme": "central-difference", "output.window_periods": 2},
]
OWN: list[dict[str, object]] = [
    {"lamina.thick.density": 1000.0},
    {"lamina.thin.damping_ratio": 0.1},
    {"gap.tip": 0.02},
    {"gap.exponent": 3.0},
    {"gap.shape": "mode"},
    {"mesh.elements": 4},
    {"damping.rayleigh": "mass"},
    {"time.mass": "lumped"},
    {"contact.points_per_element": 2, "contact.impulse": "consistent"},
]
ASKED = (
    "excitation.kind",
    "excitation.acts_on",
    "excitation.2.lamina",
    "excitation.position",
    "gap.stiffness",
    "time.refine",
    "stop.1.gap",
)
"""Keys of axes whose points are asked for their model, as they may change it."""


@pytest.fixture
def runner() -> PointRunner:
    axis = {"key": "excitation.frequency", "values": [3.0]}
    return PointRunner(sweep_of({"name": "s", "base": "paper", "set": SMALL, "axis": [axis]}))


@pytest.mark.parametrize("keys", SHARED)
def test_what_does_not_enter_the_assembly_shares_the_model(
    runner: PointRunner, keys: dict[str, object]
) -> None:
    case = preset("paper", SMALL)
    other = case.with_overrides(keys)
    model = runner.structure(case)
    assert runner.structure(other) is model
    for name in ("mass", "damping", "stiffness"):  # and it is right to share it
        operators = PointRunner(runner.sweep).structure(other).operators
        difference = getattr(operators, name) - getattr(model.operators, name)
        assert abs(difference).max() == 0.0
        np.testing.assert_array_equal(operators.gap0, model.operators.gap0)


@pytest.mark.parametrize("keys", OWN)
def test_what_enters_the_assembly_has_a_model_of_its_own(
    runner: PointRunner, keys: dict[str, object]
) -> None:
    case = preset("paper", SMALL)
    assert runner.structure(case.with_overrides(keys)) is not runner.structure(case)


class Bond(Section):
    """A section that cases may have one day."""

    length: float = 0.0


class BondedCase(Case):
    """A case with one more section."""

    bond: Bond = Bond()


def test_a_new_section_never_shares_models() -> None:
    data = preset("paper", SMALL).model_dump(exclude_none=True)
    plain, none, some = (
        Case.model_validate(data),
        BondedCase.model_validate(data),
        BondedCase.model_validate({**data, "bond": {"length": 0.1}}),
    )
    assert len({assembly_key(case) for case in (plain, none, some)}) == 3


def test_points_say_whether_they_have_settled_and_may_run_until_they_have() -> None:
    """A point that ends by itself has the row of one with as many periods; the last strobes are
    those of its end."""
    keys = {"time.steps_per_period": 60, "output.window_periods": 4, "time.periods": "settled"}
    axis = {"key": "excitation.frequency", "values": [1.25, 13.667]}
    damping = {f"lamina.{name}.damping_ratio": 0.005 for name in ("thick", "thin")}
    data = {"name": "s", "base": "paper", "axis": [axis], "record": {"strobes": 30}}
    ends = PointRunner(sweep_of(data | {"set": SMALL | keys}))
    layout = ends.structure(ends.sweep.case(0)).layout
    wanted = quantities(ends.sweep.file.record, layout)
    names, sizes = [q.name for q in wanted], [q.size for q in wanted]
    first, _ = ends.point(0, None)
    assert first.row is not None and first.outcome == "completed"
    starts = dict(zip(names, np.cumsum([0, *sizes]), strict=False))
    periods = int(first.row[starts["periods_computed"]])
    assert first.row[starts["settled"]] == 1.0 and periods % 20 == 0 and periods < 300
    counted = PointRunner(sweep_of(data | {"set": SMALL | keys | {"time.periods": periods}}))
    np.testing.assert_array_equal(counted.point(0, None)[0].row, first.row)
    few = {"time.periods": 60, "contact.law": "none"}
    short = PointRunner(sweep_of(data | {"set": SMALL | keys | damping | few}))
    row = short.point(1, None)[0].row
    assert row is not None and row[starts["settled"]] == 0.0
    assert np.isnan(row[starts["periodicity"]]) and row[starts["transient"]] > 0.01


@pytest.mark.parametrize("keys", SHARED)
def test_axes_that_count_as_free_change_no_model(keys: dict[str, object]) -> None:
    """Points that are not asked for their model have that of the first one."""
    case = preset("paper", SMALL)
    free = {key: value for key, value in keys.items() if not _may_assemble(key)}
    assert free or "name" in keys
    assert assembly_key(case.with_overrides(free)) == assembly_key(case)


@pytest.mark.parametrize("keys", [*OWN, *({key: 0} for key in ASKED)])
def test_axes_that_may_change_the_model_are_not_free(keys: dict[str, object]) -> None:
    assert any(map(_may_assemble, keys))


def test_points_share_a_model_as_far_as_nothing_else_is_varied() -> None:
    axes = [
        {"key": "contact.restitution", "values": [0.1, 0.5]},
        {"key": "excitation.frequency", "values": [3.0, 3.5]},
    ]
    data = {"name": "s", "base": "paper", "set": SMALL | {"time.periods": 1}}
    runner = PointRunner(sweep_of(data | {"axis": axes}))
    models = {id(runner._prepared(index)[1]) for index in range(4)}
    assert len(models) == 1
    gaps = [*axes, {"key": "gap.tip", "values": [0.01, 0.02]}]
    runner = PointRunner(sweep_of(data | {"axis": gaps}))
    models = {id(runner._prepared(index)[1]) for index in range(8)}
    assert len(models) == 2


@pytest.mark.parametrize("base", ["default", "paper", "embedded"])
def test_cases_of_points_are_those_that_overrides_make(base: str) -> None:
    """Laminae that no axis changes are taken over as they are."""
    axis = {"key": "contact.restitution", "values": [0.1, 0.5]}
    sweep = sweep_of({"name": "s", "base": base, "axis": [axis]})
    for values in (
        {"contact.restitution": 0.3},
        {f"lamina.{sweep.base.lamina[0].name}.thickness": 0.0021},
        {"excitation.amplitude": "3 mm", "time.periods": 7},
    ):
        case, other = sweep.case_of(values, "point"), sweep.base.with_overrides(values)
        assert case == other
        assert case.to_toml() == other.to_toml()
    with pytest.raises(CaseError, match=r"contact\.restitution"):
        sweep.case_of({"contact.restitution": -1.0}, "point")


def test_each_point_under_a_load_begins_at_its_own_state_of_rest() -> None:
    """Springs of the law bear it: what they are is part of the state of rest."""
    strip = {"length": 0.3, "width": 0.03, "material": "steel", "damping_ratio": 0.02}
    base = Case(
        name="level",
        lamina=[{"name": name, "thickness": h} | strip for name, h in (("a", 2e-3), ("b", 1e-3))],
        gap={"tip": 1e-3}, gravity={}, mesh={"elements": 4},
        excitation={"kind": "harmonic", "frequency": 10.0, "amplitude": 1e-12},
        contact={"law": "penalty", "penalty_stiffness": 2000.0},
        time={"periods": 1, "steps_per_period": 200}, output={"window_periods": 1},
    )  # fmt: skip
    axes: dict[str, list[Any]] = {
        "contact.penalty_stiffness": [2000.0, 200.0],
        "contact.law": ["penalty", "newton-penalty", "none"],
    }
    for key, values in axes.items():
        runner = PointRunner(Sweep(base, {key: values}))
        wanted = quantities(runner.sweep.file.record, runner.structure(base).layout)
        start = sum(q.size for q in wanted[: [q.name for q in wanted].index("tip_min")])
        for index, value in enumerate(values):
            point, _ = runner.point(index, None)
            tips = df.rest(base.with_overrides({key: value})).displacement.values[:, -1]
            assert point.row is not None
            assert point.row[start : start + 2] == pytest.approx(tips, rel=1e-6), (key, value)
