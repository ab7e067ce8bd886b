"""Cubic Hermite table of L / L_inf on nodes equally spaced in w = 1 / (1 + z_hat).

w maps any gap to a number between 0 and 1 with one division. Lift, steep near a boundary and flat
far from it, varies evenly in w. A piece has value and slope at either end, so the table is
continuously differentiable; it is refined to single precision.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.flight import Ratio
from nearlift.results.document import Numbers, Unwritten

#: Largest relative error, under three units in a float's last place; largest number of pieces.
ERROR, MOST = 1.5e-7, 2048
#: Step in w of the finite differences that give slopes.
STEP = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class HermiteTable:
    """Values and slopes (per piece) of L / L_inf at `pieces + 1` nodes from `w_low` on, `per_w`
    pieces per unit of w; valid for low <= z_hat <= high. `relative_error` is the largest.
    """

    low: Unwritten[float]
    high: Unwritten[float]
    w_low: float
    per_w: float
    value: Numbers
    slope: Numbers
    relative_error: float

    @property
    def pieces(self) -> int:
        """Number of pieces."""
        return len(self.value) - 1

    @property
    def power(self) -> float:
        """Power of z_hat with which L / L_inf - 1 falls at `high`, at least -1.

        Farther, it falls as 1 / (1 + power s + s^2) with s = z_hat / high - 1. This is smooth
        from `high` on, without a change of sign. In the end it falls as the inverse square of
        distance.
        """
        above = float(self.value[0]) - 1.0
        fall = self.high * float(self.slope[0]) * self.per_w * self.w_low**2
        return max(fall / above, -1.0) if above else 0.0

    def __call__(self, z_hat: FloatArray) -> FloatArray:
        """L / L_inf by the table; z_hat is clamped to its range."""
        z = np.clip(np.asarray(z_hat, dtype=float), self.low, self.high)
        x = np.clip((1 / (1 + z) - self.w_low) * self.per_w, 0, self.pieces)
        i = np.minimum(x.astype(int), self.pieces - 1)
        t = x - i
        a, b, p, q = self.value[i], self.value[i + 1], self.slope[i], self.slope[i + 1]
        d = b - a
        result: FloatArray = a + t * (p + t * ((3 * d - 2 * p - q) + t * (p + q - 2 * d)))
        return result


def hermite_table(ratio: Ratio, low: float, high: float) -> HermiteTable:
    """Coarsest table, of 16, 32, ... pieces, with a relative error of at most ERROR.

    Raises
    ------
    InputRefused
        The model has no finite value somewhere in the range, or MOST pieces are too few.
    """
    w_low, w_high = 1 / (1 + high), 1 / (1 + low)

    def at(w: FloatArray) -> FloatArray:
        with np.errstate(invalid="ignore", divide="ignore"):
            return ratio(1 / w - 1)

    probe = np.linspace(w_low, w_high, 8 * MOST + 1)
    truth = at(probe)
    if not np.isfinite(truth).all():
        bad = 1 / probe[~np.isfinite(truth)].min() - 1
        raise InputRefused(
            "export",
            f"the model has no value at z_hat = {bad:.3g}",
            f"it can be exported above {bad:.3g} only",
        )
    pieces = 16
    while pieces <= MOST:
        w = np.linspace(w_low, w_high, pieces + 1)
        # one-sided at the ends, beyond which the model may have no value
        up, down = np.minimum(w + STEP, w_high), np.maximum(w - STEP, w_low)
        slope = (at(up) - at(down)) / (up - down) * (w_high - w_low) / pieces
        for end, step in ((0, STEP), (-1, -STEP)):
            first, second, third = at(w[end] + step * np.arange(3.0))
            rise = (-3 * first + 4 * second - third) / (2 * step)
            slope[end] = rise * (w_high - w_low) / pieces
        table = HermiteTable(
            low=low,
            high=high,
            w_low=w_low,
            per_w=pieces / (w_high - w_low),
            value=at(w),
            slope=slope,
            relative_error=0.0,
        )
        error = float(np.max(np.abs(table(1 / probe - 1) / truth - 1)))
        if error <= ERROR:
            return replace(table, relative_error=error)
        pieces *= 2
    raise InputRefused(
        "export",
        f"the model is too steep near z_hat = {low:.3g}: {MOST} pieces leave {error:.1g}",
        "begin the range farther away",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertaintyTable:
    """Standard uncertainty of L / L_inf and of its slope in z_hat, linear between nodes.

    Nodes are equally spaced in w from a `HermiteTable`'s `w_low` on, `per_w` pieces per unit.
    """

    per_w: float
    ratio: Numbers
    slope: Numbers


def uncertainty_table(drawn: Ratio, low: float, high: float) -> UncertaintyTable:
    """Standard deviations of L / L_inf and its slope over the draws, the rows of `drawn`.

    Draws that are not finite everywhere are left out.

    The number of pieces doubles, up to MOST, until midpoints are interpolated within 5 % of their
    value or 1 % of the largest.
    """
    w_low, w_high = 1 / (1 + high), 1 / (1 + low)

    def spread(w: FloatArray) -> FloatArray:
        up, down = np.minimum(w + STEP, w_high), np.maximum(w - STEP, w_low)
        at = np.concatenate([w, up, down])
        with np.errstate(invalid="ignore", divide="ignore"):
            draws = drawn(1 / at - 1)
        value, above, below = np.split(draws[np.isfinite(draws).all(axis=1)], 3, axis=1)
        slope = (above - below) / (up - down) * -(w**2)
        return np.stack([value.std(axis=0), slope.std(axis=0)])

    pieces = 8
    while True:
        spreads = spread(np.linspace(w_low, w_high, 2 * pieces + 1))
        nodes, middle = spreads[:, ::2], spreads[:, 1::2]
        apart = np.abs(middle - (nodes[:, 1:] + nodes[:, :-1]) / 2)
        allowed = np.maximum(0.05 * middle, 0.01 * spreads.max(axis=1, keepdims=True))
        if (apart <= allowed).all() or pieces >= MOST:
            return UncertaintyTable(per_w=pieces / (w_high - w_low), ratio=nodes[0], slope=nodes[1])
        pieces *= 2
