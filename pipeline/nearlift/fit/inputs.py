"""Inputs of a lift model with an uncertainty: rotor radius and spacing, exponent, air density,
mass.

An input's error is an unknown of the likelihood like any other. It acts on log lift by the model's
own derivative at the fitted coefficients. The derivative is per relative change of the input, or
per unit change of the exponent, whose nominal value is 1.

- `rotor_radius` scales every distance and spacing at once, since a model sees them as multiples of
  it.
- `rotor_spacing` scales the layout, except a diagonal or positions that the manifest gives.
- `exponent` is that of ``(L / L_inf)^n``, which depends on the held quantity.
- `air_density` scales lift: an L_inf per throttle absorbs it unless it differs by session.
- `mass` does not act on a tethered vehicle's lift.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import numpy as np

from nearlift import derivative
from nearlift.declare import FloatArray, LiftModel
from nearlift.fit.information import UNITS
from nearlift.likelihood.budget import INPUTS, Component
from nearlift.likelihood.problem import Likelihood, lift_ratio
from nearlift.results import Observations
from nearlift.results.fit import UndeclaredInput

#: Relative uncertainty of a calliper on a small rotor, and uncertainty in m of a datum set by eye.
#: Ours: a quarter of a millimetre on 23 mm, and half of a ruler's division.
PLAUSIBLE_ERRORS = {"rotor_radius": 0.01, "rotor_spacing": 0.01, "height": 5e-4}


def acting(
    parts: Iterable[Component], model: LiftModel, theta: FloatArray
) -> tuple[Component, ...]:
    """The components, each input with its derivative at these coefficients; an existing derivative
    is kept.

    Give every rival model those of the base model, as with the slope of heights, or their
    likelihoods are not comparable.
    """
    coefficients = {p.name: float(t) for p, t in zip(model.parameters, theta, strict=True)}
    return tuple(
        replace(part, derivative=partial(_derivative, part, model, coefficients))
        if part.on in INPUTS and part.derivative is None
        else part
        for part in parts
    )


def _derivative(
    part: Component, model: LiftModel, coefficients: dict[str, float], data: Observations
) -> FloatArray:
    if part.on == "air_density":
        return np.ones(data.n)
    if part.on == "mass":
        return np.zeros(data.n)
    if part.on == "exponent":
        return _log_ratio(model, data, coefficients)
    return derivative.at_zero(lambda t: _log_ratio(model, _scaled(data, part, 1 + t), coefficients))


def _log_ratio(model: LiftModel, data: Observations, coefficients: dict[str, float]) -> FloatArray:
    """Log L / L_inf of each trial; 0 in free air and where the model has no value."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(np.log(lift_ratio(model, data, coefficients)), posinf=0.0, neginf=0.0)


def _scaled(data: Observations, part: Component, factor: float) -> Observations:
    """The trials with an input scaled by `factor`."""
    if part.on == "rotor_spacing":
        return replace(
            data,
            geometry={n: v * factor if n in part.moves else v for n, v in data.geometry.items()},
        )
    hats = {
        n: np.asarray(v) / factor if n.endswith("_hat") else v for n, v in data.geometry.items()
    }
    return replace(data, z_hat=data.z_hat / factor, radius_m=data.radius_m * factor, geometry=hats)


def undeclared(
    problem: Likelihood,
    theta: FloatArray,
    gain: FloatArray,
    parts: Iterable[Component],
    slope: FloatArray,
) -> tuple[UndeclaredInput, ...]:
    """Geometry and datum without a declared uncertainty, each with the shift of the coefficients
    that an error of plausible size would cause.

    Parameters
    ----------
    theta : (p,)
    gain : (p, n)
        Change of the coefficients per change of log lift.
    parts : iterable of Component
        What was declared.
    slope : (n,)
        d log ratio / dz.
    """
    declared, model = {part.on for part in parts}, problem.model
    moves = tuple(n for n in ("spacing_hat", "diagonal_hat", "layout_hat") if n in model.needs)
    listed = []
    for on, size in PLAUSIBLE_ERRORS.items():
        if on in declared or (on == "rotor_spacing" and not moves):
            continue
        part = Component(
            name=on, on=on, standard=size, distribution="normal", scope="campaign", moves=moves
        )
        [part] = acting([part], model, theta)
        shift = gain @ part.sensitivity(problem.data, slope)
        listed.append(
            UndeclaredInput(
                on=on,
                size=size,
                unit=UNITS[on][0],
                shift=dict(zip(problem.names, shift.tolist(), strict=True)),
            )
        )
    return tuple(listed)
