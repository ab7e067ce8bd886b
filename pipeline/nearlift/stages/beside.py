"""What is asked beside the fit of each base model: throttle, held quantity, rotor; entries of
fit.json.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from nearlift.declare import FloatArray
from nearlift.effects.air_density import STANDARD, density
from nearlift.fit import collapse, gum, held_quantity, rotor
from nearlift.fit.least_squares import Fit, minimise
from nearlift.likelihood import student
from nearlift.likelihood.problem import Problem
from nearlift.manifest.campaign import Campaign
from nearlift.results import Estimate, Observations
from nearlift.stages import beside_words as words

NORMAL90 = 1.6448536269514722


def ask(campaign: Campaign, fitted: Fit) -> dict[str, dict[str, Any]]:
    """The three entries of one boundary, from the fit of its base model."""
    problem, theta = linearised(fitted)
    covariance = fitted.covariance
    # the exponent trades places with the coefficients: it rests on what they rest on
    quantile = student.quantile(0.95, fitted.effective[0]) if len(theta) else NORMAL90
    found = held_quantity.examine(problem, theta, fitted.dof_of_all) if len(theta) else None
    parts, slope = (*fitted.parts, *fitted.plan.shared), gum.linearised(fitted)[2]

    def freedom(g: FloatArray) -> FloatArray:
        return gum.freedom(problem, g, parts, fitted.noise, slope)

    return {
        "throttle_collapse": throttle_collapse(collapse.examine(problem, theta, freedom), quantile),
        "held_quantity": {} if found is None else held(campaign, problem, found, quantile),
        "rotor_coefficient": rotor_coefficient(
            campaign, problem, theta, covariance, found.responses if found else ()
        ),
    }


def linearised(fitted: Fit) -> tuple[Problem, FloatArray]:
    """The likelihood with every error in its covariance, and its optimum.

    What all trials share of height and the slope does not carry is put at its likeliest value,
    about which the slope does carry it. The declared distribution is moved there too, which matters
    little: only what the trials tell well is carried so.
    """
    problem, over = gum.stand_in(fitted), fitted.marginal
    if over is None:
        return problem, fitted.theta
    about = replace(problem, shift=0.0)
    return about, minimise(about, over.theta[over.best])


def throttle_collapse(found: collapse.Collapse, quantile: float) -> dict[str, Any]:
    """One boundary's test of the collapse."""
    entry: dict[str, Any] = {
        "coefficient": found.name,
        "per_throttle": {
            f"{t:g}": {**interval(v, u, quantile), "u_apart": apart}
            for t, v, u, apart in zip(
                found.throttles, found.values, found.u, found.u_apart.tolist(), strict=True
            )
            if np.isfinite(u)
        },
        "tests": {
            name: (
                None
                if test is None
                else {
                    "F": test.statistic,
                    "dof": list(test.dof),
                    "p_value": test.p_value,
                    "quiet": test.quiet,
                }
            )
            for name, test in (
                ("coefficient", found.coefficient),
                ("curve", found.curve),
                ("cells", found.cells),
            )
        },
        "largest_departure": {
            name: (
                None
                if d is None
                else {"between": list(d.between), "value": d.value, "u": d.u, "bound95": d.bound}
            )
            for name, d in (("coefficient", found.of_coefficient), ("delta_L", found.of_curve))
        },
    }
    return {**entry, "text": words.throttle_collapse(found)}


def held(
    campaign: Campaign, problem: Problem, found: held_quantity.Held, quantile: float
) -> dict[str, Any]:
    """One boundary's range of the headline coefficient over the exponents, and what the
    logs say.
    """
    judged = found.at_ends if found.supported else found.plausible

    def at(x: held_quantity.AtExponent) -> dict[str, Any]:
        return {"n": x.n, **interval(x.value, x.u, quantile), "p_value": x.p_value}

    entry: dict[str, Any] = {
        "declared": campaign.rig.held,
        "declared_text": words.declared(campaign.rig.held),
        "coefficient": problem.names[0],
        "plausible": [{"supposes": held_quantity.PLAUSIBLE[x.n], **at(x)} for x in found.plausible],
        "exponent_from_lift": (
            interval(found.n, found.u_n, quantile) if np.isfinite(found.n) else None
        ),
        "logged": [
            {
                "quantity": r.quantity,
                "response": interval(r.slope, r.u, NORMAL90),
                "p_value": r.p_value,
                "held": r.held,
                "spread": r.spread,
                "exponents": None if r.exponents() is None else list(r.exponents() or ()),
            }
            for r in found.responses
        ],
        "supported_exponents": None if found.supported is None else list(found.supported),
        "range": (
            {
                "from": "logged quantities" if found.supported else "plausible exponents",
                "low": min(x.value for x in judged),
                "high": max(x.value for x in judged),
                "lo90": min(x.value - quantile * x.u for x in judged),
                "hi90": max(x.value + quantile * x.u for x in judged),
            }
            if judged
            else None
        ),
        "curve": [at(x) for x in found.curve],
    }
    return {**entry, "text": words.held(found, problem.names[0])}


def rotor_coefficient(
    campaign: Campaign,
    problem: Problem,
    theta: FloatArray,
    covariance: FloatArray,
    responses: tuple[held_quantity.Response, ...],
) -> dict[str, Any]:
    """One boundary's C_L per throttle, from L_inf and the speed that was logged or mapped;
    `missing` says what it lacks.
    """
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
        return {"missing": ["rpm"], "text": words.NO_SPEED}
    known = np.isfinite(speed)
    if air is None or not known.any():
        return {
            "missing": ["air_density"] if air is None else ["rpm"],
            "text": words.NO_DENSITY if air is None else words.NO_SPEED,
        }
    log_levels, given = problem.log_levels(theta)
    toll = (
        problem.level_sensitivity(problem.jacobian(theta))
        if len(theta)
        else np.zeros((len(speed), 0))
    )
    whole = given + toll @ covariance @ toll.T
    found = rotor.examine(
        data.levels[known],
        np.exp(log_levels[known]),
        whole[np.ix_(known, known)],
        speed[known],
        u_log[known],
        air_density=air,
        radius_m=data.radius_m,
        rotors=vehicle.rotors,
    )
    law = found.trend
    each = zip(found.throttle, found.speed_Hz, found.C_L, found.u, strict=True)
    entry: dict[str, Any] = {
        "speed_from": source,
        "air_density": air,
        "air_density_from": how,
        "per_throttle": {
            f"{x:g}": {"speed_Hz": f, **interval(c, u, NORMAL90)} for x, f, c, u in each
        },
        "mean": interval(law.mean, law.u_mean, NORMAL90),
        "p_constant": law.p_constant,
        "exponent": (
            None
            if law.p_trend is None
            else interval(law.exponent, law.u_exponent, student.quantile(0.95, law.dof))
        ),
        "law": {"C_L": law.C_middle, "speed_Hz": law.middle_Hz},
        "p_trend": law.p_trend,
        "excess": law.excess,
        "paper": rotor.PAPER,
    }
    return {
        **entry,
        "text": words.rotor(
            found,
            vehicle.throttle_map is not None
            and logged is None
            and not vehicle.throttle_map.uncertainty,
        ),
    }


def air_density(campaign: Campaign, data: Observations) -> tuple[float | None, str]:
    """Density in kg/m^3 and where it is from: the manifest, else the mean of what was logged; None
    where neither tells.
    """
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

    Where too few visits tell how speed answers to the boundary, it is the mean at each throttle's
    farthest station.
    """
    known = next((r for r in responses if r.quantity == "speed_Hz"), None)
    if known is not None:
        return np.exp(known.log_far), known.u_log_far
    speed = held_quantity.logged(data).get("speed_Hz")
    if speed is None:
        return None
    mean, u = [], []
    for k in range(len(data.levels)):
        mine = data.level == k
        far = np.log(speed[mine & (data.z_hat == data.z_hat[mine].max())])
        mean.append(far.mean())
        u.append(far.std(ddof=1) / np.sqrt(len(far)) if len(far) > 1 else 0.0)
    return np.exp(mean), np.array(u)


def interval(value: float, u: float, quantile: float) -> dict[str, Any]:
    """An estimate's entry; no unit, since everything here is a ratio."""
    e = Estimate(
        value=float(value),
        u=float(u),
        lo90=float(value - quantile * u),
        hi90=float(value + quantile * u),
    )
    return {"value": e.value, "u": e.u, "lo90": e.lo90, "hi90": e.hi90, "unit": e.unit}
