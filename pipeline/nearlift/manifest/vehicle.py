"""[vehicle] of the manifest: rotors, their geometry, mass, and rotor speeds at some throttles."""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from nearlift.declare import Boundary, FloatArray
from nearlift.manifest.quantities import (
    Duration,
    Force,
    Fraction,
    Length,
    Mass,
    Position,
    PositiveLength,
    Rotation,
    Section,
)

#: Spacing over radius beyond which one of the two is wrong.
WIDEST = 20.0


class ThrottleMap(Section):
    """Rotor speed at some throttles far from every boundary: pairs of throttle and speed, Hz, and
    the standard uncertainty of each speed.
    """

    points: list[Annotated[tuple[Fraction, Rotation], Field(strict=False)]] = Field(min_length=1)
    uncertainty: Fraction = 0.0

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        throttle = [t for t, _ in self.points]
        if any(b <= a for a, b in itertools.pairwise(throttle)):
            raise ValueError(
                "the throttles of points must ascend (found"
                f" {', '.join(f'{100 * t:g} %' for t in throttle)})"
            )
        return self

    def speed_Hz(self, throttle: FloatArray) -> FloatArray:
        """Speed at each throttle, linear between points; nan outside of them, since a map says
        nothing there.
        """
        known = np.array(self.points)
        return np.asarray(
            np.interp(throttle, known[:, 0], known[:, 1], left=np.nan, right=np.nan),
            dtype=np.float64,
        )


class Vehicle(Section):
    """What hangs from the load cell. Lengths in m, mass in kg.

    `contact` is the distance to each boundary, measured from the datum, at which the vehicle first
    touches; `motor_lag` (s) and `thrust_limit` (N, all rotors, far from every boundary; the largest
    lift measured there if not given) are those of its flights.
    """

    name: str
    rotors: int = Field(ge=1, le=100)
    rotor_radius: PositiveLength
    rotor_spacing: PositiveLength | None = None
    rotor_diagonal: PositiveLength | None = None
    rotor_positions: list[Position] | None = None
    mass: Mass
    contact: dict[Boundary, Length] = Field(default={})
    motor_lag: Duration = 0.0
    thrust_limit: Force | None = None
    throttle_map: ThrottleMap | None = None

    @model_validator(mode="after")
    def _rotors_do_not_overlap(self) -> Self:
        if self.rotor_spacing is not None and self.rotor_spacing < 2 * self.rotor_radius:
            raise ValueError(
                f"rotor_spacing {self.rotor_spacing:g} m is less than two radii: neighbouring"
                " rotors would overlap"
            )
        if self.rotor_spacing is not None and self.rotor_spacing > WIDEST * self.rotor_radius:
            raise ValueError(
                f"rotor_spacing {self.rotor_spacing:g} m is"
                f" {self.rotor_spacing / self.rotor_radius:.3g} radii of {self.rotor_radius:g} m;"
                " no vehicle is so wide: mend one of them, or its unit"
            )
        if (
            self.rotor_diagonal is not None
            and self.rotor_spacing is not None
            and self.rotor_diagonal < self.rotor_spacing
        ):
            raise ValueError(
                f"rotor_diagonal {self.rotor_diagonal:g} m is less than rotor_spacing"
                f" {self.rotor_spacing:g} m; the spacing is that of ADJACENT rotors"
            )
        if self.rotor_positions is not None and len(self.rotor_positions) != self.rotors:
            raise ValueError(
                f"rotor_positions lists {len(self.rotor_positions)} rotors, not {self.rotors}"
            )
        return self

    @property
    def diagonal(self) -> float | None:
        """Distance between opposite rotor axes, m: as given, else that of a regular polygon,
        sqrt(2) times the spacing for four rotors.
        """
        if self.rotor_diagonal is not None or self.rotor_spacing is None or self.rotors == 1:
            return self.rotor_diagonal
        return self.rotor_spacing / math.sin(math.pi / self.rotors)

    def geometry(self) -> dict[str, object]:
        """What lift models may need, scaled by rotor radius: `spacing_hat`, `diagonal_hat`,
        `layout_hat` (rotors, 2).
        """
        known: dict[str, Any] = {}
        r = self.rotor_radius
        if self.rotor_spacing is not None and self.rotors > 1:
            known["spacing_hat"] = self.rotor_spacing / r
        if self.diagonal is not None and self.rotors > 1:
            known["diagonal_hat"] = self.diagonal / r
        if self.rotor_positions is not None:
            known["layout_hat"] = np.asarray(self.rotor_positions) / r
        elif self.rotors == 1:
            known["layout_hat"] = np.zeros((1, 2))
        elif self.rotor_spacing is not None:
            # a regular polygon whose side is the adjacent spacing
            angles = 2 * math.pi * (np.arange(self.rotors) + 0.5) / self.rotors
            circumradius = known["spacing_hat"] / (2 * math.sin(math.pi / self.rotors))
            known["layout_hat"] = circumradius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return known
