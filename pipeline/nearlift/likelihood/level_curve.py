"""Curve of L_inf where throttles do not repeat: its range, the throttles that it shows, and its
degree, judged by visits left out.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.likelihood.covariance import visits_by_size
from nearlift.results import Observations
from nearlift.results.observations import LevelCurve

#: Highest degree of the curve, also for a manifest. Ours: thrust is nearly quadratic in throttle.
MOST_DEGREE = 4
#: Most throttles that are shown one by one; of more, so many medians of equal shares of trials.
#: Ours: a legend holds no more.
MOST_SHOWN, SHOWN = 12, 5
#: Least relative range of a variable of the curve. Ours: below it, scatter would fix the slope.
LEAST_RANGE = 0.005
#: Number of cosines of nearness for a smooth curve of distance, and of parts of a campaign where
#: visits are too few to be left out. Ours: the curve has two bends.
SHAPES, PARTS = 4, 10


def with_curve(data: Observations, of: Sequence[str], degree: int | None) -> Observations:
    """The trials with L_inf as a curve of `of` (columns in SI); its degree is judged where None.

    Raises
    ------
    InputRefused
        A column is missing, has a blank or a value that is not positive, or hardly varies.
    """
    columns = {"throttle": data.throttle, **data.covariates}
    low, typical, high = zip(*(_range(name, columns.get(name)) for name in of), strict=True)
    throttles = np.unique(data.throttle)
    if len(throttles) > MOST_SHOWN:
        middles = (np.arange(SHOWN) + 0.5) / SHOWN
        # as files and legends write them
        throttles = np.unique([float(f"{t:.3g}") for t in np.quantile(data.throttle, middles)])
    curve = LevelCurve(
        of=tuple(of),
        degree=degree or 1,
        low=low,
        high=high,
        typical=typical,
        shown=tuple(throttles.tolist()),
    )
    data = dataclasses.replace(data, curve=curve)
    if degree is None:
        data = dataclasses.replace(data, curve=dataclasses.replace(curve, degree=_judged(data)))
    return data


def _range(name: str, values: FloatArray | None) -> tuple[float, float, float]:
    """Lowest, median and highest value."""
    if values is None:
        raise InputRefused("levels.of", f"the trials have no {name}", "log it, or take it out")
    bad = int(np.sum(~(np.isfinite(values) & (values > 0))))
    if bad:
        raise InputRefused(
            "levels.of",
            f"{name} is blank or not positive in {bad} of {len(values)} trials",
            "leave those out with [quality] exclude, or take it out",
        )
    low, middle, high = (float(f(values)) for f in (np.min, np.median, np.max))
    if high < (1 + LEAST_RANGE) * low:
        raise InputRefused(
            "levels.of",
            f"{name} hardly varies: {low:.4g} to {high:.4g}",
            "take it out: a curve of it cannot be determined",
        )
    return low, middle, high


def held_out(data: Observations) -> dict[int, FloatArray]:
    """Squared errors of log lift by visit (v,), for every possible degree of the curve of L_inf.

    A smooth curve of distance is fitted as well, and each visit is left out in turn. Trials beyond
    the range of the others are not counted. Where visits are fewer than three, tenths of the
    campaign are left out.
    """
    assert data.curve is not None
    visit = np.unique(data.visit, return_inverse=True)[1]
    if visit.max() < 2:
        visit = np.arange(data.n) * PARTS // data.n
    blocks = visits_by_size(visit)
    inside = np.empty(data.n, dtype=bool)
    for v in range(visit.max() + 1):
        members = visit == v
        inside[members] = data.level_known_from(~members)[members]
    shapes, y = _shapes(data), np.log(data.lift_N)
    squares: dict[int, FloatArray] = {}
    for degree in range(1, MOST_DEGREE + 1):
        curve = dataclasses.replace(data.curve, degree=degree)
        columns = np.hstack([curve.columns(data.curve_inputs), shapes])
        if columns.shape[1] + 2 > data.n or np.linalg.matrix_rank(columns) < columns.shape[1]:
            break
        q, _ = np.linalg.qr(columns)
        left = y - q @ (q.T @ y)
        errors = np.zeros(data.n)
        for alike in blocks:
            kept = np.eye(alike.shape[1]) - q[alike] @ q[alike].swapaxes(1, 2)
            undone = np.linalg.pinv(kept, rcond=1e-9, hermitian=True)
            errors[alike] = (undone @ left[alike][..., None])[..., 0]
        squares[degree] = np.bincount(visit, (errors * inside) ** 2).astype(np.float64)
    return squares


def at_shown(data: Observations) -> FloatArray:
    """The trials' lift, N, moved along the curve to the nearest throttle of `levels`.

    Least squares, with a smooth curve of distance; for tables, before any model is fitted.
    """
    assert data.curve is not None
    columns = data.level_design
    whole = np.hstack([columns, _shapes(data)])
    free = np.linalg.lstsq(whole, np.log(data.lift_N), rcond=None)[0][: columns.shape[1]]
    return data.lift_N * np.exp(data.shown(free)[data.level] - columns @ free)


def _shapes(data: Observations) -> FloatArray:
    """Cosines of nearness, as many as the distances can carry, (n, s)."""
    near = data.nearness
    orders = np.arange(1, min(SHAPES, len(np.unique(near)) - 1) + 1)
    return np.cos(np.pi * np.outer(near / max(near.max(), 1e-300), orders))


def _judged(data: Observations) -> int:
    """The lowest degree that predicts visits left out as well as the best does, within a standard
    error.
    """
    errors = held_out(data)
    if not errors:
        return 1
    best = min(errors.values(), key=lambda e: float(e.sum()))
    for degree, squares in errors.items():
        worse = squares - best
        if worse.sum() <= np.sqrt(len(worse)) * worse.std():
            return degree
    return max(errors)


def held_out_rms(data: Observations) -> dict[int, float]:
    """Root mean square of `held_out` over all trials, by degree."""
    return {d: float(np.sqrt(e.sum() / data.n)) for d, e in held_out(data).items()}
