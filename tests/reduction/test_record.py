"""One record: its mean, and a standard error that a rotor tone does not fool."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from nearlift.errors import InputRefused
from nearlift.reduction import contamination, slow_noise
from nearlift.reduction.record import Reduced, reduce_record
from nearlift.reduction.samples import Conditions, clock_codes

RATE = 1000.0


def record(
    rng: np.random.Generator,
    *,
    tare: int = 2000,
    live: int = 10000,
    lift: float = 0.2,
    noise: float = 2e-3,
    tone: float = 0.0,
    tone_Hz: float = 61.0,
    memory: float = 0.0,
) -> np.ndarray:
    """White or first-order noise of the given sd, a tone of random phase while the rotors run, a
    zero of 7 mN.
    """
    white = noise * rng.standard_normal(tare + live)
    if memory:
        from scipy.signal import lfilter

        white = lfilter([np.sqrt(1 - memory**2)], [1, -memory], white)
    force = 7e-3 + white
    force[tare:] += lift + tone * np.sin(
        2 * np.pi * (rng.random() + tone_Hz / RATE * np.arange(live))
    )
    return force


def reduced(force: np.ndarray, **given: Any) -> Reduced:
    conditions = {"rate_Hz": RATE, "tare_s": 2.0} | {
        k: given.pop(k) for k in Conditions.__slots__ if k in given
    }
    return reduce_record(force, Conditions(**conditions), **given)


def test_tare_settle_and_mean_are_exact() -> None:
    force = np.concatenate(
        [np.tile([1.0, 3.0], 1000), np.full(500, 50.0), np.tile([7.0, 9.0], 2000)]
    )
    got = reduced(force, settle_s=0.5)
    assert got.lift_N == 6.0
    assert got.n == 4000
    assert got.sd_N == pytest.approx(1.0, rel=1e-3)
    # the wave is fast and regular: it leaves the mean alone
    assert got.u_lift_N < 1e-3


CASES: dict[str, tuple[dict[str, Any], float]] = {
    "white": ({}, 1.0),
    "strong tone": ({"tone": 4e-2}, 1.0),
    "tone off the grid": ({"tone": 1e-2, "tone_Hz": 63.7}, 1.0),
    "low tone": ({"tone": 1e-2, "tone_Hz": 37.3}, 1.0),
    "short": ({"tone": 5e-3, "live": 1000, "tare": 200}, 1.0),
    "noise of 20 ms": ({"memory": 0.95}, 0.96),
    "noise of 50 ms and tone": ({"memory": 0.98, "tone": 1e-2}, 0.92),
}


@pytest.mark.parametrize("case", list(CASES))
def test_standard_error_is_the_scatter_of_the_mean(case: str) -> None:
    """Root mean square u against the scatter of 600 lifts, and coverage of u's 95 % interval.

    The scatter is known to 2.9 % and the mean square u to 0.7 %, so that 4 standard errors are
    0.12; coverage is a binomial of 600 about 0.93 (a t of some 15 degrees of freedom at 1.96; 0.89
    where u is 13 % low) with a standard error of 0.011. The chance of crying wolf is below 0.1 %
    for each case.
    """
    rng, (given, ratio) = np.random.default_rng(1), CASES[case]
    tare_s = given.get("tare", 2000) / RATE
    got = [reduced(record(rng, **given), tare_s=tare_s) for _ in range(600)]
    lift, u = np.array([g.lift_N for g in got]), np.array([g.u_lift_N for g in got])
    assert abs(lift.mean() - 0.2) < 4 * lift.std() / np.sqrt(600)
    assert abs(np.sqrt(np.mean(u**2)) / lift.std() / ratio - 1) < 0.12
    assert 0.885 - 2 * (1 - ratio) * 0.3 < np.mean(np.abs(lift - 0.2) < 1.96 * u) < 0.98


@pytest.mark.parametrize("memory", [0.98, 0.99, 0.997, 0.999])
def test_the_standard_error_of_slow_noise_is_honest(memory: float) -> None:
    """Noise of 50 ms to 1 s in tares of 2 s and records of 10 s: from 40 correlation times in the
    tare to two.

    Where u is known, a normal has 0.95 of the errors within 1.96 u and 0.68 within u; where it
    stands on a few correlation times, a t of two degrees of freedom 0.82 and 0.58. Two standard
    errors of a binomial of 300 are added below; above, u may be too large by a factor of two (0.95
    within u), not more.
    """
    rng = np.random.default_rng(8)
    got = [reduced(record(rng, memory=memory, tone=1e-2 * (memory < 0.99))) for _ in range(300)]
    error, u = np.array([g.lift_N for g in got]) - 0.2, np.array([g.u_lift_N for g in got])
    assert np.mean(np.abs(error) < 1.96 * u) > 0.82 - 0.044
    assert 0.58 - 0.057 < np.mean(np.abs(error) < u) < 0.95


def test_noise_as_slow_as_the_record_is_told() -> None:
    """Noise that remembers for five records: most trials say so; none with a tone, a line, a
    straight drift.
    """
    rng = np.random.default_rng(9)
    slow = [reduced(record(rng, memory=0.99998)).codes for _ in range(60)]
    # a bench with such noise must not pass for a good one: half at least, five standard errors of a
    # binomial below the 85 % measured
    assert sum(bool({"slow", "drift", "DRIFT"} & set(codes)) for codes in slow) > 30
    drift = np.concatenate([np.zeros(2000), np.linspace(-1e-3, 1e-3, 10000)])
    for noise in ({}, {"tone": 2e-2}, {"tone": 6e-3, "tone_Hz": 50.0}):
        assert not any("slow" in reduced(record(rng, **noise) + drift).codes for _ in range(60))


def test_records_of_white_noise_keep_their_standard_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """White noise reaches odds of a hundred in at most one stretch of a hundred, so in 8 of 400
    records.

    24 are more than five standard errors beyond.
    """
    rng = np.random.default_rng(10)
    records = [record(rng, tone=1e-2) for _ in range(400)]
    with_slow = [reduced(force).u_lift_N for force in records]
    monkeypatch.setattr(slow_noise, "suspected", lambda means: False)
    assert (
        sum(u != reduced(force).u_lift_N for u, force in zip(with_slow, records, strict=True)) <= 24
    )


def test_the_variance_of_the_mean_is_that_of_the_noise() -> None:
    """Covariances of Hann batches, and the mean's variance, against sums over the samples of a
    first-order process.
    """
    half, m, memory = 40, 12, 0.98
    window = np.sin(np.pi * (np.arange(2 * half) + 0.5) / (2 * half)) ** 2
    windows = np.array(
        [np.pad(window / window.sum(), (k * half, (m - 1 - k) * half)) for k in range(m)]
    )
    times = np.arange((m + 1) * half)
    noise = memory ** np.abs(times[:, None] - times)
    means = windows @ noise @ windows.T
    row, of_mean = slow_noise._exponential(m, -1 / np.log(memory) / half)
    # the integral over a window of 80 samples is 32 points: of second order, as the sum over
    # samples is
    np.testing.assert_allclose(row, means[0] / means[0, 0], rtol=2e-3)
    assert of_mean == pytest.approx(noise.mean() / means[0, 0], rel=2e-3)


def test_slope_and_its_codes() -> None:
    rng = np.random.default_rng(5)
    ramp = np.concatenate([np.zeros(2000), np.linspace(-0.5, 0.5, 10000)])
    steady = record(rng)
    for change, codes in ((0.0, ()), (0.004, ("drift",)), (0.02, ("DRIFT",)), (-0.02, ("DRIFT",))):
        got = reduced(steady + change * ramp)
        assert got.drift_N_s == pytest.approx(change / 10, abs=5e-5)
        assert got.codes == codes
    # a slope within the noise is none, however large the limit makes it
    assert reduced(record(rng, lift=1e-3, noise=1e-2)).codes == ()


def test_zero_after_the_trial_judges_the_drift() -> None:
    force = record(np.random.default_rng(6))
    for after, codes in (
        (7e-3, ()),
        (7e-3 + 4e-3, ("drift",)),
        (7e-3 - 0.02, ("DRIFT",)),
        (np.nan, ()),
    ):
        assert reduced(force, tare_after_N=after).codes == codes


@pytest.mark.parametrize(
    ("where", "codes"),
    [
        (np.s_[:0], ()),
        (np.s_[5000:5050], ("out_of_range",)),
        (np.s_[5000:5200], ("OUT_OF_RANGE",)),
        (np.s_[2000:], ("OUT_OF_RANGE", "NO_DATA")),
        (np.s_[:2000], ("OUT_OF_RANGE", "NO_DATA")),
    ],
)
def test_samples_without_a_number(where: slice, codes: tuple[str, ...]) -> None:
    force = record(np.random.default_rng(7))
    force[where] = np.nan
    got = reduced(force)
    assert got.codes == codes
    if "NO_DATA" not in codes:
        assert got.n == 10000 - len(force[where])
        assert got.lift_N == pytest.approx(0.2, abs=2e-4)
    else:
        assert np.isnan(got.lift_N)
    assert reduced(np.zeros(1500)).codes == ("NO_DATA",)
    assert reduced(np.zeros(0), codes=("EMPTY",)).codes == ("EMPTY",)


@pytest.mark.parametrize(
    ("where", "codes"),
    [(np.s_[2000:], ("STUCK",)), (np.s_[5000:6500], ("STUCK",)), (np.s_[5000:5500], ())],
)
def test_a_channel_that_repeats_one_value_is_stuck_and_a_coarse_one_is_not(
    where: slice, codes: tuple[str, ...]
) -> None:
    force = record(np.random.default_rng(9))
    assert reduced(np.round(force / 8e-3) * 8e-3).codes == ()
    force[where] = 0.2
    assert reduced(force).codes == codes


def test_saturation_by_range_and_by_rail() -> None:
    rng = np.random.default_rng(11)
    force = record(rng, tone=0.1)
    assert reduced(force, range_N=9.8).codes == ()
    assert reduced(force, range_N=0.25).codes == ("SATURATED",)
    assert reduced(np.minimum(force, 0.29)).codes == ("SATURATED",)
    assert reduced(np.maximum(force, 0.12)).codes == ("STUCK", "SATURATED")
    assert reduced(force - 1.0, range_N=0.8).codes == ("SATURATED",)
    # single samples are no force, many are
    for size in (1e3, 1e200, -1e3):
        single = record(np.random.default_rng(18))
        single[6000] = size
        got = reduced(single, range_N=9.8)
        assert got.codes == (("out_of_range",) if abs(size) > 1e9 else ("spikes",))
        assert got.lift_N == pytest.approx(0.2, abs=5e-4)
    force[3000:5200] = 20.0
    assert "SATURATED" in reduced(force, range_N=9.8).codes


@pytest.mark.parametrize("reading", [0.0, -1.0])
def test_a_reading_at_rest_that_is_the_first_of_the_lift_is_left_out(reading: float) -> None:
    clean = record(np.random.default_rng(14), tare=80, live=160, lift=300.0, noise=0.5)
    force = clean.copy()
    force[80] = reading
    given = {"rate_Hz": 80.0, "tare_s": 1.0}
    got = reduced(force, **given)
    assert (got.codes, got.n) == (("spikes",), 159)
    assert got.lift_N == pytest.approx(reduced(clean, **given).lift_N, abs=0.02)


def test_spikes_leave_the_mean_and_its_uncertainty() -> None:
    clean = record(np.random.default_rng(12))
    for size, others in ((0.1, 0.0), (-0.1, 0.0), (5.0, 0.1), (1e200, 0.0)):
        force = clean.copy()
        force[[4000, 7000]] += size
        force[9000] += others
        got = reduced(force)
        assert got.codes == (("out_of_range",) if size > 1e9 else ("spikes",))
        assert got.n == (9997 if others else 9998)
        assert got.lift_N == pytest.approx(reduced(clean).lift_N, abs=2e-6)
        assert got.n_removed == (0 if size > 1e9 else 3 if others else 2)
        assert got.u_lift_N == pytest.approx(reduced(clean).u_lift_N, rel=0.01)


@pytest.mark.parametrize("share", [0.02, 0.05])
@pytest.mark.parametrize(("tare", "live"), [(40, 120), (200, 1000)])
@pytest.mark.parametrize("range_N", [None, 9.8])
def test_error_codes_of_a_converter_leave_tare_and_live_part_apart(
    share: float, tare: int, live: int, range_N: float | None
) -> None:
    """Up to a tenth of the readings, of any size; the larger ones hide no smaller one."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        clean = record(rng, tare=tare, live=live)
        want = reduced(clean, tare_s=tare / RATE)
        bad = rng.random(len(clean)) < share
        force = np.where(bad, rng.choice([8388.607, 642.5, 131.071, 7.9], len(clean)), clean)
        got = reduced(force, tare_s=tare / RATE, range_N=range_N)
        assert got.codes == ("spikes",)
        assert got.n_removed == bad.sum()
        assert got.lift_N == pytest.approx(want.lift_N, abs=want.u_lift_N)
        assert 0.5 < got.u_lift_N / want.u_lift_N < 2.0


@pytest.mark.parametrize("code", [9.999, -32.768, 8388.607])
@pytest.mark.parametrize(
    ("where", "runs", "length"), [("tare", 1, 12), ("live", 1, 60), ("live", 4, 9)]
)
def test_a_code_that_is_held_leaves_mean_and_uncertainty(
    code: float, where: str, runs: int, length: int
) -> None:
    for seed in range(3):
        clean = record(np.random.default_rng(seed), tare=100, live=900)
        want, force = reduced(clean, tare_s=0.1), clean.copy()
        for first in (40 if where == "tare" else 200) + 3 * length * np.arange(runs):
            force[first : first + length] = code
        got = reduced(force, tare_s=0.1)
        assert (got.codes, got.n_removed) == (("spikes",), runs * length)
        assert got.lift_N == pytest.approx(want.lift_N, abs=want.u_lift_N)
        assert got.u_lift_N == pytest.approx(want.u_lift_N, rel=0.3)


def test_a_coarse_rest_or_lift_that_holds_is_no_code() -> None:
    """Rotors that stop for a tenth of the record, read without noise: the tare's level."""
    force = np.round(record(np.random.default_rng(3), tare=100, live=900), 2)
    force[500:590] = 0.01
    assert {"MIXED", "STUCK"} & {*reduced(force, tare_s=0.1).codes}
    assert {"MIXED", "STUCK"} & {*reduced(force[100:], tare_s=0.0).codes}


@pytest.mark.parametrize("n", [100, 1000])
def test_a_twentieth_of_the_samples_in_runs_of_five_are_single(n: int) -> None:
    """And one sample of however few."""

    def single(n: int, places: Any) -> bool:
        return contamination.are_single(np.isin(np.arange(n), places))

    spread = np.arange(n // 20) * 17
    assert single(n, spread)
    assert not single(n, [*spread, n - 1])
    assert single(1000, range(500, 505))
    assert not single(1000, range(500, 506))
    assert single(10, [3])
    assert not single(10, [3, 7])


@pytest.mark.parametrize(("first", "size"), [(700, 64), (1136, 64), (500, 30)])
def test_a_block_of_the_live_part_that_is_no_lift(first: int, size: int) -> None:
    """A sector zeroed: too long for single samples, too short for a second throttle."""
    force = record(np.random.default_rng(23), tare=200, live=1000, tone=2e-3)
    force[first : first + size] = 0.0
    got = reduced(force, tare_s=0.2)
    assert "MIXED" in got.codes or ("spikes" in got.codes and abs(got.lift_N - 0.2) < 1e-3)
    # rotors that stop before its end
    force = record(np.random.default_rng(15), tare=80, live=160, lift=300.0, noise=0.5)
    force[-32:] -= 300.0
    assert "MIXED" in reduced(force, rate_Hz=80.0, tare_s=1.0).codes


def test_no_number_overflows() -> None:
    force = record(np.random.default_rng(19))
    for damage in (np.s_[:], np.s_[2000:], np.s_[2500:2600], np.s_[100:164], np.s_[::2]):
        for size in (1e308, -1e200, 1e12, np.inf, np.nan):
            for range_N in (None, 9.8):
                spoilt = force.copy()
                spoilt[damage] = size
                got = reduced(spoilt, range_N=range_N)
                assert not {"out_of_range", "OUT_OF_RANGE", "NO_DATA"}.isdisjoint(got.codes)
                assert np.isnan(got.lift_N) or abs(got.lift_N - 0.2) < 1e-3


# ---- the tare

UNEVEN: dict[str, Callable[[Any, int], Any]] = {
    "zeroed at the start": lambda i, n: 0.3 * (i < 64),
    "zeroed": lambda i, n: 0.3 * (abs(i - n / 2) < 32),
    "rotors stop": lambda i, n: 0.2 * np.exp(-i / (n / 20)),
    "rotors start": lambda i, n: 0.05 * np.clip((i - 0.9 * n) / (0.1 * n), 0, 1),
    "step": lambda i, n: 0.1 * (i >= n // 2),
    "early step": lambda i, n: 0.1 * (i < 0.4 * n),
    "every third sample": lambda i, n: 0.1 * (i % 3 == 0),
}
WANDERS: dict[str, Callable[[Any], Any]] = {
    "rises": lambda x: x,
    "falls": lambda x: -x,
    "bump": lambda x: np.sin(np.pi * x),
    "dent": lambda x: -np.sin(np.pi * x),
    "rises late": lambda x: np.clip(2 * x - 1, 0, 1),
}


@pytest.mark.parametrize("tare", [2000, 200, 40, 8])
@pytest.mark.parametrize("size", [9.04, -0.3, 0.15])
def test_a_glitch_in_the_tare_does_not_move_the_lift(tare: int, size: float) -> None:
    """A single sample beside 0.2 N of lift is left out and counted, wherever it is."""
    clean = record(np.random.default_rng(20), tare=tare)
    for at in {0, tare // 3, tare - 1}:
        force = clean.copy()
        force[at] += size
        got = reduced(force, tare_s=tare / RATE)
        assert got.codes == ("spikes",)
        assert got.lift_N == pytest.approx(
            reduced(clean, tare_s=tare / RATE).lift_N, abs=3e-3 / tare**0.5
        )
        assert got.n_removed == 1
        assert got.u_lift_N < 3 * reduced(clean, tare_s=tare / RATE).u_lift_N


@pytest.mark.parametrize("tare", [2000, 200])
@pytest.mark.parametrize("name", list(UNEVEN))
def test_a_tare_that_is_not_one_level_is_refused(tare: int, name: str) -> None:
    force = record(np.random.default_rng(21), tare=tare)
    force[:tare] += UNEVEN[name](np.arange(tare), tare)
    assert reduced(force, tare_s=tare / RATE).codes == ("TARE",)


@pytest.mark.parametrize("tare", [2000, 400, 200])
@pytest.mark.parametrize("name", list(WANDERS))
def test_a_zero_that_wanders_within_the_tare_is_told_and_carried(tare: int, name: str) -> None:
    """By 6 mN, three times the noise of a sample, without an edge: the trial's zero may be half of
    that from the mean, and u says so.
    """
    clean = record(np.random.default_rng(24), tare=tare, live=1000)
    force = clean.copy()
    shape = WANDERS[name](np.arange(tare) / tare)
    force[:tare] += 6e-3 * shape
    got = reduced(force, tare_s=tare / RATE)
    assert got.codes == ("TARE",) or (got.codes == ("drift",) and got.u_lift_N > 2e-3)
    force[:tare] = clean[:tare] + 0.05 * shape
    assert not {"DRIFT", "TARE"}.isdisjoint(reduced(force, tare_s=tare / RATE).codes)


def test_a_long_segment_shows_a_small_change() -> None:
    """A second level 3.5 mN away, where blocks of samples scatter by 0.6 mN."""
    force = record(np.random.default_rng(25), tare=400, live=1000)
    force[258:400] -= 3.5e-3
    assert reduced(force, tare_s=0.4).codes == ("TARE",)


@pytest.mark.parametrize("part", [slice(0, 400), slice(100, 300)], ids=["all of it", "half of it"])
def test_a_dead_channel_in_the_tare(part: slice) -> None:
    force = record(np.random.default_rng(26), tare=400, live=1000, tone=0.01)
    force[part] = 0.007
    assert reduced(force, tare_s=0.4).codes == ("STUCK",)
    coarse = 0.01 * np.round(
        record(np.random.default_rng(26), tare=400, live=1000, tone=0.01, noise=1e-3) / 0.01
    )
    assert "STUCK" not in reduced(coarse, tare_s=0.4).codes


def test_a_tare_of_ordinary_noise_is_its_plain_mean() -> None:
    """White, slow, humming, coarse: no code is given to 1200 tares, which are drawn so that none
    would be by chance in 99 % of seeds.
    """
    rng = np.random.default_rng(22)
    for tare in (2000, 200, 40):
        for given in ({}, {"memory": 0.9}, {"hum": 1e-2}, {"step": 2e-3}, {"step": 1e-2}):
            for _ in range(80):
                force = record(rng, tare=tare, live=1000, memory=given.get("memory", 0.0))
                force[:tare] += given.get("hum", 0.0) * np.sin(
                    2 * np.pi * (rng.random() + 0.05 * np.arange(tare))
                )
                if "step" in given:
                    force = given["step"] * np.round(force / given["step"] + rng.random())
                got = reduced(force, tare_s=tare / RATE)
                assert not {"TARE", "STUCK", "drift", "spikes"} & set(got.codes)
                assert got.lift_N == pytest.approx(
                    force[tare:].mean() - force[:tare].mean(), rel=1e-12
                )


@pytest.mark.parametrize("settle_s", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("noise_N", [0.02, 0.2])
def test_a_slow_start_after_the_tare_is_named_or_within_the_uncertainty(
    settle_s: float, noise_N: float
) -> None:
    """3 N with a time constant of 0.25 s."""
    since = np.arange(8000) / RATE - 2.02
    away = []
    for seed in range(4):
        noise = np.random.default_rng(seed).normal(0, noise_N, 8000)
        force = 3 * np.where(since < 0, 0, 1 - np.exp(-since.clip(0) / 0.25)) + noise
        got = reduced(force, settle_s=settle_s)
        assert abs(got.lift_N - 3) < 0.05
        away.append(
            0.0 if {"unsettled", "slow"} & {*got.codes} else (got.lift_N - 3) / got.u_lift_N
        )
    assert abs(np.mean(away)) < 1.5


@pytest.mark.parametrize("head_s", [0.3, 0.9, 1.9, 2.1, 3.0])
@pytest.mark.parametrize("spin_s", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("tare_s", [1.0, 2.0])
def test_a_tare_that_is_not_the_head_is_refused_or_found(
    head_s: float, spin_s: float, tare_s: float
) -> None:
    """A tare longer than the head holds running rotors; one that is shorter leaves some rest."""
    rng = np.random.default_rng([26, round(10 * head_s)])
    since = np.arange(12000) / RATE - head_s
    lift = 0.24 * np.where(since < 0, 0, 1 - np.exp(-3 * since.clip(0) / max(spin_s, 1e-9)))
    got = reduced(0.05 + lift + rng.normal(0, 3e-3, 12000), tare_s=tare_s)
    if tare_s > head_s:
        assert "TARE" in got.codes
    else:
        assert got.codes == ("unsettled",)
        assert abs(got.lift_N - 0.24) < 4 * got.u_lift_N < 0.003 * 0.24


# ---- the clock


def test_gaps_are_seen_and_the_tare_ends_by_the_clock() -> None:
    force = record(np.random.default_rng(15))
    time = np.arange(12000) / RATE
    for lost, code in ((100, "gaps"), (1000, "GAPS")):
        keep = np.r_[0:1000, 1000 + lost : 12000] if lost < 1000 else np.r_[0:1000, 1999:12000]
        got = reduced(force[keep], time_s=time[keep], missing=0.05)
        assert got.codes == (code,)
        assert got.n == 10000
        assert got.lift_N == pytest.approx(0.2, abs=3e-4)


def test_a_stumbling_clock() -> None:
    force = record(np.random.default_rng(16))
    time = np.arange(12000) / RATE
    time[6000] = time[5999]
    assert reduced(force, time_s=time).codes == ("clock",)
    assert reduced(force, time_s=np.round(np.arange(12000) / RATE, 3)).codes == ()


@pytest.mark.parametrize(
    ("samples", "slower", "match"),
    [
        # a piece may be off by less than a sample, a record may not
        (12, 1.04, ""),
        (20, 1.04, ""),
        (20, 2.0, "runs at 4 Hz, the manifest says 8 Hz"),
        (200, 1.04, "runs at 7.69231 Hz"),
        (200, 0.0, "no steady rate"),
    ],
)
def test_another_rate_is_refused(samples: int, slower: float, match: str) -> None:
    clock, conditions = np.arange(samples) * slower / 8.0, Conditions(rate_Hz=8.0)
    with pytest.raises(InputRefused, match=match) if match else contextlib.nullcontext():
        assert clock_codes(clock, conditions, "r0") == []
