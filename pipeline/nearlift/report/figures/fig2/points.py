"""Trials of each point of Figure 2: their number, uncertainty and quality."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import units
from nearlift.declare import Boundary
from nearlift.reduction.quality import rejected
from nearlift.report.evidence import Columns, Evidence, stack, where
from nearlift.report.relative_lift import relative_lift
from nearlift.rounding import plain, plus_minus
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT

#: So many trials are named; the rest are counted.
NAMED = 6
#: A lift above this is told in newtons, below it in millinewtons.
MILLI_BELOW_N = 2.0


def force_unit(evidence: Evidence) -> tuple[float, str]:
    """Factor from newtons, and the unit, that the manifest asks for or that suit this vehicle."""
    unit: str = evidence.campaign.report.units.force
    if unit == "auto":
        unit = "N" if float(np.max(evidence.table(LIFT)["lift_N"])) > MILLI_BELOW_N else "mN"
    return 1.0 / units.to_si(unit, "force", "report.units.force")[0], unit


def throttle_key(throttle: float) -> str:
    """A throttle as fit.json names it."""
    return f"{throttle:g}"


def points(evidence: Evidence, boundary: Boundary) -> Columns:
    """The cells of one boundary, a row each, at finite and positive distance: `throttle` (key),
    `z_hat`, `delta` and `u_delta` (percent), `force` and `u_force` (in `force_unit`), and as text
    `label` (throttle), `at`, `delta_text`, `force_text`, `trials`, `names`, `quality`, `words` (all
    of it in a sentence).
    """
    lift, trials = (where(evidence.table(p), boundary=boundary) for p in (LIFT, TRIALS))
    scale, unit = force_unit(evidence)
    over = relative_lift(evidence, boundary)
    values = np.stack([over.throttle, over.z_hat, 100 * over.delta_L, 100 * over.u], axis=1)
    relative = {(throttle, z): (delta, u) for throttle, z, delta, u in values.tolist()}
    throttles, data = np.array(trials["throttle"], dtype=float), evidence.observations[boundary]
    if data.curve is not None:
        shown = np.array(data.curve.shown)
        throttles = shown[data.curve.nearest(throttles)]
    out = rejected(trials["quality"])
    rows = []
    columns = (lift[k].tolist() for k in ("throttle", "z_hat", "lift_N", "u_lift_N", "n_trials"))
    for throttle, z, lift_N, u_lift_N, n in zip(*columns, strict=True):
        delta, u_delta = relative.get((throttle, z), (math.nan, math.nan))
        if math.isnan(delta) or not z > 0:
            continue
        mine = (trials["z_hat"] == z) & (throttles == throttle)
        force, u_force = scale * lift_N, scale * u_lift_N
        lost = int((mine & out).sum())
        averaged = trials["trial"][mine & ~out].tolist()
        more = f" and {len(averaged) - NAMED} more" if len(averaged) > NAMED else ""
        row = {
            "throttle": throttle_key(throttle),
            "z_hat": z,
            "delta": delta,
            "u_delta": u_delta,
            "force": force,
            "u_force": u_force,
            "label": f"{100 * throttle:.3g} %",
            "at": f"{plain(z)} ({plain(1e3 * z * evidence.campaign.vehicle.rotor_radius, 3)} mm)",
            "delta_text": (
                f"{plus_minus(delta, u_delta)} %"
                if u_delta > 0
                else "0, by construction: L∞ is taken here"
            ),
            "force_text": f"{plus_minus(force, u_force)} {unit}",
            "trials": f"{n} averaged" + (f", {lost} rejected" if lost else ""),
            "names": ", ".join(averaged[:NAMED]) + more,
            "quality": _quality(trials["quality"][mine]),
        }
        row["words"] = (
            f"{boundary}, throttle {row['label']}, ẑ = {row['at']}: ΔL {row['delta_text']}; lift"
            f" {row['force_text']}; trials: {row['trials']}; quality: {row['quality']}"
        )
        rows.append(row)
    return stack(rows)


def _quality(quality: NDArray[Any]) -> str:
    count = Counter(name for text in quality.tolist() for name in text.split())
    return ", ".join(f"{name} {n}" for name, n in sorted(count.items())) or "good"
