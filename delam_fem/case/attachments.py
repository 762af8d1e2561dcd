"""Define what is attached to the laminae: point masses and sensors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import model_validator

from delam_fem.case.fields import (
    CountOrNone,
    Label,
    NotNegative,
    Positive,
    Section,
    inconsistent,
)
from delam_fem.case.layers import Neighbours
from delam_fem.case.units import Unit, in_si

Quantity = Literal["displacement", "velocity", "acceleration", "strain", "contact force"]

SENSOR_UNITS: Mapping[str, str] = {
    "displacement": "m",
    "velocity": "m/s",
    "acceleration": "m/s2",
    "strain": "1",
    "contact force": "N",
}
"""Unit of each quantity of a sensor."""


class PointMass(Section):
    """A point mass on a lamina, for example an accelerometer or a magnet at its tip.

    Attributes:
        lamina: name of the lamina.
        mass: m [kg].
        position: x of the mass [m]; the end x = length if it is not given.
    """

    lamina: Label
    mass: Annotated[Positive, Unit("kg")]
    position: Annotated[NotNegative, Unit("m")] | None = None


class Sensor(Section):
    """A sensor, whose signal is the variable `sensor_NAME` of the dataset.

    Attributes:
        name: name of the sensor.
        quantity: "displacement", "velocity", "acceleration" or "strain" at a place of a lamina, or
            "contact force" of an interface.
        lamina: name of the lamina; not of a contact force.
        position: x of the sensor [m]; not of a contact force.
        surface: "top" or "bottom" of the lamina, for a strain; "top" if it is not given.
        between: names of the two neighbouring laminae, for a contact force.
        sampling_rate: samples per second [Hz]; every step of the window if it is not given.
        noise: standard deviation of white noise on the samples, in the sensor's unit.
        seed: number from which the noise is drawn; the same seed gives the same noise.
    """

    name: Label
    quantity: Quantity
    lamina: Label | None = None
    position: Annotated[NotNegative, Unit("m")] | None = None
    surface: Literal["top", "bottom"] | None = None
    between: Neighbours | None = None
    sampling_rate: Annotated[Positive, Unit("Hz")] | None = None
    noise: NotNegative | None = None
    seed: CountOrNone = 0

    @model_validator(mode="before")
    @classmethod
    def _noise_in_si(cls, data: object) -> object:
        """Convert a noise that carries a unit to the unit of the sensor."""
        if not isinstance(data, Mapping) or "noise" not in data:
            return data
        unit = SENSOR_UNITS.get(str(data.get("quantity")), "1")
        return {**data, "noise": in_si(data["noise"], unit, "noise")}

    @model_validator(mode="after")
    def _fitting_keys(self) -> Self:
        """Check that the keys are those of the quantity."""
        is_force = self.quantity == "contact force"
        for key in ("lamina", "position"):
            if (getattr(self, key) is None) != is_force:
                words = "none" if is_force else "missing, but required"
                raise inconsistent(key, f'{words} with quantity = "{self.quantity}"')
        if (self.between is None) == is_force:
            words = "missing, but required" if is_force else "expected none"
            raise inconsistent("between", f'{words} with quantity = "{self.quantity}"')
        if self.surface is not None and self.quantity != "strain":
            raise inconsistent("surface", 'expected only with quantity = "strain"')
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
        place = f"of {self.lamina} at {self.position:g} m"
        if self.quantity == "strain":
            return f"strain at the {self.surface or 'top'} {place}"
        return f"{self.quantity} {place}"
