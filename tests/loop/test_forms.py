"""Effects with several forms: evidence over all of them, the likeliest kept."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.simulated import campaign, hsiao, problem

from nearlift import catalogue
from nearlift.errors import UsageError

CEILING = catalogue.model("hsiao_chirarattananon")
STATIONS = (0.1, 0.13, 0.17, 0.22, 0.3, 0.45, 0.7, 1.1, 2.0, 4.0)


@pytest.fixture(scope="module")
def cut_off():
    """A gain that viscous layers of 0.05 radii cut off."""

    def ratio(z):
        return 1 + (hsiao(z) - 1) * (1 - 1.5 * np.exp(-z / 0.05))

    data = campaign(
        3, boundary="ceiling", ratio=ratio, stations=STATIONS, relative=0.002, height=0.0
    )
    return problem(data, CEILING)


def test_the_likeliest_form_is_kept_and_evidence_is_the_mean_over_forms(cut_off):
    effect = catalogue.effect("near_wall_saturation")
    explanation = cut_off.explain((effect,))
    assert [e.form for e in explanation.fitted.candidate.effects] == ["cut-off"]
    each = [cut_off._likeliest((form,), (0.0,)).log_evidence for form in effect.forms]
    assert explanation.log_evidence == pytest.approx(np.log(np.mean(np.exp(each))))


def test_a_pair_has_the_forms_of_its_effects_alone(cut_off):
    saturation, sag = (
        cut_off.explain((catalogue.effect(name),))
        for name in ("near_wall_saturation", "supply_sag")
    )
    effects = (*saturation.fitted.candidate.effects, *sag.fitted.candidate.effects)
    pair = cut_off.explain(effects, (saturation, sag))
    assert pair.fitted.candidate.effects == effects
    assert pair.other_forms == saturation.other_forms < 0


def test_a_form_at_its_bound_is_not_kept_where_another_is_inside(cut_off):
    effect = catalogue.effect("near_wall_saturation")
    soft, layer = effect.forms
    narrow = [replace(p, bounds=(0.0, 0.01)) if not p.grid else p for p in layer.parameters]
    bounded = replace(effect, other_forms=(replace(layer, parameters=tuple(narrow)),))
    (kept,) = cut_off.explain((bounded,)).fitted.candidate.effects
    assert kept.form == soft.form


def test_a_form_is_found_by_its_name():
    assert catalogue.effect("plate_edge").form == catalogue.effect("plate_edge", "Gaussian").form
    assert catalogue.effect("plate_edge", "view factor").form == "view factor"
    with pytest.raises(UsageError, match="has no form 'square'"):
        catalogue.effect("plate_edge", "square")
