"""Table of L / L_inf over distance with its uncertainty, the content of every export.

Nodes are equally spaced in w = 1 / (1 + z_hat). It maps any distance to a number between 0 and 1
with one division. Lift, steep near a boundary and flat far from it, varies evenly in w. The ratio
is a cubic Hermite polynomial between nodes, its uncertainty is linear.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nearlift import derivative
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.flight import Ratio
from nearlift.results.document import Numbers

#: Largest relative error of the ratio, under three units in the last place of single precision.
RATIO_ERROR = 1.5e-7
#: Largest error of an uncertainty, relative to itself, and to the largest in the table.
UNCERTAINTY_ERROR, UNCERTAINTY_ERROR_OF_LARGEST = 0.05, 0.01
FEWEST_PIECES, MOST_PIECES = 16, 2048
#: Size of w in `derivative.central`: at an end of the table, where differences are one-sided, the
#: slope of a ratio that falls as 1 / z_hat^3 is then known to 1e-6.
SIZE = 1e-3
#: L / L_inf - 1 whose slope by these differences is rounding.
NO_LIFT = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class LiftTable:
    """L / L_inf at nodes from `high`, the farthest valid z_hat, to `low`, the nearest.

    Attributes
    ----------
    w_low, per_w : float
        w of the first node, and number of pieces per unit of w.
    power : float
        Farther than `high`, L / L_inf - 1 falls as 1 / (1 + power s + s^2), s = z_hat / high - 1.
        At least -1, and smooth at `high`.
    relative_error : float
        Largest relative error of the ratio between nodes.
    ratio, slope : array (nodes,)
        L / L_inf, and its derivative by the number of pieces.
    u_ratio : array (nodes,)
        Standard uncertainty of L / L_inf.
    """

    low: float
    high: float
    w_low: float
    per_w: float
    power: float
    relative_error: float = 0.0
    ratio: Numbers
    slope: Numbers
    u_ratio: Numbers

    @property
    def pieces(self) -> int:
        """Number of pieces."""
        return len(self.ratio) - 1

    def __call__(self, z_hat: FloatArray) -> FloatArray:
        """L / L_inf by the table; z_hat is clamped to its range."""
        z = np.clip(np.asarray(z_hat, dtype=float), self.low, self.high)
        x = np.clip((1 / (1 + z) - self.w_low) * self.per_w, 0, self.pieces)
        i = np.minimum(x.astype(int), self.pieces - 1)
        t = x - i
        a, p, q = self.ratio[i], self.slope[i], self.slope[i + 1]
        d = self.ratio[i + 1] - a
        result: FloatArray = a + t * (p + t * ((3 * d - 2 * p - q) + t * (p + q - 2 * d)))
        return result


def lift_table(ratio: Ratio, drawn: Ratio, low: float, high: float) -> LiftTable:
    """Coarsest table, of 16, 32, ... pieces, within the errors above.

    `drawn` gives L / L_inf of every draw, shape (draws, n); draws that are not finite everywhere
    are left out.

    Raises
    ------
    InputRefused
        The model has no finite value somewhere in the range, or MOST_PIECES are too few.
    """
    first, last = 1 / (1 + high), 1 / (1 + low)

    def at(w: FloatArray, lift: Ratio = ratio) -> FloatArray:
        with np.errstate(invalid="ignore", divide="ignore"):
            return lift(1 / w - 1)

    def slopes(w: FloatArray) -> FloatArray:
        """Derivatives by w (n,)."""
        change, apart = derivative.central(at, w[:, None], SIZE, first, last)
        return np.asarray(change[:, 0, 0] / apart[:, 0])

    def spread(w: FloatArray) -> FloatArray:
        value = at(w, drawn)
        return np.asarray(value[np.isfinite(value).all(axis=1)].std(axis=0))

    probe = np.linspace(first, last, 8 * MOST_PIECES + 1)
    truth = at(probe)
    if not np.isfinite(truth).all():
        bad = f"{1 / probe[~np.isfinite(truth)].min() - 1:.3g}"
        what = f"the model has no value at z_hat = {bad}"
        raise InputRefused("export", what, f"it can be exported above {bad} only")
    pieces = FEWEST_PIECES
    while pieces <= MOST_PIECES:
        w, width = np.linspace(first, last, 2 * pieces + 1), (last - first) / pieces
        spreads = spread(w)
        nodes, middle = spreads[::2], spreads[1::2]
        missed = np.abs(middle - (nodes[1:] + nodes[:-1]) / 2)
        largest = UNCERTAINTY_ERROR_OF_LARGEST * spreads.max()
        allowed = np.maximum(UNCERTAINTY_ERROR * middle, largest)
        value, slope = at(w[::2]), slopes(w[::2]) * width
        table = LiftTable(
            low=low,
            high=high,
            w_low=first,
            per_w=1 / width,
            power=_power(float(value[0]) - 1, float(slope[0]) / width, high),
            ratio=value,
            slope=slope,
            u_ratio=nodes,
        )
        error = float(np.max(np.abs(table(1 / probe - 1) / truth - 1)))
        if error <= RATIO_ERROR and ((missed <= allowed).all() or pieces == MOST_PIECES):
            return replace(table, relative_error=error)
        pieces *= 2
    raise InputRefused(
        "export",
        f"the model is too steep near z_hat = {low:.3g}: {MOST_PIECES} pieces leave {error:.1g}",
        "begin the range farther away",
    )


def _power(above: float, slope: float, high: float) -> float:
    """Power of z_hat with which L / L_inf - 1, `above`, falls at `high`; `slope` is by w. It is 1
    where `above` is rounding.
    """
    if abs(above) < NO_LIFT:
        return 1.0
    return max(high * slope / (1 + high) ** 2 / above, -1.0)
