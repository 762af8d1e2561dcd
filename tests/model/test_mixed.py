"""Models of unlike laminae in full: operators, layout, modes, responses, reductions, stresses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import golden
import numpy as np
import pytest
import scipy.sparse as sp
from mixed import BARS, BEAMS, FORCE, IMPACTORS, INNER, SOLIDS, STOPS, apart, bonded

from delam_fem.case.definition import Case
from delam_fem.case.files import load_case
from delam_fem.case.sections import EDGE_TOLERANCE
from delam_fem.model import layout as layouts
from delam_fem.model import linear, modal, operators, reduced, reduction
from delam_fem.model.beams import closed_form, forms
from delam_fem.model.beams.network import network, opening
from delam_fem.model.layout import Layout, Structure
from delam_fem.model.solids.assembly import assemble
from delam_fem.system.errors import CaseError
from delam_fem.system.files import read_arrays, write_arrays
from delam_fem.system.mpi import MPI

Check = Callable[..., None]


def waves(*shape: int) -> np.ndarray:
    """Return numbers without a pattern."""
    return np.cos(np.arange(np.prod(shape)) ** 1.3 + 0.2).reshape(shape)


def of_layout(layout: Layout, n: int) -> dict[str, Any]:
    """Return what follows from a layout."""
    u, phi = layouts.nodal(layout, waves(3, n), np.array([0.7, -0.2, 1.1]))
    touching = layout.touching
    n_pairs = sum(own.places.size for own in touching)
    states = (10.0 * waves(2, n_pairs)).astype(np.int64)
    return {
        "x": layout.x,
        "names": list(layout.names),
        "own": [layout.own_dofs(k) for k in range(len(layout.parts))],
        "stations": layout.stations,
        "of points": [layout.station_of_point(k) for k in range(layout.x.size)],
        "of pairs": [layout.stations_of(own) for own in touching],
        "states": [layout.at_stations(own, states) for own in touching],
        "values": [layout.at_stations(own, waves(2, n_pairs)) for own in touching],
        "nodal": [u, phi],
        "between": list(layouts.at_stations(layout, u, phi)),
        "moment": layouts.bending_moment(layout, u, phi),
        "tributary": [layouts.tributary_lengths(layout.parts, own) for own in layout.interfaces],
    }


def of_modes(case: Case, structure: Structure) -> dict[str, Any]:
    """Return what vibrates."""
    o = structure.operators
    n_rigid = case.n_rigid + sum(own.spring == 0.0 for own in case.impactor)
    is_floating = bool(n_rigid)
    found, vectors = linear.lowest(o.stiffness, o.mass, 5, is_floating=is_floating)
    S = linear.kept_closed(structure.layout, o.n_dofs)
    U = linear.response(o, 23.7)
    return {
        "frequencies": found[n_rigid:],
        "modes": np.abs(linear.normalised(vectors, o.mass))[:, n_rigid:],
        "closed": S,
        "response": U,
        "closed response": linear.response(o, 41.0, S),
        "start": linear.at_start(U, 23.7),
        "decay": linear.slowest_decay(o, is_floating=is_floating),
        "step": [
            linear.largest_stable_time_step(o),
            linear.largest_stable_time_step(o, 4e3, 1.7),
        ],
    }


@pytest.mark.parametrize("name", BEAMS)
def test_beams_are_the_stored_ones(name: str, stored: Check) -> None:
    """The weak forms and the closed forms are both what is stored."""
    case = BEAMS[name]
    for assemble_beams in (closed_form.assemble, forms.assemble):
        structure = assemble_beams(case)
        o = replace(structure.operators, near_null=None)
        stored(golden.of_object(replace(structure, operators=o)))
    found = of_layout(structure.layout, structure.operators.n_dofs) | of_modes(case, structure)
    stored(golden.of_object(found), ".derived")


@pytest.mark.parametrize("name", BARS)
def test_bars_and_points_are_the_stored_ones(name: str, stored: Check) -> None:
    structure = closed_form.assemble(BARS[name])
    stored(golden.of_object(structure))


def test_unknowns_are_the_stored_ones(stored: Check) -> None:
    case = bonded(support=[{"start": "free", "end": "clamped"}], delamination=INNER)
    stack = network(case, np.array([0.0, 0.03, 0.08, 0.2, 0.24, 0.29, 0.46, 0.5]))
    groups = list(stack.groups())
    found = {
        "network": {"dofs": stack.dofs, "x": stack.x, "n": [stack.n_free, stack.n_axial]},
        "axial": {str(k): v for k, v in stack.axial.items()},
        "segments": [[own.first, own.last, own.nodes] for own in stack.segments],
        "groups": [repr(own) for _, own in groups],
        "sections": [stack.section(own) for _, own in groups],
        "axes": [stack.neutral_axis(own) for _, own in groups],
        "middles": stack.middles,
        "ties": [bool(stack.ties(own, case)) for own in stack.segments],
        "clusters": [repr(stack.cluster(n, i)) for n in range(8) for i in range(3)],
        "rows": stack.matrix(
            [stack.row(n, i, c) for n in (0, 4, 7) for i in (0, 2) for c in (0, 1)]
        ),
        "axial rows": stack.matrix(
            [stack.axial_row(n, g) for s, g in groups for n in (s.first, s.last)]
        ),
    }
    stored(golden.of_object(found))


def test_openings_reach_as_far_as_round_off(stored: Check) -> None:
    case = bonded(stop=[], impactor=[], sensor=[])
    layout = closed_form.assemble(case).layout
    off = 0.5 * EDGE_TOLERANCE * np.array([-1.5, -0.9, 0.9, 1.5])
    edge = 0.5 + off  # the free end, where the opening is largest
    found = [opening(case, layout, own, x) for own in layout.interfaces for x in (edge, 0.2 + off)]
    assert (np.array(found[2]) > 0.0).tolist() == [True, True, True, False]
    stored(golden.of_object([[*own, opening(case, layout, layout.interfaces[0], np.array([0.1]))[0]]
                             for own in found]))  # fmt: skip


def test_bases_are_the_stored_ones(stored: Check) -> None:
    """Signs of modes are arbitrary; products of them are not."""
    case = apart(impactor=IMPACTORS[1:])
    structure = closed_form.assemble(case)
    lines = []
    for name, basis in {
        "all": modal.basis_of(structure.operators, 3),
        "few": modal.basis_of(structure.operators, 2, most=17),
        "loads": modal.basis_of(structure.operators, 1, loads=sp.csr_matrix(waves(2, 37))),
        "shifted": modal.basis_of(structure.operators, 3, shift=300.0),
    }.items():
        small = modal.projected(structure, basis)
        o = small.operators
        told = {
            "squares": basis.squares, "is mode": basis.is_mode, "body": basis.body,
            "of dof": basis.body_of_dof, "dropped": basis.dropped, "lowest": basis.lowest,
            "error": basis.compliance_error if basis.compliance_error > 1e-6 else 0.0,
            "damping": np.abs(basis.damping),
            "flexibility": o.gap_matrix @ sp.diags(1.0 / basis.squares) @ o.gap_matrix.T,
            "response": o.probes @ linear.response(o, 19.0),
            "modes": np.abs(basis.vectors[:, basis.is_mode]),
            "part": small.layout.reading.part if small.layout.reading else None,
            "corner": o.base.corner,
        }  # fmt: skip
        lines.append(golden.of_object(told, name))
    stored("\n".join(lines))


def test_modes_with_massless_contact_points_are_the_stored_ones(stored: Check) -> None:
    pushed = bonded(excitation=FORCE, stop=[], impactor=[])
    for suffix, case in {"": apart(impactor=[], stop=STOPS[1:2]), ".force": pushed}.items():
        structure = closed_form.assemble(case)
        found = reduced.reduce(structure.operators, 4)
        n, pairs = found.n_modes, found.n_pairs
        q = found.displacement(waves(2, n), waves(2, found.n_parts, pairs), np.array([0.3, -0.8]))
        parts = {
            "n": [n, pairs, found.n_parts, found.n_state], "squares": found.squares,
            "damping": found.damping, "creep": found.creep,
            "gap modes": np.abs(found.gap_modes), "compliance": found.compliance,
            "gap0": found.gap0, "gap drive": found.gap_drive, "loads": np.abs(found.loads),
            "base mass": found.base_mass, "shapes": np.abs(found.shapes),
            "residual": found.residual, "drive": found.drive,
            "rest": found.displacement(0.0 * waves(2, n), waves(2, found.n_parts, pairs),
                                       np.array([0.3, -0.8])),
            "rate": found.velocity(0.0 * waves(2, n), np.array([0.3, -0.8])),
            "moves": float(np.ptp(q)) > 0.0,
        }  # fmt: skip
        stored(golden.of_object(parts), suffix)


def test_a_reduction_is_the_stored_one(stored: Check) -> None:
    case = bonded(support=[{"start": "clamped", "end": "free"}])
    made = reduction.reduced_case(case, 4, coordinates=21)
    o = made.structure.operators
    found = {
        "frequencies": made.frequencies, "highest": [made.highest_mode, made.highest],
        "dropped": made.basis.dropped, "n": o.n_dofs, "gap0": o.gap0, "corner": o.base.corner,
        "flexibility": o.gap_matrix @ sp.diags(1.0 / made.basis.squares) @ o.gap_matrix.T,
        "response": o.probes @ linear.response(o, 31.0),
        "strains": np.abs(made._strains()),
    }  # fmt: skip
    stored(golden.of_object(found))


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_the_stored_ones(name: str, stored: Check) -> None:
    structure = assemble(SOLIDS[name])
    stored(golden.of_object(structure))
    body, o, layout = structure.body, structure.operators, structure.layout
    assert body is not None
    r = o.base.shift if o.base.shift is not None else np.zeros(o.n_dofs)
    n = body.free.shape[1]
    shape = body.shape()
    u = body.gathered(waves(2, n), np.array([0.4, -1.3]))
    found = {
        "n": [o.n_dofs, layout.n_impactors, r.size, body.is_first],
        "gathered": u,
        "moving": [body.moving(SOLIDS[name], [k]) for k in range(len(layout.parts))],
        "nodes": shape.nodes, "cells": shape.cells, "node": shape.node, "lamina": shape.lamina,
        "reference": shape.reference_nodes, "points": shape.points,
        "stress": shape.recovery.stress(u[0]), "pressing": list(shape.pressing),
    }  # fmt: skip
    found |= of_layout(layout, o.n_dofs)
    found["closed"] = None if n > linear.DENSE_DOFS * 3 else of_closed(structure)
    stored(golden.of_object(found), ".derived")


def of_closed(structure: Structure) -> np.ndarray:
    """Return the motion nearest to a vector that keeps all pairs closed, whatever spans them."""
    S = linear.keeping_closed(structure).toarray()
    return np.asarray(S @ np.linalg.lstsq(S, waves(structure.operators.n_dofs), rcond=None)[0])


def test_a_reduction_comes_back_as_stored(stored: Check, tmp_path: Path) -> None:
    """With stops, impactors, sensors and an initial state, and what may not differ."""
    case = bonded(initial=[{"lamina": "mid", "shape": "force", "position": 0.3,
                            "displacement": 1e-4}])  # fmt: skip
    _, path = reduction.reduced_case(case, 5).save(tmp_path)
    given = load_case(path)
    structure = reduction.load(given)
    o, layout = structure.operators, structure.layout
    n = o.n_dofs - layout.n_impactors
    K = o.stiffness[:n, :n].tocsc()
    compliance = sp.linalg.spsolve(K, o.gap_matrix[:, :n].T.tocsc())
    assert o.start is not None
    found = {
        "gap0": o.gap0, "weights": o.pair_weights, "n": [o.n_dofs, o.n_pairs, layout.n_impactors],
        "flexibility": o.gap_matrix[:, :n] @ compliance, "corner": o.base.corner,
        "sensors": layout.sensors, "parts": layout.parts, "interfaces": layout.interfaces,
        "stops": layout.stops, "probes": layout.probes,
        "read": (o.sensors[:, :n] @ compliance)[:2], "at probes": o.probes[:, :n] @ compliance,
        "start": o.gap_matrix @ o.start.T, "base": np.linalg.norm(o.base.mass),
    }  # fmt: skip
    lines = [golden.of_object(found)]
    for keys in (
        {"lamina.mid.thickness": 0.0021}, {"support.end": "clamped"}, {"mesh.elements": 15},
        {"delamination.1.end": 0.3}, {"damping.rayleigh": "mass"}, {"time.mass": "lumped"},
        {"point_mass.1.mass": 0.3}, {"stop.1.position": 0.46}, {"impactor.1.position": 0.3},
        {"contact.points_per_element": 2}, {"sensor.4.position": 0.24},
        {"sensor.4.surface": "top"}, {"sensor.4.lamina": "low"}, {"stop.1.gap": 1e-3},
        {"delamination.1.opening": 3e-4}, {"initial": []},
        {"excitation": FORCE}, {"name": "another"}, {"contact.penalty_stiffness": 1e3},
    ):  # fmt: skip
        try:
            changed = reduction.load(given.with_overrides(keys)).operators
            lines.append(golden.of_object(changed.gap0, str(keys)))
        except CaseError as error:
            lines.append(str(error).replace(str(tmp_path), "folder"))
    arrays = read_arrays(path.with_name(reduction.NAME))
    for name, value in {
        "format": np.array(7), "squares": -arrays["squares"], "strains": arrays["strains"][:, 1:],
        "readings": arrays["readings"][1:], "reading_part": arrays["reading_part"][1:],
        "H": arrays["H"] * np.nan, "gap0": np.array([object()], dtype=object).astype("S"),
    }.items():  # fmt: skip
        write_arrays(path.with_name(reduction.NAME), arrays | {name: value})
        with pytest.raises(CaseError) as raised:
            reduction.load(given)
        lines.append(str(raised.value).replace(str(tmp_path), "folder"))
    stored("\n".join(lines))


def test_masses_at_middles_are_the_stored_ones(stored: Check) -> None:
    h = np.array([0.1, 0.13, 0.09, 0.12, 0.11, 0.1, 0.14])
    found: dict[str, Any] = {}
    for n in (1, 2, 3, 4, 5, 7):
        for is_tied in (False, True):
            masses = closed_form.middle_masses(h[:n] * 3.0, h[:n], is_tied=is_tied)
            x = np.cumsum(h[:n]) - 0.5 * h[:n]
            found[f"{n} {is_tied}"] = [masses, [masses.sum(), masses @ x, masses @ x**2]]
            M, K, lumped = closed_form.beam(2.0, 3.0, h[:n], at_middles=True, is_tied=is_tied)
            found[f"beam {n} {is_tied}"] = [M, K, lumped]
    found["elements"] = [
        closed_form.element_stiffness([2.0, 3.0], [0.4, 0.7]),
        closed_form.element_mass([2.0, 3.0], [0.4, 0.7]),
        closed_form.element_lumped_mass([2.0, 3.0], [0.4, 0.7]),
    ]
    lines = [golden.of_object(found)]
    with pytest.raises(CaseError) as raised:
        closed_form.middle_masses(np.array([9.0, 0.1, 0.1]), np.array([9.0, 0.1, 0.1]))
    lines.append(str(raised.value))
    for x in ([0.1, 0.5], [0.0, 0.51], [0.0, 0.2, 0.49], [0.0, 0.2, 0.5 + 4e-10]):
        try:
            made = closed_form.assemble(apart(stop=[], impactor=[], sensor=[]), x)
            lines.append(f"{made.operators.n_dofs} dofs")
        except CaseError as error:
            lines.append(str(error))
    stored("\n".join(lines))


def test_shares_of_one_rank_are_the_stored_ones(stored: Check) -> None:
    structure = closed_form.assemble(BEAMS["apart, lumped"])
    n = structure.operators.n_dofs
    o = replace(
        structure.operators, near_null=waves(n, 3), rayleigh=(1.0 + waves(n), 2.0 + waves(n)),
        names=("a", "b"),
    )  # fmt: skip
    share = operators.spread(o, MPI.COMM_SELF)
    told: dict[str, Any] = {
        "n": [share.n_dofs, share.n_own, share.n_pairs, share.n_probes, share.n_sensors],
        "own": repr(share.own), "base": share.base, "gap": [share.gap_matrix, share.gap0],
        "lumped": share.lumped_mass, "weights": share.pair_weights, "probes": share.probes,
        "sensors": share.sensors, "rayleigh": share.rayleigh, "names": list(share.names),
        "is": [share.is_uncoupled, share.is_shared_order], "shift": share.probe_shift,
        "whole": operators.whole(waves(2, 5), MPI.COMM_SELF), "observed": o.observed,
    }  # fmt: skip
    for name in ("mass", "damping", "stiffness"):
        own = getattr(share, name)
        told[name] = sp.csr_matrix(own.getValuesCSR()[::-1], own.getSize())
    vectors = share.stiffness.getNearNullSpace().getVecs()
    told["near"] = [np.abs(v.array) for v in vectors]
    held = np.where(np.arange(n) % 5 == 1, np.arange(n) % 2, np.nan)
    H = sp.csr_matrix(o.gap_matrix.multiply(np.isnan(held)))
    for name, damping in (("rayleigh", (0.3, 2e-4)), ("own", share.damping)):
        back = operators.Operators.from_petsc(
            share.mass, damping, share.stiffness, gap=(H, o.gap0), base=held,
            probes={"p": waves(1, n), "q": waves(2, n)[1:]},
        )  # fmt: skip
        told[name] = replace(back, near_null=None)
        told[f"{name} near"] = np.abs(back.near_null) if back.near_null is not None else None
    told["without"] = o.without_contact()
    lines = [golden.of_object(told)]
    for base in (held[1:], np.where(np.arange(n) == n - 2, 1.0, np.nan)):
        with pytest.raises(CaseError) as raised:
            operators.Operators.from_petsc(
                share.mass, (0.0, 0.0), share.stiffness, gap=(o.gap_matrix, o.gap0), base=base
            )
        lines.append(str(raised.value))
    bad = {
        "mass": o.mass.toarray(), "damping": o.damping[:3], "gap0": o.gap0[1:],
        "stiffness": o.stiffness * np.nan, "lumped_mass": waves(n - 1), "probes": o.probes[:, 2:],
        "pair_weights": waves(2), "names": ("a",), "start": waves(3, n),
    }  # fmt: skip
    for name, value in {**bad, " mass": o.mass * -1.0}.items():
        try:
            replace(o, **{name.strip(): value})
            lines.append(f"{name}: accepted")
        except (CaseError, ValueError) as error:
            lines.append(" ".join(str(error).split())[:200])
    stored("\n".join(lines))


@pytest.mark.parametrize("kind", ["ball", "soft"])
def test_curved_impactors_are_the_stored_ones(kind: str, stored: Check) -> None:
    own = {"lamina": "low", "mass": 0.03, "position": 0.21, "velocity": 0.6, "gap": 1e-4}
    own |= {"radius": 0.007} if kind == "ball" else {"stiffness": 4e3, "damping": 0.4}
    contact = {"law": "penalty", "penalty_stiffness": 3e3}
    stop = [STOPS[0] | {"damping": 0.0}]
    if kind == "soft":
        contact, stop = contact | {"penalty_damping": 0.3}, STOPS[:1]
    structure = closed_form.assemble(apart(impactor=[own], stop=stop, contact=contact))
    stored(golden.of_object(structure.operators))
