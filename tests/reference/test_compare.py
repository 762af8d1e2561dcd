"""The comparison must see a difference wherever there is one."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from delam_fem import compare
from delam_fem.api import CaseError, Operators, assemble, preset
from delam_fem.reference import matrices
from delam_fem.reference.compare import Comparison, Motions, operator_differences

CHANGE = 1e-6
SAME_MATRICES, SAME_MOTION = 1e-13, 1e-11
"""Relative; m. Measured: 7e-16, 2e-14."""
SAME_FREQUENCIES = 1e-7
"""Relative."""


@pytest.fixture
def ops() -> Operators:
    return assemble(preset("paper", {"mesh.elements": 5}), needs_dolfinx=False).operators


@pytest.fixture
def comparison() -> Comparison:
    times = np.arange(1.0, 6.0)
    tips = np.zeros((2, 5))
    tips[1] = [0.0, 1e-12, -3e-12, 1e-6, 2e-6]
    motion = Motions(
        names=("thick", "thin"),
        times=times,
        values=tips,
        reference=np.zeros((2, 5)),
        impacts=(7, 8),
        impact_limit=2,
        impact_time=3.0,
    )
    return Comparison(matrices={"M": 1e-15}, frequencies=2e-12, motion=motion)


def motion_of(comparison: Comparison) -> Motions:
    assert comparison.motion is not None
    return comparison.motion


def changed(ops: Operators, where: str) -> Operators:
    """Return the operators with one entry changed by a part in a million."""
    if where in ("mass", "damping", "stiffness", "gap_matrix"):
        matrix = getattr(ops, where).copy()
        matrix.data[3] *= 1.0 + CHANGE
        return replace(ops, **{where: matrix})
    if where.startswith("base."):
        name = where.removeprefix("base.")
        column = getattr(ops.base, name).copy()
        column[1] *= 1.0 + CHANGE  # a slope
        return replace(ops, base=replace(ops.base, **{name: column}))
    vector = getattr(ops, where).copy()
    vector[-1] *= 1.0 + CHANGE
    return replace(ops, **{where: vector})


def test_equal_operators_do_not_differ(ops: Operators) -> None:
    assert set(operator_differences(ops, ops).values()) == {0.0}


@pytest.mark.parametrize(
    ("where", "name"),
    [
        ("mass", "M"),
        ("damping", "C"),
        ("stiffness", "K"),
        ("base.mass", "M, column of the base"),
        ("base.damping", "C, column of the base"),
        ("base.stiffness", "K, column of the base"),
        ("lumped_mass", "lumped mass"),
        ("gap_matrix", "H"),
        ("gap0", "gap0"),
    ],
)
def test_a_changed_entry_is_seen_in_its_place(ops: Operators, where: str, name: str) -> None:
    differences = operator_differences(changed(ops, where), ops)
    assert 0.01 * CHANGE < differences.pop(name) < 2.0 * CHANGE
    assert set(differences.values()) == {0.0}


@pytest.mark.parametrize(("k", "letter"), [(0, "M"), (1, "C"), (2, "K")])
def test_a_changed_corner_is_seen(ops: Operators, k: int, letter: str) -> None:
    corner = list(ops.base.corner)
    corner[k] *= 1.0 + CHANGE
    other = replace(ops, base=replace(ops.base, corner=(corner[0], corner[1], corner[2])))
    differences = operator_differences(other, ops)
    assert differences[f"{letter}, column of the base"] == pytest.approx(CHANGE, rel=1e-6)


def test_an_entry_where_there_should_be_none_is_seen(ops: Operators) -> None:
    mass = ops.mass.tolil()
    mass[0, 15] = CHANGE * np.sqrt(ops.mass[0, 0] * ops.mass[15, 15])
    differences = operator_differences(replace(ops, mass=mass.tocsr()), ops)
    assert differences["M"] == pytest.approx(CHANGE, rel=1e-9)


def test_histories_are_judged_up_to_the_impact(comparison: Comparison) -> None:
    assert motion_of(comparison).until_impact == 3e-12
    assert motion_of(comparison).overall == 2e-6


def test_rows_state_both(comparison: Comparison) -> None:
    rows = dict(comparison.rows())
    assert rows["M, relative"] == "1.0e-15"
    assert rows["histories up to impact 2"] == "3.0e-12 m"
    assert rows["histories up to 5 s"] == "2.0e-06 m"
    assert rows["impacts, dolfinx and reference"] == "7 and 8"


def test_rows_without_impacts_name_none(comparison: Comparison) -> None:
    rows = dict(replace(motion_of(comparison), impact_limit=0, impacts=(0, 0)).rows())
    assert not any("up to impact" in name for name in rows)
    assert rows["impacts, dolfinx and reference"] == "0 and 0"


def test_save_writes_table_and_picture(comparison: Comparison, tmp_path: Path) -> None:
    table, picture = comparison.save(tmp_path / "new")
    content = json.loads(table.read_text())
    assert content["tips_until_impact_m"] == 3e-12
    assert content["impacts"] == {"dolfinx": 7, "reference": 8}
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_figure_of_equal_histories_can_be_drawn(comparison: Comparison, tmp_path: Path) -> None:
    same = replace(motion_of(comparison), values=np.zeros((2, 5)), impact_limit=0)
    replace(comparison, motion=same).save(
        tmp_path
    )  # a logarithm of nothing but zeros must not warn


@pytest.mark.parametrize(
    ("name", "keys", "reason"),
    [
        ("default", {}, "time.scheme: the reference has newmark; given 'moreau-jean'"),
        ("embedded", {"mesh.elements": 10}, "time.scheme: the reference has newmark"),
        (
            "paper",
            {
                "excitation.kind": "sweep",
                "excitation.start_frequency": 1.0,
                "excitation.end_frequency": 2.0,
                "excitation.duration": 5.0,
            },
            "excitation.kind: the reference has the first periods of a harmonic",
        ),
        ("paper", {"initial": [{"lamina": "thin", "velocity": 0.1}]}, "initial: "),
        ("paper", {"time.refine": 8}, "time.refine: "),
    ],
)
def test_matrices_and_frequencies_are_compared_where_the_motion_cannot_be(
    name: str, keys: dict[str, object], reason: str, tmp_path: Path
) -> None:
    report = compare(preset(name, keys))
    assert report.motion is None and report.refusal.startswith(reason)
    assert set(report.matrices) >= {"M", "C", "K", "H", "gap0"}
    assert max(report.matrices.values()) < SAME_FREQUENCIES  # C follows from frequencies
    assert 0.0 <= report.frequencies < SAME_FREQUENCIES
    (table,) = report.save(tmp_path)
    assert json.loads(table.read_text())["no_motion"] == report.refusal
    assert dict(report.rows())["motion"] == "not compared"


def test_a_force_is_refused_whose_load_the_reference_does_not_have() -> None:
    force = {"kind": "force", "lamina": "thin", "position": 0.5, "amplitude": 0.1, "frequency": 3.0}
    with pytest.raises(CaseError, match=r"excitation: compare: .*'force'"):
        compare(preset("paper", {"excitation": force}))


@pytest.mark.parametrize("name", ["impacts", "periods"])
def test_numbers_below_one_are_refused(name: str) -> None:
    with pytest.raises(CaseError, match=f"{name}: expected at least 1, given 0"):
        compare(preset("paper"), **{name: 0})


def test_contact_points_inside_the_elements_are_those_of_the_reference() -> None:
    keys: dict[str, object] = {"contact.points_per_element": 3, "contact.impulse": "consistent"}
    keys |= {"mesh.elements": 6, "gap.exponent": 1.5, "contact.penalty_stiffness": 2e3}
    keys |= {"contact.threshold_velocity": 0.05}
    case = preset("paper", keys)
    operators = assemble(case, needs_dolfinx=False).operators
    independent = matrices.assemble(case, np.linspace(0.0, case.lamina[0].length, 7))
    assert max(operator_differences(operators, independent).values()) < SAME_MATRICES
    assert operators.pair_weights == pytest.approx(independent.pair_weights, rel=SAME_MATRICES)
    report = compare(case, periods=2)
    assert motion_of(report).overall < SAME_MOTION
    assert min(motion_of(report).impacts) > 10


def test_without_impacts_the_whole_motions_are_compared() -> None:
    case = preset("paper", {"mesh.elements": 4, "excitation.amplitude": 1e-5})
    motion = motion_of(compare(case, periods=1))
    assert (motion.impacts, motion.impact_limit) == ((0, 0), 0)
    assert motion.impact_time == motion.times[-1] and motion.times.size == motion.values.shape[1]
    assert motion.until_impact == motion.overall < SAME_MOTION
