"""detect: how far away each boundary shows in lift, and where it is, to detection.parquet and
proximity.json.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from nearlift.declare import Boundary
from nearlift.errors import InputRefused
from nearlift.flight.proximity import inverse
from nearlift.flight.proximity.reach import Sensor, needed, reaches
from nearlift.manifest.campaign import boundaries_of
from nearlift.manifest.flight import Detect
from nearlift.products import DETECTION, FIT, PROXIMITY, TRIALS
from nearlift.reduction.quality import rejected
from nearlift.run.job import Job, Outcome
from nearlift.stages.belief import Belief, believe
from nearlift.stages.reading import DRAWS, all_of, refuse_folds, sensitivity
from nearlift.stages.simulate import columns

#: Distances at which the inversion is tried, and the time averaged then, s.
TRIED = 25
INVERTED_S = 1.0


def run(job: Job) -> Outcome:
    """Ranges over averaging times, payloads and supplies; what a reading at each distance would say
    of it; and the manifest's readings.
    """
    chosen = job.campaign.detect or Detect()
    fitted = job.read_json(FIT)
    rows: list[dict[str, Any]] = []
    content: dict[str, Any] = {
        "schema": PROXIMITY.schema,
        "false_alarm_rate": chosen.false_alarm_rate,
        "miss_rate": chosen.miss_rate,
        "averaging_s": INVERTED_S,
        "boundaries": {},
    }
    notes = []
    beliefs: dict[str, Belief] = {}
    for boundary in boundaries_of(fitted["boundaries"]):
        job.say(f"detect {boundary}")
        belief = beliefs[boundary] = believe(job, boundary, DRAWS)
        device = sensor(job, boundary, chosen, float(fitted["noise"][boundary]["relative"]))
        rows += _ranges(job, belief, device, chosen)
        entry = _entry(belief, device)
        try:
            refuse_folds(belief)
            entry["located"] = _located(
                belief,
                device.sigma(INVERTED_S, chosen.payload[0], sensitivity(belief) * chosen.supply[0]),
            )
        except InputRefused as refusal:
            entry["refused"] = f"{refusal.what}; {refusal.remedy}"
            notes.append(
                f"{boundary}: distance is not told from lift: {refusal.what}; {refusal.remedy}"
            )
        content["boundaries"][boundary] = entry
    content["readings"], refused = all_of(job, beliefs)
    notes += refused
    job.write(DETECTION, columns(DETECTION, rows))
    job.write_json(PROXIMITY, content)
    return Outcome(notes=tuple(notes))


def sensor(job: Job, boundary: Boundary, chosen: Detect, floor: float) -> Sensor:
    """The manifest's sensor; else the bench's load cell, whose records say what averaging does and
    whose trials what it does not.
    """
    weight = job.campaign.vehicle.mass * job.campaign.rig.gravity
    if chosen.force_noise is not None and chosen.force_bandwidth is not None:
        # white up to the bandwidth: the average over a second has sd / sqrt(2 bandwidth)
        return Sensor(
            short_per_sqrt_Hz=chosen.force_noise
            / weight
            / float(np.sqrt(2 * chosen.force_bandwidth)),
            floor=0.0,
        )
    trials = job.read(TRIALS)
    mine = (
        (trials["boundary"] == boundary) & ~rejected(trials["quality"]) & (trials["u_lift_N"] > 0)
    )
    rate = job.campaign.load_cell.sample_rate
    if not mine.any() or rate is None:
        return Sensor(short_per_sqrt_Hz=0.0, floor=floor)
    length_s = trials["n"][mine] / rate
    return Sensor(
        short_per_sqrt_Hz=float(np.median(trials["u_lift_N"][mine] * np.sqrt(length_s) / weight)),
        floor=floor,
    )


def _ranges(job: Job, belief: Belief, device: Sensor, chosen: Detect) -> list[dict[str, Any]]:
    ratios = [belief.ratio(m) for m in range(-1, belief.number)]
    rows = []
    for voltage, payload in itertools.product(chosen.supply, chosen.payload):
        supply = sensitivity(belief) * voltage
        for averaging_s in chosen.averaging:
            sigma = device.sigma(averaging_s, payload, supply)
            change = needed(sigma, chosen.false_alarm_rate, chosen.miss_rate)
            best, lo90, hi90 = reaches(ratios, change, *belief.measured_z_hat)
            rows.append(
                {
                    "boundary": belief.boundary,
                    "model": belief.model.name,
                    "averaging_s": averaging_s,
                    "payload": payload,
                    "voltage": voltage,
                    "supply": supply,
                    "sigma": sigma,
                    "needed": change,
                    "range_z_hat": best,
                    "lo90": lo90,
                    "hi90": hi90,
                    "range_m": best * job.campaign.vehicle.rotor_radius,
                }
            )
    return rows


def _entry(belief: Belief, device: Sensor) -> dict[str, Any]:
    near = np.array([belief.measured_z_hat[0]])
    return {
        "model": belief.model.name,
        "title": belief.title,
        "draws_from": belief.source,
        "effects": list(belief.effects),
        "measured_z_hat": list(belief.measured_z_hat),
        "largest_change": float(belief.ratio()(near)[0] - 1.0),
        "short_per_sqrt_Hz": device.short_per_sqrt_Hz,
        "floor": device.floor,
        "lift_per_voltage": sensitivity(belief),
    }


def _located(belief: Belief, sigma: float) -> list[dict[str, float]]:
    """What a reading without error at each distance would say of the distance."""
    low, high = belief.measured_z_hat
    ratios = [belief.ratio(m) for m in range(belief.number)]
    rows = []
    for z_hat in np.geomspace(low, high, TRIED):
        measured = float(belief.ratio()(np.array([z_hat]))[0])
        found = inverse.locate(measured, sigma, ratios, low, high)
        rows.append(
            {
                "z_hat": float(z_hat),
                "ratio": measured,
                "median": found.median,
                "lo90": found.lo90,
                "hi90": found.hi90,
                "beyond": found.beyond,
            }
        )
    return rows
