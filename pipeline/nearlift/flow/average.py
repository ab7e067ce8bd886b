"""Mean, variance and count of a stream of fields, its correlation in time, and how far the mean has
converged.

One pass: a batch of fields is in memory, never the set. Batches are merged by Chan's formula, of
which Welford's update is the case of one. Correlation in time is measured on a sample of nodes with
a ring of the latest fields.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.flow.field import VelocityField, same_grid

#: Fields merged at a time.
BATCH = 16
#: Nodes on which correlation in time is measured, and the longest lag in fields.
SAMPLE, LAGS = 256, 32
#: What the paper asks of its mean fields.
WANTED = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanConvergence:
    """Change of the mean as fields are added, at doubling numbers `n` of fields (k,).

    The last number is all of them. `moved` (k,) is the change since half as many, nan for the
    first.

    Changes and the mean's standard error are root mean squares over the mean's own; a thousandth is
    what the paper states of its 150 pairs.
    """

    n: NDArray[np.int64]
    moved: FloatArray
    relative_standard_error: float
    fields_for_a_thousandth: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Average:
    """The mean of `n` fields, nan where no field has a vector.

    `u_m_s` is the correlating software's own uncertainty of a mean vector, where it gave one.

    `var_x` and `var_y` (ny, nx) are variances of one field's component in (m/s)^2, nan where fewer
    than two fields have a vector. `count` (ny, nx) is the number of fields with a vector there.
    `tau` is the number of fields per independent one, 1 if they are independent.
    """

    mean: VelocityField
    var_x: FloatArray
    var_y: FloatArray
    count: FloatArray
    n: int
    tau: float
    convergence: MeanConvergence

    @property
    def u_x(self) -> FloatArray:
        """Standard error of the mean vx, correlation in time included, (ny, nx)."""
        return self._error(self.var_x)

    @property
    def u_y(self) -> FloatArray:
        """Standard error of the mean vy, correlation in time included, (ny, nx)."""
        return self._error(self.var_y)

    def _error(self, variance: FloatArray) -> FloatArray:
        with np.errstate(invalid="ignore", divide="ignore"):
            error = np.sqrt(variance * self.tau / self.count)
        if self.mean.u_m_s is not None:
            error = np.where(np.isfinite(error), error, self.mean.u_m_s)
        return np.where(self.mean.valid, error, np.nan)


class Moments:
    """Count, mean and sum of squares of columns, batch by batch; nan is no observation."""

    def __init__(self, columns: int) -> None:
        self.count = np.zeros(columns)
        self.mean = np.zeros(columns)
        self.squares = np.zeros(columns)

    def add(self, batch: FloatArray) -> None:
        """Merge rows (k, columns)."""
        # about the present mean, or about the first rows: sums of squares then lose no digits
        shift = self.mean
        if self.count.min() == 0:
            shift = np.where(self.count > 0, self.mean, _first(batch))
        away = batch - shift
        known = np.isfinite(away)
        n = known.sum(axis=0)
        away[~known] = 0.0
        total, squares = away.sum(axis=0), np.einsum("ij,ij->j", away, away)
        batch_mean = total / np.maximum(n, 1)
        apart = batch_mean + shift - self.mean
        whole = np.maximum(self.count + n, 1)
        self.squares += np.where(
            n > 0, squares - batch_mean * total + apart**2 * self.count * n / whole, 0.0
        )
        self.mean += np.where(n > 0, apart * n / whole, 0.0)
        self.count += n

    def variance(self) -> FloatArray:
        """Unbiased, nan for fewer than two observations."""
        with np.errstate(invalid="ignore", divide="ignore"):
            result: FloatArray = np.where(
                self.count > 1, np.maximum(self.squares, 0) / (self.count - 1), np.nan
            )
        return result

    def known_mean(self) -> FloatArray:
        """The mean, nan where nothing was observed."""
        return np.where(self.count > 0, self.mean, np.nan)


def _first(batch: FloatArray) -> FloatArray:
    row = batch[np.argmax(np.isfinite(batch), axis=0), np.arange(batch.shape[1])]
    return np.where(np.isfinite(row), row, 0.0)


class Lags:
    """Autocovariance of some columns at lags up to `LAGS`, from the latest rows and each new batch
    of them.
    """

    def __init__(self, columns: int) -> None:
        self.latest = np.full((LAGS, columns), np.nan)
        self.shift: FloatArray | None = None
        self.products = np.zeros((LAGS + 1, columns))
        self.heads = np.zeros((LAGS + 1, columns))
        self.tails = np.zeros((LAGS + 1, columns))
        self.pairs = np.zeros((LAGS + 1, columns))

    def add(self, rows: FloatArray) -> None:
        """The next rows (k, columns) in time."""
        if self.shift is None:
            self.shift = _first(rows)
        all_rows = np.concatenate([self.latest, rows - self.shift])
        known = np.isfinite(all_rows)
        filled = np.where(known, all_rows, 0.0)
        late, late_known = filled[LAGS:], known[LAGS:]
        for lag in range(LAGS + 1):
            then = slice(LAGS - lag, len(filled) - lag)
            early, both = filled[then], known[then] & late_known
            self.products[lag] += np.einsum("ij,ij->j", late, early)
            self.heads[lag] += np.einsum("ij,ij->j", both, early)
            self.tails[lag] += np.einsum("ij,ij->j", late, both)
            self.pairs[lag] += both.sum(axis=0)
        self.latest = all_rows[-LAGS:]

    def tau(self) -> float:
        """Fields per independent one: `integrated` of the autocovariance pooled over columns."""
        with np.errstate(invalid="ignore", divide="ignore"):
            head, tail = self.heads / self.pairs, self.tails / self.pairs
            covariance = self.products / self.pairs - head * tail
        pooled = np.array(
            [c[np.isfinite(c)].sum() if np.isfinite(c).any() else math.nan for c in covariance]
        )
        n = float(self.pairs[0].max(initial=0.0))
        return integrated(pooled[np.isfinite(pooled)], n)


def integrated(autocovariance: FloatArray, n: float) -> float:
    """Autocorrelation time: 1 + 2 sum of autocorrelations; at least 1.

    They are summed in pairs of lags as long as they are positive (Geyer 1992).

    Subtracting the mean of `n` observations lowers every autocovariance by var(mean) = var tau / n.
    That is corrected to first order.
    """
    if len(autocovariance) < 3 or not autocovariance[0] > 0 or n < 8:
        return 1.0
    rho = autocovariance[: max(int(n) // 3, 3)] / autocovariance[0]
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


def series_tau(series: FloatArray) -> float:
    """Observations per independent one of a series (n,); nan is left out."""
    lags = Lags(1)
    lags.add(series[:, None])
    return lags.tau()


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
    size = first.vx_m_s.size
    moments, noise = Moments(2 * size), Moments(size)
    sample = np.unique(np.linspace(0, 2 * size - 1, min(SAMPLE, 2 * size)).astype(np.int64))
    lags = Lags(len(sample))
    n, means = 0, dict[int, FloatArray]()
    for batch in _batches(first, stream, where):
        rows = np.stack([np.append(field.vx_m_s, field.vy_m_s) for field in batch])
        # a vector that lacks one component is none
        lacking = np.isfinite(rows[:, :size]) != np.isfinite(rows[:, size:])
        rows[np.tile(lacking, 2)] = np.nan
        lags.add(rows[:, sample])
        moments.add(rows)
        given = [
            np.where(field.valid, field.u_m_s, np.nan).ravel() ** 2
            for field in batch
            if field.u_m_s is not None
        ]
        if given:
            noise.add(np.stack(given))
        n += len(batch)
        if _doubled(n):
            means[n] = moments.known_mean()
    means[n] = moments.known_mean()
    return _finish(first, moments, noise, means, lags.tau())


def _batches(
    first: VelocityField, others: Iterable[VelocityField], where: str
) -> Iterator[list[VelocityField]]:
    """The fields in their order, on one grid, in batches of at most `BATCH` that end where fields
    have doubled.
    """
    batch: list[VelocityField] = []
    for n, field in enumerate(chain([first], others), 1):
        if not same_grid(first, field):
            raise InputRefused(
                where,
                f"field {n} has another grid than the first",
                "one case has one grid; list others as another case",
            )
        batch.append(field)
        if len(batch) == BATCH or _doubled(n):
            yield batch
            batch = []
    if batch:
        yield batch


def _doubled(n: int) -> bool:
    return n > 1 and n.bit_count() == 1


def _moved(before: FloatArray, now: FloatArray) -> float:
    both = np.isfinite(now) & np.isfinite(before)
    change, level = (
        math.sqrt(float(np.mean(v[both] ** 2))) if both.any() else 0.0 for v in (now - before, now)
    )
    return change / level if level > 0 else math.nan


def _finish(
    first: VelocityField,
    moments: Moments,
    noise: Moments,
    means: dict[int, FloatArray],
    tau: float,
) -> Average:
    shape, size, n = first.shape, first.vx_m_s.size, max(means)
    mean, variance = means[n], moments.variance()
    given = noise.known_mean()
    with np.errstate(invalid="ignore", divide="ignore"):
        u_m_s = (
            np.sqrt(given / noise.count).reshape(shape) if noise.count.max(initial=0) > 0 else None
        )
        error2 = variance * tau / moments.count
    both = np.isfinite(error2)
    level = float(np.mean(mean[both] ** 2)) if both.any() else 0.0
    error = math.sqrt(float(np.mean(error2[both])) / level) if level > 0 else math.nan
    return Average(
        mean=VelocityField(
            x_m=first.x_m,
            y_m=first.y_m,
            vx_m_s=mean[:size].reshape(shape),
            vy_m_s=mean[size:].reshape(shape),
            u_m_s=u_m_s,
        ),
        var_x=variance[:size].reshape(shape),
        var_y=variance[size:].reshape(shape),
        count=moments.count[:size].reshape(shape),
        n=n,
        tau=tau,
        convergence=MeanConvergence(
            n=np.array(list(means), dtype=np.int64),
            moved=np.array([math.nan, *(_moved(*two) for two in pairwise(means.values()))]),
            relative_standard_error=error,
            fields_for_a_thousandth=(
                math.ceil(n * (error / WANTED) ** 2) if math.isfinite(error) else math.nan
            ),
        ),
    )
