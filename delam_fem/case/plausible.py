"""Warn where the numbers of a case look like a mistake in a unit; nothing is refused.

Each check compares a ratio of the case with bounds that laminae of any material and size keep. If
the number would be plausible in another usual unit, the warning names that unit.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise

import numpy as np
import scipy  # loads its parts when they are used

from delam_fem.case.definition import Case
from delam_fem.case.excitation import (
    BurstExcitation,
    Excitation,
    ForceExcitation,
    HammerExcitation,
    HarmonicExcitation,
    MultisineExcitation,
    NoExcitation,
    RandomExcitation,
    RecordExcitation,
    SweepExcitation,
    TableExcitation,
    Tabulated,
    drive,
    parts_of,
)
from delam_fem.case.materials import MATERIALS
from delam_fem.case.sections import DISAGREEING, ENDS, Lamina

Bounds = tuple[float, float]

SLENDERNESS: Bounds = (10.0, 2e4)
"""Length over thickness; below, Euler–Bernoulli beams do not hold."""
WAVE_SPEED: Bounds = (200.0, 20e3)
"""sqrt(E / rho) from soft plastics to diamond [m/s]."""
DENSITY: Bounds = (20.0, 23e3)
"""From foams to osmium [kg/m3]."""
AMPLITUDE: Bounds = (0.0, 0.1)
"""Largest displacement of the base over the length."""
GAP: Bounds = (0.0, 0.2)
"""Largest gap at rest over the length."""
FREQUENCY: Bounds = (0.01, 250.0)
"""Excitation over the first frequency of the laminae alone; the tenth is 253 times the first."""
DAMPING: Bounds = (0.0, 0.2)
"""Damping ratio."""
MASS: Bounds = (0.0, 20.0)
"""Point mass over the mass of its lamina."""
THICKEST = 0.1
"""Thickness above which a slender lamina has its lengths in another unit than m [m]."""
BLOW_STEPS = 20
"""Steps that a blow should have at least."""
SAMPLES = 4001
"""Instants at which the motion of a base with many lines is looked at."""

_OTHERS: Mapping[str, tuple[tuple[str, float], ...]] = {
    "m": (("mm", 1e-3), ("cm", 1e-2), ("µm", 1e-6)),
    "Pa": (("GPa", 1e9), ("MPa", 1e6)),
    "kg/m3": (("g/cm3", 1e3),),
    "Hz": (("mHz", 1e-3), ("kHz", 1e3)),
    "kg": (("g", 1e-3),),
    "m/s2": (("mm/s2", 1e-3),),
    "-": (("%", 1e-2),),
}
"""Other units that a number may be meant in, with their factors."""
_told: set[str] = set()
_log = logging.getLogger(__name__)


def warnings(case: Case) -> list[str]:
    """Return a sentence for each number of a case that looks like a mistake in a unit."""
    if case.is_axial:
        return []
    texts = [text for lamina in case.lamina for text in _of_lamina(lamina)]
    return [*texts, *_of_gaps(case), *_of_excitation(case), *_of_masses(case)]


G = 9.80665
"""Acceleration of free fall [m/s2]."""
SAGS = {(0, 2): 8.0, (1, 1): 384.0 / 5.0, (1, 2): 185.0, (2, 2): 384.0}
"""q l⁴ / (EI sag) by what both ends hold, from the weaker: nothing, deflections, slopes as well."""
LEAST_SAG = 0.1
"""Share of the gap from which a sag matters."""


def of_weight(case: Case) -> Iterator[str]:
    """Yield a warning if weight, which the case leaves out, would close gaps of level strips."""
    if case.is_axial or case.gravity is not None:
        return
    holds = case.support.holds
    ends = [holds(end) * (2 - case.support.turns(end)) for end in ENDS]
    kind_of_laminae = (min(ends), max(ends))
    pieces: list[tuple[str, float, tuple[str, str], float, tuple[int, int]]] = [
        (f"delamination.{number}.opening", one.opening, one.between, one.end - one.start, (2, 2))
        for number, one in enumerate(case.delamination, start=1)
    ]
    if case.gap is not None and kind_of_laminae in SAGS:
        stack = [lamina.name for lamina in case.lamina]
        pieces += [
            ("gap.tip", case.gap.tip or 0.0, pair, case.length, kind_of_laminae)
            for pair in pairwise(stack)
        ]
    by_name = {lamina.name: lamina for lamina in case.lamina}
    for key, gap, names, length, kind in pieces:
        sags = [
            by_name[name].uniform.mass_per_length
            * G
            * length**4
            / (SAGS[kind] * by_name[name].uniform.flexural_rigidity)
            for name in names
        ]
        if gap > 0.0 and abs(sags[0] - sags[1]) > LEAST_SAG * gap:
            texts = " and ".join(
                f"{name} sags by {1e3 * sag:.3g} mm" for name, sag in zip(names, sags, strict=True)
            )
            yield (
                f"[gravity] is not given: if the strips are level, {texts} by weight, "
                f"beside {key} = {1e3 * gap:g} mm; if they stand or lie on edge, say so by "
                "gravity.inclination = 90 or gravity.roll = 90"
            )


def tell(case: Case) -> None:
    """Log the warnings of a case, each once in a process."""
    for text in warnings(case):
        if text not in _told:
            _told.add(text)
            _log.warning(text)


def _checked(
    key: str,
    value: float,
    unit: str,
    what: str,
    bounds: Bounds,
    ratio: Callable[[float], float],
) -> Iterator[str]:
    """Yield a warning if a ratio is out of its bounds.

    Args:
        key: key of the number.
        value: the number.
        unit: its unit.
        what: the ratio in words.
        bounds: smallest and largest plausible ratio.
        ratio: function of the number.
    """
    low, high = bounds
    magnitude = ratio(value)
    if low <= magnitude <= high:
        return
    meant = [name for name, factor in _OTHERS[unit] if low <= ratio(factor * value) <= high]
    number = f"{value:g}" if unit == "-" else f"{value:g} {unit}"
    limit = f"above {high:g}" if magnitude > high else f"below {low:g}"
    hint = f'; did you mean "{value:g} {meant[0]}"?' if meant else ""
    yield f"{key} = {number} looks unusual: {what} is {magnitude:.3g}, {limit}{hint}"


def _of_lamina(lamina: Lamina) -> list[str]:
    """Return warnings about a lamina; about two of one number only if nothing else is unusual."""
    return [*_unusual_numbers(lamina)] or [*_two_stiffnesses(lamina), *_two_masses(lamina)]


def _two_stiffnesses(lamina: Lamina) -> Iterator[str]:
    """Yield a warning if a given EI is far from E b h^3/12 of a given E.

    A material does not count: to give EI beside it means to replace its stiffness.
    """
    if lamina.has_two_stiffnesses:
        EI = lamina.flexural_rigidity
        E = lamina.mean("young_modulus")
        yield (
            f"lamina.{lamina.name}.bending_stiffness = {EI:.4g} N m2 counts, not the "
            f"{E * lamina.second_moment:.4g} N m2 of young_modulus = {E:.4g} Pa with this width "
            "and thickness; remove the one that is not meant"
        )


def _two_masses(lamina: Lamina) -> Iterator[str]:
    """Yield a warning if a given mass per length is far from that of the lamina's material."""
    row = MATERIALS.get(lamina.material) if isinstance(lamina.material, str) else None
    if row is None:
        return
    if not lamina.is_uniform:
        return
    of_material = row["density"] * lamina.mean("width") * lamina.mean("thickness")
    if abs(lamina.mass_per_length - of_material) > DISAGREEING * of_material:
        yield (
            f"lamina.{lamina.name}.mass_per_length = {lamina.mass_per_length:.4g} kg/m counts, not "
            f"the {of_material:.4g} kg/m of the material {lamina.material} with this width and "
            "thickness; remove the one that is not meant"
        )


def _unusual_numbers(lamina: Lamina) -> Iterator[str]:
    """Yield warnings about a lamina: slenderness, density, wave speed, damping."""
    key = f"lamina.{lamina.name}"
    L = lamina.length
    b, h, rho, E = map(lamina.mean, ("width", "thickness", "density", "young_modulus"))
    words = "length over thickness"
    if _is_in_mm(lamina):
        yield (
            f"{key}: length = {L:g} m, width = {b:g} m and thickness = {h:g} m look "
            f'unusual; did you mean "{L:g} mm", "{b:g} mm" and "{h:g} mm"?'
        )
    elif not SLENDERNESS[0] <= 1e-3 * L / h <= SLENDERNESS[1]:  # a length in mm would be plausible
        yield from _checked(f"{key}.thickness", h, "m", words, SLENDERNESS, lambda value: L / value)
    else:
        yield from _checked(f"{key}.length", L, "m", words, SLENDERNESS, lambda value: value / h)
    dense = [*_checked(f"{key}.density", rho, "kg/m3", "the density", DENSITY, float)]
    yield from dense
    if not dense:
        yield from _checked(
            f"{key}.young_modulus",
            E,
            "Pa",
            "the wave speed sqrt(E/rho) in m/s",
            WAVE_SPEED,
            lambda value: math.sqrt(value / rho),
        )
    yield from _checked(
        f"{key}.damping_ratio", lamina.damping_ratio, "-", "the damping ratio", DAMPING, float
    )


def _is_in_mm(lamina: Lamina) -> bool:
    """Return whether all lengths of a lamina look like numbers in mm."""
    h = lamina.mean("thickness")
    is_slender = SLENDERNESS[0] <= lamina.length / h <= SLENDERNESS[1]
    return h > THICKEST and is_slender


def _of_gaps(case: Case) -> Iterator[str]:
    """Yield warnings about gaps at rest."""
    numbered = enumerate(case.delamination, start=1)
    numbers = {f"delamination.{k}.opening": delamination.opening for k, delamination in numbered}
    if case.gap is not None:
        numbers |= {"gap.tip": case.gap.tip or 0.0, "gap.root": case.gap.root or 0.0}
    for key, value in numbers.items():
        yield from _checked(
            key, value, "m", "the gap over the length", GAP, lambda gap: gap / case.length
        )


def _of_excitation(case: Case) -> Iterator[str]:
    """Yield warnings about amplitude and frequency."""
    for excitation in parts_of(case.excitation):
        yield from _of_one_excitation(excitation, case)


def _of_one_excitation(excitation: Excitation, case: Case) -> Iterator[str]:
    """Yield warnings about one of the drives of a case."""
    if (
        isinstance(excitation, HammerExcitation)
        and excitation.duration < BLOW_STEPS * case.time_step
    ):
        yield (
            f"time.step = {case.time.step:g} s is long: the blow of {excitation.duration:g} s has "
            f"{excitation.duration / case.time_step:.3g} steps, below {BLOW_STEPS}"
        )
    if isinstance(excitation, TableExcitation | RecordExcitation):
        if excitation.acts_on == "base":
            yield from _of_base_table(excitation, case.length)
    if isinstance(excitation, NoExcitation):
        starts = [start.displacement or start.velocity for start in case.initial]
        if not any((*starts, *(impactor.velocity for impactor in case.impactor))):
            yield 'excitation.kind = "none" looks unusual: nothing moves without an initial state'
    if isinstance(excitation, MultisineExcitation | RandomExcitation | BurstExcitation):
        yield from _of_band(excitation, case.length)
    if isinstance(excitation, HarmonicExcitation | SweepExcitation):
        yield from _of_base_motion(excitation, case.length)
    is_judged = isinstance(excitation, HarmonicExcitation | SweepExcitation | ForceExcitation)
    if not is_judged or any(map(_is_in_mm, case.lamina)):
        return
    firsts = [lamina.uniform.angular_frequencies(1)[0] / (2.0 * math.pi) for lamina in case.lamina]
    for key in ("frequency", "start_frequency", "end_frequency"):
        value = getattr(excitation, key, None)
        if value is None:
            continue
        first = float(min(firsts) if value < min(firsts) else max(firsts))
        yield from _checked(
            f"excitation.{key}",
            value,
            "Hz",
            f"its ratio to the first frequency {first:.3g} Hz of a lamina alone",
            FREQUENCY,
            lambda f, first=first: f / first,  # type: ignore[misc]
        )


def _of_base_motion(given: HarmonicExcitation | SweepExcitation, length: float) -> Iterator[str]:
    """Yield a warning if the displacement of the base is large beside the laminae."""
    is_acceleration = given.acceleration is not None
    size = given.acceleration if given.acceleration is not None else given.amplitude or 0.0
    starts = ("frequency", "start_frequency", "end_frequency")
    lowest = min(getattr(given, name, math.inf) for name in starts)
    displacement = given.displacement_amplitude(lowest)
    yield from _checked(
        "excitation.acceleration" if is_acceleration else "excitation.amplitude",
        size,
        "m/s2" if is_acceleration else "m",
        "the amplitude over the length",
        AMPLITUDE,
        lambda value: displacement * (value / size) / length if size else 0.0,
    )


def _of_band(
    given: MultisineExcitation | RandomExcitation | BurstExcitation, length: float
) -> Iterator[str]:
    """Yield a warning if a base with many lines moves far beside the laminae."""
    if given.acts_on == "force":
        return
    times = np.linspace(0.0, given.length or given.turns / given.top_frequency, SAMPLES)
    largest = float(np.abs(drive(given).states(times)[:, 0]).max())
    if largest > AMPLITUDE[1] * length:
        yield (
            f"excitation looks unusual: it moves the base by up to {largest:.3g} m, "
            f"{largest / length:.3g} of the length of the laminae, most of it at excitation.low = "
            f"{given.low:g} Hz"
        )


def _of_base_table(given: TableExcitation | RecordExcitation, length: float) -> Iterator[str]:
    """Yield a warning if the motion of a base from a table is large beside the laminae."""
    time, value, unit = given.series()
    course = Tabulated.of(time, value, unit)
    largest = float(np.abs(course.states(time)[:, 0]).max())
    if largest <= AMPLITUDE[1] * length:
        return
    hint = ""
    if unit == "m/s2":
        mean = float(scipy.integrate.trapezoid(value, time) / time[-1])
        hint = (
            f"; its accelerations have the mean {mean:.3g} m/s2, from which this drift follows: "
            'take offset = "remove" of a table, or high_pass of a record'
        )
    yield (
        f"excitation.file = {given.file.name} looks unusual: it moves the base by up to "
        f"{largest:.3g} m, {largest / length:.3g} of the length of the laminae{hint}"
    )


def _of_masses(case: Case) -> Iterator[str]:
    """Yield warnings about point masses."""
    masses = {lamina.name: lamina.uniform.mass_per_length * lamina.length for lamina in case.lamina}
    for number, point_mass in enumerate(case.point_mass, start=1):
        lamina_mass = masses[point_mass.lamina]
        yield from _checked(
            f"point_mass.{number}.mass",
            point_mass.mass,
            "kg",
            "its ratio to the mass of the lamina",
            MASS,
            lambda value, whole=lamina_mass: value / whole,  # type: ignore[misc]
        )
