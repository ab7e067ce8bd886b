"""Residuals against a covariate: columns, bins and their means."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.report.figures import style
from nearlift.results import Observations

#: Up to this many distinct values a covariate is binned by value, beyond it by quantiles.
DISTINCT = 24
BINS = 16
#: Up to this many bins, each has its own tick.
DISCRETE = 6
#: A gap of this part of the whole range parts two clusters of at least so many trials.
GAP, MIN_CLUSTER = 0.05, 8
#: Bins of run order, from which Akaike's criterion chooses.
TIME_BINS = (12, 24, 48)
DISTANCES = ("z_hat", "previous_z_hat")
LABELS = {
    "throttle_percent": r"throttle $\tau$ (%)",
    "run_order": "run order (trial)",
    "approach": "direction of the last move",
    "previous_throttle_percent": "previous throttle (%)",
    "order_in_visit": "order within a visit",
}


def columns(data: Observations) -> dict[str, FloatArray]:
    """Every covariate in drawing units, (n,); nan where there is none, as in free air."""
    known: dict[str, NDArray[Any]] = {
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
    for name in known.keys() & DISTANCES:
        x = np.asarray(known[name], dtype=float)
        known[name] = np.where(np.isfinite(x) & (x > 0), x, np.nan)
    return known


def bins(x: FloatArray) -> NDArray[np.int64]:
    """Bin of each value, 0, 1, ... without gaps: by value where there are few, else by
    quantiles of each cluster, so that no mean lies in a gap.
    """
    distinct, index = np.unique(x, return_inverse=True)
    if len(distinct) <= DISTINCT:
        return index.astype(np.int64)
    order = np.argsort(x, kind="stable")
    starts = [0]
    for at in (np.flatnonzero(np.diff(x[order]) > GAP * np.ptp(x)) + 1).tolist():
        if at - starts[-1] >= MIN_CLUSTER and len(x) - at >= MIN_CLUSTER:
            starts.append(at)
    label = np.zeros(len(x), dtype=np.int64)
    first = 0
    for members in np.split(order, starts[1:]):
        values = x[members]
        count = max(round(BINS * len(values) / len(x)), 1)
        edges = np.unique(np.quantile(values, np.linspace(0, 1, count + 1)))
        place = np.searchsorted(edges[1:-1], values, side="right")
        label[members] = first + np.unique(place, return_inverse=True)[1]
        first = int(label[members].max()) + 1
    return label


def time_bins(y: FloatArray, session: NDArray[Any]) -> NDArray[np.int64]:
    """Bin of each trial along run order: within sessions, as many as Akaike's criterion wants."""
    tried: list[NDArray[np.int64]] = []
    scores = []
    for count in TIME_BINS:
        label = np.zeros(len(session), dtype=np.int64)
        for value in np.unique(session):
            mine = np.flatnonzero(session == value)
            parts = max(round(count * len(mine) / len(session)), 1)
            label[mine] = label.max() + 1 + np.arange(len(mine)) * parts // len(mine)
        label = np.unique(label, return_inverse=True)[1].astype(np.int64)
        mean = np.bincount(label, y) / np.bincount(label)
        tried.append(label)
        variance = float(np.mean((y - mean[label]) ** 2))
        scores.append(len(y) * math.log(max(variance, 1e-300)) + 2 * len(mean))
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


def abscissa(ax: Axes, covariate: str, centres: list[float]) -> None:
    """Scale, ticks and label of an axis whose bins have these centres."""
    label = LABELS.get(covariate) or style.quantity(covariate)
    if covariate in DISTANCES:
        label = covariate.removesuffix("z_hat").replace("_", " ") + style.Z_HAT
        style.log_distance(ax, label)
    elif len(centres) <= DISCRETE:
        words = {-1.0: "closer", 1.0: "away"} if covariate == "approach" else {}
        ax.set_xticks(centres, [words.get(x, f"{x:.3g}".replace("-", "−")) for x in centres])
        ax.margins(x=0.12)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
    ax.set_xlabel(label)
