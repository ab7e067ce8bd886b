"""The stage `simulate`: products, effects that fly, draws, refusals, figures and chapter."""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from nearlift import catalogue
from nearlift.campaign import manifest as manifest
from nearlift.errors import InputRefused, ManifestError, UsageError
from nearlift.flight import paper
from nearlift.flight.fitted import conditions
from nearlift.flight.fitted_lift import FittedLift
from nearlift.flight.monte_carlo import settings_of, tabulate
from nearlift.flight.vehicle import CRAZYFLIE_AS_PRINTED, gains_for, poles
from nearlift.report.figures.fig6 import touching
from nearlift.report.figures.files import drawn, render
from nearlift.report.figures.style import Style
from nearlift.report.registry import FIGURES
from nearlift.run.engine import Job, stage_of
from nearlift.run.workers import open_executor
from nearlift.stages import STAGES, detect, simulate
from nearlift.stages.detect import DETECTION
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.export import export
from nearlift.stages.gathering import gather
from nearlift.stages.simulate import CRASH_RATES, FLIGHTS, SAFETY
from nearlift.stages.simulated_flights import vehicle as vehicle_of

from . import quoted, small_run
from .manifests import raw_manifest

QUICK = {
    "flights": 40,
    "draws": 3,
    "risks": [0.5],
    "presets": ["paper"],
    "roll_inertia": "1.6e-5 kg*m^2",
    "set_points": {"ground": [0.8, 1.0, 1.2, 1.4], "ceiling": [1.6, 1.8, 2.0, 2.2]},
}


#: Flights behind a set-point that is advised, here.
ADVISED = 100


@pytest.fixture(scope="module", autouse=True)
def few_flights():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("nearlift.flight.fitted.ADVISED_FLIGHTS", ADVISED)
        yield


@pytest.fixture(scope="module")
def flown(remake):
    """A job that has flown."""
    job = remake(simulate=QUICK)
    outcome = simulate.run(job)
    return job, outcome


def test_products_obey_their_schema_and_say_what_flew(flown):
    job, outcome = flown
    rates = job.read(CRASH_RATES)
    assert set(zip(rates["preset"], rates["boundary"], strict=True)) == {
        (p, b) for p in ("paper", "fitted") for b in ("ground", "ceiling")
    }
    assert ((rates["lo90"] <= rates["rate"]) & (rates["rate"] <= rates["hi90"])).all()
    assert rates["crashes"] == pytest.approx(rates["rate"] * rates["flights"])
    fitted = rates["preset"] == "fitted"
    assert set(rates["member"][fitted].tolist()) == {-1, 0, 1, 2}
    assert rates["cost_paper"] == pytest.approx(rates["ratio"] ** -1.5)
    flying = job.read_json(SAFETY)["fitted"]["ground"]["gains"]
    # a Crazyflie of the paper's size: its gains to 2 %
    assert [flying[k] for k in ("kP", "kD", "kI")] == pytest.approx([-316, -316, -31.6], rel=0.02)
    histories = job.read(FLIGHTS)
    assert set(histories["model"]) == {"none", "sanchez_cuevas", "hsiao_chirarattananon"}
    assert (
        histories["z_hat"][histories["t_s"] == 0]
        == histories["target_z_hat"][histories["t_s"] == 0]
    ).all()
    assert sum("a step of 0.1 s is too long" in n for n in outcome.notes) == 2


def test_findings(flown):
    job, _ = flown
    content = job.read_json(SAFETY)
    assert content["schema"] == "nearlift.safety/1"
    ground = content["fitted"]["ground"]
    assert ground["convergence"]["converged"]
    assert ground["contact_z_hat"] == pytest.approx(12 / 23)
    assert ground["contact_m"] == pytest.approx(0.012)
    assert ground["bound_z_hat"] == ground["contact_z_hat"]
    assert ground["measured_z_hat"][0] == pytest.approx(1.14)
    (level,) = ground["levels"]
    assert level["lo90"] <= level["value"] <= level["hi90"]
    paper = {
        (e["exponent"], e["risk"]): e["value"]
        for e in content["presets"]["paper"]["boundaries"]["ground"]["levels"]
    }
    assert paper[0.0, 0.5] == pytest.approx(1.15, abs=0.1)  # 40 flights
    assert (ground["flights"], ground["draw_flights"]) == (ADVISED, 40)
    assert level["rate_lo90"] <= level["crashes"] / ADVISED <= level["rate_hi90"]
    assert 0.6 < level["relative_power"] < 1
    roll = content["roll"]["near_pair_only"]
    assert roll["lo90_deg_s2"] < roll["acceleration_deg_s2"] < roll["hi90_deg_s2"]


def test_twice_gives_the_same_bytes(flown, remake):
    job, _ = flown
    files = [job.processed / p.file for p in (CRASH_RATES, FLIGHTS, SAFETY)]
    before = [f.read_bytes() for f in files]
    simulate.run(job)
    assert [f.read_bytes() for f in files] == before


def test_figures_and_chapter(flown):
    job, _ = flown
    evidence = gather(job)
    for spec in FIGURES:
        if spec.name not in ("fig6", "safety"):
            continue
        table = spec.table(evidence)
        assert render(spec.draw, table, Style())["png"].startswith(b"\x89PNG")
        assert "alving the step changes" in spec.caption(evidence, table)
        assert "ground" in spec.alt(table)
    text = small_run.chapter(evidence, "safety")
    levels = re.findall(r"<summary>(\w+): set-points by risk(.*?)</details>", text, re.DOTALL)
    assert [boundary for boundary, _ in levels] == ["Ground", "Ceiling"]
    assert 'data-source="safety.json#/fitted/ground/levels/0/rate_lo90"' in levels[0][1]
    assert "The paper's simulation, repeated" in html.unescape(text)


VEHICLE = raw_manifest()["vehicle"]


def test_a_crash_is_drawn_where_the_flight_touches():
    t, z = touching(np.array([0.0, 0.1, 0.2]), np.array([1.0, 0.3, -0.1]))
    assert (t[-1], z[-1]) == (pytest.approx(0.175), 0.0)
    assert np.array_equal(t[:2], [0.0, 0.1])
    for alive in ([1.0, 0.3, 0.1], [1.0]):
        assert np.array_equal(touching(np.arange(len(alive)), np.array(alive))[1], alive)


@pytest.mark.parametrize("text", ["threads:2", "processes:2"])
def test_no_executor_changes_what_is_flown(text):
    """Blocks of flights go to the executor's workers as plain values and come back in order."""
    how = paper.preset("paper").monte_carlo("ground", 120, 9)
    curves, settings = tabulate([np.ones_like], 0.5), settings_of([1.0, 1.2])
    alone = how.ended(curves, settings)
    with open_executor(text) as pool:
        job = Job(root=Path(), campaign=None, processed=Path(), reports=Path(), executor=pool)
        workers = []

        def spread(task, firsts):
            workers.append(pool)
            return job.executor.map(task, firsts)

        assert np.array_equal(replace(how, spread=spread).ended(curves, settings), alone)
    assert workers


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        (
            {
                "gains": {
                    "ground": {
                        "proportional": "316 1/m/s",
                        "derivative": "316 1/m",
                        "integral": "31.6 1/m/s^2",
                    }
                }
            },
            ManifestError,
            "unstable loop",
        ),
        ({"risks": [0.001]}, UsageError, "cannot be seen in 40 flights\n.*3000"),
        ({"presets": ["printed"]}, ManifestError, "'printed' is not a preset"),
        ({"step": "0.03 s"}, ManifestError, "no whole part"),
        (
            {"set_points": {"ground": [0.5, 1.2]}},
            ManifestError,
            r"begins at 0.5, where the vehicle touches \(z_hat = 0.522\)",
        ),
        ({"duration": "0.05 s"}, ManifestError, "0.05 s is shorter than one gust of 0.1 s"),
        ({"bound_z_hat": {"ground": 20.0}}, InputRefused, "20 leaves no range"),
        (
            {
                "gains": {
                    "ground": {
                        "proportional": "0 1/m/s",
                        "derivative": "-316 1/m",
                        "integral": "0 1/m/s^2",
                    }
                }
            },
            ManifestError,
            "without both",
        ),
    ],
)
def test_refusals(remake, changes, error, words):
    with pytest.raises(error, match=words):
        simulate.run(remake("ground", simulate=QUICK | {"presets": []} | changes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"set_points": {"ground": [-1.0, 1.0]}},
            r"simulate.set_points.ground.0: Input should be greater than 0",
        ),
        ({"set_points": {"ground": [1.4, 1.0]}}, r"simulate.set_points.ground: must ascend"),
        (
            {"set_points": {"ground": [1.0]}},
            r"simulate.set_points.ground: List should have at least 2 items",
        ),
        ({"set_points": {"sidewall": [1.0, 2.0]}}, r"a sidewall turns the vehicle"),
        ({"contact_z_hat": {"ground": 1.04}}, r"simulate.contact_z_hat"),
        (
            {"bound_z_hat": {"ground": -0.5}},
            r"simulate.bound_z_hat.ground: Input should be greater than 0",
        ),
        ({"risks": [0.0]}, r"simulate.risks.0: Input should be greater than 0"),
        ({"risks": [1.5]}, r"simulate.risks.0: Input should be less than 1"),
        ({"presets": ["paper", "paper"]}, r"simulate.presets: names one of its values twice"),
        ({"maps": False}, r"simulate.maps"),
        ({"route": {}}, r"simulate.route"),
    ],
)
def test_what_cannot_be_flown_is_refused_as_the_manifest_is_read(changes, words):
    with pytest.raises(ManifestError, match=words):
        manifest.parse(raw_manifest(simulate=QUICK | changes))


@pytest.mark.parametrize("own", [True, False], ids=["own gains", "carried over"])
def test_gains_for_a_payload_keep_the_poles_or_are_kept(own):
    bare = replace(CRAZYFLIE_AS_PRINTED, most_lift_N=0.6)
    loaded = replace(bare, mass_kg=bare.mass_kg + 0.005)
    gains = {"proportional": "-316 1/m/s", "derivative": "-316 1/m", "integral": "-31.6 1/m/s^2"}
    found = {}
    for name, craft in (("scaled", loaded), ("kept", loaded), ("none", bare)):
        asked = {"gains": {"ground": gains}} if own else {}
        if craft is loaded:
            asked |= {"mass": "32 g", "scale_gains": name == "scaled"}
        chosen = manifest.parse(raw_manifest(simulate=asked)).simulate
        groups = conditions(chosen, "ground", craft, 0.0, 0, map, bare.mass_kg).groups
        found[name] = gains_for(groups, craft), groups.noise * craft.weight_N
    bare_poles = poles(found["none"][0], bare, "ground")
    assert poles(found["scaled"][0], loaded, "ground") == pytest.approx(bare_poles)
    assert found["scaled"][0].kP == pytest.approx(found["none"][0].kP * np.sqrt(32 / 27))
    assert found["kept"][0].kD == pytest.approx(found["none"][0].kD)
    assert found["kept"][1] == found["scaled"][1] == pytest.approx(found["none"][1])


def test_a_payload_flies_and_one_that_the_rotors_cannot_carry_is_refused(remake):
    asked = QUICK | {"mass": "32 g"}
    vehicle = raw_manifest()["vehicle"] | {"thrust_limit": "0.31 N"}
    job = remake("ground", simulate=asked | {"presets": [], "flights": 20}, vehicle=vehicle)
    assert vehicle_of(job, job.campaign.simulate).mass_kg == pytest.approx(0.032)
    with pytest.raises(ManifestError, match=r"at most 0.31 N of a weight of 0.314 N"):
        simulate.run(job)


def test_the_usual_set_points_begin_above_what_the_vehicle_touches(remake):
    """A Crazyflie's feet are 24 mm below its rotors, so it touches at 1.04 radii."""
    touching = QUICK | {"flights": 20, "presets": [], "set_points": {}}
    job = remake("ground", simulate=touching, vehicle=VEHICLE | {"contact": {"ground": "24 mm"}})
    simulate.run(job)
    rates = job.read(CRASH_RATES)
    assert rates["target_z_hat"].min() == pytest.approx(1.2)
    assert set(rates["contact_z_hat"]) == {24 / 23}


@pytest.mark.parametrize(
    ("contact", "rig", "words"),
    [
        (
            {},
            {},
            r"vehicle.contact.ground: is missing.*what counts as a crash\n.*\[vehicle\] contact",
        ),
        ({"ground": "24 mm"}, {"distance_offset": "-30 mm"}, "put the rotors into the ground"),
    ],
)
def test_what_counts_as_a_crash_is_asked_for(remake, contact, rig, words):
    whole = raw_manifest()["rig"] | rig
    job = remake("ground", simulate=QUICK, vehicle=VEHICLE | {"contact": contact}, rig=whole)
    with pytest.raises(ManifestError, match=words):
        simulate.run(job)


def test_contact_is_measured_from_the_datum(remake):
    """Feet 4 mm above the floor when the datum, 20 mm under the rotors, reads 4 mm."""
    rig = raw_manifest()["rig"] | {"distance_offset": {"ground": "20 mm"}}
    job = remake("ground", vehicle=VEHICLE | {"contact": {"ground": "4 mm"}}, rig=rig)
    assert job.campaign.contact_m("ground") == pytest.approx(0.024)


def test_nothing_is_advised_where_lift_nearer_than_measured_decides(remake, monkeypatch):
    """A ground that pushes at many times the weight below its nearest station saves what lift held
    there loses: both readings are told, and neither is advised.
    """
    job = remake("ground", simulate=QUICK | {"flights": 60, "presets": [], "set_points": {}})
    wall = replace(quoted.fitted_lift(job, "ground", 3), measured_z_hat=(2.4, 11.0))
    monkeypatch.setattr(
        FittedLift,
        "ratio",
        lambda self, member=-1, **changes: lambda z: 1 + 20 * np.exp(-8 * (z - 0.52)) + 0.01 / z**2,
    )
    monkeypatch.setattr("nearlift.flight.quoted_lift.QuotedLifts.lift", lambda *args: wall)
    simulate.run(job)
    ground = job.read_json(SAFETY)["fitted"]["ground"]
    (level,) = ground["levels"]
    assert not level["agrees"]
    assert level["held"] > level["hi90"]
    (spec,) = (s for s in FIGURES if s.name == "safety")
    evidence = gather(job)
    told = spec.caption(evidence, spec.table(evidence))
    assert "No set-point is advised for a risk of 50 %" in told
    figure = drawn(spec.draw, spec.table(evidence), Style())
    assert "no set-point is advised" in [t.get_text() for ax in figure.axes for t in ax.texts]
    assert "no advice: it depends" in small_run.chapter(evidence, "safety")


def test_a_gain_without_a_unit_is_refused(remake):
    with pytest.raises(ManifestError, match="has no unit"):
        remake(
            simulate={
                "gains": {
                    "ground": {
                        "proportional": 316,
                        "derivative": "316 1/m",
                        "integral": "31.6 1/m/s^2",
                    }
                }
            }
        )


def test_the_manifest_decides_what_run_includes(remake):
    job = remake("ground")
    assert not stage_of(STAGES, "simulate").configured(job.campaign)
    assert stage_of(STAGES, "simulate").configured(remake("ground", simulate={}).campaign)


def diagnosed(job, boundary, **found):
    blocks = {boundary: {"coefficients": {}, "effects": [], **found}}
    job.write_json(DIAGNOSIS, quoted.diagnosis(blocks))
    quoted.write(job, blocks)


def span(value, half=0.0):
    return {"value": value, "lo90": value - half, "hi90": value + half}


def test_what_the_loop_found_flies_or_stays_on_the_bench(remake):
    job = remake("ground", "ceiling")
    sagging = {"name": "supply_sag", "parameters": {"sag_exponent": span(2.0, 0.1)}}
    joint = {"parameters": ["K_b", "sag_exponent"], "correlation": [[1.0, -0.8], [-0.8, 1.0]]}
    diagnosed(
        job,
        "ground",
        verdict="effect",
        effects=[sagging],
        coefficients={"after": {"K_b": span(1.8, 0.2)}},
        joint=joint,
    )
    belief = quoted.fitted_lift(job, "ground", 500)
    assert (belief.effects, belief.left, belief.source) == (("supply_sag",), (), "results.json")
    assert belief.best == {"K_b": 1.8, "sag_exponent": 2.0}
    assert belief.draws["K_b"].std() == pytest.approx(0.2 / 1.645, rel=0.15)
    # as wide as the intervals say, and together as the refit has them
    assert belief.draws["sag_exponent"].std() == pytest.approx(0.1 / 1.645, rel=0.15)
    assert np.corrcoef(belief.draws["K_b"], belief.draws["sag_exponent"])[0, 1] == pytest.approx(
        -0.8, abs=0.08
    )
    assert belief.droop(0.9 * belief.supply_V[0]) == pytest.approx(0.81 - 1)
    # the sag is in time: at the start of a flight the ratio is the bare model's
    bare = catalogue.model("sanchez_cuevas")(
        1.5, K_b=1.8, spacing_hat=65 / 23, diagonal_hat=np.sqrt(2) * 65 / 23
    )
    assert belief.ratio()(np.array([1.5])) == pytest.approx([float(bare)])
    datum = {"name": "height_offset", "parameters": {"offset_m": span(1e-3)}}
    diagnosed(
        job,
        "ceiling",
        verdict="effect",
        effects=[datum],
        coefficients={"after": {"alpha": span(0.1, 0.01)}},
    )
    belief = quoted.fitted_lift(job, "ceiling", 10)
    assert (belief.effects, belief.left, belief.model.name) == (
        (),
        ("height_offset",),
        "hsiao_chirarattananon",
    )
    assert belief.best == {"alpha": 0.1}
    saturated = {
        "name": "near_wall_saturation",
        "parameters": {"gap_hat2": span(0.02), "saturation_power": span(0.68)},
    }
    diagnosed(
        job,
        "ceiling",
        verdict="effect",
        effects=[saturated],
        coefficients={"after": {"alpha": span(0.1, 0.01)}},
    )
    belief = quoted.fitted_lift(job, "ceiling", 10)
    assert belief.effects == ("near_wall_saturation",)
    near, plain = belief.ratio()(np.array([0.1])), 0.5 + 0.5 * np.sqrt(1 + 0.1 / 0.01)
    assert 1 < near[0] < plain


def test_draws_have_the_ends_of_their_intervals_and_what_no_interval_bounds_is_not_taken_as_known(
    remake,
):
    job = remake("ceiling")
    bounded = {"value": 0.0, "lo90": 0.0, "hi90": 0.2}
    saturated = {
        "name": "near_wall_saturation",
        "parameters": {"gap_hat2": bounded, "saturation_power": span(0.68)},
    }
    alpha = {"value": 0.1, "lo90": 0.09, "hi90": 0.16}
    diagnosed(
        job,
        "ceiling",
        verdict="effect",
        effects=[saturated],
        coefficients={"after": {"alpha": alpha}},
    )
    draws = quoted.fitted_lift(job, "ceiling", 4000).draws
    assert np.percentile(draws["alpha"], [5, 50, 95]) == pytest.approx([0.09, 0.1, 0.16], abs=0.004)
    # an estimate at its bound keeps the width on the side that is free
    assert np.percentile(draws["gap_hat2"], [5, 95]) == pytest.approx([0.0, 0.2], abs=0.01)
    endless = {"value": 0.1, "lo90": None, "hi90": None}
    diagnosed(
        job,
        "ceiling",
        verdict="effect",
        effects=[saturated],
        coefficients={"after": {"alpha": endless}},
    )
    # its prior, mean 0.125 and sd 0.25, without what lies below 0
    prior = stats.truncnorm(-0.5, np.inf, loc=0.125, scale=0.25)
    assert np.percentile(
        quoted.fitted_lift(job, "ceiling", 4000).draws["alpha"], [25, 75]
    ) == pytest.approx(prior.ppf([0.25, 0.75]), rel=0.07)


def test_a_model_that_leaves_nothing_free_flies_is_found_and_is_exported(make_job):
    job = make_job(
        ("ground",),
        fit={"ground": {"base": "sanchez_cuevas_published"}},
        simulate=QUICK | {"presets": [], "flights": 20},
    )
    simulate.run(job)
    own = job.read_json(SAFETY)["fitted"]["ground"]
    assert (own["draws"], own["levels"][0]["model_only"][0]) == (1, own["levels"][0]["value"])
    detect.run(job)
    ranges = job.read(DETECTION)
    assert ranges["lo90"] == pytest.approx(ranges["hi90"])
    (path,) = export(job, ("c",))
    assert "K_b = 2" in Path(path).read_text()


def test_draws_are_those_of_what_is_quoted(remake):
    job = remake("ground")
    quoted.write(
        job,
        {"ground": {"coefficients": {"after": {"K_b": {"value": 5.5, "lo90": 5.0, "hi90": 6.0}}}}},
    )
    belief = quoted.fitted_lift(job, "ground", 2000)
    assert belief.source == "results.json"
    assert belief.number == 2000
    assert np.percentile(belief.draws["K_b"], [5, 95]) == pytest.approx([5.0, 6.0], abs=0.05)
    assert (
        json.loads((job.processed / "fit.json").read_text())["boundaries"]["ground"][
            "sanchez_cuevas"
        ]["parameters"]["K_b"]["value"]
        < 5
    )
