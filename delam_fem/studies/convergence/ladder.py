"""Describe a ladder: one case by several methods, on finer meshes and with smaller steps.

This module says what a rung is; `rung.py` computes one, `run.py` computes all of them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias, get_args

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.contact.laws import COMBINATIONS, LAWS, Impulse, combined_name
from delam_fem.engines.choose import EngineName
from delam_fem.model.mesh import node_coordinates

MeshChoice: TypeAlias = int | Path
"""Elements per lamina of equal length, or a mesh file."""

IMPULSES = get_args(Impulse)
ELEMENTS = (5, 10, 20, 40, 80, 160)
STEPS = (250, 500, 1000, 2000, 4000, 8000, 16000)
LIMIT_STEPS = 64000
PERIODS, SETTLING = 60, 30
"""Periods of the statistics, and periods before them."""
MANY_STEPS, FEW_PERIODS = 16000, 10
"""With more than MANY_STEPS per period the cycles scatter little, so FEW_PERIODS are enough."""
METHODS = (
    "newton@newmark",
    "newton-penalty@newmark",
    "penalty@newmark",
    "newton@moreau-jean",
    "recovery@moreau-jean",
)
"""What is compared unless methods are named."""
RIGID: dict[str, object] = {"contact.law": "newton@moreau-jean"}
"""The law and scheme whose small steps stand for rigid contact on a mesh: Newton's law has the same
limit with Newmark, and is closer to it with Moreau–Jean."""


@dataclass(frozen=True)
class Method:
    """What a ladder compares: a law with its scheme, maybe the kind of impulse, and other keys.

    Attributes:
        name: in tables and figures.
        overrides: keys of the case that it sets.
    """

    name: str
    overrides: tuple[tuple[str, object], ...]


FREE = Method("none", (("contact.law", "none@newmark"),))
"""Without contact; there an exact solution is known."""
LIMIT = Method("limit", tuple(RIGID.items()))
"""Stands for the rigid limit of a mesh."""


def method(text: str) -> Method:
    """Return the method of a text: LAW or LAW@SCHEME, alone or with /lumped or /consistent.

    A law alone takes the first scheme that it goes with. The name has the scheme in any case.

    Raises:
        CaseError: the text has another form, or names what does not go together.
    """
    pair, slash, impulse = text.partition("/")
    law, at, scheme = pair.partition("@")
    schemes = [name for known, name in COMBINATIONS if known == law and law != "none"]
    if (at and scheme not in schemes) or not schemes or (slash and impulse not in IMPULSES):
        laws = [name for name in LAWS if name != "none"]
        raise CaseError(
            f"laws: expected one of {', '.join(laws)}, with its scheme as in {METHODS[0]}, and "
            f"with the impulse as in {METHODS[0]}/lumped where that matters, given {text!r}"
        )
    name = combined_name(law, scheme or schemes[0])
    chosen: list[tuple[str, object]] = [("contact.law", name)]
    if slash:
        chosen.append(("contact.impulse", impulse))
    return Method(name + slash + impulse, tuple(chosen))


@dataclass(frozen=True)
class Rung:
    """One run of a ladder.

    Attributes:
        method: the name of its method.
        mesh: elements of equal length, or the file.
        elements: per lamina.
        steps: N, per period.
        periods: number of last periods of which statistics are taken.
        case: what is computed.
    """

    method: str
    mesh: MeshChoice
    elements: int
    steps: int
    periods: int
    case: Case

    @property
    def key(self) -> str:
        """Name of the rung within its ladder."""
        return _key(self.method, self.mesh, self.steps)


@dataclass(frozen=True)
class Ladder:
    """The runs of one case by several methods, on several meshes, with several numbers of steps.

    Attributes:
        case: the base of all rungs.
        methods: with contact.
        meshes: from coarse to fine.
        steps: N per period, increasing.
        periods: of the statistics, after as many periods of settling but at most `SETTLING`.
        limit_steps: N of the runs that stand for the rigid limit; 0: none.
        engine: what computes the steps.
    """

    case: Case
    methods: tuple[Method, ...]
    meshes: tuple[MeshChoice, ...]
    steps: tuple[int, ...]
    periods: int = PERIODS
    limit_steps: int = LIMIT_STEPS
    engine: EngineName = "compiled"

    def __post_init__(self) -> None:
        """Check everything that can be checked before a rung is computed.

        Raises:
            CaseError: a rung would be an invalid case, or the ladder does not refine.
        """
        if self.case.excitation.kind != "harmonic":
            raise CaseError(
                'converge: expected excitation.kind = "harmonic", as statistics are taken of '
                f'periods, given "{self.case.excitation.kind}"'
            )
        if self.periods < 1:
            raise CaseError(f"periods: expected at least 1, given {self.periods}")
        _require_rising("steps", self.steps)
        if not self.meshes:
            raise CaseError("elements: expected at least one number or mesh file, given none")
        free = self.along_meshes(FREE, self.steps[0])
        _require_rising("elements", [rung.elements for rung in free])

    def rungs(self) -> list[Rung]:
        """Return all rungs, without contact first, cheap ones first."""
        rungs = [
            self.rung(method, mesh, steps)
            for method in (FREE, *self.methods)
            for mesh in self.meshes
            for steps in self.steps
        ]
        if self.has_limit:
            rungs += self.along_meshes(LIMIT, self.limit_steps)
        return sorted(rungs, key=lambda rung: (rung.method != FREE.name, rung.steps))

    def rung(self, method: Method, mesh: MeshChoice, steps: int) -> Rung:
        """Return a rung."""
        key = _key(method.name, mesh, steps)
        if key not in self._made:
            self._made[key] = self._new(method, mesh, steps)
        return self._made[key]

    def along_steps(self, method: Method, mesh: MeshChoice) -> list[Rung]:
        """Return the rungs of a method on one mesh."""
        return [self.rung(method, mesh, steps) for steps in self.steps]

    def along_meshes(self, method: Method, steps: int) -> list[Rung]:
        """Return the rungs of a method over all meshes."""
        return [self.rung(method, mesh, steps) for mesh in self.meshes]

    def limit_of(self, mesh: MeshChoice) -> Rung:
        """Return the rung that stands for the rigid limit of a mesh; see `has_limit`."""
        return self.rung(LIMIT, mesh, self.limit_steps)

    @property
    def has_limit(self) -> bool:
        """Whether the ladder has rungs that stand for the rigid limit."""
        return self.limit_steps > 0

    @property
    def identity(self) -> str:
        """Text that is equal for ladders that may share rungs; methods and sizes may differ."""
        sizes = {"mesh.elements": 1, "time.steps_per_period": 1000, "time.periods": 1}
        kept = {"output.fields_per_period": 0, "output.window_periods": 1}
        case = self.case.with_overrides({**sizes, **kept, "contact.law": "none@newmark"})
        return f"periods = {self.periods}\n{case.to_toml()}"

    @cached_property
    def _made(self) -> dict[str, Rung]:
        """Rungs that were asked for, by key: a case takes milliseconds to check."""
        return {}

    def _new(self, method: Method, mesh: MeshChoice, steps: int) -> Rung:
        is_file, periods = isinstance(mesh, Path), self.periods
        if steps > MANY_STEPS:
            periods = min(periods, FEW_PERIODS)
        case = self.case.with_overrides(
            {
                "mesh.file" if is_file else "mesh.elements": str(mesh) if is_file else mesh,
                "output.fields_per_period": 0,
                "output.window_periods": 1,
                "time.steps_per_period": steps,
                "time.periods": min(self.periods, SETTLING) + periods,
                **dict(method.overrides),
            }
        )
        elements = mesh if isinstance(mesh, int) else node_coordinates(case).size - 1
        return Rung(method.name, mesh, elements, steps, periods, case)


def _key(method: str, mesh: MeshChoice, steps: int) -> str:
    """Return the name of a rung within its ladder."""
    return f"{method} {mesh} {steps}"


def whole_numbers(text: str, what: str) -> tuple[int, ...]:
    """Return the numbers of a list such as "5,10,20".

    Raises:
        CaseError: the text is no such list.
    """
    if not re.fullmatch(r"\s*[1-9]\d*\s*(,\s*[1-9]\d*\s*)*", text):
        raise CaseError(f"{what}: expected whole numbers such as 5,10,20, given {text!r}")
    return tuple(int(word) for word in text.split(","))


def _require_rising(what: str, sizes: Sequence[int]) -> None:
    """Raise unless numbers increase."""
    if not sizes or any(a >= b for a, b in pairwise(sizes)):
        given = ", ".join(str(size) for size in sizes) or "none"
        raise CaseError(f"{what}: expected increasing numbers, coarse first, given {given}")
