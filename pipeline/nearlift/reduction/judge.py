"""Checks of trials against the whole campaign: quality codes, refusals and notes.

A force that no vehicle of this weight can have is refused, with the unit that would make sense. A
far lift that does not rise with throttle is flagged and kept: it may be the battery.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from nearlift import units
from nearlift.campaign.manifest import Campaign
from nearlift.errors import InputRefused
from nearlift.reduction import outliers, quality
from nearlift.reduction.quality import rejected
from nearlift.reduction.stretch import SD_PER_MAD

Table = dict[str, NDArray[Any]]
#: Times the weight beyond which a single trial's lift is no lift, whatever the others are.
TOO_HEAVY = 100.0
#: Largest thrust over weight: racing quadrotors at full throttle come near 14.
STRONGEST = 15.0
#: Smallest thrust over weight where the throttle is high; below such a throttle a hundredth, since
#: a lab may run slow rotors only.
WEAKEST, HIGH_THROTTLE = 0.25, 0.75
#: Times the weight between which the largest far lift of a flying vehicle usually lies.
ODD = (0.2, 6.0)
#: Distance over radius from which on ground and ceiling leave a rotor alone, to some per cent.
REACH = 2.0
#: As many trials at one place and throttle show how well they repeat.
FEWEST_TO_REPEAT = 5
#: A trial with less than this fraction of its throttle's usual lift had its rotors at rest.
STOPPED = 0.05
#: Median u(zero) over median u(lift), above which a constant tare is a fault.
TARE_SCATTERS = 0.1
#: Standard uncertainties by which results of one record differ if its samples are rounded again.
ROUNDED = 1e-3
#: The columns of a cell.
CELL = ["boundary", "z_hat", "throttle"]
#: Places without a boundary's effect.
FAR_FROM = {side: f"far from the {side}" for side in ("ground", "ceiling", "sidewall")}
FAR_FROM["none"] = "in free air"


# ---- records


def record_codes(
    columns: Table, codes: Sequence[list[str]], owners: NDArray[np.object_], campaign: Campaign
) -> list[str]:
    """Add to `codes` those of records that are like others' or have another length; returns notes.

    `columns` are rows of trials in run order, `owners` the record of each. Raises as
    `check_lengths` does.
    """
    if campaign.records.reader == "means":
        return []
    # trials of one long table are distinguished by their numbers
    same = ["source_sha256"]
    if not campaign.cuts_records:
        check_lengths(columns, codes, campaign)
        same += ["lift_N", "sd_N"]
    rows = pd.DataFrame({name: columns[name] for name in same}).assign(owner=owners)
    rows = rows[columns["n"] > 0]
    rows["first"] = rows.groupby(same, dropna=False)["owner"].transform("first")
    twice = rows[rows["owner"] != rows["first"]]
    for i in twice.index:
        codes[i].append("DUPLICATE")
    pairs = twice[["owner", "first"]].drop_duplicates().itertuples(index=False)
    notes = [f"the record of {owner} is that of {first}, byte for byte" for owner, first in pairs]
    if campaign.cuts_records:
        return notes
    for i, first in _written_again(columns, rows.index.difference(twice.index), campaign):
        codes[i].append("DUPLICATE")
        notes.append(f"the record of {owners[i]} has the samples of {owners[first]}, rounded")
    return notes


def _written_again(
    columns: Table, rows: pd.Index[int], campaign: Campaign
) -> list[tuple[int, int]]:
    """Pairs of rows, the later first, of equal records that were rounded differently.

    Their numbers of samples are equal. Lift, scatter and drift agree far within their standard
    uncertainties.
    """
    rate_Hz = campaign.load_cell.sample_rate or 0.0
    names = ["lift_N", "sd_N", "drift_N_s"]
    trials = pd.DataFrame({name: columns[name] for name in [*names, "n", "u_lift_N"]}).loc[rows]
    trials = trials.sort_values(["n", "lift_N"])
    n, u_lift = trials["n"], trials["u_lift_N"]
    # the last is that of the slope of a line through n samples
    u = [u_lift, trials["sd_N"] / (2 * n) ** 0.5, 12**0.5 * u_lift * rate_Hz / n]
    agree = trials[names].diff().abs() < ROUNDED * np.column_stack(u)
    alike = agree.all(axis="columns") & (n.diff() == 0)
    ordered = trials.index.to_list()
    pairs = [(ordered[k - 1], ordered[k]) for k in np.flatnonzero(alike)]
    return [(max(pair), min(pair)) for pair in pairs]


def mark_constant_tares(columns: Table, codes: Sequence[list[str]]) -> None:
    """Add `STUCK` to records with a constant tare, if the scatter of most tares matters to the
    lift.

    A scale whose tares are all constant is quiet, not stuck.
    """
    here = columns["n"] > 0
    u_zero, u_lift = columns["u_zero_N"][here], columns["u_lift_N"][here]
    if len(u_zero) and np.median(u_zero) > TARE_SCATTERS * np.median(u_lift):
        for i in np.flatnonzero(here)[u_zero == 0]:
            codes[i].append("STUCK")


def check_lengths(columns: Table, codes: Sequence[list[str]], campaign: Campaign) -> None:
    """Add `short` or `SHORT` to the codes of records with too few samples.

    Where a length is planned, the samples of each record (tare included) are compared with it.
    Below ``1 - missing`` of it the trial is rejected, and any sample that lacks is remarked on.
    Elsewhere the samples averaged, `n`, are compared with their median. Below half of it a trial
    was aborted. Between there and ``1 - missing`` it is rejected only if its file is cut off. A lab
    may well measure for different times.

    Raises
    ------
    InputRefused
        The records' median length is not the planned one: the rate is wrong, or the plan.
    """
    cell, missing = campaign.load_cell, campaign.quality.missing
    record_s, rate_Hz = cell.record or 0.0, cell.sample_rate or 0.0
    planned = round(record_s * rate_Hz)
    counts = columns["samples" if planned else "n"]
    here = counts[counts > 0]
    usual = float(np.median(here)) if len(here) else np.nan
    if planned and abs(usual - planned) > missing * planned:
        raise InputRefused(
            "load_cell.sample_rate",
            f"the records hold {usual:.0f} samples (the median of {len(here)}), where"
            f" {record_s:g} s at {rate_Hz:g} Hz are {planned}",
            f"is the rate {usual / record_s:.4g} Hz? or correct `record`, which counts the tare,"
            " under [load_cell]",
        )
    least = (1 - missing) * (planned or usual)
    for i in np.flatnonzero((counts > 0) & (counts < (planned or least))).tolist():
        aborted = counts[i] < 0.5 * usual or "truncated" in codes[i]
        codes[i].append("SHORT" if (counts[i] < least if planned else aborted) else "short")


# ---- trials


def judge(table: Table, campaign: Campaign) -> list[str]:
    """Check trials against each other; adds codes to `table`, and returns notes.

    Raises
    ------
    InputRefused
        No vehicle of this weight has such a lift; see `against_weight`.
    """

    def mark(name: str, rows: Iterable[int]) -> None:
        for i in rows:
            table["quality"][i] = quality.joined([*table["quality"][i].split(), name])

    notes = against_weight(table, campaign)
    heavy = TOO_HEAVY * campaign.vehicle.mass * campaign.rig.gravity
    with np.errstate(invalid="ignore"):
        mark("IMPLAUSIBLE", np.flatnonzero(np.abs(table["lift_N"]) > heavy))
    good = _accepted(table)
    usual = good.groupby("throttle")["lift_N"].transform("median")
    mark("NO_LIFT", good.index[(good["lift_N"] <= 0) | (good["lift_N"] < STOPPED * usual)])
    mark("other_throttle", other_throttle(table))
    texts = table["quality"][~rejected(table["quality"])]
    share = sum("unsettled" in text.split() for text in texts) / max(len(texts), 1)
    if share >= 0.5:
        notes.append(
            f"{share:.0%} of the records begin with another force than they go on with."
            " Is `tare` or `settle` too short (rotors still at rest), or is sample_rate wrong?"
        )
    if campaign.load_cell.accuracy is not None and campaign.load_cell.range is None:
        notes.append("load_cell.accuracy is at full range, and counts for nothing without `range`")
    for side in dict.fromkeys(table["boundary"].tolist()):
        # trials that repeats and neighbours contradict
        mine = np.flatnonzero(
            (table["boundary"] == side) & ~rejected(table["quality"]) & (table["lift_N"] > 0)
        )
        z_hat, throttle, visit = (table[name][mine] for name in ("z_hat", "throttle", "visit"))
        seen = outliers.screen(np.log(table["lift_N"][mine]), z_hat, throttle, visit)
        mark("outlying", mine[seen.outlying])
        notes += [
            f"{table['trial'][mine[i]]} lifts {100 * np.expm1(seen.departure[i]):+.3g} % against"
            f" its repeats and neighbours, {abs(seen.sigmas[i]):.0f} times their scatter: noise"
            " does not reach so far; look at its record and its row"
            for i in np.flatnonzero(seen.outlying)
        ]
    for side, lower, upper, below, above in not_rising(table):
        here = (table["boundary"] == side) & (table["throttle"] == upper)
        farthest = table["z_hat"] == table["z_hat"][here].max()
        mark("not_rising", np.flatnonzero(here & farthest))
        notes.append(
            f"{FAR_FROM[side]} the lift does not rise with throttle: {below:.4g} N at"
            f" {100 * lower:.4g} %, {above:.4g} N at {100 * upper:.4g} % (battery, order of the"
            " sweep, or a wrong label?)"
        )
    return notes


def _accepted(table: Mapping[str, NDArray[Any]]) -> pd.DataFrame:
    """Boundary, distance, throttle and lift of the accepted trials with a lift, by their row."""
    good = ~rejected(table["quality"]) & np.isfinite(table["lift_N"].astype(float))
    trials = pd.DataFrame({name: table[name][good] for name in (*CELL, "lift_N")})
    return trials.set_axis(np.flatnonzero(good), axis="index")


def other_throttle(table: Mapping[str, NDArray[Any]]) -> list[int]:
    """Rows of the trials that lift as those of another throttle do at their place: their label may
    be wrong.

    Such a trial is more than six times the usual scatter off its own throttle's median. It is
    within three times of another's. Each throttle has five trials or more. A supply that sags moves
    lift too, but not onto another throttle whose trials repeat well.
    """
    good = _accepted(table)
    good = good[good.groupby(CELL)["lift_N"].transform("size") >= FEWEST_TO_REPEAT]
    good["median"] = good.groupby(CELL)["lift_N"].transform("median")
    away = (good["lift_N"] - good["median"]).abs()
    good["scatter"] = SD_PER_MAD * away.groupby([good[name] for name in CELL]).transform("median")
    levels = good.drop_duplicates(CELL)[[*CELL, "median", "scatter"]]
    odd = good[away > 6 * good["scatter"]].reset_index(names="row")
    pairs = odd.merge(levels, on=CELL[:2], suffixes=("", "_other"))
    off = (pairs["lift_N"] - pairs["median_other"]).abs()
    near = (pairs["throttle"] != pairs["throttle_other"]) & (off < 3 * pairs["scatter_other"])
    return [*dict.fromkeys(pairs.loc[near, "row"].tolist())]


# ---- lift far from a boundary


def _far_lifts(table: Mapping[str, NDArray[Any]]) -> pd.Series[float]:
    """Median lift, N, of the good trials farthest from each boundary, by boundary and throttle.

    Farthest for each throttle, since not every throttle is run at every station.
    """
    good = _accepted(table)
    farthest = good.groupby(CELL[::2])["z_hat"].transform("max")
    return good[good["z_hat"] == farthest].groupby(CELL[::2])["lift_N"].median()


def against_weight(table: Mapping[str, NDArray[Any]], campaign: Campaign) -> list[str]:
    """Refuse forces that cannot belong to a vehicle of this weight (mass times gravity).

    Returns a note where the largest far lift is possible, but unusual: gf for mN is a factor of
    ten.

    Raises
    ------
    InputRefused
        The largest far lift is more than 15 times the weight, or negative. Or it is less than a
        hundredth (a quarter at a throttle of 75 % and more).
    """
    far, weight = _far_lifts(table), campaign.vehicle.mass * campaign.rig.gravity
    if far.empty:
        return []
    series, key = campaign.records.force, "records.force.unit"
    unit = series.unit if series is not None else campaign.trials.units.get("lift", "N")
    key = key if series is not None else "trials.units.lift"
    side, throttle = far.index[int(far.abs().argmax())]
    lift = float(far[side, throttle])
    place, ratio = f"{FAR_FROM[side]} at {100 * throttle:.0f} % throttle", lift / weight
    least = WEAKEST if throttle >= HIGH_THROTTLE else 1 / TOO_HEAVY
    if not least <= abs(ratio) <= STRONGEST:
        times = f"{abs(ratio):.3g} times the weight of {weight:.4g} N"
        what = f"{place} the lift is {lift:.4g} N, {times}"
        raise InputRefused(key, what, _other_unit(lift, weight, unit))
    if ratio < 0:
        remedy = (
            "if lift pulls the cell the other way, change the sign of [records] force; if a"
            " converter's counter wraps, `nearlift inspect FILE` shows the jump"
        )
        raise InputRefused(key, f"{place} the lift is negative ({lift:.4g} N)", remedy)
    if ODD[0] < ratio < ODD[1]:
        return []
    said = f"the largest lift far away is {ratio:.3g} times the weight, which is unusual"
    return [f"{said}; {_other_unit(lift, weight, unit)} ({key} is {unit})"]


def _other_unit(lift: float, weight: float, unit: str) -> str:
    """The units that would make of it 0.3 to 10 times the weight, and how many times."""
    if unit == "count":
        gain = f"off by about {abs(lift) / weight:.2g}?"
        return f"check the calibration's gain ({gain}) and [vehicle] mass"
    number = abs(lift) / units.to_si(unit, "force", "force")[0]
    fitting = [
        f'"{u}" ({units.to_si(u, "force", "force")[0] * number / weight:.2g} times the weight)'
        for u in units.plausible(number, "force", 0.3 * weight, 10 * weight)
        if u != unit
    ]
    if not fitting:
        return "no usual unit makes sense of it; check the unit or correct [vehicle] mass"
    asked = f'is the unit {", or ".join(fitting)}, rather than "{unit}"?'
    return f"{asked} or correct [vehicle] mass"


def not_rising(table: Mapping[str, NDArray[Any]]) -> list[tuple[str, float, float, float, float]]:
    """Throttles over which far lift does not rise: (boundary, lower, upper, lift below, above)."""
    far = _far_lifts(table).reset_index()
    far[["lower", "below"]] = far.groupby("boundary")[["throttle", "lift_N"]].shift()
    falls = far.loc[far["lift_N"] <= far["below"]]
    columns = ["boundary", "lower", "throttle", "below", "lift_N"]
    return list(falls[columns].itertuples(index=False, name=None))


def without_reference(table: Mapping[str, NDArray[Any]]) -> list[tuple[str, float, float, float]]:
    """Throttles without a lift far from the boundary: (boundary, throttle, its farthest z_hat, the
    boundary's farthest).

    Half of the boundary's farthest station is far enough, and so is free air.
    """
    good = _accepted(table)
    free = good["boundary"] == "none"
    far = good[~free].groupby(CELL[::2], as_index=False)["z_hat"].max()
    far["farthest"] = far.groupby("boundary")["z_hat"].transform("max")
    known = far["throttle"].isin(good.loc[free, "throttle"])
    lacking = far[(far["z_hat"] < 0.5 * far["farthest"]) & ~known]
    return list(lacking.itertuples(index=False, name=None))


def only_near(table: Mapping[str, NDArray[Any]]) -> list[tuple[str, float]]:
    """Ground and ceiling from which no trial is farther than `REACH` radii, if none is in free air:
    (boundary, its farthest z_hat).
    """
    far = _accepted(table).groupby("boundary")["z_hat"].max()
    if "none" in far:
        return []
    return [(s, float(far[s])) for s in ("ground", "ceiling") if s in far and far[s] < REACH]
