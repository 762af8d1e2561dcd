"""Tell where refinement goes below what the beam and its damping can mean.

Two lengths bound what a finer mesh adds. Waves of modes that are overdamped do not wave: a bump
that short creeps back. And a beam knows nothing of what happens within its thickness.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from delam_fem.case.definition import Case
from delam_fem.numerics.rayleigh import overdamped_from


@dataclass(frozen=True)
class ShortWave:
    """The longest wave of a lamina that is overdamped.

    Attributes:
        name: name of the lamina.
        frequency: frequency that it would have undamped [Hz].
        length: wavelength [m].
        thickness: thickness of the lamina [m].
    """

    name: str
    frequency: float
    length: float
    thickness: float


def short_waves(case: Case) -> tuple[ShortWave, ...]:
    """Return the longest overdamped wave of each lamina, from bottom to top.

    A wave of a beam has the length λ = 2π (EI/ρA)^(1/4) / ω^(1/2). With mass damping alone no mode
    is overdamped by its shortness; its wavelength is 0.
    """
    found = []
    for i, lamina in enumerate(case.lamina):
        omega = overdamped_from(*case.rayleigh(i))
        stiffness = lamina.flexural_rigidity / lamina.mass_per_length
        length = 2.0 * math.pi * stiffness**0.25 / math.sqrt(omega) if omega > 0.0 else math.inf
        found.append(ShortWave(lamina.name, omega / (2.0 * math.pi), length, lamina.thickness))
    return tuple(found)


def refinement_warnings(case: Case, points: Iterable[int]) -> list[str]:
    """Return a warning for each length that some of the meshes go below.

    Points at a distance h hold waves down to 2 h.

    Args:
        case: the case that is refined.
        points: numbers of contact points along the laminae, of all meshes.
    """
    numbers = sorted(set(points))
    waves = short_waves(case)
    longest = max(waves, key=lambda wave: wave.length)
    thickest = max(waves, key=lambda wave: wave.thickness)
    texts = []
    if creeping := [n for n in numbers if 2.0 * case.length / n < longest.length]:
        texts.append(
            f"{_meshes(case, creeping)} hold waves shorter than {_mm(longest.length)} mm, and "
            f"those are overdamped ({longest.name}: modes above {longest.frequency:.3g} Hz, "
            f"{case.damping.rayleigh} damping): what such a mesh adds does not wave, it creeps"
        )
    if thin := [n for n in numbers if case.length / n < thickest.thickness]:
        texts.append(
            f"{_meshes(case, thin)} have points nearer to one another than the thickness "
            f"{_mm(thickest.thickness)} mm of {thickest.name}: a beam has no meaning there"
        )
    return texts


def _meshes(case: Case, numbers: list[int]) -> str:
    first = numbers[0]
    return f"meshes from {first} points along the laminae on ({_mm(case.length / first)} mm apart)"


def _mm(length: float) -> str:
    return f"{1e3 * length:.3g}"
