"""Define named materials, and orthotropic ones, whose numbers a case gives.

Numbers of named materials are nominal values for a first model. Sheets of one name differ by some
percent: where natural frequencies matter, identify the modulus.

Sources:
    aluminium: EN 1999-1-1, 3.2.5.
    steel: EN 1993-1-1, 3.2.6 (modulus, Poisson's ratio); EN 1991-1-1, table A.4 (77 to 78.5 kN/m3).
    titanium: the alloy Ti-6Al-4V; ASM Handbook, volume 2.
    carbon-epoxy (T300/5208), glass-epoxy (Scotchply 1002): unidirectional, along the fibres; S. W.
    Tsai, H. T. Hahn, "Introduction to Composite Materials" (1980), table 1.7.
    cfrp-ud, gfrp-ud: the same two with all their moduli, which that table gives in the plane.
    Across the fibres they are isotropic (E3 = E2, G13 = G12, nu13 = nu12), with nu23 = 0.4 assumed.
    foam: closed-cell PVC of 100 kg/m3, as Divinycell H100 (Diab, "Divinycell H Technical Manual"):
    modulus in tension (in compression 135 MPa) and in shear; nu = 0.4 assumed.
    honeycomb: aluminium 5052, 72 kg/m3 (4.5 lb/ft3), cells of 1/8 in, as HexWeb CR III
    1/8-5052-.001 (Hexcel, "HexWeb Honeycomb Attributes and Properties"): E3, G13 (ribbon, axis 1)
    and G23, there 150, 70 and 31 ksi. In its plane a core carries next to nothing; those moduli are
    small numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Self

import numpy as np
from pydantic import model_validator

from delam_fem.case.values import Finite, Positive, Section, Unit, inconsistent
from delam_fem.numerics import elasticity
from delam_fem.numerics.types import FloatArray

MATERIALS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "aluminium": {"young_modulus": 70e9, "density": 2700.0},
        "steel": {"young_modulus": 210e9, "density": 7850.0},
        "titanium": {"young_modulus": 113.8e9, "density": 4430.0},
        "carbon-epoxy": {"young_modulus": 181e9, "density": 1600.0},
        "glass-epoxy": {"young_modulus": 38.6e9, "density": 1800.0},
    }
)
"""Young's modulus E [Pa] and density rho [kg/m3] by the names that `lamina.….material` takes."""
POISSON: Mapping[str, float] = MappingProxyType(
    {
        "aluminium": 0.3,
        "steel": 0.3,
        "titanium": 0.342,
        "carbon-epoxy": 0.28,
        "glass-epoxy": 0.26,
    }
)
"""Poisson's ratio by the names of materials [-]; of unidirectional layers the larger one."""


class Orthotropic(Section):
    """An orthotropic material: axis 1 along its fibres, 2 across them, 3 through the thickness.

    Attributes:
        E1: Young's modulus along axis 1 [Pa].
        E2: Young's modulus along axis 2 [Pa].
        E3: Young's modulus along axis 3 [Pa].
        G12: shear modulus in the plane of the layer [Pa].
        G13: shear modulus of axes 1 and 3 [Pa].
        G23: shear modulus of axes 2 and 3 [Pa].
        nu12: Poisson's ratio: contraction along 2 under a stress along 1 [-].
        nu13: contraction along 3 under a stress along 1 [-].
        nu23: contraction along 3 under a stress along 2 [-].
    """

    E1: Annotated[Positive, Unit("Pa")]
    E2: Annotated[Positive, Unit("Pa")]
    E3: Annotated[Positive, Unit("Pa")]
    G12: Annotated[Positive, Unit("Pa")]
    G13: Annotated[Positive, Unit("Pa")]
    G23: Annotated[Positive, Unit("Pa")]
    nu12: Annotated[Finite, Unit("1")]
    nu13: Annotated[Finite, Unit("1")]
    nu23: Annotated[Finite, Unit("1")]

    @model_validator(mode="after")
    def _positive_energy(self) -> Self:
        """Check that any strain has a positive energy (Jones, section 2.4)."""
        for ratio, first, second in (("nu12", "E1", "E2"), ("nu13", "E1", "E3"),
                                     ("nu23", "E2", "E3")):  # fmt: skip
            value = getattr(self, ratio)
            most = float(np.sqrt(getattr(self, first) / getattr(self, second)))
            if abs(value) >= most:
                raise inconsistent(
                    ratio,
                    f"expected a size below sqrt({first}/{second}) = {most:.4g}, because any "
                    f"strain must have a positive energy, given {value:g}",
                )
        if not elasticity.is_admissible(self.compliance):
            names = ("nu12", "nu13", "nu23")
            ratios = ", ".join(f"{key} = {getattr(self, key):g}" for key in names)
            raise inconsistent(
                "nu12",
                "expected Poisson's ratios that together give any strain a positive energy, given "
                f"{ratios} with E1 = {self.E1:g}, E2 = {self.E2:g}, E3 = {self.E3:g} Pa",
            )
        return self

    @property
    def compliance(self) -> FloatArray:
        """Compliance with axis 1 along x, see `elasticity.compliance`, shape (6, 6) [1/Pa]."""
        return elasticity.compliance(
            (self.E1, self.E2, self.E3),
            (self.G12, self.G13, self.G23),
            (self.nu12, self.nu13, self.nu23),
        )

    def at(self, angle: float) -> FloatArray:
        """Return the compliance in x, y, z with axis 1 at an angle from x to z [deg], (6, 6)."""
        return elasticity.turned(self.compliance, angle)


ORTHOTROPIC: Mapping[str, tuple[Orthotropic, float]] = MappingProxyType(
    {
        "cfrp-ud": (
            Orthotropic(
                E1=181e9, E2=10.3e9, E3=10.3e9, G12=7.17e9, G13=7.17e9, G23=3.68e9, nu12=0.28,
                nu13=0.28, nu23=0.4,
            ),
            1600.0,
        ),
        "gfrp-ud": (
            Orthotropic(
                E1=38.6e9, E2=8.27e9, E3=8.27e9, G12=4.14e9, G13=4.14e9, G23=2.95e9, nu12=0.26,
                nu13=0.26, nu23=0.4,
            ),
            1800.0,
        ),
        "foam": (
            Orthotropic(
                E1=130e6, E2=130e6, E3=130e6, G12=35e6, G13=35e6, G23=35e6, nu12=0.4, nu13=0.4,
                nu23=0.4,
            ),
            100.0,
        ),
        "honeycomb": (
            Orthotropic(
                E1=1e6, E2=1e6, E3=1034e6, G12=0.5e6, G13=483e6, G23=214e6, nu12=0.3, nu13=0.0,
                nu23=0.0,
            ),
            72.0,
        ),
    }
)  # fmt: skip
"""Orthotropic materials by name, each with its density [kg/m3]."""
