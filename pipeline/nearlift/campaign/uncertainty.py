"""[[uncertainty]] of the manifest: one component of the budget."""

from __future__ import annotations

import math
from typing import Literal, Self

from pydantic import model_validator

from nearlift import units
from nearlift.campaign.quantities import Section, as_fault
from nearlift.errors import ManifestError

#: Inputs of a lift model with a unit, and their dimensions.
INPUTS_WITH_UNIT = {
    "rotor_radius": "length",
    "rotor_spacing": "length",
    "mass": "mass",
    "air_density": "density",
}
DIMENSIONS = {"height": "length", "force": "force", "gain": "fraction", "exponent": "fraction"}


class Uncertainty(Section):
    """A component of the budget: one shared unknown per element of its scope."""

    name: str
    on: Literal[
        "height",
        "force",
        "gain",
        "rotor_radius",
        "rotor_spacing",
        "exponent",
        "mass",
        "air_density",
    ]
    value: str
    distribution: Literal["normal", "uniform"] = "normal"
    scope: Literal["sample", "trial", "distance", "throttle", "session", "boundary", "campaign"]

    @model_validator(mode="after")
    def _value_has_the_dimension(self) -> Self:
        with as_fault():
            self.standard()
        return self

    @property
    def relative(self) -> bool:
        """Whether the value is a fraction of the input, such as `"1 percent"` of rotor radius."""
        return self.on in INPUTS_WITH_UNIT and self.value.strip().endswith(
            ("percent", "%", "fraction")
        )

    def standard(self) -> float:
        """Standard uncertainty in SI: m on height and lengths, N on force, a fraction on gain and
        exponent; a fraction if `relative`.
        """
        place = f"uncertainty {self.name!r}: value"
        dimension = "fraction" if self.relative else (DIMENSIONS | INPUTS_WITH_UNIT)[self.on]
        value = units.quantity(self.value, dimension, place)
        if value < 0:
            raise ManifestError(
                place, f"{self.value!r} is negative", "an uncertainty is a size, not a correction"
            )
        if value >= 1 and dimension == "fraction":
            raise ManifestError(
                place,
                f"{self.value!r} is as large as what it is of",
                'percent? one per cent is "1 percent"',
            )
        return value / math.sqrt(3) if self.distribution == "uniform" else value
