"""The way through the manifest's corridor, from the crash rates and powers of the fitted models; a
part of the stage simulate.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from nearlift.declare import Boundary
from nearlift.flight.simulation import energy, route, safety
from nearlift.flight.simulation.craft import Craft
from nearlift.flight.simulation.sweep import Sweep
from nearlift.manifest.flight import Simulate
from nearlift.randomness import generator
from nearlift.run.job import Job


def plan(
    job: Job,
    chosen: Simulate,
    craft: Craft,
    fitted: dict[Boundary, Any],
    flown: dict[Boundary, Sweep],
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The route's entry in safety.json, and the rows of routes.parquet.

    Raises
    ------
    InputRefused
        Start or goal is in an obstacle, nothing joins them, or no way is shown to be safe enough.
    """
    asked = chosen.route
    assert asked is not None
    near = {b: _nearness(job, b, own, flown[b], chosen, craft) for b, own in fitted.items()}
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
    grid = route.field(
        route.Corridor(length_m=asked.length, height_m=asked.height, boxes=boxes), pilot, near
    )
    found = route.ways(grid, pilot, asked.start, asked.goal)
    best = route.cheapest(found, asked.risk, chosen.flights)
    told = [
        {
            "price": w.price,
            "energy": w.energy,
            "risk": w.risk,
            "lo90": w.lo90,
            "hi90": w.hi90,
            "chosen": int(w is best),
        }
        for w in found
    ]
    table = [
        {"way": i, **own, "risk_from": route.BASES[basis], "x_m": float(x), "z_m": float(z)}
        for i, (w, own) in enumerate(zip(found, told, strict=True))
        for x, z, basis in zip(w.x_m, w.z_m, w.basis, strict=True)
    ]
    entry = {
        "length_m": asked.length,
        "height_m": asked.height,
        "boxes_m": [list(b) for b in boxes],
        "start_m": list(asked.start),
        "goal_m": list(asked.goal),
        "speed_m_s": asked.speed,
        "risk_bound": asked.risk,
        "flights": chosen.flights,
        "boundaries": list(near),
        "lowest_z_hat": {b: n.lowest_z_hat for b, n in near.items()},
        "ways": [own | {"chosen": bool(own["chosen"])} for own in told],
        "energy": best.energy,
        "risk": best.risk,
        "lo90": best.lo90,
        "hi90": best.hi90,
        # how much of the chosen way lies where no flight crashed, or none was flown
        "share_by_basis": {
            basis: float(np.mean(best.basis == i)) for i, basis in enumerate(route.BASES)
        },
    }
    return entry, table


def _nearness(
    job: Job, boundary: Boundary, own: dict[str, Any], flown: Sweep, chosen: Simulate, craft: Craft
) -> route.Nearness:
    """Power and hazard near one boundary, from what was flown with the best estimate (row 1 of the
    sweep) and with the model's draws.
    """
    z_hat = flown.target_z_hat
    cost = energy.cost(flown.ratio[1], job.campaign.rig.held)[1]
    crashes = flown.crashed[1].sum(axis=1)
    duration_s = own["groups"]["duration"] * craft.time_s
    rng = generator(job.seed, "route", boundary)
    low, high = (
        np.concatenate(
            [
                safety.rate_draws(c, safety.PER_DRAW, rng, crash=crash, safe=1.0 - crash)
                for c in flown.crashed[1:]
            ]
        )
        for crash in (0.0, 1.0)
    )
    # beyond the highest set-point the saving falls as the square of distance, as an image's does
    last = 1 - cost[-1]
    return route.Nearness(
        power=lambda z: np.where(
            z > z_hat[-1],
            1 - last * (z_hat[-1] / np.maximum(z, z_hat[-1])) ** 2,
            np.interp(z, z_hat, cost),
        ),
        hazard=route.hazard_of(z_hat, safety.estimate(crashes, flown.flights), duration_s),
        low=route.hazard_of(z_hat, low, duration_s),
        high=route.hazard_of(z_hat, high, duration_s),
        lowest_z_hat=max(
            float(z_hat[0]), own["measured_z_hat"][0], chosen.contact_z_hat.get(boundary, 0.0)
        ),
        seen_z_hat=float(z_hat[np.flatnonzero(crashes)[-1]]) if crashes.any() else -np.inf,
        flown_z_hat=float(z_hat[-1]),
    )
