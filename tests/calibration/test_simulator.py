"""The simulator itself: strengths and noise are what they claim, records give back the truth."""

import numpy as np
import pytest
from scipy.stats import binom
from tests.calibration import forms, oracle
from tests.calibration.assess import headline
from tests.calibration.bench import SPACING
from tests.calibration.kinds import KINDS, RHO, STRONG, draw
from tests.calibration.simulator import (
    Errors,
    Shared,
    Spec,
    Unreachable,
    amplitude,
    draw_errors,
    log_lift,
    records,
    simulate,
)

#: How strong effects are, by group of kinds.
STRENGTH = {
    "strange": (STRONG, 1.0),
    "tables": (1.0, 3.0),
    "growing": (0.3, 0.6),
    "records": (0.2, 1.0),
}
#: Kinds that the true covariance does not describe: a t3 has no fourth moment.
UNDESCRIBED = {"t3", "outliers", "rail", "datum_undeclared"}


@pytest.fixture(scope="module")
def nulls():
    return {b: simulate(Spec(boundary=b, realism=False), 3) for b in forms.BOUNDARIES}


def standardised(campaign):
    """Whitened deviation of log lift from the truth."""
    return campaign.whitener(np.log(campaign.data.lift_N) - campaign.truth.log_lift)


@pytest.mark.parametrize(
    ("boundary", "kind", "foreign"),
    [
        ("ground", "supply_sag", False),
        ("ceiling", "near_wall_saturation", True),
        ("sidewall", "parity", False),
    ],
)
def test_strength_is_what_was_asked_for(boundary, kind, foreign):
    """From the definition, with the covariance written out: n rho^2 is the effect's noncentrality
    next to theta and L_inf.
    """
    spec = Spec(boundary=boundary, effects=((kind, 0.4),), foreign=foreign, visits=4, sessions=3)
    campaign = simulate(spec, 5)
    white, visit = campaign.whitener, campaign.data.visit
    shared = white.q * white.sd
    blocks = (visit[:, None] == visit[None, :]) * np.outer(shared, shared)
    inverse = np.linalg.inv(np.diag(white.sd**2) + blocks)
    absorbed = np.hstack([campaign.indicator, campaign.jacobian])
    e = campaign.truth.contributions[kind]
    left = e - absorbed @ np.linalg.solve(absorbed.T @ inverse @ absorbed, absorbed.T @ inverse @ e)
    assert np.sqrt(left @ inverse @ left / campaign.data.n) == pytest.approx(0.4, rel=2e-3)


def test_what_a_coefficient_absorbs_cannot_be_made_strong():
    with pytest.raises(Unreachable, match="height_scale"):
        simulate(Spec(boundary="ceiling", effects=(("height_scale", 0.2),)), 1)


@pytest.mark.parametrize("boundary", forms.BOUNDARIES)
def test_forms_do_nothing_at_zero_and_foreign_ones_differ_in_shape(nulls, boundary):
    campaign, tried = nulls[boundary], 0
    for kind in forms.names(boundary):
        left = []
        for foreign in (False, True):
            form = forms.form(kind, foreign)
            assert np.abs(campaign.effect((form, 0.0))).max() < 1e-12, kind
            try:
                x = amplitude(campaign.setting, campaign.whitener, kind, foreign, 0.15, 1.0)
            except Unreachable:
                continue
            left.append(campaign.left(campaign.effect((form, x))))
        if len(left) == 2:
            tried += 1
            one, other = (e / np.linalg.norm(e) for e in left)
            assert 1 - (one @ other) ** 2 > 1e-3, kind
    assert tried >= 12


def test_records_are_records_and_give_back_the_truth():
    campaign = simulate(Spec(boundary="ground", realism=False, samples=400), 11)
    data, truth, sensor = campaign.data, campaign.truth, campaign.sensor
    force = records(campaign.spec, 11, campaign.setting, truth.scatter, sensor, ())
    assert force.shape == (data.n, 400 + sensor.tare) == (1200, 400 + sensor.tare)
    # the records' own standard errors, against what was put into them
    assert np.median(data.u_lift_N) == pytest.approx(truth.scatter.record_N, rel=0.15)
    # white, of unit variance: 4 sigma each
    white, n = standardised(campaign), data.n
    assert abs(np.mean(white)) < 4 / np.sqrt(n)
    assert abs(np.var(white) - 1) < 4 * np.sqrt(2 / n)
    assert abs(np.mean(white[1:] * white[:-1])) < 4 / np.sqrt(n)
    # the rotor's tone: a line near the turning rate of the first trial
    live = force[0, sensor.tare :]
    power = np.abs(np.fft.rfft((live - live.mean()) * np.hanning(len(live)))) ** 2
    peak = np.fft.rfftfreq(len(live), 1e-3)[np.argmax(power[10:]) + 10]
    assert peak == pytest.approx(campaign.setting.bench.speed_rpm[0] / 60, rel=0.03)


def test_realism_adds_tails_and_little_else():
    white = standardised(simulate(Spec(boundary="ground"), 8))
    spread = 1.4826 * np.median(np.abs(white - np.median(white)))
    assert spread == pytest.approx(0.95, abs=0.12)
    assert np.mean(np.abs(white) > 4 * spread) > 5e-4


@pytest.mark.parametrize("foreign", [False, True])
def test_heating_shows_in_the_records_alone(foreign):
    campaign = simulate(Spec(boundary="ceiling", realism=False, sink=0.01, foreign=foreign), 4)
    data = campaign.data
    change = data.covariates["drift_N_s"] * data.covariates["record_s"] / data.lift_N
    share = np.mean(change / campaign.setting.load)
    assert share == pytest.approx(-0.01, rel=0.35 if foreign else 0.08)
    effect = campaign.truth.log_lift - log_lift(campaign.setting, ())[campaign.keep]
    assert np.sqrt(np.mean(campaign.left(effect) ** 2)) < 1e-6


def test_own_curves_reproduce_the_golden_numbers():
    """Sanchez-Cuevas (true geometry, K_b = 2; to four decimals) and Hsiao-Chirarattananon."""
    ground = forms.ratio("ground", np.array([1.0, 2.0, 5.0]), {"K_b": 2.0})
    assert ground == pytest.approx([1.1586, 1.0898, 1.0256], abs=2e-4)
    ceiling = forms.ratio("ceiling", np.array([0.5, 1.0, 2.0, 0.1]), {"alpha": 0.125})
    assert ceiling == pytest.approx([1.112372, 1.030330, 1.007752, 2.337117], abs=5e-7)


def test_the_true_model_covers():
    """90 % intervals on 60 campaigns; a right simulator fails this once in a thousand."""
    hits, effects = 0, (("tether_stiffness", 0.4),)
    for seed in range(20):
        for boundary, name in forms.HEADLINE.items():
            spec = Spec(boundary=boundary, effects=effects, visits=3, errors=Errors())
            campaign = simulate(spec, seed)
            low, high = oracle.fit(campaign).interval(name)
            hits += low <= campaign.truth.theta[name] <= high
    assert binom.ppf(0.0005, 60, 0.9) <= hits <= binom.ppf(0.9995, 60, 0.9)


def test_a_coefficient_is_stated_at_the_speed_of_the_library():
    """A sidewall's loss is in proportion to its coefficient, so the answer can be written down;
    0.625 of throttle turns at (15924 + 20539) / 2.
    """
    spec = Spec(boundary="sidewall", effects=(("reynolds", 0.3),), errors=Errors())
    campaign = simulate(spec, 3)
    assert np.median(campaign.data.throttle) == 0.625
    speed = 18231.5 / 17000
    expected = campaign.truth.theta["a"] * speed ** campaign.truth.amplitudes["reynolds"]
    assert headline(campaign) == pytest.approx(expected, rel=1e-5)


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_every_kind_is_drawn_as_strong_and_as_noisy_as_it_says(kind):
    """Of six seeds, three have an effect where a kind is of both. Deviations are white to the true
    covariance, in which nothing is that is not stated.
    """
    slow = kind.group in ("records", "strange")
    white = []
    for i, seed in enumerate((17, 20) if slow else 3 * np.arange(6)):
        campaign = draw(kind.name, kind.boundaries[i % len(kind.boundaries)], int(seed))
        rho = campaign.truth.rho
        low, high = RHO.get(kind.name, STRENGTH.get(kind.group, (0.2, 1.0)))
        assert all(low - 1e-6 <= r <= high + 1e-6 for r in rho.values())
        if slow:
            assert len(rho) == {"null": 0, "within": 0, "two": 2}.get(kind.name, 1)
        elif kind.group != "tables":
            assert len(rho) <= seed // 3 % 2
        white.append(standardised(campaign))
    n = sum(map(len, white))
    if slow or kind.group == "experiments" or kind.name in UNDESCRIBED:
        return
    # 5 sigma of n independent squares; heights act through the curve and not its slope
    assert abs(sum(w @ w for w in white) / n - 1) < 5 * np.sqrt(2 / n) + 0.03
    assert abs(sum(w[1:] @ w[:-1] for w in white) / n) < 5 / np.sqrt(n) + 0.03


def test_trials_are_lost_and_deviate_as_stated():
    bench = simulate(Spec(boundary="ground", realism=False, errors=Errors()), 1).setting.bench
    n = bench.n

    def drawn(**errors):
        return draw_errors(Errors(**errors), 0.005, bench, 1)

    keep = drawn(lost=0.25, lost_sessions=1).keep
    assert len(set(bench.session[keep])) == bench.session.max()
    lost = np.mean(~drawn(lost=0.25).keep)
    assert lost == pytest.approx(0.25, abs=5 * np.sqrt(0.25 * 0.75 / n))
    odd = np.abs(drawn(outliers=0.015).error) > 4.5 * 0.005
    assert np.mean(odd) == pytest.approx(0.015, abs=5 * np.sqrt(0.015 / n))
    shift = np.abs(drawn(bad_visit=7).error - drawn().error)
    assert np.unique(bench.visit[shift > 0]).size == 1
    assert shift.max() == pytest.approx(0.035)


def test_a_rail_cuts_means_short():
    free, cut = (
        simulate(Spec(boundary="ground", errors=Errors(rail=r)), 7).data.lift_N for r in (0.0, 0.03)
    )
    change = cut / free - 1
    assert change.min() < -0.005
    assert 0.02 < np.mean(change < -0.002) < 0.15
    assert change.max() < 1e-9


def test_a_wrong_radius_in_the_manifest_moves_no_lift_and_is_in_the_true_covariance():
    """The slope of log lift with the radius, against a curve of scaled geometry written out."""
    common = {"boundary": "ground", "visits": 2, "errors": Errors(), "declared": True}
    right, wrong = (
        simulate(Spec(**common, shared=shared), 7)
        for shared in (Shared(), Shared(rotor_radius=0.01))
    )
    true, data = right.data, wrong.data
    assert np.array_equal(true.lift_N, data.lift_N)
    assert data.radius_m != true.radius_m
    assert np.allclose(data.z_hat * data.radius_m, true.z_hat * true.radius_m)
    for name, value in true.geometry.items():
        assert np.allclose(data.geometry[name] * data.radius_m, np.asarray(value) * true.radius_m)
    bench, K_b = wrong.setting.bench, wrong.setting.theta["K_b"]
    up, down = (
        np.log(forms.sanchez_cuevas(bench.z_hat * bench.radius_m / r, K_b, spacing=SPACING / r))
        for r in (bench.radius_m * 1.001, bench.radius_m * 0.999)
    )
    column = 0.01 * (up - down) / 0.002
    assert np.allclose(wrong.whitener.given[3], np.outer(column, column), rtol=1e-4, atol=1e-14)
    [part] = wrong.parts
    assert (part.on, part.standard) == ("rotor_radius", 0.01)


@pytest.mark.nightly
@pytest.mark.parametrize("name", forms.STRANGE)
def test_strange_structures_are_no_library_effect_in_disguise(name):
    """What theta and L_inf leave of each runs parallel to no named effect, own form or foreign, on
    at least three of six benches.
    """
    apart = []
    for seed in range(6):
        campaign = draw(name, KINDS[name].boundaries[seed % len(KINDS[name].boundaries)], seed)
        boundary, closest = campaign.spec.boundary, 0.0
        e = campaign.left(campaign.truth.contributions[name])
        for form in (f for kind in forms.names(boundary) for f in forms.NAMED[kind]):
            size = (0.05 if form.signed else 0.3) * form.most[boundary]
            c = campaign.left(campaign.effect((form, size)))
            if np.linalg.norm(c) > 1e-9:
                closest = max(closest, abs(c @ e) / np.linalg.norm(c) / np.linalg.norm(e))
        apart.append(closest)
    assert np.median(apart) < 0.9, apart
