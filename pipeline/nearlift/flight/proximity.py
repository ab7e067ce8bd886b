"""Distance at which each boundary shows in lift, and its place by a reading of lift."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nearlift.campaign.forecasts import Detect, LiftReading
from nearlift.declare import Boundary
from nearlift.errors import InputRefused, UsageError
from nearlift.flight.detection import (
    INVERTED_S,
    BoundaryProximity,
    HeightReading,
    ProximityResult,
    RefusedReading,
    Sensor,
    boundary_proximity,
    range_rows,
    read_height,
)
from nearlift.flight.fitted_lift import FittedLift
from nearlift.flight.quoted_lift import QuotedLifts
from nearlift.reduction.quality import rejected

DRAWS = 100


def proximity(
    quoted: QuotedLifts, say: Callable[[str], None]
) -> tuple[list[dict[str, object]], ProximityResult, tuple[str, ...]]:
    """Ranges over averaging times, payloads and supplies; what a reading at each distance would say
    of it; and the manifest's readings.
    """
    chosen = quoted.campaign.detect or Detect()
    rows: list[dict[str, object]] = []
    notes = []
    boundaries: dict[Boundary, BoundaryProximity] = {}
    lifts: dict[Boundary, FittedLift] = {}
    for boundary in quoted.boundaries:
        say(f"detect {boundary}")
        lift = lifts[boundary] = quoted.lift(boundary, DRAWS)
        levels, scatter = quoted.levels(boundary)
        floor = float(np.hypot(scatter, np.median([u / value for value, u in levels.values()])))
        device = sensor(quoted, boundary, chosen, floor)
        rows += range_rows(lift, device, chosen, quoted.campaign.vehicle.rotor_radius)
        entry = boundaries[boundary] = boundary_proximity(lift, device, chosen)
        if entry.refused:
            notes.append(f"{boundary}: distance cannot be inferred from lift:  {entry.refused}")
    readings: list[HeightReading | RefusedReading] = []
    for i, reading in enumerate(chosen.reading):
        try:
            readings.append(read(quoted, reading, lifts.get(reading.boundary)))
        except (InputRefused, UsageError) as refusal:
            why = f"{refusal.what}; {refusal.remedy}"
            readings.append(RefusedReading(boundary=reading.boundary, refused=why))
            notes.append(f"detect.reading[{i}]: {why}")
    result = ProximityResult(
        false_alarm_rate=chosen.false_alarm_rate,
        miss_rate=chosen.miss_rate,
        averaging_s=INVERTED_S,
        boundaries=boundaries,
        readings=tuple(readings),
    )
    return rows, result, tuple(notes)


def read(
    quoted: QuotedLifts, reading: LiftReading, lift: FittedLift | None = None
) -> HeightReading:
    """The posterior of z_hat from one reading.

    Raises
    ------
    UsageError
        Nothing was fitted at that boundary.
    InputRefused
        As `read_height` says.
    """
    others = [b for b in quoted.fits.boundaries if b != reading.boundary]
    if reading.boundary not in quoted.fits.boundaries:
        raise UsageError(
            "boundary",
            f"nothing was fitted at the {reading.boundary}",
            f"fitted: {', '.join(quoted.fits.boundaries)}",
        )
    vehicle = quoted.campaign.vehicle
    return read_height(
        reading,
        quoted.lift(reading.boundary, DRAWS) if lift is None else lift,
        quoted.levels(reading.boundary)[0],
        quoted.campaign.detect or Detect(),
        vehicle.rotor_radius,
        (vehicle.mass if reading.mass is None else reading.mass) * quoted.campaign.rig.gravity,
        [quoted.lift(b, 2) for b in others],
    )


def sensor(quoted: QuotedLifts, boundary: Boundary, chosen: Detect, floor: float) -> Sensor:
    """The manifest's sensor; else the bench's load cell, whose records say what averaging does.
    Averaging
    leaves the scatter of the bench's trials and the uncertainty of L_inf.
    """
    weight = quoted.campaign.vehicle.mass * quoted.campaign.rig.gravity
    if chosen.force_noise is not None and chosen.force_bandwidth is not None:
        # white up to the bandwidth: the average over a second has sd / sqrt(2 bandwidth)
        white = chosen.force_noise / weight / float(np.sqrt(2 * chosen.force_bandwidth))
        return Sensor(short_per_sqrt_Hz=white, floor=floor)
    trials = quoted.trials
    mine = (
        (trials["boundary"] == boundary) & ~rejected(trials["quality"]) & (trials["u_lift_N"] > 0)
    )
    rate, noise = quoted.campaign.load_cell.sample_rate, 0.0
    if mine.any() and rate is not None:
        length_s = trials["n"][mine] / rate
        noise = float(np.median(trials["u_lift_N"][mine] * np.sqrt(length_s) / weight))
    return Sensor(short_per_sqrt_Hz=noise, floor=floor)
