"""Convert measured values to SI by the unit that a file or a user names."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

from delam_fem.case.toml import CaseError, shown

QUANTITIES = {
    "displacement": ("m", {"[length]": 1.0}),
    "velocity": ("m/s", {"[length]": 1.0, "[time]": -1.0}),
    "acceleration": ("m/s2", {"[length]": 1.0, "[time]": -2.0}),
    "force": ("N", {"[mass]": 1.0, "[length]": 1.0, "[time]": -2.0}),
    "impulse": ("N s", {"[mass]": 1.0, "[length]": 1.0, "[time]": -1.0}),
    "moment": ("N m", {"[mass]": 1.0, "[length]": 2.0, "[time]": -2.0}),
    "strain": ("1", {}),
    "time": ("s", {"[time]": 1.0}),
    "frequency": ("Hz", {"[time]": -1.0}),
    "voltage": ("V", {"[mass]": 1.0, "[length]": 2.0, "[time]": -3.0, "[current]": -1.0}),
    "receptance": ("m/N", {"[mass]": -1.0, "[time]": 2.0}),
    "mobility": ("m/(N s)", {"[mass]": -1.0, "[time]": 1.0}),
    "accelerance": ("m/(N s2)", {"[mass]": -1.0}),
}
"""Quantities with their SI unit and their dimensions."""
SI = "SI"
"""What names the SI unit of a quantity that is known otherwise."""
GRAVITY = ("g", "G", "gn")
"""How accelerometers name the standard gravity; a channel is not in grams."""
POWER = re.compile(r"(?<=[A-Za-zµμ])(-?[23])(?!\w)")
"""The exponent of a unit as in m/s2."""


@dataclass(frozen=True)
class Unit:
    """A unit as a factor.

    Attributes:
        factor: value in SI per value in the unit.
        units: the SI unit.
        quantity: one of `QUANTITIES`; empty for others.
    """

    factor: float
    units: str
    quantity: str


def unit_of(text: str, label: str) -> Unit:
    """Return what a unit is.

    Args:
        text: for example "mm", "m/s²", "µm/m", "g"; empty or "1": a pure number.
        label: of what has the unit, for messages.

    Raises:
        CaseError: there is no such unit, or it has a zero of its own (°C).
    """
    name = "g_0" if text in GRAVITY else text
    try:
        parsed: Any = _registry().Quantity(1.0, POWER.sub(r"**\1", name.strip("[] ")) or "1")
        base = parsed.to_base_units()
    except Exception as error:  # pint raises its own, tokenize's and arithmetic errors
        reason = "" if type(error).__name__ == "UndefinedUnitError" else f" ({error})"
        raise CaseError(
            f"{label}: expected a unit such as mm, m/s, m/s2, g, N or um/m, given "
            f"{shown(text)}{reason[:80]}"
        ) from None
    dimensions = {str(key): float(power) for key, power in base.dimensionality.items()}
    for quantity, (units, own) in QUANTITIES.items():
        if own == dimensions:
            return Unit(float(base.magnitude), units, quantity)
    return Unit(float(base.magnitude), f"{base.units:~C}".replace("**", ""), "")


def of_quantity(quantity: str) -> Unit:
    """Return the SI unit of a quantity."""
    return Unit(1.0, QUANTITIES[quantity][0], quantity)


@cache
def _registry() -> Any:
    """Return pint's units; to read their definitions takes a third of a second."""
    import pint

    return pint.UnitRegistry()
