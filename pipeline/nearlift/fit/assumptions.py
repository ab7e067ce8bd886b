"""Checks of a base fit's assumptions: throttle collapse, held quantity, constant C_L."""

from __future__ import annotations

from dataclasses import replace
from typing import TypedDict

import numpy as np

from nearlift.declare import FloatArray
from nearlift.effects.air_density import STANDARD, density
from nearlift.fit import assumption_text as text
from nearlift.fit import collapse, gum, held_quantity, rotor
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.fit.linearised import linear_problem, stand_in
from nearlift.fit.minimum import minimise
from nearlift.likelihood import student
from nearlift.likelihood.problem import Problem
from nearlift.manifest.campaign import Campaign
from nearlift.results import Observations
from nearlift.results.assumptions import (
    ExponentFit,
    ExponentRange,
    HeldQuantity,
    LoggedResponse,
    PlausibleExponent,
    RatioEstimate,
    RotorCoefficient,
    RotorTrend,
    RotorUnknown,
    SpeedLaw,
    ThrottleCoefficient,
    ThrottleCollapse,
    ThrottleLift,
)
from nearlift.results.serial import Nothing


def check(
    campaign: Campaign, fitted: LeastSquaresFit
) -> tuple[ThrottleCollapse, HeldQuantity | Nothing, RotorCoefficient]:
    """The three checks of one boundary, from the fit of its base model."""
    problem, theta = linearised(fitted)
    # the exponent is confounded with the coefficients and takes their degrees of freedom
    quantile = student.quantile(0.95, fitted.effective[0]) if len(theta) else student.NORMAL_90
    held = held_quantity.examine(problem, theta, fitted.dof_of_all) if len(theta) else None
    parts, slope = (*fitted.parts, *fitted.plan.shared), linear_problem(fitted)[2]

    def freedom(g: FloatArray) -> FloatArray:
        return gum.freedom(problem, g, parts, fitted.noise, slope)

    return (
        throttle_collapse(collapse.examine(problem, theta, freedom), quantile),
        Nothing() if held is None else exponents(campaign, problem, held, quantile),
        rotor_coefficient(
            campaign, problem, theta, fitted.covariance, held.responses if held else ()
        ),
    )


def linearised(fitted: LeastSquaresFit) -> tuple[Problem, FloatArray]:
    """The likelihood with every error in its covariance, and its optimum.

    A shared height error that was integrated over is linearised about its posterior mean, and its
    declared distribution is centred there too, which matters only if the trials hardly determine
    it.
    """
    problem, over = stand_in(fitted), fitted.marginal
    if over is None:
        return problem, fitted.theta
    about = replace(problem, shift=0.0)
    return about, minimise(about, over.theta[over.best])


def throttle_collapse(tested: collapse.Collapse, quantile: float) -> ThrottleCollapse:
    """The throttle-collapse result of one boundary."""
    each = zip(tested.throttles, tested.values, tested.u, tested.u_apart, strict=True)
    return ThrottleCollapse(
        coefficient=tested.name,
        per_throttle={
            t: ThrottleCoefficient(**interval(value, u, quantile), u_apart=float(apart))
            for t, value, u, apart in each
            if np.isfinite(u)
        },
        tests={"coefficient": tested.coefficient, "curve": tested.curve, "cells": tested.cells},
        largest_departure={"coefficient": tested.of_coefficient, "delta_L": tested.of_curve},
        text=text.throttle_collapse(tested),
    )


def exponents(
    campaign: Campaign, problem: Problem, examined: held_quantity.Held, quantile: float
) -> HeldQuantity:
    """One boundary's headline coefficient over the supported, else the plausible, exponents."""
    judged = examined.at_ends if examined.supported else examined.plausible
    return HeldQuantity(
        declared=campaign.rig.held,
        declared_text=text.declared(campaign.rig.held),
        coefficient=problem.names[0],
        plausible=tuple(
            PlausibleExponent(
                supposes=held_quantity.PLAUSIBLE[x.n],
                n=x.n,
                **interval(x.value, x.u, quantile),
                p_value=x.p_value,
            )
            for x in examined.plausible
        ),
        exponent_from_lift=(
            RatioEstimate(**interval(examined.n, examined.u_n, quantile))
            if np.isfinite(examined.n)
            else None
        ),
        logged=tuple(
            LoggedResponse(
                quantity=r.quantity,
                response=RatioEstimate(**interval(r.slope, r.u, student.NORMAL_90)),
                p_value=r.p_value,
                held=r.held,
                spread=r.spread,
                exponents=r.exponents(),
            )
            for r in examined.responses
        ),
        supported_exponents=examined.supported,
        range=ExponentRange(
            source="logged quantities" if examined.supported else "plausible exponents",
            low=min(x.value for x in judged),
            high=max(x.value for x in judged),
            lo90=min(x.value - quantile * x.u for x in judged),
            hi90=max(x.value + quantile * x.u for x in judged),
        )
        if judged
        else None,
        curve=tuple(
            ExponentFit(n=x.n, **interval(x.value, x.u, quantile), p_value=x.p_value)
            for x in examined.curve
        ),
        text=text.held(examined, problem.names[0]),
    )


def rotor_coefficient(
    campaign: Campaign,
    problem: Problem,
    theta: FloatArray,
    covariance: FloatArray,
    responses: tuple[held_quantity.Response, ...],
) -> RotorCoefficient:
    """C_L per throttle from L_inf and the logged or mapped speed, or the `missing` inputs."""
    data, vehicle = problem.data, campaign.vehicle
    logged = logged_speed(data, responses)
    air, how = air_density(campaign, data)
    if logged is not None:
        speed, u_log = logged
        source = "the rpm logged, far from the boundary"
    elif vehicle.throttle_map is not None:
        speed = vehicle.throttle_map.speed_Hz(data.levels)
        u_log, source = (
            np.full(len(speed), vehicle.throttle_map.uncertainty),
            "the manifest's throttle_map",
        )
    else:
        return RotorUnknown(missing=("rpm",), text=text.NO_SPEED)
    known = np.isfinite(speed)
    if air is None:
        return RotorUnknown(missing=("air_density",), text=text.NO_DENSITY)
    if not known.any():
        return RotorUnknown(missing=("rpm",), text=text.NO_SPEED)
    log_levels, given = problem.log_levels(theta)
    toll = (
        problem.level_sensitivity(problem.jacobian(theta))
        if len(theta)
        else np.zeros((len(speed), 0))
    )
    whole = given + toll @ covariance @ toll.T
    estimated = rotor.examine(
        data.levels[known],
        np.exp(log_levels[known]),
        whole[np.ix_(known, known)],
        speed[known],
        u_log[known],
        air_density=air,
        radius_m=data.radius_m,
        rotors=vehicle.rotors,
    )
    law = estimated.trend
    each = zip(estimated.throttle, estimated.speed_Hz, estimated.C_L, estimated.u, strict=True)
    exact_map = logged is None and not u_log.any()
    return RotorTrend(
        speed_from=source,
        air_density=air,
        air_density_from=how,
        per_throttle={
            x: ThrottleLift(speed_Hz=f, **interval(c, u, student.NORMAL_90)) for x, f, c, u in each
        },
        mean=RatioEstimate(**interval(law.mean, law.u_mean, student.NORMAL_90)),
        p_constant=law.p_constant,
        exponent=(
            None
            if law.p_trend is None
            else RatioEstimate(
                **interval(law.exponent, law.u_exponent, student.quantile(0.95, law.dof))
            )
        ),
        law=SpeedLaw(C_L=law.C_middle, speed_Hz=law.middle_Hz),
        p_trend=law.p_trend,
        excess=law.excess,
        paper=rotor.PAPER,
        text=text.rotor(estimated, exact_map),
    )


def air_density(campaign: Campaign, data: Observations) -> tuple[float | None, str]:
    """Air density in kg/m^3 and its source: manifest or mean of the log; None without either."""
    if campaign.rig.air_density is not None:
        return campaign.rig.air_density, "the manifest"
    kelvin = data.covariates.get("temperature_K")
    if kelvin is None or not np.isfinite(kelvin).any():
        return None, ""
    pressure = data.covariates.get("pressure_Pa", np.full(data.n, STANDARD["pressure_Pa"]))
    humidity = data.covariates.get("humidity", np.full(data.n, STANDARD["humidity"]))
    lacking = [
        name
        for name in ("pressure", "humidity")
        if not any(c.startswith(name) for c in data.covariates)
    ]
    how = "the temperature logged" if lacking else "temperature, pressure and humidity as logged"
    return float(np.nanmean(density(kelvin, pressure, humidity))), how + (
        f", standard {' and '.join(lacking)}" if lacking else ""
    )


def logged_speed(
    data: Observations, responses: tuple[held_quantity.Response, ...]
) -> tuple[FloatArray, FloatArray] | None:
    """Speed per throttle far from the boundary, and the standard uncertainty of its logarithm; None
    where no rpm was logged.

    Without an estimated response of speed to the boundary it is the geometric mean at each
    throttle's farthest station.
    """
    known = next((r for r in responses if r.quantity == "speed_Hz"), None)
    if known is not None:
        return np.exp(known.log_far), known.u_log_far
    speed = held_quantity.logged(data).get("speed_Hz")
    if speed is None:
        return None
    mean, u = [], []
    for k in range(len(data.levels)):
        at_throttle = data.level == k
        far = np.log(speed[at_throttle & (data.z_hat == data.z_hat[at_throttle].max())])
        mean.append(far.mean())
        u.append(far.std(ddof=1) / np.sqrt(len(far)) if len(far) > 1 else 0.0)
    return np.exp(mean), np.array(u)


class Interval90(TypedDict):
    """Value, standard uncertainty and 90 % interval of an estimate."""

    value: float
    u: float
    lo90: float
    hi90: float


def interval(value: float, u: float, quantile: float) -> Interval90:
    """An estimate with the 90 % interval ``value - quantile u`` to ``value + quantile u``."""
    return {
        "value": float(value),
        "u": float(u),
        "lo90": float(value - quantile * u),
        "hi90": float(value + quantile * u),
    }
