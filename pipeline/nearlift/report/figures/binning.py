"""Residuals against a covariate: columns, bins and their means, smooth curves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.likelihood.subspace import cosines
from nearlift.report.figures import style
from nearlift.report.figures.style import Look, Style, quantity
from nearlift.results import Observations

#: Up to this many distinct values a covariate is binned by value, beyond it by quantiles.
DISTINCT = 24
BINS = 16
#: Up to this many bins, each has its own tick.
DISCRETE = 6
#: A gap of this part of the whole range parts two clusters of at least so many trials.
GAP = 0.05
FEWEST = 8
#: Bins of run order, and terms of a curve along it, from which Akaike's criterion chooses.
TIME_BINS = (12, 24, 48)
TIME_TERMS = 40
TERMS = 8
CURVE_POINTS = 400
DISTANCES = ("z_hat", "previous_z_hat")
LABELS = {
    "run_order": "run order (trial)",
    "approach": "direction of the last move",
    "previous_throttle_percent": "previous throttle (%)",
    "order_in_visit": "order within a visit",
}


def columns(data: Observations) -> dict[str, FloatArray]:
    """Every covariate in drawing units, (n,); nan where there is none, as in free air."""
    known: Look = {
        **data.covariates,
        "z_hat": data.z_hat,
        "throttle_percent": 100 * data.throttle,
        "run_order": 1.0 + np.arange(data.n),
        "session": data.session + 1.0,
    }
    if "previous_throttle" in known:
        known["previous_throttle_percent"] = 100 * known["previous_throttle"]
    if "order_in_visit" in known:
        known["order_in_visit"] = known["order_in_visit"] + 1
    for name in DISTANCES:
        if name in known:
            x = np.asarray(known[name], dtype=float)
            known[name] = np.where(np.isfinite(x) & (x > 0), x, np.nan)
    return known


def bins(x: FloatArray) -> NDArray[np.int64]:
    """Bin of each value, 0, 1, ... without gaps: by value where there are few, else by
    quantiles of each cluster.
    """
    distinct, index = np.unique(x, return_inverse=True)
    if len(distinct) <= DISTINCT:
        return index.astype(np.int64)
    label = np.zeros(len(x), dtype=np.int64)
    first = 0
    for members in _clusters(x):
        values = x[members]
        count = max(round(BINS * len(values) / len(x)), 1)
        edges = np.unique(np.quantile(values, np.linspace(0, 1, count + 1)))
        place = np.searchsorted(edges, values, side="right") - 1
        _, inside = np.unique(np.clip(place, 0, max(len(edges) - 2, 0)), return_inverse=True)
        label[members] = first + inside
        first = int(label[members].max()) + 1
    return label


def _clusters(x: FloatArray) -> list[NDArray[np.int64]]:
    """Indices of the values, split at gaps, so that no mean lies in one."""
    order = np.argsort(x, kind="stable")
    gaps = np.flatnonzero(np.diff(x[order]) > GAP * (x.max() - x.min())) + 1
    kept: list[int] = []
    for at in gaps.tolist():
        if at - (kept[-1] if kept else 0) >= FEWEST and len(x) - at >= FEWEST:
            kept.append(at)
    return np.split(order, kept)


def time_bins(y: FloatArray, session: NDArray[Any]) -> NDArray[np.int64]:
    """Bin of each trial along run order: within sessions, as many as Akaike's criterion wants."""
    tried = []
    for count in TIME_BINS:
        label = np.zeros(len(session), dtype=np.int64)
        for value in np.unique(session):
            mine = np.flatnonzero(session == value)
            parts = max(round(count * len(mine) / len(session)), 1)
            label[mine] = label.max() + 1 + np.arange(len(mine)) * parts // len(mine)
        tried.append(np.unique(label, return_inverse=True)[1].astype(np.int64))
    left = [y - (np.bincount(label, y) / np.bincount(label))[label] for label in tried]
    scores = [_akaike(r, label.max() + 1) for r, label in zip(left, tried, strict=True)]
    return tried[int(np.argmin(scores))]


def means(
    x: FloatArray, y: FloatArray, label: NDArray[Any]
) -> tuple[NDArray[np.int64], FloatArray, FloatArray, FloatArray]:
    """Count of each bin, the means of `x` and `y`, and the standard error of the latter, trials
    taken as independent; nan for one.
    """
    count = np.bincount(label)
    mean = np.bincount(label, y) / count
    spread = np.sqrt(np.bincount(label, (y - mean[label]) ** 2) / np.maximum(count - 1, 1))
    error = np.where(count > 1, spread / np.sqrt(count), np.nan)
    return count, np.bincount(label, x) / count, mean, error


def smooth_curve(name: str, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A smooth curve through residuals, its number of terms chosen by Akaike's criterion; empty for
    few levels.
    """
    if len(np.unique(x)) <= DISTINCT:
        return np.zeros(0), np.zeros(0)
    terms = min(TIME_TERMS if name == "run_order" else TERMS, len(x) // 8)
    design = np.hstack([np.ones((len(x), 1)), cosines(x, terms)])
    fits = [
        design[:, : m + 1] @ np.linalg.lstsq(design[:, : m + 1], y, rcond=None)[0]
        for m in range(1, terms + 1)
    ]
    best = min(range(terms), key=lambda i: _akaike(y - fits[i], i + 2))
    chosen = np.unique(np.linspace(0, len(x) - 1, CURVE_POINTS).astype(int))
    order = np.argsort(x, kind="stable")[chosen]
    return x[order], fits[best][order]


def _akaike(residual: FloatArray, unknowns: int) -> float:
    return len(residual) * float(np.log(max(float(np.mean(residual**2)), 1e-300))) + 2 * unknowns


def shown_x(covariate: str, x: Any, look: Style) -> Any:
    """Values of a covariate as they are drawn: distances in the style's unit."""
    return look.distance[0] * x if covariate in DISTANCES else x


def abscissa(ax: Axes, covariate: str, centres: Sequence[float], look: Style) -> None:
    """Scale, ticks and label of an axis whose bins have these centres."""
    if covariate in DISTANCES:
        style.log_distance(ax, "")
    elif len(centres) <= DISCRETE:
        words = {-1.0: "closer", 1.0: "away"} if covariate == "approach" else {}
        names = [words.get(x, f"{x:.3g}".replace("-", "−")) for x in centres]
        ax.set_xticks(centres, names)
        ax.margins(x=0.12)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
    ax.set_xlabel(label(covariate, look), labelpad=1)


def label(covariate: str, look: Style) -> str:
    """Axis label of a covariate."""
    if covariate in DISTANCES:
        return covariate.removesuffix("z_hat").replace("_", " ") + look.distance[1]
    if covariate == "throttle_percent":
        return quantity("throttle", "%")
    return LABELS.get(covariate) or quantity(covariate)
