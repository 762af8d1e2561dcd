"""Read values that carry a unit, such as "2 mm", "70 GPa" or "3.25 Hz"; everything else is SI.

The names of units are those of pint, which is imported only where a text has a unit.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from functools import lru_cache
from typing import Any

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from delam_fem.case.fields import inconsistent

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
        return core_schema.no_info_before_validator_function(self._converted, handler(source))

    def _converted(self, value: object) -> object:
        """Convert a value if it carries a unit."""
        return in_si(value, self.name)


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
    found = _VALUE.fullmatch(value) if isinstance(value, str) else None
    if found is None:
        comma = _COMMA.fullmatch(value) if isinstance(value, str) else None
        if comma is not None:
            point = f"{comma[1]}.{comma[2]}"
            raise _refused(f"expected {_words(unit)} with a decimal point, {point!r}", key)
        return value
    text = f"{found[1]} {found[2]}"
    if _ANGULAR.search(found[2]) and unit == "Hz":
        raise _refused(f"expected {_WORDS[unit]}, not an angular one, given {text!r}", key)
    try:
        quantity = _registry().Quantity(Decimal(found[1]), _unit(found[2]))
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
    """Return an error at the place of the value, or at a key."""
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
