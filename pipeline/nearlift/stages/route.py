"""The way through the manifest's corridor, from the crash rates and powers of the fitted models; a part of the stage simulate."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from nearlift.declare import Boundary
from nearlift.flight_manifest import Simulate
from nearlift.simulation import route
from nearlift.simulation.craft import Craft
from nearlift.stages.job import Job

Rows = list[dict[str, Any]]


def plan(
    job: Job, chosen: Simulate, craft: Craft, fitted: dict[Boundary, Any], rows: list[dict[str, Any]]
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The route's entry in safety.json, and the rows of routes.parquet.

    Raises
    ------
    InputRefused
        Start or goal is in an obstacle, nothing joins them, or no way is safe enough.
    """
    asked = chosen.route
    assert asked is not None
    near = {b: _nearness(b, own, rows, craft) for b, own in fitted.items()}
    boxes = [(*box.x, *box.z) for box in asked.obstacles]
    vehicle = job.campaign.vehicle
    half_width = craft.radius_m + (vehicle.rotor_spacing or 0.0) / 2
    disks = craft.rotors * math.pi * craft.radius_m**2
    pilot = route.Pilot(
        radius_m=craft.radius_m,
        half_width_m=half_width,
        speed_m_s=asked.speed,
        induced_m_s=math.sqrt(craft.weight_N / (2 * craft.density_kg_m3 * disks)),
    )
    grid = route.field(route.Corridor(length_m=asked.length, height_m=asked.height, boxes=boxes), pilot, near)
    found = route.ways(grid, pilot, asked.start, asked.goal)
    best = route.cheapest(found, asked.risk)
    table = [
        {"way": i, "price": w.price, "energy": w.energy, "risk": w.risk, "chosen": int(w is best), "x_m": float(x), "z_m": float(z)}
        for i, w in enumerate(found)
        for x, z in zip(w.x_m, w.z_m, strict=True)
    ]
    entry = {
        "length_m": asked.length,
        "height_m": asked.height,
        "boxes_m": [list(b) for b in boxes],
        "start_m": list(asked.start),
        "goal_m": list(asked.goal),
        "speed_m_s": asked.speed,
        "risk_bound": asked.risk,
        "boundaries": list(near),
        "ways": [{"price": w.price, "energy": w.energy, "risk": w.risk, "chosen": w is best} for w in found],
        "energy": best.energy,
        "risk": best.risk,
    }
    return entry, table


def _nearness(boundary: Boundary, own: dict[str, Any], rows: Rows, craft: Craft) -> route.Nearness:
    mine = [r for r in rows if r["preset"] == "fitted" and r["boundary"] == boundary and r["member"] == -1 and r["exponent"] != 0]
    z_hat = np.array([r["target_z_hat"] for r in mine])
    cost = np.array([r["cost"] for r in mine])
    crashes = np.array([r["crashes"] for r in mine], dtype=float)
    # beyond the highest set-point the saving falls as the square of distance, as an image's does
    last = 1 - cost[-1]
    return route.Nearness(
        power=lambda z: np.where(z > z_hat[-1], 1 - last * (z_hat[-1] / np.maximum(z, z_hat[-1])) ** 2, np.interp(z, z_hat, cost)),
        hazard=route.hazard_of(z_hat, crashes, own["flights"], own["groups"]["duration"] * craft.time_s),
        lowest_z_hat=float(z_hat[0]),
    )
