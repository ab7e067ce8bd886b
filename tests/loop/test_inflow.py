"""Measured downwash as evidence: which effects change the inflow, and how probable a cut is."""

from functools import cache

import numpy as np
import pytest
from scipy.stats import norm
from tests.unit.simulated import campaign, hsiao, sanchez_cuevas

from nearlift import catalogue
from nearlift.declare import compose
from nearlift.loop.diagnose import set_up
from nearlift.loop.inflow import NOT_THE_INFLOW, MeasuredDownwash, log_density
from nearlift.loop.search_problem import Options, SearchProblem
from nearlift.observed import at_the_disk
from nearlift.results.diagnosis import FORM_SD

THEORY = catalogue.model("cheeseman_bennett_fixed")
CEILING = catalogue.model("hsiao_chirarattananon")


@cache
def problem(boundary: str, *cuts: MeasuredDownwash) -> SearchProblem:
    base = CEILING if boundary == "ceiling" else THEORY
    ratio = hsiao if boundary == "ceiling" else sanchez_cuevas
    data = campaign(1, boundary=boundary, ratio=ratio)
    return set_up(data, base, (), Options(downwash=cuts))[0]


@pytest.mark.parametrize(
    ("effect", "values", "expected"),
    [
        # by hand: the image cancels 1/16 of the inflow at one radius
        ("image_strength", {"strength": 0.5}, 1 - 0.5 / 16),
        ("height_scale", {"z_scale": 1.0}, 1 - 1 / 64),
        ("held_quantity", {"held_exponent": 0.5}, 15 / 16),
        ("airframe_stagnation", {"stagnation": 0.1}, 15 / 16),
    ],
)
def test_an_effect_declares_whether_it_changes_the_inflow(effect, values, expected):
    model = compose(THEORY, catalogue.effect(effect))
    assert model.downwash is not None
    known = {p.name: p.value for p in model.parameters} | values
    assert model.downwash(1.0, **known) == pytest.approx(expected)


def test_density_of_a_model_without_parameters_is_by_hand():
    fitted = problem("ground").base_fit
    cut = MeasuredDownwash(z_hat=1.0, ratio=0.9, u=0.01)
    sd = np.hypot(0.01, FORM_SD / 16)
    by_hand = (1 - NOT_THE_INFLOW) * norm.pdf(0.9, 15 / 16, sd) + NOT_THE_INFLOW
    assert log_density((cut,), fitted) == pytest.approx(np.log(by_hand))
    assert log_density((), fitted) == 0.0


def test_a_cut_that_no_explanation_predicts_favours_none():
    fits = problem("ceiling").base_fit, saturated(problem("ceiling")).fitted
    far_off = (MeasuredDownwash(z_hat=0.5, ratio=0.1, u=0.01),)
    expected = pytest.approx(np.log(NOT_THE_INFLOW), abs=1e-6)
    assert [log_density(far_off, f) for f in fits] == [expected, expected]


def saturated(of: SearchProblem):
    return of.explain((catalogue.effect("near_wall_saturation"),))


def test_evidence_over_the_base_model_is_added_to_both_forms():
    cut = MeasuredDownwash(z_hat=0.2, ratio=0.7, u=0.01)
    plain, with_cut = (saturated(problem("ceiling", *c)) for c in ((), (cut,)))
    of = problem("ceiling", cut)
    added = log_density((cut,), plain.fitted) - log_density((cut,), of.base_fit)
    assert added != pytest.approx(0.0, abs=1e-3)
    for form in ("exact", "discrepant"):
        change = getattr(with_cut, form) - getattr(plain, form)
        assert change == pytest.approx(added, rel=1e-6)
    assert with_cut.unnamed == plain.unnamed


def test_only_level_cuts_at_the_disk_count():
    rows = {
        "rotor": ["all", "0", "all", "all", "all", "all"],
        "boundary": ["ground", "ground", "ceiling", "ground", "ground", "ground"],
        "tilt_rad": [0.0, 0.0, 0.0, 0.1, 0.0, 0.0],
        "warnings": ["no_scatter", "", "", "", "deflection_zone", ""],
        "u_reduction": [0.01, 0.01, 0.01, 0.01, 0.01, np.nan],
        "z_hat": [3.0, 3.0, 2.0, 3.0, 1.5, 4.0],
        "reduction": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
    }
    cuts = {
        k: np.array(v, dtype=object if isinstance(v[0], str) else float) for k, v in rows.items()
    }
    assert at_the_disk(cuts, "ground") == (MeasuredDownwash(z_hat=3.0, ratio=0.9, u=0.01),)
