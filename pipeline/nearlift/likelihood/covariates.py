"""Covariates of trials: the measured and derived ones, and the effects that cannot be tested for
lack of one.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from nearlift.declare import Effect, FloatArray
from nearlift.effects import STAND_INS
from nearlift.likelihood.variance_components import elapsed_trials
from nearlift.results import Observations

#: Least variation of a covariate, as a fraction of a plausible range, for an effect along it to be
#: tested; absolute where the scale is fixed. Ours: a few steps
#: of the usual sensor, so that its resolution is not tested as an effect.
LEAST_SPREAD = {
    "temperature_K": 0.2,
    "pressure_Pa": 20.0,
    "humidity": 0.01,
    "tilt_rad": 1e-3,
    "turn_rad": 0.1,
    "supply_V": 5e-3,
    "speed_hat": 5e-4,
}


def derive(
    data: Observations, lift_inf_N: FloatArray, ratio: FloatArray | float = 1.0
) -> Observations:
    """The observations with every derived covariate that effects and families may ask for.

    Time: `since_start_s` (since the session's first trial), `elapsed_hat` (campaign time, or run
    order, scaled to [-1, 1]) and `order_in_visit`. Previous trial: `previous_lift_N`,
    `previous_throttle`, `previous_z_hat` and `rest_s` (0 at the start of a session). `speed_hat` is
    the rotor speed over its median at the throttle, or over its curve. `drift_hat` is the relative
    change of lift within a record. `lift_inf_N` (n,) is as given, in N. Times the base model's lift
    `ratio` (n,) it is the lift of a trial, and `previous_lift_N` of the next. Geometry: the medians
    `supply_ref_V`, `temperature_ref_K`, `pressure_ref_Pa`, that of the throttles, `throttle_ref`,
    and `radius_m`. Where the order of the trials is unknown, all that follows from it is constant.
    A covariate with a default that was not logged for every trial takes that value for all, and is
    no covariate.
    """
    known = dict(data.covariates)
    n = data.n
    first = np.r_[True, data.session[1:] != data.session[:-1]]
    index = np.arange(n, dtype=float)
    if not data.ordered:
        # the order is unknown, so nothing may vary along it
        first, index = np.ones(n, dtype=bool), np.zeros(n)
        known.pop("start_s", None)
    order = (
        known["start_s"] if "start_s" in known and np.isfinite(known["start_s"]).all() else index
    )
    known["elapsed_hat"] = _scaled(order)
    known["run_order"] = index
    known["elapsed_trials"] = elapsed_trials(order)
    if "start_s" in known:
        begin = known["start_s"][np.maximum.accumulate(np.where(first, np.arange(n), 0))]
        known["since_start_s"] = known["start_s"] - begin
        known["rest_s"] = np.where(
            first, 0.0, np.diff(known["start_s"], prepend=known["start_s"][:1])
        )
    known["lift_inf_N"] = lift_inf_N
    if (
        "speed_Hz" in known
        and np.isfinite(known["speed_Hz"]).all()
        and (known["speed_Hz"] > 0).all()
    ):
        known["speed_hat"] = known["speed_Hz"] / _usual(data, known["speed_Hz"])
    # the model's lift and not the trial's own: that carries its noise, which would then explain its
    # neighbour's
    for name, values in (
        ("previous_lift_N", known["lift_inf_N"] * ratio),
        ("previous_throttle", data.throttle),
        ("previous_z_hat", data.z_hat),
    ):
        known[name] = np.where(first, 0.0, np.r_[0.0, values[:-1]])
    change = np.r_[True, data.visit[1:] != data.visit[:-1]]
    known["order_in_visit"] = (
        index - index[np.maximum.accumulate(np.where(change, np.arange(n), 0))]
    )
    if {"drift_N_s", "record_s"} <= known.keys():
        known["drift_hat"] = known["drift_N_s"] * known["record_s"] / data.lift_N
    geometry: dict[str, object] = {
        **data.geometry,
        "radius_m": data.radius_m,
        # not of the trials: between two middle throttles a single one would decide
        "throttle_ref": float(np.median(np.unique(data.throttle))),
    }
    for name, reference in (
        ("supply_V", "supply_ref_V"),
        ("temperature_K", "temperature_ref_K"),
        ("pressure_Pa", "pressure_ref_Pa"),
    ):
        if name in known and np.isfinite(known[name]).any():
            geometry[reference] = float(np.nanmedian(known[name]))
    for name, usual in STAND_INS.items():
        logged = known.get(name, np.empty(0))
        whole = logged[np.isfinite(logged)]
        if name not in geometry and len(whole) < n:
            # one value for all: of a log with gaps the median
            geometry[name] = float(np.median(whole)) if len(whole) else usual
            known.pop(name, None)
    return dataclasses.replace(data, covariates=known, geometry=geometry)


def _usual(data: Observations, speed_Hz: FloatArray) -> FloatArray:
    """The speed expected at each trial's throttle."""
    if data.curve is not None:
        x, y = data.level_design, np.log(speed_Hz)
        return np.asarray(np.exp(x @ np.linalg.lstsq(x, y, rcond=None)[0]), dtype=np.float64)
    return data.level_medians(speed_Hz)[data.level]


def _scaled(x: FloatArray) -> FloatArray:
    span = x.max() - x.min()
    return 2 * (x - x.min()) / span - 1 if span > 0 else np.zeros_like(x)


def varies(data: Observations, name: str) -> bool:
    """Whether a covariate is known for every trial and varies enough to tell anything."""
    if name in data.geometry or name in ("z_hat", "throttle"):
        return True
    if name == "session":
        return bool(data.session.max() > 0)
    values = data.covariates.get(name)
    if values is None or not np.isfinite(values).all():
        return False
    return bool(np.ptp(values) > LEAST_SPREAD.get(name, 0.0))


def missing(effect: Effect, data: Observations) -> tuple[str, ...]:
    """Needs of the effect that these trials do not meet; empty if it can be tested.

    Its covariate `varies_with` has no default.
    """

    def known(name: str) -> bool:
        if name in STAND_INS:
            decides = name == effect.varies_with
            return not decides or (name in data.covariates and varies(data, name))
        return name == "lift_inf_N" or varies(data, name)

    return tuple(name for name in effect.needs if not known(name))


def unlogged(effect: Effect, data: Observations) -> tuple[str, ...]:
    """Covariates that the effect's declaration asks to record and these trials do not have. The
    session counts as missing if there is only one.
    """
    known = {name.split("_")[0] for name in data.covariates}
    if varies(data, "session"):
        known.add("session")
    return tuple(name for name in effect.log_next_time if name not in known)
