"""One contract for everything declared, whether nearlift brings it or an installed package does."""

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearlift import catalogue
from nearlift.declare import (
    BOUNDARIES,
    Check,
    Declaration,
    LiftModel,
    Parameter,
    keywords,
    uniform,
    variant,
)
from nearlift.errors import DeclarationError
from nearlift.models import MODELS as BUILT_IN
from nearlift.models.images import square
from nearlift.nomenclature import SYMBOLS

GEOMETRY = {
    "spacing_hat": 65 / 23,
    "diagonal_hat": 92 / 23,
    "layout_hat": square(65 / 23),
    "gap_hat": math.inf,
    "edge_hat": 4.0,
    "tilt_rad": 0.02,
}
MODELS = catalogue.models()
every_model = pytest.mark.parametrize("model", MODELS, ids=lambda m: m.name)
every_declaration = pytest.mark.parametrize(
    "item", [*MODELS, *catalogue.effects()], ids=lambda d: d.name
)


def known(model: LiftModel) -> dict:
    return {name: GEOMETRY[name] for name in model.needs}


def declared(model: LiftModel) -> dict:
    return {p.name: p.value for p in model.parameters}


def heights(model: LiftModel) -> st.SearchStrategy:
    low, high = model.valid_z_hat
    return st.floats(max(low, 1e-3), min(high, 1e3), exclude_min=True)


def draws(model: LiftModel) -> st.SearchStrategy:
    return st.fixed_dictionaries({p.name: st.floats(*p.bounds) for p in model.parameters})


# --- every declaration: what it says about itself


@every_declaration
def test_says_what_it_is_and_its_priors_include_the_declared_value(item: Declaration):
    assert item.title
    assert item.formula
    assert item.source.citation
    assert all(check.quoted_by for check in item.checks)
    for p in item.parameters:
        assert p.meaning
        assert p.unit
        prior = p.prior.frozen()
        assert np.isfinite(prior.logpdf(p.value)), p.name
        # half of a normal prior is cut off on purpose where only one sign is physical, and of the
        # rest a tail that physics does not reach
        assert prior.cdf(p.bounds[1]) - prior.cdf(p.bounds[0]) > 0.43, p.name


# --- every model: how its ratio behaves


@every_model
def test_broadcasts_parameters_against_heights(model: LiftModel):
    m, z = 4, np.linspace(max(0.6, 1.01 * model.valid_z_hat[0]), 5.0, 7)
    columns = {name: np.full((m, 1), value) for name, value in declared(model).items()}
    expected = (m, z.size) if columns else z.shape
    got = np.asarray(model.evaluate(z, **columns, **known(model)))
    assert got.shape == expected
    row = np.asarray(model.evaluate(z, **declared(model), **known(model)))
    np.testing.assert_allclose(got, np.broadcast_to(row, expected), rtol=1e-12)
    if model.downwash is not None:
        assert np.asarray(model.downwash(z, **columns, **known(model))).shape == expected


@every_model
def test_heights_of_any_shape_are_each_their_own(model: LiftModel):
    z = np.linspace(max(0.6, 1.01 * model.valid_z_hat[0]), 5.0, 6)
    given = {**declared(model), **known(model)}
    for function in (model.evaluate, model.downwash):
        if function is not None:
            row, table = (np.asarray(function(x, **given)) for x in (z, z.reshape(2, 3)))
            np.testing.assert_allclose(table, row.reshape(2, 3), rtol=1e-12)
    assert np.ndim(model(2.0, **known(model))) == 0


@every_model
@given(data=st.data())
def test_is_finite_or_refuses_with_nan(model: LiftModel, data: st.DataObject):
    z, theta = data.draw(heights(model)), data.draw(draws(model))
    ratio = float(model.evaluate(z, **theta, **known(model)))
    assert math.isnan(ratio) or math.isfinite(ratio)


@every_model
@given(data=st.data())
def test_has_a_value_at_its_declared_parameters(model: LiftModel, data: st.DataObject):
    low = max(model.valid_z_hat[0], 0.1)
    # the pole of several images lies a little above that of one, where valid_z_hat begins
    z = data.draw(st.floats(1.35 * low, 1e3))
    ratio = float(model.evaluate(z, **declared(model), **known(model)))
    assert 0 < ratio < math.inf


@every_model
@given(data=st.data())
def test_has_exactly_no_effect_in_free_air(model: LiftModel, data: st.DataObject):
    theta = data.draw(draws(model))
    far = float(model.evaluate(np.inf, **theta, **known(model)))
    if model.tends_to_one:
        assert far == pytest.approx(1.0, abs=1e-12)
        if model.downwash is not None:
            assert float(model.downwash(np.inf, **theta, **known(model))) == pytest.approx(
                1.0, abs=1e-12
            )
    else:
        assert far != pytest.approx(1.0, abs=1e-6), "it does tend to 1: say so"


@pytest.mark.parametrize("model", [m for m in MODELS if m.tends_to_one], ids=lambda m: m.name)
def test_tends_to_one_gradually(model: LiftModel):
    gap = np.abs(
        np.asarray(model.evaluate(np.array([1e1, 1e2, 1e3]), **declared(model), **known(model))) - 1
    )
    assert gap[0] < 0.02
    assert (np.diff(gap) <= 0).all()


@every_model
def test_gain_fades_with_distance(model: LiftModel):
    z = np.geomspace(max(0.5, 1.35 * model.valid_z_hat[0]), 50, 200)
    ratio = np.asarray(model.evaluate(z, **declared(model), **known(model)))
    if model.boundary == "sidewall":
        assert (ratio <= 1).all()
        assert (np.diff(ratio) >= 0).all()
    else:
        assert (np.diff(ratio) <= 0).all()
        assert ratio[0] > 1


@pytest.mark.parametrize("model", [m for m in MODELS if m.downwash], ids=lambda m: m.name)
def test_downwash_is_reduced_where_lift_is_gained(model: LiftModel):
    assert model.downwash is not None
    z = np.linspace(0.6, 10, 50)
    left = np.asarray(model.downwash(z, **declared(model), **known(model)))
    assert ((left > 0) & (left <= 1)).all()
    assert (np.diff(left) >= 0).all()


@every_model
@settings(max_examples=20)
@given(data=st.data())
def test_raises_no_warning_at_or_behind_the_boundary(model: LiftModel, data: st.DataObject):
    z = data.draw(st.floats(-10, 0))  # warnings are errors here
    model.evaluate(np.array([z, 0.0, np.nan]), **declared(model), **known(model))


@pytest.mark.parametrize(
    "model", BUILT_IN, ids=lambda m: m.name
)  # a package's own names are its own affair
def test_names_are_in_the_nomenclature(model: LiftModel):
    missing = {*keywords(model.evaluate)} - {s.name for s in SYMBOLS}
    assert not missing, "add a row for each to pipeline/nearlift/symbols.csv"


# --- the catalogue


def test_names_are_unique_over_all_kinds():
    names = [d.name for d in (*catalogue.models(), *catalogue.effects())]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("rotors", [1, 2, 4, 6])
def test_base_and_rivals_exist_and_suit(boundary, rotors):
    geometry = GEOMETRY if rotors > 1 else {"layout_hat": ((0.0, 0.0),)}
    base = catalogue.model(catalogue.default_base(boundary, rotors))
    rivals = catalogue.default_rivals(boundary, rotors, geometry)
    assert base.boundary == boundary
    assert base.suits(rotors, geometry)
    assert rivals
    assert base.name not in rivals
    assert all(
        catalogue.model(r).suits(rotors, geometry) and catalogue.model(r).boundary == boundary
        for r in rivals
    )


def test_base_models_and_headline_coefficients_are_the_contracts():
    expected = {
        ("ground", 4): ("sanchez_cuevas", "K_b", 2.0),
        ("ground", 1): ("cheeseman_bennett", "k", 1.0),
        ("ceiling", 4): ("hsiao_chirarattananon", "alpha", 0.125),
        ("sidewall", 4): ("sidewall_decay", "a", 0.05),
    }
    for (boundary, rotors), (name, coefficient, value) in expected.items():
        assert catalogue.default_base(boundary, rotors) == name
        first = catalogue.model(name).parameters[0]
        assert (first.name, first.value) == (coefficient, value)


def test_rivals_without_geometry_leave_out_what_needs_it():
    assert "images" not in catalogue.default_rivals("ground", 4, {})


def test_importing_the_catalogue_imports_nothing_heavy():
    code = (
        "import nearlift.catalogue, nearlift.describe, sys; print([m for m in"
        " ('pandas','scipy','matplotlib','pyarrow','pint') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


# --- variants of a model


def test_a_variant_is_its_model_with_parameters_held_or_an_exponent():
    base = next(m for m in BUILT_IN if m.name == "exponential")
    n = Parameter(
        name="n", unit="1", value=1.0, bounds=(0.1, 2.0), prior=uniform(0, 2), meaning="n"
    )
    z = np.array([0.5, 1.0, np.inf])
    held = variant(base, held={"a": 0.3}, name="held", checks=(Check(x=np.inf, expected=1.0),))
    raised = variant(base, exponent=n, name="raised")
    assert keywords(held.evaluate) == ("b",)
    assert [p.name for p in raised.parameters] == ["a", "b", "n"]
    np.testing.assert_array_equal(held(z, b=2.0), base(z, a=0.3, b=2.0))
    np.testing.assert_array_equal(raised(z, n=0.7), base(z) ** 0.7)
    np.testing.assert_array_equal(raised(z), base(z))
    columns = raised.evaluate(z, a=0.3, b=2.0, n=np.array([[0.5], [1.0]]))
    np.testing.assert_array_equal(columns[1], base(z, a=0.3, b=2.0))
    with pytest.raises(DeclarationError, match="gives"):
        variant(base, exponent=0.5, name="unchecked")
