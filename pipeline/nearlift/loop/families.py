"""Families of regressors in the test for structure: smooth or free shapes along each covariate.

They need no physical cause: they show whether structure is left and along what, and
never become part of a model.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood.covariates import varies
from nearlift.likelihood.subspace import cosines
from nearlift.likelihood.variance_components import MIN_REVISITS
from nearlift.loop.structure import Hypothesis
from nearlift.nomenclature import SCHEDULE_WORDS
from nearlift.results import Observations

#: Most columns of a family, as a share of the trials and in all; smoother families stand for it.
LARGEST_SHARE, LARGEST = 1 / 8, 256
#: Most times at which a step is tested.
STEPS = 40
STEP = "time, step"
#: Name of the family of curves of distance that change with time.
MOVING = "distance x time"
#: Measured covariates with families of their own, and their names in results.
SURROUNDINGS = (("supply_V", "supply"), ("temperature_K", "temperature"))
#: Covariates without a smooth family by default, since another represents them or none may.
SPOKEN_FOR = frozenset(
    {"supply_V", "temperature_K", "approach", "tilt_rad", "speed_Hz", "record_s", "session"}
    | {"start_s", "since_start_s", "elapsed_hat", "elapsed_trials", "run_order", "rest_s", "visit"}
    | {"previous_lift_N", "previous_throttle", "previous_z_hat", "order_in_visit", "n"}
    | {"drift_N_s", "drift_hat", "lift_sd_N", "lift_inf_N"}
)


def powers(x: FloatArray, count: int) -> FloatArray:
    """Powers 1 to `count` of x scaled to [-1, 1], (n, count); zeros for a constant x."""
    low, high = x.min(), x.max()
    u = 2 * (x - low) / (high - low) - 1 if high > low else np.zeros_like(x)
    return np.stack([u**j for j in range(1, count + 1)], axis=1)


def indicators(label: np.ndarray) -> FloatArray:
    """Indicator columns of the distinct labels, (n, k)."""
    _, index = np.unique(label, return_inverse=True)
    return np.eye(index.max() + 1)[index]


def times(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of each column of `a` with each column of `b`."""
    return (a[:, :, None] * b[:, None, :]).reshape(len(a), -1)


def families(data: Observations) -> tuple[Hypothesis, ...]:
    """Families that these trials can carry; `data` has its derived covariates and `lift_inf_N`."""
    known, n, near = data.covariates, data.n, data.nearness
    # L_inf and not the trial's own lift: that carries its noise, which would then seem explained
    additive = (np.median(known["lift_inf_N"]) / known["lift_inf_N"])[:, None]
    few_levels = data.curve is None and len(data.levels) <= 8
    levels = indicators(data.throttle)[:, 1:] if few_levels else powers(data.throttle, 3)
    distances, sessions = (len(np.unique(x)) for x in (data.z_hat, data.session))
    most = max(min(LARGEST_SHARE * n, LARGEST), 1)
    log_z = _log_distance(data)
    smooth_z = powers(log_z, int(min(4, most, max(distances - 1, 1))))
    bent = times(smooth_z, levels)
    if bent.shape[1] > most:
        # few trials show at most that the steepness along distance changes with throttle
        bent = times(powers(log_z, 1), powers(data.throttle, 1))
    degree = int(min(3, most))
    # change within a visit is confounded with noise that neighbours share: resolve time to visits
    visits = len(np.unique(data.visit))
    slow = cosines(known["run_order"], min(8, visits))
    fast = cosines(known["run_order"], max(min(32, n // 12, visits // 4 - 8), 0), first=9)
    order = indicators(np.minimum(known["order_in_visit"], 5))
    last, came = known["previous_throttle"], known["previous_z_hat"]
    throttled = indicators(last) if few_levels else powers(last, 3)
    nearer = np.where(np.isfinite(came) & (came > 0), 1 / np.maximum(came, 0.1), 0.0)
    every: list[Hypothesis] = []

    def add(name: str, covariate: str, columns: FloatArray) -> None:
        every.append(Hypothesis(name, SCHEDULE_WORDS.get(covariate, covariate), columns))

    # indicators take trials by groups of memory, and are not made where they are too many
    if distances <= most:
        add("distance", "distance", indicators(data.z_hat))
    add("distance smooth", "distance", smooth_z)
    add("distance x throttle", "throttle", bent)
    add("time, slow", "start", slow)
    add("time, slow, additive", "start", slow * additive)
    add("time, fast", "start", fast)
    add("zero", "throttle", additive)
    add("order within a visit", "order_in_visit", order)
    add("previous throttle", "previous_throttle", throttled)
    add("previous distance", "previous_distance", powers(nearer, 3))
    if data.curve is not None:
        # structure beyond the degree of the L_inf curve
        bend = powers(np.log(data.throttle), int(min(data.curve.degree + 3, most)))
        add("throttle", "throttle", bend)
    if few_levels and distances * len(data.levels) <= most:
        cells = times(indicators(data.z_hat), indicators(data.throttle))
        add("distance x throttle, cells", "throttle", cells)
    if data.session.max() > 0 and sessions <= most:
        each = indicators(data.session)
        add("session", "session", each)
        add("session, additive", "session", each * additive)
    if varies(data, "since_start_s"):
        since = known["since_start_s"]
        fade = np.stack([np.exp(-since / tau) for tau in (60.0, 300.0, 1500.0)], axis=1)
        add("time since start", "start", np.hstack([fade, fade * additive]))
    for name, covariate in SURROUNDINGS:
        if varies(data, name):
            shape = powers(known[name], degree)
            add(covariate, covariate, shape)
            add(f"{covariate}, additive", covariate, shape[:, :2] * additive)
    closeness = np.stack([np.ones(n), near, near**2], axis=1)
    if varies(data, "approach"):
        add("approach", "approach", times(known["approach"][:, None], closeness))
    others = [k for k in sorted(known.keys() - SPOKEN_FOR) if varies(data, k)]
    if data.ordered and visits >= MIN_REVISITS:
        # fewer visits do not separate such curves from noise that the trials of a visit share
        every.append(moving(data))
        for name, covariate, columns in _bent_by(data, smooth_z[:, :2], additive, others):
            add(name, covariate, columns)
    if varies(data, "tilt_rad"):
        add("tilt", "tilt", times(powers(known["tilt_rad"], 2), closeness))
    for name in others:
        add(name, name, powers(known[name], degree))
    kept = [f for f in every if 0 < f.columns.shape[1] <= most and exceed_levels(f.columns, data)]
    return (*kept, *_steps(known["run_order"], data.visit))


def exceed_levels(columns: FloatArray, data: Observations) -> bool:
    """Whether any column varies beyond L_inf; else its rounding errors would pass for a family."""
    levels = data.level_design
    left = columns - levels @ np.linalg.lstsq(levels, columns, rcond=None)[0]
    return bool(np.abs(left).max() > 1e-9 * np.abs(columns).max())


def moving(data: Observations) -> Hypothesis:
    """Curves of distance (linear, quadratic) that change slowly with time."""
    shape = powers(_log_distance(data), min(2, max(len(np.unique(data.z_hat)) - 1, 1)))
    slow = cosines(data.covariates["run_order"], min(4, len(np.unique(data.visit))))
    return Hypothesis(MOVING, "start", times(shape, slow))


def _steps(order: FloatArray, visit: np.ndarray) -> list[Hypothesis]:
    """Steps at up to `STEPS` changes of visit, evenly spread; each is its own hypothesis."""
    if np.ptp(order) == 0:
        return []
    changes = order[1:][visit[1:] != visit[:-1]] - 0.5
    if len(changes) > 2:
        evenly = np.linspace(0, len(changes) - 1, min(STEPS + 2, len(changes)))
        changes = changes[np.unique(evenly.astype(int))[1:-1]]
    return [Hypothesis(STEP, "start", (order > at).astype(float)[:, None]) for at in changes]


def _log_distance(data: Observations) -> FloatArray:
    """Log z_hat, (n,); in free air that of the farthest station."""
    near = data.nearness
    return np.asarray(-np.log(np.maximum(near, near[near > 0].min() if (near > 0).any() else 1.0)))


def _bent_by(
    data: Observations, shape: FloatArray, additive: FloatArray, others: list[str]
) -> Iterator[tuple[str, str, FloatArray]]:
    """Curves of distance that change with session, supply or temperature; forces by tilt and
    `others`.

    The traverse's last move is a family too, as a direction and as a log ratio of distances.
    """
    known = data.covariates
    if 0 < data.session.max() < LARGEST // shape.shape[1]:
        yield "distance x session", "session", times(shape, indicators(data.session))
    for name, covariate in SURROUNDINGS:
        if varies(data, name):
            yield f"distance x {covariate}", covariate, times(shape, powers(known[name], 1))
    tilt = [("tilt_rad", "tilt")] if varies(data, "tilt_rad") else []
    for name, covariate in (*tilt, *zip(others, others, strict=True)):
        yield f"{covariate}, additive", covariate, powers(known[name], 2) * additive
    before = known["previous_z_hat"]
    moved = (before > 0) & (before != data.z_hat)
    last = np.maximum.accumulate(np.where(moved, np.arange(data.n), -1))
    origin = np.where(last >= 0, before[last], np.nan)
    near = np.isfinite(origin) & np.isfinite(data.z_hat)
    ratio = np.zeros(data.n)
    ratio[near] = np.log(data.z_hat[near] / origin[near])
    move = np.stack([np.sign(ratio), ratio], axis=1)
    yield (
        "last move",
        "previous_distance",
        np.hstack([move, move * additive, move * shape[:, :1]]),
    )
