"""What every declared effect owes: nothing at its null, a slope there, shapes that broadcast, names
of its own.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearlift.declare import Effect, LiftModel, Parameter, compose
from nearlift.effects import EFFECTS, STAND_INS
from nearlift.models import MODELS
from nearlift.models.images import SANCHEZ_CUEVAS
from nearlift.models.momentum import HSIAO_CHIRARATTANANON
from nearlift.models.sidewall import SIDEWALL_DECAY

GEOMETRY = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}

every = pytest.mark.parametrize(
    "effect",
    [form for e in EFFECTS for form in e.forms],
    ids=lambda e: f"{e.name} {e.form}".strip(),
)


def trials(n: int = 24) -> dict[str, Any]:
    """What was recorded of n trials, the last of them in free air."""
    draw = np.random.default_rng(11)
    z_hat = np.append(np.geomspace(0.1, 12.0, n - 1), np.inf)
    return {
        "z_hat": z_hat,
        "throttle": draw.choice([0.25, 0.5, 0.75, 0.92], n),
        "supply_V": draw.uniform(3.3, 4.0, n),
        "speed_hat": draw.uniform(0.97, 1.03, n),
        "temperature_K": draw.uniform(290.0, 300.0, n),
        "pressure_Pa": draw.uniform(99e3, 102e3, n),
        "humidity": draw.uniform(0.2, 0.8, n),
        "approach": draw.choice([-1.0, 0.0, 1.0], n),
        "tilt_rad": draw.uniform(-0.08, 0.08, n),
        "start_s": 20.0 * np.arange(n),
        "session": np.arange(n) // 8,
        "since_start_s": 20.0 * (np.arange(n) % 8),
        "elapsed_hat": np.linspace(-1.0, 1.0, n),
        "previous_lift_N": draw.uniform(0.0, 0.55, n),
        "rest_s": draw.uniform(3.0, 60.0, n),
        "drift_hat": draw.uniform(-0.03, 0.0, n),
        "inverted": draw.choice([0.0, 1.0], n),
        "turn_rad": draw.choice([0.0, 0.5, 1.0], n) * np.pi,
        "other_propeller": (np.arange(n) > 9).astype(float),
        "fountain_side": draw.choice([-1.0, 1.0], n),
        "supply_ref_V": 3.65,
        "temperature_ref_K": 294.0,
        "pressure_ref_Pa": 100.5e3,
        "throttle_ref": 0.6,
        "radius_m": 0.023,
        **GEOMETRY,
    }


#: Covariates of trials, measured and derived; and what all trials share.
ARRAYS = {name for name, values in trials().items() if np.ndim(values)}
SCALARS = trials().keys() - ARRAYS


def of(effect: Effect, known: dict[str, Any]) -> dict[str, Any]:
    return {name: known[name] for name in effect.needs}


def argument(effect: Effect, known: dict[str, Any]) -> Any:
    """A height, ratio or force that the effect might meet at these trials."""
    z_hat = known["z_hat"]
    ratio = 0.5 + 0.5 * np.sqrt(1.0 + 0.125 / np.square(z_hat))
    return {"height": z_hat, "ratio": ratio, "force": 0.6 * known["throttle"] * ratio}[
        effect.acts_on
    ]


def sizes(effect: Effect) -> tuple[Parameter, ...]:
    return tuple(p for p in effect.parameters if not p.grid)


def shapes(effect: Effect) -> tuple[Parameter, ...]:
    return tuple(p for p in effect.parameters if p.grid)


def test_no_two_parameters_share_a_name() -> None:
    names = [p.name for e in EFFECTS for p in e.parameters]
    assert len(set(names)) == len(names)
    assert not set(names) & (ARRAYS | SCALARS | {n for m in MODELS for n in m.needs})


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e.other_forms], ids=lambda e: e.name)
def test_forms_of_an_effect_differ_in_name_and_form_alone(effect: Effect) -> None:
    assert all(form.form for form in effect.forms)
    assert len({form.form for form in effect.forms}) == len(effect.forms)
    own = {"form", "other_forms", "formula", "evaluate", "parameters", "needs", "source", "checks"}
    for form in effect.other_forms:
        for field in {f.name for f in dataclasses.fields(Effect)} - own - {"notes"}:
            assert getattr(form, field) == getattr(effect, field)
        assert set(form.needs) <= {*effect.needs, "z_hat"}


@every
def test_declares_what_it_is(effect: Effect) -> None:
    assert effect.mechanism
    assert effect.mechanism[0].islower()
    for phrase in ("Convention:", "Confounded with"):
        assert effect.notes.count(phrase) == 1, f"write one paragraph {phrase!r} into the docstring"
    assert effect.source.citation
    unknown = {*effect.needs, effect.varies_with} - ARRAYS - SCALARS
    assert not unknown, "give trials() of this file a value of each"
    assert sizes(effect)
    assert len([p for p in shapes(effect) if len(p.grid) > 1]) <= 1
    assert len(effect.checks) > 1, "give a check of a size that is not the null"
    if effect.additive:
        assert effect.acts_on == "force"
    always = {"z_hat", "throttle", "previous_lift_N"} | SCALARS | set(STAND_INS)
    assert effect.log_next_time or not set(effect.needs) - always
    # the states of the fountain are confounded with nothing
    assert bool(effect.separated_by) == (effect.name != "fountain_state"), "give separated_by"
    assert not effect.separated_by.endswith(".")
    by_session = "since_start_s" in effect.needs or any(p.per for p in effect.parameters)
    assert "session" in effect.needs or not by_session
    for p in shapes(effect):
        # one value: where a search starts is no matter, but it is no size either
        assert 1 <= len(p.grid) <= 5
        assert all(p.bounds[0] <= g <= p.bounds[1] for g in p.grid)
        assert p.value in p.grid
        assert list(p.grid) == sorted(p.grid)
    for p in effect.parameters:
        assert math.isfinite(float(p.prior.frozen().logpdf(p.value)))


@every
def test_does_nothing_at_its_null_exactly_whatever_its_shapes(effect: Effect) -> None:
    known = trials()
    x = argument(effect, known)
    np.testing.assert_array_equal(effect(x, **of(effect, known)), x)
    for p in shapes(effect):
        for value in (*p.grid, *p.bounds):
            np.testing.assert_array_equal(effect(x, **of(effect, known), **{p.name: value}), x)


@every
def test_every_size_has_a_slope_at_the_null(effect: Effect) -> None:
    known = trials()
    x = argument(effect, known)
    finite = np.isfinite(x)
    for p in sizes(effect):
        step = 1e-6 * (p.bounds[1] - p.bounds[0])
        for shape in [{}, *({s.name: g} for s in shapes(effect) for g in s.grid)]:
            slope, twice = (
                (
                    effect(x, **of(effect, known), **shape, **{p.name: p.value + h})[finite]
                    - x[finite]
                )
                / h
                for h in (step, 2 * step)
            )
            assert np.isfinite(slope).all()
            assert np.abs(slope).max() > 1e-4
            np.testing.assert_allclose(twice, slope, rtol=2e-3, atol=1e-6 * np.abs(slope).max())


@every
def test_parameters_broadcast_against_trials(effect: Effect) -> None:
    known = trials()
    x = argument(effect, known)
    m, n = 5, len(x)
    grid = {
        p.name: np.linspace(
            0.9 * p.value + 0.1 * p.bounds[0], 0.9 * p.value + 0.1 * p.bounds[1], m
        )[:, None]
        for p in effect.parameters
    }
    got = effect(x, **of(effect, known), **grid)
    assert got.shape == (m, n)
    for i in range(m):
        np.testing.assert_allclose(
            got[i],
            effect(x, **of(effect, known), **{name: float(v[i, 0]) for name, v in grid.items()}),
            rtol=1e-14,
        )
    if any(p.per for p in effect.parameters):
        spread = {p.name: np.linspace(0.0, 0.1 * p.bounds[1], n) for p in effect.parameters}
        assert effect(x, **of(effect, known), **spread).shape == (n,)


@pytest.mark.parametrize(
    "effect", [e for e in EFFECTS if e.acts_on == "force" and not e.additive], ids=lambda e: e.name
)
def test_relative_force_effects_are_factors(effect: Effect) -> None:
    known = trials()
    x = argument(effect, known)
    moved = {p.name: p.bounds[0] + 0.8 * (p.bounds[1] - p.bounds[0]) for p in effect.parameters}
    np.testing.assert_allclose(
        effect(7.0 * x, **of(effect, known), **moved),
        7.0 * effect(x, **of(effect, known), **moved),
        rtol=1e-13,
    )


@every
def test_free_air_stays_free_air(effect: Effect) -> None:
    known = trials()
    known["approach"][-1] = known["tilt_rad"][-1] = np.nan
    moved = {p.name: p.bounds[0] + 0.8 * (p.bounds[1] - p.bounds[0]) for p in effect.parameters}
    x = argument(effect, known)
    got = effect(x, **of(effect, known), **moved)[-1]
    if effect.acts_on == "force":
        assert np.isfinite(got)
    else:
        assert got == x[-1]


@every
@pytest.mark.parametrize(
    "model",
    [SANCHEZ_CUEVAS, HSIAO_CHIRARATTANANON, SIDEWALL_DECAY],
    ids=lambda m: m.name,
)
def test_composed_with_a_model_it_is_that_model_at_the_null(
    effect: Effect, model: LiftModel
) -> None:
    known = trials()
    near = {n: v[6:] if isinstance(v, np.ndarray) else v for n, v in known.items()}
    both = compose(model, effect)
    assert isinstance(both, LiftModel)
    values = {n: near[n] if n != "lift_inf_N" else 0.6 * near["throttle"] for n in both.needs}
    alone = model(near["z_hat"], **{n: near[n] for n in model.needs})
    np.testing.assert_allclose(both(near["z_hat"], **values), alone, rtol=1e-14)


def test_all_effects_together_are_a_model_again() -> None:
    known = {n: v[12:] if isinstance(v, np.ndarray) else v for n, v in trials().items()}
    both = compose(SANCHEZ_CUEVAS, *EFFECTS)
    values = {n: known[n] if n != "lift_inf_N" else 0.6 * known["throttle"] for n in both.needs}
    np.testing.assert_allclose(
        both(known["z_hat"], **values), SANCHEZ_CUEVAS(known["z_hat"], **GEOMETRY), rtol=1e-13
    )


@every
@settings(max_examples=60)
@given(data=st.data())
def test_is_finite_within_its_bounds(effect: Effect, data: st.DataObject) -> None:
    known = trials()
    drawn = {p.name: data.draw(st.floats(*p.bounds), label=p.name) for p in effect.parameters}
    x = argument(effect, known)
    got = effect(x, **of(effect, known), **drawn)
    assert not np.isnan(got).any()
    assert np.isfinite(got[np.isfinite(x)]).all()


@pytest.mark.parametrize("z_hat", [0.0, -0.05])
@pytest.mark.parametrize(
    "name",
    [
        "near_wall_saturation",
        "airframe_stagnation",
        "fountain_shape",
        "fountain_state",
        "plate_edge",
        "room_recirculation",
        "tether_stiffness",
        "tilt",
    ],
)
def test_contact_does_not_break_an_effect(name: str, z_hat: float) -> None:
    effect = next(e for e in EFFECTS if e.name == name)
    known = {**trials(), "z_hat": z_hat}
    moved = {p.name: p.value + 0.5 * (p.bounds[1] - p.value) for p in effect.parameters}
    assert np.isfinite(effect(0.95, **of(effect, known), **moved)).all()


def test_stand_ins_change_nothing() -> None:
    density = next(e for e in EFFECTS if e.name == "air_density")
    plain = {
        "temperature_K": 294.0,
        "temperature_ref_K": 294.0,
        **{n: STAND_INS[n] for n in density.needs if n in STAND_INS},
    }
    assert density(0.3, **plain, density_exponent=1.0) == 0.3
    creep = next(e for e in EFFECTS if e.name == "cell_creep")
    assert creep(0.3, previous_lift_N=0.5, rest_s=STAND_INS["rest_s"], creep=0.01) == pytest.approx(
        0.305
    )
    with pytest.raises(TypeError):
        STAND_INS["rest_s"] = 1.0  # type: ignore[index]


def test_what_cannot_be_is_refused_with_nan() -> None:
    held, image = (
        next(e for e in EFFECTS if e.name == n) for n in ("held_quantity", "image_strength")
    )
    assert np.isnan(held(-0.1, held_exponent=0.5))
    assert np.isnan(image(3.0, strength=1.6))
    assert np.isfinite(image(2.3, strength=1.7))
