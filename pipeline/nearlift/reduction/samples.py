"""Samples of a record that are no force, outliers, repeat one value, or came at a wrong time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.declare import BoolArray, FloatArray
from nearlift.errors import InputRefused
from nearlift.reduction import contamination
from nearlift.reduction.stretch import Stretch, steady, usual_step

#: No force: beyond it numbers are damage, whatever the load cell.
LARGEST_N = 1e9
#: At the end of its range is a cell from this share of it on; so many samples may be there, and so
#: large a share of them.
END_OF_RANGE, FEW_AT_END, SHARE_AT_END = 0.98, 3, 0.001
#: Standard deviations beyond which a sample of the live part is looked at.
FAR = 6.0
#: Share of the samples that repeat the one before from which on a channel may be still.
FEWEST_REPEATS = 0.1
HOUR_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Nominal sample rate, rotors-stopped head, settling time and limits of the quality codes.

    `range_N` is the capacity of the load cell. The fractions are from ``[quality]``. `drift` is the
    largest drift over the record, as a fraction of the trial's lift. `missing` is the fraction of
    the samples that may be absent. `out_of_range` is the fraction that may hold no number.
    """

    rate_Hz: float
    tare_s: float = 0.0
    settle_s: float = 0.0
    drift: float = 0.05
    missing: float = 0.05
    out_of_range: float = 0.01
    range_N: float | None = None


def valid_samples(values: FloatArray, range_N: float | None) -> FloatArray:
    """The samples that hold a number, clipped to the cell's range; unless most are beyond it, which
    shows another unit than the manifest's.
    """
    with np.errstate(invalid="ignore"):
        finite = values[np.abs(values) <= LARGEST_N]
    if range_N is None or 2 * np.count_nonzero(np.abs(finite) > range_N) > len(finite):
        return finite
    return np.clip(finite, -range_N, range_N)


def drop_spikes(
    live: FloatArray, run: Stretch, range_N: float | None
) -> tuple[FloatArray, list[str]]:
    """The samples without the few far from the rest or at the end of the range, and their codes."""
    outlying, codes = np.zeros(0, dtype=bool), []
    if range_N is not None and max(run.high, -run.low) >= END_OF_RANGE * range_N:
        outlying = np.abs(live) >= END_OF_RANGE * range_N
        if np.count_nonzero(outlying) > max(FEW_AT_END, SHARE_AT_END * run.n):
            return live, ["SATURATED"]
        codes.append("saturated")
    if run.far:
        far = _far(live)
        if far.any():
            outlying = outlying | far if len(outlying) else far
            codes.append("spikes")
    return (live[~outlying] if codes else live), codes


def _far(live: FloatArray) -> BoolArray:
    """Mask of the few samples over six standard deviations off, even hidden by larger ones."""
    far = np.zeros(len(live), dtype=bool)
    hidden = contamination.HIDDEN * contamination.step_of(live)
    for _ in range(5):
        rest = live[~far]
        more = np.abs(live - rest.mean()) > FAR * max(float(rest.std()), hidden)
        if far.sum() == more.sum():
            break
        far = more
    # rotors that still spin up are no outliers
    far[: int(np.argmin(far))] = False
    return far if far.mean() <= contamination.LARGEST_SHARE else np.zeros(len(live), dtype=bool)


def check_stuck(live: FloatArray, run: Stretch) -> list[str]:
    """A channel that repeats one value."""
    n = run.n
    if run.high == run.low:
        return ["STUCK"]
    # a coarse cell repeats itself all the time: then a long run means nothing
    if run.repeats > FEWEST_REPEATS * n:
        same = live[1:] == live[:-1]
        longest = contamination.longest_run(same) + 1
        elsewhere = np.count_nonzero(~same) / max(n - longest, 1)
        if longest >= 20 and longest > 0.1 * n and elsewhere > 0.5:
            return ["STUCK"]
    return []


def check_clipping(live: FloatArray, run: Stretch) -> list[str]:
    """Whether the record is clipped, somewhere below the cell's range.

    It is where it stays at its own extreme for ten samples in a row. Where the tone brings it there
    and back, one sample in two hundred is enough if hardly any other value occurs twice. A coarse
    cell repeats itself anywhere.
    """
    n = run.n
    if run.repeats < 9:
        return []
    for extreme, count in ((run.high, run.at_high), (run.low, run.at_low)):
        if 10 <= count < 0.9 * n:
            held = (
                contamination.longest_run(live == extreme) >= 10 and run.repeats < count + 0.2 * n
            )
            often = count >= 0.005 * n and run.repeats < count + 0.02 * n
            if held or often:
                return ["SATURATED"]
    return []


# a damaged clock may hold anything: it then has no steady rate
@np.errstate(over="ignore", invalid="ignore")
def clock_codes(time_s: FloatArray, conditions: Conditions, where: str) -> list[str]:
    """Gaps and stumbles of a clock column.

    A clock that runs at another rate, by more than 1 % and by more than a sample over the whole, is
    refused.
    """
    rate_Hz = conditions.rate_Hz
    if steady(time_s, rate_Hz):
        return []
    codes: list[str] = []
    steps = time_s[1:] - time_s[:-1]
    shortest, longest = float(steps.min()) * rate_Hz, float(steps.max()) * rate_Hz
    # summer time begins or ends: the clock was set by whole hours, and no sample lacks
    hours = np.round(steps / HOUR_S)
    was_set = (hours != 0) & (np.abs(steps - HOUR_S * hours) < 1.5 / rate_Hz)
    if was_set.any():
        codes, steps = ["clock"], np.where(was_set, steps - HOUR_S * hours, steps)
        shortest, longest = float(steps.min()) * rate_Hz, float(steps.max()) * rate_Hz
    usual = usual_step(steps) * rate_Hz
    # a few steps of a clock that jitters do not tell its rate to a hundredth
    if not abs(usual - 1.0) <= max(0.01, 1 / len(steps)):
        rate = f"{rate_Hz / usual:.6g} Hz" if usual > 0 else "no steady rate"
        raise InputRefused(
            where,
            f"the clock column runs at {rate}, the manifest says {rate_Hz:g} Hz",
            "correct [load_cell] sample_rate, or the unit under [records] time",
        )
    if shortest <= 0.0 and not codes:
        codes.append("clock")
    lost = round(float(steps.sum()) * rate_Hz / usual) + 1 - len(time_s)
    if lost > 0 and longest > 1.5:
        codes.append("GAPS" if lost > conditions.missing * (len(time_s) + lost) else "gaps")
    return codes
