"""One record to one number: tare removed, settling dropped, mean, its standard error, and what is
wrong with the samples.

The standard error is from batch means (`reduction.mean_noise`), which also tell of noise that
outlasts a batch (`reduction.slow_noise`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from nearlift.campaign.segments import FEWEST_SAMPLES
from nearlift.declare import FloatArray
from nearlift.reduction import contamination
from nearlift.reduction.conditions import Conditions
from nearlift.reduction.mean_noise import outlasting, slope_of, spectral_density_at_zero
from nearlift.reduction.samples import (
    LARGEST_N,
    clipped,
    clock_codes,
    forces,
    stuck,
    without_strays,
)
from nearlift.reduction.stretch import SD_PER_MAD, Stretch, median
from nearlift.reduction.tare import zero_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Reduced:
    """One trial's mean lift and how well the record alone knows it; columns of trials.parquet by
    the same names.

    NaN (and n = 0) where no sample was left. `n_removed` counts the readings of tare and live part
    that were left out as impossible or far from all others. `n_eff` = variance of a sample over
    variance of the mean of the live part, at most n; `u_lift_N` has the tare's standard error in
    it, which `u_zero_N` is by itself.
    """

    lift_N: float = math.nan
    u_lift_N: float = math.nan
    u_zero_N: float = math.nan
    n: int = 0
    n_removed: int = 0
    n_eff: float = math.nan
    drift_N_s: float = math.nan
    sd_N: float = math.nan
    codes: tuple[str, ...] = ()


def reduce_record(
    force_N: FloatArray,
    conditions: Conditions,
    *,
    time_s: FloatArray | None = None,
    tare_after_N: float = math.nan,
    tare_N: FloatArray | None = None,
    codes: tuple[str, ...] = (),
    where: str = "record",
) -> Reduced:
    """Reduce one record: lift `force_N` (n,), up positive, tare included, NaN where unreadable.

    Gaps are seen by the record's clock, `time_s` (n,), where there is one, and tare and settle then
    end by it; else by counting samples. The zero reading after the trial, `tare_after_N`, only
    judges the drift of the zero: the tare subtracted is that of the head, or, where the record is a
    piece of a longer one, `tare_N` (m,). `codes` are what the reader noticed.

    Raises
    ------
    InputRefused
        The clock runs at another rate than the manifest says (by more than 1 %, and by more than
        a sample over the record).
    """
    flags = list(codes)
    rate_Hz, range_N = conditions.rate_Hz, conditions.range_N
    tare_s, settle_s = conditions.tare_s, conditions.settle_s
    if not {"EMPTY", "NO_DATA", "MALFORMED"}.isdisjoint(flags):
        return Reduced(codes=tuple(flags))
    # a tare from elsewhere takes none of the record's own samples
    own_s = tare_s if tare_N is None else 0.0
    head = len(force_N[: round(own_s * rate_Hz)])
    start = head + round(settle_s * rate_Hz)
    if time_s is not None and len(time_s) > 2:
        flags += clock_codes(time_s, conditions, where)
        if not {"gaps", "GAPS"}.isdisjoint(flags) and "clock" not in flags:
            # a hole moves every later sample: only the clock knows where the tare ends
            since = time_s - time_s[0]
            head = int(np.count_nonzero(since < own_s - 0.5 / rate_Hz))
            start = int(np.count_nonzero(since < own_s + settle_s - 0.5 / rate_Hz))
    tare, live = force_N[:head] if tare_N is None else tare_N, force_N[start:]
    # numbers that are none are left out below
    with np.errstate(over="ignore", invalid="ignore"):
        quiet, rest = spectral_density_at_zero(tare, rate_Hz, tone=False)
        density, run = spectral_density_at_zero(live, rate_Hz)
    if not (
        math.isfinite(rest.mean + run.mean)
        and max(run.high, -run.low, rest.high, -rest.low) <= (range_N or LARGEST_N)
    ):
        whole = len(tare) + len(live)
        tare, live = forces(tare, range_N), forces(live, range_N)
        quiet, rest = spectral_density_at_zero(tare, rate_Hz, tone=False)
        density, run = spectral_density_at_zero(live, rate_Hz)
        if rest.n + run.n < whole:
            too_many = 1.0 - (rest.n + run.n) / whole > conditions.out_of_range
            flags.append("OUT_OF_RANGE" if too_many else "out_of_range")
    tare, wild_tare = _without_impossible(tare, rest, run.mean, first=False)
    live, wild = _without_impossible(live, run, rest.mean, first=True)
    if wild_tare:
        quiet, rest = spectral_density_at_zero(tare, rate_Hz, tone=False)
    if wild:
        density, run = spectral_density_at_zero(live, rate_Hz)
    flags += ["spikes"] if wild or wild_tare else []
    n = run.n
    if n < 2 or (tare_s > 0 and rest.n < 2):
        return Reduced(codes=(*flags, "NO_DATA"))
    if n < FEWEST_SAMPLES:
        return Reduced(codes=(*flags, "TOO_SHORT"))
    kept, codes_of_samples = without_strays(live, run, range_N)
    flags += codes_of_samples
    if len(kept) < n:
        live, wild = kept, wild + n - len(kept)
        density, run = spectral_density_at_zero(live, rate_Hz)
    n = run.n
    variance = run.squares / (n - 1)
    u2 = density / n
    zero, u2_tare, codes_of_tare, left_out = zero_of(tare, rest, quiet, live, run, u2, conditions)
    flags += codes_of_tare
    lift = run.mean - zero
    allowed = conditions.drift * abs(lift)
    slope, u_slope = slope_of(run, density, rate_Hz)
    flags += stuck(live, run)
    batches = run.batches
    apart = float(batches.max() - batches.min()) if len(batches) else 0.0
    if apart > allowed:
        moved, at_start = contamination.moved_by_segment(live, contamination.step_of(live))
        # rotors that still spin up are unsettled
        damaged = moved > math.sqrt(u2) and not at_start
        if damaged or contamination.stepped(batches, allowed):
            flags.append("MIXED")
    flags += clipped(live, run)
    if slow := outlasting(live, batches, u2, rate_Hz):
        u2 = slow.variance
        flags += ["slow"] if slow.is_too_long else []
    flags += _drifts(slope * n / rate_Hz, u_slope * n / rate_Hz, tare_after_N - zero, allowed)
    flags += _unsettled(batches, lift)
    return Reduced(
        lift_N=lift,
        u_lift_N=math.sqrt(u2 + u2_tare),
        u_zero_N=math.sqrt(u2_tare),
        n=n,
        n_removed=wild_tare + wild + left_out,
        n_eff=min(float(n), variance / u2) if u2 > 0 else float(n),
        drift_N_s=slope,
        sd_N=math.sqrt(variance),
        codes=tuple(dict.fromkeys(flags)),
    )


def _without_impossible(
    values: FloatArray, sums: Stretch, other: float, *, first: bool
) -> tuple[FloatArray, int]:
    """One part of a record without its impossible readings, and how many there were: each part by
    itself, so that those of one hide nothing in the other.
    """
    bad = contamination.impossible(values, sums, other, first) if sums.n > 2 else None
    return (values, 0) if bad is None else (values[~bad], int(bad.sum()))


def _unsettled(batches: FloatArray, lift: float) -> list[str]:
    """Whether the first batch is away from the others by more than a tenth of the lift.

    By the median and its scatter: a head of stopped rotors takes several batches and would hide
    behind its own spread.
    """
    if len(batches) < 3 or float(batches.max() - batches.min()) <= 0.1 * abs(lift):
        return []
    level = median(batches)
    scatter = SD_PER_MAD * median(np.abs(batches - level))
    away = abs(batches[0] - level)
    return ["unsettled"] if away > max(0.1 * abs(lift), 6 * scatter) else []


def _drifts(change: float, u_change: float, tare_change: float, allowed: float) -> list[str]:
    """Drift of the force over the record beyond chance (4 standard errors), and of the zero."""
    changes = [change] if abs(change) > 4 * u_change else []
    changes += [tare_change] if math.isfinite(tare_change) else []
    return ["DRIFT" if abs(c) > allowed else "drift" for c in changes if abs(c) > 0.2 * allowed]
