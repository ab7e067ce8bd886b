"""The simulator itself: strengths and noise are what they claim, records give back the truth; and
the tables of its rows.
"""

import numpy as np
import pytest
from scipy.stats import binom
from tests.calibration import figures, forms, oracle
from tests.calibration.assess import assess, headline, peer_answers
from tests.calibration.bench import SPACING
from tests.calibration.kinds import KINDS, RHO, STRONG, chosen, draw
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

CASES = (
    ("ground", "supply_sag", False),
    ("ground", "fountain_shape", True),
    ("ceiling", "near_wall_saturation", True),
    ("ceiling", "cell_creep", False),
    ("sidewall", "tilt", True),
    ("sidewall", "parity", False),
)
#: Kinds whose trials the true covariance describes, and how strong their effects are by group.
TRIALS = [k for k in KINDS.values() if k.group not in ("records", "strange", "experiments")]
STRENGTH = {"strange": (STRONG, 1.0), "tables": (1.0, 3.0), "growing": (0.3, 0.6)}
STRENGTH |= {"experiments": (0.2, 1.0)}


@pytest.fixture(scope="module")
def nulls():
    return {b: simulate(Spec(boundary=b, realism=False), 3) for b in forms.BOUNDARIES}


def standardised(campaign):
    """Whitened deviation of log lift from the truth."""
    return campaign.whitener(np.log(campaign.data.lift_N) - campaign.truth.log_lift)


@pytest.mark.parametrize(("boundary", "kind", "foreign"), CASES)
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


@pytest.mark.parametrize(
    ("boundary", "kind"),
    [("sidewall", "height_offset"), ("sidewall", "height_scale"), ("ceiling", "height_scale")],
)
def test_what_a_coefficient_absorbs_cannot_be_made_strong(boundary, kind):
    with pytest.raises(Unreachable, match=kind):
        simulate(Spec(boundary=boundary, effects=((kind, 0.2),)), 1)


@pytest.mark.parametrize("boundary", forms.BOUNDARIES)
def test_clean_noise_is_white_and_of_the_stated_size(nulls, boundary):
    white = standardised(nulls[boundary])
    n = len(white)
    # 4 sigma each: 1 in 16000, nine such tests
    assert abs(np.mean(white)) < 4 / np.sqrt(n)
    assert abs(np.var(white) - 1) < 4 * np.sqrt(2 / n)
    for lag in (1, 4):
        assert abs(np.mean(white[lag:] * white[:-lag])) < 4 / np.sqrt(n)


def test_realism_adds_tails_and_little_else():
    white = standardised(simulate(Spec(boundary="ground"), 8))
    spread = 1.4826 * np.median(np.abs(white - np.median(white)))
    assert spread == pytest.approx(0.95, abs=0.12)
    assert np.mean(np.abs(white) > 4 * spread) > 5e-4


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


def test_the_library_and_the_outside_are_apart():
    assert len(forms.NAMED) == 23
    assert len(forms.UNNAMED) >= 8
    assert not set(forms.NAMED) & {*forms.UNNAMED, *forms.STRANGE, "motor_heating"}


def test_records_are_records_and_give_back_the_truth():
    campaign = simulate(Spec(boundary="ground", realism=False, samples=400), 11)
    data, truth, sensor = campaign.data, campaign.truth, campaign.sensor
    force = records(campaign.spec, 11, campaign.setting, truth.scatter, sensor, ())
    assert force.shape == (data.n, 400 + sensor.tare) == (1200, 400 + sensor.tare)
    # the records' own standard errors, against what was put into them
    assert np.median(data.u_lift_N) == pytest.approx(truth.scatter.record_N, rel=0.15)
    scatter = np.sqrt(np.mean(truth.variance))
    assert np.std(np.log(data.lift_N) - truth.log_lift) == pytest.approx(scatter, rel=0.1)
    # the rotor's tone: a line near the turning rate of the first trial
    live = force[0, sensor.tare :]
    power = np.abs(np.fft.rfft((live - live.mean()) * np.hanning(len(live)))) ** 2
    peak = np.fft.rfftfreq(len(live), 1e-3)[np.argmax(power[10:]) + 10]
    assert peak == pytest.approx(campaign.setting.bench.speed_rpm[0] / 60, rel=0.03)


@pytest.mark.parametrize("foreign", [False, True])
def test_heating_shows_in_the_records_alone(foreign):
    campaign = simulate(Spec(boundary="ceiling", realism=False, sink=0.01, foreign=foreign), 4)
    data = campaign.data
    change = data.covariates["drift_N_s"] * data.covariates["record_s"] / data.lift_N
    share = np.mean(change / campaign.setting.load)
    assert share == pytest.approx(-0.01, rel=0.35 if foreign else 0.08)
    effect = campaign.truth.log_lift - log_lift(campaign.setting, ())[campaign.keep]
    assert np.sqrt(np.mean(campaign.left(effect) ** 2)) < 1e-6


def test_seeds_rule_everything():
    spec = Spec(boundary="sidewall", effects=(("warm_up", 0.3),))
    one, same, other = (simulate(spec, seed).data for seed in (1, 1, 2))
    assert np.array_equal(one.lift_N, same.lift_N)
    assert not np.array_equal(one.lift_N, other.lift_N)


def test_covariates_are_what_the_contract_names(nulls):
    for campaign in nulls.values():
        data, known = campaign.data, campaign.data.covariates
        names = {"supply_V", "temperature_K", "approach", "tilt_rad", "start_s", "drift_N_s"}
        assert names <= set(known)
        assert all(np.isfinite(v).all() and len(v) == data.n for v in known.values())
        assert 2.9 < known["supply_V"].min() < known["supply_V"].max() < 4.3
        assert np.degrees(known["tilt_rad"]).std() == pytest.approx(1, abs=0.25)
        assert set(np.unique(known["approach"])) == {-1.0, 1.0}
        assert data.session.max() == 5
        assert (np.diff(known["start_s"]) > 10).all()
        assert (np.diff(data.visit)[np.diff(data.z_hat) != 0] == 1).all()


def test_own_curves_reproduce_the_golden_numbers():
    """Sanchez-Cuevas (true geometry, K_b = 2; to four decimals) and Hsiao-Chirarattananon."""
    ground = forms.ratio("ground", np.array([1.0, 2.0, 5.0]), {"K_b": 2.0})
    assert ground == pytest.approx([1.1586, 1.0898, 1.0256], abs=2e-4)
    ceiling = forms.ratio("ceiling", np.array([0.5, 1.0, 2.0, 0.1]), {"alpha": 0.125})
    assert ceiling == pytest.approx([1.112372, 1.030330, 1.007752, 2.337117], abs=5e-7)


def test_the_true_model_covers():
    """90 % intervals on 60 campaigns; a right simulator fails this once in a thousand."""
    hits = []
    for seed in range(20):
        for boundary in forms.BOUNDARIES:
            effects = (("tether_stiffness", 0.4),)
            campaign = simulate(
                Spec(boundary=boundary, effects=effects, visits=3, errors=Errors()), seed
            )
            name = forms.HEADLINE[boundary]
            low, high = oracle.fit(campaign).interval(name)
            hits.append(low <= campaign.truth.theta[name] <= high)
    assert binom.ppf(0.0005, 60, 0.9) <= sum(hits) <= binom.ppf(0.9995, 60, 0.9)


def test_a_coefficient_is_stated_at_the_speed_of_the_library():
    """A sidewall's loss is in proportion to its coefficient, so the answer can be written down;
    0.625 of throttle turns at (15924 + 20539) / 2.
    """
    other, campaign = (
        simulate(Spec(boundary="sidewall", effects=((name, 0.3),), errors=Errors()), 3)
        for name in ("supply_sag", "reynolds")
    )
    assert headline(other) == other.truth.theta["a"]
    assert np.median(campaign.data.throttle) == 0.625
    speed = 18231.5 / 17000
    expected = campaign.truth.theta["a"] * speed ** campaign.truth.amplitudes["reynolds"]
    assert headline(campaign) == pytest.approx(expected, rel=1e-5)


def test_rivals_find_what_is_plain_to_see():
    spec = Spec(boundary="ground", effects=(("supply_sag", 1.0),), errors=Errors(), visits=5)
    for method, names in peer_answers(simulate(spec, 2)).items():
        assert "supply_sag" in names, method


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_every_kind_can_be_drawn(kind):
    boundary = kind.boundaries[0]
    for seed in (17, 20):
        campaign = draw(kind.name, boundary, seed)
        rho = campaign.truth.rho
        assert (campaign.data.boundary, (campaign.data.lift_N > 0).all()) == (boundary, True)
        low, high = RHO.get(kind.name, STRENGTH.get(kind.group, (0.2, 1.0)))
        assert all(low - 1e-6 <= r <= high + 1e-6 for r in rho.values())
        if kind.group in ("records", "strange"):
            assert len(rho) == {"null": 0, "within": 0, "two": 2}.get(kind.name, 1)
        elif kind.group != "tables":
            assert len(rho) == seed // 3 % 2


@pytest.mark.parametrize("kind", TRIALS, ids=lambda k: k.name)
def test_errors_of_trials_are_white_to_the_true_covariance(kind):
    """Six campaigns of each kind, three with an effect; what is not stated is in no covariance, and
    shows.
    """
    white = []
    for seed in range(6):
        boundary = kind.boundaries[seed % len(kind.boundaries)]
        white.append(standardised(draw(kind.name, boundary, 3 * seed)))
    n = sum(len(w) for w in white)
    variance = sum(w @ w for w in white) / n
    lag = sum(w[1:] @ w[:-1] for w in white) / n
    if kind.name not in {"t3", "outliers", "rail", "datum_undeclared"}:  # a t3 has no fourth moment
        # 5 sigma of n independent squares; heights act through the curve and not its slope
        assert abs(variance - 1) < 5 * np.sqrt(2 / n) + 0.03
        assert abs(lag) < 5 / np.sqrt(n) + 0.03


@pytest.fixture(scope="module")
def drawn():
    spec = Spec(boundary="ground", realism=False, errors=Errors())
    bench = simulate(spec, 1).setting.bench
    return lambda seed=1, **errors: (draw_errors(Errors(**errors), 0.005, bench, seed), bench)


@pytest.mark.parametrize("r", [0.5, 0.95])
def test_errors_are_correlated_as_stated(drawn, r):
    error = drawn(correlation=r)[0].error
    # of a chain's lag-one correlation the variance is (1 - r^2) / n
    slack = 5 * np.sqrt((1 - r**2) / len(error))
    assert np.corrcoef(error[1:], error[:-1])[0, 1] == pytest.approx(r, abs=slack)


@pytest.mark.parametrize(("where", "end"), [("far", np.max), ("near", np.min)])
def test_errors_grow_towards_one_end(drawn, where, end):
    made, bench = drawn(**{where: 3})
    assert np.std(made.error[bench.z_hat == end(bench.z_hat)]) == pytest.approx(0.015, rel=0.3)


@pytest.mark.parametrize("trials", [60.0, np.inf])
def test_a_random_gain_has_the_stated_rms(drawn, trials):
    paths = [drawn(seed, wander=0.02, trials=trials)[0].error for seed in range(20)]
    assert np.sqrt(np.mean([np.var(p) for p in paths])) == pytest.approx(0.02, rel=0.35)


def test_trials_are_lost_and_deviate_as_stated(drawn):
    made, bench = drawn(lost=0.25, lost_sessions=1)
    n = bench.n
    assert len(set(bench.session[made.keep])) == bench.session.max()
    lost = np.mean(~drawn(lost=0.25)[0].keep)
    assert lost == pytest.approx(0.25, abs=5 * np.sqrt(0.25 * 0.75 / n))
    odd = np.abs(drawn(outliers=0.015)[0].error) > 4.5 * 0.005
    assert np.mean(odd) == pytest.approx(0.015, abs=5 * np.sqrt(0.015 / n))
    shift = np.abs(drawn(bad_visit=7)[0].error - drawn()[0].error)
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


def test_a_wrong_geometry_in_the_manifest_moves_no_lift():
    true, radius, spacing = (
        simulate(
            Spec(boundary="ground", errors=Errors(), shared=Shared(**s), declared=True), 7
        ).data
        for s in ({}, {"rotor_radius": 0.01}, {"spacing_m": 5e-4})
    )
    assert np.array_equal(true.lift_N, radius.lift_N)
    assert np.array_equal(true.lift_N, spacing.lift_N)
    assert radius.radius_m != true.radius_m
    assert np.allclose(radius.z_hat * radius.radius_m, true.z_hat * true.radius_m)
    for name, value in true.geometry.items():
        metres = np.asarray(value) * true.radius_m
        assert np.allclose(radius.geometry[name] * radius.radius_m, metres)
    assert np.array_equal(spacing.z_hat, true.z_hat)
    assert spacing.geometry["spacing_hat"] != true.geometry["spacing_hat"]


def test_stated_inputs_are_in_the_true_covariance():
    """The slope of log lift with the radius, against a curve of scaled geometry written out."""
    shared = Shared(rotor_radius=0.01)
    spec = Spec(boundary="ground", visits=2, errors=Errors(), shared=shared, declared=True)
    campaign = simulate(spec, 7)
    bench, K_b = campaign.setting.bench, campaign.setting.theta["K_b"]
    up, down = (
        np.log(forms.sanchez_cuevas(bench.z_hat * bench.radius_m / r, K_b, spacing=SPACING / r))
        for r in (bench.radius_m * 1.001, bench.radius_m * 0.999)
    )
    column = 0.01 * (up - down) / 0.002
    assert np.allclose(campaign.whitener.given[3], np.outer(column, column), rtol=1e-4, atol=1e-14)
    [part] = campaign.parts
    assert (part.on, part.standard) == ("rotor_radius", 0.01)


@pytest.mark.parametrize("name", forms.STRANGE)
def test_strange_structures_are_no_library_effect_in_disguise(name):
    """What theta and L_inf leave of each runs parallel to no named effect, own form or foreign, on
    at least three of six benches.
    """
    kind, apart = KINDS[name], []
    for seed in range(6):
        campaign = draw(name, kind.boundaries[seed % len(kind.boundaries)], seed)
        boundary, closest = campaign.spec.boundary, 0.0
        e = campaign.left(campaign.truth.contributions[name])
        for effect in forms.names(boundary):
            for form in (forms.form(effect, False), forms.form(effect, True)):
                size = (0.05 if form.signed else 0.3) * form.most[boundary]
                c = campaign.left(campaign.effect((form, size)))
                if np.linalg.norm(c) > 1e-9:
                    closest = max(closest, abs(c @ e) / np.linalg.norm(c) / np.linalg.norm(e))
        apart.append(closest)
    assert np.median(apart) < 0.9, apart


def test_a_growing_campaign_is_analysed_until_something_is_claimed():
    analysed = []

    def stub(campaign):
        analysed.append(campaign)
        verdict = "unexplained" if campaign.data.n == 268 else "adequate"
        return {"verdict": verdict, "effects": [], "quoted": {"K_b": (-9.0, 9.0)}}

    row = assess("growing", "ground", 6, stub)
    assert [c.data.n for c in analysed] == [160, 216, 268]
    early, later = analysed[0], analysed[1]
    assert len(early.truth.log_lift) == early.keep.sum() == early.jacobian.shape[0] == 160
    assert np.array_equal(early.data.lift_N, later.data.lift_N[:160])
    assert np.isfinite(oracle.fit(early).theta["K_b"])
    wanted = {"claimed": True, "trials": 268, "cover_quoted": True, "failed": ""}
    assert row.items() >= wanted.items()
    data = figures.frame([row])
    assert figures.by_kind(data)["null: any claim"][0] == "1 of 1 (3-100)"
    assert figures.by_verdict(data)["adequate"][0] == "-"


def test_kinds_are_chosen_by_name_and_by_group():
    assert chosen("t3,records")[:2] == ("t3", "null")
    assert "ar_95" in chosen("violations")
    with pytest.raises(ValueError, match="nonsense: no kind"):
        chosen("nonsense")


def test_clopper_pearson_is_exact():
    assert figures.clopper_pearson(0, 10) == (0.0, pytest.approx(1 - 0.025**0.1))
    assert figures.clopper_pearson(10, 10)[1] == 1.0
    low, high = figures.clopper_pearson(12, 160)
    assert binom.sf(11, 160, low) == pytest.approx(0.025)
    assert binom.cdf(12, 160, high) == pytest.approx(0.025)


def row(**facts):
    null = {"kind": "null", "boundary": "ground", "truth": [], "verdict": "adequate", "failed": ""}
    widths = {"cpu_s": 1.0, "cover_quoted": True, "width_quoted": 3.0, "oracle_width": 2.0}
    return null | widths | {"rho": 0.0, "claimed": False, "named": False} | facts


def test_figures_are_judged_by_their_interval():
    rows = [row(claimed=i < 12) for i in range(160)]
    null = figures.figures(rows).loc["null"]
    assert (null["k"], null["n"], null["passed"]) == (12, 160, True)
    rows = [row(claimed=i < 40) for i in range(160)]
    assert figures.figures(rows).loc["null", "passed"] is False
    assert "**fails**" in figures.markdown(rows)
    rows[0] = {"kind": "null", "boundary": "ground", "failed": "ValueError: no"}
    assert figures.figures(rows).loc["failed", "passed"] is False


def test_intervals_are_counted_by_campaign_and_verdict():
    strange = {"kind": "lost_steps", "truth": ["lost_steps"], "verdict": "unexplained"}
    data = figures.frame([row(), row(cover_quoted=False), row(**strange, width_quoted=8.0)])
    null, odd, every = figures.by_verdict(data).to_dict("records")
    assert null == {
        "campaign": "null",
        "adequate": "1 of 2 (1-99), 1.50",
        "effect": "-",
        "unexplained": "-",
        "all": "1 of 2 (1-99), 1.50",
    }
    assert odd["unexplained"] == "1 of 1 (3-100), 4.00"
    assert every["all"] == "2 of 3 (9-99), 1.50"


def test_a_section_takes_the_place_of_its_own(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# Title\n\nText.\n")
    for name, body in (("one", "first\n"), ("two", "second"), ("one", "new \\1 one")):
        figures.write(page, name, body)
    assert page.read_text() == (
        "# Title\n\nText.\n\n<!-- one -->\nnew \\1 one\n<!-- end of one -->\n\n"
        "<!-- two -->\nsecond\n<!-- end of two -->\n"
    )
