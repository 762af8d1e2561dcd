"""Stops, impactors, supports inside the span and initial states of solids, beside beams."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from mpi_pool import Crew

from delam_fem import CaseError, Result, run
from delam_fem.api import Case, assemble, lowest
from delam_fem.engines.session import ENGINES

L, WIDTH, THICKNESS = 0.5, 0.02, 0.005
LAMINA = {
    "name": "one", "length": L, "width": WIDTH, "thickness": THICKNESS, "mass_per_length": 0.1,
    "bending_stiffness": 10.0, "damping_ratio": 0.01,
}  # fmt: skip
PLANE, SOLID = ({"kind": kind, "poisson": 0.0} for kind in ("plane-stress", "solid"))
STOP = {"lamina": "one", "position": L, "side": "above", "gap": 1e-3}
BLOW = {
    "lamina": "one", "position": 0.8 * L, "side": "above", "mass": 0.01, "velocity": 0.3,
    "gap": 1e-3,
}  # fmt: skip
RIGID = {"law": "newton", "restitution": 0.3, "impulse": "consistent"}
SOFT = {"stiffness": 400.0}
PIN = {"position": 0.4 * L, "kind": "pinned"}
SPRING = {
    "position": 0.63 * L, "kind": "spring", "stiffness": 2e3, "damping": 0.5,
    "rotational_stiffness": 3.0,
}  # fmt: skip
BONDED = {
    "lamina": [LAMINA, LAMINA | {"name": "two", "bending_stiffness": 4.0}],
    "delamination": [
        {"between": ["one", "two"], "start": 0.4 * L, "end": L, "opening": 1e-4, "shape": "power"}
    ],
}


def case_of(model: dict[str, Any], **sections: Any) -> Case:
    data = {
        "name": "solid", "lamina": [LAMINA], "mesh": {"elements": 10}, "model": model,
        "excitation": {"kind": "harmonic", "amplitude": 2e-4, "frequency": 20.0},
        "contact": {"law": "penalty"}, "time": {"steps_per_period": 1000, "periods": 2},
        "output": {"window_periods": 2},
    }  # fmt: skip
    return Case(**(data | sections))


def frequencies(case: Case, n: int = 3) -> np.ndarray:
    o = assemble(case).operators
    return lowest(o.stiffness, o.mass, n)[0]


def tips(result: Result) -> np.ndarray:
    return result.history["tip_displacement"].to_numpy()


@pytest.mark.parametrize(
    ("supports", "sections"),
    [
        ([PIN], {}),
        ([{"position": 0.37 * L, "kind": "clamped"}], {}),
        ([SPRING], {}),
        ([{"start": "pinned", "end": "pinned"}, PIN | {"rotational_stiffness": 5.0}], {}),
        ([{"position": 0.2 * L, "kind": "clamped"}, SPRING | {"lamina": "one"}], BONDED),
        ([{"position": 0.7 * L, "kind": "clamped"}, SPRING | {"position": 0.3 * L}], BONDED),
    ],
    ids=["pin", "clamp", "spring", "pinned ends", "bonded and one", "apart and bonded"],
)
def test_supports_inside_are_those_of_beams(
    supports: list[dict[str, Any]], sections: dict[str, Any]
) -> None:
    """First frequencies: catches what is held or left free along x, and springs counted twice."""
    mesh = {"mesh": {"elements": 40}, "support": supports}
    beam = frequencies(case_of({"kind": "beam"}, **mesh | sections))
    plane = frequencies(case_of(PLANE, **mesh | sections))
    assert plane[0] == pytest.approx(beam[0], rel=8e-3 if sections else 5e-4)
    if not sections:
        coarse = case_of(SOLID, support=supports, mesh={"elements": 20})
        assert frequencies(coarse, 1)[0] == pytest.approx(beam[0], rel=5e-3)


@pytest.mark.parametrize("place", [0.3, 0.7], ids=["bonded", "apart"])
def test_supports_inside_hold_nothing_along_x(place: float) -> None:
    """With free ends the whole slides on a clamp, the bonded laminae as one: of 5 nodes, or 2 × 3
    where they are apart, a clamp holds the turns alone."""
    o, pinned = (
        assemble(
            case_of(PLANE, **BONDED, support=[{"start": "free"}, support | {"position": place * L}])
        ).operators
        for support in ({"kind": "clamped"}, {"kind": "pinned"})
    )
    assert pinned.n_dofs - o.n_dofs == 4
    assert o.near_null is not None
    x, y, _ = o.near_null.T
    assert np.abs(o.stiffness @ x).max() < 1e-12 * np.abs(abs(o.stiffness) @ abs(x)).max()
    assert np.abs(o.stiffness @ y + o.base.stiffness).max() < 1e-12 * abs(o.stiffness).max()


@pytest.mark.parametrize(
    ("sections", "tolerance"),
    [
        ({"stop": [STOP | SOFT]}, 0.02),
        ({"stop": [STOP | SOFT, STOP | SOFT | {"position": 0.57 * L, "on": "ground"}]}, 0.02),
        ({"stop": [STOP | SOFT | {"position": None, "start": 0.5 * L, "end": L}]}, 0.02),
        ({"stop": [STOP | {"side": "both"}], "contact": RIGID}, 0.05),
        ({"impactor": [BLOW | {"stiffness": 1e4}]}, 0.02),
        ({"impactor": [BLOW], "stop": [STOP], "contact": RIGID}, 0.05),
        ({"stop": [STOP | SOFT], "initial": [{"shape": "mode", "displacement": 2e-3}]}, 0.03),
        (
            {
                "initial": [
                    {"lamina": "one", "shape": "force", "position": 0.6 * L, "displacement": 2e-3},
                    {"velocity": 0.01},
                ]
            },
            0.03,
        ),
        ({"support": [PIN, SPRING], "stop": [STOP | SOFT | {"gap": 1e-5}]}, 0.05),
    ],
    ids=["base", "both frames", "stretch", "rigid", "blow", "rigid blow", "mode", "force", "held"],
)
def test_a_solid_moves_as_a_beam(sections: dict[str, Any], tolerance: float) -> None:
    """Both engines agree, the ledger closes, and the tip is that of the beam (rms of two periods).

    A wrong frame, side, sign or start moves the tip by its whole motion.
    """
    (beam,) = tips(run(case_of({"kind": "beam"}, **sections), engine="compiled"))
    results = [run(case_of(PLANE, **sections), engine=name) for name in ENGINES]
    history = results[0].history
    events = history["event_time"].to_numpy()[:10]
    n = int(np.searchsorted(history["time"], events[-1])) if events.size else None
    (first,), (second,) = map(tips, results)
    np.testing.assert_allclose(first[:n], second[:n], rtol=0.0, atol=1e-9)
    assert np.std(first - beam) < tolerance * np.std(beam)
    for result in results:
        assert result.summary["energy_residual"] < 1e-8


def test_fields_of_a_solid_are_in_the_frame_of_the_ground() -> None:
    """Stops on the base change the dofs, not what body and readings give."""
    case = case_of(PLANE, stop=[STOP | {"gap": 1.0}], impactor=[BLOW | {"gap": 1.0}])
    plain, shifted = (assemble(one) for one in (case_of(PLANE), case))
    assert shifted.operators.base.shift is not None and shifted.body and plain.body
    u = np.random.default_rng(1).standard_normal((1, plain.operators.n_dofs))
    w = np.append(u, [[0.0]], axis=1) - 0.3 * shifted.operators.base.shift
    q = np.array([0.3])
    nodes = [one.body.gathered(v, q) for one, v in ((plain, u), (shifted, w))]
    np.testing.assert_allclose(*nodes, atol=1e-12)
    np.testing.assert_allclose(plain.layout.read(u, q), shifted.layout.read(w, q), atol=1e-12)


def test_a_lamina_starts_with_what_is_bonded_to_it() -> None:
    """The mode of the upper lamina leaves the lower one at rest where both are apart."""
    start = [{"shape": "mode", "lamina": "two", "displacement": 1e-4}]
    shapes = []
    for model in ({"kind": "beam"}, PLANE):
        structure = assemble(
            case_of(model, **BONDED, initial=start).with_overrides({"mesh.elements": 40})
        )
        assert structure.operators.start is not None
        read = structure.layout.read(structure.operators.start[:1], np.zeros(1))[0]
        shapes.append([read[p.dofs[1:, 0]] for p in structure.layout.parts])
    (low, up), (of_plane_low, of_plane_up) = shapes
    assert np.abs(up).max() == pytest.approx(1e-4) == np.abs(of_plane_up).max()
    np.testing.assert_allclose(of_plane_up, up, atol=2e-6)
    np.testing.assert_allclose(of_plane_low, low, atol=2e-6)
    assert not low[20:].any() and np.abs(of_plane_low[20:]).max() < 1e-6


ON_RANKS = """
import json
import numpy as np
import delam_fem as df
from delam_fem.cli.endings import ended_together

case = df.Case(**json.loads(arguments[0]))
with ended_together(comm):
    many = df.run(case, comm=comm).history
    if comm.rank == 0:
        one = df.run(case).history
        names = ["tip_displacement", *(name for name in one if str(name).startswith("sensor"))]
        for name in (name for name in names if one[name].dtype.kind == "f"):
            a, b = (np.nan_to_num(history[name].values) for history in (one, many))
            assert np.abs(a - b).max() <= 1e-7 * np.abs(a).max(), name
        assert one.attrs["outcome"] == many.attrs["outcome"] == "completed"
"""
SHORT = {"steps_per_period": 300, "periods": 1}
FEATURES: dict[str, dict[str, Any]] = {
    "supports": {"support": [PIN, SPRING], "contact": {"law": "none"}},
    "stops": {"stop": [STOP | SOFT, STOP | SOFT | {"side": "below", "gap": 5e-4}]},
    "rigid stop": {
        "stop": [STOP | {"gap": 2e-4}], "contact": RIGID,
        "time": SHORT | {"scheme": "moreau-jean"},
    },
    "impactor": {"impactor": [BLOW | SOFT], **BONDED},
    "mode": {"initial": [{"shape": "mode", "mode": 2, "displacement": 1e-4}]},
    "force": {
        "initial": [
            {"shape": "force", "lamina": "one", "position": L, "displacement": 1e-4},
            {"velocity": 0.1},
        ]
    },
}  # fmt: skip
ACCELERATION = {
    "name": "tip", "quantity": "acceleration", "lamina": "one", "position": 0.9 * L
}  # fmt: skip


@pytest.mark.mpi
@pytest.mark.parametrize("feature", list(FEATURES))
def test_ranks_compute_what_one_does(feature: str, crew: Crew) -> None:
    sections = {"time": SHORT, "output": {"window_periods": 1}, **FEATURES[feature]}
    case = case_of(PLANE, **sections, sensor=[ACCELERATION])
    crew.run(2, ON_RANKS, json.dumps(case.model_dump(mode="json", exclude_unset=True)))


def test_what_solids_cannot_give_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mesh from a file may have no node at a support."""
    grid = np.linspace(0.0, L, 8)
    for module in ("assembly", "meshing"):
        monkeypatch.setattr(f"delam_fem.model.solids.{module}.node_coordinates", lambda case: grid)
    with pytest.raises(CaseError, match=r"support\.position: "):
        assemble(case_of(PLANE, support=[PIN]))
