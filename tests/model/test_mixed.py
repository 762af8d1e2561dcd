"""Models of unlike laminae in full: operators, layout, modes, responses, reductions, stresses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import golden
import numpy as np
import pytest
import scipy.sparse as sp
from mixed import BARS, BEAMS, FORCE, IMPACTORS, INNER, SOLIDS, STOPS, apart, bonded

from delam_fem.case.definition import Case
from delam_fem.model import layout as layouts
from delam_fem.model import linear, modal, reduced, reduction
from delam_fem.model.beams import closed_form, forms
from delam_fem.model.beams.network import network
from delam_fem.model.layout import Layout, Structure
from delam_fem.model.solids.assembly import assemble

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
            "damping": found.damping, "part": found.part, "creep": found.creep,
            "gap modes": np.abs(found.gap_modes), "compliance": found.compliance,
            "gap0": found.gap0, "gap drive": found.gap_drive, "loads": np.abs(found.loads),
            "base mass": found.base_mass, "shapes": np.abs(found.shapes),
            "residual": found.residual, "drive": found.drive, "frequencies": found.frequencies,
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
    """Return the motions that keep all pairs closed, as what they do to a vector."""
    S = linear.keeping_closed(structure)
    return np.asarray(S @ (S.T @ waves(structure.operators.n_dofs)))
