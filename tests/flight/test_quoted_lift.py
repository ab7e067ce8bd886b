"""The lift that flies, detects and is exported: effects that belong to the vehicle, and draws."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from tests.unit import quoted

from nearlift import catalogue
from nearlift.stages import detect, simulate
from nearlift.stages.detect import DETECTION
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.export import export
from nearlift.stages.simulate import SAFETY


def span(value, half=0.0):
    return {"value": value, "lo90": value - half, "hi90": value + half}


SATURATION = {
    "name": "near_wall_saturation",
    "parameters": {"gap_hat2": span(0.02), "saturation_power": span(0.68)},
}


def diagnosed(job, boundary, effect, coefficients, **block):
    """The job with this effect named by the loop."""
    blocks = {
        boundary: {
            "verdict": "effect",
            "effects": [effect],
            "coefficients": {"after": coefficients},
            **block,
        }
    }
    job.write(DIAGNOSIS, quoted.diagnosis(blocks))
    quoted.write(job, blocks)


def test_an_effect_of_the_vehicle_flies_with_the_joint_draws(remake):
    job = remake("ground")
    sag = {"name": "supply_sag", "parameters": {"sag_exponent": span(2.0, 0.1)}}
    joint = {"parameters": ["K_b", "sag_exponent"], "correlation": [[1.0, -0.8], [-0.8, 1.0]]}
    diagnosed(job, "ground", sag, {"K_b": span(1.8, 0.2)}, joint=joint)
    lift = quoted.fitted_lift(job, "ground", 500)
    assert (lift.effects, lift.left) == (("supply_sag",), ())
    assert lift.best == {"K_b": 1.8, "sag_exponent": 2.0}
    # as wide as the intervals say, and together as the refit has them
    assert lift.draws["K_b"].std() == pytest.approx(0.2 / 1.645, rel=0.15)
    assert lift.draws["sag_exponent"].std() == pytest.approx(0.1 / 1.645, rel=0.15)
    both = np.corrcoef(lift.draws["K_b"], lift.draws["sag_exponent"])
    assert both[0, 1] == pytest.approx(-0.8, abs=0.08)
    left = lift.supply_V[1] / lift.supply_V[0]
    exponents = [2.0, *lift.draws["sag_exponent"]]
    assert left < 1
    assert lift.droop() == pytest.approx(left ** np.array(exponents) - 1)
    # the sag is in time: at the start of a flight the ratio is the bare model's
    bare = catalogue.model("sanchez_cuevas")(
        1.5, K_b=1.8, spacing_hat=65 / 23, diagonal_hat=np.sqrt(2) * 65 / 23
    )
    assert lift.ratio()(np.array([1.5])) == pytest.approx([float(bare)])


def test_an_effect_of_the_bench_stays_there(remake):
    job = remake("ceiling")
    offset = {"name": "height_offset", "parameters": {"offset_m": span(1e-3)}}
    diagnosed(job, "ceiling", offset, {"alpha": span(0.1, 0.01)})
    lift = quoted.fitted_lift(job, "ceiling", 10)
    assert (lift.effects, lift.left) == ((), ("height_offset",))
    assert (lift.model.name, lift.best) == ("hsiao_chirarattananon", {"alpha": 0.1})
    diagnosed(job, "ceiling", SATURATION, {"alpha": span(0.1, 0.01)})
    lift = quoted.fitted_lift(job, "ceiling", 10)
    assert lift.effects == ("near_wall_saturation",)
    near, plain = lift.ratio()(np.array([0.1])), 0.5 + 0.5 * np.sqrt(1 + 0.1 / 0.01)
    assert 1 < near[0] < plain


def test_an_effect_flies_in_the_form_that_was_likeliest(remake):
    job = remake("ceiling")
    layer = {
        "name": "near_wall_saturation",
        "form": "cut-off",
        "parameters": {"viscous_share": span(0.5), "layer_hat": span(0.2)},
    }
    diagnosed(job, "ceiling", layer, {"alpha": span(0.1)})
    lift = quoted.fitted_lift(job, "ceiling", 20)
    bare = catalogue.model("hsiao_chirarattananon")(0.2, alpha=0.1)
    by_hand = 1 + (bare - 1) * (1 - 0.5 * np.exp(-1))
    assert lift.ratio()(np.array([0.2])) == pytest.approx([by_hand])


def test_draws_have_the_ends_of_their_intervals_and_unbounded_ones_their_prior(remake):
    job = remake("ceiling")
    bounded = {"value": 0.0, "lo90": 0.0, "hi90": 0.2}
    saturation = {
        "name": "near_wall_saturation",
        "parameters": {"gap_hat2": bounded, "saturation_power": span(0.68)},
    }
    alpha = {"value": 0.1, "lo90": 0.09, "hi90": 0.16}
    diagnosed(job, "ceiling", saturation, {"alpha": alpha})
    draws = quoted.fitted_lift(job, "ceiling", 4000).draws
    assert np.percentile(draws["alpha"], [5, 50, 95]) == pytest.approx([0.09, 0.1, 0.16], abs=0.004)
    # an estimate at its bound keeps the width on the side that is free
    assert np.percentile(draws["gap_hat2"], [5, 95]) == pytest.approx([0.0, 0.2], abs=0.01)
    unbounded = {"value": 0.1, "lo90": None, "hi90": None}
    diagnosed(job, "ceiling", saturation, {"alpha": unbounded})
    # its prior, mean 0.125 and sd 0.25, without what lies below 0
    prior = stats.truncnorm(-0.5, np.inf, loc=0.125, scale=0.25)
    draws = quoted.fitted_lift(job, "ceiling", 4000).draws
    quartiles = np.percentile(draws["alpha"], [25, 75])
    assert quartiles == pytest.approx(prior.ppf([0.25, 0.75]), rel=0.07)


def test_draws_are_those_of_the_quoted_interval_not_of_the_base_fit(remake):
    job = remake("ground")
    after = {"K_b": {"value": 5.5, "lo90": 5.0, "hi90": 6.0}}
    quoted.write(job, {"ground": {"coefficients": {"after": after}}})
    lift = quoted.fitted_lift(job, "ground", 2000)
    assert lift.number == 2000
    assert np.percentile(lift.draws["K_b"], [5, 95]) == pytest.approx([5.0, 6.0], abs=0.05)


def test_a_model_without_free_parameters_flies_is_detected_and_exported(make_job, monkeypatch):
    monkeypatch.setattr("nearlift.flight.fitted.ADVISED_FLIGHTS", 20)
    job = make_job(
        ("ground",),
        fit={"ground": {"base": "sanchez_cuevas_published"}},
        simulate={"presets": [], "flights": 20, "risks": [0.5]},
    )
    simulate.run(job)
    own = job.read_json(SAFETY)["fitted"]["ground"]
    assert (own["draws"], len(own["levels"])) == (1, 1)
    detect.run(job)
    ranges = job.read(DETECTION)
    assert ranges["lo90"] == pytest.approx(ranges["hi90"])
    (path,) = export(job, ("c",))
    assert "K_b = 2" in Path(path).read_text()
