"""One record to one number: tare removed, settling dropped, mean, its standard error, and what is
wrong with the samples.

The standard error is made from batch means. A rotor tone (61 Hz and its like) is no noise of the
mean: it averages out within each batch, while estimators that add up autocorrelations are fooled by
it. Three choices make the batches right:

* they are long, a sixteenth of the record (an eighth of the tare) and at least 60 ms, so that slow
  noise is counted: u is 4 % low where the noise remembers for a twelfth of the tare's batch, 13 %
  for a fifth (measured in tests/unit/test_record.py);
* each is weighted with a Hann window, so that a tone which does not fit a whole number of times
  leaks 30 dB less than from plain batches. For white noise the weighted means have ``sum(w^2) /
  sum(w)^2`` of the samples' variance, which is divided out;
* they overlap by half, which wins back the efficiency that the window costs.

What results is the noise's spectral density at frequency zero, S0 (N^2 per sample), and u^2 = S0 /
n. Where batches far apart are alike, noise outlasts a batch: `nearlift.reduction.slow_noise` then
says how far the mean is off, and the code `slow` tells where no record of this length can.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.reduction import contamination, slow_noise
from nearlift.reduction.slow_noise import SlowNoise
from nearlift.reduction.steps import stepped
from nearlift.reduction.stretch import SD_PER_MAD, STEADY, STRETCH, Stretch, median, steady, stretch

BATCHES = 16
TARE_BATCHES = 8
SHORTEST_BATCH_S = 0.06
SHORTEST_BATCH = 8
FEWEST_BATCHES = 4
#: Aborted runs leave two to four rows behind.
FEWEST_SAMPLES = 5
#: No force: beyond it numbers are damage, whatever the load cell.
LARGEST_N = 1e9
#: At the end of its range is a cell from this share of it on; so many samples may be there, and so
#: large a share of them.
END_OF_RANGE, FEW_AT_END, SHARE_AT_END = 0.98, 3, 0.001
#: Standard deviations beyond which a sample of the live part is looked at.
FAR = 6.0
#: Single samples of a tare are left out that move the zero by more than this share of the lift's u;
#: a tare is refused that longer damage moves by more than u itself.
MATTERS = 0.5
#: Share of the lift by which a tare's ends may differ from its middle.
ROTORS = 0.1
#: Share of the samples that repeat the one before from which on a channel may stand still.
FEWEST_REPEATS = 0.1
#: Steps of the converter that a live part scatters by, from which on a tare would show some noise,
#: too.
COARSE = 100.0
HOUR_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What the quality codes are judged by.

    Attributes
    ----------
    drift, missing, out_of_range : float
        Fractions, from ``[quality]``: of the trial's lift that the drift over the record may reach;
        of the samples that may be absent; of the samples that may hold no number.
    range_N : float or None
        Capacity of the load cell.
    """

    drift: float = 0.05
    missing: float = 0.05
    out_of_range: float = 0.01
    range_N: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reduced:
    """One trial's mean lift and how well the record alone knows it; columns of trials.parquet by
    the same names.

    NaN (and n = 0) where no sample was left. `n_eff` = variance of a sample over variance of the
    mean of the live part, at most n; `u_lift_N` has the tare's standard error in it.
    """

    lift_N: float = math.nan
    u_lift_N: float = math.nan
    n: int = 0
    n_eff: float = math.nan
    drift_N_s: float = math.nan
    sd_N: float = math.nan
    codes: tuple[str, ...] = ()


def reduce_record(
    force_N: FloatArray,
    *,
    rate_Hz: float,
    tare_s: float = 0.0,
    settle_s: float = 0.0,
    time_s: FloatArray | None = None,
    tare_after_N: float = math.nan,
    limits: Limits = Limits(),
    codes: tuple[str, ...] = (),
    where: str = "record",
) -> Reduced:
    """Reduce one record.

    Parameters
    ----------
    force_N : (n,) float array
        Lift, up positive, tare included; NaN where unreadable.
    rate_Hz, tare_s, settle_s : float
        Nominal sample rate; rotors-stopped head; what is discarded after it.
    time_s : (n,) float array, optional
        The record's clock. Gaps are seen by it, and tare and settle then end by it; else by
        counting samples.
    tare_after_N : float
        Zero reading after the trial. It only judges the drift of the zero; the tare subtracted is
        that of the head.
    codes : tuple of str
        What the reader noticed.

    Raises
    ------
    InputRefused
        The clock runs at another rate than the manifest says (by more than 1 %).
    """
    found = list(codes)
    if not {"EMPTY", "NO_DATA", "MALFORMED"}.isdisjoint(found):
        return Reduced(codes=tuple(found))
    head = len(force_N[: round(tare_s * rate_Hz)])
    start = head + round(settle_s * rate_Hz)
    if time_s is not None and len(time_s) > 2:
        found += _clock(time_s, rate_Hz, limits, where)
        if not {"gaps", "GAPS"}.isdisjoint(found) and "clock" not in found:
            # a hole moves every later sample: only the clock knows where the tare ends
            since = time_s - time_s[0]
            head = int(np.count_nonzero(since < tare_s - 0.5 / rate_Hz))
            start = int(np.count_nonzero(since < tare_s + settle_s - 0.5 / rate_Hz))
    tare, live = force_N[:head], force_N[start:]
    # numbers that are none are left out below
    with np.errstate(over="ignore", invalid="ignore"):
        (quiet, rest), (density, run) = (
            spectral_density_at_zero(tare, rate_Hz, tone=False),
            spectral_density_at_zero(live, rate_Hz),
        )
    if not (
        math.isfinite(rest.mean + run.mean)
        and max(run.high, -run.low, rest.high, -rest.low) <= (limits.range_N or LARGEST_N)
    ):
        whole = len(tare) + len(live)
        tare, live = _forces(tare, limits.range_N), _forces(live, limits.range_N)
        (quiet, rest), (density, run) = (
            spectral_density_at_zero(tare, rate_Hz, tone=False),
            spectral_density_at_zero(live, rate_Hz),
        )
        if rest.n + run.n < whole:
            found.append(
                "OUT_OF_RANGE"
                if 1.0 - (rest.n + run.n) / whole > limits.out_of_range
                else "out_of_range"
            )
    n = run.n
    if n < 2 or (tare_s > 0 and rest.n < 2):
        return Reduced(codes=(*found, "NO_DATA"))
    if n < FEWEST_SAMPLES:
        return Reduced(codes=(*found, "TOO_SHORT"))
    worth = 0.0
    kept, codes_of_samples = _without_strays(live, run, limits.range_N)
    found += codes_of_samples
    if len(kept) < n:
        # the mean with them and without them: what they are worth is not known to be nothing
        live, worth = kept, run.mean - float(kept.mean())
        density, run = spectral_density_at_zero(live, rate_Hz)
    n = run.n
    variance = run.squares / (n - 1)
    sd = math.sqrt(variance)
    u2 = density / n + worth**2
    zero, u2_tare, codes_of_tare = _zero(tare, rest, quiet, live, run, u2, rate_Hz, limits)
    found += codes_of_tare
    lift = run.mean - zero
    slope, u_slope = _slope(run, density, rate_Hz)
    found += _stuck(live, run)
    batches = run.batches
    if len(batches) and float(batches.max() - batches.min()) > limits.drift * abs(lift):
        moved, at_start = contamination.moved_by_segment(live, contamination.step_of(live))
        # rotors that still spin up are unsettled
        if stepped(batches, limits.drift * abs(lift)) or (moved > math.sqrt(u2) and not at_start):
            found.append("MIXED")
    found += _clipped(live, run)
    if slow := _slow_noise(live, run.batches, u2, rate_Hz):
        u2 = slow.variance
        found += ["slow"] if slow.is_too_long else []
    found += _drifts(lift, slope * n / rate_Hz, u_slope * n / rate_Hz, tare_after_N - zero, limits)
    if len(batches) > 2 and float(batches.max() - batches.min()) > 0.1 * abs(lift):
        # the median and its scatter, for a head of stopped rotors takes several batches and would
        # hide behind its own spread
        level = median(batches)
        scatter = SD_PER_MAD * median(np.abs(batches - level))
        if abs(batches[0] - level) > max(0.1 * abs(lift), 6 * scatter):
            found.append("unsettled")
    return Reduced(
        lift_N=lift,
        u_lift_N=math.sqrt(u2 + u2_tare),
        n=n,
        n_eff=min(float(n), variance / u2) if u2 > 0 else float(n),
        drift_N_s=slope,
        sd_N=sd,
        codes=tuple(dict.fromkeys(found)),
    )


def prepare() -> None:
    """Make what is compiled ready."""
    for kernel in (STRETCH, STEADY, contamination.LOOK):
        kernel.prepare()


def spectral_density_at_zero(
    values: FloatArray, rate_Hz: float, *, tone: bool = True
) -> tuple[float, Stretch]:
    """Variance of the mean times n, N^2, and the stretch with the batch means that it was made
    from.

    Parameters
    ----------
    values : (n,) float array
        Samples.
    tone : bool
        Whether the rotors ran. A tare has no tone; it is shorter, so it is cut into fewer batches
        to keep them long.

    Notes
    -----
    Biased low by noise whose correlation time is not short beside a batch, as every estimate from
    one record is.
    """
    n = len(values)
    shortest = max(SHORTEST_BATCH, math.ceil(SHORTEST_BATCH_S * rate_Hz) if tone else 0)
    half = max(n // (BATCHES if tone else TARE_BATCHES), min(shortest, n // FEWEST_BATCHES)) // 2
    found = stretch(values, half if half >= 2 else 0)
    if half < 2:
        return found.squares / max(n - 1, 1), found
    means = found.batches
    # each mean is taken from the record's own mean, which shares 1/n of its variance
    # not by BLAS: a record that will be rejected may hold inf
    return float(np.add.reduce(means * means)) / len(means) / (found.gain - 1.0 / n), found


def _slow_noise(
    values: FloatArray, means: FloatArray, u2: float, rate_Hz: float, *, tone: bool = True
) -> SlowNoise | None:
    """Slow noise, where means of batches or blocks raise the suspicion and it is worth more than
    `u2`.
    """
    if not slow_noise.suspected(means):
        return None
    # a tone leaks less from longer batches
    shortest = max(SHORTEST_BATCH, math.ceil(SHORTEST_BATCH_S * rate_Hz) if tone else 0)
    finer = stretch(values, max(len(values) // slow_noise.SEGMENTS, shortest // 2))
    slow = slow_noise.slow_noise(finer.batches)
    return slow if slow is not None and slow.variance > u2 else None


def _slope(run: Stretch, density: float, rate_Hz: float) -> tuple[float, float]:
    """Least-squares slope, N/s, and its standard error from the noise at low frequency."""
    power = run.n * (run.n**2 - 1) / 12
    return run.tilt / power * rate_Hz, math.sqrt(density / power) * rate_Hz


def _drifts(
    lift: float, change: float, u_change: float, tare_change: float, limits: Limits
) -> list[str]:
    """Drift of the force over the record, if it is no chance (4 standard errors), and of
    the zero.
    """
    allowed = limits.drift * abs(lift)
    found = []
    if abs(change) > 4 * u_change:
        found += (
            ["DRIFT"] if abs(change) > allowed else ["drift"] if abs(change) > 0.2 * allowed else []
        )
    if math.isfinite(tare_change):
        found += (
            ["DRIFT"]
            if abs(tare_change) > allowed
            else ["drift"]
            if abs(tare_change) > 0.2 * allowed
            else []
        )
    return found


def _forces(values: FloatArray, range_N: float | None) -> FloatArray:
    """The samples that hold a number, clipped to the cell's range; unless most are beyond it, which
    tells of another unit than the manifest's.
    """
    with np.errstate(invalid="ignore"):
        forces = values[np.abs(values) <= LARGEST_N]
    if range_N is None or 2 * np.count_nonzero(np.abs(forces) > range_N) > len(forces):
        return forces
    return np.clip(forces, -range_N, range_N)


def _without_strays(
    live: FloatArray, run: Stretch, range_N: float | None
) -> tuple[FloatArray, list[str]]:
    """The samples without the few that stand far from the rest or at the end of the cell's range,
    and what is said of them.
    """
    stray, found = np.zeros(0, dtype=bool), []
    if range_N is not None and max(run.high, -run.low) >= END_OF_RANGE * range_N:
        stray = np.abs(live) >= END_OF_RANGE * range_N
        if np.count_nonzero(stray) > max(FEW_AT_END, SHARE_AT_END * run.n):
            return live, ["SATURATED"]
        found.append("saturated")
    if run.far:
        far = _far(live)
        if far.any():
            stray = stray | far if len(stray) else far
            found.append("spikes")
    return (live[~stray] if found else live), found


def _far(live: FloatArray) -> NDArray[np.bool_]:
    """Mask of the few samples more than six standard deviations off, those aside that hide behind
    larger ones being found, too.
    """
    far, hidden = (
        np.zeros(len(live), dtype=bool),
        contamination.HIDDEN * contamination.step_of(live),
    )
    for _ in range(5):
        rest = live[~far]
        more = np.abs(live - rest.mean()) > FAR * max(float(rest.std()), hidden)
        if far.sum() == more.sum():
            break
        far = more
    # rotors that still spin up are no stray samples
    far[: int(np.argmin(far))] = False
    return far if far.mean() <= contamination.LARGEST_SHARE else np.zeros(len(live), dtype=bool)


def _zero(
    tare: FloatArray,
    rest: Stretch,
    quiet: float,
    live: FloatArray,
    run: Stretch,
    u2_live: float,
    rate_Hz: float,
    limits: Limits,
) -> tuple[float, float, list[str]]:
    """The tare's mean, its variance, and codes: single samples that stand apart are left out, a
    tare that is not one level is refused.

    Both only where it matters beside the lift's own uncertainty; the plain mean else, which is the
    better one. Where the level wanders from its middle, so far may the trial's zero be from the
    mean: that is in the variance.
    """
    if rest.n == 0:
        return rest.mean, 0.0, []
    zero, u2, found = rest.mean, quiet / rest.n, []
    if _dead(tare, rest, live, run):
        return zero, u2, ["STUCK"]
    single, uneven = contamination.suspicious(tare, rest)
    single = single and bool(contamination.far_samples(tare, 0.0).any())
    step = contamination.step_of(live) if single or uneven else 0.0
    if single and (far := contamination.far_samples(tare, step)).any():
        density, kept = spectral_density_at_zero(tare[~far], rate_Hz, tone=False)
        worth, u = zero - kept.mean, math.sqrt(u2_live + density / kept.n)
        isolated = contamination.are_single(far)
        if abs(worth) > u and not isolated:
            return zero, u2, ["TARE"]
        if abs(worth) > MATTERS * u and isolated:
            tare, zero, u2, found = tare[~far], kept.mean, density / kept.n + worth**2, ["spikes"]
    if uneven:
        damaged = contamination.moved_by_segment(tare, step)[0] > math.sqrt(u2_live + u2)
        # rotors that run down or up need not have an edge
        if damaged or contamination.ends_apart(tare, step) > ROTORS * abs(run.mean - zero):
            return zero, u2, ["TARE"]
    means, _ = contamination.blocks(tare, 0.0)
    slow = _slow_noise(tare, means, u2, rate_Hz, tone=False)
    if (away := contamination.wander(tare, means, 0.0)) > MATTERS * math.sqrt(u2_live + u2) and (
        away := contamination.wander(tare, means, contamination.step_of(live))
    ):
        found, u2 = (
            [*found, "DRIFT" if away > limits.drift * abs(run.mean - zero) else "drift"],
            u2 + away**2,
        )
    if slow and slow.variance > u2:
        u2 = slow.variance
        if slow.is_too_long and not found and u2 > MATTERS**2 * u2_live:
            found.append("slow")
    return zero, u2, found


def _dead(tare: FloatArray, rest: Stretch, live: FloatArray, run: Stretch) -> bool:
    """Whether the tare, or a part of it, repeats one value, and not because the converter is too
    coarse to show any noise.
    """
    if rest.n < contamination.FEW or rest.repeats < FEWEST_REPEATS * rest.n:
        return False
    return bool(_stuck(tare, rest)) and math.sqrt(
        run.squares / (run.n - 1)
    ) > COARSE * contamination.step_of(live)


def _stuck(live: FloatArray, run: Stretch) -> list[str]:
    """A channel that repeats one value."""
    n = run.n
    if run.high == run.low:
        return ["STUCK"]
    # a coarse cell repeats itself all the time: then a long run means nothing
    if run.repeats > FEWEST_REPEATS * n:
        changes = np.flatnonzero(live[1:] != live[:-1])
        longest = int(np.diff(np.concatenate([[-1], changes, [n - 1]])).max())
        elsewhere = len(changes) / max(n - longest, 1)
        if longest >= 20 and longest > 0.1 * n and elsewhere > 0.5:
            return ["STUCK"]
    return []


def _clipped(live: FloatArray, run: Stretch) -> list[str]:
    """Whether the record is clipped, somewhere below the cell's range.

    It is where it stays at its own extreme for ten samples in a row, or, where the tone brings it
    there and back, for one sample in two hundred while hardly any other value occurs twice. A
    coarse cell repeats itself anywhere.
    """
    n = run.n
    if run.repeats < 9:
        return []
    for extreme, count in ((run.high, run.at_high), (run.low, run.at_low)):
        if 10 <= count < 0.9 * n:
            held = (
                _longest_run(np.flatnonzero(live == extreme)) >= 10
                and run.repeats < count + 0.2 * n
            )
            often = count >= 0.005 * n and run.repeats < count + 0.02 * n
            if held or often:
                return ["SATURATED"]
    return []


def _longest_run(at: NDArray[np.intp]) -> int:
    breaks = np.concatenate([[-1], np.flatnonzero(np.diff(at) > 1), [len(at) - 1]])
    return int(np.diff(breaks).max())


# a damaged clock may hold anything: it then has no steady rate
@np.errstate(over="ignore", invalid="ignore")
def _clock(time_s: FloatArray, rate_Hz: float, limits: Limits, where: str) -> list[str]:
    """Gaps and stumbles of a clock column; refuses one that runs at another rate."""
    if steady(time_s, rate_Hz):
        return []
    found: list[str] = []
    steps = time_s[1:] - time_s[:-1]
    shortest, longest = float(steps.min()) * rate_Hz, float(steps.max()) * rate_Hz
    # summer time begins or ends: the clock was set by whole hours, and no sample lacks
    hours = np.round(steps / HOUR_S)
    was_set = (hours != 0) & (np.abs(steps - HOUR_S * hours) < 1.5 / rate_Hz)
    if was_set.any():
        found, steps = ["clock"], np.where(was_set, steps - HOUR_S * hours, steps)
        shortest, longest = float(steps.min()) * rate_Hz, float(steps.max()) * rate_Hz
    usual = float(np.median(steps)) * rate_Hz
    if not abs(usual - 1.0) <= 0.01:
        rate = f"{rate_Hz / usual:.6g} Hz" if usual > 0 else "no steady rate"
        raise InputRefused(
            where,
            f"the clock column runs at {rate}, the manifest says {rate_Hz:g} Hz",
            "mend [load_cell] sample_rate, or the unit under [records] time",
        )
    if shortest <= 0.0 and not found:
        found.append("clock")
    lost = round(float(steps.sum()) * rate_Hz / usual) + 1 - len(time_s)
    if lost > 0 and longest > 1.5:
        found.append("GAPS" if lost > limits.missing * (len(time_s) + lost) else "gaps")
    return found
