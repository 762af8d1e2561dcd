"""The file of a reduced structure: written, read, refused where case and file do not agree."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from project import ROOT

from delam_fem.api import (
    Case,
    CaseError,
    assemble,
    load_case,
    preset,
    read_arrays,
    reduced_case,
    write_arrays,
)
from delam_fem.model.reduction import Reduction

SMALL = {"mesh.elements": 6}
SENSOR = {"name": "s", "quantity": "displacement", "lamina": "thin", "position": 0.3}
STRAIN = {"name": "s", "quantity": "strain", "lamina": "upper", "position": 0.1}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Reduction, Case]:
    """Return a reduction, and the case that is computed with its file."""
    folder = tmp_path_factory.mktemp("reduced")
    reduction = reduced_case(preset("default", SMALL), 3)
    return reduction, load_case(reduction.save(folder)[1])


def test_a_structure_comes_back_as_it_was(made: tuple[Reduction, Case]) -> None:
    reduction, case = made
    again, before = assemble(case), reduction.structure
    for name in ("mass", "damping", "stiffness", "gap_matrix", "probes"):
        there, here = (getattr(s.operators, name).toarray() for s in (again, before))
        np.testing.assert_array_equal(there, here, err_msg=name)
    for name in ("mass", "damping", "stiffness", "corner"):
        there, here = (np.asarray(getattr(s.operators.base, name)) for s in (again, before))
        np.testing.assert_array_equal(there, here)
    np.testing.assert_array_equal(again.operators.gap0, before.operators.gap0)
    assert again.layout.probes == before.layout.probes
    assert [part.name for part in again.layout.parts] == ["thick", "thin"]
    assert assemble(case).operators is again.operators  # a file is read once


def test_gaps_at_rest_follow_the_case(made: tuple[Reduction, Case]) -> None:
    case = made[1].with_overrides({"gap.tip": 0.02, "gap.exponent": 3.0})
    expected = assemble(preset("default", {**SMALL, "gap.tip": 0.02, "gap.exponent": 3.0}))
    np.testing.assert_array_equal(assemble(case).operators.gap0, expected.operators.gap0)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"lamina.thin.thickness": 0.002}, "lamina.thin.thickness: "),
        ({"mesh.elements": 7}, "mesh.elements: "),
        ({"damping.rayleigh": "mass"}, "damping.rayleigh: "),
        ({"contact.points_per_element": 2}, "contact.points_per_element: "),
        ({"time.mass": "lumped"}, "time.mass: "),
        ({"point_mass": [{"lamina": "thin", "mass": 0.1}]}, "point_mass"),
        (
            {"excitation": {"kind": "force", "lamina": "thin", "position": 0.1, "frequency": 3.0,
                            "amplitude": 1.0}},
            "excitation.kind: ",
        ),
        ({"contact.impulse": "lumped", "time.scheme": "newmark"}, 'expected "consistent", because'),
    ],
)  # fmt: skip
def test_another_model_is_refused_by_the_key_that_differs(
    made: tuple[Reduction, Case], overrides: Mapping[str, object], message: str
) -> None:
    with pytest.raises(CaseError, match=message):
        assemble(made[1].with_overrides(overrides))


def test_a_mesh_file_may_move_but_not_change(tmp_path: Path) -> None:
    mesh = tmp_path / "own.msh"
    mesh.write_bytes((ROOT / "meshes" / "laminae_graded.msh").read_bytes())
    reduction = reduced_case(preset("default", {"mesh.file": str(mesh)}), 3)
    case = load_case(reduction.save(tmp_path / "model")[1])
    assert case.mesh.file != mesh
    assert assemble(case).operators.n_pairs == reduction.full.operators.n_pairs
    case.mesh.file.write_bytes(case.mesh.file.read_bytes() + b" ")
    with pytest.raises(CaseError, match=r"mesh\.file: is not the mesh with which"):
        assemble(case)


def test_what_was_not_assembled_may_change(made: tuple[Reduction, Case]) -> None:
    keys = {"excitation.frequency": 2.0, "contact.restitution": 0.5, "time.refine": 4}
    keys |= {"output.window_periods": 1, "name": "other", "time.steps_per_period": 100}
    assert assemble(made[1].with_overrides(keys)).operators.n_pairs == 6


def test_sensors_may_be_anywhere(made: tuple[Reduction, Case]) -> None:
    reduction, case = made
    kinds = ("displacement", "strain")
    sensors = [{**SENSOR, "name": kind, "quantity": kind} for kind in kinds]
    reduced = assemble(case.with_overrides({"sensor": sensors}))
    full = assemble(preset("default", {**SMALL, "sensor": sensors}))
    V, q = reduction.basis.vectors, np.random.default_rng(1).normal(size=reduced.operators.n_dofs)
    for k in range(2):
        a, b = (s.layout.sensors[k] for s in (reduced, full))
        there = reduced.operators.sensors[a.of_u] @ q
        np.testing.assert_allclose(there, full.operators.sensors[b.of_u] @ (V @ q), rtol=1e-9)


def test_strains_of_a_bonded_stack_are_those_it_had(tmp_path: Path) -> None:
    case = preset("embedded", {"mesh.elements": 20, "sensor": [STRAIN]})
    reduction = reduced_case(case, 5)
    reduced = load_case(reduction.save(tmp_path)[1])
    reduced_structure, full = assemble(reduced), reduction.full
    q = np.random.default_rng(1).normal(size=reduced_structure.operators.n_dofs)
    u = reduction.basis.vectors @ q
    np.testing.assert_allclose(
        reduced_structure.operators.sensors @ q, full.operators.sensors @ u, rtol=1e-9
    )
    other = reduced.with_overrides({"sensor": [{**STRAIN, "surface": "bottom"}]})
    with pytest.raises(CaseError, match=r"expected one of the 1 strains .* lamina upper at 0.1 m"):
        assemble(other)


def test_a_damaged_file_is_refused_in_words(made: tuple[Reduction, Case], tmp_path: Path) -> None:
    case = made[1]
    content = case.model.file.read_bytes()
    path = tmp_path / "reduced.npz"
    other = case.model_copy(update={"model": case.model.model_copy(update={"file": path})})
    half = bytearray(content)
    half[content.index(read_arrays(case.model.file)["squares"].tobytes())] ^= 0xFF
    for damaged in (content[: len(content) // 2], bytes(half), b"", b"nonsense"):
        path.write_bytes(damaged)
        with pytest.raises(CaseError, match="is damaged or no file of delam-fem reduce"):
            assemble(other)
    path.unlink()
    with pytest.raises(CaseError, match="cannot be read"):
        assemble(other)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("format", np.array(99)),
        ("H", np.zeros((3, 2))),
        *(("squares", values) for values in (-np.ones(4), np.ones((2, 2)), np.zeros(0))),
        ("gap0", np.full(6, np.nan)),
        ("lower", np.array([1])),
        ("places_0", np.arange(5.0)),
        ("places_0", np.arange(6.0)[:, None]),
        ("sections", np.ones((2, 6))),
        ("x", np.zeros((6, 1))),
        ("case", np.array(["a"])),
        ("dofs", np.zeros((2, 6, 2), dtype=np.int64)),
        ("strains", np.zeros((0, 3))),
    ],
)
def test_arrays_that_do_not_fit_are_refused(
    made: tuple[Reduction, Case], tmp_path: Path, name: str, value: np.ndarray
) -> None:
    case = made[1]
    path = write_arrays(tmp_path / "reduced.npz", {**read_arrays(case.model.file), name: value})
    other = case.model_copy(update={"model": case.model.model_copy(update={"file": path})})
    reason = "squares " if name == "squares" else ""
    with pytest.raises(CaseError, match=rf"is damaged or no file of delam-fem reduce \({reason}"):
        assemble(other)


def test_a_file_that_was_changed_is_refused(made: tuple[Reduction, Case], tmp_path: Path) -> None:
    case, path = made[1], tmp_path / "reduced.npz"
    with np.load(case.model.file) as archive:
        arrays = {key: archive[key] for key in archive.files}
    np.savez(path, **{**arrays, "squares": 1.01 * arrays["squares"]})
    other = case.model_copy(update={"model": case.model.model_copy(update={"file": path})})
    with pytest.raises(CaseError, match=r"is damaged .*\(changed after it was written\)"):
        assemble(other)


def test_a_reduced_case_and_a_lumped_mass_are_not_reduced(made: tuple[Reduction, Case]) -> None:
    with pytest.raises(CaseError, match="expected a model that is not reduced yet"):
        reduced_case(made[1])
    with pytest.raises(CaseError, match=r"contact\.impulse: "):
        reduced_case(preset("paper", SMALL))
    with pytest.raises(CaseError, match=r"modes: .*given 0"):
        reduced_case(preset("default", SMALL), 0)
