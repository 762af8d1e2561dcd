"""Units as instruments and people write them, as factors to SI.

Only what stands in the tables of this module is a unit. Libraries of units take prefixes before
everything and leave out characters that they do not know: `mg` becomes kilograms, `?m` metres,
`EU` an exa-unit. A channel with a wrong unit is worse than one without.

    unit    = term {(blank | * | · | . | -) term} {/ term}
    term    = number | name [power] | ( unit )

After a quotient no product may follow without brackets, because m/N s has two meanings.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf, pi

from delam_fem.api import CaseError, shown


@dataclass(frozen=True)
class MeasuredUnit:
    """A unit of measurement as a factor to the SI unit.

    Attributes:
        factor: value in SI per value in the unit.
        units: the SI unit.
        quantity: one of `QUANTITIES`; empty for pure numbers and for ratios of two quantities.
    """

    factor: float
    units: str
    quantity: str


Powers = Mapping[str, int]
"""Powers of m, kg, s, A, rad and of counts; those that are 0 are left out."""
FORCE: Powers = {"kg": 1, "m": 1, "s": -2}
ACCELERATION: Powers = {"m": 1, "s": -2}
VOLTAGE: Powers = {"kg": 1, "m": 2, "s": -3, "A": -1}
PRESSURE: Powers = {"kg": 1, "m": -1, "s": -2}
QUANTITIES: dict[str, tuple[str, Powers]] = {
    "displacement": ("m", {"m": 1}),
    "velocity": ("m/s", {"m": 1, "s": -1}),
    "acceleration": ("m/s2", ACCELERATION),
    "force": ("N", FORCE),
    "impulse": ("N s", {"kg": 1, "m": 1, "s": -1}),
    "moment": ("N m", {"kg": 1, "m": 2, "s": -2}),
    "strain": ("1", {}),
    "angle": ("rad", {"rad": 1}),
    "angular velocity": ("rad/s", {"rad": 1, "s": -1}),
    "time": ("s", {"s": 1}),
    "frequency": ("Hz", {"s": -1}),
    "voltage": ("V", VOLTAGE),
    "current": ("A", {"A": 1}),
    "pressure": ("Pa", PRESSURE),
    "receptance": ("m/N", {"kg": -1, "s": 2}),
    "mobility": ("m/(N s)", {"kg": -1, "s": 1}),
    "accelerance": ("m/(N s2)", {"kg": -1}),
    "strain per force": ("1/N", {"kg": -1, "m": -1, "s": 2}),
}
"""Quantities with their SI unit and their dimensions."""
RESPONDING = ("displacement", "velocity", "acceleration", "strain", "voltage", "angle", "pressure")
EXCITING = ("displacement", "velocity", "acceleration", "force", "voltage", "current", "moment")
"""Quantities whose ratios are frequency responses; force over motion is none, but its inverse."""


@dataclass(frozen=True)
class Symbol:
    """A unit with the ways to write it.

    Attributes:
        names: names, separated by blanks.
        factor: SI value of one.
        powers: its dimensions.
        prefixes: prefixes that its first names may have.
        prefixed: how many of its names may have prefixes.
    """

    names: str
    factor: float
    powers: Powers
    prefixes: str = ""
    prefixed: int = 1


PREFIXES = {"p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "c": 1e-2,
            "d": 0.1, "da": 10.0, "h": 100.0, "k": 1e3, "M": 1e6, "G": 1e9}  # fmt: skip
GRAVITY, INCH, POUND = 9.80665, 0.0254, 4.4482216152605
"""Standard gravity [m/s²], an inch [m] and the force of a pound [N], all exact by definition."""
STRAIN = {"strain": 1}
COUNT = {"count": 1}
"""Marks of strains, which have no dimension, and of a converter's counts."""
SYMBOLS = (
    Symbol("m metre metres meter meters", 1.0, {"m": 1}, "n u µ μ m c d k"),
    Symbol("micron microns", 1e-6, {"m": 1}),
    Symbol("in inch inches", INCH, {"m": 1}),
    Symbol("mil mils thou", 1e-3 * INCH, {"m": 1}),
    Symbol("ft foot feet", 12.0 * INCH, {"m": 1}),
    Symbol("s sec second seconds secs Sec SEC Sekunde Sekunden", 1.0, {"s": 1}, "n u µ μ m", 2),
    Symbol("min minute minutes", 60.0, {"s": 1}),
    Symbol("h hr hour hours", 3600.0, {"s": 1}),
    Symbol("Hz hz HZ Hertz hertz HERTZ", 1.0, {"s": -1}, "m k M"),
    Symbol("KHz", 1e3, {"s": -1}),
    Symbol("cpm CPM rpm RPM", 1.0 / 60.0, {"s": -1}),
    Symbol("g G gn g0 g_0 g_n gs Gs g's G's", GRAVITY, ACCELERATION, "u µ μ m", 2),
    Symbol("Gal", 0.01, ACCELERATION, "m"),
    Symbol("ips", INCH, {"m": 1, "s": -1}),
    Symbol("N Newton newton Newtons newtons", 1.0, FORCE, "u µ μ m da k M"),
    Symbol("lbf", POUND, FORCE, "k"),
    Symbol("kgf kp", GRAVITY, FORCE),
    Symbol("dyn", 1e-5, FORCE),
    Symbol("Ns", 1.0, {"kg": 1, "m": 1, "s": -1}, "m k"),
    Symbol("Nm", 1.0, {"kg": 1, "m": 2, "s": -2}, "m k"),
    Symbol("V Volt volt Volts volts", 1.0, VOLTAGE, "n u µ μ m k"),
    Symbol("A ampere amperes", 1.0, {"A": 1}, "u µ μ m"),
    Symbol("C", 1.0, {"A": 1, "s": 1}, "p n"),
    Symbol("Pa Pascal pascal", 1.0, PRESSURE, "u µ μ m h k M G"),
    Symbol("bar", 1e5, PRESSURE, "m"),
    Symbol("psi", POUND / INCH**2, PRESSURE),
    Symbol("rad radian radians", 1.0, {"rad": 1}, "u µ μ m"),
    Symbol("deg degree degrees °", pi / 180.0, {"rad": 1}, "m"),
    Symbol("ε epsilon strain", 1.0, STRAIN, "n u µ μ m", 3),
    Symbol("ue ustrain microstrain", 1e-6, STRAIN),
    Symbol("%", 0.01, {}),
    Symbol("‰", 1e-3, {}),
    Symbol("ppm", 1e-6, {}),
    Symbol("counts count cts ct LSB digits", 1.0, COUNT),
    Symbol("kg", 1.0, {"kg": 1}),
    Symbol("lb lbs lbm", 0.45359237, {"kg": 1}),
    Symbol("W", 1.0, {"kg": 1, "m": 2, "s": -3}),
)
"""All units. The last are in no channel, and so refused with what they are."""


def _known() -> Iterator[tuple[str, tuple[float, Powers]]]:
    """Yield each way to write a unit, with factor and dimensions."""
    for symbol in SYMBOLS:
        names = symbol.names.split()
        for name in names:
            yield name, (symbol.factor, symbol.powers)
        for prefix in symbol.prefixes.split():
            for name in names[: symbol.prefixed]:
                yield prefix + name, (PREFIXES[prefix] * symbol.factor, symbol.powers)


UNITS: dict[str, tuple[float, Powers]] = dict(_known())
PLAIN = ("1", "-", "–", "none", "unitless", "dimensionless")
"""Texts of pure numbers."""
AS_PEAK = ("0-pk", "0-peak", "0-p", "peak", "pk")
NOT_PEAK = ("rms", "pk-pk", "peak-to-peak", "peak-peak", "pkpk", "p-p", "pp", "p2p")
"""What instruments write behind a unit: of amplitudes, and of what is none."""
AMBIENT = {
    **dict.fromkeys(("°C", "℃", "degC", "deg C", "Celsius"), "a temperature"),
    **dict.fromkeys(("°F", "℉", "degF", "deg F", "K", "Kelvin"), "a temperature"),
    **dict.fromkeys(("%RH", "% RH", "%rH", "% rH", "%rh", "% rh"), "a humidity"),
    **dict.fromkeys(("W", "mW", "kW"), "a power"),
}
"""Units of what loggers and exports hold beside the motion, and what that is."""
REASONS = {
    **{unit: f"{what}, which no channel is" for unit, what in AMBIENT.items()},
    "dB": "a level; take 10 to the level over 20, times its reference",
    "EU": "engineering units, which the instrument's set-up defines",
    "a.u.": "arbitrary units",
    "arb": "arbitrary units",
}
"""Why some texts cannot be units of a channel, by the beginning of the text."""
TOKEN = re.compile(
    r"(?P<blank>\s+)|(?P<number>\d{1,15}(?:\.\d{1,15})?(?:[eE][-+]?\d{1,3})?)"
    r"|(?P<operator>\*\*|[-+*·⋅×./()^])|(?P<raised>[⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]{1,2})"
    r"|(?P<name>[A-Za-zµμε°%‰][A-Za-zµμε°'_]*(?:(?<=g)0|(?<=g_)0)?)"
)
"""A piece of a unit."""
RAISED = str.maketrans("⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "+-0123456789")
LONGEST = 80
"""Characters of the longest unit."""
DEEPEST = 4
"""Brackets within brackets."""


class _Wrong(ValueError):
    """Say why a text is no unit."""


@dataclass
class _Term:
    """What has been read of a unit.

    Attributes:
        factor: its factor to SI.
        powers: powers of its dimensions.
        parts: dimensions of the units in it, for ratios that cancel.
    """

    factor: float
    powers: Counter[str]
    parts: list[Powers]

    def times(self, other: _Term, power: int) -> None:
        """Multiply by another term to a power."""
        self.factor *= other.factor**power
        for name, exponent in other.powers.items():
            self.powers[name] += power * exponent
        self.parts += other.parts


def unit_of(text: str, label: str, *, is_response: bool = False) -> MeasuredUnit:
    """Return the factor, the SI unit and the quantity of a unit that is given as text.

    A sensitivity may stand in it: `V/(100 mV/g)` is an acceleration.

    Args:
        text: a unit such as "mm", "m/s²", "µm/m", "g"; "1" or "-": a pure number.
        label: name of what has the unit, for messages.
        is_response: whether the ratio of any motion to any excitation is meant, too.

    Raises:
        CaseError: the text is no unit of `UNITS`, or that of no quantity.
    """
    try:
        return _evaluated(text.strip(), is_response)
    except _Wrong as error:
        raise CaseError(
            f"{label}: expected a unit such as mm, m/s, m/s2, g, N or um/m, given {shown(text)}: "
            f"{error}; --channel NAME=SOURCE:UNIT gives another"
        ) from None


def ambient(text: str) -> str:
    """Return what has a unit that is one of the surroundings; empty: it is none."""
    return AMBIENT.get(text.strip().removeprefix("[").removesuffix("]").strip(), "")


def _evaluated(text: str, is_response: bool) -> MeasuredUnit:
    """Return a text as a unit of a quantity.

    Raises:
        _Wrong: it is none.
    """
    if text.startswith("[") and text.endswith("]"):
        text = text[1:-1].strip()
    if text in PLAIN:
        return MeasuredUnit(1.0, "1", "")
    if len(text) > LONGEST:
        raise _Wrong(f"longer than {LONGEST} characters")
    for start, reason in REASONS.items():
        if text == start or text.startswith(f"{start} "):
            raise _Wrong(reason)
    tokens = _tokens(_without_peak(text))
    try:
        term = _product(tokens)
    except (OverflowError, ZeroDivisionError):
        raise _Wrong("its factor is no finite number") from None
    if tokens:
        raise _Wrong("a bracket is closed that was not opened")
    if not 0.0 < term.factor < inf:
        raise _Wrong("its factor is no positive finite number")
    powers = {name: power for name, power in term.powers.items() if power}
    if "count" in powers:
        raise _Wrong("counts of a converter need its sensitivity, as in counts/(2000 counts/g)")
    is_strain = any(part == STRAIN for part in term.parts)
    powers.pop("strain", None)
    if not powers:
        return MeasuredUnit(term.factor, "1", _of_ratio(term.parts, is_strain))
    for quantity, (units, dimensions) in QUANTITIES.items():
        if dimensions == powers:
            return MeasuredUnit(term.factor, units, quantity)
    if is_response and _is_response(powers):
        return MeasuredUnit(term.factor, written(powers), "")
    raise _Wrong(f"taken for {written(powers)}, which is the unit of no channel")


def _of_ratio(parts: list[Powers], is_strain: bool) -> str:
    """Return the quantity of units that cancel: a strain, or none for pure numbers and g/g.

    Raises:
        _Wrong: they are a ratio of voltages, times or angles, which may be anything.
    """
    if is_strain or (parts and all(part == {"m": 1} for part in parts)):
        return "strain"
    mechanical = [part for part in parts if "m" in part and "A" not in part]
    if any(parts) and not mechanical:
        raise _Wrong("a ratio of two equal units, and not of two lengths, is no strain")
    return ""


def _is_response(powers: Powers) -> bool:
    """Return whether dimensions are those of a motion over an excitation."""
    ratios = []
    for response in RESPONDING:
        for excitation in EXCITING:
            ratio = Counter(QUANTITIES[response][1])
            ratio.subtract(QUANTITIES[excitation][1])
            ratios.append({name: power for name, power in ratio.items() if power})
    return dict(powers) in ratios


def _without_peak(text: str) -> str:
    """Return a unit without the word that its values are peaks.

    Raises:
        _Wrong: its values are no amplitudes.
    """
    bare = text.rstrip(" )")
    lower = bare.lower()
    if lower.endswith(NOT_PEAK):
        raise _Wrong(
            "an effective value or one from peak to peak is no amplitude; a factor in the unit "
            "makes it one, as in 1.4142 g or 0.5 mm"
        )
    for word in AS_PEAK:
        if lower.endswith(word):
            return bare[: -len(word)].rstrip(" (_-.,")
    return text.removesuffix(".")


def _tokens(text: str) -> list[tuple[str, str]]:
    """Return the pieces of a unit, kind and text, the last first.

    Raises:
        _Wrong: a character is not understood.
    """
    tokens = []
    place = 0
    while place < len(text):
        match = TOKEN.match(text, place)
        if match is None:
            raise _Wrong(
                f"the character {text[place]!r} is not understood (a file in another encoding?)"
            )
        tokens.append((str(match.lastgroup), match.group()))
        place = match.end()
    if not tokens:
        raise _Wrong("it is empty")
    return tokens[::-1]


def _product(tokens: list[tuple[str, str]], depth: int = 0) -> _Term:
    """Return the product or quotient that begins with the last of the tokens; they are taken off.

    Raises:
        _Wrong: it is none, or has two meanings.
    """
    product = _Term(1.0, Counter(), [])
    is_divided = False
    power = 1
    while True:
        _skip_blank(tokens)
        product.times(_one(tokens, depth), power)
        is_blank = _skip_blank(tokens)
        kind, text = tokens[-1] if tokens else ("end", "")
        if kind == "end" or text == ")":
            return product
        if text == "/":
            power = -1
            is_divided = True
            tokens.pop()
        elif text in ("*", "·", "⋅", "×", ".", "-") or is_blank or kind == "name":
            if is_divided:
                raise _Wrong(
                    "a product behind a quotient has two meanings; brackets tell them apart"
                )
            if kind == "operator" and text != "(":
                tokens.pop()
        else:
            raise _Wrong(f"{text!r} is not expected there")


def _skip_blank(tokens: list[tuple[str, str]]) -> bool:
    """Take blanks off the end of the tokens; return whether there were any."""
    is_blank = bool(tokens) and tokens[-1][0] == "blank"
    if is_blank:
        tokens.pop()
    return is_blank


def _one(tokens: list[tuple[str, str]], depth: int) -> _Term:
    """Return the number, the unit with its power, or what is in brackets; it is taken off.

    Raises:
        _Wrong: the last token is none of these, or an unknown name.
    """
    kind, text = tokens.pop() if tokens else ("end", "its end")
    if kind == "number":
        return _Term(float(text), Counter(), [])
    if text == "(" and depth < DEEPEST:
        term = _product(tokens, depth + 1)
        if not tokens:
            raise _Wrong("a bracket is not closed")
        tokens.pop()
    elif kind == "name":
        if text not in UNITS:
            raise _Wrong(_unknown(text))
        factor, powers = UNITS[text]
        term = _Term(factor, Counter(powers), [powers])
    else:
        raise _Wrong(f"{text!r} is not expected there")
    power = _power(tokens)
    if text == "ms" and power < 0:
        raise _Wrong("milliseconds or metres times seconds; write m/s or m/s2")
    result = _Term(1.0, Counter(), [])
    result.times(term, power)
    return result


def _power(tokens: list[tuple[str, str]]) -> int:
    """Return the power that follows a unit, 1 if none does; it is taken off.

    Raises:
        _Wrong: it is no whole number.
    """
    kind, text = tokens[-1] if tokens else ("end", "")
    if kind == "raised":
        tokens.pop()
        return int(text.translate(RAISED))
    is_said = text in ("^", "**")
    if is_said:
        tokens.pop()
    in_brackets = is_said and bool(tokens) and tokens[-1][1] == "("
    if in_brackets:
        tokens.pop()
    sign = 1
    if len(tokens) > 1 and tokens[-1][1] in ("-", "+") and tokens[-2][0] == "number":
        sign = -1 if tokens.pop()[1] == "-" else 1
    if tokens and tokens[-1][0] == "number":
        digits = tokens.pop()[1]
        if not digits.isdigit() or int(digits) > 9:
            raise _Wrong(f"{digits} is no whole power")
        if in_brackets and (not tokens or tokens.pop()[1] != ")"):
            raise _Wrong("a bracket is not closed")
        return sign * int(digits)
    if is_said:
        raise _Wrong("a power is missing")
    return 1


def _unknown(name: str) -> str:
    """Return why a name is no unit, with those that differ from it in capitals only."""
    similar = [unit for unit in UNITS if unit.lower() == name.lower()]
    hint = f"; {' or '.join(similar)} would be one" if similar else ""
    return f"{name!r} is no unit that the program knows{hint}"


def written(powers: Powers) -> str:
    """Return dimensions as an SI unit, such as kg/(A s2)."""
    above = [f"{name}{power if power > 1 else ''}" for name, power in powers.items() if power > 0]
    below = [f"{name}{-power if power < -1 else ''}" for name, power in powers.items() if power < 0]
    if not below:
        return " ".join(above) or "1"
    divisor = below[0] if len(below) == 1 else f"({' '.join(below)})"
    return f"{' '.join(above) or '1'}/{divisor}"


def ratio_of(units: str, divisor: str) -> str:
    """Return the SI unit of the ratio of two SI units, such as m/(N s) of m/s and N."""
    term = _product(_tokens(units))
    term.times(_product(_tokens(divisor)), -1)
    powers = {name: power for name, power in term.powers.items() if power}
    named = [unit for unit, dimensions in QUANTITIES.values() if dimensions == powers]
    return named[0] if named else written(powers)


def of_quantity(quantity: str) -> MeasuredUnit:
    """Return the SI unit of a quantity."""
    return MeasuredUnit(1.0, QUANTITIES[quantity][0], quantity)
