"""The loop's numbers against matrices written out (n x n covariances, textbook formulae), its
decisions against truth tables.
"""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import chi2, t
from tests.unit.simulated import GROUND, campaign, restated

from nearlift import catalogue
from nearlift.loop import (
    coefficients,
    confirmation,
    discrepancy,
    findings,
    limits,
    search,
    search_problem,
    structure,
    weigh,
)
from nearlift.loop.diagnose import set_up
from nearlift.loop.evidence import LEAST_SHARE
from nearlift.loop.families import families
from nearlift.loop.power import size_parameters
from nearlift.loop.random_walk_gain import waves
from nearlift.loop.search_problem import Options
from nearlift.results.diagnosis import FORM_SD

NAMES = ("supply_sag", "session_gain", "warm_up", "zero_offset", "near_wall_saturation")
EFFECTS = tuple(e for e in catalogue.effects() if e.name in NAMES)


def sagging(covariates):
    return (covariates["supply_V"] / 3.8) ** 0.5


@pytest.fixture(scope="module")
def stage():
    return set_up(
        campaign(3, visits=3, gain=sagging, session_gain=0.004), GROUND, (), Options(), EFFECTS
    )[0]


@pytest.fixture(scope="module")
def tried(stage):
    answer = search.run(stage)
    found = {e.name: e for e in (*answer.singles, *answer.pairs)}
    assert {*NAMES} - {"near_wall_saturation"} <= found.keys()
    assert len(found) > len(NAMES)
    return found


def levels(stage):
    return np.eye(len(stage.data.levels))[stage.data.level]


def log_det(matrix):
    sign, value = np.linalg.slogdet(matrix)
    assert sign == 1
    return value


def integrated(stage, residual, fixed, random):
    """Chi2 of a residual under V = V0 + random random', beside L_inf and the columns `fixed`; and
    log |V| + log |A' V^-1 A| less those of V0.
    """
    v0, a = stage.space.covariance.dense(), levels(stage)
    v = v0 + random @ random.T
    root = np.linalg.cholesky(v)
    x, y = np.linalg.solve(root, np.hstack([a, fixed])), np.linalg.solve(root, residual)
    left = y - x @ np.linalg.lstsq(x, y, rcond=1e-10)[0]

    def volume(c):
        return log_det(c) + log_det(a.T @ np.linalg.solve(c, a))

    return left @ left, volume(v) - volume(v0)


def linearised(stage, fitted):
    """What the fit leaves of log lift, its derivatives, prior, and which of the effects' entries
    are free, one for all trials or one of a session's, and which stand at a bound.
    """
    candidate, p = fitted.candidate, len(stage.theta)
    mean, sd = candidate.prior
    low, high = candidate.bounds
    mine = np.arange(len(mean)) >= p
    free = (fitted.vector > low) & (fitted.vector < high) & mine
    by_session = np.array(
        [s.parameter.per == "session" for s in candidate.slots for _ in range(s.start, s.stop)]
    )
    rest = stage.log_lift - candidate.log_ratio(fitted.vector)
    entries = (np.flatnonzero(x) for x in (free & ~by_session, free & by_session, mine & ~free))
    return rest, candidate.jacobian(fitted.vector), mean, sd, *entries


def readings(stage, e):
    """Columns of the nuisances beside an explanation's form as printed, and uncertain."""
    for reading, sd in zip(stage.linear_fits(e.fitted, e.form_sd), (0.0, e.form_sd), strict=True):
        columns = e.fitted.candidate.form_discrepancy(e.fitted.vector, sd)
        if reading.random_walk_gain:
            columns = np.hstack([columns, reading.random_walk_gain * waves(stage.data)])
        yield reading, columns


def test_log_evidence_is_that_of_unit_information_beside_nothing_added(stage, tried):
    """Of what the trials tell less of than n times its prior does, the prior is what is asked."""
    p = len(stage.theta)
    rest, slopes, *_ = linearised(stage, stage.base_fit)
    nothing = -0.5 * integrated(stage, rest, slopes, np.zeros((stage.data.n, 0)))[0]
    assert stage.nothing_added[1] == pytest.approx(nothing, rel=1e-9)
    asked_by_priors = set()
    for e in tried.values():
        # the uncertainty of an inexact form is doubled once it is accepted
        e = replace(e, form_sd=FORM_SD)
        rest, slopes, mean, sd, own, session, held = linearised(stage, e.fitted)
        logs = []
        for reading, form_discrepancy in readings(stage, e):
            known, c = precision(stage, form_discrepancy), slopes[:, :p]
            known = known - known @ c @ np.linalg.solve(c.T @ known @ c, c.T @ known)
            # coefficients have no prior, and nothing is left of their slopes
            prior = np.where(np.isfinite(sd), sd, 0.0)
            told = np.einsum("ij,ik,kj->j", slopes, known, slopes) * np.square(prior)
            vague = own[told[own] > stage.data.n]
            narrow = np.setdiff1d(own, vague)
            asked_by_priors |= {(e.name, i) for i in narrow.tolist()}
            random = np.r_[narrow, session]
            chi2_, volume = integrated(
                stage,
                rest + slopes[:, random] @ (e.fitted.vector - mean)[random],
                np.hstack([c, slopes[:, vague]]),
                np.hstack([slopes[:, random] * sd[random], form_discrepancy]),
            )
            paying = np.r_[vague, held]
            prior = np.sum(((e.fitted.vector - mean)[paying] / sd[paying]) ** 2)
            # one unknown more each: how much sessions differ, and how far the gain wanders
            unknowns = len(paying) + bool(len(session)) + bool(reading.random_walk_gain)
            logs.append(-0.5 * (chi2_ + volume + prior + unknowns * np.log(stage.data.n)))
        assert [e.exact, e.discrepant] == pytest.approx(logs, rel=1e-6)
        expected = np.logaddexp(*logs) - np.log(2)
        assert e.log_evidence == pytest.approx(expected, rel=1e-6), e.name
        assert e.over_none == pytest.approx(expected - stage.unnamed, rel=1e-6, abs=1e-5)
        # of what restarts with every session each size is its own
        again = stage.space.project(e.fitted.candidate.restarts(e.fitted.vector, e.form_sd).T).T
        whole, left = np.eye(stage.data.n) + again @ again.T, e.fitted.residual
        assert e.gain == pytest.approx(stage.base_fit.chi2 - left @ np.linalg.solve(whole, left))
    # both kinds of price are tried
    assert asked_by_priors


def test_without_rivals_a_form_is_as_uncertain_as_the_trials_say(tried):
    """Its variance is the mean over both readings, and never nothing."""
    e = tried["supply_sag"]
    bent = e.fitted.candidate.form_discrepancy(e.fitted.vector, e.form_sd)
    for odds in (1e-3, 1.0, 50.0):
        known = restated(e, exact=0.0, discrepant=np.log(odds))
        columns = known.without_rivals().nuisances["form of supply_sag"]
        expected = max(odds / (1 + odds), LEAST_SHARE) * bent @ bent.T
        np.testing.assert_allclose(columns @ columns.T, expected, atol=1e-12 * expected.max())


def precision(stage, nuisance):
    """What V0 + nuisance nuisance' leaves of the precision once L_inf per throttle is eliminated,
    (n, n).
    """
    a = levels(stage)
    inverse = np.linalg.inv(stage.space.covariance.dense() + nuisance @ nuisance.T)
    return inverse - inverse @ a @ np.linalg.solve(a.T @ inverse @ a, a.T @ inverse)


@pytest.mark.parametrize("wide", [False, True], ids=["exact", "form uncertain"])
def test_a_coefficient_and_its_uncertainty_are_those_of_generalised_least_squares(
    stage, tried, wide
):
    for e in tried.values():
        nuisance = e.form_discrepancy if wide else np.zeros((stage.data.n, 0))
        rest, slopes, mean, sd, *_ = linearised(stage, e.fitted)
        m, prior = precision(stage, nuisance), np.where(np.isfinite(sd), sd, np.inf) ** -2.0
        covariance = np.linalg.inv(slopes.T @ m @ slopes + np.diag(prior))
        offset = np.where(prior > 0, e.fitted.vector - mean, 0.0)
        step = covariance @ (slopes.T @ m @ rest - prior * offset) if wide else np.zeros(len(mean))
        u = np.sqrt(np.diag(covariance))
        value, joint = coefficients.joint(stage, e.fitted, nuisance if wide else None)
        low, high = e.fitted.candidate.bounds
        assert np.sqrt(np.diag(joint)) == pytest.approx(u, rel=1e-5), e.name
        expected = np.clip(e.fitted.vector + step, low, high)
        assert (value - expected) / u == pytest.approx(0, abs=1e-4), e.name
        assert joint == pytest.approx(covariance, rel=1e-4, abs=1e-9 * covariance.max())


def test_an_effect_that_was_not_named_is_a_nuisance_of_its_physical_size(stage):
    def size(effect):
        (prior,) = (q.prior for q in effect.parameters if not q.grid)
        return prior.scale / (1 if "norm" in prior.distribution else np.sqrt(12))

    def expected(names):
        total = np.zeros((stage.data.n, stage.data.n))
        for effect, columns in stage.library:
            if effect.name in names:
                shapes = sum(e.name == effect.name for e, _ in stage.library)
                total += size(effect) ** 2 / shapes * columns @ columns.T
        return total

    everything = {e.name for e, _ in stage.library}
    for chosen in ((), ("supply_sag",)):
        found = coefficients.constrained_columns(stage, chosen)
        whole = expected(everything - {*chosen})
        assert found @ found.T == pytest.approx(whole, rel=1e-9, abs=1e-18)


def test_what_is_silent_biases_by_what_the_coefficients_take_of_it(stage):
    """The headline's shift, in its u, by an effect of noncentrality 16, or of its prior's size
    where that is less.
    """
    effects = tuple({e.name: e for e, _ in stage.library}.values())
    inverse = precision(stage, np.zeros((stage.data.n, 0)))
    jacobian = stage.candidate().jacobian(stage.base_fit.vector)
    information = jacobian.T @ inverse @ jacobian
    for limit in (0.0, 1.1):
        found = {f.effect: f for f in limits.silent(stage, effects, limit)}
        for effect in effects:
            columns = [c for e, c in stage.library if e.name == effect.name and c.shape[1] == 1]
            if not columns:
                assert effect.name not in found
                continue
            c = columns[0][:, 0]
            shift = np.linalg.solve(information, jacobian.T @ inverse @ c)
            seen = c @ inverse @ c - shift @ information @ shift
            prior = size_parameters(effect)[0].plausible
            size = prior if limit > 1 else min(4 / np.sqrt(seen), prior)
            bias = abs(shift[0]) * np.sqrt(information[0, 0]) * size
            assert (effect.name in found) == (limit > 1 or bias > 1), effect.name
            if effect.name in found:
                assert found[effect.name].bias_at_detection_limit == pytest.approx(bias, rel=1e-6)
                assert found[effect.name].u == pytest.approx(information[0, 0] ** -0.5)
                assert found[effect.name].hidden == (limit > 1)
        biases = [f.bias_at_detection_limit for f in limits.silent(stage, effects, limit)]
        assert biases == sorted(biases, reverse=True)
        assert biases


def test_visibility_is_the_share_of_energy_that_theta_and_levels_leave(stage):
    inverse = np.linalg.inv(stage.space.covariance.dense())
    jacobian = stage.candidate().jacobian(stage.base_fit.vector)
    for effect in {e.name: e for e, _ in stage.library}.values():
        shares = []
        for columns in (c for e, c in stage.library if e.name == effect.name):
            left, whole = 0.0, 0.0
            for c in columns.T:
                left += integrated(stage, c, jacobian, np.zeros((len(c), 0)))[0]
                whole += c @ inverse @ c
            shares.append(left / whole)
        assert stage.visibility(effect) == pytest.approx(max(shares), rel=1e-6, abs=1e-9)


def test_every_p_value_is_that_of_the_chi_square_it_takes_of_the_residual(stage):
    found, _ = stage.nothing_added
    rest, slopes, *_ = linearised(stage, stage.base_fit)
    none = np.zeros((stage.data.n, 0))
    whole, _ = integrated(stage, rest, slopes, none)
    listed = iter(zip(found.names, found.covariates, found.log10_p, strict=True))
    checked = 0
    named = [(f.name, f.columns) for f in families(stage.data)]
    named += [(f"effect {e.name}", c) for e, c in stage.library]
    root = np.linalg.cholesky(stage.space.covariance.dense())
    fixed = np.linalg.solve(root, np.hstack([levels(stage), slopes]))
    fixed, _ = np.linalg.qr(fixed)
    for name, columns in named:
        white = np.linalg.solve(root, columns)
        singular = np.linalg.svd(white - fixed @ (fixed.T @ white), compute_uv=False)
        rank = int((singular > 1e-5 * max(np.linalg.norm(white, axis=0).max(), 1e-300)).sum())
        if not rank:
            continue
        given, _, value = next(listed)
        assert given == name
        if singular[singular > 0].min() > 1e-4 * singular.max():
            drop = whole - integrated(stage, rest, np.hstack([slopes, columns]), none)[0]
            expected = chi2.logsf(drop, rank) / np.log(10)
            assert value == pytest.approx(expected, rel=1e-4, abs=1e-4), name
            checked += 1
    assert checked > 20


def of(log10_p, covariates=("time", "tilt"), threshold=-4.0):
    return structure.Structure(
        names=tuple(f"f{i}" for i in range(len(covariates))),
        covariates=covariates,
        log10_p=np.array(log10_p),
        p_value=0.1,
        threshold=threshold,
    )


DOUBTS = list(itertools.product([False, True], [-1.0, 1.0, 3.0], [False, True], [False, True]))


@pytest.mark.parametrize("names", [("supply_sag",), ("supply_sag", "zero_offset")], ids="+".join)
def test_what_is_accepted_and_what_is_possible(stage, tried, names):
    """A name leaves nothing, is likelier than none by 2 of log evidence, needed, and within bounds;
    beside it stands what is likelier than none.
    """
    effects = {e.name: e for e, _ in stage.library}
    candidate = stage.candidate(*(effects[n] for n in names))
    for present, over_none, at_bound, needed in DOUBTS:
        vector = candidate.null.copy()
        vector[candidate.sizes()] = candidate.bounds[1][candidate.sizes()] if at_bound else 1e-3
        fitted = replace(tried["supply_sag"].fitted, candidate=candidate, vector=vector)
        assert fitted.at_bound == at_bound
        left = of([-5.0], ("x",), threshold=-4.0 if present else -6.0)
        given = {"fitted": fitted, "over_none": over_none, "needed": needed, "left": left}
        e = restated(tried["supply_sag"], confirmed=None, **given)
        assert e.accepted == (not present and over_none > 2 and needed and not at_bound)
        rival = over_none > 0 and not at_bound and (needed or len(names) == 1)
        assert e.may_be_named == rival
        for confirmed in (False, True):
            judged = replace(e, confirmed=confirmed)
            assert judged.accepted == (confirmed and needed and not at_bound)
            assert judged.may_be_named == (judged.accepted or rival)


def test_structure_is_present_beyond_its_threshold_and_along_its_covariates():
    for value, present in ((-4.1, True), (-4.0, False), (-3.9, False)):
        assert of([-1.0, value]).present == present
        assert discrepancy.covariates(of([-1.0, value])) == (["tilt"] if present else [])
    several = of([-5.0, -6.0, -7.0, -1.0], ("a", "b", "a", "c"))
    assert several.foremost() == {"a": (-7.0, "f2"), "b": (-6.0, "f1"), "c": (-1.0, "f3")}
    assert list(several.foremost()) == ["a", "b", "c"]
    assert discrepancy.covariates(several) == ["a", "b"]


def test_the_interval_spans_every_answer_and_the_jackknife_its_visits():
    rng = np.random.default_rng(3)
    visit = np.repeat(np.arange(7), 3)
    before, after = rng.normal(0, 0.01, 21), rng.normal(0, 0.004, 21)

    def rms(r, keep):
        return np.sqrt(np.mean(r[keep] ** 2))

    def ends(statistic):
        """Textbook jackknife of a logarithm, Student's t, 90 %."""
        without = np.array([statistic(visit != v) for v in range(7)])
        half = t.ppf(0.95, 6) * np.sqrt(6 / 7 * np.sum((without - without.mean()) ** 2))
        return statistic(visit >= 0), half

    alone = ends(lambda keep: np.log(rms(before, keep)))
    ratio = ends(lambda keep: np.log(rms(after, keep) / rms(before, keep)))
    assert confirmation.log_rms(visit, before) == pytest.approx(alone)
    assert confirmation.log_rms(visit, after, before) == pytest.approx(ratio)
    assert np.isnan(confirmation.log_rms(visit[:6], after[:6], before[:6])[1])
    assert np.isfinite(confirmation.log_rms(visit[:9], after[:9], before[:9])).all()


def test_a_prediction_takes_its_levels_from_its_own_trials(stage):
    whole, v = stage.data, np.linalg.inv(stage.space.covariance.dense())
    a, ratio = levels(stage), stage.base_fit.candidate.log_ratio(stage.base_fit.vector)
    log_inf = np.linalg.solve(a.T @ v @ a, a.T @ v @ (stage.log_lift - ratio))
    some = np.array([5, 3, 40])
    predicted = confirmation.predict(stage, stage.base_fit, whole.take(some))
    assert predicted == pytest.approx((log_inf[whole.level] + ratio)[some])


def answered(stage, first=None, accepted=()):
    """An answer of a search."""
    first = first or stage.nothing_added[0]
    return search.Answer(problem=stage, first=first, singles=(), pairs=(), accepted=accepted)


def test_intervals_of_the_coefficient_are_made_of_its_answers(stage, tried):
    """The mixture of the accepted with their form uncertain, and the best as it is; wider with
    every effect that was not named.
    """
    accepted = (tried["supply_sag"], tried["warm_up"])
    answers = coefficients.answers(answered(stage, accepted=accepted))
    reach, found = t.ppf(0.95, answers.dof[0]), answers.estimates()
    assert 1 <= answers.dof[0] < stage.data.n
    members = [coefficients.spread(stage, e.fitted, e.form_discrepancy) for e in accepted]
    (value,), (u,) = coefficients.spread(stage, accepted[0].fitted)
    after, shares = found.after["K_b"], weigh.relative(stage, accepted)

    def below(x):
        return shares @ [t.cdf((x - v[0]) / s[0], answers.dof[0]) for v, s in members]

    low, high = (brentq(lambda x, p=p: below(x) - p, 0.0, 9.0) for p in (0.025, 0.975))
    assert after.lo90 == pytest.approx(min(low, value - reach * u))
    assert after.hi90 == pytest.approx(max(high, value + reach * u))
    mean = np.average([v[0] for v, _ in members], weights=shares)
    assert after.value == pytest.approx(mean)
    assert after.conditional == pytest.approx([value - reach * u, value + reach * u])
    nuisance = np.hstack(
        [accepted[0].form_discrepancy, coefficients.constrained_columns(stage, ("supply_sag",))]
    )
    (value,), (u,) = coefficients.spread(stage, accepted[0].fitted, nuisance)
    assert after.constrained == pytest.approx([value - reach * u, value + reach * u])
    (value,), (u,) = coefficients.spread(stage, stage.base_fit)
    before = found.before["K_b"]
    ends = (value, value - reach * u, value + reach * u)
    assert (before.value, before.lo90, before.hi90) == pytest.approx(ends)
    assert found.carried == ()


def test_what_is_carried_where_nothing_has_a_name(stage):
    """The families flagged, curves that change with time, coefficients by throttle, each at the
    size that its moments give, and its standard error.
    """
    unnamed = discrepancy.columns(stage, ["supply"])
    answers = coefficients.answers(answered(stage, of([-9.0, -1.0], ("supply", "tilt"))))
    reach, after = t.ppf(0.95, answers.dof[0]), answers.estimates()
    (value,), (u,) = coefficients.spread(stage, stage.base_fit, unnamed)
    assert after.carried == ("supply",)
    assert after.after["K_b"].conditional == pytest.approx([value - reach * u, value + reach * u])
    # moments, written out: r'F F'r less what noise alone would give, over |F'F|^2, all freed of
    # L_inf and coefficients
    m = precision(stage, np.zeros((stage.data.n, 0)))
    rest, slopes, *_ = linearised(stage, stage.base_fit)
    m = m - m @ slopes @ np.linalg.solve(slopes.T @ m @ slopes, slopes.T @ m)
    time, z = stage.data.covariates["run_order"], stage.data.z_hat
    u = 2 * (np.log(z) - np.log(z).min()) / np.ptp(np.log(z)) - 1
    rank = (np.unique(time, return_inverse=True)[1] + 0.5) / stage.data.n
    curves = [u**i * np.cos(np.pi * j * rank) for i in (1, 2) for j in (1, 2, 3, 4)]
    wanted = [f.columns for f in families(stage.data) if f.covariate == "supply"]
    wanted += [np.stack(curves, axis=1), slopes * levels(stage)]
    assert len(wanted) > 2
    total = np.zeros((stage.data.n, stage.data.n))
    for columns in wanted:
        product = columns.T @ m @ columns
        trace, energy = np.trace(product), np.sum(product**2)
        variance = (np.sum((columns.T @ m @ rest) ** 2) - trace) / energy
        # with its standard error
        variance *= 1 + np.sqrt(2 * energy) / trace
        total += max(variance, 0.0) * columns @ columns.T
    assert np.abs(total).max() > 0
    assert unnamed @ unnamed.T == pytest.approx(total, rel=1e-4, abs=1e-6 * np.abs(total).max())


def unidentifiable(slope, **columns):
    """What is said of a coefficient with this slope on a schedule of unit noise; whitened rows go
    visit by visit, trials as they were run.
    """
    n = len(slope)
    run = np.random.default_rng(5).permutation(n)
    usual = {"z_hat": np.arange(float(n)), "visit": np.arange(n), "session": np.zeros(n, dtype=int)}
    data = SimpleNamespace(ordered=True, **{k: v[run] for k, v in (usual | columns).items()})
    order = np.argsort(run)
    space = SimpleNamespace(
        project=lambda x: x[..., order], covariance=SimpleNamespace(order=order)
    )
    planned = SimpleNamespace(
        theta=np.zeros(1), base=GROUND, data=data, as_recorded=data, space=space
    )
    jacobian = SimpleNamespace(jacobian=np.asarray(slope)[:, None])
    return limits.unidentifiable_coefficients(planned, jacobian)


@pytest.mark.parametrize(
    ("share", "visits"), list(itertools.product([0.9, 0.51, 0.49, 0.1], [1, 2]))
)
def test_a_coefficient_rests_on_a_visit_where_half_of_what_is_known_is_there(share, visits):
    """`share` of the slope's energy at one distance, which one or two visits hold; the rest spread
    over the other visits.
    """
    z = np.array([1.1, 1.1, *np.linspace(2, 9, 18)])
    visit = np.array([0, 0 if visits == 1 else 1, *range(2, 20)])
    slope = np.where(z == 1.1, np.sqrt(share / 2), np.sqrt((1 - share) / 18))
    found = unidentifiable(slope, z_hat=z, visit=visit)
    assert [f.coefficient for f in found] == (["K_b"] if share > 0.5 and visits == 1 else [])
    if found:
        assert found[0].share == pytest.approx(share)
        assert found[0].rests_on == {"z_hat": 1.1}
        assert f"{100 * share:.0f} %" in found[0].text


@pytest.mark.parametrize(
    ("beside", "sessions", "said"),
    [(0.05, 4, True), (0.2, 4, False), (0.05, 1, False), (1.0, 4, False)],
)
def test_sessions_that_hold_one_distance_absorb_the_coefficient(beside, sessions, said):
    """A slope that is level within each session but for a share `beside`^2 / (1 + `beside`^2) of
    its energy.
    """
    session = np.repeat(np.arange(4) * (sessions == 4), 10)
    across = np.repeat([3.0, 1.0, -1.0, -3.0], 10) / np.sqrt(200)
    within = np.tile([1.0, -1.0], 20) / np.sqrt(40)
    found = unidentifiable(across + beside * within, session=session)
    assert [f.absorbed_by for f in found] == (["session_gain"] if said else [])
    if said:
        assert found[0].share == pytest.approx(beside**2 / (1 + beside**2))
        assert "every session" in found[0].text


def test_a_name_is_needed_where_it_takes_the_greater_part_of_what_is_there_without_it(stage, tried):
    """Gain less g is the greater part of the excess less g, but for chance, for every g that the
    others reach alone.
    """
    e, d = tried["supply_sag"], stage.hypotheses[1].shape[1]
    chance = search_problem.BY_CHANCE * np.sqrt(2 * d + 2 * d**2 / stage.noise.dof)
    part = search_problem.GREATER_PART
    least = (e.gain - part * stage.excess + chance) / (1 - part)

    def needed(*without):
        return stage.judged(e.fitted, 0.0, without).needed

    assert needed(least - 1.0)
    assert not needed(least + 1.0)
    assert not needed(least - 1.0, least + 1.0)
    assert not needed(least + 1.0, least - 1.0)
    assert needed()


def test_a_throttle_that_only_a_fold_has_cannot_be_predicted(stage):
    """The trials of one visit at a throttle of their own: nan where that visit is held out, and
    predictions of all others.
    """
    data = stage.data
    odd = data.visit == 4
    data = replace(data, throttle=np.where(odd, data.throttle + 1e-3, data.throttle))
    moved = replace(stage, data=data)
    scored = confirmation.held_out(moved, answered)
    assert np.array_equal(scored.predicted, ~odd)
    assert np.sqrt(np.mean(scored.before[~odd] ** 2)) < 0.1


def test_the_smallest_p_value_is_ranked_among_those_of_chance():
    null = structure.Null(np.linspace(-5.0, -0.1, 99))
    assert null.p_value(-4.9) == pytest.approx(4 / 100)
    assert null.p_value(0.0) == pytest.approx(1.0)
    assert null.threshold(0.5) == pytest.approx(-2.55)
    # far out the survival function underflows; decades of chi2 for two degrees of freedom are exact
    assert structure.log10_tail(np.array([1e4]), np.array([2])) == pytest.approx(-5e3 / np.log(10))


def test_chance_knows_that_the_noise_is_estimated_too():
    """A single test of one degree of freedom, its noise known with few: the threshold is that of
    Student's t.
    """
    alone = (structure.Hypothesis(name="a", covariate="b", columns=np.array([[1.0], [0.0]])),)
    none = np.zeros((2, 0))
    for dof in (4.0, 1e6):
        drawn = structure.draw(alone, none, np.random.default_rng(1), dof)
        expected = chi2.logsf(t.ppf(0.975, dof) ** 2, 1) / np.log(10)
        # a twentieth of the draws lies beyond: a few hundred
        assert drawn.threshold(0.05) == pytest.approx(expected, rel=0.08)


def test_held_out_visits_confirm_by_more_than_one_standard_error(stage):
    """Gains of visits with mean m and standard deviation 1: their sum stands beyond sqrt(visits) of
    them from m = 1 / sqrt(visits) on.
    """
    apart = replace(stage, independent=True)
    sd = np.sqrt(np.diag(apart.space.covariance.dense()))
    visits, label = np.unique(stage.data.visit, return_inverse=True)
    pattern = np.random.default_rng(2).standard_normal(len(visits))
    pattern = (pattern - pattern.mean()) / pattern.std(ddof=1)
    first = np.r_[True, label[1:] != label[:-1]]
    for m, confirmed in ((1.05, True), (0.95, False), (-0.95, False)):
        gain = (pattern + m / np.sqrt(len(visits)))[label]
        before, after = (np.where(first, np.sqrt(x), 1.0) * sd for x in (6 + gain, 6))
        common = {"visit": stage.data.visit, "chosen": ()}
        scored = confirmation.HeldOut(before=before, after=before, named=after, **common)
        assert confirmation.improves(apart, scored) == confirmed


@pytest.mark.parametrize(
    ("best", "others", "expected"),
    [
        (("a",), [("b",)], [("b",)]),
        (("a",), [("a", "b"), ("c", "b")], [("b", "c")]),
        (("a", "b"), [("a", "c")], [(), ("c",)]),
        (("a", "b"), [("c", "b"), ("a", "d")], [("c",), ("d",)]),
        (("a", "b"), [("c", "d")], [("c", "d"), ("c", "d")]),
        (("a", "b"), [("c",), ("a",)], [("c",), ("c",)]),
        (("a", "b"), [("a", "b", "c")], [("c",), ("c",)]),
    ],
)
def test_a_rival_stands_in_for_what_its_explanation_does_not_share(best, others, expected):
    def explanation(names):
        effects = [SimpleNamespace(name=name, mechanism="") for name in names]
        candidate = SimpleNamespace(effects=effects, entries_of=lambda _: ())
        return SimpleNamespace(effects=names, fitted=SimpleNamespace(candidate=candidate))

    accepted = [explanation(names) for names in (best, *others)]
    answer = SimpleNamespace(accepted=accepted, named=best, best=accepted[0].fitted)
    named = findings.named_effects(answer, SimpleNamespace(parameters={}))
    assert [(e.name, e.rivals) for e in named] == list(zip(best, expected, strict=True))
