"""The types of the values of a case, and values that carry a unit.

A value may carry a unit, as in "2 mm", "70 GPa" or "3.25 Hz"; all others are in SI. The names of
units are those of pint, which is imported only where a text has a unit.
"""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ValidationError,
    ValidatorFunctionWrapHandler,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

LEAST, MOST = 1e-30, 1e30
"""Smallest and largest sizes; their products and powers still are doubles."""
MOST_COUNTED = 10**15
"""Largest number of periods, points or the like."""


@dataclass(frozen=True)
class Expected:
    """A validator that replaces any inner error by "expected …" with the given words.

    Attributes:
        words: what is expected, as in "a positive number".
    """

    words: str

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return the schema of the field with this validator around it."""
        return core_schema.no_info_wrap_validator_function(self._check, handler(source))

    def _check(self, value: object, inner: ValidatorFunctionWrapHandler) -> object:
        """Validate a value.

        Raises:
            PydanticCustomError: the value is not what is expected.
        """
        try:
            return inner(value)
        except ValidationError:
            raise PydanticCustomError(
                "unexpected", "expected {what}", {"what": self.words}
            ) from None


def inconsistent(key: str, text: str) -> PydanticCustomError:
    """Return an error for a key that contradicts another key.

    Args:
        key: the key in the notation of overrides, without its section.
        text: message: what was expected and what was given.
    """
    return PydanticCustomError("inconsistent", "{text}", {"key": key, "text": text})


def _sensible(value: float) -> float:
    """Check that a size is from `LEAST` to `MOST`, so that doubles hold its products and powers."""
    if value and not LEAST <= value <= MOST:
        raise PydanticCustomError("unexpected", f"expected a size from {LEAST:g} to {MOST:g}")
    return value


def _countable(value: int) -> int:
    """Check that a number is one that can be counted to."""
    if value > MOST_COUNTED:
        raise PydanticCustomError("unexpected", f"expected at most {MOST_COUNTED:g}")
    return value


def _short(path: Path) -> Path:
    """Check that a file name is one that a file system can have."""
    text = os.fsencode(path)
    if b"\0" in text or len(text) > 1024 or any(len(part) > 255 for part in text.split(b"/")):
        raise PydanticCustomError("unexpected", "expected the name of a file")
    return path


_FINITE = Field(strict=True, allow_inf_nan=False)
_WHOLE = Field(strict=True)
Positive = Annotated[
    float, _FINITE, Field(gt=0.0), Expected("a positive number"), AfterValidator(_sensible)
]
NotNegative = Annotated[
    float, _FINITE, Field(ge=0.0), Expected("a number of at least 0"), AfterValidator(_sensible)
]
Finite = Annotated[float, _FINITE, Field(ge=-1e30, le=1e30), Expected("a number")]
DampingRatio = Annotated[
    float, _FINITE, Field(ge=0.0, lt=1.0), Expected("a number from 0 to below 1")
]
Restitution = Annotated[float, _FINITE, Field(ge=0.0, le=1.0), Expected("a number from 0 to 1")]
Theta = Annotated[float, _FINITE, Field(ge=0.5, le=1.0), Expected("a number from 0.5 to 1")]
Gamma = Annotated[float, _FINITE, Field(ge=0.5), Expected("a number of at least 0.5")]
Elements = Annotated[
    int, _WHOLE, Field(ge=1, le=100_000), Expected("a whole number from 1 to 100000")
]
PointsPerElement = Annotated[
    int, _WHOLE, Field(ge=1, le=64), Expected("a whole number from 1 to 64")
]
CellCount = Annotated[int, _WHOLE, Field(ge=1, le=100), Expected("a whole number from 1 to 100")]
Poisson = Annotated[
    float, _FINITE, Field(ge=0.0, lt=0.5), Expected("a number of at least 0 and below 0.5")
]
Degree = Annotated[int, _WHOLE, Field(ge=2, le=3), Expected("2 or 3")]
FilterOrder = Annotated[int, _WHOLE, Field(ge=1, le=12), Expected("a whole number from 1 to 12")]
Bits = Annotated[int, _WHOLE, Field(ge=2, le=32), Expected("a whole number from 2 to 32")]
Steps = Annotated[
    int, _WHOLE, Field(ge=4, le=100_000_000), Expected("a whole number from 4 to 100000000")
]
Refine = Annotated[
    int, _WHOLE, Field(ge=1, le=4096), Expected("a whole number from 1 (never) to 4096")
]
Count = Annotated[
    int, _WHOLE, Field(ge=1), Expected("a whole number of at least 1"), AfterValidator(_countable)
]
CountOrSettled = Annotated[
    Annotated[int, _WHOLE, Field(ge=1), AfterValidator(_countable)] | Literal["settled"],
    Expected('a whole number of at least 1, or "settled"'),
]
CountOrNone = Annotated[
    int, _WHOLE, Field(ge=0), Expected("a whole number of at least 0"), AfterValidator(_countable)
]
FileName = Annotated[
    Path,
    AfterValidator(_short),
    AfterValidator(lambda path: Path(os.path.abspath(path))),
    Expected("the name of a file"),
]
Label = Annotated[
    str,
    Field(strict=True, pattern=r"^[A-Za-z][\w-]*$"),
    Expected("a word of letters, digits, - and _"),
]


class Section(BaseModel):
    """A table of a case file.

    Attributes:
        also_written: keys of the file, positive numbers, that become other fields when it is read.
        never_written: fields that are no keys of the file.
        is_written: whether it is a table of a file; otherwise it stands for several of them.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    also_written: ClassVar[tuple[str, ...]] = ()
    never_written: ClassVar[tuple[str, ...]] = ()
    is_written: ClassVar[bool] = True

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: object) -> object:
        """Refuse a key that the section does not have, and suggest the most similar key."""
        for key in data if isinstance(data, Mapping) else ():
            if key not in cls.model_fields:
                raise cls.unknown(str(key))
        return data

    @classmethod
    def unknown(cls, key: str) -> PydanticCustomError:
        """Return the error for a key that the section does not have, with the most similar one."""
        names = [*(name for name in cls.model_fields if name not in cls.never_written)]
        names += cls.also_written
        near = difflib.get_close_matches(key, names, n=1)
        hint = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(names)}"
        return inconsistent(key, f"unknown key; {hint}")

    def require_just(self, key: str, is_needed: bool, by: str) -> None:
        """Check that a key is given if the value of another, `by`, needs it, and not otherwise.

        Raises:
            PydanticCustomError: the key is missing, or has no meaning here.
        """
        if (getattr(self, key) is not None) != is_needed:
            words = "missing, but required" if is_needed else "expected none"
            raise inconsistent(key, f'{words} with {by} = "{getattr(self, by)}"')


_VALUE = re.compile(
    r"\s*([+-]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][+-]?\d{1,3})?)"
    r"\s*([A-Za-zµμΩ°%][\w µμΩ°%²³·*/^().-]{0,40})"
)
"""A number with a unit. Its parts are short: to evaluate 9**9**9 m would take forever."""
_COMMA = re.compile(r"\s*([+-]?\d{1,40}),(\d{1,40}\s*\D{0,40})")
"""A number with a decimal comma."""
_POWER = re.compile(r"(?<=[A-Za-z])([0-9])")
"""A digit behind a letter is a power: m2 is m^2."""
_ANGULAR = re.compile(r"\b(rad|radians?|rpm|rps|rev|revolutions?|turns?|cycles?|deg|degrees?)\b")
"""Units of angles are pure numbers to pint, so that 1 rpm would be 0.105 Hz."""
_WORDS = {
    "m": 'a length such as "2 mm"',
    "kg": 'a mass such as "10 g"',
    "s": 'a time such as "5 ms"',
    "Hz": 'a frequency such as "3.25 Hz"',
    "N": 'a force such as "0.5 N"',
    "Pa": 'a modulus such as "70 GPa"',
    "m/s": 'a velocity such as "0.5 mm/s"',
    "m/s2": 'an acceleration such as "9.81 m/s2" or "1 g_0"',
    "kg/m": 'a mass per length such as "0.2 kg/m"',
    "kg/m3": 'a density such as "2.7 g/cm3"',
    "N m": 'a rotational stiffness such as "150 N m"',
    "deg": 'an angle such as "30 deg"',
    "N m2": 'a bending stiffness such as "1.5 N m2"',
    "N/m": 'a stiffness such as "0.1 N/mm"',
    "N s/m": 'a damping such as "2 N s/m"',
    "1": 'a pure number such as 0.008 or "0.8 %"',
}
"""What a key expects, by its unit."""


@dataclass(frozen=True)
class Unit:
    """A validator of a field that converts a text with a unit to a number in SI.

    Attributes:
        name: the SI unit of the field as documents write it: "kg/m3"; "1" of a pure number.
    """

    name: str

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return the schema of the field with this validator before it."""
        return core_schema.no_info_before_validator_function(
            lambda value: in_si(value, self.name), handler(source)
        )


def in_si(value: object, unit: str, key: str = "") -> object:
    """Return a value that carries a unit as a number in an SI unit; any other value as it is.

    Args:
        value: a text such as "2 mm", a quantity of pint, or anything else.
        unit: the SI unit.
        key: key of the value for messages, where the place of the error does not give it.

    Raises:
        PydanticCustomError: the unit is unknown, or does not fit.
    """
    if hasattr(value, "to") and hasattr(value, "magnitude"):  # of any registry of pint
        return _magnitude(value, unit, str(value), key)
    match = _VALUE.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        comma = _COMMA.fullmatch(value) if isinstance(value, str) else None
        if comma is not None:
            point = f"{comma[1]}.{comma[2]}"
            raise _refused(f"expected {_words(unit)} with a decimal point, {point!r}", key)
        return value
    text = f"{match[1]} {match[2]}"
    if _ANGULAR.search(match[2]) and unit == "Hz":
        raise _refused(f"expected {_WORDS[unit]}, not an angular one, given {text!r}", key)
    try:
        quantity = _registry().Quantity(Decimal(match[1]), _unit(match[2]))
    except Exception:  # pint's parser raises errors of many kinds
        raise _refused(f"expected {_words(unit)}, given {text!r}: unknown unit", key) from None
    return _magnitude(quantity, unit, text, key)


def _magnitude(quantity: Any, unit: str, text: str, key: str) -> float:
    """Return the magnitude of a quantity in a unit."""
    try:
        return float(quantity.to("" if unit == "1" else _unit(unit)).magnitude)
    except Exception:  # of another dimension, or without any finite magnitude
        raise _refused(f"expected {_words(unit)}, given {text!r}", key) from None


def _words(unit: str) -> str:
    """Return in words what has a unit."""
    return _WORDS.get(unit, f"a value in {unit}")


def _refused(text: str, key: str) -> Exception:
    """Return an error that pydantic places at the value, or at a key if one is given."""
    if key:
        return inconsistent(key, text)
    return PydanticCustomError("inconsistent", "{text}", {"text": text})


def _unit(text: str) -> str:
    """Return a unit as pint writes it: `kg/m^3` for `kg/m3`."""
    return _POWER.sub(r"^\1", text.strip())


@lru_cache(maxsize=1)
def _registry() -> Any:
    """Return pint's units, with exact decimal factors: 685 mm are 0.685 m, not round-off more."""
    from pint import UnitRegistry

    return UnitRegistry(non_int_type=Decimal)
