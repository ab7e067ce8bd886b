"""Bins, series and smooth curves of residuals against the covariates that a diagnosis flags."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import catalogue
from nearlift.declare import FloatArray
from nearlift.likelihood.subspace import cosines
from nearlift.nomenclature import SCHEDULE_WORDS
from nearlift.report.evidence import (
    distinct,
)
from nearlift.report.figures.residuals import (
    DISTINCT,
    bins,
    recorded,
)
from nearlift.results import Observations
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.rounding import plain

#: Residuals are drawn against so many covariates at most.
MOST = 2
#: Bins of run order, and terms of a curve along it, from which Akaike's criterion chooses.
TIME_BINS = (12, 24, 48)
TIME_TERMS = 40
TERMS = 8
CURVE_POINTS = 400
#: A second covariate with more levels than this is divided into thirds.
LEVELS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Abscissa:
    """Abscissa, and perhaps a second covariate whose levels are series of their own."""

    column: str
    series: str = ""


#: The schedule's words. Any other covariate is drawn as it is.
AXES: dict[str, Abscissa] = {
    "distance": Abscissa(column="z_hat"),
    "throttle": Abscissa(column="z_hat", series="throttle_percent"),
    "approach": Abscissa(column="z_hat", series="approach"),
    "tilt": Abscissa(column="tilt_rad", series="z_hat"),
    "start": Abscissa(column="run_order"),
    "supply": Abscissa(column="supply_V"),
    "temperature": Abscissa(column="temperature_K"),
    "previous_throttle": Abscissa(column="previous_throttle_percent"),
    "previous_distance": Abscissa(column="previous_z_hat"),
}


def chosen_covariates(diagnosis: BoundaryDiagnosis) -> list[str]:
    """The covariate of the most significant structure; where it stays unexplained also that of the
    next, where the gain wanders also time, and after two effects also that of the effect which the
    first does not concern.
    """
    structure = diagnosis.structure
    shown = [s for s in structure[1:] if s.significant and diagnosis.verdict == "unexplained"]
    words = [s.covariate for s in (*structure[:1], *shown)] or ["distance"]
    if diagnosis.wander:
        words.append("start")
    if len(diagnosis.effects) > 1:
        known = {e.name: e.varies_with for e in catalogue.effects()}
        words += [
            SCHEDULE_WORDS.get(known[e.name], known[e.name])
            for e in diagnosis.effects
            if e.name in known
        ]
    return list(dict.fromkeys(words))[:MOST]


def axis_of(word: str, data: Observations) -> Abscissa:
    """Abscissa of that covariate; run order where the trials do not have it."""
    wanted = AXES.get(word, Abscissa(column=word))
    return wanted if np.isfinite(column_of(wanted.column, data)).any() else AXES["start"]


def column_of(name: str, data: Observations) -> FloatArray:
    """A covariate in drawing units, nan where it says nothing (free air, the first trial of a
    session).
    """
    if name == "previous_throttle_percent":
        return 100 * column_of("previous_throttle", data)
    values = np.asarray(recorded(data).get(name, np.full(data.n, np.nan)), dtype=float)
    if name == "order_in_visit":
        return values + 1
    if name.startswith("previous_"):
        return np.where(np.isfinite(values) & (values > 0), values, np.nan)
    return values


def series_of(name: str, data: Observations) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Label and trials of each series; one without a label if there is no second covariate."""
    if not name:
        yield "", np.ones(data.n, dtype=bool)
        return
    values = column_of(name, data)
    distinct = np.unique(values[np.isfinite(values)])
    if len(distinct) <= LEVELS:
        for level in distinct:
            yield _level(name, float(level)), values == level
        return
    ends = np.quantile(values[np.isfinite(values)], [0, 1 / 3, 2 / 3, 1])
    for i, (low, high) in enumerate(pairwise(ends)):
        yield (
            f"{plain(float(low), 3)} to {plain(float(high), 3)}{_unit(name)}",
            (values >= low if i == 0 else values > low) & (values <= high),
        )


def _level(name: str, level: float) -> str:
    if name == "approach":
        return "moved away" if level > 0 else "moved closer"
    return plain(level, 3) + _unit(name)


def _unit(name: str) -> str:
    return " %" if name.endswith("_percent") else ""


def bins_of(name: str, x: FloatArray, y: FloatArray, session: NDArray[Any]) -> NDArray[np.int64]:
    """Bin of each trial. Run order is parted within sessions, into as many bins as Akaike's
    criterion wants.
    """
    if name != "run_order":
        return bins(x)
    tried = [_within(session, count) for count in TIME_BINS]
    return min(
        tried,
        key=lambda parts: _akaike(
            y - (np.bincount(parts, y) / np.bincount(parts))[parts], int(parts.max()) + 1
        ),
    )


def _within(session: NDArray[Any], count: int) -> NDArray[np.int64]:
    bin_of = np.zeros(len(session), dtype=np.int64)
    first = 0
    for value in distinct(session):
        mine = np.flatnonzero(session == value)
        parts = max(round(count * len(mine) / len(session)), 1)
        bin_of[mine] = first + np.arange(len(mine)) * parts // len(mine)
        first += parts
    return np.unique(bin_of, return_inverse=True)[1].astype(np.int64)


def smooth_curve(name: str, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A smooth curve without a name through residuals, its number of terms chosen by Akaike's
    criterion; empty for few levels.
    """
    if len(np.unique(x)) <= DISTINCT:
        return np.zeros(0), np.zeros(0)
    terms = min(TIME_TERMS if name == "run_order" else TERMS, len(x) // 8)
    columns = np.hstack([np.ones((len(x), 1)), cosines(x, terms)])
    fits = [
        columns[:, : m + 1] @ np.linalg.lstsq(columns[:, : m + 1], y, rcond=None)[0]
        for m in range(1, terms + 1)
    ]
    best = min(range(terms), key=lambda i: _akaike(y - fits[i], i + 2))
    order = np.argsort(x, kind="stable")[
        np.unique(np.linspace(0, len(x) - 1, CURVE_POINTS).astype(int))
    ]
    return x[order], fits[best][order]


def _akaike(residual: FloatArray, unknowns: int) -> float:
    return len(residual) * float(np.log(max(float(np.mean(residual**2)), 1e-300))) + 2 * unknowns
