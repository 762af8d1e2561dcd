"""Cases whose laminae are solids, beside the beams of the same cases."""

import numpy as np
import pytest
import scipy.sparse as sp
from box_meshes import two_bricks
from mpi_pool import Crew
from scipy.sparse.linalg import spsolve

from delam_fem.api import CaseError, Structure, lowest, preset
from delam_fem.model import discretise
from delam_fem.model.beams import closed_form
from delam_fem.model.layout import DISPLACEMENT
from delam_fem.model.solids.assembly import assemble, in_plan, whole_bodies
from delam_fem.model.solids.meshing import lattice

PLANE = {"model.kind": "plane-stress", "mesh.elements": 20}
SOLID = {"model.kind": "solid", "model.strips": 2, "mesh.elements": 10}
ROUND_OFF = 1e-9
THIN = 1
"""Number of the upper lamina of the preset "default"."""
SLENDER = 0.005
"""Solids of 20 to 40 cells and beams: relative difference of responses, all of it from the mesh."""


def both(name: str, overrides: dict[str, object]) -> tuple[Structure, Structure]:
    """Return the solids of a preset and its beams."""
    case = preset(name, overrides)
    return discretise.assemble(case), closed_form.assemble(case)


def statics(structure: Structure, load: np.ndarray) -> np.ndarray:
    """Return the readings of all points under a load, shape (n_readings,)."""
    u = spsolve(structure.operators.stiffness.tocsc(), load)
    return structure.layout.read(u[None], np.zeros(1))[0]


@pytest.mark.parametrize("name", ["default", "edge", "embedded"])
@pytest.mark.parametrize("per_element", [1, 3])
def test_plane_stress_has_the_layout_of_beams(name: str, per_element: int) -> None:
    solid, beam = both(name, {**PLANE, "contact.points_per_element": per_element})
    for part, other in zip(solid.layout.parts, beam.layout.parts, strict=True):
        assert part.name == other.name
        np.testing.assert_array_equal(part.x, other.x)
        np.testing.assert_allclose(part.flexural_rigidity, other.flexural_rigidity)
        np.testing.assert_allclose(part.mass_per_length, other.mass_per_length)
    assert solid.layout.probes == beam.layout.probes
    for mine, theirs in zip(solid.layout.interfaces, beam.layout.interfaces, strict=True):
        assert (mine.name, mine.parts, mine.pairs) == (theirs.name, theirs.parts, theirs.pairs)
        np.testing.assert_allclose(mine.places, theirs.places, atol=1e-12)
    np.testing.assert_allclose(solid.operators.gap0, beam.operators.gap0, atol=1e-15)
    weights = solid.operators.pair_weights, beam.operators.pair_weights
    assert (weights[0] is None) == (weights[1] is None) == (per_element == 1)
    if per_element > 1:
        np.testing.assert_allclose(*weights)


@pytest.mark.parametrize("name", ["default", "edge", "embedded"])
@pytest.mark.parametrize("kind", [PLANE, SOLID])
def test_a_moving_base_carries_all_with_it(name: str, kind: dict[str, object]) -> None:
    """K ι = -k_b with ι = 1 in every reading; ι carries the whole mass, no pair opens."""
    structure = assemble(preset(name, kind))
    o, layout = structure.operators, structure.layout
    iota = -spsolve(o.stiffness.tocsc(), o.base.stiffness)
    read = layout.read(iota[None], np.ones(1))[0]
    for part in layout.parts:
        np.testing.assert_allclose(read[part.dofs[:, DISPLACEMENT]], 1.0, atol=1e-3)
    case = preset(name)
    total_mass = sum(lamina.mass_per_length * lamina.length for lamina in case.lamina)
    mass = iota @ (o.mass @ iota + 2.0 * o.base.mass) + o.base.corner[0]
    assert mass == pytest.approx(total_mass, rel=1e-3)
    assert np.abs(o.gap_matrix @ iota).max() < 1e-3
    exact = np.where(np.arange(o.n_dofs) >= 0, iota.round(), 0.0)  # 1 along y, 0 elsewhere
    assert np.abs(o.gap_matrix @ exact).max() < ROUND_OFF
    scale = abs(o.stiffness).max()
    assert np.abs(o.stiffness @ exact + o.base.stiffness).max() < 1e-12 * scale
    assert exact @ o.base.stiffness + o.base.corner[2] == pytest.approx(0.0, abs=1e-9 * scale)


def test_rows_of_pairs_across_the_width_share_the_weight_of_a_beams_pair() -> None:
    solid, beam = both("embedded", {**SOLID, "mesh.elements": 20})
    interface = solid.layout.interfaces[0]
    weights = solid.operators.pair_weights
    np.testing.assert_allclose(weights[:3], [0.25, 0.5, 0.25])
    np.testing.assert_allclose(np.unique(interface.places), beam.layout.interfaces[0].places)
    np.testing.assert_allclose(
        solid.layout.at_stations(interface, weights)[solid.layout.stations_of(interface)], 1.0
    )
    finer = both("embedded", {**SOLID, "mesh.elements": 20, "contact.points_per_element": 2})
    theirs = finer[1].layout.at_stations(
        finer[1].layout.interfaces[0], finer[1].operators.pair_weights
    )
    mine = finer[0].layout.at_stations(
        finer[0].layout.interfaces[0], finer[0].operators.pair_weights
    )
    np.testing.assert_allclose(mine, theirs)


def test_rates_of_gaps_are_those_of_the_middle_lines() -> None:
    """In bending without strain of the thickness the surfaces move with the middle lines."""
    structure = assemble(preset("default", PLANE))
    o, layout = structure.operators, structure.layout
    load = np.asarray(o.probes[THIN].toarray()).ravel()
    u = spsolve(o.stiffness.tocsc(), load)
    read = layout.read(u[None], np.zeros(1))[0]
    interface = layout.interfaces[0]
    points = interface.places.astype(np.int64)
    of_upper = read[layout.parts[THIN].dofs[points, DISPLACEMENT]]
    np.testing.assert_allclose(o.gap_matrix @ u, of_upper, rtol=1e-3, atol=1e-6)
    assert of_upper[-1] > 0.5


def test_damping_has_the_coefficients_of_the_beam() -> None:
    case = preset("default", PLANE)
    structure = assemble(case)
    o = structure.operators
    for number in range(2):
        dofs = structure.layout.own_dofs(number)
        alpha, beta = case.rayleigh(number)
        M, C, K = (A[dofs][:, dofs] for A in (o.mass, o.damping, o.stiffness))
        assert abs(C - alpha * M - beta * K).max() < 1e-12 * abs(C).max()
        m, c, k = o.base.mass[dofs], o.base.damping[dofs], o.base.stiffness[dofs]
        np.testing.assert_allclose(c, alpha * m + beta * k)
    both_kinds = both("embedded", PLANE)
    ratios = []
    for structure in both_kinds:
        o = structure.operators
        _, modes = lowest(o.stiffness, o.mass, 2)
        squares, terms = (
            np.einsum("ij,ij->j", modes, A @ modes) / np.einsum("ij,ij->j", modes, o.mass @ modes)
            for A in (o.stiffness, o.damping)
        )
        beta = (terms[1] - terms[0]) / (squares[1] - squares[0])
        ratios.append((terms[0] - beta * squares[0], beta))
    assert ratios[0] == pytest.approx(ratios[1], rel=1e-6)


@pytest.mark.parametrize("kind", [PLANE, SOLID])
def test_a_force_bends_a_lamina_as_a_beam(kind: dict[str, object]) -> None:
    force = {"kind": "force", "frequency": 3.0, "amplitude": 1.0, "lamina": "thin"}
    case = preset("default", {**kind, "excitation": {**force, "position": 0.6}})
    structure = assemble(case)
    read = statics(structure, -structure.operators.base.stiffness)
    lamina, part = case.lamina[THIN], structure.layout.parts[THIN]
    a, x = 0.6, part.x
    deflection = np.where(x < a, x**2 * (3 * a - x), a**2 * (3 * x - a))
    exact = deflection / (6.0 * lamina.flexural_rigidity)
    deflections = read[part.dofs[:, DISPLACEMENT]]
    np.testing.assert_allclose(deflections, exact, atol=SLENDER * exact[-1])
    assert np.abs(read[structure.layout.parts[0].dofs]).max() < ROUND_OFF


def test_sensors_read_deflection_and_strain_of_surfaces() -> None:
    """Under a load at the tip the strain is -s h/2 F (L - x) / EI, s = 1 at the top."""
    places = {"position": 0.2, "lamina": "thin"}
    sensors = [
        {"name": "u", "quantity": "displacement", **places},
        {"name": "top", "quantity": "strain", "surface": "top", **places},
        {"name": "bottom", "quantity": "strain", "surface": "bottom", **places},
        {"name": "other", "quantity": "strain", "lamina": "thick", "position": 0.2},
        {"name": "a", "quantity": "acceleration", **places},
    ]
    case = preset("default", {**PLANE, "mesh.elements": 40, "sensor": sensors})
    structure = assemble(case)
    o, lamina = structure.operators, case.lamina[THIN]
    assert structure.body is not None and [sensor.name for sensor in structure.layout.sensors] == [
        "u", "top", "bottom", "other", "a",
    ]  # fmt: skip
    u = spsolve(o.stiffness.tocsc(), o.probes[THIN].toarray().ravel())
    read = o.sensors @ u
    L, EI, h = lamina.length, lamina.flexural_rigidity, lamina.thickness
    strain = -0.5 * h * (L - 0.2) / EI
    assert read[0] == pytest.approx(0.2**2 * (3 * L - 0.2) / (6.0 * EI), rel=SLENDER)
    assert read[1] == pytest.approx(strain, rel=1e-3)
    assert read[2] == pytest.approx(-strain, rel=1e-3)
    assert read[3] == pytest.approx(0.0, abs=ROUND_OFF)


def test_strain_of_a_bonded_stack_is_that_of_the_beam() -> None:
    of = {"quantity": "strain", "lamina": "lower"}
    sensors = [
        {"name": "b", "surface": "bottom", "position": 0.05, **of},
        {"name": "t", "surface": "top", "position": 0.19, **of},
    ]
    solid, beam = both("embedded", {**PLANE, "mesh.elements": 80, "sensor": sensors})
    strains = []
    for structure in (solid, beam):
        o = structure.operators
        strains.append(o.sensors @ spsolve(o.stiffness.tocsc(), o.probes[0].toarray().ravel()))
    np.testing.assert_allclose(strains[0], strains[1], rtol=0.002)


def test_point_masses_lower_frequencies_as_of_beams() -> None:
    masses = [
        {"lamina": "thin", "mass": 0.04},
        {"lamina": "thick", "mass": 0.03, "position": 0.33},
    ]
    solid, beam = both("default", {**PLANE, "mesh.elements": 40, "point_mass": masses})
    frequencies, expected = (
        lowest(structure.operators.stiffness, structure.operators.mass, 3)[0]
        for structure in (solid, beam)
    )
    np.testing.assert_allclose(frequencies, expected, rtol=1e-3)
    assert expected[0] < 0.9  # 1.4357 Hz without the masses
    o = solid.operators
    iota = np.round(-spsolve(o.stiffness.tocsc(), o.base.stiffness))
    total_mass = 0.07 + sum(
        lamina.mass_per_length * lamina.length for lamina in preset("default").lamina
    )
    mass = iota @ (o.mass @ iota + 2.0 * o.base.mass) + o.base.corner[0]
    assert mass == pytest.approx(total_mass, rel=ROUND_OFF)


def test_lumped_mass_is_diagonal_and_whole() -> None:
    case = preset("embedded", {**PLANE, "time.mass": "lumped", "mesh.elements": 40})
    o = assemble(case).operators
    assert (o.mass - sp.diags(o.mass.diagonal())).nnz == 0
    np.testing.assert_allclose(o.mass.diagonal(), o.lumped_mass)
    iota = np.round(-spsolve(o.stiffness.tocsc(), o.base.stiffness))
    total_mass = sum(lamina.mass_per_length * lamina.length for lamina in case.lamina)
    assert iota @ o.mass @ iota + o.base.corner[0] == pytest.approx(total_mass)
    acting = {"contact.impulse": "lumped", "mesh.elements": 40}
    consistent = assemble(preset("embedded", {**PLANE, **acting})).operators
    np.testing.assert_allclose(consistent.lumped_mass, o.lumped_mass)
    frequencies, expected = (
        lowest(operators.stiffness, operators.mass, 3)[0] for operators in (o, consistent)
    )
    np.testing.assert_allclose(frequencies, expected, rtol=0.01)


def test_point_masses_on_a_lumped_mass_are_refused() -> None:
    masses = {"time.mass": "lumped", "point_mass": [{"lamina": "thin", "mass": 0.04}]}
    with pytest.raises(CaseError, match="point_mass: "):
        assemble(preset("default", {**PLANE, **masses}))


def test_bodies_go_to_the_ranks_as_wholes() -> None:
    mesh = two_bricks("quadrilateral", (3, 1), (2, 1))
    assert whole_bodies(mesh, 2).tolist() == [0, 0, 0, 1, 1]
    assert whole_bodies(mesh, 1).tolist() == [0] * 5
    assert whole_bodies(mesh, 3) is None


def test_bodies_are_cut_in_plan() -> None:
    """Cells above one another have one rank, and all ranks about as many cells."""
    mesh = lattice(preset("default", SOLID | {"mesh.elements": 12, "model.layers": 2}))
    middles = mesh.points[mesh.cells].mean(axis=1)
    ranks = in_plan(mesh, 4)
    assert ranks is not None and np.bincount(ranks).tolist() == 4 * [len(ranks) // 4]
    for i in range(len(middles)):
        is_above = np.abs(middles[:, [0, 2]] - middles[i, [0, 2]]).max(axis=1) < 1e-9
        assert np.count_nonzero(is_above) == 4 and np.unique(ranks[is_above]).size == 1
    assert in_plan(mesh, 25) is None  # there are 24 columns of cells


SCRIPT = """
import numpy as np
import scipy.sparse as sp
from delam_fem.case.files import preset
from delam_fem.case.toml import CaseError
from delam_fem.model.solids.assembly import assemble

def whole(matrix):
    indptr, columns, values = matrix.getValuesCSR()
    shape = matrix.getLocalSize()[0], matrix.getSize()[0]
    return sp.vstack(comm.allgather(sp.csr_matrix((values, columns, indptr), shape))).toarray()

def columns(rows):
    return sp.hstack(comm.allgather(rows)).toarray()

def joined(vector):
    return np.concatenate(comm.allgather(vector))

def answers(M, C, K, rows, lumped, b):
    # functionals of responses: they do not depend on the order of the dofs
    A = 1e6 * M + 1e3 * C + K
    loads = np.column_stack([rows.T, 1e6 * b.mass + 1e3 * b.damping + b.stiffness])
    found = [rows @ np.linalg.solve(A, loads)]
    return found if lumped is None else [*found, (rows / lumped) @ rows.T]

def base(b):
    return type(b)(joined(b.mass), joined(b.damping), joined(b.stiffness), b.corner)

def compare(name, kind, degree, impulse="consistent"):
    keys = {"model.kind": kind, "mesh.elements": 6, "model.degree": degree}
    keys["contact.impulse"] = impulse
    if name == "embedded":
        keys |= {"support.start": "pinned", "support.end": "pinned"}
        keys["sensor"] = [{"name": "s", "lamina": "lower", "quantity": "strain", "position": 0.1}]
        keys["point_mass"] = [{"lamina": "upper", "mass": 0.02, "position": 0.21}]
    case = preset(name, keys)
    one, many = assemble(case), assemble(case, comm=comm)
    o, d, n = one.operators, many.operators, one.operators.n_dofs
    assert d.n_dofs == n and d.is_uncoupled == (name == "default" and comm.size == 2)
    reading = one.layout.reading, many.layout.reading
    rows = sp.vstack([o.gap_matrix, o.observed, reading[0].matrix]).toarray()
    shares = columns(sp.vstack([d.gap_matrix, d.observed, reading[1].matrix]))
    M, C, K = (matrix.toarray() for matrix in (o.mass, o.damping, o.stiffness))
    expected = answers(M, C, K, rows, o.lumped_mass, o.base)
    M, C, K = (whole(matrix) for matrix in (d.mass, d.damping, d.stiffness))
    lumped = None if d.lumped_mass is None else joined(d.lumped_mass)
    assert (lumped is None) == (impulse == "consistent")
    found = answers(M, C, K, shares, lumped, base(d.base))
    for mine, theirs in zip(found, expected):
        limit = 1e-8 if lumped is None else 1e-6  # round-off: see unknowns.py
        assert np.abs(mine - theirs).max() < limit * np.abs(theirs).max(), (mine, theirs)
    np.testing.assert_allclose(d.base.corner, o.base.corner)
    np.testing.assert_array_equal(d.gap0, o.gap0)
    np.testing.assert_allclose(reading[1].base, reading[0].base, atol=1e-12)
    # the dofs are those of one rank, in another order
    order = joined(d.order)
    np.testing.assert_array_equal(np.sort(order), np.arange(n))
    for mine, theirs in zip((M, C, K), (o.mass, o.damping, o.stiffness)):
        theirs = theirs.toarray()[np.ix_(order, order)]
        assert np.abs(mine - theirs).max() < 1e-10 * np.abs(theirs).max()
    np.testing.assert_array_equal(joined(reading[1].part), reading[0].part[order])
    if not d.is_uncoupled and d.n_pairs > 4:  # most of what touches is on one rank
        n_ranks = np.sum(comm.allgather(np.diff(d.gap_matrix.indptr) > 0), axis=0)
        assert n_ranks.min() == 1 and np.mean(n_ranks == 1) > 0.6, n_ranks

compare("default", "plane-stress", 2, "lumped")
compare("default", "solid", 2)
compare("embedded", "plane-stress", 3)
compare("embedded", "solid", 2)
"""


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [pytest.param(2, marks=pytest.mark.nightly), 3])
def test_shares_of_ranks_make_the_operators_of_one(ranks: int, crew: Crew) -> None:
    crew.run(ranks, SCRIPT)
