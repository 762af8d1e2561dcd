"""Supports and initial states at points [x, z] of plates, against the flexibility of free plates.

With G = K⁻¹ of the plate without the support, a spring k at p leaves G_ab - G_ap G_pb / (G_pp +
1/k) between any points a and b (the Sherman-Morrison formula); a pin is k = ∞.
"""

import json

import numpy as np
import pytest
import scipy.sparse.linalg
from mpi_pool import Crew
from plates import PATCH, patched, plate

import delam_fem as df
from delam_fem.api import CaseError, Place, Structure, assemble, lowest, reduced_case

P, A, B = (0.15, 0.05), (0.1, -0.05), (0.175, 0.075)  # vertices of the mesh [m]
STIFFNESS = 2e4  # N/m, of the size of the plate's own at P
SENSORS = [
    {"name": name, "quantity": "displacement", "lamina": "sheet", "position": place}
    for name, place in (("p", P), ("a", A), ("b", B))
]
PIN = {"position": P, "kind": "pinned"}
SPRING = {"position": P, "kind": "spring", "stiffness": STIFFNESS, "lamina": "sheet"}


def sheet(*supports, surface="middle", **sections):
    """A plate that is clamped at its start, with supports inside and sensors at P, A and B."""
    tables = [{"side": "start", "kind": "clamped"}, {"side": "end", "kind": "free"}, *supports]
    sensors = [sensor | {"surface": surface} for sensor in SENSORS]
    return plate({}, **{"support": tables, "sensor": sensors, **sections})


def rows_of(structure: Structure, *, side: int = 0) -> np.ndarray:
    """Return what P, A and B read of the free dofs, and the base, shape (3, n + 1)."""
    layout = structure.layout
    rows = [layout.row_of(Place(0, *place, side)) for place in (P, A, B)]
    return np.concatenate([layout.of_dofs(row).toarray() for row in rows])


def flexibility(case: df.Case, side: int = 0) -> np.ndarray:
    """Return the deflections of P, A and B under unit forces there, shape (3, 3) [m/N]."""
    structure = assemble(case)
    rows = rows_of(structure, side=side)[:, :-1]
    return rows @ scipy.sparse.linalg.spsolve(structure.operators.stiffness.tocsc(), rows.T)


def supported(G: np.ndarray, softness: float) -> np.ndarray:
    return G - np.outer(G[:, 0], G[0]) / (G[0, 0] + softness)


def test_a_spring_at_a_point_takes_its_share():
    G = flexibility(sheet())
    sprung = flexibility(sheet(SPRING))
    np.testing.assert_allclose(sprung, supported(G, 1.0 / STIFFNESS), rtol=1e-8)
    assert sprung[0, 0] < 0.8 * G[0, 0]  # it matters


@pytest.mark.slow
@pytest.mark.parametrize(("surface", "side"), [("top", 1), ("bottom", -1)])
def test_a_pin_is_a_spring_without_end(surface, side):
    pin = PIN | {"surface": surface, "lamina": "sheet"}
    G = flexibility(sheet(surface=surface), side)
    pinned = flexibility(sheet(pin, surface=surface), side)
    np.testing.assert_allclose(pinned, supported(G, 0.0), atol=1e-8 * G.max())
    assert abs(pinned[0]).max() < 1e-9 * G.max()  # P does not move
    stiff = SPRING | {"stiffness": 1e12, "surface": surface}
    sprung = flexibility(sheet(stiff, surface=surface), side)
    np.testing.assert_allclose(pinned, sprung, atol=1e-6 * G.max())


def test_a_pin_holds_the_thickness():
    """Beside the pin of the surface it takes the indentation away, which is small in a plate."""
    G = flexibility(sheet())
    through = flexibility(sheet(PIN))
    np.testing.assert_allclose(through, supported(G, 0.0), atol=2e-3 * G.max())
    np.testing.assert_allclose(through, through.T, atol=1e-12 * G.max())


def test_points_move_with_the_base():
    structure = assemble(sheet(PIN, SPRING | {"position": A}))
    o = structure.operators
    u = scipy.sparse.linalg.spsolve(o.stiffness.tocsc(), -o.base.stiffness)
    np.testing.assert_allclose(rows_of(structure) @ np.append(u, 1.0), 1.0, rtol=1e-9)


def test_a_pin_on_a_nodal_line_changes_no_frequency():
    """The second mode of a simply supported rectangle rests on x = a/2."""
    edges = dict.fromkeys(("start", "end", "left", "right"), "pinned")
    tables = [{"side": side, "kind": kind} for side, kind in edges.items()]
    pin = {"position": [0.1, 0.0], "kind": "pinned"}
    frequencies = []
    for supports in (tables, [*tables, pin]):
        o = assemble(plate({}, 8, 6, width=0.15, support=supports)).operators
        frequencies.append(lowest(o.stiffness, o.mass, 3)[0])
    free, pinned = frequencies
    assert np.abs(pinned / free[1] - 1.0).min() < 1e-9
    assert pinned[0] > 1.5 * free[0]  # the first one is not left


@pytest.mark.slow
def test_a_patch_parts_what_a_pin_holds():
    """Within the patch the other lamina stays free; beside it both are held."""
    motions = []
    for place in ([0.065, 0.0], [0.1, 0.04]):
        pin = {"position": place, "kind": "pinned", "lamina": "upper"}
        structure = assemble(patched(8, support=[{"side": "start", "kind": "clamped"}, pin]))
        o = structure.operators
        body = structure.body
        shape = body.shape()
        at = np.abs(shape.points[:, [0, 2]] - place).max(axis=1) < 1e-9
        u = scipy.sparse.linalg.spsolve(o.stiffness.tocsc(), np.ones(o.n_dofs))
        moved = np.abs(body.gathered(u[None], np.zeros(1))[0, shape.node[at], 1])
        motions.append({name: moved[shape.lamina[at] == k].max() for k, name in enumerate("lu")})
    assert motions[0]["u"] == 0.0 < motions[0]["l"]
    assert motions[1]["u"] == motions[1]["l"] == 0.0


@pytest.mark.slow
def test_a_reduced_plate_keeps_its_points():
    load = [{"lamina": "sheet", "position": A, "force": 1.0}]
    for support in (PIN, SPRING):
        case = sheet(support, load=load)
        o = assemble(case).operators
        deflections = o.probes @ scipy.sparse.linalg.spsolve(o.stiffness.tocsc(), o.load)
        reduced = reduced_case(case, 6).structure.operators
        q = reduced.load / reduced.stiffness.diagonal()
        np.testing.assert_allclose(reduced.probes @ q, deflections, rtol=1e-6)


STEPS = {"steps_per_period": 100, "periods": 2}


@pytest.mark.slow
def test_engines_agree_with_points():
    case = sheet(
        PIN, SPRING | {"position": A, "damping": 5.0}, time=STEPS,
        mesh={"elements": 4, "across": 4}, output={"window_periods": 2},
    )  # fmt: skip
    first, second = (df.run(case, engine).history for engine in ("petsc", "compiled"))
    for name in ("sensor_a", "sensor_b", "energy_damping_loss"):
        one, other = first[name].to_numpy(), second[name].to_numpy()
        np.testing.assert_allclose(one, other, atol=1e-7 * np.abs(one).max())
    base = first["base_displacement"].to_numpy()
    np.testing.assert_allclose(first["sensor_p"], base, atol=1e-12)


PROGRAM = """
import json
import numpy as np
import delam_fem as df
from delam_fem.api import assemble

case = df.Case(**json.loads(arguments[0]))
shared = assemble(case, comm=comm).operators
assert 0 < shared.n_own < shared.n_dofs
one = assemble(case).operators
for name in ("stiffness", "damping", "mass"):
    alone = np.sqrt(np.sum(getattr(one, name).data ** 2))
    assert abs(getattr(shared, name).norm() / alone - 1.0) < 1e-9, name
"""


@pytest.mark.mpi
@pytest.mark.slow
def test_two_ranks_hold_the_same(crew: Crew):
    case = sheet(PIN, SPRING | {"position": A, "damping": 5.0})
    crew.run(2, PROGRAM, json.dumps(case.model_dump(mode="json", exclude_unset=True)))


@pytest.mark.slow
def test_an_initial_state_at_a_point_is_static():
    initial = {"lamina": "sheet", "shape": "force", "position": A, "displacement": 1e-3}
    structure = assemble(sheet(initial=[initial]))
    o = structure.operators
    force = o.stiffness @ o.start[0]
    row = rows_of(structure)[1, :-1]
    size = force @ row / (row @ row)
    np.testing.assert_allclose(force, size * row, atol=1e-9 * np.abs(force).max())
    largest = np.abs(structure.body.raised(o.start[0], [0])).max()
    assert largest == pytest.approx(1e-3)
    reduced = reduced_case(sheet(initial=[initial]), 6).structure
    start = reduced.operators.start[0]
    assert start @ (reduced.operators.stiffness @ start) == pytest.approx(
        o.start[0] @ force, rel=1e-8
    )


def test_a_reduced_plate_keeps_places_of_stops_and_initial_states():
    """Nothing else reads there."""
    initial = {"lamina": "upper", "shape": "force", "position": [0.08, 0.01], "displacement": 1e-4}
    stop = {"lamina": "upper", "position": [0.1, 0.03], "side": "above", "gap": 1e-4}
    case = patched(initial=[initial], stop=[stop])
    reduction = reduced_case(case, 6)
    full, small = reduction.full, reduction.structure
    o = full.operators
    layouts = full.layout, small.layout

    def read(place):
        return [layout.of_dofs(layout.row_of(place)).toarray()[0, :-1] for layout in layouts]

    row, reduced_row = read(Place(1, 0.1, 0.03, 1))  # the stop strikes the top
    exact = row @ scipy.sparse.linalg.spsolve(o.stiffness.tocsc(), row)
    static = reduced_row @ (reduced_row / small.operators.stiffness.diagonal())
    assert static == pytest.approx(exact, rel=1e-6)  # a residual shape is of this place
    row, reduced_row = read(Place(1, 0.08, 0.01, 0))
    start = assemble(case.without_impactors).operators.start[0]
    assert reduced_row @ small.operators.start[0] == pytest.approx(row @ start, rel=1e-4)


def test_an_initial_state_of_a_lamina_leaves_the_other_in_the_patch():
    initial = {"lamina": "upper", "shape": "force", "position": [0.065, 0.0], "displacement": 1e-4}
    structure = assemble(patched(initial=[initial]))
    shape = structure.body.shape()
    (u,) = structure.body.gathered(structure.operators.start[:1], np.zeros(1))
    deflection = np.abs(u[shape.node, 1])
    x, z = shape.points[:, 0], shape.points[:, 2]
    low, high = PATCH["across"]
    inside = (x > PATCH["start"]) & (x < PATCH["end"]) & (z > low) & (z < high)
    assert deflection[inside & (shape.lamina == 1)].max() == pytest.approx(1e-4)
    assert deflection[inside & (shape.lamina == 0) & (shape.points[:, 1] < 1e-9)].max() == 0.0
    # bonded beside the patch, both move
    assert deflection[~inside & (shape.lamina == 0)].max() > 1e-7


@pytest.mark.parametrize(
    ("support", "key"),
    [
        (PIN | {"kind": "clamped"}, "kind"),
        (PIN | {"rotational_stiffness": 1.0}, "rotational_stiffness"),
        ({key: value for key, value in SPRING.items() if key != "lamina"}, "lamina"),
        (PIN | {"surface": "top"}, "lamina"),
        (PIN | {"position": 0.1, "surface": "top"}, "surface"),
        (PIN | {"position": [0.1, 0.2]}, "position"),
        (PIN | {"position": [0.3, 0.0]}, "position"),
    ],
)
def test_points_that_are_none_are_refused(support, key):
    with pytest.raises(CaseError, match=key):
        sheet(support)


def test_a_clamp_at_a_point_is_refused_with_its_key_and_what_to_use():
    with pytest.raises(CaseError, match=r"support\.4\.kind: .*\"clamped\".* pins"):
        sheet(PIN, PIN | {"kind": "clamped"})


def test_beams_have_no_points():
    with pytest.raises(CaseError, match="position"):
        df.preset("embedded").with_overrides({"support": [PIN]})
    with pytest.raises(CaseError, match="position"):
        df.preset("paper").with_overrides(
            {"initial": [{"lamina": "thin", "shape": "force", "position": [0.1, 0.0]}]}
        )
