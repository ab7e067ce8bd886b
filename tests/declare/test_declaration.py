"""Declarations defend themselves when they are made, and effects compose with models into
models.
"""

from dataclasses import replace

import numpy as np
import pytest

from nearlift.declare import (
    Check,
    Effect,
    LiftModel,
    Parameter,
    Prior,
    Source,
    compose,
    keywords,
    normal,
    uniform,
)
from nearlift.errors import DeclarationError
from nearlift.models.images import CHEESEMAN_BENNETT, SANCHEZ_CUEVAS

SOURCE = Source("nobody", doubts=("all of it",))
GAIN = Parameter(
    name="gain", unit="1", value=0.0, bounds=(-1, 1), prior=normal(0, 0.1), meaning="relative gain"
)


def bell(z_hat, /, *, k):
    return 1 + k * np.exp(-np.square(z_hat))


def one_by_one(z_hat, /, *, k):
    return 1 + k if z_hat < 0.1 else 1.0


def mixed(z_hat, /, *, k):
    return bell(z_hat, k=np.mean(k))


def declare(**changes) -> LiftModel:
    k = Parameter(
        name="k", unit="1", value=0.5, bounds=(0, 2), prior=uniform(0, 2), meaning="gain at contact"
    )
    defaults = {
        "name": "bell",
        "title": "Bell",
        "formula": "1 + k",
        "evaluate": bell,
        "parameters": (k,),
        "source": SOURCE,
        "boundary": "ground",
        "checks": (Check(x=0.0, expected=1.5, quoted_by="own arithmetic"),),
    }
    return LiftModel(**{**defaults, **changes})


def effect(name="gain", evaluate=None, acts_on="force", **changes) -> Effect:
    defaults = {
        "name": name,
        "title": name,
        "formula": "L (1 + g)",
        "evaluate": evaluate or (lambda lift, /, *, gain: lift * (1 + gain)),
        "parameters": (GAIN,),
        "source": SOURCE,
        "acts_on": acts_on,
        "mechanism": "an amplifier",
        "varies_with": "start",
        "checks": (Check(x=1.0, expected=1.0, quoted_by="null"),),
    }
    return Effect(**{**defaults, **changes})


# --- parameters and priors


@pytest.mark.parametrize(
    ("value", "bounds"),
    [
        (3.0, (0.0, 2.0)),
        (-1.0, (0.0, 2.0)),
        (1.0, (2.0, 0.0)),
        (1.0, (1.0, 1.0)),
        (float("nan"), (0.0, 1.0)),
    ],
)
def test_value_outside_its_bounds_is_refused(value, bounds):
    with pytest.raises(
        DeclarationError,
        match=r"parameter p: value .* and bounds .* disagree\n  order them low < high",
    ):
        Parameter(name="p", unit="1", value=value, bounds=bounds, prior=uniform(0, 1), meaning="m")


def test_parameter_without_a_meaning_is_refused():
    with pytest.raises(DeclarationError, match="parameter p: has no meaning"):
        Parameter(name="p", unit="1", value=0, bounds=(-1, 1), prior=uniform(0, 1), meaning="")


def test_priors():
    assert uniform(2, 5).frozen().support() == (2, 5)
    assert normal(1, 2).frozen().std() == 2
    assert Prior(
        distribution="lognorm", shape=(1.0,), scale=3.0
    ).frozen().median() == pytest.approx(3.0)
    assert str(uniform(2, 5)) == "uniform on [2, 5]"
    assert str(normal(1, 2)) == "normal, mean 1, sd 2"
    assert (
        str(Prior(distribution="lognorm", shape=(1.0,), scale=3.0))
        == "log-normal, median 3, sd of the logarithm 1"
    )


# --- declarations


def test_keywords_are_the_keyword_only_names():
    assert keywords(bell) == ("k",)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"name": "Bell"}, "declaration Bell: the name is not a lower-case identifier"),
        ({"name": "my model"}, "declaration my model: the name is not a lower-case identifier"),
        ({"needs": ("k",)}, "a name occurs twice among parameters and needs"),
        (
            {"needs": ("spacing_hat",)},
            (
                r"evaluate takes \['k'\] but parameters and needs are \['k', 'spacing_hat'\]\n "
                r" name its keyword-only arguments as its parameters"
            ),
        ),
        ({"parameters": ()}, r"evaluate takes \['k'\] but parameters and needs are \[\]"),
        ({"source": Source("nobody")}, "its source has no doi and no doubts\n  give its doi"),
        ({"checks": ()}, "has no numeric check\n  give at least one number"),
        (
            {"checks": (Check(x=0.0, expected=1.6, quoted_by="a slip"),)},
            r"gives 1\.5 at x = 0\.0, not 1\.6 \(a slip\)\n  correct the function",
        ),
        ({"evaluate": one_by_one}, r"parameters of shape \(m, 1\): .*\n  use functions of numpy"),
        ({"evaluate": mixed}, r"parameters of shape \(m, 1\): rows are mixed\n  use functions"),
        (
            {"checks": (Check(x=float("nan"), expected=1.0, quoted_by="a slip"),)},
            "gives nan at x = nan",
        ),
        (
            {"boundary": "window"},
            "'window' is not a boundary\n  boundaries are ground, ceiling, sidewall",
        ),
        (
            {"downwash": lambda z, /: 1.0},
            r"downwash takes \[\] but evaluate takes \['k'\]\n  give both the same",
        ),
    ],
)
def test_contradiction_is_refused_when_it_is_made(changes, told):
    with pytest.raises(DeclarationError, match=told):
        declare(**changes)


def test_calling_fills_in_declared_values():
    assert float(declare()(0.0)) == 1.5
    assert float(declare()(0.0, k=1.0)) == 2.0


def test_calling_with_a_name_it_does_not_take_is_refused():
    with pytest.raises(
        DeclarationError, match=r"declaration bell: does not take \['K'\]\n  it takes \['k'\]"
    ):
        declare()(0.0, K=1.0)


def test_calling_without_what_it_needs_is_refused():
    with pytest.raises(
        DeclarationError, match=r"needs \['diagonal_hat'\]\n  give them as keywords"
    ):
        SANCHEZ_CUEVAS(1.0, spacing_hat=3.0)


def test_parameter_by_name():
    assert declare().parameter("k").value == 0.5
    with pytest.raises(DeclarationError, match=r"has no parameter 'q'\n  it has \['k'\]"):
        declare().parameter("q")


def test_suits():
    assert declare(rotors="one").suits(1, {})
    assert not declare(rotors="one").suits(4, {})
    assert declare(rotors="several").suits(4, {})
    assert not declare(rotors="several").suits(1, {})
    assert declare().suits(1, {})
    assert not SANCHEZ_CUEVAS.suits(4, {"spacing_hat": 3.0})


def test_effect_without_a_mechanism_is_refused():
    with pytest.raises(
        DeclarationError, match="effect gain: names no mechanism\n  only what has a physical cause"
    ):
        effect(mechanism="")


def test_effect_that_is_not_shown_to_vanish_is_refused():
    own = Check(x=1.0, expected=1.0, arguments={"gain": 0.0}, quoted_by="own arithmetic")
    with pytest.raises(DeclarationError, match=r"no check that it does nothing .*\n  add null\("):
        effect(checks=(own,))


# --- composition

HEIGHT = effect(
    "offset", lambda z, /, *, delta: z + delta, "height", parameters=(replace(GAIN, name="delta"),)
)
RATIO = effect(
    "power", lambda r, /, *, m: r ** (1 + m), "ratio", parameters=(replace(GAIN, name="m"),)
)
ADDED = effect(
    "tare",
    lambda lift, /, *, zero_N: lift + zero_N,
    "force",
    parameters=(replace(GAIN, name="zero_N", unit="N"),),
    additive=True,
)


def test_composed_model_is_a_model_that_does_nothing_new_at_the_null():
    model = compose(CHEESEMAN_BENNETT, HEIGHT, RATIO, effect())
    assert isinstance(model, LiftModel)
    assert model.name == "cheeseman_bennett_with_offset_with_power_with_gain"
    assert [p.name for p in model.parameters] == ["k", "delta", "m", "gain"]
    assert set(keywords(model.evaluate)) == {"k", "delta", "m", "gain"}
    z = np.linspace(0.5, 5, 9)
    np.testing.assert_array_equal(model(z), CHEESEMAN_BENNETT(z))


def test_height_acts_before_the_model_and_ratio_after():
    model = compose(CHEESEMAN_BENNETT, HEIGHT, RATIO)
    assert float(model(1.0, delta=0.5)) == pytest.approx(float(CHEESEMAN_BENNETT(1.5)))
    assert float(model(1.0, m=0.4)) == pytest.approx(float(CHEESEMAN_BENNETT(1.0)) ** 1.4)


def test_additive_force_needs_the_lift_far_away():
    model = compose(CHEESEMAN_BENNETT, ADDED)
    assert model.needs == ("lift_inf_N",)
    assert float(model(np.inf, zero_N=0.01, lift_inf_N=0.5)) == pytest.approx(1.02)


def test_effect_that_asks_for_the_height_gets_the_shifted_one():
    asking = effect(
        "fade",
        lambda r, /, *, m, z_hat: r + m * z_hat,
        "ratio",
        parameters=(replace(GAIN, name="m"),),
        needs=("z_hat",),
        checks=(Check(x=1.0, expected=1.0, arguments={"z_hat": 2.0}, quoted_by="null"),),
    )
    model = compose(CHEESEMAN_BENNETT, HEIGHT, asking)
    assert model.needs == ()
    assert float(model(1.0, delta=0.5, m=0.1)) == pytest.approx(
        float(CHEESEMAN_BENNETT(1.5)) + 0.15
    )


def test_composed_model_broadcasts():
    model = compose(SANCHEZ_CUEVAS, HEIGHT, effect())
    z, column = np.linspace(1, 5, 7), np.full((3, 1), 0.1)
    assert model(
        z, K_b=column, delta=column, gain=column, spacing_hat=2.83, diagonal_hat=4.0
    ).shape == (3, 7)


def test_two_parts_with_one_parameter_name_are_refused():
    with pytest.raises(
        DeclarationError,
        match=(
            r"compose\(cheeseman_bennett, ...\): two of the parts have a parameter of the same name"
        ),
    ):
        compose(CHEESEMAN_BENNETT, effect(), effect("again"))
