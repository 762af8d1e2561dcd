"""Sensors as linear functionals of the state, of the base and of the contact forces.

With r the row that evaluates a deflection at the place of the sensor, a signal is

    displacement   r u + r_b q          velocity   r v + r_b q'
    acceleration   r a + r_b q'',   a = M⁻¹ (-K u - C v - m q'' - c q' - k q + H^T λ)           (A1)
    strain         a functional of u; see `StrainRows`
    contact force  Σ λ_k of the pairs of an interface

A1 is the equation of motion: at the end of a step of Newmark's scheme it is the scheme's own
acceleration. λ_k are the forces of springs, and the impulses of a step over the time step: their
mean force. An impulse acts through the matrix of the law, M or the lumped mass.

`simulation/signals.py` puts the signals together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from delam_fem.case.definition import Case
from delam_fem.case.sections import Sensor
from delam_fem.model.layout import (
    CURVATURE,
    Layout,
    SensorRows,
    Structure,
    cells_at,
    columns_of,
    place_of,
)
from delam_fem.model.operators import Operators
from delam_fem.numerics.types import FloatArray

StrainRows = Callable[[int, float, float], sp.csr_matrix]
"""Function (number of the lamina, place as a number of points, side: 1 top, -1 bottom) -> strain of
the surface as a row in free dofs and base, shape (1, n + 1)."""


def with_sensors(structure: Structure, case: Case, strain: StrainRows | None = None) -> Structure:
    """Return the structure with the sensors of its case.

    Args:
        structure: the structure of the case, with its drive.
        case: the case.
        strain: strains of surfaces; None: those of laminae that are apart, -s h/2 w'' with s = 1
            at the top, at a point between two cells the mean of both.
    """
    o, layout = structure.operators, structure.layout
    if not (case.sensor or layout.n_impactors):
        return structure
    if strain is None:
        strain = _of_single_laminae(case, layout, o.n_dofs)
    rows = [*np.eye(layout.n_impactors, o.n_dofs, o.n_dofs - layout.n_impactors)]
    sensors = tuple(
        replace(_sensor(own, case, structure, strain, rows), unit=own.unit, words=own.words)
        for own in case.sensor
    )
    blocks = [sp.csr_matrix(np.array(rows).reshape(len(rows), o.gap_matrix.shape[1]))]
    needs_gaps = any(sensor.of_forces is not None for sensor in sensors)
    if needs_gaps:
        blocks.append(o.gap_matrix)
    return replace(
        structure,
        operators=replace(o, sensors=sp.vstack(blocks, format="csr")),
        layout=replace(layout, sensors=sensors, gap_row=len(rows) if needs_gaps else None),
    )


def _sensor(
    own: Sensor, case: Case, structure: Structure, strain: StrainRows, rows: list[FloatArray]
) -> SensorRows:
    """Return what a sensor reads; append its functionals to `rows`."""
    o, layout = structure.operators, structure.layout
    if own.quantity == "contact force":
        of_pairs = np.zeros(o.n_pairs)
        number = own.stop or (own.impactor and len(case.stop) + own.impactor)
        for stop in layout.stops:
            if stop.number + 1 == number:
                of_pairs[stop.pairs] = 1.0
        for interface in layout.interfaces:
            if tuple(layout.names[part] for part in interface.parts) == own.between:
                of_pairs[interface.pairs] = 1.0
        return SensorRows(
            own.name,
            None,
            None,
            of_forces=of_pairs,
            of_impulses=of_pairs,
            of_lumped_impulses=of_pairs,
        )
    assert own.lamina is not None and own.position is not None  # all but contact forces
    number = layout.names.index(own.lamina)
    part = layout.parts[number]
    place = place_of(part, own.position)
    if own.quantity == "strain":
        row = strain(number, place, -1.0 if own.surface == "bottom" else 1.0)
    else:
        row = layout.of_dofs(columns_of(part, place, layout.n_numbered(o.n_dofs)))
    of_dofs, of_base = row.toarray()[0, :-1], 0.0 if o.base.is_force else float(row[0, -1])
    if own.quantity == "acceleration":
        return _acceleration(own.name, o, of_dofs, of_base, rows)
    rows.append(of_dofs)
    if own.quantity == "velocity":
        return SensorRows(own.name, None, len(rows) - 1, (0.0, of_base, 0.0))
    return SensorRows(own.name, len(rows) - 1, None, (of_base, 0.0, 0.0))


def _acceleration(
    name: str, o: Operators, row: FloatArray, of_base: float, rows: list[FloatArray]
) -> SensorRows:
    """Return what a sensor of an acceleration reads (A1), with y = M⁻¹ rᵀ."""
    y = splu(sp.csc_matrix(o.mass)).solve(row)
    rows += [-(o.stiffness.T @ y), -(o.damping.T @ y)]
    base = (-o.base.stiffness @ y, -o.base.damping @ y, of_base - o.base.mass @ y)
    of_pairs = np.asarray(o.gap_matrix @ y)
    lumped = o.mass.diagonal() if o.lumped_mass is None else o.lumped_mass
    return SensorRows(
        name,
        len(rows) - 2,
        len(rows) - 1,
        (float(base[0]), float(base[1]), float(base[2])),
        of_forces=of_pairs,
        of_impulses=of_pairs,
        of_lumped_impulses=np.asarray(o.gap_matrix @ (row / lumped)),
    )


def _of_single_laminae(case: Case, layout: Layout, n: int) -> StrainRows:
    """Return the strains of laminae that bend about their own middles."""
    numbered = layout.n_numbered(n)

    def rows(lamina: int, place: float, side: float) -> sp.csr_matrix:
        part = layout.parts[lamina]
        cells = cells_at(part, place)
        bends = [columns_of(part, place, numbered, CURVATURE, cell) for cell in cells]
        mean = layout.of_dofs(sum(bends) / len(cells))
        return sp.csr_matrix(-0.5 * side * case.lamina[lamina].thickness * mean)

    return rows
