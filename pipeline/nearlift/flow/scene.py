"""Positions of rotors and boundary in vehicle axes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """One case's geometry: a ground beneath the wake, a ceiling above the inflow, or neither.

    `distance_m` is from the origin (midway between the rotors) to the boundary along its normal,
    inf without one. The tilt is positive where the +x side is farther from the boundary. `rotors_m`
    are x of the rotor axes in the light sheet.
    """

    boundary: Literal["ground", "ceiling", "none"]
    distance_m: float
    tilt_rad: float
    rotors_m: tuple[float, ...]
    radius_m: float

    def height_m(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        """Distance to the boundary along its normal, positive on the vehicle's side, inf without
        one; shapes broadcast.
        """
        if self.boundary == "none":
            return np.full(np.broadcast_shapes(np.shape(x_m), np.shape(y_m)), np.inf)
        side = 1.0 if self.boundary == "ground" else -1.0
        result: FloatArray = (
            self.distance_m + side * y_m * math.cos(self.tilt_rad) + x_m * math.sin(self.tilt_rad)
        )
        return result

    def boundary_y_m(self, x_m: FloatArray) -> FloatArray:
        """Height of the boundary at `x_m`."""
        side = 1.0 if self.boundary == "ground" else -1.0
        result: FloatArray = (
            -side * (self.distance_m + x_m * math.sin(self.tilt_rad)) / math.cos(self.tilt_rad)
        )
        return result

    def beneath(self, x_m: FloatArray, reach: float = 1.0) -> NDArray[np.bool_]:
        """Whether `x_m` lies within `reach` radii of a rotor axis."""
        return np.asarray(
            np.any([np.abs(x_m - c) <= reach * self.radius_m for c in self.rotors_m], axis=0)
        )
