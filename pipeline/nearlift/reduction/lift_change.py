"""Trials to Delta L of each cell, with the covariance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray
from nearlift.likelihood.level_curve import at_shown
from nearlift.nomenclature import CARRIED
from nearlift.reduction import cells, plausibility
from nearlift.results import Observations

Table = dict[str, NDArray[Any]]
#: With more cells than this no covariance is written: a column of numbers for every cell, it grows
#: with their square (34 MB here).
MOST_CELLS = 2000


def lift_change(
    trials: Table, observed: Mapping[Boundary, Observations], near_reference: bool = False
) -> tuple[Table, Table, tuple[str, ...]]:
    """Cells of accepted trials at one (boundary, distance, throttle), the covariance of their Delta
    L (empty beyond `MOST_CELLS`), and notes.

    A throttle without a lift far from the boundary has no L_inf, and its Delta L is nan. With
    `near_reference` the farthest lift serves. Where L_inf is a curve, lifts are moved along it to
    the throttles that it shows.
    """
    from scipy.linalg import block_diag

    reduced, carried, curve = {}, {}, False
    for boundary, data in observed.items():
        curve = data.curve is not None
        lift_N = at_shown(data) if curve else data.lift_N
        throttle = data.levels[data.level]
        reduced[boundary] = cells.reduce(data.z_hat, throttle, lift_N, data.u_lift_N, data.visit)
        carried[boundary] = _carried(trials, data, reduced[boundary])
    columns = ("z_hat", "throttle", "lift_N", "u_lift_N", "n_trials", "delta_L", "u_delta_L")
    table = {name: np.concatenate([getattr(c, name) for c in reduced.values()]) for name in columns}
    table["boundary"] = np.concatenate(
        [np.full(len(c.z_hat), b, dtype=object) for b, c in reduced.items()]
    )
    for name in sorted({name for means in carried.values() for name in means}):
        table[name] = np.concatenate(
            [carried[b].get(name, np.full(len(c.z_hat), np.nan)) for b, c in reduced.items()]
        )
    wanted, notes = curve or near_reference, []
    for side, far in plausibility.only_near(trials):
        notes.append(
            f"{side}: no trial is farther than z_hat = {far:.3g}, where the {side} still acts, so"
            " Delta L is against that; measure farther away, or in free air; or is the unit of"
            " distance wrong?"
        )
    lacking = np.zeros(len(table["z_hat"]), dtype=bool)
    # a curve gives L_inf of every throttle from all of them
    for side, level, far, farthest in () if curve else plausibility.without_reference(trials):
        if not wanted:
            lacking |= (table["boundary"] == side) & (table["throttle"] == level)
        notes.append(
            f"{side}: at {100 * level:.4g} % throttle no trial is farther than z_hat = {far:.3g},"
            f" where others reach {farthest:.3g}: "
            + (
                "its Delta L rests on a lift that the boundary changes, as asked"
                if wanted
                else "it has no L_inf, hence no Delta L"
            )
            + "; measure it far away, or in free air"
            + ("" if wanted else ", or say near_reference = true under [quality]")
        )
    table["delta_L"][lacking] = table["u_delta_L"][lacking] = np.nan
    if len(lacking) > MOST_CELLS:
        size = f"{8e-6 * len(lacking) ** 2:.0f} MB"
        notes.append(
            f"{len(lacking)} cells: their covariance would be {size}, and lift_covariance.parquet"
            " is left empty; u_delta_L is in lift.parquet"
        )
        return table, {}, tuple(notes)
    covariance = block_diag(*(c.covariance() for c in reduced.values()))
    covariance[lacking] = covariance[:, lacking] = np.nan
    return table, {f"c{i}": column for i, column in enumerate(covariance.T)}, tuple(notes)


def _carried(trials: Table, data: Observations, reduced: cells.Cells) -> dict[str, FloatArray]:
    """Mean and standard uncertainty, for each cell, of quantities measured with lift.

    The uncertainty is that of the mean of the trials' own, or the scatter of the trials where that
    is larger.
    """
    row = {str(t): i for i, t in enumerate(trials["trial"])}
    mine = np.array([row[str(t)] for t in data.trial], dtype=np.int64)
    throttle, columns = data.levels[data.level], {}
    for name, u in CARRIED.items():
        if name not in trials:
            continue
        values = np.asarray(trials[name], dtype=float)[mine]
        u_each = np.asarray(trials.get(u, np.full(len(row), np.nan)), dtype=float)[mine]
        means = [
            _mean(values[here], u_each[here])
            for z, t in zip(reduced.z_hat, reduced.throttle, strict=True)
            for here in [(data.z_hat == z) & (throttle == t) & np.isfinite(values)]
        ]
        columns[name], columns[u] = (np.array(column) for column in zip(*means, strict=True))
    return columns


def _mean(values: FloatArray, u: FloatArray) -> tuple[float, float]:
    n = len(values)
    if not n:
        return np.nan, np.nan
    scatter = float(values.var(ddof=1)) if n > 1 else np.nan
    known = float(np.mean(u**2))
    return float(values.mean()), float(np.sqrt(np.fmax(scatter, known) / n))
