"""Names near a boundary with and without measured downwash, on the same simulated campaigns:
``python -m tests.calibration.downwash OUT.jsonl FIRST_SEED COUNT``.

Downwash is the reciprocal of the true ratio with the effects that change the inflow. A cut that is
wrong measures less by `WRONG` of the control's. A logged speed follows the true ratio at constant
throttle, for lift that scales at constant speed as the ratio to the power `AT_SPEED`.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
from tests.calibration import forms
from tests.calibration.bench import stream
from tests.calibration.kinds import Kind, trials
from tests.calibration.simulator import Campaign, Unreachable, log_lift

from nearlift import catalogue
from nearlift.loop.diagnose import set_up
from nearlift.loop.inflow import MeasuredDownwash
from nearlift.loop.search import search_to_convergence
from nearlift.loop.search_problem import Options

HEIGHT_AND_HELD = ("held_quantity", "near_wall_saturation", "height_offset")
NEAR = {
    "ground": (*HEIGHT_AND_HELD, "image_strength", "airframe_stagnation"),
    "ceiling": HEIGHT_AND_HELD,
}
INFLOW = {"near_wall_saturation", "height_offset", "image_strength"}
#: Distances of the cuts, at least two radii above the ground when half a radius below the disk.
CUTS = {"ground": (2.5, 3.0, 4.0), "ceiling": (0.3, 0.7, 2.0)}
U_DOWNWASH, WRONG = 0.015, 0.1
AT_SPEED, U_SPEED = 0.71, 0.002


def ratio(campaign: Campaign, kinds: set[str], z_hat: np.ndarray) -> np.ndarray:
    """True L / L_inf with the campaign's effects of these kinds, mean over throttles, at z_hat."""
    pieces = tuple(
        (forms.form(kind, campaign.spec.foreign), size)
        for kind, size in campaign.truth.amplitudes.items()
        if kind in kinds
    )
    value = np.exp(log_lift(campaign.setting, pieces)) / campaign.setting.inf_N
    at, index = np.unique(campaign.setting.bench.z_hat, return_inverse=True)
    return np.interp(np.log(z_hat), np.log(at), np.bincount(index, value) / np.bincount(index))


def row(boundary: str, seed: int) -> dict[str, object]:
    """Answers to one campaign: by lift alone, with downwash, with a wrong one, with a speed."""
    make = partial(trials, {"visits": 5}, rho=(0.3, 1.4), always=True, among=NEAR[boundary])
    kind = Kind(name="near", group="", make=make)
    campaign = kind.make(kind, boundary, seed)
    rng, data = stream(seed, "downwash", boundary), campaign.data
    z_hat = np.array(CUTS[boundary])
    truth = 1 / ratio(campaign, INFLOW, z_hat) + U_DOWNWASH * rng.standard_normal(len(z_hat))
    held = 1 + campaign.truth.amplitudes.get("held_quantity", 0.0)
    inflow = ratio(campaign, INFLOW, np.minimum(data.z_hat, 1e3))
    speed = 200 * (1 + data.throttle) * inflow ** ((held - AT_SPEED) / 2)
    speed *= 1 + U_SPEED * rng.standard_normal(data.n)

    def answer(downwash: np.ndarray | None = None, **logged: np.ndarray) -> dict[str, object]:
        cuts = () if downwash is None else zip(z_hat, downwash, strict=True)
        measured = tuple(MeasuredDownwash(z_hat=z, ratio=v, u=U_DOWNWASH) for z, v in cuts)
        seen = replace(data, covariates={**data.covariates, **logged})
        base = catalogue.model(catalogue.default_base(boundary, 4))
        options = Options(seed=seed, downwash=measured)
        problem, _, _ = set_up(seen, base, campaign.parts, options)
        found = search_to_convergence(problem)
        listed = [asdict(e) for e in found.probabilities]
        return {"set": [e.effects for e in found.accepted], "probabilities": listed}

    return {
        "boundary": boundary,
        "seed": seed,
        "truth": [*campaign.truth.amplitudes],
        "lift": answer(),
        "downwash": answer(truth),
        "wrong": answer(truth - WRONG),
        "speed": answer(speed_Hz=speed),
    }


def main() -> None:
    """Run campaigns, keep a line of each, and print how many best names are the truth."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out")
    parser.add_argument("first", type=int)
    parser.add_argument("count", type=int)
    args = parser.parse_args()
    best: Counter[str] = Counter()
    with Path(args.out).open("a") as file:
        for seed in range(args.first, args.first + args.count):
            try:
                made = row(("ground", "ceiling")[seed % 2], seed)
            except Unreachable:
                continue
            print(json.dumps(made), file=file, flush=True)
            best["campaigns"] += 1
            for key in ("lift", "downwash", "wrong", "speed"):
                named = made[key]["set"]
                best[key] += bool(named) and [*named[0]] == made["truth"]
    print(dict(best))


if __name__ == "__main__":
    main()
