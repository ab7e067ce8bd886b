"""Trials to Delta L of each cell, with the full covariance.

A cell is the mean lift at one (boundary, distance, throttle), and Delta L = (L - L_inf) / L_inf.
Every cell of a throttle shares one L_inf, so their errors are correlated. The throttles of one
visit of the traverse share that visit's height. Delta L is for tables and figures: fits work on
the trials themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray, IntArray
from nearlift.likelihood.level_curve import at_shown
from nearlift.nomenclature import CARRIED
from nearlift.reduction import judge
from nearlift.results import Observations

Table = dict[str, NDArray[Any]]
#: With fewer repeats than this a cell borrows the relative scatter of all cells of its boundary.
OWN_SCATTER = 4
#: With more cells than this no covariance is written: a column of numbers for every cell, it grows
#: with their square (34 MB here).
MOST_CELLS = 2000
CELL_COLUMNS = ("z_hat", "throttle", "lift_N", "u_lift_N", "n_trials", "delta_L", "u_delta_L")


class Cells(NamedTuple):
    """One boundary's cells, ordered by throttle, then distance: a table with `CELL_COLUMNS`, and
    the covariance of delta_L, (c, c). It has 8 c^2 bytes, and three times that while it is made.
    """

    table: pd.DataFrame
    covariance: Callable[[], FloatArray]


def cells(
    z_hat: FloatArray,
    throttle: FloatArray,
    lift_N: FloatArray,
    u_lift_N: FloatArray,
    visit: NDArray[Any],
) -> Cells:
    """Cells of the accepted trials of one boundary, from their columns of trials.parquet (n,).

    Free-air trials have z_hat = inf and serve as L_inf where present, else each throttle's farthest
    station.
    """
    trials = pd.DataFrame({"throttle": throttle, "z_hat": z_hat, "lift": lift_N, "visit": visit})
    trials["u2"] = u_lift_N**2
    groups = trials.groupby(["throttle", "z_hat"])
    made = groups.agg(lift_N=("lift", "mean"), n_trials=("lift", "size"), u2=("u2", "mean"))
    made = made.reset_index()
    # rows are sorted: a throttle's last one is its farthest
    far = np.arange(len(made)) + made.groupby("throttle").cumcount(ascending=False).to_numpy()
    mean = made["lift_N"].to_numpy()
    variance, joint = _scatter(trials.assign(cell=groups.ngroup()), made)
    over = mean / mean[far]
    # a cell and its reference are at two distances, which share nothing
    both = variance + over**2 * variance[far]
    is_far = far == np.arange(len(mean))
    made["u_lift_N"], made["delta_L"] = np.sqrt(variance), over - 1
    made["u_delta_L"] = np.sqrt(np.where(is_far, 0.0, both)) / np.abs(mean[far])
    near = np.isfinite(made["z_hat"].to_numpy())

    def covariance() -> FloatArray:
        result = np.diag(variance)
        for members, block in joint:
            result[np.ix_(members, members)] = block
        # d delta = (d mean - (1 + delta) d mean_far) / mean_far: exactly nothing at the far end
        result -= over[:, None] * result[far]
        result -= over * result[:, far]
        result /= mean[far][:, None]
        result /= mean[far]
        result = result[np.ix_(near, near)]
        return (result + result.T) / 2

    return Cells(made.loc[near, list(CELL_COLUMNS)].reset_index(drop=True), covariance)


def _scatter(
    trials: pd.DataFrame, made: pd.DataFrame
) -> tuple[FloatArray, list[tuple[IntArray, FloatArray]]]:
    """Variances of cell means from repeats, and blocks (members, covariance) of the throttles that
    share visits.
    """
    count, mean = made["n_trials"].to_numpy(), made["lift_N"].to_numpy()
    trials["deviation"] = trials["lift"] - mean[trials["cell"]]
    squares = np.bincount(trials["cell"], trials["deviation"] ** 2)
    spare = np.sum(count) - len(count)
    pooled = np.sum(squares / mean**2) / spare if spare >= OWN_SCATTER else 0.0
    repeats = np.where(count >= OWN_SCATTER, squares / np.maximum(count - 1, 1), pooled * mean**2)
    variance, shared = np.maximum(repeats, made["u2"].to_numpy()) / count, []
    often = made[np.isfinite(made["z_hat"]) & (count >= 2 * OWN_SCATTER)]
    for station in often.groupby("z_hat").groups.values():
        members = station.to_numpy()
        mine = trials[trials["cell"].isin(members)]
        # only complete repeats give a joint scatter that is a covariance
        if len(members) < 2 or mine.duplicated(["cell", "visit"]).any():
            continue
        table = mine.pivot(index="cell", columns="visit", values="deviation").to_numpy()
        if not np.isfinite(table).all():
            continue
        n = table.shape[1]
        block = table @ table.T / (n - 1) / n
        block += np.diag(np.maximum(variance[members] - np.diag(block), 0))
        shared.append((members, block))
        variance[members] = np.diag(block)
    return variance, shared


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

    curve = any(data.curve is not None for data in observed.values())
    tables, covariances = [], []
    for boundary, data in observed.items():
        lift_N = data.lift_N if data.curve is None else at_shown(data)
        throttle = data.levels[data.level]
        reduced = cells(data.z_hat, throttle, lift_N, data.u_lift_N, data.visit)
        tables.append(_carried(trials, data, reduced.table).assign(boundary=boundary))
        covariances.append(reduced.covariance)
    table = pd.concat(tables, ignore_index=True)
    further = sorted(set(map(str, table)) - {*CELL_COLUMNS, "boundary"})
    table = table[[*CELL_COLUMNS, "boundary", *further]]
    notes = [
        f"{side}: no trial is farther than z_hat = {far:.3g}, where the {side} still acts, so"
        " Delta L is against that; measure farther away, or in free air; or is the unit of"
        " distance wrong?"
        for side, far in judge.only_near(trials)
    ]
    lacking = np.zeros(len(table), dtype=bool)
    # a curve gives L_inf of every throttle from all of them
    for side, level, far, farthest in () if curve else judge.without_reference(trials):
        ends = "it has no L_inf, hence no Delta L; measure it far away, or in free air, or say"
        ends += " near_reference = true under [quality]"
        if near_reference:
            ends = "its Delta L depends on a lift that the boundary changes, as asked; measure it"
            ends += " far away, or in free air"
        else:
            lacking |= ((table["boundary"] == side) & (table["throttle"] == level)).to_numpy()
        notes.append(
            f"{side}: at {100 * level:.4g} % throttle no trial is farther than z_hat = {far:.3g},"
            f" where others reach {farthest:.3g}: {ends}"
        )
    table.loc[lacking, ["delta_L", "u_delta_L"]] = np.nan
    columns = {str(name): table[name].to_numpy() for name in table}
    if len(table) > MOST_CELLS:
        size = f"{8e-6 * len(table) ** 2:.0f} MB"
        notes.append(
            f"{len(table)} cells: their covariance would be {size}, and lift_covariance.parquet"
            " is left empty; u_delta_L is in lift.parquet"
        )
        return columns, {}, tuple(notes)
    covariance = block_diag(*(made() for made in covariances))
    covariance[lacking] = covariance[:, lacking] = np.nan
    return columns, {f"c{i}": column for i, column in enumerate(covariance.T)}, tuple(notes)


def _carried(trials: Table, data: Observations, table: pd.DataFrame) -> pd.DataFrame:
    """The table of cells with mean and standard uncertainty of quantities measured with lift.

    The uncertainty is that of the mean of the trials' own, or the scatter of the trials where that
    is larger.
    """
    rows = pd.Series(np.arange(len(trials["trial"])), index=trials["trial"].astype(str))
    mine = rows[data.trial.astype(str)].to_numpy()
    keys = ["z_hat", "throttle"]
    frame = pd.DataFrame({"z_hat": data.z_hat, "throttle": data.levels[data.level]})
    for name, u in CARRIED.items():
        if name not in trials:
            continue
        frame["value"] = trials[name][mine].astype(float)
        frame["u2"] = trials[u][mine].astype(float) ** 2 if u in trials else np.nan
        by_cell = frame.dropna(subset="value").groupby(keys)
        means = by_cell.agg(value=("value", "mean"), n=("value", "size"), scatter=("value", "var"))
        # an unknown uncertainty makes that of the mean unknown
        known = by_cell["u2"].apply(lambda u2: u2.mean(skipna=False))
        means[u] = np.sqrt(np.fmax(means["scatter"], known) / means["n"])
        columns = means[["value", u]].rename(columns={"value": name}).reset_index()
        table = table.merge(columns, on=keys, how="left")
    return table
