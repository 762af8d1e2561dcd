"""Every variable of the dataset of a run, and where results come from.

Each variable has its dimensions, its unit and its meaning here, once. A dataset with a single
interface does not have the dimension `interface`. The coordinates `lamina` and `interface` hold
names.

A result comes from a program, libraries, a machine and a command. Which numbers are equal bit by
bit depends on all of them; see docs/reliability.md.
"""

from __future__ import annotations

import platform
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, version
from itertools import cycle
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, cast

import numba
import numpy as np
import scipy
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from delam_fem.case.toml import message
from delam_fem.case.values import Expected, Finite
from delam_fem.numerics.settling import LONGEST
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    import xarray as xr

    from delam_fem.simulation.signals import Signal

_BLAS = re.compile(r"/(lib(?:open)?blas|libmkl_rt|libblis|libatlas|libflexiblas|libscipy_openblas)")
"""Start of the name of a library with BLAS."""
_MAPS = Path("/proc/self/maps")
_CPU = Path("/proc/cpuinfo")
UNKNOWN = "unknown"
_GIT_SECONDS = 5.0


@cache
def versions() -> dict[str, str]:
    """Return the versions of the program and of the libraries that all results need."""
    return {
        "delam_fem": version("delam_fem"),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "numba": numba.__version__,
    }


@cache
def solvers() -> dict[str, str]:
    """Return the versions of dolfinx and petsc4py by name; "none" if one is not installed."""
    result = {}
    for name, package in (("dolfinx", "fenics-dolfinx"), ("petsc", "petsc4py")):
        try:
            result[name] = distribution(package).version
        except PackageNotFoundError:
            result[name] = "none"
    return result


def provenance() -> dict[str, str]:
    """Return versions, BLAS, machine, git revision and command line by name."""
    return origin() | occasion()


def origin() -> dict[str, str]:
    """Return versions and git revision, which are the same on all machines of a cluster."""
    return {
        **versions(),
        "python": sys.version.split()[0],
        "git_revision": git_revision(),
    }


def occasion() -> dict[str, str]:
    """Return BLAS, machine and command line of this process."""
    return {
        "blas": blas(),
        "host": platform.node() or UNKNOWN,
        "processor": processor(),
        "command": shlex.join(sys.argv).encode("utf-8", "backslashreplace").decode(),
    }


def blas() -> str:
    """Return the files of the BLAS libraries that this process has loaded."""
    return _blas_in(_MAPS, len(sys.modules))


@cache
def _blas_in(maps_file: Path, n_modules: int) -> str:
    """Return what `blas` does; no library is loaded without another module."""
    try:
        lines = maps_file.read_text("utf-8", "replace").splitlines()
    except OSError:
        return UNKNOWN
    paths = {Path(line.split(maxsplit=5)[5]) for line in lines if _BLAS.search(line)}
    return ", ".join(sorted({f"{path.parent.name}/{path.name}" for path in paths})) or UNKNOWN


@cache
def processor() -> str:
    """Return the model of the processor."""
    try:
        match = re.search(r"^model name\s*:\s*(.+)$", _CPU.read_text("utf-8", "replace"), re.M)
    except OSError:
        match = None
    return match[1].strip() if match else platform.processor() or platform.machine() or UNKNOWN


@cache
def git_revision() -> str:
    """Return the revision of the checkout that the package runs from, with "-dirty" if changed.

    The result is "none" if the package is not run from a checkout.
    """
    root = Path(__file__).resolve().parents[2]
    if _git(root, "rev-parse", "--show-toplevel") != str(root):
        return "none"
    return _git(root, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*") or "none"


def _git(root: Path, *arguments: str) -> str:
    """Return the output of a git command; empty if it fails."""
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=_GIT_SECONDS,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()


INTERFACE = "interface"
CONTACT = "contact"
SCAN_POINT = "scan_point"
FORCE_PLACE = "force_place"
SENSOR = "sensor_"
"""Beginning of the names of sensors' variables."""

DIMENSIONS: Mapping[str, str] = MappingProxyType(
    {
        "lamina": "laminae from bottom to top",
        INTERFACE: "pairs of neighbouring laminae from bottom to top; not if there is a single one",
        "time": "every step of the window",
        "period": "all periods of the run",
        "frame": "instants of the window at which fields are kept",
        "dof": "dofs of operators, of one rank its own; only without a case",
        "node": "points along the laminae: nodes, and contact points inside the elements",
        "probe": "further probes, on both sides of delaminations; only if there are any",
        "stop": "contact points of stops and impactors; only if there are any",
        "impactor": "impactors; only if there are any",
        SCAN_POINT: "points of the scan of a plate; only with a scan",
        CONTACT: "contacts whose springs are recorded at each step; only if there are any",
        FORCE_PLACE: "places where forces act; only if drives act at several places",
        "event": "impacts on single pairs in the window, in the order of time",
    }
)
"""Dimensions of the variables with their meaning."""


@dataclass(frozen=True)
class Variable:
    """A variable of the dataset of a run.

    Attributes:
        name: name in the dataset.
        dims: dimensions.
        units: unit; "1" for pure numbers.
        long_name: meaning.
    """

    name: str
    dims: tuple[str, ...]
    units: str
    long_name: str


_TIP = "at the reference probe (the tip of a cantilever), base motion included"
_END = "at the reference probe at the end of the period"
_WITHIN = "displacement at the reference probe within the period"
_LAMINA_TIME = ("lamina", "time")
_LAMINA_PERIOD = ("lamina", "period")
_FIELD = ("lamina", "frame", "node")

_ALL = (
    Variable("time", ("time",), "s", "time"),
    Variable("tip_displacement", _LAMINA_TIME, "m", f"displacement {_TIP}"),
    Variable("tip_velocity", _LAMINA_TIME, "m/s", f"velocity {_TIP}"),
    Variable("base_displacement", ("time",), "m", "displacement of the base"),
    Variable("force", ("time",), "N", "force at the first of its places; only if one acts"),
    Variable("forces", (FORCE_PLACE, "time"), "N", "force at each place"),
    Variable("probe_displacement", ("probe", "time"), "m", "displacement at a further probe"),
    Variable("probe_velocity", ("probe", "time"), "m/s", "velocity at a further probe"),
    Variable("probe_lamina", ("probe",), "1", "number of the probe's lamina from 0"),
    Variable("probe_node", ("probe",), "1", "number of the probe's point"),
    Variable("period", ("period",), "1", "number of the period"),
    Variable("strobe_displacement", _LAMINA_PERIOD, "m", f"displacement {_END}"),
    Variable("strobe_velocity", _LAMINA_PERIOD, "m/s", f"velocity {_END}"),
    Variable("envelope_min", _LAMINA_PERIOD, "m", f"smallest {_WITHIN}"),
    Variable("envelope_max", _LAMINA_PERIOD, "m", f"largest {_WITHIN}"),
    Variable(
        "impulse_sum",
        ("period",),
        "N s",
        "sum of impulses in the period; no limit in the number of contact points",
    ),
    Variable("impact_count", ("period",), "1", "impulses on pairs in the period"),
    Variable("energy_kinetic", ("period",), "J", "kinetic energy at the end of the period"),
    Variable(
        "energy_strain",
        ("period",),
        "J",
        "strain energy at the end of the period, with the potential of weight and constant loads",
    ),
    Variable(
        "energy_spring", ("period",), "J", "energy in contact springs at the end of the period"
    ),
    Variable("energy_base_work", ("period",), "J", "work of the base in the period"),
    Variable("energy_force_work", ("period",), "J", "work of all forces in the period"),
    Variable(
        "energy_force_works",
        (FORCE_PLACE, "period"),
        "J",
        "work of the force at each place in the period",
    ),
    Variable("energy_damping_loss", ("period",), "J", "energy lost to damping in the period"),
    Variable(
        "energy_contact_damping_loss",
        ("period",),
        "J",
        "energy lost to contact dampers in the period",
    ),
    Variable("energy_impact_loss", ("period",), "J", "energy lost to impacts in the period"),
    Variable(
        "energy_spring_released",
        ("period",),
        "J",
        "energy set free by switching contact springs in the period",
    ),
    Variable(
        "energy_residual", ("period",), "J", "energy of the period that the ledger does not explain"
    ),
    Variable("x", ("node",), "m", "position along the laminae"),
    Variable("tip_node", (), "1", "number of the point at which tip_… is taken"),
    Variable("gap0", (INTERFACE, "node"), "m", "gap at rest"),
    Variable("end", ("lamina",), "m", "end of the lamina; fields beyond it have the values there"),
    Variable(
        "spring_share",
        (INTERFACE, "node"),
        "1",
        "stiffness and damping of a contact spring at the point, relative to those of the case",
    ),
    Variable("frame", ("frame",), "s", "time of the frame"),
    Variable("displacement", _FIELD, "m", "displacement, base motion included"),
    Variable("slope", _FIELD, "1", "slope of the displacement"),
    Variable("velocity", _FIELD, "m/s", "velocity, base motion included"),
    Variable("moment", _FIELD, "N m", "bending moment E I u''"),
    Variable(
        "contact_state",
        (INTERFACE, "frame", "node"),
        "1",
        "contact state: 0 open, 1 hit, 2 resting",
    ),
    Variable("scan_x", (SCAN_POINT,), "m", "position along the laminae of a point of the scan"),
    Variable("scan_z", (SCAN_POINT,), "m", "position across of a point of the scan"),
    Variable("scan_displacement", ("frame", SCAN_POINT), "m", "deflection, base motion included"),
    Variable("scan_velocity", ("frame", SCAN_POINT), "m/s", "velocity, base motion included"),
    Variable("dof_displacement", ("frame", "dof"), "m", "u of each dof; only of operators"),
    Variable("dof_velocity", ("frame", "dof"), "m/s", "v of each dof; only of operators"),
    Variable("stop_number", ("stop",), "1", "number of its stop, from 1; impactors count on"),
    Variable("stop_lamina", ("stop",), "1", "number of the lamina that may strike it, from 0"),
    Variable("stop_node", ("stop",), "1", "point that may strike it"),
    Variable("stop_height", ("stop",), "m", "its height above the lamina at rest"),
    Variable("stop_on_base", ("stop",), "1", "1: it moves with the base; 0: it is on the ground"),
    Variable("impactor_displacement", ("impactor", "time"), "m", "displacement of an impactor"),
    Variable("impactor_velocity", ("impactor", "time"), "m/s", "velocity of an impactor"),
    Variable(
        "contact_force",
        (CONTACT, "time"),
        "N",
        "force of a contact with springs, positive in compression; impulses count over the step",
    ),
    Variable("stop_state", ("frame", "stop"), "1", "contact state: 0 open, 1 hit, 2 resting"),
    Variable("event_time", ("event",), "s", "time of the impact"),
    Variable("event_interface", ("event",), "1", "number of the interface that is hit; -1: a stop"),
    Variable("event_stop", ("event",), "1", "contact point of stops that is hit, from 0; -1: none"),
    Variable("event_pair", ("event",), "1", "contact pair that is hit, from 0; only of operators"),
    Variable("event_node", ("event",), "1", "point that is hit"),
    Variable("event_impulse", ("event",), "N s", "impulse that parts the laminae"),
    Variable("event_velocity_before", ("event",), "m/s", "gap rate before the impact"),
    Variable(
        "event_energy",
        ("event",),
        "J",
        "change of energy of the impact: impulse times the mean of the gap rates before and after",
    ),
    Variable(
        "heat",
        (INTERFACE, "node"),
        "W",
        "mean power that impacts and contact dampers take at the point, over the window",
    ),
    Variable("stop_heat", ("stop",), "W", "the same as heat, at the contact point of a stop"),
)

VARIABLES: Mapping[str, Variable] = MappingProxyType({entry.name: entry for entry in _ALL})
"""The variables by name, in the order of the dataset."""
OPTIONAL = frozenset({
    "force", "forces", "energy_force_works", "probe_displacement", "probe_velocity",
    "probe_lamina", "probe_node",
    "dof_displacement", "dof_velocity", "stop_number", "stop_lamina", "stop_node", "stop_height",
    "stop_on_base", "impactor_displacement", "impactor_velocity", "stop_state", "event_interface",
    "event_stop", "event_pair", "heat", "stop_heat", "contact_force", "end",
    "scan_x", "scan_z", "scan_displacement", "scan_velocity",
})  # fmt: skip
"""Variables that the result of a case may do without."""
NUMBERING: Mapping[str, str] = MappingProxyType({
    "tip_node": "node", "probe_lamina": "lamina", "probe_node": "node", "stop_lamina": "lamina",
    "stop_node": "node", "event_interface": INTERFACE, "event_stop": "stop", "event_node": "node",
})  # fmt: skip
"""Variables whose values number the entries of a dimension, from 0, and that dimension."""
NONE_HIT = ("event_interface", "event_stop")
"""Those of them that are -1 where there is none."""
OUTCOMES = ("completed", "diverged", "interrupted", "failed")
"""How a run may end."""
RISING = ("time", "frame", "x", "period")
"""Coordinates that increase."""


def require_history(data: xr.Dataset, label: str) -> None:
    """Require that a dataset is one of a run: names, dimensions, types, and finite numbers.

    Numbers of a run that has diverged need not be finite, except coordinates.

    Args:
        data: the dataset, as it was read from a file.
        label: name of the file in messages.

    Raises:
        CaseError: it is not.
    """
    problem = next(_problems(data), None)
    if problem is not None:
        raise CaseError(f"{label}: expected the result of a run, found {problem}")


def _problems(data: xr.Dataset) -> Iterator[str]:
    """Yield in words what the dataset of a run must not have."""
    if data.attrs.get("outcome") not in OUTCOMES:
        yield f"no outcome that is one of {', '.join(OUTCOMES)}"
    yield from (
        f"no text in the attribute {k}"
        for k in ("case", "title")
        if not isinstance(data.attrs.get(k, ""), str)
    )
    yield from (
        f"no {name}"
        for name in ("lamina", *VARIABLES)
        if name not in data.variables and name not in OPTIONAL
    )
    yield from (f"no {dim}" for dim in ("lamina", "time", "period", "node") if not data.sizes[dim])
    has_interfaces = INTERFACE in data.dims
    is_finite = data.attrs["outcome"] != "diverged"
    for name, variable in data.variables.items():
        key = str(name)
        if key in ("lamina", INTERFACE, "probe", CONTACT, FORCE_PLACE):
            dims: tuple[str, ...] = (key,)
            kinds = "OUT" if variable.size else "OUTf"
        elif key in VARIABLES:
            dims = tuple(d for d in VARIABLES[key].dims if has_interfaces or d != INTERFACE)
            kinds = "iu" if key in NUMBERING else "fiub"
        elif key.startswith(SENSOR):
            yield from _sensor_problems(key, variable)
            dims = tuple(map(str, variable.dims))
            kinds = "f"
        else:
            dims = ()
            kinds = ""
        if variable.dtype.kind not in kinds or variable.dims != dims:
            yield f"{key[:40]!r} with the dimensions {variable.dims} and values of another kind"
        if "U" in kinds:
            names = variable.values.tolist()
            if not all(isinstance(text, str) for text in names) or len(set(names)) < len(names):
                yield f"no names in {key}"
        elif (is_finite or key in RISING) and not np.isfinite(variable.values).all():
            yield f"{key} with numbers that are not finite"
        if key in RISING and np.any(np.diff(variable.values) <= 0):
            yield f"{key} that does not increase"
        if key in NUMBERING:
            first = -1 if key in NONE_HIT else 0
            size = max(data.sizes.get(NUMBERING[key], 1), 0)
            if np.any((variable.values < first) | (variable.values >= size)):
                yield f"{key} that numbers no {NUMBERING[key]}"
    n_interfaces = data.sizes.get(INTERFACE, 1)
    if n_interfaces != data.sizes["lamina"] - 1:
        yield f"{n_interfaces} interfaces of {data.sizes['lamina']} laminae"


def _sensor_problems(name: str, variable: xr.Variable) -> Iterator[str]:
    """Yield in words what the variable of a sensor, or its time, must not have."""
    time = name if name.endswith("_time") else f"{name}_time"
    if variable.dims not in (("time",), (time,)):
        yield f"{name[:40]!r} with the dimensions {variable.dims}"
    for key in ("units", "long_name"):
        if not isinstance(variable.attrs.get(key), str):
            yield f"{name[:40]!r} without {key}"


SHOWN = {"m": ("mm", 1e3), "J": ("mJ", 1e3), "1": ("", 1.0)}
"""Units that tables and figures show in place of others, and the factors."""


@dataclass(frozen=True)
class Measure(Variable):
    """A number of a run: an entry of summary.json, a variable of sweeps, a row of tables.

    Attributes:
        is_percent: whether the number is shown in percent.
    """

    is_percent: bool = False

    @property
    def shown(self) -> tuple[str, float]:
        """The unit in which tables show the number, and the factor to it."""
        return ("%", 100.0) if self.is_percent else SHOWN.get(self.units, (self.units, 1.0))


_LAMINA = ("lamina",)
_MEASURES = (
    Measure("outcome", (), "", "how the run ended: completed, diverged, interrupted or failed"),
    Measure("engine", (), "", "what computed the steps"),
    Measure("law", (), "", "contact law; of operators"),
    Measure("scheme", (), "", "time integration; of operators"),
    Measure("probes", ("probe",), "", "names of the probes; of operators"),
    Measure("steps", (), "1", "time steps of the whole run, of all sizes"),
    Measure("wall_seconds", (), "s", "duration of the computation"),
    Measure("microseconds_per_step", (), "µs", "duration per time step"),
    Measure("unforeseen_contacts", (), "1",
        "share of contacts that coarse steps did not see; 0 is good, above 0.05 the run warns"),
    Measure("blow_steps", (), "1",
        "fewest steps in a blow on a contact spring; below 10 the run warns; – without springs"),
    Measure("tip_min", _LAMINA, "m",
        "smallest displacement of each tip over the last periods, base motion included"),
    Measure("tip_max", _LAMINA, "m", "largest displacement of each tip over the last periods"),
    Measure("tip_amplitude", _LAMINA, "m", "half peak-to-peak displacement of each tip"),
    Measure("probe_min", ("probe",), "m", "smallest displacement of each probe; of operators"),
    Measure("probe_max", ("probe",), "m", "largest displacement of each probe; of operators"),
    Measure("probe_amplitude", ("probe",), "m", "half of the difference of both; of operators"),
    Measure("periodicity", (), "1",
        "periods of the excitation after which the motion repeats, 1 to 8; – if it does not"),
    Measure("periodicity_class", (), "",
        "the same with a margin; undecided: thresholds of 8.3 % and 12 % give different answers"),
    Measure("strobe_scatters", ("distance",), "1",
        "how much cycles 1, 2, … 8 periods apart differ", True),
    Measure("strobe_scatter", (), "1",
        "how much cycles differ that repeat, rms in half peak-to-peak amplitudes", True),
    Measure("settled", (), "",
        "whether the transient has died out; irregular: it has, no cycle repeats"),
    Measure("judged_by", ("channel",), "", "channels whose cycles say so"),
    Measure("settling", (), "", "the numbers behind it"),
    Measure("transient", (), "1",
        "what is left of the transient, in half peak-to-peak amplitudes", True),
    Measure("uncertainty", (), "1", "two standard errors of the transient", True),
    Measure("scatter", (), "1",
        "how much the cycles scatter, in half peak-to-peak amplitudes", True),
    Measure("allowed", (), "1",
        "transient of a settled motion, at most: 1 %, or the scatter of its cycles", True),
    Measure("decay", (), "1", "e-folds of the slowest mode per period, without contact"),
    Measure("observed_decay", (), "1",
        "e-folds per period by which the cycles draw nearer to one another"),
    Measure("periods_judged", (), "1", "last periods that were judged"),
    Measure("periods_needed", (), "1",
        "further periods until it has settled, at most; – if nothing bounds them"),
    Measure("intervals", (), "",
        "means over windows of an irregular motion with their 95 % intervals"),
    Measure("periods", (), "1", "periods computed"),
    Measure("tip_contacts_per_period", (), "1",
        "how often the tips meet; closures within 0.05 periods count once"),
    Measure("impacts_per_period", (), "1",
        "impulses on single pairs; depends on the time step, does not converge"),
    Measure("rest", (), "", "state of rest under weight and loads: displacements of the tips [m], "
        "contact forces [N], factor on weight and axial forces at which the structure buckles"),
    Measure("contacts", (CONTACT,), "",
        "what each interface, stop and impactor did: strikes, speed, impulse, force"),
    Measure("channels", ("channel",), "",
        "min, max, amplitude (half peak-to-peak), rms and units of each channel of the record"),
    Measure("distortion_factor", _LAMINA, "1",
        "d = √(ΣAᵢ²)/A₁ − 1 over all harmonics: how far each tip is from a sine", True),
    Measure("thd", _LAMINA, "1",
        "amplitude of all higher harmonics over that of the first, for each tip", True),
    Measure("minimum_tip_gap", (), "m",
        "smallest gap at the tips; negative: the contact gives way so far"),
    Measure("energy_residual", (), "1",
        "relative energy that the ledger does not explain: round-off if all is well"),
    Measure("impact_energy_gain", (), "J",
        "energy that single instants of impact have added, without what others have taken"),
    Measure("unread_keys", ("key",), "", "keys of the case that this run did not use"),
    Measure("warnings", ("warning",), "", "warnings of the run"),
    Measure("message", (), "", "why the run diverged or failed, and what may help; only then"),
)  # fmt: skip

MEASURES: Mapping[str, Measure] = MappingProxyType({entry.name: entry for entry in _MEASURES})
"""Every entry of summary.json, by name. Sweeps, pages and tables take unit and meaning from here;
`diagnostics.summary_of` computes those of the motion. Tips are the reference probes."""


@dataclass(frozen=True)
class ChannelMeasure:
    """A number of a channel.

    Attributes:
        meaning: the number in words.
        of: function of values over time, shape (…, k), that returns it, shape (…), in their unit.
    """

    meaning: str
    of: Callable[[FloatArray], Any]


CHANNEL_MEASURES: Mapping[str, ChannelMeasure] = MappingProxyType(
    {
        "min": ChannelMeasure("smallest", lambda values: values.min(axis=-1)),
        "max": ChannelMeasure("largest", lambda values: values.max(axis=-1)),
        "amplitude": ChannelMeasure(
            "half peak-to-peak", lambda values: np.ptp(values, axis=-1) / 2.0
        ),
        "rms": ChannelMeasure(
            "root mean square of the", lambda values: np.sqrt(np.mean(values**2, axis=-1))
        ),
        "mean": ChannelMeasure("mean of the", lambda values: values.mean(axis=-1)),
    }
)
"""What can be said of any channel, by name."""


_Text: TypeAlias = Annotated[str, Field(strict=True), Expected("a text")]
_Numbers: TypeAlias = Finite | list[Finite | None] | None


class _Interval(BaseModel):
    """A mean with its interval."""

    mean: _Numbers
    half_width: _Numbers
    windows: Finite
    periods: Finite


class _Channel(BaseModel, extra="allow"):
    """The measures of a channel, with its unit."""

    __pydantic_extra__: dict[str, Finite | None]
    units: _Text = ""


class _Rest(BaseModel):
    """A state of rest."""

    tip_displacement: list[Finite] | None
    contact_force: dict[str, Finite]
    buckling_factor: Finite | None


def require_summary(summary: object, n_laminae: int, label: str) -> dict[str, Any]:
    """Return what was read from summary.json, if it is what `MEASURES` says.

    Args:
        summary: what was read.
        n_laminae: number of the laminae of the result.
        label: what it is of, for messages.

    Raises:
        CaseError: it is no table, or an entry has another form.
    """
    try:
        _summary_form(n_laminae).model_validate(summary)
    except ValidationError as error:
        table = summary if isinstance(summary, dict) else {}
        raise CaseError(message(label, error, table)) from None
    return cast("dict[str, Any]", summary)


@cache
def _summary_form(n_laminae: int) -> type[BaseModel]:
    """Return the form of summary.json; entries that `MEASURES` does not know may have any."""
    forms: dict[str, Any] = {}
    for name, measure in MEASURES.items():
        most = max(n_laminae, 1) if measure.dims == _LAMINA else LONGEST
        if measure.units:
            several = Annotated[list[Finite | None], Field(min_length=1, max_length=most)]
            forms[name] = several | None if measure.dims else Finite | None
        else:
            forms[name] = list[_Text] | None if measure.dims else _Text | None
    numbers: dict[str, Any] = {number.name: (Finite | None, ...) for number in CONTACTS}
    contact = create_model("Contact", name=(_Text, ...), kind=(_Text, ...), **numbers)
    forms |= {
        "settling": dict[str, Finite | None] | None,
        "rest": _Rest | None,
        "contacts": list[contact] | None,  # type: ignore[valid-type]
        "channels": dict[str, _Channel] | None,
        "intervals": dict[str, _Interval] | None,
        **dict.fromkeys(("unread_keys", "warnings", "probes"), list[_Text]),
    }
    entries: dict[str, Any] = {name: (form, None) for name, form in forms.items()}
    return create_model("Summary", __config__=ConfigDict(extra="allow"), **entries)


ELSEWHERE = ("warnings", "message")
"""Entries that a page shows above its tables."""
LAST = ("outcome", "periods", "engine", "steps", "wall_seconds", "microseconds_per_step",
        "unforeseen_contacts", "unread_keys")  # fmt: skip
"""Entries about the computation, which follow those about the motion."""


def rows(summary: Mapping[str, Any], laminae: Sequence[str]) -> list[tuple[str, str, str]]:
    """Return table rows of a summary: name, value with its unit, meaning.

    Args:
        summary: the numbers of summary.json.
        laminae: names of the laminae, shown before the values of each.
    """
    intervals = summary.get("intervals") or {}
    values: dict[str, Any] = {}
    for key, value in summary.items():
        if key == "rest" and value is not None:
            values |= {f"rest_{name}": entry for name, entry in value.items()}
            values["rest_contact_force"] = list(value["contact_force"].values())
        elif isinstance(value, Mapping):
            values |= value if key == "settling" else {}
        elif key not in (*ELSEWHERE, "settling", "intervals", "contacts", "rest"):
            values[key] = value
    return [
        _row(key, values[key], intervals.get(key), laminae)
        for key in sorted(values, key=LAST.__contains__)
    ]


def _row(
    key: str, value: Any, interval: Mapping[str, Any] | None, laminae: Sequence[str]
) -> tuple[str, str, str]:
    """Return the row of an entry, or of its mean with its interval if it has one."""
    known = MEASURES.get(key)  # None: of another version
    (unit, factor), meaning = (known.shown, known.long_name) if known else (("", 1.0), "")
    widths = [""]
    if interval is not None:
        value = np.atleast_1d(interval["mean"]).astype(float).tolist()
        widths = [
            f" ± {factor * w:.2g}"
            for w in np.atleast_1d(interval["half_width"]).astype(float).tolist()
        ]
        about = f"{interval['windows']} windows in {interval['periods']} periods"
        meaning = f"mean and 95 % interval, {about}: {meaning}"
    is_list = isinstance(value, (list, tuple, np.ndarray))
    entries = list(value) if is_list else [value]
    is_named = is_list and not any(isinstance(entry, str) for entry in entries)
    is_named &= len(entries) == len(laminae)
    names = [f"{name} " for name in laminae] if is_named else [""] * len(entries)
    text = ", ".join(
        name + shown(entry, factor) + width
        for name, entry, width in zip(names, entries, cycle(widths), strict=False)
    )
    with_unit = f"{text or 'none'}\u00a0{unit}" if unit and value is not None else text or "none"
    return key.replace("_", " "), with_unit, meaning


CONTACTS = (
    Measure("strikes_per_period", (), "1", "closures within 0.05 periods count once"),
    Measure("approach_velocity", (), "m/s", "mean speed of approach of the strikes"),
    Measure("impulse", (), "N s", "mean impulse of a strike, by impacts and by springs"),
    Measure("peak_force", (), "N", "largest force at the end of a step; impacts have none"),
    Measure("closed_share", (), "1", "share of the steps at which it is closed", True),
)
"""Numbers of a contact, the entries of `contacts` in a summary besides name and kind."""


def contact_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return table rows of the contacts of a summary: name, then the numbers `CONTACTS`."""
    return [
        (str(contact["name"]), *(
            shown(contact[number.name], number.shown[1]) for number in CONTACTS
        ))
        for contact in summary.get("contacts") or ()
    ]  # fmt: skip


def contact_heading() -> tuple[str, ...]:
    """Return the heading of `contact_rows`: names with units."""
    columns = (
        f"{number.name.replace('_', ' ')}{f' [{number.shown[0]}]' if number.shown[0] else ''}"
        for number in CONTACTS
    )
    return ("contact", *columns)


def shown(value: Any, factor: float = 1.0) -> str:
    """Return a value of the summary as text; numbers are multiplied."""
    if isinstance(value, (list, tuple, np.ndarray)):
        return ", ".join(shown(entry, factor) for entry in value)
    if isinstance(value, float):
        return f"{factor * value:.4g}".replace("-", "−")
    return "–" if value is None else str(value)


def add(data: xr.Dataset, **variables: Any) -> None:
    """Add variables to a dataset with their dimensions, units and meanings.

    Values of a single interface come without the dimension `interface`.

    Args:
        data: the dataset.
        variables: values by the names of `VARIABLES`.

    Raises:
        KeyError: the schema has no such variable.
        ValueError: the values do not have its dimensions.
    """
    rows: dict[str, Any] = {}
    for name, values in variables.items():
        row = VARIABLES[name]
        array = np.asarray(values)
        dims = row.dims
        if INTERFACE in dims and array.ndim == len(dims) - 1:
            dims = tuple(dim for dim in dims if dim != INTERFACE)
        rows[name] = (dims, array, {"units": row.units, "long_name": row.long_name})
    data.update(rows)  # at once: one by one takes several times as long


def with_sensor(data: xr.Dataset, signal: Signal) -> xr.Dataset:
    """Return the dataset with the variable `sensor_NAME` of a sensor.

    The variable's dimension is `time`; with a sampling rate it is `sensor_NAME_time`, with a
    coordinate of that name [s].
    """
    sensor, name, dim = signal.sensor, f"{SENSOR}{signal.sensor.name}", "time"
    if sensor.sampling_rate is not None:
        dim = f"{name}_time"
        meaning = {"units": "s", "long_name": f"time of the samples of {sensor.name}"}
        data = data.assign_coords({dim: (dim, signal.time, meaning)})
    about: dict[str, Any] = {
        "units": sensor.unit,
        "long_name": sensor.words,
        "quantity": sensor.quantity,
    }
    keys = ("lamina", "position", "surface", "sampling_rate", "noise")
    about |= {key: value for key in keys if (value := getattr(sensor, key)) is not None}
    if isinstance(sensor.position, tuple):  # x and z
        about["position"] = [*sensor.position]
    if sensor.between is not None:
        about["between"] = list(sensor.between)
    about["alternating"] = signal.alternating
    data[name] = (dim, signal.value, about)
    return data


def sensors_of(history: xr.Dataset) -> list[str]:
    """Return the names of the variables of sensors, in the order of the case."""
    return [str(name) for name in history.data_vars if str(name).startswith(SENSOR)]


def by_interface(values: xr.DataArray) -> np.ndarray[Any, np.dtype[Any]]:
    """Return a variable with the interfaces as its first axis, also where there is only one."""
    array = values.to_numpy()
    return array if INTERFACE in values.dims else array[None]


def event_interfaces(history: xr.Dataset) -> np.ndarray[Any, np.dtype[Any]]:
    """Return the number of the interface that each event hits, also if there is only one."""
    if "event_interface" in history:
        return history["event_interface"].to_numpy()
    return np.zeros(history.sizes["event"], dtype=np.int64)
