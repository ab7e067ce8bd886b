"""One measurement read as a distance: a lift ratio, or the throttle at which the vehicle hovers,
against what was fitted.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.errors import InputRefused, UsageError
from nearlift.flight.proximity import inverse
from nearlift.manifest.flight import Detect, Reading
from nearlift.products import FIT
from nearlift.run.job import Job
from nearlift.stages.belief import Belief, believe

DRAWS = 100
#: Lift goes so with the supply where the loop did not find its own exponent: a motor at fixed duty.
SAG_EXPONENT = 2.0


def sensitivity(belief: Belief) -> float:
    """Relative change of lift per relative change of supply voltage."""
    return abs(belief.best.get("sag_exponent", SAG_EXPONENT))


def refuse_folds(belief: Belief) -> None:
    """Refuse a model of which the best estimate or any draw has one ratio at two heights."""
    for member in range(-1, belief.number):
        inverse.refuse_folds(
            belief.ratio(member),
            *belief.measured_z_hat,
            where=f"{belief.boundary} {belief.model.name}",
        )


def read(job: Job, reading: Reading, belief: Belief | None = None) -> dict[str, Any]:
    """The posterior of z_hat from one reading.

    Raises
    ------
    UsageError
        Nothing was fitted at that boundary.
    InputRefused
        The model folds, the throttle is outside those measured, or the reading is far from
        everything that the model can give.
    """
    fitted = job.read_json(FIT)
    if reading.boundary not in fitted["boundaries"]:
        raise UsageError(
            "boundary",
            f"nothing was fitted at the {reading.boundary}",
            f"fitted: {', '.join(fitted['boundaries'])}",
        )
    belief = believe(job, reading.boundary, DRAWS) if belief is None else belief
    refuse_folds(belief)
    ratio, u = _ratio(
        job,
        reading,
        belief,
        fitted["boundaries"][reading.boundary][fitted["base"][reading.boundary]],
    )
    found = inverse.locate(
        ratio, u, [belief.ratio(m) for m in range(belief.number)], *belief.measured_z_hat
    )
    radius_m = job.campaign.vehicle.rotor_radius
    return {
        "boundary": reading.boundary,
        "model": belief.model.name,
        "throttle": reading.throttle,
        "ratio": ratio,
        "u": u,
        "z_hat": {"median": found.median, "lo90": found.lo90, "hi90": found.hi90},
        "z_m": {
            "median": radius_m * found.median,
            "lo90": radius_m * found.lo90,
            "hi90": radius_m * found.hi90,
        },
        "beyond": found.beyond,
        "within_z_hat": list(belief.measured_z_hat),
    }


def _ratio(
    job: Job, reading: Reading, belief: Belief, entry: dict[str, Any]
) -> tuple[float, float]:
    """L / L_inf and its standard uncertainty. A ratio's `u` is all of it unless weight or supply
    are given too; hover always has both.
    """
    exponent = sensitivity(belief)
    if reading.ratio is not None:
        further = np.hypot(reading.weight or 0.0, exponent * (reading.supply or 0.0))
        return reading.ratio, float(np.hypot(reading.u, reading.ratio * further))
    chosen = job.campaign.detect or Detect()
    weight = chosen.payload[0] if reading.weight is None else reading.weight
    supply = exponent * (chosen.supply[0] if reading.supply is None else reading.supply)
    assert reading.throttle is not None
    # null stands for what is not finite
    known = sorted(
        (float(t), float(e["value"]), np.inf if e["u"] is None else float(e["u"]))
        for t, e in entry["L_inf_N"].items()
    )
    levels, lifts, spread = (list(column) for column in zip(*known, strict=True))
    own = float(np.interp(reading.throttle, levels, np.array(spread) / np.array(lifts)))
    mass = job.campaign.vehicle.mass if reading.mass is None else reading.mass
    return inverse.ratio_of_hover(
        reading.throttle,
        mass * job.campaign.rig.gravity,
        weight,
        levels,
        lifts,
        float(np.hypot(own, supply)),
        reading.u,
    )


def all_of(job: Job, beliefs: dict[str, Belief]) -> tuple[list[dict[str, Any]], list[str]]:
    """Every [[detect.reading]] of the manifest, those refused with the reason; and notes."""
    told, notes = [], []
    for i, reading in enumerate((job.campaign.detect or Detect()).reading):
        try:
            told.append(read(job, reading, beliefs.get(reading.boundary)))
        except (InputRefused, UsageError) as refusal:
            told.append(
                {"boundary": reading.boundary, "refused": f"{refusal.what}; {refusal.remedy}"}
            )
            notes.append(f"detect.reading[{i}]: {refusal.what}; {refusal.remedy}")
    return told, notes


def text(found: dict[str, Any]) -> str:
    """A reading's answer for the terminal."""
    low, high = found["within_z_hat"]
    z, mm = found["z_hat"], {k: 1e3 * v for k, v in found["z_m"].items()}
    share = "below 0.01" if found["beyond"] < inverse.NONE else f"{100 * found['beyond']:.2g}"
    hover = (
        "" if found["throttle"] is None else f" (hover at {100 * found['throttle']:.4g} % throttle)"
    )
    return (
        f"{found['boundary']}, {found['model']}: L/L_inf = {found['ratio']:.4g} +-"
        f" {found['u']:.2g}{hover}\nz_hat = {z['median']:.3g} (90 %: {z['lo90']:.3g} to"
        f" {z['hi90']:.3g}), {mm['median']:.3g} mm ({mm['lo90']:.3g} to {mm['hi90']:.3g}), if there"
        f" is a boundary\nnone between z_hat {low:.3g} and {high:.3g}: {share} % (50 % before the"
        " reading)"
    )
