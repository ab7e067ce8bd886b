"""A model's curve over distance, and the 90 % band that the covariance of its fit implies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from nearlift.declare import FloatArray, LiftModel

#: Normal quantile of a two-sided 90 % interval, for a fit that quotes none of its own.
NORMAL_90 = 1.6448536269514722


def ratio(model: LiftModel, z_hat: FloatArray, arguments: Mapping[str, Any]) -> FloatArray:
    """L / L_inf at `z_hat`; nan outside the model's range and where it has no value."""
    low, high = model.valid_z_hat
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        value = np.broadcast_to(np.asarray(model(z_hat, **arguments), dtype=float), z_hat.shape)
    return np.where((z_hat > low) & (z_hat <= high) & np.isfinite(value) & (value > 0), value, np.nan)


def uncertainty(model: LiftModel, z_hat: FloatArray, known: Mapping[str, Any], entry: Mapping[str, Any]) -> FloatArray:
    """Standard uncertainty of L / L_inf at `z_hat` from the covariance of the fitted parameters, to first order."""
    names = entry["covariance"]["names"]
    covariance = np.asarray(entry["covariance"]["values"], dtype=float).reshape(len(names), len(names))
    centre = {n: float(entry["parameters"][n]["value"]) for n in names}
    jacobian = np.zeros((len(names), len(z_hat)))
    for i, name in enumerate(names):
        low, high = model.parameter(name).bounds
        # a step well within the uncertainty, so that the slope is that of the curve where the data leave it
        step = max(0.01 * float(np.sqrt(covariance[i, i])), 1e-7 * max(abs(centre[name]), 1.0))
        up, down = min(centre[name] + step, high), max(centre[name] - step, low)
        jacobian[i] = (ratio(model, z_hat, {**known, **centre, name: up}) - ratio(model, z_hat, {**known, **centre, name: down})) / (up - down)
    variance = np.einsum("iz,ij,jz->z", jacobian, covariance, jacobian)
    result: FloatArray = np.sqrt(np.maximum(variance, 0.0))
    return result


def quantile90(entry: Mapping[str, Any]) -> float:
    """How many standard uncertainties the fit's own 90 % intervals reach to either side."""
    for e in entry["parameters"].values():
        if e["u"] and e["hi90"] is not None:
            return float((e["hi90"] - e["value"]) / e["u"])
    return NORMAL_90
