"""Describe a refinement study: one case by several methods, on finer meshes with smaller steps.

A study is one case by several methods, on finer and finer meshes, with smaller steps. One run of a
study is a level. This module describes the levels; `level.py` computes one level, and `run.py`
computes all of them.

Warnings say where refinement goes below what the beam and its damping can mean. Two lengths bound
what a finer mesh adds. Overdamped modes do not oscillate: a bump as short as their waves creeps
back. And a beam knows nothing of what happens within its thickness.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import Literal, TypeAlias, get_args

from delam_fem.api import (
    CHANNEL_MEASURES,
    COMBINATIONS,
    LAWS,
    WITHOUT_FRAMES,
    Case,
    CaseError,
    EngineName,
    Impulse,
    cells_along,
    combined_name,
    content_of,
    harmonics,
    identity,
    node_coordinates,
    require,
    require_kind,
    solid_mesh,
)


def short_waves(case: Case) -> list[tuple[float, float]]:
    """Return the longest overdamped bending wave of each lamina, from bottom to top.

    A wave of a beam has the length λ = 2π (EI/ρA)^(1/4) / ω^(1/2). With mass damping alone no mode
    is overdamped by its shortness, and the length is 0.

    Returns:
        Its length [m], and the frequency that it would have undamped [Hz].
    """
    waves = []
    for i, lamina in enumerate(case.lamina):
        omega = harmonics.overdamped_from(*case.rayleigh(i))
        stiffness = lamina.flexural_rigidity / lamina.mass_per_length
        length = 2.0 * math.pi * stiffness**0.25 / math.sqrt(omega) if omega > 0.0 else math.inf
        waves.append((length, omega / (2.0 * math.pi)))
    return waves


def refinement_warnings(case: Case, points: Iterable[int]) -> list[str]:
    """Return a warning for each length of the beam model that some of the meshes go below.

    Points at a distance h hold waves down to the length 2 h.

    Args:
        case: the case that is refined.
        points: numbers of contact points along the laminae, of all meshes.
    """
    if case.is_axial:  # both lengths are those of bending
        return []
    numbers = sorted(set(points))
    waves = zip(short_waves(case), case.lamina, strict=True)
    (length, frequency), lamina = max(waves, key=lambda wave: wave[0][0])
    thickest = max(case.lamina, key=lambda own: own.mean("thickness"))
    texts = []
    if creeping := [n for n in numbers if 2.0 * case.length / n < length]:
        texts.append(
            f"{_meshes(case, creeping)} hold waves shorter than {_mm(length)} mm, and "
            f"those are overdamped ({lamina.name}: modes above {frequency:.3g} Hz, "
            f"{case.damping.rayleigh} damping): what such a mesh adds does not wave, it creeps"
        )
    if thin := [n for n in numbers if case.length / n < thickest.mean("thickness")]:
        texts.append(
            f"{_meshes(case, thin)} have points nearer to one another than the thickness "
            f"{_mm(thickest.mean('thickness'))} mm of {thickest.name}: a beam has no meaning there"
        )
    return texts


def _meshes(case: Case, numbers: list[int]) -> str:
    first = numbers[0]
    return f"meshes from {first} points along the laminae on ({_mm(case.length / first)} mm apart)"


def _mm(length: float) -> str:
    return f"{1e3 * length:.3g}"


@dataclass(frozen=True)
class PointMesh:
    """A mesh with contact points inside its elements.

    Attributes:
        mesh: number of equal elements per lamina, or the mesh file.
        per_element: number of contact points per element.
    """

    mesh: int | Path
    per_element: int

    def __str__(self) -> str:
        """Return the mesh as part of a level's key."""
        return f"{self.mesh}x{self.per_element}"


MeshChoice: TypeAlias = int | Path | PointMesh
"""Number of equal elements per lamina, or a mesh file, maybe with points inside elements."""

IMPULSES = get_args(Impulse)
ELEMENTS = (5, 10, 20, 40, 80, 160)
POINTS = (1, 2, 4, 8)
STEPS = (250, 500, 1000, 2000, 4000, 8000, 16000)
LIMIT_STEPS = 64000
PERIODS, SETTLING = 60, 30
"""Number of periods of the statistics, and number of settling periods before them."""
MANY_STEPS, FEW_PERIODS = 16000, 10
"""With more than MANY_STEPS steps per period the cycles scatter little, and FEW_PERIODS suffice."""
METHODS = (
    "newton@newmark",
    "newton-penalty@newmark",
    "penalty@newmark",
    "newton@moreau-jean",
    "newton@moreau-jean:64",
)
"""Methods that are compared by default; of massless contact points the last two."""
RIGID: dict[str, object] = {"contact.law": "newton@moreau-jean", "time.refine": 1}
"""Method whose run with very small steps stands for the rigid limit of a mesh. Newton's law has the
same limit with Newmark, but is closer to it with Moreau–Jean."""


@dataclass(frozen=True)
class Method:
    """A method that a study compares: a law with its scheme, and maybe other keys of the case.

    Attributes:
        name: name in tables and figures.
        overrides: keys of the case that the method sets, with their values.
    """

    name: str
    overrides: tuple[tuple[str, object], ...]


FREE = Method("none", (("contact.law", "none@newmark"), ("time.refine", 1)))
"""Method without contact, for which an exact solution is known."""
LIMIT = Method("limit", tuple(RIGID.items()))
"""Method that stands for the rigid limit of a mesh; see `RIGID`."""


def method(text: str) -> Method:
    """Return the method that a text names: LAW or LAW@SCHEME, maybe with :R, /lumped, /consistent.

    A law without a scheme gets the first scheme that it can be combined with. The name of the
    method always contains the scheme. `:64` divides steps near contact into up to 64; without it no
    step is divided.

    Raises:
        CaseError: the text has another form, or its law and scheme cannot be combined.
    """
    timed, slash, impulse = text.partition("/")
    pair, colon, refine = timed.partition(":")
    law, at, scheme = pair.partition("@")
    schemes = [name for known, name in COMBINATIONS if known == law and law != "none"]
    is_known = schemes and (not at or scheme in schemes) and (not slash or impulse in IMPULSES)
    if not is_known or (colon and not refine.isdecimal()):
        laws = [name for name in LAWS if name != "none"]
        raise CaseError(
            f"laws: expected one of {', '.join(laws)}, with its scheme as in {METHODS[0]}, and "
            f"with refined steps as in {METHODS[0]}:64, and with the impulse as in "
            f"{METHODS[0]}/lumped where that matters, given {text!r}"
        )
    name = combined_name(law, scheme or schemes[0])
    chosen: list[tuple[str, object]] = [("contact.law", name), ("time.refine", int(refine or 1))]
    if slash:
        chosen.append(("contact.impulse", impulse))
    return Method(name + colon + refine + slash + impulse, tuple(chosen))


def usual_methods(case: Case) -> tuple[Method, ...]:
    """Return the methods that a case is compared by if none are given.

    Elastic contacts do not go with impulses within a step. Such a case keeps its law, or is
    computed with `penalty`.
    """
    texts: Sequence[str] = METHODS[-2:] if case.is_massless else METHODS
    if case.is_elastic:
        goes = ("penalty", case.time.scheme) in COMBINATIONS
        law = "penalty" if case.contact.law == "none" else case.contact.law
        texts = (combined_name(law, case.time.scheme if goes else "newmark"),)
    return tuple(method(text) for text in texts)


JUDGED_MEASURES = ("min", "max", "rms")
"""Measures of a channel that are judged if none is named."""


def channel_of(text: str) -> tuple[str, tuple[str, ...]]:
    """Return the name of the channel and the measures that a text NAME or NAME:MEASURE asks for."""
    name, colon, measure = text.rpartition(":")
    if colon and measure in CHANNEL_MEASURES:
        return name, (measure,)
    return text, JUDGED_MEASURES


@dataclass(frozen=True)
class Level:
    """One run of a study.

    Attributes:
        method: name of the method.
        mesh: number of equal elements per lamina, or the mesh file.
        elements: number of elements per lamina.
        points: number of contact points per lamina.
        steps: number N of steps per period.
        periods: number of last periods in the statistics.
        case: the case that the level computes.
        of: names of the channels whose measures are statistics.
    """

    method: str
    mesh: MeshChoice
    elements: int
    points: int
    steps: int
    periods: int
    case: Case
    of: tuple[str, ...] = ()

    @property
    def mesh_text(self) -> str:
        """The mesh in words."""
        points = (
            f" with {self.mesh.per_element} points each" if isinstance(self.mesh, PointMesh) else ""
        )
        return f"{self.elements} elements{points}"

    @cached_property
    def key(self) -> str:
        """Key of the level within its study; a mesh file is known by its content."""
        plain = _plain(self.mesh)
        mesh = str(self.mesh)
        if isinstance(plain, Path):
            mesh = mesh.replace(str(plain), content_of(plain, "mesh.file"))
        return f"{self.method} {mesh} {self.steps}"


@dataclass(frozen=True)
class RefinementStudy:
    """The runs of one case by several methods, on several meshes, with several numbers of steps.

    Attributes:
        case: case from which all levels are made.
        methods: methods with contact.
        meshes: meshes from coarse to fine.
        steps: numbers N of steps per period, increasing.
        periods: number of periods in the statistics. As many periods, but at most `SETTLING`, are
            computed before them.
        limit_steps: N of the levels that stand for the rigid limit; 0, or with elastic stops: there
            are no such levels.
        engine: name of the engine that computes the steps.
        judged: names of the numbers that are judged, see `Convergence.judged`.
        of: channels that are judged, as NAME or NAME:MEASURE; with neither: the extremes.
    """

    case: Case
    methods: tuple[Method, ...]
    meshes: tuple[MeshChoice, ...]
    steps: tuple[int, ...]
    periods: int = PERIODS
    limit_steps: int = LIMIT_STEPS
    engine: EngineName = "compiled"
    judged: tuple[str, ...] = ()
    of: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the study before any level is computed.

        Raises:
            CaseError: the excitation is not periodic, a level has an invalid case, or the meshes or
                steps do not become finer.
        """
        if not self.case.is_periodic:
            raise CaseError(
                'converge: expected excitation.kind = "harmonic", because statistics need '
                f'periods, given "{self.case.excitation.kind}"'
            )
        require(self.periods >= 1, "periods", "at least 1", self.periods)
        _require_rising("steps", self.steps)
        if not self.meshes:
            raise CaseError("elements: expected at least one number or mesh file, given none")
        if not (self.case.model.is_continuum or self.meshes == (self.case.mesh.elements,)):
            require_kind(
                self.case,
                "converge",
                ("beam", "plane-stress", "solid"),
                "a reduced model is refined in steps alone: --in steps",
            )
        sizes = [self._new(FREE, mesh, self.steps[0]).points for mesh in self.meshes]
        _require_rising(self.refines, sizes)

    def levels(self) -> list[Level]:
        """Return all levels: those without contact first, then by increasing steps per period."""
        levels = [
            self.level(method, mesh, steps)
            for method in (FREE, *self.methods)
            for mesh in self.meshes_of(method)
            for steps in self.steps
        ]
        if self.has_limit:
            levels += self.along_meshes(LIMIT, self.limit_steps)
        return sorted(levels, key=lambda level: (level.method != FREE.name, level.steps))

    @cached_property
    def level(self) -> Callable[[Method, MeshChoice, int], Level]:
        """Function of a method, a mesh and a number of steps per period that returns their level.

        Levels are kept, because checking a case takes milliseconds.
        """
        return cache(self._new)

    def along_steps(self, method: Method, mesh: MeshChoice) -> list[Level]:
        """Return the levels of a method on one mesh, over all steps per period."""
        return [self.level(method, mesh, steps) for steps in self.steps]

    def along_meshes(self, method: Method, steps: int) -> list[Level]:
        """Return the levels of a method with one number of steps per period, over all meshes."""
        return [self.level(method, mesh, steps) for mesh in self.meshes_of(method)]

    def meshes_of(self, method: Method) -> tuple[MeshChoice, ...]:
        """Return the meshes of a method; contact points make no difference without contact."""
        if method != FREE:
            return self.meshes
        return tuple({str(_plain(mesh)): _plain(mesh) for mesh in self.meshes}.values())

    @property
    def refines(self) -> Literal["elements", "points"]:
        """What the meshes refine: their elements, or the contact points of a lamina."""
        is_plain = all(not isinstance(mesh, PointMesh) for mesh in self.meshes)
        return "elements" if is_plain else "points"

    def limit_of(self, mesh: MeshChoice) -> Level:
        """Return the level that stands for the rigid limit of a mesh; see `has_limit`."""
        return self.level(LIMIT, mesh, self.limit_steps)

    @property
    def has_limit(self) -> bool:
        """Whether the study has levels that stand for the rigid limit."""
        return self.limit_steps > 0 and not self.case.is_elastic

    @property
    def identity(self) -> str:
        """Text that is equal for studies that can share levels; methods and sizes may differ."""
        beside: dict[str, object] = {"channels": self.channels} if self.of else {}
        return identity(self._without_sizes, periods=self.periods, engine=self.engine, **beside)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that are judged."""
        return tuple(dict.fromkeys(channel_of(text)[0] for text in self.of))

    @property
    def _without_sizes(self) -> Case:
        sizes: dict[str, object] = {
            "mesh.elements": 1,
            "time.steps_per_period": 1000,
            "time.refine": 1,
            "time.periods": 1,
            **WITHOUT_FRAMES,
            "output.window_periods": 1,
            "contact.law": "none@newmark",
        }
        if self.refines == "points":
            sizes["contact.points_per_element"] = 1
        return self.case.with_overrides(sizes)

    def _new(self, method: Method, mesh: MeshChoice, steps: int) -> Level:
        plain = _plain(mesh)
        periods = self.periods
        is_file = isinstance(plain, Path)
        points: dict[str, object] = {}
        if isinstance(mesh, PointMesh):
            points["contact.points_per_element"] = mesh.per_element
        if isinstance(plain, int) and self.case.mesh.across is not None:  # cells keep their shape
            share = plain / (self.case.mesh.elements or plain)
            points["mesh.across"] = max(1, round(self.case.mesh.across * share))
        if steps > MANY_STEPS:
            periods = min(periods, FEW_PERIODS)
        of = () if method == FREE else self.channels
        case = self.case.with_overrides(
            {
                "mesh.file" if is_file else "mesh.elements": str(plain) if is_file else plain,
                **points,
                **WITHOUT_FRAMES,
                "output.window_periods": periods if of else 1,
                "time.steps_per_period": steps,
                "time.periods": min(self.periods, SETTLING) + periods,
                **dict(method.overrides),
            }
        )
        elements = plain if isinstance(plain, int) else _elements(case)
        n_points = elements * case.contact.points_per_element
        return Level(method.name, mesh, elements, n_points, steps, periods, case, of)


def _plain(mesh: MeshChoice) -> int | Path:
    """Return a mesh without its contact points."""
    return mesh.mesh if isinstance(mesh, PointMesh) else mesh


def _elements(case: Case) -> int:
    """Return the number of elements along a lamina in the mesh file of a case."""
    if case.model.is_continuum:
        return cells_along(case, solid_mesh(case))
    return node_coordinates(case).size - 1


def _require_rising(what: str, sizes: Sequence[int]) -> None:
    """Raise a CaseError unless the numbers increase."""
    if not sizes or any(a >= b for a, b in pairwise(sizes)):
        listing = ", ".join(str(size) for size in sizes) or "none"
        raise CaseError(f"{what}: expected increasing numbers, coarse first, given {listing}")
