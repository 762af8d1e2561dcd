"""The state of rest under weight and constant loads: its numbers, and its dataset."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.model.layout import Structure, at_stations, nodal
from delam_fem.results.contacts import pairs_of
from delam_fem.system.errors import CaseError


def summary_of(structure: Structure, case: Case) -> dict[str, Any] | None:
    """Return the entry `rest` of a summary (collective where ranks share the dofs).

    Args:
        structure: the structure of the case.
        case: the case.

    Returns:
        Displacements of the probes [m], None where there is no state of rest; the force of each
        contact, positive in compression [N]; the factor on weight and axial forces together at
        which the structure buckles, None if there is none. None: nothing acts all the time.
    """
    if not case.is_loaded:
        return None
    o = structure.operators
    equilibrium = o.equilibrium
    u = np.zeros(o.n_own) if equilibrium is None else equilibrium.displacement
    probes = o.total(o.probes @ u)[: len(structure.layout.parts)].tolist()
    forces = np.zeros(o.n_pairs) if equilibrium is None else equilibrium.force
    return {
        "tip_displacement": probes if o.load is None or equilibrium is not None else None,
        "contact_force": {
            name: float(forces[pairs].sum())
            for name, pairs in pairs_of(structure.layout, case).items()
        },
        "buckling_factor": getattr(o, "buckling_factor", None),
    }


def rows_of(structure: Structure, case: Case) -> list[tuple[str, str]]:
    """Return what the state of rest is in words, as rows of a table: label and text."""
    summary = summary_of(structure, case)
    if summary is None:
        return []
    tips = summary["tip_displacement"]
    if tips is None:
        return [("at rest", "there is no state of rest: something that nothing holds falls")]
    pairs = zip(structure.layout.names, tips, strict=True)
    rows = [("at rest", ", ".join(f"{name} {1e3 * tip:+.4g} mm" for name, tip in pairs))]
    forces = summary["contact_force"]
    pressed = [f"{name} by {force:.4g} N" for name, force in forces.items() if force > 0.0]
    if forces:
        rows.append(("pressed together", ", ".join(pressed) or "nothing"))
    o = structure.operators
    if o.n_pairs and o.equilibrium is not None:
        gap = o.gap_matrix @ o.equilibrium.displacement + o.gap0
        texts = [
            f"{name} {1e3 * gap[numbers].min():.4g} to {1e3 * gap[numbers].max():.4g} mm"
            for name, numbers in pairs_of(structure.layout, case).items()
        ]
        rows.append(("gaps in place", ", ".join(texts)))
    if summary["buckling_factor"] is not None:
        words = f"at {summary['buckling_factor']:.4g} times its weight and axial forces"
        rows.append(("buckles", words))
    return rows


def dataset_of(structure: Structure, case: Case) -> xr.Dataset:
    """Return the state of rest of a structure as a dataset.

    Args:
        structure: the structure of the case.
        case: the case.

    Returns:
        `displacement(lamina, x)` from the unloaded shape, `gap(pair)` and `contact_force(pair)`
        with the names of their contacts, and the entries of `summary_of` as attributes.

    Raises:
        CaseError: nothing acts all the time, or there is no state of rest.
    """
    if not case.is_loaded:
        raise CaseError("rest: expected [gravity] or [[load]], given neither: nothing moves")
    o, layout = structure.operators, structure.layout
    if o.load is not None and o.equilibrium is None:
        raise CaseError("rest: something that nothing holds falls, so that there is none")
    u = np.zeros(o.n_dofs) if o.equilibrium is None else o.equilibrium.displacement
    force = np.zeros(o.n_pairs) if o.equilibrium is None else o.equilibrium.force
    shape = at_stations(layout, *nodal(layout, u[None], np.zeros(1)))[0][:, 0]
    names = np.full(o.n_pairs, "", dtype=object)
    for name, pairs in pairs_of(structure.layout, case).items():
        names[pairs] = name
    entries = summary_of(structure, case) or {}
    buckling = entries["buckling_factor"]
    return xr.Dataset(
        {
            "displacement": (
                ("lamina", "x"),
                shape,
                {"units": "m", "long_name": "displacement at rest from the unloaded shape"},
            ),
            "gap": ("pair", o.gap_matrix @ u + o.gap0, {"units": "m", "long_name": "gap at rest"}),
            "contact_force": (
                "pair",
                force,
                {"units": "N", "long_name": "contact force at rest, positive in compression"},
            ),
            "contact": ("pair", names.astype(str), {"units": "", "long_name": "contact"}),
        },
        coords={
            "lamina": list(layout.names),
            "x": ("x", layout.parts[0].positions(layout.stations), {"units": "m"}),
        },
        attrs={} if buckling is None else {"buckling_factor": buckling},
    )
