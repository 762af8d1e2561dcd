"""The channels of a run as arrays: their names and units before it, their histories after it.

The record of a result (`record.py`) has the same channels as a dataset. Sweeps and refinement
studies reduce the histories of thousands of runs to measures, for which no dataset is made.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.excitation import places_of
from delam_fem.model.layout import Layout, Structure, reference_channels
from delam_fem.numerics.types import FloatArray
from delam_fem.results import contacts
from delam_fem.results.schema import SENSOR
from delam_fem.simulation.recorder import Recorder
from delam_fem.simulation.signals import signals, steps_of
from delam_fem.system.errors import CaseError


def offered(layout: Layout, case: Case, *, only_stepped: bool = False) -> dict[str, str]:
    """Return the units of the channels that the record of a case has, by their names.

    Args:
        layout: layout of the case.
        case: the case.
        only_stepped: leave out sensors with a sampling rate: their samples do not fill periods.
    """
    units: dict[str, str] = {}
    for name in layout.names:
        units |= dict(zip(reference_channels(name), ("m", "m/s"), strict=True))
    units |= _of_drives([one.acts_on for one, *_ in places_of(case.excitation)])
    striking = [(interface.name, interface.first_pair) for interface in layout.interfaces]
    striking += [(contacts.named(stop.number, case)[1], stop.first_pair) for stop in layout.stops]
    for name, first_pair in striking:
        is_recorded = layout.gap_row is not None and first_pair >= layout.first_gap
        if unit := contacts.force_unit(case, name, is_recorded=is_recorded):
            units[f"contact_{name}"] = unit
    sampled = {sensor.name for sensor in case.sensor if sensor.sampling_rate is not None}
    for sensor in layout.sensors:
        if only_stepped and sensor.name in sampled:
            continue
        name = f"{SENSOR}{sensor.name}" if sensor.name in units else sensor.name
        units[name] = sensor.unit
    return units


def _of_drives(acts_on: Sequence[str]) -> dict[str, str]:
    """Return the units of the channels of drives, by their names: base, drive, drive_2 and so on.

    Args:
        acts_on: what each drive acts on, "base" or "force".
    """
    units = {"base": "m"} if acts_on[0] == "base" else {}
    for number in range(1, 1 + len(acts_on) - len(units)):
        units["drive" if number == 1 else f"drive_{number}"] = "N"
    return units


def of_references(names: Sequence[str]) -> list[str]:
    """Return the channels that stand for a motion: displacements of its reference probes.

    By them it is judged settled or periodic, as a motion whose reference probes repeat has no
    channel that does not. Studies take them unless other channels are asked for.

    Args:
        names: names of the laminae, or of the probes of operators.
    """
    return [reference_channels(name)[0] for name in names]


def chosen(names: Sequence[str], layout: Layout, case: Case) -> dict[str, str]:
    """Return the units of channels that have a value at each step, by their names.

    Args:
        names: names of the channels; none: those of `of_references`.
        layout: layout of the case.
        case: the case.

    Raises:
        CaseError: there is no such channel, or it is a sensor with a sampling rate.
    """
    units = offered(layout, case, only_stepped=True)
    names = names or of_references(layout.names)
    require_channels(names, units, remark=", which have a value at each step")
    return {name: units[name] for name in names}


def require_channels(
    names: Iterable[str], known: Iterable[Hashable], key: str = "channel", remark: str = ""
) -> None:
    """Refuse names that are none of the channels there are.

    Args:
        names: the names.
        known: names of the channels that there are.
        key: what names them, for the message.
        remark: what the message says of those that there are.

    Raises:
        CaseError: there is no channel of a name.
    """
    channels = [str(name) for name in known]
    if unknown := [name for name in names if name not in channels]:
        raise CaseError(
            f"{key}: expected some of {', '.join(channels)}{remark}, given {', '.join(unknown)}"
        )


class History(NamedTuple):
    """The history of a channel over the window of a run.

    Attributes:
        time: times of the values, shape (k,) [s].
        values: the values, shape (k,).
        units: their unit.
    """

    time: FloatArray
    values: FloatArray
    units: str


def histories_of(
    recorder: Recorder, structure: Structure, case: Case, *, has_contacts: bool = True
) -> dict[str, History]:
    """Return the histories of all channels over the window of a recorder, by their names.

    Args:
        recorder: recorder of the run, after at least one period.
        structure: structure that moved.
        case: its case.
        has_contacts: whether forces of contacts, which take most of the time, are wanted.

    Returns:
        One value after each step; a sensor with a sampling rate has times of its own. Sensors are
        `sensor_NAME` as well, which no other channel is.
    """
    u, v, base = (rows[1:] for rows in steps_of(recorder))
    start = (recorder.n_closed - len(recorder.window)) * recorder.steps_per_period
    time = (start + 1 + np.arange(len(u))) * recorder.time_step
    histories: dict[str, History] = {}
    for row, name in enumerate(structure.layout.names):
        displacement, velocity = reference_channels(name)
        histories[displacement] = History(time, u[:, row], "m")
        histories[velocity] = History(time, v[:, row], "m/s")
    acts_on = ["force" if recorder.is_forced else "base", *["force"] * recorder.n_forces]
    for (name, units), values in zip(_of_drives(acts_on).items(), base[:, ::3].T, strict=True):
        histories[name] = History(time, values, units)
    touching = contacts.histories(recorder, structure, case) if has_contacts else {}
    for contact, (units, values) in touching.items():
        histories[f"contact_{contact}"] = History(time, values, units)
    for signal in signals(recorder, structure, case):
        sensor = signal.sensor
        history = History(signal.time, signal.value, sensor.unit)
        histories.setdefault(sensor.name, history)
        histories[f"{SENSOR}{sensor.name}"] = history
    return histories
