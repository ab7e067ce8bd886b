"""Mean, variance and count of a stream of fields, and its correlation in time.

One pass: one field is in memory, never the set. Correlation in time is measured on a sample of
nodes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.flow.field import VelocityField, same_grid

#: Nodes on which correlation in time is measured, and the longest lag in fields.
SAMPLE, LAGS = 256, 32
#: Least number of fields, and of lags, that show a correlation in time.
FEWEST_FIELDS, FEWEST_LAGS = 8, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Average:
    """The mean of `n` fields, nan where no field has a vector.

    `variance` (2, ny, nx) is that of one field's vx and vy in (m/s)^2, nan where fewer than two
    fields have a vector. `count` (ny, nx) is the number of fields with a vector there. `tau` is the
    number of fields per independent one, 1 if they are independent.
    """

    mean: VelocityField
    variance: FloatArray
    count: FloatArray
    n: int
    tau: float

    @property
    def u_m_s(self) -> FloatArray:
        """Standard errors of the mean vx and vy, correlation in time included, (2, ny, nx)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            error = np.sqrt(self.variance * self.tau / self.count)
        return np.where(self.mean.valid, error, np.nan)


def correlation_time(rows: FloatArray) -> float:
    """Observations per independent one of rows (n, columns) in their order, by the autocovariance
    pooled over columns; nan is left out.
    """
    known = np.isfinite(rows)
    x = np.where(known, rows, 0.0)
    x = np.where(known, x - x.sum(axis=0) / np.maximum(known.sum(axis=0), 1), 0.0)
    pooled = []
    for lag in range(min(LAGS, len(rows) - 1) + 1):
        early, late = slice(0, len(rows) - lag), slice(lag, None)
        both = known[early] & known[late]
        pairs = both.sum(axis=0)
        seen = pairs > 0
        if not seen.any():
            break
        head, tail, product = (
            np.einsum("ij,ij->j", a, b)[seen] / pairs[seen]
            for a, b in ((x[early], both), (x[late], both), (x[early], x[late]))
        )
        pooled.append(float((product - head * tail).sum()))
    return integrated(np.array(pooled), float(known.sum(axis=0).max(initial=0)))


def integrated(autocovariance: FloatArray, n: float) -> float:
    """Autocorrelation time: 1 + 2 sum of autocorrelations; at least 1.

    They are summed in pairs of lags as long as they are positive (Geyer 1992).

    Subtracting the mean of `n` observations lowers every autocovariance by var(mean) = var tau / n.
    That is corrected to first order.
    """
    if len(autocovariance) < FEWEST_LAGS or not autocovariance[0] > 0 or n < FEWEST_FIELDS:
        return 1.0
    rho = autocovariance[: max(int(n) // 3, FEWEST_LAGS)] / autocovariance[0]
    tau = 1.0
    for _ in range(3):
        lifted = (rho + tau / n) / (1 + tau / n)
        total = 1.0
        for k in range(1, len(rho) - 1, 2):
            pair = lifted[k] + lifted[k + 1]
            if pair <= 0:
                break
            total += 2 * pair
        tau = max(total, 1.0)
    return float(min(tau, n / 2))


def average(fields: Iterable[VelocityField], where: str = "fields") -> Average:
    """The mean of fields on one grid, in the order in which they were taken.

    Raises
    ------
    InputRefused
        No field, or one on another grid than the first.
    """
    stream = iter(fields)
    first = next(stream, None)
    if first is None:
        raise InputRefused(where, "holds no field", "check the pattern of files")
    size, shape = first.vx_m_s.size, first.shape
    # sums are about each column's first observation, so that they lose no digits
    count, origin, total, squares = np.zeros((4, 2 * size))
    sample = np.unique(np.linspace(0, 2 * size - 1, min(SAMPLE, 2 * size)).astype(np.int64))
    sampled: list[FloatArray] = []
    for n, field in enumerate(chain([first], stream), 1):
        if not same_grid(first, field):
            what = f"field {n} has another grid than the first"
            raise InputRefused(where, what, "one case has one grid; list others as another case")
        # a vector that lacks one component is none
        vectors = np.where(field.valid, [field.vx_m_s, field.vy_m_s], np.nan).ravel()
        known = np.isfinite(vectors)
        origin = np.where(known & (count == 0), vectors, origin)
        away = np.where(known, vectors - origin, 0.0)
        total, squares, count = total + away, squares + away**2, count + known
        sampled.append(vectors[sample])
    with np.errstate(invalid="ignore", divide="ignore"):
        vx, vy = (origin + total / count).reshape(2, *shape)
        variance = np.maximum((squares - total**2 / count) / (count - 1), 0.0)
    return Average(
        mean=VelocityField(x_m=first.x_m, y_m=first.y_m, vx_m_s=vx, vy_m_s=vy),
        variance=np.where(count > 1, variance, np.nan).reshape(2, *shape),
        count=count[:size].reshape(shape),
        n=len(sampled),
        tau=correlation_time(np.stack(sampled)),
    )
