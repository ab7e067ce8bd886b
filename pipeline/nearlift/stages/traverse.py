"""The way to the next visits: each station from either side in turn, as `design` draws them."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from nearlift.campaign.manifest import Campaign
from nearlift.results import Observations
from nearlift.run import tables
from nearlift.stages.plans import OVERSHOOT_RADII


@dataclass(frozen=True, slots=True, kw_only=True)
class Traverse:
    """A boundary's stations by z_hat: what the traverse shows at each in m (infinite in free air),
    and visits that arrived there moving away less those that came closer, of those made.

    `overshoot_m` is how far it drives past a station to arrive from its other side; 0 where nobody
    logs sides.
    """

    shown_m: Mapping[float, float]
    balance: Mapping[float, float]
    overshoot_m: float

    def ways(
        self, z_hat: Iterable[float], last: float, rng: np.random.Generator
    ) -> list[tuple[int, float | None]]:
        """Of each visit, from the station `last` on, the side (+1: the last move leads away from
        the boundary) and where to drive to first, None for straight there.

        The side is that from which the station was visited less often, by chance where both are
        even, and free only between the nearest and the farthest station.
        """
        balance = defaultdict(float, self.balance)
        known = [d for d in self.shown_m.values() if math.isfinite(d)]
        here, ways = self.shown_m[last], list[tuple[int, float | None]]()
        for z in z_hat:
            distance = self.shown_m[z]
            straight, coin = 1 if distance > here else -1, int(rng.choice([-1, 1]))
            here, way, via = distance, straight, None
            if self.overshoot_m > 0 and math.isfinite(distance):
                wanted = int(-np.sign(balance[z])) or coin
                past = min(max(distance - wanted * self.overshoot_m, min(known)), max(known))
                if wanted != straight and abs(past - distance) >= self.overshoot_m / 2:
                    way, via = wanted, past
                balance[z] += way
            ways.append((way, via))
        return ways


def traverse(trials: tables.Table, data: Observations, campaign: Campaign) -> Traverse:
    """That of a boundary: every distance that the schedule lists, and the sides of its trials."""
    mine = np.isin(trials["boundary"], [data.boundary, "none"])
    shown = trials["z_m"][mine] - campaign.rig.offset(data.boundary)
    sides = data.covariates.get("approach")
    balance = defaultdict[float, float](float)
    if sides is not None:
        for i in np.unique(data.visit, return_index=True)[1]:
            balance[float(data.z_hat[i])] += float(np.nan_to_num(sides[i]))
    wanted = campaign.design.overshoot if campaign.design else None
    overshoot = OVERSHOOT_RADII * campaign.vehicle.rotor_radius if wanted is None else wanted
    return Traverse(
        shown_m=dict(zip(trials["z_hat"][mine].tolist(), shown.tolist(), strict=True)),
        balance=balance,
        overshoot_m=0.0 if sides is None else overshoot,
    )
