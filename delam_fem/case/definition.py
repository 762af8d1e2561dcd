"""Define a case: everything that a run depends on, checked when it is constructed."""

from __future__ import annotations

import difflib
import math
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from itertools import combinations
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Self

import numpy as np
import scipy  # loads its parts when they are used
from pydantic import BeforeValidator, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from delam_fem.case.excitation import (
    BurstExcitation,
    Excitation,
    HammerExcitation,
    HarmonicExcitation,
    RandomExcitation,
    RecordExcitation,
    SweepExcitation,
    TableExcitation,
    drive,
    parts_of,
)
from delam_fem.case.sections import (
    EDGE_TOLERANCE,
    EDGES,
    ENDS,
    POINT_LENGTH,
    Contact,
    Damping,
    Delamination,
    Gravity,
    Impactor,
    Initial,
    InitialGap,
    Lamina,
    Load,
    Mesh,
    Model,
    Output,
    OwnContact,
    PointMass,
    Sensor,
    Stop,
    Support,
    SurfaceScan,
    TimeStepping,
    require_fitting,
    require_neighbours,
    x_of,
    z_of,
)
from delam_fem.case.toml import Data, apply_overrides, message, set_key, toml_text
from delam_fem.case.unread import idle_keys, read_of_contact
from delam_fem.case.values import Expected, Section, in_si, inconsistent
from delam_fem.contact.laws import ELASTIC_WITHIN, Law, combination, combined_name
from delam_fem.numerics import harmonics
from delam_fem.numerics.beams import transmissibility
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError

ROUND_OFF = 1e-9
"""Share of a period by which round-off alone may make a sweep longer than whole periods."""
FASTEST = 0.2
"""Largest frequency of a sensor's filters over the steps per second."""
PARTS = 100
"""Parts of a run with a given time step; each stands for a period."""
LEAST_STEPS = 4
"""Smallest number of steps of such a part."""
BEAM_CELLS = 100
"""Cells of the beams that stand for solids whose mesh is from a file."""
OFFSET_DRIFT = 1e-3
"""Drift over the length from which an offset is one; see `TableExcitation.offset`."""
MOST_FRAMES = 500
"""Frames of a run whose excitation does not repeat, where nothing else is said."""
_NEEDS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "hammer": ("step", "duration"),
        "table": ("step",),
        "record": ("step",),
        "none": ("step", "duration"),
    }
)
"""Keys of the section `time` that a kind of excitation needs."""
_OF_PERIODS = (
    ("time", "periods"), ("time", "steps_per_period"), ("output", "window_periods"),
    ("output", "fields_per_period"),
)  # fmt: skip
"""Keys with another default, or without meaning, where the excitation does not repeat."""
WITHOUT_FRAMES: Mapping[str, object] = MappingProxyType(
    {"output.fields_per_period": 0, "scan": None}
)
"""Overrides for cases of which signals alone are read: no frames, and no scan at them."""


def _tables(value: object) -> object:
    """Check that there are [[lamina]] tables."""
    if not isinstance(value, list | tuple) or not value:
        raise PydanticCustomError(
            "inconsistent",
            "expected one or more [[lamina]] tables, given {count}",
            {"count": "none" if isinstance(value, list | tuple) else "something else"},
        )
    return value


def _listed(data: Mapping[str, Any], key: str) -> Sequence[object]:
    """Return the tables of a section that may be repeated; none if it is something else."""
    tables = data.get(key)
    return tables if isinstance(tables, list | tuple) else ()


def _placed(table: object, end: object) -> object:
    """Return a table that acts on a point, with its place at the end if none is given."""
    if not isinstance(table, Mapping) or "lamina" not in table or "position" in table:
        return table
    return {**table, "position": end}


LEAST_SHEAR = 0.01
"""Shear modulus of a layer over the largest modulus of a case below which beams refuse it: cores of
sandwiches have less, UD layers three times as much and more."""


class Case(Section):
    """A complete case.

    Attributes:
        name: name of the case and of the folder of its results.
        lamina: the laminae from bottom to top; in the paper thick and thin.
        gap: the gap at rest between laminae that are apart over their whole length.
        point_mass: point masses on the laminae.
        stop: stops that laminae may strike.
        impactor: masses that strike laminae.
        initial: displacements and velocities at t = 0; at rest without any.
        gravity: weight; none if the table is not given.
        load: constant loads.
        sensor: sensors, whose signals are in the results.
        scan: points on the surface of a plate that are read at every frame; none if the table is
            not given.
        support: how the laminae are held at their ends.
        delamination: where neighbours are apart; elsewhere they are bonded. Without any, laminae
            with a gap are apart over their whole length.
        mesh: the mesh of both laminae.
        model: what the laminae are computed as: beams, or solids.
        damping: the damping model.
        excitation: the motion of the base, or the force at a point.
        contact: the contact law.
        time: the time integration.
        output: the window and the frames that a run records.
    """

    name: Annotated[
        str,
        Field(strict=True, pattern=r"^\w[\w .+-]*$", max_length=100),
        Expected("a name fit for a folder: letters, digits, space and . + - _"),
    ]
    lamina: Annotated[tuple[Lamina, ...], BeforeValidator(_tables)]
    gap: InitialGap | None = None
    support: Support = Support()
    delamination: tuple[Delamination, ...] = ()
    mesh: Mesh
    model: Model = Model()
    damping: Damping = Damping()
    excitation: Excitation
    contact: Contact
    time: TimeStepping = TimeStepping()
    output: Output = Output()
    point_mass: tuple[PointMass, ...] = ()
    stop: tuple[Stop, ...] = ()
    impactor: tuple[Impactor, ...] = ()
    initial: tuple[Initial, ...] = ()
    gravity: Gravity | None = None
    load: tuple[Load, ...] = ()
    sensor: tuple[Sensor, ...] = ()
    scan: SurfaceScan | None = None

    def __init__(self, /, **sections: object) -> None:
        """Check a case that is written in Python, table by table, as `tomllib` returns a file.

        Raises:
            CaseError: the sections do not describe a valid case.
        """
        try:
            super().__init__(**sections)
        except ValidationError as error:
            label = f"case {sections.get('name', '')}".rstrip()
            raise CaseError(message(label, error, sections)) from None

    @model_validator(mode="before")
    @classmethod
    def _law_with_scheme(cls, data: object) -> object:
        """Take a law with its scheme, such as newton@moreau-jean, apart."""
        if not isinstance(data, Mapping) or not isinstance(data.get("contact"), Mapping):
            return data
        law, _, scheme = str(data["contact"].get("law")).partition("@")
        if not scheme:
            return data
        time = data.get("time", {})
        if isinstance(time, Mapping):
            if time.get("scheme", scheme) != scheme:
                raise inconsistent(
                    "contact.law", f"expected time.scheme = {time['scheme']!r}, given {scheme!r}"
                )
            time = {**time, "scheme": scheme}
        return {**data, "contact": {**data["contact"], "law": law}, "time": time}

    @model_validator(mode="before")
    @classmethod
    def _points_have_no_places(cls, data: object) -> object:
        """Place what acts on points, or is read there, at their end if no place is given."""
        if not isinstance(data, Mapping):
            return data
        laminae = data.get("lamina")
        if not isinstance(laminae, list | tuple) or not laminae:
            return data
        first = laminae[0]
        if not isinstance(first, Mapping) or "mass" not in first:
            return data
        data = {"mesh": {"elements": 1}, **data}
        end = in_si(first.get("length", POINT_LENGTH), "m", "length")
        changed = {
            "sensor": [_placed(table, end) for table in _listed(data, "sensor")],
            "initial": [
                _placed(table, end)
                if isinstance(table, Mapping) and table.get("shape") == "force"
                else table
                for table in _listed(data, "initial")
            ],
        }
        changed = {key: tables for key, tables in changed.items() if tables}
        drives = data.get("excitation")
        if isinstance(drives, list | tuple):
            return {**data, **changed, "excitation": [_placed(table, end) for table in drives]}
        return {**data, **changed, "excitation": _placed(drives, end)}

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Check conditions that involve several sections."""
        self._check_laminae()
        self._check_materials()
        self._check_openings()
        self._check_places()
        self._check_time()
        self._check_sensors()
        self._check_elastic()
        self._check_stops()
        self._check_loads()
        if self.time.periods == "settled" and not self.is_periodic:
            raise inconsistent(
                "time.periods",
                "expected a number, because a motion settles only if its excitation repeats after "
                'each period; given "settled"',
            )
        self._check_massless()
        try:
            combination(self.contact.law, self.time.scheme)
        except ValueError as error:
            raise inconsistent("contact.law", str(error)) from None
        if self.contact.points_per_element > 1 and self.has_lumped_impulses:
            raise inconsistent(
                "contact.points_per_element",
                'expected 1 with contact.impulse = "lumped", because points inside an element '
                "share its nodes and separate impulses on them add energy; given "
                f'{self.contact.points_per_element}: use contact.impulse = "consistent"',
            )
        is_said = self.is_periodic or "fields_per_period" in self.output.model_fields_set
        n_steps = self.time.steps_per_period * self.excitation.turns
        if is_said and self.time.step is None and self.output.fields_per_period > n_steps:
            raise inconsistent(
                "output.fields_per_period",
                f"expected at most time.steps_per_period = {n_steps}, "
                f"given {self.output.fields_per_period}",
            )
        return self

    def _check_places(self) -> None:
        """Check that what acts on laminae names one of them and a place on it."""
        for key, drive_table in self._drives():
            self._check_place(key, drive_table)
        for section in ("point_mass", "sensor", "stop", "impactor", "initial", "load"):
            tolerance = 0.0 if section in ("point_mass", "sensor") else EDGE_TOLERANCE
            for number, entry in enumerate(getattr(self, section), start=1):
                key = f"{section}.{getattr(entry, 'name', number)}"
                self._check_place(key, entry, tolerance)

    def _check_place(self, key: str, own: Section, tolerance: float = 0.0) -> None:
        """Check the lamina and the places that a table names, if it names any."""
        names = [lamina.name for lamina in self.lamina]
        lamina_name = getattr(own, "lamina", None)
        if lamina_name is not None and lamina_name not in names:
            raise inconsistent(
                f"{key}.lamina", f"expected one of {', '.join(names)}, given {lamina_name!r}"
            )
        for end in ("position", "end"):
            x = getattr(own, end, None)
            if end == "position":
                self._check_surface(key, own)
                x = x if x is None else x_of(x)
            if x is not None and self.is_of_points and (end == "end" or x != self.length):
                raise inconsistent(
                    f"{key}.{end}",
                    f"expected none on a point, which has no places, given {x!r}; leave it out",
                )
            length = self.length_of(lamina_name)
            if x is not None and x > length * (1.0 + tolerance):
                raise inconsistent(
                    f"{key}.{end}", f"expected at most the length {length!r} m, given {x!r}"
                )

    def _check_surface(self, key: str, own: Section) -> None:
        """Check that places on surfaces are on those of a plate."""
        position = getattr(own, "position", None)
        is_surface = getattr(own, "surface", None) is not None
        if isinstance(own, Sensor) and own.quantity == "strain":
            is_surface = False
        if self.is_plate:
            half = self.half_width
            if isinstance(position, tuple) and abs(position[1]) > half * (1.0 + EDGE_TOLERANCE):
                raise inconsistent(
                    f"{key}.position",
                    f"expected z from {-half:g} to {half:g} m, the edges of the plate, given "
                    f"{position[1]:g} m",
                )
        elif isinstance(position, tuple) or is_surface:
            name = "position" if isinstance(position, tuple) else "surface"
            raise inconsistent(
                f"{key}.{name}",
                f"expected {'a number' if name == 'position' else 'none'} but on a plate, which "
                "has mesh.across",
            )

    def _check_time(self) -> None:
        """Check that time is in periods, or in seconds if the excitation does not repeat."""
        kinds = [drive_table.kind for _, drive_table in self._drives()]
        needs: dict[str, str] = {key: kind for kind in kinds for key in _NEEDS.get(kind, ())}
        has_length = self.excitation.length is not None or {"table", "record"} & set(kinds)
        if len(kinds) > 1 and not (self.is_periodic or has_length):
            needs.setdefault("duration", "several, without a common period")
        for key, other in (("step", "steps_per_period"), ("duration", "periods")):
            value = getattr(self.time, key)
            if value is None and key in needs:
                raise inconsistent(
                    f"time.{key}",
                    f'missing, but required [s] with excitation.kind = "{needs[key]}"',
                )
            if value is not None and (self.is_periodic or other in self.time.model_fields_set):
                reason = ", because the excitation repeats" if self.is_periodic else ", not both"
                raise inconsistent(
                    f"time.{key}", f"expected time.{other} instead{reason}; given {value:g} s"
                )
        for key, drive_table in self._drives():
            if isinstance(drive_table, HammerExcitation):
                self._check_blow(key, drive_table)

    def _check_blow(self, key: str, blow: HammerExcitation) -> None:
        """Check that a blow is within the window."""
        end = self.n_periods * self.period
        begin = end - self.n_window_periods * self.period
        margin = ROUND_OFF * end
        if blow.start < begin - margin or blow.start + blow.duration > end + margin:
            raise inconsistent(
                f"{key}.start",
                f"expected a blow within the window, {begin:g} to {end:g} s, given {blow.start:g} "
                f"to {blow.start + blow.duration:g} s",
            )

    def _check_massless(self) -> None:
        """Check that modes without a file have massless contact points, which are rigid."""
        model = self.model
        if not self.is_massless:
            if model.kind == "modes" and model.file is None:
                raise inconsistent(
                    "time.mass",
                    'expected "massless" with model.kind = "modes" and no file, given '
                    f'"{self.time.mass}"',
                )
            return
        if model.is_continuum or model.file is not None or self.is_axial:
            raise inconsistent(
                "time.mass",
                'expected "massless" only with model.kind = "beam", or "modes" without a file, and '
                f'laminae that bend; given model.kind = "{model.kind}"',
            )
        if self.is_at_middles and self.contact.points_per_element > 1:
            raise inconsistent(
                "contact.points_per_element",
                'expected 1 with time.mass = "massless" and model.kind = "beam", because the mass '
                f"is inside the elements; given {self.contact.points_per_element}",
            )
        if self.is_floating:
            raise inconsistent(
                "support",
                'expected a structure that is held with time.mass = "massless", and springs that '
                "hold impactors, given "
                f'"{self.support.kind("start")}" and "{self.support.kind("end")}" ends',
            )
        for number, support in enumerate(self.support.placed, start=1):
            if support.damping:
                raise inconsistent(
                    f"support.{number}.damping",
                    'expected 0 with time.mass = "massless", which takes C = alpha M + beta K '
                    f"alone, given {support.damping:g}",
                )
        is_rigid = self.contact.law == "newton" and not self.contact.restitution
        if self.contact.law != "none" and not is_rigid:
            raise inconsistent(
                "contact.law",
                'expected "newton" with restitution = 0, or "none", with time.mass = "massless": a '
                "contact point without mass is rigid and cannot bounce; given "
                f'"{self.contact.law}" with restitution = {self.contact.restitution:g}',
            )

    def _check_elastic(self) -> None:
        """Check that contacts with numbers of their own fit the law, the scheme and the masses."""
        if self.has_stiffnesses and not self.spring[0]:
            raise inconsistent(
                "contact.penalty_stiffness",
                "expected a positive number beside contacts with a stiffness of their own",
            )
        if self.contact.law != "newton":
            return
        for key, entry in self.contacts:
            if entry.elastic_by and self.is_massless:
                raise inconsistent(
                    f"{key}.{entry.elastic_by}",
                    'expected none with time.mass = "massless": a contact point without mass is '
                    "rigid",
                )
            if entry.restitution and self.is_massless:
                raise inconsistent(
                    f"{key}.restitution",
                    'expected 0 with time.mass = "massless": a contact point without mass cannot '
                    f"bounce; given {entry.restitution:g}",
                )
            if entry.elastic_by and self.time.scheme == "moreau-jean":
                raise inconsistent(f"{key}.{entry.elastic_by}", ELASTIC_WITHIN)

    def _check_stops(self) -> None:
        """Check that a rigid stop has no second one at its place and side of a lamina."""
        margin = EDGE_TOLERANCE * self.length
        for (first, before), (second, stop) in combinations(enumerate(self.stop, start=1), 2):
            if before.lamina != stop.lamina or {before.side, stop.side} == {"above", "below"}:
                continue
            (low, high), (start, end) = before.reach(self.length), stop.reach(self.length)
            is_apart = start > high + margin or end < low - margin
            across = [z_of(s.position) if s.position is not None else 0.0 for s in (before, stop)]
            is_apart |= abs(across[1] - across[0]) > margin
            if not is_apart and not (before.elastic_by and stop.elastic_by):
                raise inconsistent(
                    f"stop.{second}.{'position' if stop.start is None else 'start'}",
                    f"expected another place or side of lamina {stop.lamina} than that of stop "
                    f"{first}, {low:g} to {high:g} m {before.side}, given {start:g} to {end:g} m "
                    f"{stop.side}; only elastic stops may be at one place",
                )

    def _check_loads(self) -> None:
        """Check that constant loads act on something, and that nothing is loaded that cannot be."""
        for number, load in enumerate(self.load, start=1):
            if load.between is not None:
                require_neighbours(f"load.{number}.between", load.between, self.lamina)
            if load.force is not None and load.position is None and not self.is_of_points:
                raise inconsistent(f"load.{number}.position", "missing, but required beside force")
            for key in ("axial", "per_length") if self.is_of_points else ("axial",):
                if self.is_axial and getattr(load, key) is not None:
                    raise inconsistent(
                        f"load.{number}.{key}",
                        "expected a force on bars and points, on which tension has no effect",
                    )
        gravity = self.gravity
        is_of_bars = self.is_axial and not self.is_of_points
        if is_of_bars and gravity is not None and gravity.along == 0.0:
            raise inconsistent(
                "gravity.inclination",
                "expected an angle other than 0 and 180 on bars, as weight across them has no "
                f"effect, given {gravity.inclination:g}",
            )
        if self.has_axial_forces and not all(lamina.is_uniform for lamina in self.lamina):
            self._check_forces_along_profiles()

    def _check_forces_along_profiles(self) -> None:
        """Check that axial forces do not bend laminae that are not uniform."""
        is_upright = self.gravity is not None and self.gravity.along != 0.0
        key = "gravity.inclination" if is_upright else "load"
        if not self.is_apart:
            raise inconsistent(
                key,
                "expected uniform laminae, or laminae that are apart: the neutral axis of a bonded "
                "profile is not straight, and what acts along it bends it",
            )
        if self.model.is_continuum and any(load.axial for load in self.load):
            raise inconsistent(
                "load", "expected uniform laminae with tension in a solid, given a profile"
            )

    def _check_sensors(self) -> None:
        """Check that sensors have different names, something to read, and possible rates."""
        highest_rate = 1.0 / (self.time.step or self.time_step)
        names = [sensor.name for sensor in self.sensor]
        for sensor in self.sensor:
            key = f"sensor.{sensor.name}"
            if names.count(sensor.name) > 1:
                raise inconsistent("sensor", f"expected other names, given {sensor.name!r} twice")
            if sensor.between is not None:
                require_neighbours(f"{key}.between", sensor.between, self.lamina)
            for name in ("stop", "impactor"):
                number = getattr(sensor, name)
                count = len(getattr(self, name))
                if number is not None and number > count:
                    raise inconsistent(
                        f"{key}.{name}", f"expected at most {count} {name}s, given {number}"
                    )
            for name in ("corner", "resonance"):
                value = getattr(sensor, name)
                if value is not None and value > FASTEST * highest_rate:
                    raise inconsistent(
                        f"{key}.{name}",
                        f"expected at most {FASTEST:g} of the steps per second, "
                        f"{FASTEST * highest_rate:g} Hz, given {value:g} Hz; take more steps",
                    )
            if sensor.mass is not None and self.model.file is not None:
                raise inconsistent(
                    f"{key}.mass",
                    "expected none with model.file, whose structure is reduced already; give the "
                    "mass in the case that is reduced",
                )
            if sensor.sampling_rate is not None and sensor.sampling_rate > highest_rate * (
                1.0 + ROUND_OFF
            ):
                raise inconsistent(
                    f"{key}.sampling_rate",
                    f"expected at most {highest_rate:g} Hz, one sample a step, given "
                    f"{sensor.sampling_rate:g} Hz",
                )

    def _check_laminae(self) -> None:
        """Check that names differ and lengths agree, and that there are beams or points."""
        if len({(lamina.is_point, lamina.motion) for lamina in self.lamina}) > 1:
            raise inconsistent("lamina", "expected beams, bars or points, given several of these")
        is_bar = self.is_axial and not self.is_of_points
        if is_bar:
            self._check_bars()
        elif self.damping.rayleigh == "every mode":
            raise inconsistent("damping.rayleigh", "expected another of beams, solids and points")
        if self.is_of_points and (
            self.mesh.elements != 1
            or self.contact.points_per_element != 1
            or self.model.kind != "beam"
            or not self.is_apart
        ):
            raise inconsistent(
                "lamina",
                "expected of points mesh.elements = 1, contact.points_per_element = 1, "
                'model.kind = "beam" and no support',
            )
        for number, other in enumerate(self.lamina[1:], start=1):
            if any(other.name == below.name for below in self.lamina[:number]):
                raise inconsistent("lamina", f"expected two names, given {other.name!r} twice")
        if not self.has_one_length:
            self._check_lengths()

    def _check_materials(self) -> None:
        """Check that beams have no layers whose couplings or shear they do not know."""
        if self.model.is_continuum or self.model.file is not None:
            return
        solid = 'take model.kind = "plane-stress" or "solid"'
        stiffest = max(lamina.mean("young_modulus") for lamina in self.lamina)
        for lamina in self.lamina:
            if lamina.orthotropic is None:
                continue
            if not lamina.is_symmetric:
                raise inconsistent(
                    f"lamina.{lamina.name}.plies",
                    "expected plies whose upper half mirrors the lower one with laminae as beams, "
                    "which know no coupling of bending and stretching, given "
                    f"{[*(lamina.plies or ())]}; {solid}",
                )
            shear = min(1.0 / lamina.orthotropic.at(angle)[3, 3] for angle, _ in lamina.layers)
            if shear < LEAST_SHEAR * stiffest:
                raise inconsistent(
                    f"lamina.{lamina.name}.material",
                    f"expected a shear modulus of at least {LEAST_SHEAR:g} of the largest Young's "
                    f"modulus, {stiffest:.4g} Pa, with laminae as beams, which know no shear, "
                    f"given {shear:.4g} Pa; {solid}",
                )

    def _check_lengths(self) -> None:
        """Check that laminae of unequal lengths are cantilevers that begin at one clamp."""
        model = f'model.kind = "{self.model.kind}", time.mass = "{self.time.mass}"'
        reasons = {
            "beams that bend": not self.is_axial,
            f'model.kind = "beam" without massless contact points, given {model}': (
                self.model.kind == "beam" and not self.is_massless
            ),
            "[gap], beside which laminae are apart; bonded laminae have one length": (
                self.gap is not None
            ),
            "laminae that are held at x = 0 alone, as a shorter one has no end at x = length": (
                self.support.kind("end") == "free" and self.support.kind("start") != "free"
            ),
            "mesh.elements, as the lines of a mesh file have one length": self.mesh.file is None,
        }
        for expected, is_there in reasons.items():
            if not is_there:
                other = next(one for one in self.lamina if one.length != self.lamina[0].length)
                raise inconsistent(
                    f"lamina.{other.name}.length",
                    f"expected the length {self.lamina[0].length!r} of lamina "
                    f"{self.lamina[0].name}, or {expected}; given {other.length!r}",
                )

    def _check_bars(self) -> None:
        """Check that bars are apart, and that nothing is asked that they do not have."""
        n_open = len({d.between for d in self.delamination if d.spans(self.length)})
        expected = {
            "model.kind": self.model.kind == "beam",
            "delamination": self.gap is not None or n_open == len(self.lamina) - 1,
            "support": self.support.rotational_stiffness is None
            and not any(support.rotational_stiffness for support in self.support.placed),
            "contact.points_per_element": self.contact.points_per_element == 1,
            "sensor": all(sensor.quantity != "strain" for sensor in self.sensor),
        }
        for key, is_there in expected.items():
            if not is_there:
                raise inconsistent(
                    key,
                    "expected of bars: apart over their whole length, pairs at nodes, supports "
                    'without rotational_stiffness, no strain, model.kind = "beam"',
                )

    def _check_openings(self) -> None:
        """Check that either a gap or delaminations are given, and that they fit the laminae."""
        if self.delamination:
            if self.gap is not None:
                raise inconsistent("gap", "expected no gap beside [[delamination]]: give openings")
            require_fitting(self.delamination, self.lamina, self.support)
        elif len(self.lamina) == 1:
            if self.gap is not None:
                raise inconsistent("gap", "expected none beside a single lamina; give [[stop]]")
        elif self.gap is None and "support" not in self.model_fields_set:
            raise inconsistent(
                "gap",
                "missing, but required for laminae that are apart; give [[delamination]] tables "
                "for a bonded stack, or [support] alone for one without delaminations",
            )
        self._check_placed_supports()
        self._check_plate()
        kinds = [self.support.kind("start"), self.support.kind("end")]
        if self.support.rotational_stiffness is not None and (
            self.model.is_continuum or "clamped" not in kinds
        ):
            raise inconsistent(
                "support.rotational_stiffness",
                'expected only with a clamped end and model.kind = "beam", given '
                f'"{kinds[0]}" and "{kinds[1]}" ends, "{self.model.kind}"',
            )

    @property
    def contacts(self) -> tuple[tuple[str, OwnContact], ...]:
        """The tables of what may touch, with their keys: "gap", "delamination.1", "stop.1", …."""
        tables: list[tuple[str, OwnContact]] = [] if self.gap is None else [("gap", self.gap)]
        for section in ("delamination", "stop", "impactor"):
            entries = enumerate(getattr(self, section), start=1)
            tables += [(f"{section}.{number}", entry) for number, entry in entries]
        return tuple(tables)

    @property
    def has_stiffnesses(self) -> bool:
        """Whether a contact has a stiffness of its own, or that of a ball."""
        return any(entry.has_stiffness for _, entry in self.contacts)

    @property
    def contact_law(self) -> Law:
        """The contact law with its numbers."""
        contact = self.contact
        stiffness, damping = self.spring
        return Law(
            contact.law,
            restitution=contact.restitution,
            impulse=contact.impulse,
            penalty_stiffness=stiffness,
            penalty_damping=damping,
            threshold_velocity=contact.threshold_velocity,
        )

    @property
    def spring(self) -> tuple[float, float]:
        """Stiffness [N/m] and damping [N s/m] of a contact spring of weight 1.

        If all contacts that carry springs have a stiffness of their own, the first gives both.
        Balls alone have a spring of 1 N/m, of which their stiffnesses are multiples.
        """
        if not self.has_own_springs:
            return self.contact.penalty_stiffness, self.contact.penalty_damping
        springs = [
            (entry.stiffness, entry.damping)
            for _, entry in self.contacts
            if entry.stiffness is not None
        ]
        return springs[0] if springs else (1.0, 0.0)

    def _check_placed_supports(self) -> None:
        """Check that supports inside the span are apart from the ends and from one another."""
        margin = EDGE_TOLERANCE * self.length
        taken = [0.0, self.length]
        for support in self.support.placed:
            self._check_place("support", support, math.inf)
            is_yielding_clamp = support.kind == "clamped" and support.rotational_stiffness
            if is_yielding_clamp and self.model.is_continuum:
                raise inconsistent(
                    "support.rotational_stiffness",
                    'expected kind = "pinned" beside it with laminae as solids, given "clamped"',
                )
        for support in self.support.at_points:
            if support.x > self.length:
                raise inconsistent(
                    "support.position",
                    f"expected x from 0 to the length {self.length!r} m, given {support.x!r}",
                )
        for place in sorted(support.x for support in self.support.inside):
            if place >= self.length or min(abs(place - x) for x in taken) <= margin:
                raise inconsistent(
                    "support.position",
                    f"expected places from 0 to the length {self.length!r} m, apart from the ends "
                    f"and from one another, given {place!r}",
                )
            taken.append(place)

    def _check_plate(self) -> None:
        """Check that what plates alone have is that of a plate, and that it fits its width."""
        is_solid = self.model.kind == "solid" or self.model.file is not None
        of_plates = {"mesh.across": self.mesh.across is not None}
        for number, delamination in enumerate(self.delamination, start=1):
            of_plates[f"delamination.{number}.across"] = delamination.across is not None
        for number, support in enumerate(self.support.placed, start=1):
            if support.is_edge and not is_solid:
                raise inconsistent(
                    f"support.{number}.side",
                    "expected 'start' or 'end', or an edge of a plate with model.kind = \"solid\", "
                    f"given {support.side!r}",
                )
            of_plates[f"support.{number}.side"] = support.is_edge
        of_plates["scan"] = self.scan is not None
        for key, is_there in of_plates.items():
            if not is_there or self.is_plate:
                continue
            if not is_solid:
                expected = 'expected only with model.kind = "solid"'
                raise inconsistent(key, f'{expected}, of a plate, given "{self.model.kind}"')
            raise inconsistent(
                key, "expected only of a plate: give mesh.across, the number of cells across it"
            )
        if not self.is_plate:
            return
        if self.gap is not None:
            raise inconsistent("gap", "expected [[delamination]] tables of a plate, given a gap")
        self._check_sizes_of_plate()

    def _check_sizes_of_plate(self) -> None:
        """Check that a plate has one width, that patches lie in it, and that edges exist."""
        first = self.lamina[0]
        for lamina in self.lamina if self.mesh.file is None else ():
            if "width" in lamina.profiles or lamina.width != first.width:
                raise inconsistent(
                    f"lamina.{lamina.name}.width",
                    f"expected one number for all laminae of a plate, given {lamina.width!r}",
                )
        half = self.half_width
        for number, patch in enumerate(self.delamination, start=1):
            if patch.across is not None and max(np.abs(patch.across)) > half * (
                1.0 + EDGE_TOLERANCE
            ):
                raise inconsistent(
                    f"delamination.{number}.across",
                    f"expected places from {-half:g} to {half:g} m, the edges of the plate, given "
                    f"{[*patch.across]}",
                )
        for number, support in enumerate(self.support.placed, start=1):
            if self.mesh.file is None and support.side not in (None, *EDGES):
                raise inconsistent(
                    f"support.{number}.side",
                    f"expected one of {', '.join(EDGES)}, or a group of facets with mesh.file, "
                    f"given {support.side!r}",
                )
        self._check_scan()
        if self.contact.points_per_element != 1:
            raise inconsistent(
                "contact.points_per_element",
                "expected 1 with plates, whose pairs are at the vertices of their cells, given "
                f"{self.contact.points_per_element}",
            )

    def _check_scan(self) -> None:
        """Check that the scan of a plate is on one of its laminae, and that frames are kept."""
        if self.scan is None:
            return
        names = [lamina.name for lamina in self.lamina]
        if self.scan.lamina not in (None, *names):
            raise inconsistent(
                "scan.lamina", f"expected one of {', '.join(names)}, given {self.scan.lamina!r}"
            )
        if self.scan.spacing is not None and self.mesh.file is not None:
            raise inconsistent(
                "scan.spacing",
                "expected a file of points with a mesh of your own, whose outline a grid does not "
                "know",
            )
        if not self.output.fields_per_period:
            raise inconsistent(
                "output.fields_per_period",
                "expected 1 or more, because a scan is read at the frames, given 0",
            )

    @property
    def outer_lamina(self) -> Lamina:
        """The thinner one of the outermost laminae, behind which delaminations are looked for."""
        outermost = (self.lamina[-1], self.lamina[0])
        return min(outermost, key=lambda lamina: lamina.mean("thickness") or math.inf)

    @property
    def is_plate(self) -> bool:
        """Whether the laminae are a plate: solids with edges and patches along both axes."""
        if self.model.kind != "solid" and self.model.file is None:
            return False
        has_patch = any(delamination.across is not None for delamination in self.delamination)
        has_edge = any(support.is_edge for support in self.support.placed)
        return self.mesh.across is not None or (
            self.mesh.file is not None and (has_patch or has_edge)
        )

    @property
    def is_of_points(self) -> bool:
        """Whether masses on springs are in place of beams."""
        return self.lamina[0].is_point

    @property
    def is_axial(self) -> bool:
        """Whether nothing bends: bars, or points."""
        return self.is_of_points or self.lamina[0].motion == "axial"

    @property
    def length(self) -> float:
        """Length of the structure: that of its longest lamina [m]."""
        return max(lamina.length for lamina in self.lamina)

    @property
    def thickness(self) -> float:
        """Thickness of all laminae together [m]."""
        return sum(lamina.mean("thickness") for lamina in self.lamina)

    @property
    def half_width(self) -> float:
        """Half of the width of a plate: that of its widest lamina [m]."""
        return 0.5 * max(lamina.mean("width") for lamina in self.lamina)

    @property
    def has_one_length(self) -> bool:
        """Whether all laminae are equally long."""
        return len({lamina.length for lamina in self.lamina}) == 1

    def length_of(self, name: str | None) -> float:
        """Return the length of a lamina by its name; of the structure without one [m]."""
        return next((lamina.length for lamina in self.lamina if lamina.name == name), self.length)

    def contact_length(self, lower: str, upper: str) -> float:
        """Return the length over which two neighbours may touch, that of the shorter one [m]."""
        return min(self.length_of(lower), self.length_of(upper))

    @property
    def is_apart(self) -> bool:
        """Whether all laminae are bodies of their own, apart over their whole length.

        A plate counts as one body.
        """
        if self.gap is not None:
            return True
        if self.is_plate:
            return False
        open_everywhere = {d.between for d in self.delamination if d.spans(self.length)}
        return self.support.is_cantilever and len(open_everywhere) == len(self.lamina) - 1

    @property
    def is_massless(self) -> bool:
        """Whether contact points have no mass, so that modes compute the motion."""
        return self.time.mass == "massless"

    @property
    def without_strikes(self) -> Self:
        """The case without stops, impactors, their sensors, and without an initial state."""
        sensors = tuple(
            sensor for sensor in self.sensor if sensor.stop is None and sensor.impactor is None
        )
        return self.model_copy(
            update={"stop": (), "impactor": (), "initial": (), "sensor": sensors}
        )

    @property
    def without_impactors(self) -> Self:
        """The case without its impactors and their sensors: what vibrates between two blows."""
        sensors = tuple(sensor for sensor in self.sensor if sensor.impactor is None)
        return self.model_copy(update={"impactor": (), "sensor": sensors})

    @property
    def masses(self) -> tuple[PointMass, ...]:
        """The point masses, and those of sensors, which the laminae carry."""
        of_sensors = (
            PointMass(
                lamina=sensor.lamina,
                mass=sensor.mass,
                position=sensor.position,
                surface=None if sensor.quantity == "strain" else sensor.surface,
            )
            for sensor in self.sensor
            if sensor.mass is not None and sensor.lamina is not None
        )
        return (*self.point_mass, *of_sensors)

    @property
    def is_elastic(self) -> bool:
        """Whether a contact is elastic by a number of its own."""
        return any(entry.elastic_by for _, entry in self.contacts)

    @property
    def is_loaded(self) -> bool:
        """Whether weight or constant loads act."""
        return self.gravity is not None or bool(self.load)

    @property
    def has_axial_forces(self) -> bool:
        """Whether weight or loads pull or press beams along their axes."""
        if self.is_axial:
            return False
        is_upright = self.gravity is not None and self.gravity.along != 0.0
        return is_upright or any(load.axial for load in self.load)

    @property
    def begins_at_rest(self) -> bool:
        """Whether runs begin in the state of rest under weight and loads."""
        return self.is_loaded and self.time.begin != "unloaded"

    @property
    def before_loads(self) -> Self:
        """The case whose runs begin without deflections, and whose gaps are those of that shape."""
        gravity = self.gravity and self.gravity.model_copy(update={"gaps": "unloaded"})
        begin = "unloaded" if self.is_loaded else self.time.begin
        time = self.time.model_copy(update={"begin": begin})
        return self.model_copy(update={"gravity": gravity, "time": time})

    @property
    def without_loads(self) -> Self:
        """The case without weight and without constant loads."""
        return self.model_copy(update={"gravity": None, "load": ()})

    @property
    def title(self) -> str:
        """What the case is, in a few words."""
        law = self.contact.law
        scheme = self.time.scheme
        contact = combined_name(law, scheme)
        if "impulse" in combination(law, scheme).reads:
            contact += f", {self.contact.impulse} impulses"
        return f"{self.name}: {self.excitation.words}, contact: {contact}"

    @property
    def as_beams(self) -> Self:
        """The case with beams in place of its solids; `BEAM_CELLS` elements if it has a mesh file.

        Its sensors, stops, impactors and initial states are left out.
        """
        mesh = self.mesh if self.mesh.file is None else Mesh(elements=BEAM_CELLS)
        return self.without_strikes.without_loads.model_copy(
            update={"mesh": mesh, "model": Model(), "sensor": (), "point_mass": self.masses}
        )

    @property
    def is_floating(self) -> bool:
        """Whether something moves without any stiffness: the structure, a point, an impactor."""
        springs = [lamina.stiffness for lamina in self.lamina] + [
            impactor.spring for impactor in self.impactor
        ]
        return self.n_rigid > 0 or 0.0 in springs

    @property
    def is_at_middles(self) -> bool:
        """Whether the mass of beams is at the middles of elements, and nodes have none."""
        return self.is_massless and self.model.kind == "beam"

    @property
    def n_modes(self) -> int:
        """Largest number of modes of each part with massless contact points."""
        return sys.maxsize if self.is_at_middles else self.model.modes

    @property
    def n_rigid(self) -> int:
        """Number of rigid motions that supports leave to a stack kept closed.

        Of laminae that are apart, the sum of all.
        """
        if self.is_of_points:
            return 0
        if self.is_plate:
            return self._n_rigid_of_plate()
        names = [lamina.name for lamina in self.lamina]
        if not self.is_apart:
            return self._n_rigid_of(names)
        return sum(self._n_rigid_of([name]) for name in names)

    def _n_rigid_of(self, names: Sequence[str]) -> int:
        """Return the number of rigid motions that supports leave to a body of some laminae."""
        support = self.support
        length = self.length
        x: list[float] = []
        n_turns = 0
        for end, place in zip(ENDS, (0.0, length), strict=True):
            if support.holds(end):
                x.append(place)
                n_turns += support.kind(end) == "clamped"
        for point in support.points(length):
            if point.lamina is None or point.lamina in names:
                x += [point.x] * point.holds_deflections
                n_turns += point.holds_slopes
        if self.is_axial:
            return int(not x)
        return 2 - bool(x) - (n_turns > 0 or len(set(x)) > 1)  # shift and turn

    def _n_rigid_of_plate(self) -> int:
        """Return the number of the six rigid motions that the edges and points of a plate leave.

        A motion is a + b x r of the middle plane. A group of facets counts as a closed outline.
        """
        half = self.half_width
        L = self.length
        corners = np.array([[0.0, -half], [0.0, half], [L, -half], [L, half]])
        ends = {"start": corners[:2], "end": corners[2:], "left": corners[::2]}
        ends["right"] = corners[1::2]
        rows: list[FloatArray] = []
        for side in self.support.sides:
            kind = self.support.kind(side)
            tables = [table for table in self.support.placed if table.side == side]
            turns = any(table.rotational_stiffness for table in tables)
            for x, z in ends.get(side, corners):
                u = np.array([[1, 0, 0, 0, z, 0], [0, 1, 0, -z, 0, x], [0, 0, 1, 0, -x, 0]])
                if self.support.holds(side):
                    rows += [*u]
                elif any(table.stiffness for table in tables):
                    rows.append(u[1])
            if kind == "clamped" or turns:
                slopes = np.eye(6)[[3, 5]]
                is_across = {"start": [1], "end": [1], "left": [0], "right": [0]}
                rows += [*(slopes if kind == "clamped" else slopes[is_across.get(side, [0, 1])])]
        for support in self.support.inside:
            x = support.x
            for z in (-half, half):
                if support.holds_deflections:
                    rows.append(np.array([0, 1, 0, -z, 0, x]))
            if support.holds_slopes:
                rows.append(np.eye(6)[5])
        for support in self.support.at_points:
            if support.holds_deflections:
                rows.append(np.array([0, 1, 0, -z_of(support.position or 0.0), 0, support.x]))
        if not rows:
            return 6
        scale = np.array([1.0, 1.0, 1.0, L, L, L])
        return 6 - int(np.linalg.matrix_rank(np.array(rows) / scale))

    @property
    def unread(self) -> tuple[str, ...]:
        """Keys that the case sets although a run does not use them, as overrides name them."""
        tables = dict(self._placed())
        return tuple(
            f"{place}.{key}"
            for place, key in idle_keys(self)
            if key in tables[place].model_fields_set
        )

    @property
    def has_lumped_impulses(self) -> bool:
        """Whether impulses act on the hit nodes alone, with this law and scheme."""
        return self.contact.impulse == "lumped" and "impulse" in read_of_contact(self)

    @property
    def has_own_springs(self) -> bool:
        """Whether all contacts that carry a spring have a stiffness of their own."""
        if self.contact.law == "newton":
            return self.is_elastic
        return bool(self.contacts) and all(entry.has_stiffness for _, entry in self.contacts)

    @property
    def is_periodic(self) -> bool:
        """Whether the excitation repeats after each period."""
        return self.excitation.is_periodic

    @property
    def is_harmonic(self) -> bool:
        """Whether the excitation is one sine, whose period is that of the run."""
        return self.excitation.is_harmonic

    @property
    def n_periods(self) -> int:
        """Number of periods to compute, at most; for a sweep, enough to cover its duration."""
        if self.is_periodic:
            periods = self.time.periods
            return self.time.most_periods if periods == "settled" else periods
        if self.time.step is not None:
            return math.ceil(self._least_steps / self.steps_per_period)
        turns = self._length * self.excitation.top_frequency / self.excitation.turns
        return max(1, math.ceil(turns - ROUND_OFF))

    @property
    def _length(self) -> float:
        """Time that a run with an excitation that does not repeat must cover [s]."""
        length = self.time.duration or self.excitation.length
        if length is None:
            raise CaseError("time.duration: missing; load the case from a file, which sets it")
        return length

    @property
    def _least_steps(self) -> int:
        """Number of steps that are no longer than `time.step`."""
        return math.ceil(self._length / (self.time.step or math.inf) * (1.0 - ROUND_OFF))

    @property
    def steps_per_period(self) -> int:
        """Number N of steps of a period; with `time.step`, of a hundredth of the run.

        A period of a multisine has as many for each period of its highest line.
        """
        if self.time.step is None:
            return self.time.steps_per_period * self.excitation.turns
        return max(LEAST_STEPS, math.ceil(self._least_steps / PARTS))

    @property
    def n_window_periods(self) -> int:
        """Number of last periods that are recorded at every step (the window)."""
        if not self.is_periodic and "window_periods" not in self.output.model_fields_set:
            return self.n_periods
        return min(self.output.window_periods, self.n_periods)

    @property
    def frames_per_period(self) -> int:
        """Number of frames of the fields per period of the window."""
        frames = self.output.fields_per_period
        if not self.is_periodic and "fields_per_period" not in self.output.model_fields_set:
            frames = min(frames, max(1, MOST_FRAMES // self.n_window_periods))
        return min(frames, self.steps_per_period)

    @property
    def time_step(self) -> float:
        """Time step dt = 1/(N f), where f is the frequency, of a sweep the highest [s].

        With `time.step`: the longest step up to that one of which whole periods cover the run.
        """
        if self.time.step is None:
            return 1.0 / (self.time.steps_per_period * self.excitation.top_frequency)
        return self._length / (self.n_periods * self.steps_per_period)

    @property
    def period(self) -> float:
        """Length of the N steps of one period [s]."""
        return self.steps_per_period * self.time_step

    def rayleigh(self, i: int) -> tuple[float, float]:
        """Return the damping coefficients of one lamina, C = alpha M + beta K.

        The damping ratio holds at the modes of the lamina alone, as it is held. Where it carries
        point masses or has other supports, and in a bonded stack, these modes follow from the
        matrices, see
        `model.beams.network`.

        Args:
            i: index of the lamina from 0.

        Returns:
            alpha [1/s], beta [s].
        """
        is_even = self.support.holds("start") == self.support.holds("end")
        first, second = self.lamina[i].angular_frequencies(2, is_even=is_even).tolist()
        if self.is_of_points:
            return 0.0, 2.0 * self.lamina[i].damping_ratio / first if first else 0.0
        return harmonics.coefficients(
            self.lamina[i].damping_ratio, first, second, self.damping.kind
        )

    def position_of(self, entry: PointMass | Load | Stop | Impactor) -> float:
        """Return x where an entry acts on its lamina [m]: at the end if it does not say."""
        return self.length_of(entry.lamina) if entry.position is None else x_of(entry.position)

    @property
    def reference_point(self) -> tuple[float, float]:
        """Where a plate has its reference probes: x and z of the middle of the largest patch [m].

        Without patches: the middle of the plate.
        """
        patches = [patch for patch in self.delamination if not patch.spans(self.length)]
        width = self.lamina[0].mean("width")

        def area(patch: Delamination) -> float:
            low, high = patch.across or (0.0, width)
            return (patch.end - patch.start) * (high - low)

        return max(patches, key=area).middle if patches else (0.5 * self.length, 0.0)

    def has_exact_modes(self, i: int) -> bool:
        """Return whether the modes of a lamina that is apart are those of `angular_frequencies`.

        Args:
            i: index of the lamina from 0.
        """
        name = self.lamina[i].name
        has_masses = any(mass.lamina == name for mass in self.masses)
        if has_masses or self.has_axial_forces or not self.lamina[i].is_uniform:
            return False
        if not self.is_axial:
            return self.support.is_cantilever
        return not any(
            point.lamina in (None, name) and (point.side is None or point.kind == "spring")
            for point in self.support.placed
        )

    @property
    def has_exact_laminae(self) -> bool:
        """Whether the laminae are apart, and the modes of each are known exactly."""
        return self.is_apart and all(map(self.has_exact_modes, range(len(self.lamina))))

    def linear_amplitude(self, i: int, frequency: FloatArray) -> FloatArray:
        """Return the exact tip amplitude of one lamina without contact on the moving base.

        The amplitude is NaN if the base does not move harmonically.

        Args:
            i: index of the lamina from 0.
            frequency: frequencies of the base, any shape [Hz].

        Returns:
            Amplitudes, same shape as `frequency` [m].
        """
        lamina = self.lamina[i]
        H = transmissibility(
            2.0 * np.pi * frequency,
            length=lamina.length,
            flexural_rigidity=lamina.flexural_rigidity,
            mass_per_length=lamina.mass_per_length,
            rayleigh=self.rayleigh(i),
        )
        excitation = self.excitation
        if not isinstance(excitation, HarmonicExcitation | SweepExcitation):
            return np.full_like(H, np.nan, dtype=np.float64)
        each = [excitation.displacement_amplitude(f) for f in np.ravel(frequency)]
        return np.asarray(np.reshape(each, np.shape(frequency)) * np.abs(H))

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the case file."""
        return f"<pre>{escape(self.to_toml())}</pre>"

    def to_toml(self) -> str:
        """Return the complete case as TOML; reading the text gives an equal case.

        Keys that the run does not read are left out, unless the case sets them.
        """
        dumped = self.model_dump(exclude_none=True)
        data = {
            key: list(value) if isinstance(value, tuple) else value for key, value in dumped.items()
        }
        tables = dict(self._placed())
        for place, key in (*idle_keys(self), *(() if self.is_periodic else _OF_PERIODS)):
            if key not in tables[place].model_fields_set:
                set_key(data, f"{place}.{key}", None)
        if self.time.duration is not None:  # it may be that of a table
            set_key(data, "time.periods", None)
        absent = {key for key, value in data.items() if value == []}  # no tables
        if self.is_apart and "support" not in self.model_fields_set:
            absent.add("support")
        if self.model == Model():
            absent.add("model")
        return toml_text({key: value for key, value in data.items() if key not in absent})

    @classmethod
    def from_toml(cls, text: str) -> Self:
        """Return the case that `to_toml` wrote, without a check that its files still exist.

        Raises:
            CaseError: the text does not describe a valid case.
        """
        try:
            data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise CaseError(f"case: not valid TOML: {error}") from None
        return cls.checked(data, "case")

    def with_overrides(
        self, overrides: Mapping[str, object] | None = None, **by_word: object
    ) -> Self:
        """Return the case with some keys replaced.

        A key that is one of several alternatives (`mesh.file`, `gap.shape`, `excitation.kind`, …)
        replaces the other alternatives.

        Args:
            overrides: values by key (`excitation.frequency`, `lamina.thick.length`); None removes
                an optional key. File names are relative to the working directory.
            **by_word: values by the last part of a key, if one key alone of this case ends in it:
                `frequency=3.65`.

        Returns:
            The new case, checked as a whole.

        Raises:
            CaseError: a key is unknown, a value is not valid, or a file is missing.
        """
        data = tomllib.loads(toml_text(self.model_dump(exclude_unset=True, exclude_none=True)))
        named = {self._key_of(word): value for word, value in by_word.items()}
        apply_overrides(data, {**(overrides or {}), **named})
        return self.checked(data, f"case {self.name}").with_files_checked(f"case {self.name}")

    def _key_of(self, word: str) -> str:
        """Return the only key of this case whose last part is a word."""
        keys = [
            f"{place}.{key}" for place, entry in self._placed() for key in type(entry).model_fields
        ]
        fitting = [key for key in keys if key.endswith(f".{word}")]
        tables = dict(self._placed())  # a contact without a number of its own has that of [contact]
        having = [
            key for key in fitting if getattr(tables[key.rpartition(".")[0]], word) is not None
        ]
        for names in (fitting, having):
            if len(names) == 1:
                return names[0]
        if fitting:
            raise CaseError(f"{word}: say which: " + " or ".join(f'{{"{k}": …}}' for k in fitting))
        near = difflib.get_close_matches(word, [key.rsplit(".", 1)[-1] for key in keys], n=1)
        hint = f"did you mean {near[0]}?" if near else 'write {"section.key": …}'
        raise CaseError(f"{word}: no key of case {self.name} ends in it; {hint}")

    @classmethod
    def checked(cls, data: Data, label: str) -> Self:
        """Return the case that a dictionary describes, and explain every problem in words.

        Args:
            data: the case as `tomllib` returns it.
            label: name of the case in messages.

        Raises:
            CaseError: the dictionary does not describe a valid case.
        """
        case = cls.__new__(cls)
        try:
            Section.__init__(case, **data)  # `Case(…)` would name the case in another way
            return case
        except ValidationError as error:
            raise CaseError(message(label, error, data)) from None

    def with_files_checked(self, label: str) -> Self:
        """Return the case after a check of its files, with the duration of a tabulated excitation.

        Raises:
            CaseError: a file is missing, or the table of the excitation cannot be used or ends
                before the run.
        """
        for key, file in self.files.items():
            if not file.is_file():
                raise CaseError(f"{label}: {key}: no such file: {file}")
        case = self
        for key, excitation in self._drives():
            case = case._with_series_checked(f"{label}: {key}", excitation)
        return case

    def _with_series_checked(self, label: str, excitation: Excitation) -> Self:
        """Return the case after a check of the table of a drive; see `with_files_checked`."""
        if isinstance(excitation, RandomExcitation | BurstExcitation):
            drive(excitation)  # a table of its density can be used
        if not isinstance(excitation, TableExcitation | RecordExcitation):
            return self
        time, value, unit = excitation.series()
        length = float(time[-1])
        if getattr(excitation, "offset", None) == "refuse" and unit == "m/s2":
            mean = float(scipy.integrate.trapezoid(value, time)) / length
            drift = abs(mean) * length**2 / 8.0
            if drift > OFFSET_DRIFT * self.length:
                raise CaseError(
                    f"{label}.file: expected accelerations without an offset with "
                    f'excitation.offset = "refuse", given the mean {mean:.3g} m/s2, from which the '
                    f'base drifts by {drift:.3g} m; take "remove", or filter the record'
                )
        duration = self.time.duration
        if duration is None:
            section = self.time.model_copy(update={"duration": length})
            return self.model_copy(update={"time": section})
        if duration > length * (1.0 + ROUND_OFF):
            raise CaseError(
                f"{label}.file: expected times up to time.duration = {duration:g} s, "
                f"given {length:g} s"
            )
        return self

    @property
    def files(self) -> dict[str, Path]:
        """The files that the case names, by their keys."""
        named = {
            f"{place}.{key}": getattr(entry, key, None)
            for place, entry in self._placed()
            for key in ("file", "psd")
        }
        return {key: file for key, file in named.items() if file is not None}

    def _drives(self) -> Iterator[tuple[str, Excitation]]:
        """Yield the tables of the excitation with their places, as overrides name them."""
        tables_of = parts_of(self.excitation)
        for number, table in enumerate(tables_of, start=1):
            yield "excitation" if len(tables_of) == 1 else f"excitation.{number}", table

    def _placed(self) -> Iterator[tuple[str, Section]]:
        """Yield the tables of the case with their places, as overrides name them."""
        for name in type(self).model_fields:
            value = getattr(self, name)
            if name == "excitation":
                yield from self._drives()
            elif isinstance(value, Section):
                yield name, value
            elif isinstance(value, tuple):
                for number, entry in enumerate(value, start=1):
                    yield f"{name}.{getattr(entry, 'name', number)}", entry
