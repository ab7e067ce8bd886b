"""Detection range and inferred height of each boundary: proximity.json and detection.parquet."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from nearlift.declare import Boundary
from nearlift.errors import InputRefused
from nearlift.flight.fitted_lift import FittedLift
from nearlift.flight.proximity import inverse
from nearlift.flight.proximity.reach import Sensor, needed, reaches
from nearlift.flight.proximity.reading import (
    HeightReading,
    RefusedReading,
    refuse_folds,
    supply_sensitivity,
)
from nearlift.flight.proximity.sequential import HOUR_S, sequential_test
from nearlift.manifest.flight import Detect
from nearlift.results.serial import Unbounded, optional

#: Number of heights for detection delay and inversion; averaging time of the inversion, s.
TRIED = 25
INVERTED_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightTrial:
    """Posterior of the height for a reading of exactly the best estimate at `z_hat`."""

    z_hat: float
    ratio: float
    median: float
    lo90: float
    hi90: float
    beyond: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SignificantHeight:
    """Largest z_hat at which the boundary changes lift by at least `change` (a fraction), with its
    90 % interval over draws of the model; nan where no measured height has such a change.
    """

    change: float
    z_hat: float
    lo90: float
    hi90: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Noticed:
    """Mean delay of the sequential test at one height, and its threshold in standard deviations of
    a reading; both infinite where the constant offset hides the change.
    """

    z_hat: float
    change: float
    threshold: Unbounded
    delay_s: Unbounded


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryProximity:
    """One boundary: model, sensor, range of significant change, detection delays, and inferred
    heights or why none are; `lift_per_voltage` is |d ln L / d ln V|.
    """

    model: str
    title: str
    draws_from: str
    effects: tuple[str, ...]
    measured_z_hat: tuple[float, float]
    largest_change: float
    significant: SignificantHeight
    noticed: tuple[Noticed, ...]
    short_per_sqrt_Hz: float
    floor: float
    every_s: float
    lift_per_voltage: float
    located: tuple[HeightTrial, ...] | None = optional()
    refused: str | None = optional()


@dataclass(frozen=True, slots=True, kw_only=True)
class ProximityResult:
    """Content of proximity.json; `averaging_s` is the averaging time of the inferred heights."""

    schema: str
    false_alarm_rate: float
    miss_rate: float
    false_alarms_per_hour: float
    averaging_s: float
    boundaries: Mapping[Boundary, BoundaryProximity]
    readings: tuple[HeightReading | RefusedReading, ...]


def boundary_proximity(lift: FittedLift, device: Sensor, chosen: Detect) -> BoundaryProximity:
    """Significant range, detection delays and inferred heights (none where the model folds)."""
    sensitivity = supply_sensitivity(lift)
    sigma = device.sigma(INVERTED_S, chosen.payload[0], sensitivity * chosen.supply[0])
    located, refused = None, None
    try:
        refuse_folds(lift)
        located = _located(lift, sigma)
    except InputRefused as refusal:
        refused = f"{refusal.what}; {refusal.remedy}"
    best, lo90, hi90 = reaches(lift.ratios, chosen.significant, *lift.measured_z_hat)
    return BoundaryProximity(
        model=lift.model.name,
        title=lift.title,
        draws_from=lift.source,
        effects=lift.effects,
        measured_z_hat=lift.measured_z_hat,
        largest_change=lift.largest_change,
        significant=SignificantHeight(change=chosen.significant, z_hat=best, lo90=lo90, hi90=hi90),
        noticed=_noticed(lift, device, chosen),
        short_per_sqrt_Hz=device.short_per_sqrt_Hz,
        floor=device.floor,
        every_s=device.every_s,
        lift_per_voltage=sensitivity,
        located=located,
        refused=refused,
    )


def _noticed(lift: FittedLift, device: Sensor, chosen: Detect) -> tuple[Noticed, ...]:
    """Sequential tests at TRIED heights, with the first of the payload and supply uncertainties."""
    heights = np.geomspace(*lift.measured_z_hat, TRIED)
    stays = (device.floor, chosen.payload[0], supply_sensitivity(lift) * chosen.supply[0])
    sigma = max(device.short_per_sqrt_Hz / math.sqrt(device.every_s), 1e-9)
    noticed = []
    for z_hat, change in zip(heights.tolist(), (lift.ratio()(heights) - 1.0).tolist(), strict=True):
        threshold, delay_s = sequential_test(
            change, sigma, math.hypot(*stays), device.every_s, chosen.false_alarms_per_hour
        )
        noticed.append(Noticed(z_hat=z_hat, change=change, threshold=threshold, delay_s=delay_s))
    return tuple(noticed)


def _located(lift: FittedLift, sigma: float) -> tuple[HeightTrial, ...]:
    low, high = lift.measured_z_hat
    best, *draws = lift.ratios
    trials = []
    for z_hat in np.geomspace(low, high, TRIED):
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
        best, lo90, hi90 = reaches(lift.ratios, change, *lift.measured_z_hat)
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
