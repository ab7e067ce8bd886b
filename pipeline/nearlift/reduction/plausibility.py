"""Checks of a whole campaign: lengths of records, the weight, and whether lift rises with
throttle.

A force that no vehicle of this weight can have is refused, with the unit that would make sense. A
far lift that does not rise with throttle is flagged and kept: it may be the battery.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import units
from nearlift.campaign.manifest import Campaign
from nearlift.declare import BoolArray, FloatArray, IntArray
from nearlift.errors import InputRefused
from nearlift.reduction.quality import rejected
from nearlift.reduction.stretch import SD_PER_MAD, distinct, median, numbered_pairs

#: Times the weight beyond which a single trial's lift is no lift, whatever the others are.
TOO_HEAVY = 100.0
#: Largest thrust over weight: racing quadrotors at full throttle come near 14.
STRONGEST = 15.0
#: What is left of that at least (of the weight) where the throttle is high; below such a throttle a
#: hundredth, since a lab may run slow rotors only.
WEAKEST, HIGH_THROTTLE = 0.25, 0.75
#: Times the weight between which the largest far lift of a flying vehicle usually lies.
ODD = (0.2, 6.0)
#: Distance over radius from which on ground and ceiling leave a rotor alone, to some per cent.
REACH = 2.0
#: As many trials at one place and throttle show how well they repeat.
FEWEST_TO_REPEAT = 5
#: Departure of a load cell from a straight line over its range: catalogues of strain-gauge cells
#: state 0.0002 to 0.01.
WORST_CELL = 0.05
#: A trial with less than this fraction of its throttle's usual lift had its rotors at rest.
STOPPED = 0.05


def lengths(
    n: IntArray,
    codes: list[list[str]],
    missing: float,
    samples: IntArray | None = None,
    planned: int | None = None,
) -> None:
    """Add `short` or `SHORT` to the codes of records with too few samples.

    Where a length is planned, `samples` of each record (tare included) are compared with it. Below
    ``1 - missing`` of it the trial is rejected, and any sample that lacks is remarked on. Elsewhere
    `n`, the samples averaged, are compared with their median. Below half of it a trial was aborted.
    Between there and ``1 - missing`` it is rejected only if its file is cut off. A lab may well
    measure for different times.
    """
    if planned is not None and samples is not None:
        for i, length in enumerate(samples):
            if 0 < length < planned:
                codes[i].append("SHORT" if length < (1 - missing) * planned else "short")
        return
    whole = n[n > 0]
    usual = median(whole) if len(whole) else 0.0
    for i, length in enumerate(n):
        if 0 < length < (1 - missing) * usual:
            aborted = length < 0.5 * usual or "truncated" in codes[i]
            codes[i].append("SHORT" if aborted else "short")


def planned_length(samples: IntArray, record_s: float, rate_Hz: float, missing: float) -> None:
    """Compare the usual length of the records with the planned one, `record_s` at `rate_Hz`.

    `samples` (n,) includes the tare; it is 0 for no record.

    Raises
    ------
    InputRefused
        They differ by more than the fraction `missing`. Either the rate is wrong or the plan. The
        rate that the records would have is proposed.
    """
    whole = samples[samples > 0]
    if len(whole) == 0:
        return
    usual, planned = median(whole), record_s * rate_Hz
    if abs(usual - planned) > missing * planned:
        raise InputRefused(
            "load_cell.sample_rate",
            f"the records hold {usual:.0f} samples (the median of {len(whole)}), where {record_s:g}"
            f" s at {rate_Hz:g} Hz are {planned:.0f}",
            f"is the rate {usual / record_s:.4g} Hz? or correct `record`, which"
            " counts the tare, under [load_cell]",
        )


def far_lifts(table: Mapping[str, NDArray[Any]]) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Boundary -> (throttles rising, median lift in N of the good trials farthest from it).

    Farthest per (boundary, throttle), since not every throttle is run at every station.
    """
    good = ~rejected(table["quality"]) & np.isfinite(table["lift_N"])
    far = {}
    for side in dict.fromkeys(table["boundary"][good]):
        here = good & (table["boundary"] == side)
        throttles = distinct(table["throttle"][here])
        lifts = np.empty(len(throttles))
        for i, throttle in enumerate(throttles):
            level = here & (table["throttle"] == throttle)
            lifts[i] = median(
                table["lift_N"][level & (table["z_hat"] == table["z_hat"][level].max())]
            )
        far[side] = throttles, lifts
    return far


def against_weight(table: Mapping[str, NDArray[Any]], weight_N: float, unit: str, key: str) -> None:
    """Refuse forces that cannot belong to a vehicle of this weight (mass times gravity).

    `unit` is what they were read in, ``"count"`` where a calibration made them, and is at `key`
    of the manifest.

    Raises
    ------
    InputRefused
        The largest far lift is more than 15 times the weight, or negative. Or it is less than a
        hundredth (a quarter at a throttle of 75 % and more).
    """
    levels = [
        (side, throttle, lift)
        for side, (throttles, lifts) in far_lifts(table).items()
        for throttle, lift in zip(throttles, lifts, strict=True)
    ]
    if not levels:
        return
    side, throttle, lift = max(levels, key=lambda level: abs(level[2]))
    place = f"far from the {side}" if side != "none" else "in free air"
    ratio = lift / weight_N
    if abs(ratio) > STRONGEST or abs(ratio) < (
        WEAKEST if throttle >= HIGH_THROTTLE else 1 / TOO_HEAVY
    ):
        raise InputRefused(
            key,
            f"{place} at {100 * throttle:.0f} % throttle the lift is {lift:.4g} N, {abs(ratio):.3g}"
            f" times the weight of {weight_N:.4g} N",
            _other_unit(lift, weight_N, unit),
        )
    if ratio < 0:
        raise InputRefused(
            key,
            f"{place} at {100 * throttle:.0f} % throttle the lift is negative ({lift:.4g} N)",
            "lift pulls the cell the other way: change the sign of [records] force",
        )


def _other_unit(lift: float, weight: float, unit: str) -> str:
    """The units that would make of it 0.3 to 10 times the weight, and how many times."""
    if unit == "count":
        return (
            f"check the calibration's gain (off by about {abs(lift) / weight:.2g}?) and [vehicle]"
            " mass"
        )
    mass = "or correct [vehicle] mass"
    here, _ = units.to_si(unit, "force", "force")
    number = abs(lift) / here
    fitting = [u for u in units.plausible(number, "force", 0.3 * weight, 10 * weight) if u != unit]
    if not fitting:
        return f"no usual unit makes sense of it; check the unit {mass}"
    ratios = [units.to_si(u, "force", "force")[0] * number / weight for u in fitting]
    said = ", or ".join(
        f'"{u}" ({r:.2g} times the weight)' for u, r in zip(fitting, ratios, strict=True)
    )
    return f'is the unit {said}, rather than "{unit}"? {mass}'


def implausible(lift_N: FloatArray, weight_N: float) -> BoolArray:
    """Mask of single trials beyond a hundred times the weight, in a plausible campaign."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(lift_N) > TOO_HEAVY * weight_N)


def not_rising(table: Mapping[str, NDArray[Any]]) -> list[tuple[str, float, float, float, float]]:
    """Throttles over which far lift does not rise: (boundary, lower, upper, lift below, above)."""
    return [
        (side, float(throttles[i]), float(throttles[i + 1]), float(lifts[i]), float(lifts[i + 1]))
        for side, (throttles, lifts) in far_lifts(table).items()
        for i in np.flatnonzero(np.diff(lifts) <= 0)
    ]


def without_reference(table: Mapping[str, NDArray[Any]]) -> list[tuple[str, float, float, float]]:
    """Throttles without a lift far from the boundary: (boundary, throttle, its farthest z_hat, the
    boundary's farthest).

    Half of the boundary's farthest station is far enough, and so is free air.
    """
    good = ~rejected(table["quality"])
    free = set(table["throttle"][good & (table["boundary"] == "none")])
    lacking = []
    for side in dict.fromkeys(table["boundary"][good & (table["boundary"] != "none")]):
        here = good & (table["boundary"] == side)
        farthest = float(table["z_hat"][here].max())
        for level in distinct(table["throttle"][here]):
            far = float(table["z_hat"][here & (table["throttle"] == level)].max())
            if far < 0.5 * farthest and level not in free:
                lacking.append((str(side), float(level), far, farthest))
    return lacking


def only_near(table: Mapping[str, NDArray[Any]]) -> list[tuple[str, float]]:
    """Ground and ceiling from which no trial is farther than `REACH` radii, if none is in free air:
    (boundary, its farthest z_hat).
    """
    good = ~rejected(table["quality"])
    if (good & (table["boundary"] == "none")).any():
        return []
    near = []
    for side in ("ground", "ceiling"):
        z_hat = table["z_hat"][good & (table["boundary"] == side)]
        if len(z_hat) and z_hat.max() < REACH:
            near.append((side, float(z_hat.max())))
    return near


def without_lift(table: Mapping[str, NDArray[Any]]) -> BoolArray:
    """Trials whose lift is not positive, or under a twentieth of their throttle's median."""
    lift = np.asarray(table["lift_N"], dtype=float)
    good = ~rejected(table["quality"]) & np.isfinite(lift)
    usual = np.full(len(lift), np.nan)
    for throttle in distinct(table["throttle"]):
        here = table["throttle"] == throttle
        if (good & here).any():
            usual[here] = median(lift[good & here])
    with np.errstate(invalid="ignore"):
        return np.asarray(good & ((lift <= 0) | (lift < STOPPED * usual)))


def other_throttle(table: Mapping[str, NDArray[Any]]) -> BoolArray:
    """Trials that lift as those of another throttle do at their place: their label may be wrong.

    Such a trial is more than six times the usual scatter off its own throttle's median. It is
    within three times of another's. Each throttle has five trials or more. A supply that sags moves
    lift too, but not onto another throttle whose trials repeat well.
    """
    lift = np.asarray(table["lift_N"], dtype=float)
    good = np.flatnonzero(~rejected(table["quality"]) & np.isfinite(lift))
    mislabelled = np.zeros(len(lift), dtype=bool)
    place = numbered_pairs(table["boundary"][good].astype(str), table["z_hat"][good])
    ends = np.cumsum(np.bincount(place, minlength=1))[:-1]
    for here in np.split(good[np.argsort(place, kind="stable")], ends):
        throttle = table["throttle"][here]
        levels = [
            t for t in distinct(throttle) if np.count_nonzero(throttle == t) >= FEWEST_TO_REPEAT
        ]
        repeats = [lift[here][throttle == t] for t in levels]
        medians = np.array([median(values) for values in repeats])
        away = [np.abs(v - m) for v, m in zip(repeats, medians, strict=True)]
        scatter = np.array([SD_PER_MAD * median(values) for values in away])
        for k, level in enumerate(levels):
            trials = here[throttle == level]
            off = np.abs(lift[trials, None] - medians)
            mislabelled[trials] = (off[:, k] > 6 * scatter[k]) & np.any(
                np.delete(off, k, axis=1) < 3 * np.delete(scatter, k), axis=1
            )
    return mislabelled


def odd_weight(
    table: Mapping[str, NDArray[Any]], weight_N: float, unit: str, key: str
) -> list[str]:
    """A note where the largest far lift is possible, but unusual: gf for mN is a factor of ten."""
    peaks = [float(np.max(lifts)) for _, lifts in far_lifts(table).values()]
    if not peaks or ODD[0] < max(peaks) / weight_N < ODD[1]:
        return []
    ratio = max(peaks) / weight_N
    note = (
        f"the largest lift far away is {ratio:.3g} times the weight, which is unusual;"
        f" {_other_unit(max(peaks), weight_N, unit)} ({key} is {unit})"
    )
    return [note]


def overstated(table: Mapping[str, NDArray[Any]], campaign: Campaign) -> list[str]:
    """Notes on errors declared as large as what they are of (the least distance, the largest lift),
    and on a cell worse than any.
    """
    good = ~rejected(table["quality"])
    least_m = campaign.vehicle.rotor_radius * float(np.min(table["z_hat"][good], initial=np.inf))
    most_N = float(np.max(table["lift_N"][good], initial=0.0))
    notes = []
    for u in campaign.uncertainty:
        key = f"[[uncertainty]] {u.name!r}: value = {u.value!r}"
        if u.on == "height" and u.standard() >= least_m:
            notes.append(
                f"{key} is no less than the least distance, {1e3 * least_m:.3g} mm, at which the"
                " rotor would have struck: is the unit right?"
            )
        if u.on == "force" and u.standard() >= most_N > 0:
            notes.append(
                f"{key} is no less than the largest lift, {1e3 * most_N:.3g} mN: is the unit right?"
            )
    accuracy, full = campaign.load_cell.accuracy, campaign.load_cell.range
    if accuracy is None:
        return notes
    if full is None:
        notes.append(
            f"load_cell.accuracy = {1e3 * accuracy:.3g} mN is that of the straight line at"
            " full range, and counts for nothing without `range`"
        )
    elif accuracy > WORST_CELL * full:
        notes.append(
            f"load_cell.accuracy = {1e3 * accuracy:.3g} mN is {accuracy / full:.0%}"
            f" of `range`, {1e3 * full:.3g} mN, where cells have 0.02 to 1 % (more than"
            f" {WORST_CELL:.0%} is noted): is it the departure from a straight line, and in that"
            " unit?"
        )
    return notes


def mostly_unsettled(table: Mapping[str, NDArray[Any]]) -> list[str]:
    """A note where most records begin with another force than they go on with: their rotors-stopped
    head was not taken off.
    """
    good = ~rejected(table["quality"])
    begins = np.array(["unsettled" in text.split() for text in table["quality"]])
    if not good.any() or (share := np.mean(begins[good])) < 0.5:
        return []
    note = (
        f"{share:.0%} of the records begin with another force than they go on with: is `tare` or"
        " `settle` too short (rotors still at rest), or is sample_rate wrong?"
    )
    return [note]
