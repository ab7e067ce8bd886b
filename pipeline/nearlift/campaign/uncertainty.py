"""[[uncertainty]] of the manifest: one component of the budget, a shared unknown per element of its
scope.
"""

from __future__ import annotations

import math
from typing import Literal, Self

from pydantic import model_validator

from nearlift import units
from nearlift.campaign.quantities import Section
from nearlift.errors import ManifestError

#: Inputs of a lift model that have a unit, and what each kind of component is a size of.
INPUTS_WITH_UNIT = {
    "rotor_radius": "length",
    "rotor_spacing": "length",
    "mass": "mass",
    "air_density": "density",
}

DIMENSIONS = {
    "height": "length",
    "force": "force",
    "gain": "fraction",
    "exponent": "fraction",
    **INPUTS_WITH_UNIT,
}


class Uncertainty(Section):
    """One component of the budget, as written."""

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
        try:
            self.standard()
        except ManifestError as refusal:
            raise ValueError(f"{refusal.what}\n{refusal.remedy}") from None
        return self

    @property
    def relative(self) -> bool:
        """Whether the value is a part of the input, such as ``"1 percent"`` of the rotor radius."""
        return self.on in INPUTS_WITH_UNIT and self.value.strip().endswith(
            ("percent", "%", "fraction")
        )

    def standard(self) -> float:
        """Standard uncertainty in SI: m on height and lengths, N on force, a fraction on gain and
        exponent; a fraction if `relative`.
        """
        dimension = "fraction" if self.relative else DIMENSIONS[self.on]
        value = units.quantity(self.value, dimension, f"uncertainty {self.name!r}: value")
        if value < 0:
            raise ManifestError(
                f"uncertainty {self.name!r}: value",
                f"{self.value!r} is negative",
                "an uncertainty is a size, not a correction",
            )
        if value >= 1 and (self.relative or self.on in ("gain", "exponent")):
            raise ManifestError(
                f"uncertainty {self.name!r}: value",
                f"{self.value!r} is as large as what it is of",
                'percent? one per cent is "1 percent"',
            )
        return value / math.sqrt(3) if self.distribution == "uniform" else value
