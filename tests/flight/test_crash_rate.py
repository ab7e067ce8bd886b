"""The simulated flights: the paper's crash curves, dimensionless groups, the normal transform,
signs of gains, energy.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from nearlift import catalogue
from nearlift.errors import InputRefused, ManifestError, UsageError
from nearlift.flight import crash_rate, energy, gusts, paper, roll
from nearlift.flight.monte_carlo import (
    combined,
    settings_of,
    steps_per_hold,
    sweep,
    tabulate,
)
from nearlift.flight.vehicle import (
    CRAZYFLIE_AS_PRINTED,
    PAPER_CEILING,
    PAPER_DISTURBANCE,
    PAPER_GAINS,
    Craft,
    Gains,
    dimensionless,
    disturbance_for,
    gains_for,
    poles,
    stable,
)

KEY = 20210401
NO_BOUNDARY = tabulate([np.ones_like], 0.5)


def flown(preset, boundary, exponent, targets, flights, key=KEY):
    """Crash of each flight at each set-point, with the paper's model to a power."""
    curves = paper.scaled_curves(boundary, (exponent,))
    return preset.monte_carlo(boundary, flights, key).crashed(curves, settings_of(targets))


def level(preset, boundary, exponent, risk, around, flights):
    targets = np.round(np.arange(around - 0.3, around + 0.31, 0.1), 10)
    rate = flown(preset, boundary, exponent, targets, flights).mean(axis=1)
    return crash_rate.level(targets, rate, risk, 0.5 / flights)


PAPER, CONVERGED = paper.preset("paper"), paper.preset("converged")
#: Boundary, power (0: no model), and the levels of 50 % and 1 % worked out independently for the
#: paper's scheme.
REPRODUCED = [
    ("ground", 0.0, 1.15, 1.55),
    ("ground", 0.6, 0.80, 1.10),
    ("ground", 0.8, 0.80, 1.08),
    ("ground", 1.0, 0.82, 1.08),
    ("ground", 1.2, 0.84, 1.07),
    ("ground", 1.4, 0.86, 1.07),
    ("ceiling", 0.0, 1.17, None),
    ("ceiling", 0.6, 1.74, 2.09),
    ("ceiling", 0.8, 1.90, 2.25),
    ("ceiling", 1.0, 2.03, 2.39),
    ("ceiling", 1.2, 2.11, 2.50),
    ("ceiling", 1.4, 2.17, 2.59),
]


@pytest.mark.parametrize(("boundary", "exponent", "half", "_"), REPRODUCED)
def test_the_paper_s_curves_half_of_the_flights(boundary, exponent, half, _):
    """50 % levels within 0.05; 400 flights: the level's standard deviation is below 0.012, so a
    true one strays 4 of them.
    """
    assert level(PAPER, boundary, exponent, 0.5, half, 400) == pytest.approx(half, abs=0.05)


@pytest.mark.calibration
@pytest.mark.parametrize(("boundary", "exponent", "half", "rare"), REPRODUCED)
def test_the_paper_s_curves_at_ten_thousand_flights(boundary, exponent, half, rare):
    assert level(PAPER, boundary, exponent, 0.5, half, 10_000) == pytest.approx(half, abs=0.05)
    if rare is not None:
        assert level(PAPER, boundary, exponent, 0.01, rare, 10_000) == pytest.approx(rare, abs=0.1)


def test_a_converged_step_moves_the_levels_down_and_keeps_the_claim():
    """Ground 50 %: 0.92 without and 0.55 with the model at steps of 0.02 s and less; ceiling 1.88
    and 0.94. 200 flights: +-0.04.
    """
    assert level(CONVERGED, "ground", 0.0, 0.5, 0.9, 200) == pytest.approx(0.91, abs=0.06)
    assert level(CONVERGED, "ground", 1.0, 0.5, 0.7, 200) == pytest.approx(0.53, abs=0.06)
    assert level(CONVERGED, "ceiling", 1.0, 0.5, 1.88, 200) == pytest.approx(1.87, abs=0.06)


def test_runge_kutta_and_fine_euler_crash_alike():
    """Two schemes, one truth: with a step of 1/16 hold explicit Euler agrees with Runge-Kutta
    flight by flight, but for a few.
    """
    fine = replace(CONVERGED, scheme="euler", step_s=0.1 / 64)
    targets = np.array([0.8, 0.9, 1.0])
    one, two = (flown(p, "ground", 0.0, targets, 60) for p in (CONVERGED, fine))
    assert (one != two).mean() < 0.05


def one_sweep(preset, boundary="ground", flights=120, **changes):
    how = preset.monte_carlo(boundary, flights, KEY, **changes)
    return sweep(how, NO_BOUNDARY, np.array([0.8, 1.0, 1.2]))


def test_every_run_tests_its_own_step():
    good, bad = one_sweep(CONVERGED)[1], one_sweep(PAPER)[1]
    assert good.converged
    assert not bad.converged
    assert bad.worst > 0.2
    assert (bad.halved_s, bad.flights) == (0.05, 50)


def test_one_flight_among_few_makes_no_step_too_long():
    """49 of 50 and 50 of 50 lie outside of the first's interval, not of the second's."""
    how, settings = CONVERGED.monte_carlo("ground", 50, KEY), settings_of([0.2])
    coarse = np.ones((1, 50), dtype=bool)
    coarse[0, 0] = False
    assert how.step_test(NO_BOUNDARY, settings, coarse).converged
    coarse[0, :20] = False
    assert not how.step_test(NO_BOUNDARY, settings, coarse).converged


def test_a_level_is_read_across_no_gap_wider_than_half_its_interval():
    """The bounded push makes all crash at 0.5 and none at 0.6, and three set-points would read the
    level in the middle of their gap.
    """
    curves, coarse = paper.scaled_curves("ground", (1.0,)), np.array([0.4, 0.6, 0.8])
    how = CONVERGED.monte_carlo("ground", 200, KEY)
    flown, step_test = sweep(how, curves, coarse, risks=(0.5,))
    weights = crash_rate.resamples(200, np.random.default_rng(1))
    values = crash_rate.levels(flown.target_z_hat, flown.crashed[0], 0.5, weights)
    low, high = crash_rate.spread90(values)
    around = np.searchsorted(flown.target_z_hat, values[0])
    gap = flown.target_z_hat[around] - flown.target_z_hat[around - 1]
    assert gap <= max(crash_rate.FINEST, 0.6 * (high - low))
    fine = np.round(np.arange(0.49, 0.54, 0.002), 6)
    dense, _ = sweep(how, curves, fine)
    assert values[0] == pytest.approx(
        crash_rate.level(fine, dense.crashed[0].mean(axis=1), 0.5, 0.0025), abs=0.003
    )
    assert {0.4, 0.6, 0.8} <= set(flown.target_z_hat)
    assert step_test.settings == 3
    unasked, _ = sweep(how, curves, coarse)
    assert np.array_equal(unasked.target_z_hat, coarse)


def test_several_tests_of_the_step_are_as_good_as_the_worst():
    good, bad = (
        one_sweep(CONVERGED, flights=50)[1],
        one_sweep(PAPER, flights=50)[1],
    )
    both = combined([good, bad])
    assert (both.converged, both.worst, both.step_s, both.settings) == (False, bad.worst, 0.1, 6)
    assert combined([good, good]).converged


def test_threads_blocks_and_order_change_nothing():
    with ThreadPoolExecutor(3) as pool:
        many, _ = one_sweep(PAPER, flights=170, spread=pool.map)

    def from_behind(fly_block, firsts):
        done = {first: fly_block(first) for first in reversed(list(firsts))}
        return [done[first] for first in sorted(done)]

    backwards, _ = one_sweep(PAPER, flights=170, spread=from_behind)
    alone, _ = one_sweep(PAPER, flights=170)
    assert np.array_equal(many.crashed, alone.crashed)
    assert np.array_equal(backwards.crashed, alone.crashed)
    # more flights do not change the first ones
    assert np.array_equal(one_sweep(PAPER, flights=60)[0].crashed, alone.crashed[:, :, :60])


def test_two_vehicles_with_equal_groups_crash_alike_and_others_do_not():
    """A vehicle of three times the size and ten times the mass, its gains and weather carried over:
    the same flights crash.
    """
    own = dimensionless(CRAZYFLIE_AS_PRINTED, PAPER_GAINS["ground"], PAPER_DISTURBANCE, 120.0)
    big = Craft(radius_m=0.07, mass_kg=0.4, gravity_m_s2=9.81, density_kg_m3=1.1, C_L=2.5, rotors=4)
    gains, force = gains_for(own, big), disturbance_for(own, big)
    there = dimensionless(big, gains, force, own.duration * big.time_s)
    assert there.alpha == pytest.approx(own.alpha)
    assert there.beta == pytest.approx(own.beta)
    assert there.gamma == pytest.approx(own.gamma)
    targets = np.array([0.9, 1.0, 1.1, 1.2])

    def crashed(g):
        how = replace(PAPER.monte_carlo("ground", 150, KEY), groups=g)
        return how.crashed(NO_BOUNDARY, settings_of(targets))

    one, two = crashed(own), crashed(there)
    assert (one != two).mean() < 0.01  # rounding may part a flight that grazes the ground
    unscaled = crashed(dimensionless(big, PAPER_GAINS["ground"], PAPER_DISTURBANCE, 120.0))
    assert (one.mean(axis=1) != unscaled.mean(axis=1)).all()


def test_groups_are_the_paper_s():
    own = dimensionless(CRAZYFLIE_AS_PRINTED, PAPER_CEILING, PAPER_DISTURBANCE, 120.0)
    scale = 4 * 1.6 * 1.2 / 0.027
    assert own.alpha == pytest.approx(316 * math.sqrt(scale * 0.023**6 / 9.8))
    assert own.beta == pytest.approx(316 * math.sqrt(scale * 0.023**5))
    assert own.gamma == pytest.approx(31.6 * math.sqrt(scale * 0.023**7 / 9.8**2))
    assert (own.delta, round(own.hold, 2)) == (1.0, 2.06)
    back = gains_for(own, CRAZYFLIE_AS_PRINTED)
    assert (back.kP, back.kD, back.kI) == pytest.approx((316, 316, 31.6))


# ---- gains


def test_gains_of_the_wrong_sign_are_refused_with_the_reason():
    with pytest.raises(
        ManifestError,
        match=(
            r"simulate.gains.ground: kP = 316.*unstable loop.*too low must turn its rotors"
            r" faster\n.*negative"
        ),
    ):
        stable(PAPER_CEILING, CRAZYFLIE_AS_PRINTED, "ground")
    with pytest.raises(
        ManifestError, match=r"simulate.gains.ceiling.*too close must slow its rotors\n.*positive"
    ):
        stable(PAPER_GAINS["ground"], CRAZYFLIE_AS_PRINTED, "ceiling")
    with pytest.raises(ManifestError, match="want one sign"):
        stable(Gains(kP=-316, kD=316, kI=-31.6), CRAZYFLIE_AS_PRINTED, "ground")
    for boundary, gains in PAPER_GAINS.items():
        assert stable(gains, CRAZYFLIE_AS_PRINTED, boundary) is gains
    assert sorted(poles(PAPER_CEILING, CRAZYFLIE_AS_PRINTED, "ceiling").real) == pytest.approx(
        [-16.6, -0.945, -0.113], abs=0.05
    )


def test_a_step_that_does_not_divide_the_hold_is_refused_with_one_that_does():
    assert steps_per_hold(0.1, 0.025) == 4
    with pytest.raises(ManifestError, match=r"0.03 s is no whole part of the 0.1 s.*\n.*0.0333"):
        steps_per_hold(0.1, 0.03)


def test_a_ratio_without_a_value_is_refused():
    model = catalogue.model("cheeseman_bennett_fixed")
    with pytest.raises(InputRefused, match=r"L / L_inf has no value at z_hat = 0.2"):
        tabulate([lambda z: model(z)], 0.1)


def test_the_table_is_the_model():
    model = catalogue.model("sanchez_cuevas")
    curves = tabulate([lambda z: model(z, **paper.GEOMETRY)], 0.5)
    z_hat = np.linspace(0.5, 15, 999)
    assert curves.at(z_hat)[0] == pytest.approx(model(z_hat, **paper.GEOMETRY), abs=1e-4)
    assert curves.at(np.array([0.1]))[0, 0] == pytest.approx(model(0.5, **paper.GEOMETRY))


def test_a_sagging_supply_crashes_more():
    how = CONVERGED.monte_carlo("ground", 300, KEY)
    curves = tabulate([np.ones_like, np.ones_like], 0.5)
    crashed = how.crashed(curves, settings_of([1.0], (0, 1), (0.0, -0.2))).sum(axis=1)
    assert crashed[1] > crashed[0] + 30


def test_a_trace_is_the_flight_that_was_counted():
    how, settings = PAPER.monte_carlo("ground", 60, KEY), settings_of([1.0])
    ended = how.ended(NO_BOUNDARY, settings)[0]
    crashing, living = int(np.flatnonzero(ended >= 0)[0]), int(np.flatnonzero(ended < 0)[0])
    heights = how.trace(NO_BOUNDARY, settings, crashing)[0]
    assert np.isnan(heights[ended[crashing] + 2 :]).all()
    assert heights[ended[crashing] + 1] <= 0 < heights[ended[crashing]]
    assert np.nanmin(how.trace(NO_BOUNDARY, settings, living)[0]) > 0


# ---- random numbers


def normals(key, flight, n):
    """First `n` standard normals of a flight."""
    out = np.empty(n)
    start = gusts.begin(np.uint64(key), np.uint64(flight))
    gusts.fill(np.uint64(start), out)
    return out


def test_normals_are_normal():
    """Kolmogorov-Smirnov at 1e-4, so one fixed key in ten thousand would cry wolf; and moments of
    200 000 draws within 5 sigma.
    """
    draws = np.concatenate([normals(KEY, f, 1000) for f in range(200)])
    assert stats.kstest(draws, "norm").pvalue > 1e-4
    n = len(draws)
    assert abs(draws.mean()) < 5 / math.sqrt(n)
    assert abs(draws.var() - 1) < 5 * math.sqrt(2 / n)
    assert abs((draws**4).mean() - 3) < 5 * math.sqrt(96 / n)
    lag = np.corrcoef(draws[:-1], draws[1:])[0, 1]
    assert abs(lag) < 5 / math.sqrt(n)


def test_streams_are_addressed():
    """A flight's gusts depend on key and flight only, their beginning not on their number; other
    flights and keys have others.
    """
    assert np.array_equal(normals(1, 2, 5), normals(1, 2, 1000)[:5])
    across = np.array([normals(1, f, 500) for f in range(200)])
    assert stats.kstest(across[:, 0], "norm").pvalue > 1e-4
    correlation = np.corrcoef(across)[np.triu_indices(200, 1)]
    assert abs(correlation).max() < 0.3  # 19 900 pairs at sd 0.045: 6.7 sigma
    assert not np.intersect1d(normals(1, 0, 500), normals(2, 0, 500)).size
    assert normals(7, 3, 4) == pytest.approx(normals(7, 3, 4), abs=0)


# ---- rates and levels


def test_intervals_of_rates_cover():
    """90 % intervals over every true rate drawn: between 86 and 94 % of 2000 (a sd of 0.7 %)."""
    rng = np.random.default_rng(1)
    p = rng.uniform(0.02, 0.98, 2000)
    low, high = crash_rate.binomial90(rng.binomial(200, p), 200)
    assert 0.86 < ((low <= p) & (p <= high)).mean() < 0.94
    low, high = crash_rate.binomial90(np.array([0, 200]), 200)
    assert (low[0], high[1]) == (0.0, 1.0)
    assert high[0] < 0.02


def test_levels():
    z_hat, rate = np.array([1.0, 1.1, 1.2, 1.3]), np.array([0.9, 0.5, 0.05, 0.0])
    assert crash_rate.level(z_hat, rate, 0.5, 1e-3) == pytest.approx(1.0 + 0.1 * 1.0)
    assert 1.1 < crash_rate.level(z_hat, rate, 0.1, 1e-3) < 1.2
    # between a set-point where all crash and one where none does, half do in the middle
    assert crash_rate.level(z_hat, np.array([1.0, 1.0, 0.0, 0.0]), 0.5, 1e-3) == pytest.approx(1.15)
    assert math.isnan(crash_rate.level(z_hat, rate + 0.3, 0.1, 1e-3))
    rows = np.stack([rate, rate + 0.3, np.zeros(4)])
    assert np.array_equal(
        crash_rate.level(z_hat, rows, 0.1, 1e-3),
        [float(crash_rate.level(z_hat, row, 0.1, 1e-3)) for row in rows],
        equal_nan=True,
    )
    assert crash_rate.level(z_hat, np.zeros(4), 0.1, 1e-3) == 1.0
    with pytest.raises(UsageError, match=r"0.01 cannot be seen in 100 flights\n.*300"):
        crash_rate.refuse_few(0.01, 100)
    low, high = crash_rate.spread90(np.array([1.0] * 19 + [math.nan]))
    assert low == 1.0
    assert math.isnan(high)


# ---- energy and roll


def test_energy_by_what_is_held():
    """gamma at z_hat 0.5 and 0.1: 0.852 and 0.280 as the paper takes it, 0.899 and 0.428 as the
    theory means it.
    """
    gamma = catalogue.model("hsiao_chirarattananon")(np.array([0.5, 0.1]))
    assert energy.paper_cost(gamma) == pytest.approx([0.852, 0.280], abs=5e-4)
    assert energy.cost(gamma, "thrust")[1] == pytest.approx([0.899, 0.428], abs=5e-4)
    # one and the same rotor, told as thrusts at the same power
    assert energy.cost(gamma ** (2 / 3), "power")[1] == pytest.approx(1 / gamma)
    low, best, high = energy.cost(gamma, "rpm")
    assert (low < best).all()
    assert (best < high).all()


def test_other_flights_meet_other_gusts():
    how, settings = CONVERGED.monte_carlo("ground", 60, KEY), settings_of([0.9])
    first, other = (h.crashed(NO_BOUNDARY, settings)[0] for h in (how, how.others()))
    assert 0 < other.sum() < 60
    assert (first != other).any()
    assert (how.others().others().crashed(NO_BOUNDARY, settings)[0] == first).all()


def test_roll_from_a_fit():
    rng = np.random.default_rng(0)
    ratios = [
        lambda z, a=a: 1 - a * np.exp(-z / 0.5) for a in (0.03, *rng.normal(0.03, 0.003, 200))
    ]
    found = roll.roll_beside_wall(
        ratios,
        0.1,
        weight_N=0.027 * 9.8,
        arm_m=0.0325,
        spacing_hat=65 / 23,
        inertia_kg_m2=1.6e-5,
        u_inertia=None,
        rng=rng,
    )
    near = found.near_pair_only
    assert near.torque_N_m[0] == pytest.approx(0.03 * math.exp(-0.2) * 0.027 * 9.8 * 0.0325)
    assert near.lo90_N_m[0] < near.torque_N_m[0] < near.hi90_N_m[0]
    assert found.same_law.torque_N_m[0] < near.torque_N_m[0]
    assert near.lo90_deg_s2 < near.acceleration_deg_s2 < near.hi90_deg_s2
    # the inertia is not known exactly: with a torque known perfectly, its uncertainty is all there
    # is
    sure = [ratios[0]] * 400
    known = {
        "weight_N": 0.027 * 9.8,
        "arm_m": 0.0325,
        "spacing_hat": 65 / 23,
        "inertia_kg_m2": 1.6e-5,
    }
    for u in (0.0, 0.1):
        own = roll.roll_beside_wall(sure, 0.1, **known, u_inertia=u, rng=rng).near_pair_only
        half = 0.5 * math.log(own.hi90_deg_s2 / own.lo90_deg_s2)
        assert half == pytest.approx(1.645 * u, rel=0.2)
        assert own.lo90_N_m[0] == pytest.approx(own.hi90_N_m[0])
    assert pytest.approx(0.056, abs=1e-3) == roll.INERTIA_SPREAD
