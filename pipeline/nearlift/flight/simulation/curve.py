"""Tables of L / L_inf, equally spaced and constant below a bound, for the compiled loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.flight import Ratio

#: Height above which every table is constant; lift there is within 0.5 % of L_inf for the declared
#: models at their declared parameters.
TOP = 16.0
#: Nodes of every table.
NODES = 2049


@dataclass(frozen=True, slots=True, kw_only=True)
class Curves:
    """Tables (m, NODES) of L / L_inf over a common range of z_hat, from `low` to `TOP`; beyond both
    the ratio is constant, so that `low` is the bound that the paper puts at 0.5.
    """

    low: float
    values: FloatArray

    @property
    def z_hat(self) -> FloatArray:
        """Heights of the nodes."""
        return np.linspace(self.low, TOP, NODES)

    @property
    def per_radius(self) -> float:
        """Table steps per rotor radius."""
        return (NODES - 1) / (TOP - self.low)

    def packed(self) -> FloatArray:
        """Value at and change over each step, tables one behind the other, for the kernel."""
        slope = np.zeros_like(self.values)
        slope[:, :-1] = np.diff(self.values, axis=1)
        return np.ascontiguousarray(np.stack([self.values, slope], axis=-1).reshape(-1))

    def at(self, z_hat: FloatArray) -> FloatArray:
        """Every table at heights (n,): shape (m, n)."""
        return np.stack([np.interp(z_hat, self.z_hat, row) for row in self.values])


def tabulate(ratios: Sequence[Ratio], low: float) -> Curves:
    """Tables of several functions of z_hat, each constant below `low`.

    Raises
    ------
    InputRefused
        A ratio has no positive value somewhere in the range (a singularity, or a bound below the
        model's validity), or the range is empty.
    """
    if not low < TOP:
        raise InputRefused(
            "simulate.bound_z_hat",
            f"{low:g} leaves no range: above z_hat = {TOP:g} lift is constant",
            f"bound the ratio below {TOP:g}",
        )
    z_hat = np.linspace(low, TOP, NODES)
    with np.errstate(invalid="ignore", divide="ignore"):
        values = np.stack([ratio(z_hat) for ratio in ratios])
    bad = ~(np.isfinite(values) & (values > 0))
    if bad.any():
        where = float(z_hat[bad.any(axis=0)].max())
        raise InputRefused(
            "simulate.bound_z_hat",
            f"L / L_inf has no value at z_hat = {where:.3g}",
            f"bound the ratio above {where:.3g}",
        )
    return Curves(low=low, values=values)
