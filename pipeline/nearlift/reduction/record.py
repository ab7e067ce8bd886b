"""One record to one number: tare removed, settling dropped, mean, its standard error, and what is
wrong with the samples.

The standard error is from batch means (`reduction.mean_noise`), which also tell of noise that
outlasts a batch (`reduction.slow_noise`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearlift.campaign.rig import FEWEST_SAMPLES
from nearlift.declare import FloatArray
from nearlift.reduction import contamination
from nearlift.reduction.mean_noise import RecordPart, outlasting, part_of
from nearlift.reduction.samples import (
    FEWEST_REPEATS,
    LARGEST_N,
    Conditions,
    check_clipping,
    check_stuck,
    clock_codes,
    drop_spikes,
    valid_samples,
)
from nearlift.reduction.start import steady_after
from nearlift.reduction.stretch import SD_PER_MAD, median

#: Codes of readers for a record that holds no samples.
UNREADABLE = frozenset({"EMPTY", "NO_DATA", "MALFORMED"})
#: Single samples of a tare are left out that move the zero by more than this share of the lift's u;
#: a tare is refused that longer damage moves by more than u itself.
MATTERS = 0.5
#: Share of the lift by which a tare's ends may differ from its middle.
ROTORS = 0.1
#: Steps of the converter that a live part scatters by, from which on a tare would show some noise,
#: too.
COARSE = 100.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Reduced:
    """One trial's mean lift and how well the record alone knows it; columns of trials.parquet by
    the same names.

    NaN (and n = 0) where no sample was left. `n_removed` counts the readings of tare and live part
    that were left out as impossible or far from all others. `n_eff` = variance of a sample over
    variance of the mean of the live part, at most n. `u_lift_N` includes the tare's standard error,
    which `u_zero_N` is by itself.
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

    The record's clock, `time_s` (n,), where there is one, shows gaps and ends tare and settle; else
    samples are counted. The zero reading after the trial, `tare_after_N`, only judges the drift of
    the zero. The tare subtracted is that of the head. Where the record is a piece of a longer one,
    it is `tare_N` (m,). `codes` are what the reader noticed. Rotors that start only after tare and
    settle give `unsettled`: the mean begins where their lift is steady.

    Raises
    ------
    InputRefused
        The clock runs at another rate than the manifest says. The difference is more than 1 %, and
        more than a sample over the record.
    """
    flags, rate_Hz = list(codes), conditions.rate_Hz
    if not UNREADABLE.isdisjoint(flags):
        return Reduced(codes=tuple(flags))
    # a tare from elsewhere takes none of the record's own samples
    own_s = conditions.tare_s if tare_N is None else 0.0
    if time_s is not None and len(time_s) > 2:
        flags += clock_codes(time_s, conditions, where)
    head, start = _edges(force_N, time_s, own_s, conditions, flags)
    # numbers that are none are left out below
    with np.errstate(over="ignore", invalid="ignore"):
        tare = part_of(force_N[:head] if tare_N is None else tare_N, rate_Hz, tone=False)
        live = part_of(force_N[start:], rate_Hz, tone=True)
    tare, live, unreadable = _readable(tare, live, conditions)
    flags += unreadable
    whole, level = tare.sums.n + live.sums.n, tare.sums.mean
    tare = _without_impossible(tare, live.sums.mean, rate_Hz, first=False)
    live = _without_impossible(live, level, rate_Hz, first=True)
    n = live.sums.n
    removed = whole - tare.sums.n - n
    flags += ["spikes"] if removed else []
    if n < 2 or (conditions.tare_s > 0 and tare.sums.n < 2):
        return Reduced(codes=(*flags, "NO_DATA"))
    if n < FEWEST_SAMPLES:
        return Reduced(codes=(*flags, "TOO_SHORT"))
    kept, codes_of_samples = drop_spikes(live.values, live.sums, conditions.range_N)
    flags += codes_of_samples
    if len(kept) < n:
        removed += n - len(kept)
        live = part_of(kept, rate_Hz, tone=True)
    run, n = live.sums, live.sums.n
    variance, u2 = run.squares / (n - 1), live.density / n
    zero, u2_tare, codes_of_tare, left_out = _zero_of(tare, live, u2, conditions)
    flags += codes_of_tare
    lift = run.mean - zero
    allowed = conditions.drift * abs(lift)
    # least squares, and its standard error from the noise at low frequency
    power = n * (n**2 - 1) / 12
    slope, u_slope = run.tilt / power * rate_Hz, math.sqrt(live.density / power) * rate_Hz
    flags += check_stuck(live.values, run)
    flags += _mixed(live, u2, allowed)
    flags += check_clipping(live.values, run)
    if slow := outlasting(live.values, run.batches, u2, rate_Hz):
        u2 = slow.variance
        flags += ["slow"] if slow.is_too_long else []
    moving = _drifts(slope * n / rate_Hz, u_slope * n / rate_Hz, math.nan, allowed)
    moving += _unsettled(run.batches, lift)
    if moving and tare_N is None and (later := steady_after(force_N, start, rate_Hz)):
        # the rotors started only after tare and settle
        late = replace(conditions, settle_s=conditions.settle_s + later / rate_Hz)
        settled = reduce_record(
            force_N, late, time_s=time_s, tare_after_N=tare_after_N, codes=codes, where=where
        )
        return replace(settled, codes=tuple(dict.fromkeys((*settled.codes, "unsettled"))))
    flags += _drifts(math.nan, math.inf, tare_after_N - zero, allowed) + moving
    return Reduced(
        lift_N=lift,
        u_lift_N=math.sqrt(u2 + u2_tare),
        u_zero_N=math.sqrt(u2_tare),
        n=n,
        n_removed=removed + left_out,
        n_eff=min(float(n), variance / u2) if u2 > 0 else float(n),
        drift_N_s=slope,
        sd_N=math.sqrt(variance),
        codes=tuple(dict.fromkeys(flags)),
    )


def _edges(
    force_N: FloatArray,
    time_s: FloatArray | None,
    own_s: float,
    conditions: Conditions,
    codes: Sequence[str],
) -> tuple[int, int]:
    """The samples of the tare, and the first one that is settled."""
    rate_Hz = conditions.rate_Hz
    gaps = {"gaps", "GAPS"} & {*codes} and "clock" not in codes
    if gaps and time_s is not None and len(time_s) > 2:
        # a hole moves every later sample: only the clock knows where the tare ends
        since = time_s - time_s[0]
        ends = own_s, own_s + conditions.settle_s
        head, start = (int(np.count_nonzero(since < end - 0.5 / rate_Hz)) for end in ends)
        return head, start
    head = len(force_N[: round(own_s * rate_Hz)])
    return head, head + round(conditions.settle_s * rate_Hz)


def _readable(
    tare: RecordPart, live: RecordPart, conditions: Conditions
) -> tuple[RecordPart, RecordPart, list[str]]:
    """Both parts without the samples that hold no number, clipped to the cell's range."""
    sums, rate_Hz, range_N = (tare.sums, live.sums), conditions.rate_Hz, conditions.range_N
    largest = max(max(s.high, -s.low) for s in sums)
    if math.isfinite(sums[0].mean + sums[1].mean) and largest <= (range_N or LARGEST_N):
        return tare, live, []
    whole = len(tare.values) + len(live.values)
    tare = part_of(valid_samples(tare.values, range_N), rate_Hz, tone=False)
    live = part_of(valid_samples(live.values, range_N), rate_Hz, tone=True)
    lost = whole - tare.sums.n - live.sums.n
    if not lost:
        return tare, live, []
    too_many = 1.0 - (whole - lost) / whole > conditions.out_of_range
    return tare, live, ["OUT_OF_RANGE" if too_many else "out_of_range"]


def _without_impossible(
    part: RecordPart, other: float, rate_Hz: float, *, first: bool
) -> RecordPart:
    """One part of a record without its impossible readings, judged by itself, so that those of one
    part hide nothing in the other.
    """
    few = part.sums.n <= 2
    bad = None if few else contamination.impossible(part.values, part.sums, other, first)
    # the live part is the first to border on the other, and has a tone
    return part if bad is None else part_of(part.values[~bad], rate_Hz, tone=first)


def _zero_of(
    at_rest: RecordPart, lifting: RecordPart, u2_live: float, conditions: Conditions
) -> tuple[float, float, list[str], int]:
    """The tare's mean, its variance, codes, and how many samples were left out: single samples that
    are far from the others. A tare that is not one level is refused.

    Both only where it matters against the lift's own uncertainty; the plain mean else, which is the
    better one. Where the level wanders from its middle, so far may the trial's zero be from the
    mean: that is in the variance.
    """
    tare, quiet, rest = at_rest
    live, _, run = lifting
    if rest.n == 0:
        return rest.mean, 0.0, [], 0
    rate_Hz = conditions.rate_Hz
    zero, u2, codes, left_out = rest.mean, quiet / rest.n, [], 0
    noise = math.sqrt(run.squares / (run.n - 1))
    repeats = rest.n >= contamination.SMALL_SAMPLE and rest.repeats >= FEWEST_REPEATS * rest.n
    # one value repeats, though the converter would show some noise
    if repeats and check_stuck(tare, rest) and noise > COARSE * contamination.step_of(live):
        return zero, u2, ["STUCK"], 0
    single, uneven = contamination.suspicious(tare, rest)
    single = single and bool(contamination.far_samples(tare, 0.0).any())
    step = contamination.step_of(live) if single or uneven else 0.0
    if single and (far := contamination.far_samples(tare, step)).any():
        _, density, kept = part_of(tare[~far], rate_Hz, tone=False)
        moved, u = zero - kept.mean, math.sqrt(u2_live + density / kept.n)
        isolated = contamination.are_single(far)
        if abs(moved) > u and not isolated:
            return zero, u2, ["TARE"], 0
        if abs(moved) > MATTERS * u and isolated:
            tare, zero, u2, codes = tare[~far], kept.mean, density / kept.n, ["spikes"]
            left_out = int(far.sum())
    if uneven:
        damaged = contamination.moved_by_segment(tare, step)[0] > math.sqrt(u2_live + u2)
        # rotors that run down or up need not have an edge
        if damaged or contamination.ends_apart(tare, step) > ROTORS * abs(run.mean - zero):
            return zero, u2, ["TARE"], 0
    means = contamination.blocks(tare)
    slow = outlasting(tare, means, u2, rate_Hz, tone=False)
    if (away := contamination.slow_drift(tare, means, 0.0)) > MATTERS * math.sqrt(
        u2_live + u2
    ) and (away := contamination.slow_drift(tare, means, contamination.step_of(live))):
        codes = [*codes, "DRIFT" if away > conditions.drift * abs(run.mean - zero) else "drift"]
        u2 += away**2
    if slow and slow.variance > u2:
        u2 = slow.variance
        if slow.is_too_long and not codes and u2 > MATTERS**2 * u2_live:
            codes.append("slow")
    return zero, u2, codes, left_out


def _mixed(live: RecordPart, u2: float, allowed: float) -> list[str]:
    """Whether the force steps from one level to another, or a block of it is damaged."""
    batches = live.sums.batches
    apart = float(batches.max() - batches.min()) if len(batches) else 0.0
    if not apart > allowed:
        return []
    moved, at_start = contamination.moved_by_segment(
        live.values, contamination.step_of(live.values)
    )
    # rotors that still spin up are unsettled
    damaged = moved > math.sqrt(u2) and not at_start
    return ["MIXED"] if damaged or contamination.stepped(batches, allowed) else []


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
