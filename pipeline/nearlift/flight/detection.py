"""Detection range and inferred height of each boundary: proximity.json and detection.parquet.

Without a boundary the estimate of L / L_inf scatters about 1 with standard deviation sigma(T). An
alarm is raised when it departs, in the boundary's direction, by more than k_fa sigma, with k_fa the
normal quantile of the false-alarm rate. A boundary that changes lift by D is missed at the given
rate when D = (k_fa + k_miss) sigma. The range is the largest z_hat at which |L / L_inf - 1| is D.

    sigma(T)^2 = short^2 / T + floor^2 + payload^2 + supply^2

Averaging over T reduces only `short`, the standard deviation of a one-second average.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from nearlift.campaign.forecasts import Detect
from nearlift.declare import Boundary
from nearlift.errors import InputRefused
from nearlift.flight import inverse
from nearlift.flight.fitted_lift import FittedLift
from nearlift.flight.reading import (
    HeightReading,
    RefusedReading,
    refuse_folds,
    supply_sensitivity,
)
from nearlift.results.document import IfAny, Real

#: Number of heights that are inferred, and averaging time of a reading, s.
N_HEIGHTS = 25
INVERTED_S = 1.0
HOUR_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """Noise of a relative lift reading: the standard deviation of the average over one second, and
    that which averaging does not reduce.
    """

    short_per_sqrt_Hz: float
    floor: float

    def sigma(self, averaging_s: float, payload: float = 0.0, supply: float = 0.0) -> float:
        """Standard deviation of the estimated L / L_inf; `payload` and `supply` are relative
        standard uncertainties of weight and of lift by the supply.
        """
        short = self.short_per_sqrt_Hz**2 / averaging_s
        return float(np.sqrt(short + self.floor**2 + payload**2 + supply**2))


def needed(sigma: float, false_alarm_rate: float, miss_rate: float) -> float:
    """Relative change of lift that is detected at these rates."""
    from scipy.special import ndtri

    return float(sigma * (-ndtri(false_alarm_rate) - ndtri(miss_rate)))


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightTrial:
    """Posterior of the height for a reading of exactly the best estimate at `z_hat`."""

    z_hat: Real
    ratio: Real
    median: Real
    lo90: Real
    hi90: Real
    beyond: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class SignificantHeight:
    """Largest z_hat with a change of lift of at least `change` (a fraction), and its 90 % interval.

    The interval is over draws of the model; nan where no measured height has such a change.
    """

    change: Real
    z_hat: Real
    lo90: Real
    hi90: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryProximity:
    """One boundary: model, sensor, range of significant change, and inferred heights or why none
    are; `lift_per_voltage` is |d ln L / d ln V|.
    """

    model: str
    title: str
    draws_from: str
    effects: tuple[str, ...]
    measured_z_hat: tuple[Real, Real]
    largest_change: Real
    significant: SignificantHeight
    short_per_sqrt_Hz: Real
    floor: Real
    lift_per_voltage: Real
    located: IfAny[tuple[HeightTrial, ...]] = None
    refused: IfAny[str] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ProximityResult:
    """Content of proximity.json; `averaging_s` is the averaging time of the inferred heights."""

    schema: str = "nearlift.proximity/1"
    false_alarm_rate: Real
    miss_rate: Real
    averaging_s: Real
    boundaries: Mapping[Boundary, BoundaryProximity]
    readings: tuple[HeightReading | RefusedReading, ...]


def boundary_proximity(lift: FittedLift, device: Sensor, chosen: Detect) -> BoundaryProximity:
    """Significant range and inferred heights (none where the model folds)."""
    sensitivity = supply_sensitivity(lift)
    sigma = device.sigma(INVERTED_S, chosen.payload[0], sensitivity * chosen.supply[0])
    located, refused = None, None
    try:
        refuse_folds(lift)
        located = _located(lift, sigma)
    except InputRefused as refusal:
        refused = f"{refusal.what}; {refusal.remedy}"
    best, lo90, hi90 = inverse.reaches(lift.ratios, chosen.significant, *lift.measured_z_hat)
    return BoundaryProximity(
        model=lift.model.name,
        title=lift.title,
        draws_from=lift.source,
        effects=lift.effects,
        measured_z_hat=lift.measured_z_hat,
        largest_change=lift.largest_change,
        significant=SignificantHeight(change=chosen.significant, z_hat=best, lo90=lo90, hi90=hi90),
        short_per_sqrt_Hz=device.short_per_sqrt_Hz,
        floor=device.floor,
        lift_per_voltage=sensitivity,
        located=located,
        refused=refused,
    )


def _located(lift: FittedLift, sigma: float) -> tuple[HeightTrial, ...]:
    low, high = lift.measured_z_hat
    best, *draws = lift.ratios
    trials = []
    for z_hat in np.geomspace(low, high, N_HEIGHTS):
        ratio = float(best(np.array([z_hat]))[0])
        height = inverse.locate(ratio, sigma, draws, low, high)
        trials.append(HeightTrial(z_hat=float(z_hat), ratio=ratio, **asdict(height)))
    return tuple(trials)


def range_rows(
    lift: FittedLift, device: Sensor, chosen: Detect, radius_m: float
) -> list[dict[str, object]]:
    """Rows of detection.parquet: detection ranges over supplies, payloads and averaging times."""
    rows = []
    for voltage, payload, averaging_s in itertools.product(
        chosen.supply, chosen.payload, chosen.averaging
    ):
        supply = supply_sensitivity(lift) * voltage
        sigma = device.sigma(averaging_s, payload, supply)
        change = needed(sigma, chosen.false_alarm_rate, chosen.miss_rate)
        best, lo90, hi90 = inverse.reaches(lift.ratios, change, *lift.measured_z_hat)
        rows.append(
            {
                "boundary": lift.boundary,
                "model": lift.model.name,
                "averaging_s": averaging_s,
                "payload": payload,
                "voltage": voltage,
                "supply": supply,
                "sigma": sigma,
                "false_alarms_per_hour": chosen.false_alarm_rate * HOUR_S / averaging_s,
                "needed": change,
                "range_z_hat": best,
                "lo90": lo90,
                "hi90": hi90,
                "range_m": best * radius_m,
            }
        )
    return rows
