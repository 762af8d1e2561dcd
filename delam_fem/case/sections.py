"""Define the sections of a case as frozen, strict models.

Numbers are SI and float64. A whole number is accepted for a float; no other conversion is made.
`definition.py` checks conditions that involve several sections.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import (
    Discriminator,
    ModelWrapValidatorHandler,
    PrivateAttr,
    SerializerFunctionWrapHandler,
    Tag,
    ValidationError,
    model_serializer,
    model_validator,
)
from pydantic_core import PydanticCustomError

from delam_fem.case.materials import MATERIALS, ORTHOTROPIC, POISSON, Orthotropic
from delam_fem.case.values import (
    Bits,
    CellCount,
    Count,
    CountOrNone,
    CountOrSettled,
    DampingRatio,
    Degree,
    Elements,
    Expected,
    FileName,
    FilterOrder,
    Finite,
    Gamma,
    Label,
    NotNegative,
    PointsPerElement,
    Poisson,
    Positive,
    Refine,
    Restitution,
    Section,
    Steps,
    Theta,
    Unit,
    in_si,
    inconsistent,
)
from delam_fem.contact.laws import SCHEMES, Impulse, LawName, Scheme, SchemeName
from delam_fem.numerics import elasticity
from delam_fem.numerics.beams import cantilever_roots
from delam_fem.numerics.harmonics import Kind
from delam_fem.numerics.types import BoolArray, FloatArray
from delam_fem.system.errors import CaseError

_OF_MATERIALS: Mapping[str, str] = MappingProxyType({"young_modulus": "Pa", "density": "kg/m3"})
"""Keys of a lamina whose values a material says, with their units."""
DISAGREEING = 0.05
"""Share by which a measured EI or mass per length may differ from that of a modulus or material."""
_SAME = 1e-9
"""Relative difference that round-off may leave between two values of one number."""


EDGE_TOLERANCE = 1e-9
"""Tolerance relative to the length within which an edge is at an end of the structure."""


class Profile(Section):
    """A property along a lamina: a table over x, linear between its places, or in steps.

    Attributes:
        x: places from 0 on, increasing [m]; without steps the last is the length of the lamina.
        value: the values there, in the unit of the property.
        steps: whether each value holds up to the next place, the last up to the end.
    """

    x: Annotated[tuple[NotNegative, ...], Expected("a list of places of at least 0")]
    value: Annotated[tuple[Positive, ...], Expected("a list of positive numbers")]
    steps: bool = False

    @model_validator(mode="after")
    def _increasing(self) -> Self:
        """Check that places increase from 0 on, and that each has a value."""
        if len(self.x) != len(self.value) or len(self.x) < 2:
            raise inconsistent(
                "value",
                f"expected two or more values, one for each x, given {len(self.value)} for "
                f"{len(self.x)} places",
            )
        if self.x[0] != 0.0 or any(a >= b for a, b in pairwise(self.x)):
            raise inconsistent("x", f"expected places that increase from 0 on, given {self.x}")
        return self

    def at(self, x: FloatArray, inside: FloatArray | None = None) -> FloatArray:
        """Return the values at places.

        Args:
            x: places, any shape [m].
            inside: places that say on which side of a step each x is, same shape [m]; None: to the
                right.
        """
        if not self.steps:
            return np.asarray(np.interp(x, self.x, self.value))
        places = x if inside is None else inside
        number = np.searchsorted(self.x, places, side="right") - 1
        return np.asarray(np.array(self.value)[np.maximum(number, 0)])

    def mean(self, length: float) -> float:
        """Return the mean value up to a length [m]."""
        if self.steps:
            return float(np.diff([*self.x, length]) @ np.array(self.value) / length)
        return float((0.5 * np.diff(self.x) @ np.add(self.value[1:], self.value[:-1])) / length)


def _form(value: object) -> Literal["number", "profile"]:
    """Return what a value of a lamina is by its form."""
    return "profile" if _is_table(value) else "number"


Along = Annotated[
    Annotated[Positive, Tag("number")] | Annotated[Profile, Tag("profile")],
    Discriminator(_form),
]
"""A number, or a table over x."""
VARYING = ("thickness", "width", "density", "young_modulus")
"""Keys of a lamina that take a table over x."""


def _material_form(value: object) -> Literal["name", "table"]:
    """Return what a material is by its form."""
    return "table" if isinstance(value, Mapping | Orthotropic) else "name"


Material = Annotated[
    Annotated[str, Tag("name")] | Annotated[Orthotropic, Tag("table")],
    Discriminator(_material_form),
]
"""The name of a material, or the numbers of an orthotropic one."""
Angle = Annotated[Finite, Unit("deg")]
MOST_PLIES = 200
"""Largest number of plies of a lamina."""


class Lamina(Section):
    """One lamina of the delaminated beam.

    Thickness, width, density and modulus take a number or a table over x, as
    `{ x = [0.0, 0.3], value = [0.002, 0.001] }`, linear between the places; with `steps = true`
    each value holds up to the next place.

    A case file may give `material`, or `mass_per_length` instead of the density; without a modulus,
    `bending_stiffness` gives it. The lamina then has the numbers that follow.

    Attributes:
        name: name of the lamina in results.
        length: length L [m].
        width: width b [m].
        thickness: thickness h [m].
        material: name of a material, whose density and modulus the lamina then has, as "aluminium"
            or "cfrp-ud", or a table of the numbers of an orthotropic one (docs/layered.md). Other
            numbers beside it are refused.
        angle: angle of the fibres of an orthotropic material, from x towards z [deg]; 0 if nothing
            is given.
        plies: in place of angle: those of plies of equal thickness, from the bottom [deg].
        density: density rho [kg/m3]; a material or mass_per_length gives it too.
        young_modulus: Young's modulus E [Pa]; a material or bending_stiffness gives it too.
        bending_stiffness: bending stiffness EI [N m2]; if given, it replaces E b h^3/12, also
            that of a material.
        damping_ratio: damping ratio D at the modes that the damping model names [-].
        mass_per_length: mass per length rho b h [kg/m]; in a case file instead of density.
        mass: mass of a point in place of a beam [kg]; its length, width and thickness then are
            those of its picture, and need not be given.
        stiffness: stiffness of the spring between a point and the base [N/m]; 0: free.
        motion: "lateral", or "axial": a bar, which stretches along its axis in place of bending, in
            linear elements; "above" is where its displacements are positive.
    """

    also_written: ClassVar[tuple[str, ...]] = ("mass_per_length",)

    name: Label
    length: Annotated[Positive, Unit("m")]
    width: Annotated[Along, Unit("m")]
    thickness: Annotated[Along, Unit("m")]
    material: Material | None = None
    angle: Angle | None = None
    plies: Annotated[tuple[Angle, ...] | None, Expected("a list of angles [deg]")] = None
    density: Annotated[Along, Unit("kg/m3")]
    young_modulus: Annotated[Along, Unit("Pa")]
    bending_stiffness: Annotated[Positive | None, Unit("N m2")] = None
    damping_ratio: Annotated[DampingRatio, Unit("1")]
    mass: Annotated[Positive | None, Unit("kg")] = None
    stiffness: Annotated[NotNegative | None, Unit("N/m")] = None
    motion: Literal["lateral", "axial"] = "lateral"
    _line_mass: float | None = PrivateAttr(None)
    """Mass per length that was given [kg/m]; None: the density was."""

    @model_validator(mode="wrap")
    @classmethod
    def _resolved(cls, data: object, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Put the numbers of a material, of EI or of the mass per length in their places.

        Keys whose values follow from others do not count as set, so that a written case says what
        its user said.
        """
        if not isinstance(data, Mapping):
            return handler(data)
        numbers = {key: _converted(key, value) for key, value in data.items()}
        said_by_material = _take_material(numbers)
        if "mass" in numbers:
            numbers = dict(_PICTURE) | numbers
        line_mass = _take_section(numbers)
        lamina = handler(numbers)
        follow = {str(key) for key in numbers if key not in data} | said_by_material
        lamina.model_fields_set.difference_update(follow)
        lamina._line_mass = line_mass
        return lamina

    @model_serializer(mode="wrap")
    def _as_said(self, handler: SerializerFunctionWrapHandler) -> dict[str, object]:
        """Return the keys of the lamina without those that follow from others."""
        data: dict[str, object] = handler(self)
        follow = {*_PICTURE, *_OF_MATERIALS, "bending_stiffness"} - self.model_fields_set
        line_mass = {} if self._line_mass is None else {"mass_per_length": self._line_mass}
        return {key: value for key, value in data.items() if key not in follow} | line_mass

    @model_validator(mode="after")
    def _whole_point(self) -> Self:
        """Check that a point has both a mass and a spring."""
        if (self.mass is None) != (self.stiffness is None):
            raise inconsistent(
                "stiffness" if self.stiffness is None else "mass",
                "missing, but required of a point, which has both",
            )
        return self

    @model_validator(mode="after")
    def _fitting_tables(self) -> Self:
        """Check that tables end with the lamina, and that no single number replaces them."""
        for key, profile in self.profiles.items():
            last = profile.x[-1]
            is_end = math.isclose(last, self.length, rel_tol=EDGE_TOLERANCE)
            if profile.steps and (is_end or last > self.length):
                raise inconsistent(
                    f"{key}.x",
                    f"expected steps before the length {self.length:g} m, given {last:g}",
                )
            if not profile.steps and not is_end:
                raise inconsistent(
                    f"{key}.x",
                    f"expected a last place at the length {self.length:g} m, given {last:g}",
                )
        for key in ("bending_stiffness", "mass", "material", "plies"):
            names = (*_OF_MATERIALS,) if key == "material" else VARYING
            if key == "material" and isinstance(self.material, Orthotropic):
                names = ("young_modulus",)
            tables = [name for name in names if name in self.profiles]
            if tables and getattr(self, key) is not None:
                raise inconsistent(key, f"expected none beside a table of {' and '.join(tables)}")
        return self

    @model_validator(mode="after")
    def _fitting_angles(self) -> Self:
        """Check that angles belong to an orthotropic material, and are said once."""
        for key in ("angle", "plies"):
            if getattr(self, key) is not None and self.orthotropic is None:
                raise inconsistent(
                    key,
                    f"expected only beside an orthotropic material, {', '.join(ORTHOTROPIC)} or a "
                    f"table of its moduli, given material = {self.material!r}",
                )
        if self.angle is not None and self.plies is not None:
            raise inconsistent("plies", "expected angle or plies, not both")
        if self.plies is not None and not 1 <= len(self.plies) <= MOST_PLIES:
            raise inconsistent(
                "plies", f"expected 1 to {MOST_PLIES} angles, given {len(self.plies)}"
            )
        return self

    @property
    def orthotropic(self) -> Orthotropic | None:
        """The orthotropic material of the lamina; None: it is isotropic."""
        if isinstance(self.material, Orthotropic):
            return self.material
        named = ORTHOTROPIC.get(self.material or "")
        return None if named is None else named[0]

    @property
    def layers(self) -> tuple[tuple[float, float], ...]:
        """Angle [deg] and share of the thickness of each layer from the bottom; equal plies join.

        An isotropic lamina is one layer.
        """
        return _layers(self.angle, self.plies)

    @property
    def is_symmetric(self) -> bool:
        """Whether the layers above the middle mirror those below, so that bending stretches not."""
        plies = self.plies or (0.0,)
        return all(abs(a - b) % 180.0 == 0.0 for a, b in zip(plies, plies[::-1], strict=True))

    @property
    def profiles(self) -> dict[str, Profile]:
        """The tables over x, by their keys."""
        values = {key: getattr(self, key) for key in VARYING}
        return {key: value for key, value in values.items() if isinstance(value, Profile)}

    @property
    def is_uniform(self) -> bool:
        """Whether no property changes along the lamina."""
        return not self.profiles

    @property
    def breaks(self) -> tuple[float, ...]:
        """Places inside the lamina at which a property steps or its slope does [m]."""
        places = {x for profile in self.profiles.values() for x in profile.x}
        margin = EDGE_TOLERANCE * self.length
        return tuple(sorted(x for x in places if margin < x < self.length - margin))

    def along(self, key: str, x: FloatArray, inside: FloatArray | None = None) -> FloatArray:
        """Return a property at places.

        Args:
            key: "thickness" [m], "width" [m], "density" [kg/m3] or "young_modulus" [Pa].
            x: places, any shape [m].
            inside: see `Profile.at`.
        """
        value = getattr(self, key)
        if isinstance(value, Profile):
            return value.at(x, inside)
        return np.full(np.shape(x), float(value))

    def mean(self, key: str) -> float:
        """Return the mean of a property over the length; see `along`."""
        value = getattr(self, key)
        return value.mean(self.length) if isinstance(value, Profile) else float(value)

    @property
    def uniform(self) -> Lamina:
        """The lamina with means in place of its tables, for estimates alone."""
        return self.model_copy(update={key: self.mean(key) for key in self.profiles})

    def _number(self, key: str) -> float:
        """Return a property of a uniform lamina.

        Raises:
            CaseError: it changes along the lamina.
        """
        value = getattr(self, key)
        if isinstance(value, Profile):
            raise CaseError(
                f"lamina.{self.name}.{key}: expected a uniform lamina here, given a table over x"
            )
        return float(value)

    def flexural_rigidity_at(self, x: FloatArray, inside: FloatArray | None = None) -> FloatArray:
        """Return EI at places, see `along` [N m2]."""
        if self.is_uniform:
            return np.full(np.shape(x), self.flexural_rigidity)
        E, b, h = (self.along(key, x, inside) for key in ("young_modulus", "width", "thickness"))
        return np.asarray(E * b * h**3 / 12.0)

    def axial_rigidity_at(self, x: FloatArray, inside: FloatArray | None = None) -> FloatArray:
        """Return EA at places, see `along` [N]."""
        if self.is_uniform:
            return np.full(np.shape(x), self.axial_rigidity)
        E, b, h = (self.along(key, x, inside) for key in ("young_modulus", "width", "thickness"))
        return np.asarray(E * b * h)

    def mass_per_length_at(self, x: FloatArray, inside: FloatArray | None = None) -> FloatArray:
        """Return the mass per length at places, see `along` [kg/m]."""
        if self.is_uniform:
            return np.full(np.shape(x), self.mass_per_length)
        rho, b, h = (self.along(key, x, inside) for key in ("density", "width", "thickness"))
        return np.asarray(rho * b * h)

    @property
    def is_point(self) -> bool:
        """Whether the lamina is a mass on a spring in place of a beam."""
        return self.mass is not None

    @property
    def axial_rigidity(self) -> float:
        """Axial stiffness E b h [N]."""
        return self._number("young_modulus") * self._number("width") * self._number("thickness")

    @property
    def flexural_rigidity(self) -> float:
        """Bending stiffness EI: the given one, otherwise E b h^3/12 [N m2]."""
        if self.bending_stiffness is not None:
            return self.bending_stiffness
        return self._number("young_modulus") * self.second_moment

    @property
    def has_two_stiffnesses(self) -> bool:
        """Whether EI and E are both given and disagree by more than measured ones do."""
        if self.bending_stiffness is None or "young_modulus" not in self.model_fields_set:
            return False
        of_modulus = self._number("young_modulus") * self.second_moment
        return abs(self.bending_stiffness - of_modulus) > DISAGREEING * of_modulus

    @property
    def second_moment(self) -> float:
        """Second moment of area b h^3/12 [m4]."""
        return self._number("width") * self._number("thickness") ** 3 / 12.0

    @property
    def mass_per_length(self) -> float:
        """Mass per length rho b h [kg/m]."""
        if self._line_mass is not None:
            return self._line_mass
        return self._number("density") * self._number("width") * self._number("thickness")

    @property
    def poisson(self) -> float:
        """Poisson's ratio of the lamina's isotropic material; 0 without one [-]."""
        return POISSON.get(self.material, 0.0) if isinstance(self.material, str) else 0.0

    def angular_frequencies(self, n: int, *, is_even: bool = False) -> FloatArray:
        """Return the first natural frequencies, omega_k = (B_k/L)^2 sqrt(EI / rho A) of a beam.

        Args:
            n: number of frequencies.
            is_even: whether both ends of a bar are held, or both are free.

        Returns:
            Angular frequencies of the exact undamped cantilever, or of a bar that vibrates,
            increasing, shape (n,) [rad/s].
        """
        if self.mass is not None and self.stiffness is not None:  # a point has one
            return np.full(n, np.sqrt(self.stiffness / self.mass))
        if self.motion == "axial":
            waves = np.pi * (np.arange(n) + (1.0 if is_even else 0.5)) / self.length
            speed = np.sqrt(self._number("young_modulus") / self._number("density"))
            return np.asarray(waves * speed)
        speed = np.sqrt(self.flexural_rigidity / self.mass_per_length)
        return np.asarray((cantilever_roots(n) / self.length) ** 2 * speed)


POINT_LENGTH = 1.0
"""Length of the picture of a point whose length is not given [m]."""
_PICTURE = {"length": POINT_LENGTH, "width": 0.1, "thickness": 0.05, "density": 2000.0,
            "young_modulus": 1e10}  # fmt: skip
"""What a point has besides its mass and its spring."""


def _converted(key: object, value: object) -> object:
    """Return a value of a lamina, in SI if it carries a unit, before others follow from it."""
    if key == "mass_per_length":
        return in_si(value, "kg/m", "mass_per_length")
    if key == "plies" and isinstance(value, list | tuple):
        return [in_si(entry, "deg", "plies") for entry in value]
    field = Lamina.model_fields.get(str(key))
    notes = () if field is None else field.metadata
    unit = next((note.name for note in notes if isinstance(note, Unit)), None)
    if isinstance(value, Mapping) and unit is not None:  # a table over x
        units = {"x": "m", "value": unit}
        return {
            name: [in_si(entry, units[name], f"{key}.{name}") for entry in entries]
            if name in units and isinstance(entries, list | tuple)
            else entries
            for name, entries in value.items()
        }
    return value if unit is None else in_si(value, unit, str(key))


def _take_material(numbers: dict[object, object]) -> set[str]:
    """Fill in density and stiffness of a material; return the keys whose values it says.

    Raises:
        PydanticCustomError: the material is unknown, or a number differs from the material's.
    """
    name = numbers.get("material")
    if name is None:
        return set()
    row: Mapping[str, float] | None = None
    if isinstance(name, str):
        row = MATERIALS.get(name)
    if row is None:
        return _take_orthotropic(name, numbers)
    said = {"young_modulus"}
    if "mass_per_length" not in numbers:
        said.add("density")
    for key in said:
        _take(numbers, key, row[key])
    return said


def _take(numbers: dict[object, object], key: str, of_material: float) -> None:
    """Fill in a number of a named material.

    Raises:
        PydanticCustomError: another one is given.
    """
    value = numbers.setdefault(key, of_material)
    if isinstance(value, int | float) and not math.isclose(value, of_material, rel_tol=_SAME):
        raise inconsistent(
            key,
            f"expected {of_material:g} {_OF_MATERIALS[key]} of material = "
            f"{numbers['material']!r}, or no material, given {value:g} {_OF_MATERIALS[key]}",
        )


def _take_orthotropic(material: object, numbers: dict[object, object]) -> set[str]:
    """Fill in the modulus along x and, of plies, EI; return the keys that the material says.

    The modulus is that of stretching, EI that of bending, both of classical laminate theory for a
    narrow beam (`elasticity.laminate`).

    Raises:
        PydanticCustomError: the material is unknown, or a stiffness stands beside it.
    """
    said = {"young_modulus"}
    if isinstance(material, str):
        if material not in ORTHOTROPIC:
            raise inconsistent(
                "material",
                f"expected one of {', '.join((*MATERIALS, *ORTHOTROPIC))} or a table of E1, E2, "
                f"E3, G12, G13, G23, nu12, nu13 and nu23, given {material!r}",
            )
        row, density = ORTHOTROPIC[material]
        if "mass_per_length" not in numbers:
            said.add("density")
            _take(numbers, "density", density)
    elif isinstance(material, Orthotropic):
        row = material
    else:
        try:
            row = Orthotropic.model_validate(material)
        except ValidationError:  # the lamina's own check tells it with its place
            numbers["young_modulus"] = 1.0
            return said
    for key in ("young_modulus", "bending_stiffness"):
        if key in numbers:
            raise inconsistent(
                key, "expected none beside an orthotropic material, whose moduli give it"
            )
    angle = numbers.get("angle")
    plies = numbers.get("plies", [0.0 if angle is None else angle])
    angles = [_number(one) for one in plies] if isinstance(plies, list | tuple) else []
    if not angles or None in angles:
        numbers["young_modulus"] = row.E1  # the angles themselves are refused
        return said
    layers = _layers(None, tuple(one for one in angles if one is not None))
    b, h = (_positive(numbers.get(key)) for key in ("width", "thickness"))
    heights = [share * (h or 1.0) for _, share in layers]
    _, stretching, bending = elasticity.laminate([row.at(one) for one, _ in layers], heights)
    numbers["young_modulus"] = stretching / sum(heights)
    if len(layers) > 1 and b is not None and h is not None:
        numbers["bending_stiffness"] = b * bending
        said.add("bending_stiffness")
    return said


def _layers(
    angle: float | None, plies: tuple[float, ...] | None
) -> tuple[tuple[float, float], ...]:
    """Return angle [deg] and share of the thickness of each layer; neighbours of one angle join."""
    angles = (angle or 0.0,) if plies is None else plies
    layers: list[tuple[float, float]] = []
    for one in angles:
        share = 1.0 / len(angles)
        if layers and layers[-1][0] == one:
            share += layers.pop()[1]
        layers.append((one, share))
    return tuple(layers)


def _number(value: object) -> float | None:
    """Return a finite number as such; None: it is another value."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def _take_section(numbers: dict[object, object]) -> float | None:
    """Turn a mass per length into the density, and without a modulus EI into the modulus.

    Returns:
        The mass per length, if it was given [kg/m].

    Raises:
        PydanticCustomError: it stands beside a density, or is no positive number.
    """
    b, h = (_positive(numbers.get(key)) for key in ("width", "thickness"))
    if b is None or h is None:
        if "mass_per_length" in numbers and any(map(_is_table, numbers.values())):
            raise inconsistent("mass_per_length", "expected density beside a table over x")
        return None  # the sizes themselves are refused
    EI = _positive(numbers.get("bending_stiffness"))
    if "young_modulus" not in numbers and EI is not None:
        numbers["young_modulus"] = 12.0 * EI / (b * h**3)
    if "mass_per_length" not in numbers:
        return None
    if "density" in numbers:
        raise inconsistent("mass_per_length", "expected density or mass_per_length, not both")
    line_mass = _positive(numbers["mass_per_length"])
    if line_mass is None:
        value = numbers["mass_per_length"]
        raise inconsistent("mass_per_length", f"expected a positive number, given {value!r}")
    numbers["density"] = line_mass / (b * h)
    del numbers["mass_per_length"]
    return line_mass


def _is_table(value: object) -> bool:
    """Return whether a value of a lamina is a table over x."""
    return isinstance(value, Mapping | Profile)


def _positive(value: object) -> float | None:
    """Return a positive number as such; None: it is another value."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if value > 0.0 else None


def _plan_form(value: object) -> Literal["number", "plan"]:
    """Return what a position is by its form."""
    return "plan" if isinstance(value, list | tuple) else "number"


Position = Annotated[
    Annotated[Annotated[NotNegative, Unit("m")], Tag("number")]
    | Annotated[
        tuple[Annotated[NotNegative, Unit("m")], Annotated[Finite, Unit("m")]],
        Expected("a place x, or [x, z] on a plate"),
        Tag("plan"),
    ],
    Discriminator(_plan_form),
]
"""A place x [m], or of plates [x, z]."""
SurfaceName = Literal["middle", "top", "bottom"]
"""Surfaces of a lamina on which a place may be."""


def x_of(position: float | tuple[float, float]) -> float:
    """Return x of a position [m]."""
    return position[0] if isinstance(position, tuple) else position


def z_of(position: float | tuple[float, float]) -> float:
    """Return z of a position, 0 in the middle of the width [m]."""
    return position[1] if isinstance(position, tuple) else 0.0


def place_words(position: float | tuple[float, float] | None) -> str:
    """Return a position in words: "0.1 m", "(0.1, -0.02) m"."""
    if isinstance(position, tuple):
        return f"({position[0]:g}, {position[1]:g}) m"
    return f"{position:g} m"


OwnRestitution = Annotated[Restitution | None, Unit("1")]
OwnStiffness = Annotated[Positive | None, Unit("N/m")]
OwnDamping = Annotated[NotNegative, Unit("N s/m")]
OwnThreshold = Annotated[NotNegative | None, Unit("m/s")]
"""Types of the numbers that a contact may have in place of those of `[contact]`."""


class OwnContact(Section):
    """A table of a contact: [gap], [[delamination]], [[stop]] or [[impactor]]."""

    if TYPE_CHECKING:  # each table says in its own place what they mean
        restitution: float | None
        stiffness: float | None
        damping: float
        threshold_velocity: float | None

    @model_validator(mode="after")
    def _damping_beside_stiffness(self) -> Self:
        """Check that the damping of a contact stands beside its stiffness."""
        if self.damping and self.stiffness is None:
            raise inconsistent("damping", "expected only beside stiffness, of an elastic contact")
        return self

    @property
    def _stiffness_key(self) -> str | None:
        """Name of the key that gives the contact its stiffness; None: it has none."""
        keys = ("stiffness", "radius")
        return next((key for key in keys if getattr(self, key, None) is not None), None)

    @property
    def has_stiffness(self) -> bool:
        """Whether the contact has a stiffness of its own, or that of a ball."""
        return self._stiffness_key is not None

    @property
    def elastic_by(self) -> str | None:
        """Name of the key that makes the contact elastic; None: it follows the law of the case."""
        return self._stiffness_key if self.restitution is None else None


class InitialGap(OwnContact):
    """The gap at rest: a power of x/L, the first mode shape, or a table.

    Attributes:
        tip: gap at the free end [m]; not given with a table.
        root: gap at the clamp [m]; 0 if it is not given. The gap is root + (tip - root) times
            the shape. Not given with a table, which may begin with a gap of its own.
        exponent: p in the gap root + (tip - root) (x/L)^p [-]; 2 if no exponent, shape or file is
            given.
        shape: "mode": the first cantilever mode, scaled to the gap at the tip.
        file: CSV table with the columns x [m], gap [m]; a relative name counts from the case file.
        restitution: e of this contact [-]; contact.restitution if not given. Beside stiffness it
            makes the contact rigid.
        stiffness: stiffness of the springs of this contact [N/m per node pair]; it makes the
            contact elastic, unless restitution stands beside it.
        damping: damping of the springs of an elastic contact [N s/m per node pair].
        threshold_velocity: velocity gamma of this contact [m/s]; contact.threshold_velocity if not
            given.
    """

    tip: Annotated[Positive, Unit("m")] | None = None
    root: Annotated[NotNegative, Unit("m")] | None = None
    exponent: Positive | None = None
    shape: Literal["mode"] | None = None
    file: FileName | None = None
    restitution: OwnRestitution = None
    stiffness: OwnStiffness = None
    damping: OwnDamping = 0.0
    threshold_velocity: OwnThreshold = None

    @model_validator(mode="before")
    @classmethod
    def _square_by_default(cls, data: object) -> object:
        """Set the exponent 2 if no exponent, shape or file is given."""
        if isinstance(data, Mapping) and not {"exponent", "shape", "file"} & set(data):
            return {**data, "exponent": 2.0}
        return data

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        """Check that one shape is given, and the gap at the tip unless there is a table."""
        keys = [key for key in ("exponent", "shape", "file") if getattr(self, key) is not None]
        if len(keys) != 1:
            raise PydanticCustomError(
                "inconsistent",
                "expected one of exponent, shape, file, given {given}",
                {"given": " and ".join(keys) or "none"},
            )
        if self.file is None and self.tip is None:
            raise inconsistent("tip", "missing, but required unless gap.file is given")
        for key in ("tip", "root"):
            if self.file is not None and getattr(self, key):
                raise inconsistent(
                    key, f"expected no {key} beside gap.file, which has the gap itself"
                )
        return self


class Mesh(Section):
    """The mesh of both laminae.

    Attributes:
        elements: number of equal elements per lamina; of a plate, of cells along x, which are finer
            at the edges of delaminations.
        across: number of cells across the width: the laminae are a plate (docs/plates.md).
        file: mesh file (.msh, .vtk, .vtu or .xdmf); a relative name counts from the case file.
        unit: unit of length of a mesh file: "m", "cm", "mm", "um" or "inch"; "m" if it is not
            given.
    """

    elements: Elements | None = None
    across: Elements | None = None
    file: FileName | None = None
    unit: Literal["m", "cm", "mm", "um", "inch"] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        """Check that either a number of elements or a file is given, and what belongs to each."""
        if self.file is not None and self.across is not None:
            raise inconsistent("across", "expected only beside elements, given beside file")
        if self.file is None and self.unit is not None:
            raise inconsistent("unit", "expected only beside file, of a mesh")
        if (self.elements is None) == (self.file is None):
            raise PydanticCustomError(
                "inconsistent",
                "expected one of elements, file, given {given}",
                {"given": "none" if self.file is None else "both"},
            )
        return self


MESH_UNITS: Mapping[str, float] = MappingProxyType(
    {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "inch": 0.0254}
)
"""Metres of the units of mesh files."""
ModelKind = Literal["beam", "plane-stress", "solid", "modes"]
_READS: Mapping[ModelKind, frozenset[str]] = MappingProxyType(
    {
        "beam": frozenset(),
        "plane-stress": frozenset({"poisson", "degree", "layers"}),
        "solid": frozenset({"poisson", "degree", "layers", "strips"}),
        "modes": frozenset({"modes"}),
    }
)


class Model(Section):
    """What the laminae are computed as.

    Attributes:
        kind: "beam" (Euler-Bernoulli), "plane-stress" (two dimensions), "solid" (three dimensions)
            or "modes": those of a file (docs/modes.md), or of beams with
            time.mass = "massless" (docs/modes.md).
        poisson: Poisson's ratio of all laminae [-]. Without it solids have 0, and the contact of a
            ball that of the material of its lamina.
        degree: degree of the elements.
        layers: number of cells through the thickness of each lamina.
        strips: number of cells across the width; give 2 or more where contact counts.
        file: file of `delam-fem reduce`; a relative name counts from the case file.
        modes: number of modes of each lamina, or of a bonded structure; without a file.
    """

    kind: ModelKind = "beam"
    poisson: Annotated[Poisson | None, Unit("1")] = None
    degree: Degree = 2
    layers: CellCount = 1
    strips: CellCount = 1
    file: FileName | None = None
    modes: Count = 12

    @model_validator(mode="after")
    def _source_of_modes(self) -> Self:
        """Check that modes come from a file or are counted, and that other models read no file."""
        if self.kind != "modes" and self.file is not None:
            raise inconsistent("file", f'expected only with kind = "modes", given {self.kind!r}')
        if self.file is not None and "modes" in self.model_fields_set:
            raise inconsistent("modes", f"expected only without a file, given {self.modes}")
        return self

    @property
    def is_continuum(self) -> bool:
        """Whether the laminae are computed as solids."""
        return self.kind in ("plane-stress", "solid")

    @property
    def reads(self) -> frozenset[str]:
        """Keys that this kind of model reads."""
        return frozenset({"kind"}) | (_READS[self.kind] if self.file is None else {"file"})


class Damping(Section):
    """The damping model: how C = alpha M + beta K follows from the damping ratio D.

    Attributes:
        rayleigh: "two-mode" (D at modes 1 and 2), "stiffness" or "mass" (D at mode 1); of bars also
            "every mode" (D at each mode of the mesh).
    """

    rayleigh: Literal[Kind, "every mode"] = "two-mode"

    @property
    def kind(self) -> Kind:
        """The terms of C; with "every mode" those that are nearest."""
        return "two-mode" if self.rayleigh == "every mode" else self.rayleigh


class Contact(Section):
    """The contact law and its parameters.

    Attributes:
        law: "none", "newton", "newton-penalty" or "penalty"; see docs/theory.md.
        impulse: "lumped" (acts on the hit nodes alone) or "consistent" (acts through the mass
            matrix).
        restitution: coefficient of restitution e [-].
        penalty_stiffness: stiffness of a contact spring [N/m per node pair].
        penalty_damping: damping of a contact spring [N s/m per node pair]; only the law "penalty"
            reads it.
        threshold_velocity: velocity gamma [m/s]; a pair that separates more slowly than this stays
            at rest.
        points_per_element: number of contact points per element, at equal distances; 1: the nodes,
            as in the paper. Inside the elements the gap follows from the Hermite interpolants. A
            penalty spring then has its share of the stiffness and damping, which hold per element.
    """

    law: LawName
    impulse: Impulse = "consistent"
    restitution: Annotated[Restitution, Unit("1")] = 0.1
    penalty_stiffness: Annotated[NotNegative, Unit("N/m")] = 100.0
    penalty_damping: Annotated[NotNegative, Unit("N s/m")] = 0.0
    threshold_velocity: Annotated[NotNegative, Unit("m/s")] = 0.5e-3
    points_per_element: PointsPerElement = 1


class TimeStepping(Section):
    """The time integration.

    Attributes:
        scheme: "newmark" (average acceleration), "central-difference" or "moreau-jean".
        theta: θ of moreau-jean, from 1/2 (no numerical damping) to 1; 1/2 if it is not given.
        beta: β of newmark; 1/4 if it is not given. Below γ/2 only small steps are stable.
        gamma: γ of newmark; 1/2 if it is not given, above it there is numerical damping.
        mass: "consistent" or "lumped" mass matrix; "massless": beams or modes whose contact points
            have no mass and are rigid (docs/modes.md).
        steps_per_period: time steps per period, N; in a sweep, a period is that of the
            highest frequency.
        step: longest time step [s]; instead of steps_per_period where the excitation does not
            repeat, and needed for a blow or a table.
        refine: largest division r; near contact a step is divided into up to r steps of Δt/r; 1:
            never.
        refine_velocity: gap rate up to which a pair near contact does not divide a step [m/s].
        periods: number of periods of a harmonic run. "settled": as many as it takes until the
            motion has settled.
        duration: length of the run [s]; instead of periods where the excitation does not repeat,
            and needed for a blow. A sweep runs for its own duration, a table for its length.
        most_periods: number of periods after which a run ends that has not settled.
        begin: "equilibrium" (the state of rest under weight and loads; so if there are any and
            nothing is given) or "unloaded".
    """

    scheme: SchemeName = "newmark"
    theta: Annotated[Theta, Unit("1")] | None = None
    beta: Annotated[NotNegative, Unit("1")] | None = None
    gamma: Annotated[Gamma, Unit("1")] | None = None
    mass: Literal["consistent", "lumped", "massless"] = "consistent"
    steps_per_period: Steps = 1000
    step: Annotated[Positive, Unit("s")] | None = None
    refine: Refine = 1
    refine_velocity: Annotated[NotNegative, Unit("m/s")] = 0.0
    periods: CountOrSettled = 300
    duration: Annotated[Positive, Unit("s")] | None = None
    most_periods: Count = 3000
    begin: Literal["equilibrium", "unloaded"] | None = None

    @property
    def integration(self) -> Scheme:
        """The scheme with its numbers."""
        scheme = SCHEMES[self.scheme]
        chosen = {key: getattr(self, key) for key in scheme.numbers}
        return replace(scheme, **{key: x for key, x in chosen.items() if x is not None})


class Output(Section):
    """The record of a run: its window and its frames.

    The default window of an excitation that does not repeat is the whole run, with about 500
    frames. With `time.step`, a hundredth of the run counts as a period.

    Attributes:
        window_periods: number of last periods that are recorded at every step (the window).
        fields_per_period: number of frames of the fields per period of the window; 0 for none.
    """

    window_periods: Count = 10
    fields_per_period: CountOrNone = 50


SupportKind = Literal["clamped", "pinned", "free"]

Neighbours = Annotated[
    tuple[Label, Label], Expected("the names of two neighbouring laminae, the lower one first")
]


End = Literal["start", "end"]
ENDS: tuple[End, End] = ("start", "end")
"""The ends of the structure, x = 0 and x = length."""
EDGES = (*ENDS, "left", "right")
"""The edges of a plate: those at z < 0 and z > 0 besides the ends."""


class PointSupport(Section):
    """A support at an end, or inside the span; what holds the laminae there moves with the base.

    Attributes:
        side: of a support at an end: "start" (x = 0) or "end" (x = length); of an edge of a plate
            also "left" (z < 0), "right" (z > 0), or the name of a group of facets in its mesh.
        position: of a support inside the span: its x [m], or [x, z] of a point of a plate.
        surface: of a point of a plate: "top" or "bottom" of its lamina; "middle", which of a pin is
            the whole thickness, if it is not given.
        kind: "clamped", "pinned", "free" (of an end or edge alone) or "spring".
        lamina: name of the lamina that it holds, at an end of a spring alone; all laminae, each by
            itself, if not given. A spring at a point of a plate, or a surface, needs it.
        stiffness: stiffness of a spring [N/m], of an edge of a plate as a whole; may be 0.
        rotational_stiffness: moment over slope of a spring, beside a pin, or of a clamped end that
            yields [N m]; of an edge of a plate as a whole.
        damping: damping of a spring [N s/m], of an edge of a plate as a whole.
    """

    side: Label | None = None
    position: Position | None = None
    surface: SurfaceName | None = None
    kind: Literal["pinned", "clamped", "free", "spring"]
    lamina: Label | None = None
    stiffness: Annotated[NotNegative | None, Unit("N/m")] = None
    rotational_stiffness: Annotated[NotNegative, Unit("N m")] = 0.0
    damping: Annotated[NotNegative, Unit("N s/m")] = 0.0

    @model_validator(mode="after")
    def _fitting_keys(self) -> Self:
        """Check that there is one place, and that the keys are those of the kind."""
        is_spring = self.kind == "spring"
        if (self.side is None) == (self.position is None):
            raise inconsistent("position", "expected either position, or side of an end")
        if self.is_at_point:
            if self.kind not in ("pinned", "spring"):
                expected = f'expected "pinned" or "spring" at a point [x, z], given "{self.kind}"'
                if self.kind == "clamped":
                    expected += (
                        ": a point of a solid has no slope. Three pins beside one another hold it "
                        "and its turns; position = x clamps a line across the width, side an edge"
                    )
                raise inconsistent("kind", expected)
            if self.rotational_stiffness:
                raise inconsistent(
                    "rotational_stiffness",
                    "expected none at a point [x, z], which has no slope: springs beside one "
                    "another resist turns",
                )
            if self.lamina is None and (is_spring or self.surface in ("top", "bottom")):
                raise inconsistent(
                    "lamina", "missing, but required of a spring or a surface at a point [x, z]"
                )
        elif self.surface is not None:
            raise inconsistent("surface", "expected only with a position [x, z]")
        if self.kind == "free" and self.side is None:
            raise inconsistent("kind", 'expected "free" only with side, of an end')
        self.require_just("stiffness", is_spring, "kind")
        if self.damping and not is_spring:
            raise inconsistent("damping", f'expected none with kind = "{self.kind}"')
        is_rigid = self.kind == "clamped" and self.side is None
        if self.rotational_stiffness and (is_rigid or self.kind == "free"):
            raise inconsistent("rotational_stiffness", f'expected none with kind = "{self.kind}"')
        if self.lamina is not None and self.side is not None and not is_spring:
            raise inconsistent("lamina", 'expected only with kind = "spring" at an end')
        if self.lamina is not None and self.is_edge:
            raise inconsistent("lamina", "expected none at an edge, which is held as a whole")
        return self

    @property
    def is_edge(self) -> bool:
        """Whether it is at an edge that plates alone have."""
        return self.side is not None and self.side not in ENDS

    @property
    def is_at_point(self) -> bool:
        """Whether it is at a point [x, z] of a plate."""
        return isinstance(self.position, tuple)

    @property
    def x(self) -> float:
        """Its x [m]; 0 at an edge."""
        return 0.0 if self.position is None else x_of(self.position)

    @property
    def holds_slopes(self) -> bool:
        """Whether it resists turns."""
        return self.kind == "clamped" or self.rotational_stiffness > 0.0

    @property
    def holds_deflections(self) -> bool:
        """Whether it resists deflections."""
        return self.kind in ("clamped", "pinned") or bool(self.stiffness)


class Support(Section):
    """The supports of the structure; held points move with the base.

    A case file with springs at ends or with supports inside the span has [[support]] tables: one
    with the keys of the ends, which may be left out, and one with a side or a position for each of
    the others.

    Attributes:
        start: support at x = 0: "clamped", "pinned" or "free".
        end: support at x = length: the same words.
        rotational_stiffness: moment over slope of each clamped end of a bonded beam [N m]; rigid
            if not given.
        placed: supports with a side or a position.
    """

    never_written: ClassVar[tuple[str, ...]] = ("placed",)

    start: SupportKind = "clamped"
    end: SupportKind = "free"
    rotational_stiffness: Annotated[Positive | None, Unit("N m")] = None
    placed: tuple[PointSupport, ...] = ()

    @property
    def inside(self) -> tuple[PointSupport, ...]:
        """The supports inside the span, over the whole width."""
        return tuple(
            support
            for support in self.placed
            if support.position is not None and not support.is_at_point
        )

    @property
    def at_points(self) -> tuple[PointSupport, ...]:
        """The supports at points [x, z] of a plate."""
        return tuple(support for support in self.placed if support.is_at_point)

    @property
    def pins(self) -> tuple[PointSupport, ...]:
        """The supports at points [x, z] of a plate at which nodes are held: all but springs."""
        return tuple(support for support in self.at_points if support.kind == "pinned")

    @property
    def held(self) -> tuple[PointSupport, ...]:
        """The supports inside the span at which a node is held: all but springs."""
        return tuple(support for support in self.inside if support.kind != "spring")

    @property
    def sides(self) -> tuple[str, ...]:
        """The ends, and the other edges of a plate that tables name."""
        named = (support.side for support in self.placed if support.side is not None)
        return tuple(dict.fromkeys((*ENDS, *named)))

    def kind(self, side: str) -> str:
        """Return the word for an end or edge: "clamped", "pinned", "free" or "spring"."""
        words = (support.kind for support in self.placed if support.side == side)
        return next(words, getattr(self, side) if side in ENDS else "free")

    def holds(self, side: str) -> bool:
        """Return whether an end or edge follows the base, so that its deflection is no unknown."""
        return self.kind(side) in ("clamped", "pinned")

    def turns(self, side: str) -> bool:
        """Return whether an end or edge can turn: it is no clamp, or one that yields."""
        yields = any(table.rotational_stiffness for table in self.placed if table.side == side)
        return self.kind(side) != "clamped" or yields or bool(self.clamp_stiffness(side))

    def clamp_stiffness(self, end: str) -> float:
        """Return the rotational stiffness of the table at an end, 0 where another counts [N m]."""
        has_another = any(
            support.rotational_stiffness for support in self.placed if support.side == end
        )
        is_clamped = end in ENDS and self.kind(end) == "clamped"
        return (self.rotational_stiffness or 0.0) if is_clamped and not has_another else 0.0

    @property
    def is_cantilever(self) -> bool:
        """Whether the start is clamped, rigidly, and nothing else holds the laminae."""
        is_elastic = any(
            support.kind == "spring" or support.position is not None for support in self.placed
        )
        others = any(self.holds(side) for side in self.sides if side != "start")
        return not (self.turns("start") or others or is_elastic)

    def points(self, length: float) -> tuple[PointSupport, ...]:
        """Return the supports at ends or over the whole width, all with their places.

        Args:
            length: of the structure [m].
        """
        ends: dict[str, float] = dict(zip(ENDS, (0.0, length), strict=True))
        return tuple(
            support
            if support.side is None
            else support.model_copy(update={"position": ends[support.side]})
            for support in self.placed
            if support.side in ends or (support.side is None and not support.is_at_point)
        )

    @model_validator(mode="before")
    @classmethod
    def _from_tables(cls, data: object) -> object:
        """Sort [[support]] tables into the ends and the others."""
        for table in data if isinstance(data, list) else [data]:
            if isinstance(table, Mapping) and "placed" in table:
                raise cls.unknown("placed")
        if isinstance(data, Mapping) and {"side", "position"} & set(data):
            raise inconsistent("side" if "side" in data else "position", "expected in [[support]]")
        if not isinstance(data, list):
            return data
        placed = [
            isinstance(entry, Mapping) and bool({"side", "position"} & set(entry)) for entry in data
        ]
        ends = [entry for entry, is_placed in zip(data, placed, strict=True) if not is_placed]
        if len(ends) > 1:
            raise inconsistent(
                "position", "missing, but required of all [[support]] but one, or side in its place"
            )
        others = [entry for entry, is_placed in zip(data, placed, strict=True) if is_placed]
        return {**(ends[0] if ends else {}), "placed": others}

    @model_validator(mode="after")
    def _one_at_each_end(self) -> Self:
        """Check that an end or edge has one support, or springs of different laminae."""
        for end in self.sides:
            at = [support for support in self.placed if support.side == end]
            if at and end in self.model_fields_set:
                raise inconsistent(end, f'expected none beside a table with side = "{end}"')
            names = {support.lamina for support in at}
            if len(names) < len(at) or (len(at) > 1 and None in names):
                raise inconsistent(
                    "side",
                    f'expected one [[support]] with side = "{end}", or springs that name '
                    f"different laminae, given {len(at)}",
                )
        return self

    @model_serializer(mode="wrap")
    def _to_tables(self, handler: SerializerFunctionWrapHandler) -> object:
        """Return one table, or several if supports have a side or a position."""
        data = handler(self)
        placed = data.pop("placed", ())
        for support in self.placed:
            if support.side in ENDS:
                data.pop(support.side, None)
        return [*([data] if data else []), *placed] if placed else data


Across = Annotated[Finite, Unit("m")]
"""A place across the width of a plate, from its middle [m]."""
ON_EDGE = 1e-6
"""How far outside a delamination a place on its edge may be, in halves of its size: round-off."""


ELLIPSE_CORNERS = 64
"""Corners of the polygon that stands for an ellipse; its area is 0.2 % too small."""


class Delamination(OwnContact):
    """A stretch over which two neighbouring laminae are not bonded; of a plate, a patch.

    Attributes:
        between: names of the lower and the upper lamina.
        start: where it begins [m].
        end: where it ends [m].
        across: z of both edges of a patch in a plate [m], from the middle of the width; the whole
            width if it is not given.
        shape_in_plane: of a patch: "rectangle", or "ellipse" within the same four edges;
            "rectangle" if it is not given.
        opening: largest gap at rest [m]; 0: closed.
        shape: "half-cosine" (zero at both ends) or "power" (zero at the bonded end, largest at the
            end that is open); "half-cosine" if neither shape nor file is given.
        exponent: exponent of the shape "power" [-]; 2 if it is not given.
        file: CSV table with the columns x [m], gap [m] over the delamination; a relative name
            counts from the case file.
        restitution: e of this contact [-]; contact.restitution if not given. Beside stiffness it
            makes the contact rigid.
        stiffness: stiffness of the springs of this contact [N/m per node pair]; it makes the
            contact elastic, unless restitution stands beside it.
        damping: damping of the springs of an elastic contact [N s/m per node pair].
        threshold_velocity: velocity gamma of this contact [m/s]; contact.threshold_velocity if not
            given.
    """

    between: Neighbours
    start: Annotated[NotNegative, Unit("m")]
    end: Annotated[Positive, Unit("m")]
    across: Annotated[
        tuple[Across, Across] | None, Expected("two places [m], as [-0.03, 0.01]")
    ] = None
    shape_in_plane: Literal["rectangle", "ellipse"] | None = None
    opening: Annotated[NotNegative, Unit("m")] = 0.0
    shape: Literal["half-cosine", "power"] | None = None
    exponent: Positive | None = None
    file: FileName | None = None
    restitution: OwnRestitution = None
    stiffness: OwnStiffness = None
    damping: OwnDamping = 0.0
    threshold_velocity: OwnThreshold = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Check the order of the edges, and that one shape is given."""
        if not self.start < self.end:
            raise inconsistent(
                "end", f"expected a place beyond start = {self.start!r} m, given {self.end!r}"
            )
        if self.across is not None and not self.across[0] < self.across[1]:
            raise inconsistent(
                "across", f"expected two places [m], the smaller one first, given {[*self.across]}"
            )
        if self.across is None and self.shape_in_plane is not None:
            raise inconsistent("shape_in_plane", "expected only beside across, of a patch")
        if self.across is not None and (self.shape == "power" or self.file is not None):
            key = "shape" if self.file is None else "file"
            raise inconsistent(key, 'expected "half-cosine", the only shape of a patch')
        _require_one_shape(self)
        return self

    def spans(self, length: float) -> bool:
        """Return whether the delamination reaches from one end of the structure to the other."""
        reaches_both = self.reaches(0.0, length) and self.reaches(length, length)
        return self.across is None and reaches_both

    @property
    def middle(self) -> tuple[float, float]:
        """Its middle, x and z [m]."""
        low, high = self.across or (0.0, 0.0)
        return 0.5 * (self.start + self.end), 0.5 * (low + high)

    @property
    def is_ellipse(self) -> bool:
        """Whether it is a patch that is an ellipse."""
        return self.shape_in_plane == "ellipse"

    def outline(self, half_width: float) -> FloatArray:
        """Return the corners of a patch in its plan, x and z, counter-clockwise, (n, 2) [m].

        Args:
            half_width: half of the width of the plate [m].
        """
        low, high = (-half_width, half_width) if self.across is None else self.across
        if self.is_ellipse:
            angle = 2.0 * np.pi * np.arange(ELLIPSE_CORNERS) / ELLIPSE_CORNERS
            corners = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        else:
            corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        first = np.array([self.start, low])
        last = np.array([self.end, high])
        return np.asarray(0.5 * (first + last) + 0.5 * (last - first) * corners)

    def local(self, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return coordinates from -1 at one edge to 1 at the other, along x and across.

        Args:
            x: places [m], any shape.
            z: places across the width, the shape of x [m].

        Returns:
            Both of the shape of x; over the whole width the second is 0.
        """
        along = (2.0 * x - self.start - self.end) / (self.end - self.start)
        if self.across is None:
            return along, np.zeros_like(along)
        low, high = self.across
        return along, (2.0 * z - low - high) / (high - low)

    def contains(self, x: FloatArray, z: FloatArray) -> BoolArray:
        """Return which places lie in the delamination, its edges included, the shape of x."""
        along, across = self.local(x, z)
        if self.is_ellipse:
            return np.asarray(np.hypot(along, across) <= 1.0 + ON_EDGE)
        return np.asarray(np.maximum(np.abs(along), np.abs(across)) <= 1.0 + ON_EDGE)

    def reaches(self, end: float, length: float) -> bool:
        """Return whether an edge of the delamination is at `end` (0 or the length)."""
        edge = self.start if end == 0.0 else self.end
        return abs(edge - end) <= EDGE_TOLERANCE * length


def _require_one_shape(own: Delamination | Stop) -> None:
    """Check that a delamination or a stop has either a shape or a table."""
    if own.file is not None and (own.shape is not None or own.opening):
        raise inconsistent("file", "expected no shape and no opening beside the table")
    if own.exponent is not None and own.shape != "power":
        raise inconsistent("exponent", 'expected only with shape = "power"')


def require_fitting(
    delaminations: tuple[Delamination, ...], laminae: tuple[Lamina, ...], support: Support
) -> None:
    """Check delaminations beside the laminae of their case.

    Args:
        delaminations: the delaminations of the case.
        laminae: laminae from bottom to top.
        support: the supports of the case.

    Raises:
        PydanticCustomError: a delamination does not fit; the error names its key.
    """
    length = laminae[0].length
    for number, delamination in enumerate(delaminations, start=1):
        key = f"delamination.{number}"
        require_neighbours(f"{key}.between", delamination.between, laminae)
        if delamination.end > length * (1.0 + EDGE_TOLERANCE):
            raise inconsistent(
                f"{key}.end",
                f"expected at most the length {length!r} m, given {delamination.end!r}",
            )
        for other_number, other in enumerate(delaminations[: number - 1], start=1):
            is_beside = delamination.start <= other.end and other.start <= delamination.end
            if delamination.across is not None and other.across is not None:
                low, high = delamination.across
                is_beside &= low <= other.across[1] and other.across[0] <= high
            if delamination.between == other.between and is_beside:
                raise inconsistent(
                    f"{key}.start",
                    f"expected a place apart from delamination.{other_number} between the same "
                    f"laminae, {other.start!r} to {other.end!r} m, given {delamination.start!r}",
                )
        if delamination.shape == "power" and len(open_ends(delamination, length, support)) != 1:
            raise inconsistent(
                f"{key}.shape",
                'expected "half-cosine" or a file: "power" needs one edge at a free end of the '
                "structure",
            )


def require_neighbours(key: str, between: tuple[str, str], laminae: tuple[Lamina, ...]) -> None:
    """Check that two names are those of neighbours, the lower one first.

    Raises:
        PydanticCustomError: they are not; the error names the key.
    """
    neighbours = [*pairwise(lamina.name for lamina in laminae)]
    if between not in neighbours:
        choices = " or ".join(f'["{a}", "{b}"]' for a, b in neighbours)
        raise inconsistent(
            key,
            f"expected neighbours from bottom to top, {choices}, given "
            f'["{between[0]}", "{between[1]}"]',
        )


def open_ends(delamination: Delamination, length: float, support: Support) -> tuple[str, ...]:
    """Return at which ends of the structure a delamination is open: "start", "end"."""
    ends = zip(ENDS, (0.0, length), strict=True)
    return tuple(
        name for name, x in ends if not support.holds(name) and delamination.reaches(x, length)
    )


Quantity = Literal["displacement", "velocity", "acceleration", "strain", "contact force"]

SENSOR_UNITS: Mapping[str, str] = {
    "displacement": "m",
    "velocity": "m/s",
    "acceleration": "m/s2",
    "strain": "1",
    "contact force": "N",
}
"""Unit of each quantity of a sensor."""


class Gravity(Section):
    """Weight; it matters where level strips sag by a tenth of the gap, or upright ones are slender.

    A level cantilever sags by rho b h g L^4/(8 EI). Without this table there is no weight.

    Attributes:
        acceleration: acceleration of free fall [m/s2].
        inclination: angle of the axis from x = 0 above the horizontal [deg]; 90: upright on x = 0,
            -90: hanging from it.
        roll: angle about the axis [deg]; 0: the last lamina on top, 180: turned over, 90: on edge.
        gaps: "unloaded", or "in place": gaps as measured under this weight and all loads.
    """

    acceleration: Annotated[Positive, Unit("m/s2")] = 9.80665
    inclination: Annotated[Finite, Unit("deg")] = 0.0
    roll: Annotated[Finite, Unit("deg")] = 0.0
    gaps: Literal["unloaded", "in place"] = "unloaded"

    @property
    def along(self) -> float:
        """Acceleration along the axis, towards x = length [m/s2]."""
        return -self.acceleration * _turned(self.inclination)[1]

    @property
    def across(self) -> float:
        """Acceleration along positive deflections [m/s2]."""
        return -self.acceleration * _turned(self.inclination)[0] * _turned(self.roll)[0]

    @property
    def sideways(self) -> float:
        """Acceleration across the width [m/s2]."""
        return self.acceleration * _turned(self.inclination)[0] * _turned(self.roll)[1]


def _turned(degrees: float) -> tuple[float, float]:
    """Return cosine and sine of an angle, exact at right angles."""
    quarters, remainder = divmod(degrees, 90.0)
    angle = math.radians(remainder)
    c = math.cos(angle)
    s = math.sin(angle)
    return ((c, s), (-s, c), (-c, -s), (s, -c))[int(quarters) % 4]


class Load(Section):
    """A constant load; several add up.

    Attributes:
        lamina: name of the lamina; an axial force without it is that of the structure.
        between: names of two neighbours, instead of a lamina: the load acts on both, equal and
            opposite; positive presses them together.
        position: x of a force [m], or [x, z] on a plate.
        force: force [N]; positive upwards, of a bar along its axis.
        start: where a force per length begins [m]; 0, or the start of the only delamination between
            the two, if it is not given.
        end: where it ends [m]; the length, or the end of that delamination, if it is not given.
        per_length: force per length [N/m].
        surface: of a plate, on which a force acts: "middle", "top" or "bottom"; "middle" if it is
            not given, and of a force between two laminae.
        axial: tension along the whole length [N]; that of the structure is shared by E b h.
    """

    lamina: Label | None = None
    between: Neighbours | None = None
    position: Position | None = None
    force: Annotated[Finite, Unit("N")] | None = None
    start: Annotated[NotNegative, Unit("m")] | None = None
    end: Annotated[Positive, Unit("m")] | None = None
    per_length: Annotated[Finite, Unit("N/m")] | None = None
    surface: SurfaceName | None = None
    axial: Annotated[Finite, Unit("N")] | None = None

    @model_validator(mode="after")
    def _one_load(self) -> Self:
        """Check that there is one load, with what belongs to it."""
        kinds = [k for k in ("force", "per_length", "axial") if getattr(self, k) is not None]
        if len(kinds) != 1:
            raise inconsistent(
                "force",
                f"expected one of force, per_length, axial, given {' and '.join(kinds) or 'none'}",
            )
        kind = kinds[0]
        if kind == "axial" and self.between is not None:
            raise inconsistent("between", "expected none beside axial: name a lamina, or none")
        if kind != "axial" and (self.lamina is None) == (self.between is None):
            count = "none" if self.lamina is None else "both"
            raise inconsistent("lamina", f"expected one of lamina, between, given {count}")
        if self.position is not None and kind != "force":
            raise inconsistent("position", f"expected only with force, given with {kind}")
        if self.surface is not None and (kind != "force" or self.between is not None):
            raise inconsistent("surface", "expected only with a force on one lamina")
        for key in ("start", "end"):
            if getattr(self, key) is not None and kind != "per_length":
                raise inconsistent(key, f"expected only with per_length, given with {kind}")
        if self.start is not None and self.end is not None and not self.start < self.end:
            raise inconsistent("end", f"expected a place beyond start, given {self.end!r}")
        return self

    @property
    def sides(self) -> tuple[tuple[Load, float], ...]:
        """The loads on single laminae that this one is, with their signs; no axial force."""
        if self.between is None:
            return ((self, 1.0),)
        lower, upper = (
            self.model_copy(update={"lamina": name, "between": None}) for name in self.between
        )
        return (lower, 1.0), (upper, -1.0)

    def reach(
        self, length: float, delaminations: tuple[Delamination, ...] = ()
    ) -> tuple[float, float]:
        """Return where a force per length begins and ends [m]."""
        fitting = [d for d in delaminations if d.between == self.between]
        ends = (fitting[0].start, fitting[0].end) if len(fitting) == 1 else (0.0, length)
        start = ends[0] if self.start is None else self.start
        return start, ends[1] if self.end is None else self.end


class PointMass(Section):
    """A point mass on a lamina, for example an accelerometer or a magnet at its tip.

    Attributes:
        lamina: name of the lamina.
        mass: m [kg].
        position: x of the mass [m], or [x, z] on a plate; the end x = length if it is not given.
        surface: of a plate: "middle", "top" or "bottom"; "middle" if it is not given.
    """

    lamina: Label
    mass: Annotated[Positive, Unit("kg")]
    position: Position | None = None
    surface: SurfaceName | None = None


class Stop(OwnContact):
    """A stop that a lamina may strike: a point, or points along a stretch.

    A rigid stop follows the contact law. An elastic one is a spring (and damper) that acts while
    its gap is closed, whatever the law of the others.

    Attributes:
        lamina: name of the lamina.
        side: side of the lamina on which the stop is: "above", "below" or "both".
        gap: gap at rest [m].
        position: x of a point [m], or [x, z] on a plate; the end x = length if nothing is given.
        start: where a stretch begins [m]; instead of position.
        end: where a stretch ends [m]; each node of the mesh from start to end is a contact point.
        opening: largest gap at rest of a stretch beyond `gap` [m]; 0: all of it has the same gap.
        shape: of the opening: "half-cosine" (zero at both ends), or "power" (zero at the start,
            largest at the end); "half-cosine" if neither shape nor file is given.
        exponent: exponent of the shape "power" [-]; 2 if it is not given.
        file: CSV table with the columns x [m], gap [m] from start to end, which is added to `gap`;
            a relative name counts from the case file.
        on: what carries the stop: "base" (it moves with the base) or "ground".
        stiffness: stiffness of an elastic stop, of a stretch as a whole [N/m]; rigid if not given,
            or with restitution beside it.
        damping: damping of an elastic stop, of a stretch as a whole [N s/m].
        restitution: e of the stop [-]; contact.restitution if not given. Beside stiffness it makes
            the stop rigid.
        threshold_velocity: velocity gamma of the stop [m/s]; contact.threshold_velocity if not
            given.
    """

    lamina: Label
    side: Literal["above", "below", "both"]
    gap: Annotated[NotNegative, Unit("m")]
    position: Position | None = None
    start: Annotated[NotNegative, Unit("m")] | None = None
    end: Annotated[Positive, Unit("m")] | None = None
    opening: Annotated[NotNegative, Unit("m")] = 0.0
    shape: Literal["half-cosine", "power"] | None = None
    exponent: Positive | None = None
    file: FileName | None = None
    on: Literal["base", "ground"] = "base"
    stiffness: OwnStiffness = None
    damping: OwnDamping = 0.0
    restitution: OwnRestitution = None
    threshold_velocity: OwnThreshold = None

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        """Check that either a point or a stretch is given, and no damping of a rigid stop."""
        is_stretch = self.start is not None
        if (self.position is not None and is_stretch) or is_stretch != (self.end is not None):
            raise inconsistent("position", "expected either position, or start and end")
        if self.start is not None and self.end is not None and not self.start < self.end:
            raise inconsistent(
                "end", f"expected a place beyond start = {self.start!r} m, given {self.end!r}"
            )
        for key in ("opening", "shape", "file"):
            if getattr(self, key) and not is_stretch:
                raise inconsistent(key, "expected only of a stretch, from start to end")
        _require_one_shape(self)
        return self

    def reach(self, length: float) -> tuple[float, float]:
        """Return where the stop begins and ends on a lamina of a length [m]."""
        if self.start is not None and self.end is not None:
            return self.start, self.end
        place = length if self.position is None else x_of(self.position)
        return place, place


class Impactor(OwnContact):
    """A mass that strikes a lamina, free or on a spring, as the tip of a hammer.

    Attributes:
        lamina: name of the lamina.
        mass: m [kg].
        position: x of the place that it strikes [m], or [x, z] on a plate; the end x = length if it
            is not given.
        side: side of the lamina on which it is: "above" or "below".
        gap: gap at rest [m].
        velocity: velocity towards the lamina at t = 0 [m/s].
        stiffness: stiffness of the contact [N/m]; without it and radius the contact is rigid, and
            with restitution beside it.
        damping: damping of the contact, beside stiffness [N s/m].
        radius: radius of a rigid ball [m], whose contact follows Hertz; needs velocity.
        spring: stiffness of the spring that holds it [N/m]; 0: it is free.
        spring_damping: damping of that spring [N s/m].
        on: what carries that spring: "base" (it moves with the base) or "ground".
        restitution: e of the contact [-]; contact.restitution if not given. Beside stiffness it
            makes the contact rigid.
        threshold_velocity: velocity gamma of the contact [m/s]; contact.threshold_velocity if not
            given.
    """

    lamina: Label
    mass: Annotated[Positive, Unit("kg")]
    position: Position | None = None
    side: Literal["above", "below"] = "above"
    gap: Annotated[NotNegative, Unit("m")] = 0.0
    velocity: Annotated[NotNegative, Unit("m/s")] = 0.0
    stiffness: OwnStiffness = None
    damping: OwnDamping = 0.0
    radius: Annotated[Positive, Unit("m")] | None = None
    spring: Annotated[NotNegative, Unit("N/m")] = 0.0
    spring_damping: Annotated[NotNegative, Unit("N s/m")] = 0.0
    on: Literal["base", "ground"] = "ground"
    restitution: OwnRestitution = None
    threshold_velocity: OwnThreshold = None

    @model_validator(mode="after")
    def _one_contact(self) -> Self:
        """Check that the keys of the contact go together."""
        if self.radius is not None and self.stiffness is not None:
            raise inconsistent("radius", "expected stiffness or radius, not both")
        if self.radius is not None and not self.velocity:
            raise inconsistent(
                "velocity", "expected a positive number beside radius: it sets the depth of contact"
            )
        if self.radius is not None and self.restitution is not None:
            raise inconsistent("restitution", "expected none beside radius, of an elastic contact")
        return self


class Initial(Section):
    """A displacement and a velocity at t = 0, in the fixed frame; several of them add up.

    Attributes:
        lamina: name of the lamina; all laminae if it is not given.
        shape: "uniform", "mode" (a mode without contact), or "force": static under a force.
        mode: number of the mode; the first is 1.
        position: x of the force [m], or [x, z] on a plate.
        surface: of a plate, on which the force acts: "middle", "top" or "bottom"; "middle" if it is
            not given.
        displacement: largest displacement of the nodes, with its sign [m].
        velocity: largest velocity of the nodes, with its sign [m/s].
    """

    lamina: Label | None = None
    shape: Literal["uniform", "mode", "force"] = "uniform"
    mode: Count = 1
    position: Position | None = None
    surface: SurfaceName | None = None
    displacement: Annotated[Finite, Unit("m")] = 0.0
    velocity: Annotated[Finite, Unit("m/s")] = 0.0

    @model_validator(mode="after")
    def _fitting_keys(self) -> Self:
        """Check that the keys are those of the shape."""
        self.require_just("position", self.shape == "force", "shape")
        if self.surface is not None and self.shape != "force":
            raise inconsistent("surface", f'expected none with shape = "{self.shape}"')
        if self.shape == "force" and self.lamina is None:
            raise inconsistent("lamina", 'missing, but required with shape = "force"')
        if self.mode != 1 and self.shape != "mode":
            raise inconsistent("mode", f'expected none with shape = "{self.shape}"')
        return self


Spacing = Annotated[
    Annotated[Annotated[Positive, Unit("m")], Tag("number")]
    | Annotated[
        tuple[Annotated[Positive, Unit("m")], Annotated[Positive, Unit("m")]],
        Expected("a distance, or those along x and z"),
        Tag("plan"),
    ],
    Discriminator(_plan_form),
]
"""A distance [m], or those along x and z."""


PlanPoint = Annotated[
    tuple[Annotated[NotNegative, Unit("m")], Annotated[Finite, Unit("m")]], Expected("[x, z]")
]
"""Place [x, z] of a plate [m]."""


class SurfaceScan(Section):
    """Points on the surface of a plate that are read at every frame, as by a scanning vibrometer.

    Attributes:
        lamina: name of the lamina; the thinner outermost one if it is not given.
        surface: "top", "middle" or "bottom" of the lamina; its outer one if it is not given.
        spacing: distance of the points [m], or [along x, along z]; the grid is in the middle of
            the plate.
        file: table with the columns x and z of each point [m], in place of a grid.
        points: places of the points [m], each as [x, z], in place of a grid or a file.
    """

    lamina: Label | None = None
    surface: SurfaceName | None = None
    spacing: Spacing | None = None
    file: FileName | None = None
    points: tuple[PlanPoint, ...] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        """Check that the points are given once."""
        keys = ("spacing", "file", "points")
        sources = [key for key in keys if getattr(self, key) is not None]
        if len(sources) != 1:
            raise inconsistent(
                sources[-1] if sources else "spacing",
                f"expected one of {', '.join(keys)}, given {', '.join(sources) or 'none'}",
            )
        return self


class Sensor(Section):
    """A sensor, whose signal is the variable `sensor_NAME` of the dataset.

    Attributes:
        name: name of the sensor.
        quantity: "displacement", "velocity", "acceleration" or "strain" at a place of a lamina, or
            "contact force" of an interface, of a stop or of an impactor.
        lamina: name of the lamina; not of a contact force.
        position: x of the sensor [m], or [x, z] on a plate; not of a contact force.
        surface: "top" or "bottom" of the lamina, for a strain; "top" if it is not given. Of a plate
            for other quantities too, or "middle", which they have if it is not given.
        between: names of the two neighbouring laminae, for a contact force.
        stop: number of the stop, for its contact force; the first is 1.
        impactor: number of the impactor, for its contact force; the first is 1.
        sampling_rate: samples per second [Hz]; every step of the window if it is not given.
        noise: standard deviation of white noise on the samples, in the sensor's unit.
        seed: number from which the noise is drawn; the same seed gives the same noise.
        mass: mass of the sensor, which the lamina carries at its place [kg].
        resonance: frequency of the sensor on its mounting [Hz]; rigid if it is not given.
        resonance_damping: damping ratio of that resonance [-]; 0.02 if it is not given.
        corner: frequency at which the sensor's own low-pass filter has -3 dB [Hz]; none if it is
            not given.
        order: order of that filter, a Butterworth filter; 2 if it is not given.
        range: largest signal of either sign, in the sensor's unit; what is beyond is cut off.
        bits: bits of the converter over the range from -range to range.
    """

    name: Label
    quantity: Quantity
    lamina: Label | None = None
    position: Position | None = None
    surface: SurfaceName | None = None
    between: Neighbours | None = None
    stop: Count | None = None
    impactor: Count | None = None
    sampling_rate: Annotated[Positive, Unit("Hz")] | None = None
    noise: NotNegative | None = None
    seed: CountOrNone = 0
    mass: Annotated[Positive, Unit("kg")] | None = None
    resonance: Annotated[Positive, Unit("Hz")] | None = None
    resonance_damping: Annotated[DampingRatio, Unit("1")] | None = None
    corner: Annotated[Positive, Unit("Hz")] | None = None
    order: FilterOrder | None = None
    range: Positive | None = None
    bits: Bits | None = None

    @model_validator(mode="before")
    @classmethod
    def _in_its_unit(cls, data: object) -> object:
        """Convert a noise and a range that carry a unit to the unit of the sensor."""
        if not isinstance(data, Mapping):
            return data
        unit = SENSOR_UNITS.get(str(data.get("quantity")), "1")
        keys = {"noise", "range"} & set(data)
        return {**data, **{key: in_si(data[key], unit, key) for key in sorted(keys)}}

    @model_validator(mode="after")
    def _fitting_keys(self) -> Self:
        """Check that the keys are those of the quantity."""
        is_force = self.quantity == "contact force"
        for key in ("lamina", "position"):
            self.require_just(key, not is_force, "quantity")
        keys = [key for key in ("between", "stop", "impactor") if getattr(self, key) is not None]
        if len(keys) != is_force:
            words = "missing, but required (or stop, or impactor)" if is_force else "expected none"
            key = "between" if is_force else keys[0]
            raise inconsistent(key, f'{words} with quantity = "{self.quantity}"')
        if self.surface is not None and is_force:
            raise inconsistent("surface", f'expected none with quantity = "{self.quantity}"')
        if self.surface == "middle" and self.quantity == "strain":
            raise inconsistent("surface", 'expected "top" or "bottom" of a strain')
        if self.mass is not None and is_force:
            raise inconsistent("mass", f'expected none with quantity = "{self.quantity}"')
        pairs = (("resonance_damping", "resonance"), ("order", "corner"), ("bits", "range"))
        for key, other in pairs:
            if getattr(self, key) is not None and getattr(self, other) is None:
                raise inconsistent(key, f"expected only beside {other}")
        return self

    @property
    def unit(self) -> str:
        """Unit of the signal."""
        return SENSOR_UNITS[self.quantity]

    @property
    def words(self) -> str:
        """The sensor in words, for titles and the dataset."""
        if self.between is not None:
            return f"contact force between {self.between[0]} and {self.between[1]}"
        if self.stop is not None:
            return f"contact force of stop {self.stop}"
        if self.impactor is not None:
            return f"contact force of impactor {self.impactor}"
        place = f"of {self.lamina} at {place_words(self.position)}"
        if self.quantity == "strain":
            return f"strain at the {self.surface or 'top'} {place}"
        on = f" on its {self.surface}" if self.surface in ("top", "bottom") else ""
        return f"{self.quantity} {place}{on}"
