"""Flights of the campaign's vehicle: against a simulation by the equations alone, and as products,
figures and chapter.
"""

from __future__ import annotations

import html
import re
from dataclasses import replace

import numpy as np
import pytest
from tests.unit import quoted, small_run
from tests.unit.manifests import raw_manifest

from nearlift import catalogue
from nearlift.campaign import manifest
from nearlift.campaign.choices import Simulate
from nearlift.declare import compose
from nearlift.errors import ManifestError, UsageError
from nearlift.flight import fitted, paper
from nearlift.flight.fitted import conditions, fitted_flights
from nearlift.flight.paper import CRAZYFLIE_AS_PRINTED
from nearlift.flight.quoted_lift import QuotedLift
from nearlift.report.figures.fig6 import touching
from nearlift.report.figures.files import drawn, render
from nearlift.report.registry import FIGURES
from nearlift.stages import simulate
from nearlift.stages.gathering import gather
from nearlift.stages.simulate import CRASH_RATES, FLIGHTS, SAFETY

KEY = 20210401
R, MASS, G = 0.023, 0.027, 9.8
#: Lift over frequency squared: four rotors, C_L = 1.6, 1.2 kg/m^3.
K = 4 * 1.6 * 1.2 * R**4
#: Flights behind a set-point that is advised, in tests of products.
ADVISED = 100


@pytest.fixture
def few_flights(monkeypatch):
    monkeypatch.setattr(fitted, "ADVISED_FLIGHTS", ADVISED)


# ---- by the equations alone


def ground(z_hat, spacing_m=0.090, K_b=2.0):
    """Sanchez-Cuevas 2017, eq. 4; four rotors in a square."""
    d2 = (spacing_m / R) ** 2
    adjacent, opposite = d2 + 4 * z_hat**2, 2 * d2 + 4 * z_hat**2
    images = 1 / (16 * z_hat**2) + z_hat / (adjacent * np.sqrt(adjacent))
    return 1 / (1 - images - (0.5 + 2 * K_b) * z_hat / (opposite * np.sqrt(opposite)))


def ceiling(z_hat, alpha=0.125):
    """Hsiao and Chirarattananon 2019."""
    return 0.5 + 0.5 * np.sqrt(1 + alpha / z_hat**2)


def rate_at(ratio, z_hat, flights, step_s, seed, *, side, contact=0.0, bound=0.5, order=1):
    """Share of flights of 120 s that touch: a force of 0.015 N held for 0.1 s, the PID of Eq. 5; by
    Euler's scheme or (order 2) by Heun's. `contact` and the bound on the ratio are in radii.
    """
    rng = np.random.default_rng(seed)
    z0, f0 = z_hat * R, np.sqrt(MASS * G / (K * float(ratio(np.array(z_hat)))))
    # height, speed, integral of the error: a row each
    state = np.stack([np.full(flights, x) for x in (z0, 0.0, 0.0)])

    def slope(now, gust):
        error = 316.0 * (now[0] - z0) + 316.0 * now[1] + 31.6 * now[2]
        turning = np.maximum(f0 - side * error, 0.0)
        lift = K * turning**2 * ratio(np.maximum(now[0] / R, bound))
        return np.stack([now[1], side * (lift + gust - MASS * G) / MASS, now[0] - z0])

    for _ in range(1200):
        gust = 0.015 * rng.standard_normal(state.shape[1])
        alive = np.ones(state.shape[1], dtype=bool)
        for _ in range(round(0.1 / step_s)):
            k = slope(state, gust)
            if order == 2:
                k = 0.5 * (k + slope(state + step_s * k, gust))
            state = state + step_s * k
            alive &= state[0] > contact * R
        if not alive.all():
            # the others fly on
            state = state[:, alive]
    return 1 - state.shape[1] / flights


def lies_within(level, rate, widened=0.5):
    """Whether the level that `rate` (a function of height) has lies in the stated interval, widened
    by a share of itself on either side: a true statement is denied once in a thousand.
    """
    more = max(widened * (level.hi90 - level.lo90), 0.003)
    return rate(level.lo90 - more) > level.risk > rate(level.hi90 + more)


@pytest.mark.parametrize(
    ("boundary", "formula", "side"), [("ground", ground, 1.0), ("ceiling", ceiling, -1.0)]
)
def test_levels_of_the_paper_s_vehicle(boundary, formula, side):
    """Explicit Euler at 0.1 s, 4000 flights against the product's 400."""
    how = paper.simulation("paper", boundary, 400, KEY)
    levels = paper.published_flights("paper", how, (0.5, 0.01))[0].levels
    with_model = [level for level in levels if level.exponent == 1.0]
    assert [level.risk for level in with_model] == [0.5, 0.01]
    for level in with_model:
        assert lies_within(level, lambda z: rate_at(formula, z, 4000, 0.1, 5, side=side))


LIFT = {
    "ground": (
        "sanchez_cuevas",
        {"spacing_hat": 65 / 23, "diagonal_hat": np.sqrt(2) * 65 / 23},
        "K_b",
        2.0,
        1.14,
    ),
    "ceiling": ("hsiao_chirarattananon", {}, "alpha", 0.125, 0.1),
}


def lift_of(boundary):
    """Lift whose parameter is known to 1 %."""
    name, arguments, parameter, value, nearest = LIFT[boundary]
    rng = np.random.default_rng(2)
    return QuotedLift(
        boundary=boundary,
        model=catalogue.model(name),
        arguments=arguments,
        best={parameter: value},
        intervals={},
        draws={parameter: value * (1 + 0.01 * rng.standard_normal(4))},
        measured_z_hat=(nearest, 11.5),
    )


def of_a_fit(boundary, contact_m, flights, craft=CRAZYFLIE_AS_PRINTED, **chosen):
    """Flights of a vehicle with that lift."""
    asked = Simulate(flights=flights, **chosen)
    how = conditions(asked, boundary, craft, contact_m, KEY, map)
    return fitted_flights(lift_of(boundary), asked, how, "throttle", craft, 3)[0]


@pytest.mark.nightly
@pytest.mark.parametrize(("boundary", "contact_m"), [("ground", 0.024), ("ceiling", 0.002)])
def test_levels_and_advice_of_a_fitted_vehicle_that_touches(boundary, contact_m):
    """The demo's: levels by Heun's scheme with half the product's step. Each is flown 1,000 times,
    however few flights are asked for, and again with other gusts at a rate near its risk.
    """
    flown = of_a_fit(boundary, contact_m, 60, risks=[0.5, 0.05])
    assert (flown.flights, flown.draw_flights) == (1000, 60)
    z = contact_m / R
    formula = (lambda x: ground(x, 0.065)) if boundary == "ground" else ceiling
    alone = {"side": 1.0 if boundary == "ground" else -1.0, "contact": z, "bound": z, "order": 2}
    for level in flown.levels:
        assert level.agrees
        # as few flights as the product's: the comparison has twice the variance
        assert lies_within(level, lambda z: rate_at(formula, z, 1000, 0.025, 6, **alone), 1.0)
        assert level.advised
        # four standard deviations of a rate of 1000 flights, twice
        apart = 4 * np.sqrt(2 * level.risk * (1 - level.risk) / 1000)
        assert level.crashes / 1000 == pytest.approx(level.risk, abs=apart)
        assert level.rate_lo90 < level.crashes / 1000 < level.rate_hi90


# ---- conditions


def test_a_sagging_supply_sags_without_a_boundary_too(few_flights):
    """A ceiling without effect (alpha = 0): with and without it the same flights crash."""
    lift = QuotedLift(
        boundary="ceiling",
        model=compose(catalogue.model("hsiao_chirarattananon"), catalogue.effect("supply_sag")),
        arguments={"supply_V": 1.0, "supply_ref_V": 1.0},
        best={"alpha": 0.0, "sag_exponent": 2.0},
        intervals={},
        draws={"alpha": np.zeros(2), "sag_exponent": np.full(2, 2.0)},
        measured_z_hat=(0.1, 11.5),
        supply_V=(4.0, 3.7),
    )
    asked = Simulate(flights=20, risks=[0.5])
    how = conditions(asked, "ceiling", CRAZYFLIE_AS_PRINTED, 0.002, KEY, map)
    flown, rows = fitted_flights(lift, asked, how, "throttle", CRAZYFLIE_AS_PRINTED, 3)
    assert flown.droop == pytest.approx((3.7 / 4.0) ** 2 - 1)
    (level,) = flown.levels
    assert level.value == level.without_model
    none, form = (
        [r["crashes"] for r in rows if r["member"] == -1 and r["below_nearest"] == below]
        for below in ("", "form")
    )
    assert none == form
    assert sum(none) > 0


def test_a_vehicle_that_cannot_lift_itself_comes_down(few_flights):
    """Lift limited to 99 % of the weight holds no vehicle up where the ground adds less."""
    weak = replace(CRAZYFLIE_AS_PRINTED, most_lift_N=0.99 * MASS * G)
    at = {"risks": [0.5], "set_points": {"ground": [3.0, 12.0]}}
    (level,) = of_a_fit("ground", 0.024, 20, weak, **at).levels
    assert np.isnan(level.value) or level.value > 3.0


# ---- products, figures and chapter


QUICK = {
    "flights": 40,
    "draws": 3,
    "risks": [0.5],
    "presets": ["paper"],
    "roll_inertia": "1.6e-5 kg*m^2",
    "set_points": {"ground": [0.8, 1.0, 1.2, 1.4], "ceiling": [1.6, 1.8, 2.0, 2.2]},
}
VEHICLE = raw_manifest()["vehicle"]


@pytest.fixture(scope="module")
def flown(remake):
    """A job that has flown."""
    job = remake(simulate=QUICK)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fitted, "ADVISED_FLIGHTS", ADVISED)
        outcome = simulate.run(job)
        files = [job.processed / p.file for p in (CRASH_RATES, FLIGHTS, SAFETY)]
        before = [f.read_bytes() for f in files]
        simulate.run(job)
    assert [f.read_bytes() for f in files] == before
    return job, outcome


def test_products_state_what_flew(flown):
    job, outcome = flown
    rates = job.read(CRASH_RATES)
    assert set(zip(rates["preset"], rates["boundary"], strict=True)) == {
        (p, b) for p in ("paper", "fitted") for b in ("ground", "ceiling")
    }
    assert ((rates["lo90"] <= rates["rate"]) & (rates["rate"] <= rates["hi90"])).all()
    assert rates["crashes"] == pytest.approx(rates["rate"] * rates["flights"])
    of_fit = rates["preset"] == "fitted"
    assert set(rates["member"][of_fit].tolist()) == {-1, 0, 1, 2}
    assert rates["cost_paper"] == pytest.approx(rates["ratio"] ** -1.5)
    histories = job.read(FLIGHTS)
    assert set(histories["model"]) == {"none", "sanchez_cuevas", "hsiao_chirarattananon"}
    starts = histories["t_s"] == 0
    assert (histories["z_hat"][starts] == histories["target_z_hat"][starts]).all()
    assert sum("a step of 0.1 s is too long" in n for n in outcome.notes) == 2


def test_safety_json(flown):
    job, _ = flown
    content = job.read_json(SAFETY)
    assert content["schema"] == "nearlift.safety/2"
    own = content["fitted"]["ground"]
    # a Crazyflie of the paper's size: its gains to 2 %
    gains = [own["gains"][k] for k in ("kP", "kD", "kI")]
    assert gains == pytest.approx([-316, -316, -31.6], rel=0.02)
    assert own["convergence"]["converged"]
    assert own["contact_z_hat"] == pytest.approx(12 / 23)
    assert own["contact_m"] == pytest.approx(0.012)
    assert own["bound_z_hat"] == own["contact_z_hat"]
    assert own["measured_z_hat"][0] == pytest.approx(1.14)
    (level,) = own["levels"]
    assert level["lo90"] <= level["value"] <= level["hi90"]
    published = {
        (e["exponent"], e["risk"]): e["value"]
        for e in content["presets"]["paper"]["boundaries"]["ground"]["levels"]
    }
    assert published[0.0, 0.5] == pytest.approx(1.15, abs=0.1)  # 40 flights
    assert (own["flights"], own["draw_flights"]) == (ADVISED, 40)
    assert level["rate_lo90"] <= level["crashes"] / ADVISED <= level["rate_hi90"]
    assert 0.6 < level["relative_power"] < 1
    roll = content["roll"]["near_pair_only"]
    assert roll["lo90_deg_s2"] < roll["acceleration_deg_s2"] < roll["hi90_deg_s2"]


def test_figures_and_chapter(flown):
    job, _ = flown
    evidence = gather(job)
    for spec in FIGURES:
        if spec.name not in ("fig6", "safety"):
            continue
        table = spec.table(evidence)
        assert render(spec.draw, table)["png"].startswith(b"\x89PNG")
        assert "alving the step changes" in spec.caption(evidence, table)
        assert "ground" in spec.alt(table)
    text = small_run.chapter(evidence, "safety")
    captions = re.findall(r"<caption>(\w+): lowest set-point for a stated risk", text)
    assert captions == ["Ground", "Ceiling"]
    assert 'data-source="safety.json#/fitted/ground/levels/0/rate_lo90"' in text
    assert "The paper's simulation, repeated" in html.unescape(text)


def test_a_crash_is_drawn_where_the_flight_touches():
    t, z = touching(np.array([0.0, 0.1, 0.2]), np.array([1.0, 0.3, -0.1]))
    assert (t[-1], z[-1]) == (pytest.approx(0.175), 0.0)
    assert np.array_equal(t[:2], [0.0, 0.1])
    for alive in ([1.0, 0.3, 0.1], [1.0]):
        assert np.array_equal(touching(np.arange(len(alive)), np.array(alive))[1], alive)


def test_the_usual_set_points_begin_above_what_the_vehicle_touches():
    """A Crazyflie's feet are 24 mm below its rotors, so it touches at 1.04 radii."""
    usual = fitted.set_points("ground", 24 / 23)
    assert (usual[0], usual[-1]) == (1.2, 3.1)


def test_nothing_is_advised_where_lift_nearer_than_measured_decides(
    remake, monkeypatch, few_flights
):
    """A ground that pushes at many times the weight below its nearest station saves flights that
    crash if lift is held there: both levels are stated, and neither is advised.
    """
    job = remake("ground", simulate=QUICK | {"flights": 60, "presets": [], "set_points": {}})
    wall = replace(quoted.fitted_lift(job, "ground", 3), measured_z_hat=(2.4, 11.0))
    monkeypatch.setattr(
        QuotedLift,
        "ratio",
        lambda self, member=-1: lambda z: 1 + 20 * np.exp(-8 * (z - 0.52)) + 0.01 / z**2,
    )
    monkeypatch.setattr("nearlift.flight.quoted_lift.QuotedLifts.lift", lambda *args: wall)
    simulate.run(job)
    (level,) = job.read_json(SAFETY)["fitted"]["ground"]["levels"]
    assert not level["agrees"]
    assert level["held"] > level["hi90"]
    (spec,) = (s for s in FIGURES if s.name == "safety")
    evidence = gather(job)
    table = spec.table(evidence)
    assert "No set-point is advised for a risk of 50 %" in spec.caption(evidence, table)
    figure = drawn(spec.draw, table)
    assert "no set-point is advised" in [t.get_text() for ax in figure.axes for t in ax.texts]
    assert "no: it depends on lift nearer" in small_run.chapter(evidence, "safety")


# ---- refusals


def test_a_gust_longer_than_a_flight_is_refused():
    asked = Simulate.model_validate({"gusts": {"sd": "15 mN", "hold": "1000 s"}})
    with pytest.raises(ManifestError, match="1000 s is longer than a flight of 120 s"):
        conditions(asked, "ground", CRAZYFLIE_AS_PRINTED, 0.024, KEY, map)


def test_set_points_below_contact_are_refused():
    with pytest.raises(ManifestError, match=r"begins at 0.5, where .* \(z_hat = 1.04\)"):
        of_a_fit("ground", 0.024, 20, set_points={"ground": [0.5, 1.2]})


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        (
            {},
            ManifestError,
            r"contact.ground: is missing.*counts as a crash\n.*\[vehicle\] contact",
        ),
        ({"risks": [0.001]}, UsageError, "is not detectable in 40 flights\n.*3000"),
    ],
)
def test_contact_and_enough_flights_are_asked_for(remake, changes, error, words):
    contact = VEHICLE | {"contact": {} if not changes else VEHICLE["contact"]}
    job = remake("ground", simulate=QUICK | {"presets": []} | changes, vehicle=contact)
    with pytest.raises(error, match=words):
        simulate.run(job)


def test_contact_is_measured_from_the_datum():
    """Feet 4 mm above the floor when the datum, 20 mm under the rotors, reads 4 mm."""
    at = {"vehicle": VEHICLE | {"contact": {"ground": "4 mm"}}}
    low, high = (
        manifest.parse(raw_manifest(rig=raw_manifest()["rig"] | {"distance_offset": offset}, **at))
        for offset in ({"ground": "20 mm"}, "-30 mm")
    )
    assert low.contact_m("ground") == pytest.approx(0.024)
    with pytest.raises(ManifestError, match="put the rotors into the ground"):
        high.contact_m("ground")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"set_points": {"ground": [-1.0, 1.0]}}, r"set_points.ground.0: .*greater than 0"),
        ({"set_points": {"ground": [1.4, 1.0]}}, r"set_points.ground: must ascend"),
        ({"set_points": {"sidewall": [1.0, 2.0]}}, r"flights go up and down"),
        ({"presets": ["paper", "paper"]}, r"presets: names one of its values twice"),
        ({"presets": ["printed"]}, r"presets.0: .*'paper' or 'converged'"),
        ({"maps": False}, r"simulate.maps"),
        (
            {"gains": {"ground": {"proportional": 316, "derivative": "3 1/m", "integral": "0"}}},
            "has no unit",
        ),
    ],
)
def test_settings_that_cannot_fly_are_refused_with_the_manifest(changes, words):
    with pytest.raises(ManifestError, match=words):
        manifest.parse(raw_manifest(simulate=QUICK | changes))
