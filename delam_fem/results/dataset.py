"""Turn the record of a run into one dataset, and into groups that share a long dimension.

The whole dataset cannot become one table, because its dimensions do not go together. Each group can
(`to_dataframe()`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.case.excitation import place_in_words, places_of
from delam_fem.model import layout as fields
from delam_fem.model.beams.network import opening
from delam_fem.model.layout import Layout, Structure
from delam_fem.model.places import scanned_places
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.results import contacts
from delam_fem.results.schema import (
    CONTACT,
    FORCE_PLACE,
    INTERFACE,
    SENSOR,
    add,
    provenance,
    with_sensor,
)
from delam_fem.simulation.recorder import LEDGER, Recorder
from delam_fem.simulation.signals import frames_of, signals, steps_of


def history(
    recorder: Recorder, structure: Structure, case: Case, attributes: Mapping[str, str]
) -> xr.Dataset:
    """Return the record of a run as a dataset with the variables `schema.VARIABLES`.

    Args:
        recorder: recorder of the run, after at least one period.
        structure: gives the parts, interfaces and probes. The first probes are the reference
            probes, one for each part; the dataset shows them as tip_….
        case: the case that was computed.
        attributes: attributes of the dataset beside case and versions.
    """
    layout = structure.layout
    gap0 = structure.operators.gap0
    start = (recorder.n_closed - len(recorder.window)) * recorder.steps_per_period
    n = len(layout.parts)
    names: dict[str, list[str]] = {"lamina": list(layout.names)}
    if len(layout.interfaces) != 1:
        names["interface"] = [interface.name for interface in layout.interfaces]
    if recorder.n_forces:
        places = [place_in_words(one) for one, *_ in places_of(case.excitation)]
        names[FORCE_PLACE] = places[0 if recorder.is_forced else 1 :]
    u, v, base = (rows[1:] for rows in steps_of(recorder))
    variables = _of_motion(recorder, u[:, :n], v[:, :n], base)
    if probes := layout.probes[n:]:
        columns = slice(n, len(layout.probes))  # those of sensors follow
        names["probe"] = [probe.name for probe in probes]
        variables |= {
            "probe_displacement": u[:, columns].T,
            "probe_velocity": v[:, columns].T,
            "probe_lamina": [probe.part for probe in probes],
            "probe_node": [layout.station_of_point(probe.point) for probe in probes],
        }
    variables |= _of_periods(recorder, n)
    x = layout.parts[0].positions(layout.stations)
    observed = layout.probes[0].point
    variables |= {"x": x, "tip_node": layout.station_of_point(observed)}
    if not case.has_one_length:
        variables["end"] = [lamina.length for lamina in case.lamina]
    at_rest = _of_interfaces(layout, gap0, are_gaps=True)
    for row, interface in zip(np.atleast_2d(at_rest), layout.interfaces, strict=True):
        alone = np.delete(np.arange(x.size), layout.stations_of(interface))  # clamps, stops
        row[alone] = opening(case, layout, interface, x[alone])
    weights = structure.operators.pair_weights
    shares = np.ones(gap0.size) if weights is None else weights
    variables |= {"gap0": at_rest, "spring_share": _of_interfaces(layout, shares)}
    if stops := layout.stops:  # their contact points have the dimension `stop`
        sizes = [s.places.size for s in stops]
        points = np.concatenate([s.places for s in stops])
        variables |= {
            "stop_number": np.repeat([s.number + 1 for s in stops], sizes),
            "stop_lamina": np.repeat([s.part for s in stops], sizes),
            "stop_node": np.searchsorted(layout.stations, points),
            "stop_height": np.concatenate([s.side * gap0[s.pairs] for s in stops]),
            "stop_on_base": np.repeat([s.on_base for s in stops], sizes),
        }
    if layout.n_impactors:
        o = structure.operators
        columns = slice(o.n_probes, o.n_probes + layout.n_impactors)
        shift = np.zeros(layout.n_impactors)
        if o.base.shift is not None:
            at = o.last_dofs(layout.n_impactors)
            shift[: len(at)] = o.base.shift[at]
        shift = o.total(shift)
        variables |= {
            "impactor_displacement": (u[:, columns] + base[:, :1] * shift).T,
            "impactor_velocity": (v[:, columns] + base[:, 1:2] * shift).T,
        }
    variables |= _of_frames(recorder, structure, case, start)
    variables |= _of_events(recorder, layout, start)
    if not case.is_massless:  # there impacts take no energy
        # the mean power that impacts and contact dampers take at each pair over the window
        heat = np.sum([record.damped for record in recorder.window], axis=0)
        np.subtract.at(heat, recorder.impacts().hit, variables["event_energy"])
        heat /= len(u) * recorder.time_step
        variables["heat"] = _of_interfaces(layout, heat)
        if layout.stops:
            variables["stop_heat"] = heat[layout.stops[0].first_pair :]
    if forces := contacts.histories(recorder, structure, case, of_springs=True):
        names[CONTACT] = list(forces)
        variables["contact_force"] = np.array([force for _, force in forces.values()])
    data = xr.Dataset(coords=names)
    add(data, **variables)  # at once: one by one takes several times as long
    data = data.set_coords("x")
    for signal in signals(recorder, structure, case):
        data = with_sensor(data, signal)
    data.attrs = {
        "title": f"clapping laminae: {case.name}",
        "case": case.to_toml(),
        **provenance(),
        **attributes,
    }
    return data


def of_probes(
    recorder: Recorder, names: Sequence[str], attributes: Mapping[str, str]
) -> xr.Dataset:
    """Return the record of a run without a case as a dataset; all its probes are reference probes.

    Args:
        recorder: recorder of the run, after at least one period.
        names: names of the probes.
        attributes: attributes of the dataset beside versions.
    """
    start = (recorder.n_closed - len(recorder.window)) * recorder.steps_per_period
    data = xr.Dataset(coords={"lamina": list(names)})
    if recorder.n_forces:
        n_places = recorder.n_forces + recorder.is_forced
        data = data.assign_coords({FORCE_PLACE: [f"force {k + 1}" for k in range(n_places)]})
    n = len(names)
    u, v, base = (rows[1:] for rows in steps_of(recorder))
    variables = _of_motion(recorder, u[:, :n], v[:, :n], base)
    variables |= _of_periods(recorder, n)
    variables |= _of_events(recorder, None, start)
    steps, frames, _, _ = frames_of(recorder)
    if frames:
        u, v = np.array(frames).swapaxes(0, 1)
        times = (start + steps) * recorder.time_step
        variables |= {"frame": times, "dof_displacement": u, "dof_velocity": v}
    add(data, **variables)
    data.attrs = {**provenance(), **attributes}
    return data


def _of_motion(
    recorder: Recorder, u: FloatArray, v: FloatArray, base: FloatArray
) -> dict[str, Any]:
    """Return the motion of reference probes, and of what drives.

    Args:
        recorder: recorder of the run.
        u: displacements of the probes at the steps of the window, shape (k, n) [m].
        v: their velocities, likewise [m/s].
        base: values and derivatives of the drives there; see `steps_of`.
    """
    first_step = (recorder.n_closed - len(recorder.window)) * recorder.steps_per_period + 1
    variables = {
        "time": (first_step + np.arange(len(u))) * recorder.time_step,
        "tip_displacement": u.T,
        "tip_velocity": v.T,
        "base_displacement": np.zeros(len(u)) if recorder.is_forced else base[:, 0],
    }
    forces = base[:, 0 if recorder.is_forced else 3 :: 3].T
    if forces.size:
        variables["force"] = forces[0]
    if recorder.n_forces:
        variables["forces"] = forces
    return variables


def _of_periods(recorder: Recorder, n_parts: int) -> dict[str, Any]:
    """Return strobes, envelopes, impulses and energies of every period."""
    k = recorder.n_closed
    references = slice(0, n_parts)
    energies = zip(LEDGER, recorder.ledger[:k].T, strict=True)
    variables = {
        "period": np.arange(k),
        "strobe_displacement": recorder.strobe[:k, 0, references].T,
        "strobe_velocity": recorder.strobe[:k, 1, references].T,
        "envelope_min": recorder.envelope[:k, 0, references].T,
        "envelope_max": recorder.envelope[:k, 1, references].T,
        "impulse_sum": recorder.impulse[:k, 0],
        "impact_count": recorder.impulse[:k, 1],
        **{f"energy_{name}": column for name, column in energies},
    }
    if recorder.n_forces:
        works = recorder.works[:k].T
        if recorder.is_forced:
            first = variables["energy_force_work"] - works.sum(axis=0)
            works = np.vstack([first, works])
        variables["energy_force_works"] = works
    return variables


def _of_frames(recorder: Recorder, structure: Structure, case: Case, start: int) -> dict[str, Any]:
    """Return the fields of the window's frames, and the motion of the points of a scan."""
    layout = structure.layout
    steps, frames, contact, base = frames_of(recorder)
    states = np.array(frames) if frames else np.empty((0, 2, structure.operators.n_own))
    contact = contact.reshape(len(frames), structure.operators.n_pairs)
    nodal = fields.nodal(layout, states[:, 0], base[:, 0])
    u, phi = fields.at_stations(layout, *nodal)
    v, _ = fields.at_stations(layout, *fields.nodal(layout, states[:, 1], base[:, 1]))
    variables = {
        "frame": (start + steps) * recorder.time_step,
        "displacement": u,
        "slope": phi,
        "velocity": v,
        "moment": fields.bending_moment(layout, *nodal),
        "contact_state": _of_interfaces(layout, contact),
    }
    if layout.stops:
        variables["stop_state"] = contact[:, layout.stops[0].first_pair :]
    if places := scanned_places(case):
        rows = layout.numbers_of(places)
        at = np.array([(place.x, place.z) for place in places])
        variables |= {
            "scan_x": at[:, 0],
            "scan_z": at[:, 1],
            "scan_displacement": layout.read(states[:, 0], base[:, 0])[:, rows],
            "scan_velocity": layout.read(states[:, 1], base[:, 1])[:, rows],
        }
    return variables


def _of_interfaces(
    layout: Layout, of_pairs: npt.NDArray[Any], *, are_gaps: bool = False
) -> npt.NDArray[Any]:
    """Spread values of pairs over the stations, one interface or all of them first."""
    spread = [
        layout.at_stations(interface, of_pairs, are_gaps=are_gaps)
        for interface in layout.interfaces
    ]
    if not spread:
        return np.zeros((0, *of_pairs.shape[:-1], layout.stations.size), of_pairs.dtype)
    return spread[0] if len(spread) == 1 else np.stack(spread)


def _of_events(recorder: Recorder, layout: Layout | None, start: int) -> dict[str, Any]:
    """Return the table of impacts in the window; pairs hit at one instant share their energy."""
    impacts = recorder.impacts()
    first = np.cumsum(impacts.sizes) - impacts.sizes
    hit = impacts.hit
    p = impacts.impulses
    time = (start + impacts.ticks / recorder.refine) * recorder.time_step
    # an impulse works at the mean gap rate; a remainder is shared by the impulses
    work = 0.5 * p * (impacts.rate_pre + impacts.rate_post)
    remainder = impacts.energies - np.add.reduceat(work, first)
    total = np.add.reduceat(p, first)
    each = np.array([time, remainder, np.where(total == 0.0, 1.0, total)])
    time, remainder, total = np.repeat(each, impacts.sizes, axis=1)
    energy = work + remainder * p / total
    variables: dict[str, Any] = {"event_time": time}
    if layout is None:
        variables["event_pair"] = hit
    else:
        interface, node, stop = _places(layout)
        if len(layout.interfaces) > 1 or layout.stops:
            variables["event_interface"] = interface[hit]
        if layout.stops:
            variables["event_stop"] = stop[hit]
        variables["event_node"] = node[hit]
    return variables | {
        "event_impulse": p,
        "event_velocity_before": impacts.rate_pre,
        "event_energy": energy,
    }


def _places(layout: Layout) -> tuple[IntArray, IntArray, IntArray]:
    """Return interface (-1: a stop), station and stop (-1: none) of each pair, all (n_pairs,)."""
    numbers = [*range(len(layout.interfaces)), *(-1 for _ in layout.stops)]
    sizes = [pairs.places.size for pairs in layout.touching]
    interface = np.repeat(np.array(numbers, dtype=np.int64), sizes)
    places = np.concatenate([np.zeros(0), *(pairs.places for pairs in layout.touching)])
    stop = np.where(interface < 0, np.cumsum(interface < 0), 0) - 1
    return interface, np.searchsorted(layout.stations, places), stop


GROUPS = {"history": "time", "periods": "period", "fields": "frame", "events": "event"}
"""Name of each group, and the dimension of its variables."""
SHAPE = "shape"
"""Name of the group of what does not depend on time: gaps at rest, probes."""


def grouped(history: xr.Dataset) -> dict[str, xr.Dataset]:
    """Return the dataset of a run in groups: history, periods, fields, events, shape, sensors.

    Attributes of the dataset stay with each group. A variable is in one group; a sensor with a
    sampling rate is a group of its own.

    Args:
        history: dataset of a run; see `schema.VARIABLES`.
    """
    dims = {str(name): set(history[name].dims) for name in history.data_vars}
    groups = {
        group: [name for name, axes in dims.items() if dim in axes] for group, dim in GROUPS.items()
    }
    for name, axes in dims.items():  # a sensor with a time axis of its own
        if name.startswith(SENSOR) and f"{name}_time" in axes:
            groups[name] = [name]
    taken = {name for names in groups.values() for name in names}
    groups[SHAPE] = [name for name in dims if name not in taken]
    return {group: _tidy(history[names]) for group, names in groups.items()}


def _tidy(group: xr.Dataset) -> xr.Dataset:
    """Return a group without coordinates that belong to none of its variables."""
    used = {str(dim) for name in group.data_vars for dim in group[name].dims}
    unused = [name for name in group.coords if not set(map(str, group[name].dims)) <= used]
    return group.drop_vars([name for name in unused if name != INTERFACE])
