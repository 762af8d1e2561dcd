"""Young's modulus and density of named materials: nominal values for a first model.

Sheets of one name differ by some percent: where natural frequencies matter, identify the modulus.

Sources:
    aluminium: EN 1999-1-1, 3.2.5.
    steel: EN 1993-1-1, 3.2.6 (modulus); EN 1991-1-1, table A.4 (77 to 78.5 kN/m3).
    titanium: the alloy Ti-6Al-4V; ASM Handbook, volume 2.
    carbon-epoxy (T300/5208), glass-epoxy (Scotchply 1002): unidirectional, along the fibres; S. W.
    Tsai, H. T. Hahn, "Introduction to Composite Materials" (1980), table 1.7.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Material:
    """A material of the table.

    Attributes:
        young_modulus: E [Pa].
        density: rho [kg/m3].
    """

    young_modulus: float
    density: float


MATERIALS: Mapping[str, Material] = MappingProxyType(
    {
        "aluminium": Material(70e9, 2700.0),
        "steel": Material(210e9, 7850.0),
        "titanium": Material(113.8e9, 4430.0),
        "carbon-epoxy": Material(181e9, 1600.0),
        "glass-epoxy": Material(38.6e9, 1800.0),
    }
)
"""Materials by the names that `lamina.….material` takes."""
