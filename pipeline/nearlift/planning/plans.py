"""Planned trials, from a schedule or from `[design]`, and their expected scatter."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.campaign.forecasts import Planned
from nearlift.campaign.manifest import Campaign
from nearlift.declare import Boundary, FloatArray
from nearlift.errors import ManifestError, UsageError
from nearlift.observed import Trials
from nearlift.results import Noise
from nearlift.schedule import Schedule
from nearlift.synthetic.records import GRAVITY
from nearlift.synthetic.trial_schedule import TrialSchedule, balanced, from_both_sides, randomised

#: Scatter of a small rig in good order, where neither `[design]` nor an earlier campaign gives it.
ASSUMED = Noise(
    relative=5e-3,
    force_N=3e-4,
    height_m=5e-5,
    source="assumed: 0.5 % of lift, 0.3 mN, 0.05 mm per visit",
)
#: Full throttle lifts twice the weight, and lift goes with this power of throttle: Bitcraze's table
#: of the Crazyflie has 1.3 to 1.5.
FULL_WEIGHTS, THRUST_POWER = 2.0, 1.4
#: Distance past a station to which the traverse goes, to arrive from the other side.
OVERSHOOT_RADII = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedTrials:
    """Planned trials as columns of trials.parquet, `lift_N` being L_inf.

    Attributes
    ----------
    source : str
        Name of the schedule, or ``[design]``.
    assumed : tuple of str
        Assumptions about the trials.
    drawn : TrialSchedule or None
        Random schedule of a `[design]`.
    """

    table: Trials
    source: str
    assumed: tuple[str, ...]
    drawn: TrialSchedule | None = None


def plan(campaign: Campaign, listed: tuple[Schedule, str] | None, seed: int) -> PlannedTrials:
    """Trials of the schedule that is `listed` under a name, else of a random one from `[design]`.

    Raises
    ------
    UsageError
        There is neither.
    """
    drawn = None
    if listed is not None:
        schedule, source = listed
    elif campaign.design is not None:
        drawn = draw(campaign, seed)
        schedule, source = as_schedule(drawn, campaign), "[design]"
    else:
        raise UsageError(
            campaign.name,
            "has neither a schedule with trials nor a [design]",
            "write [design] with distances, throttles, visits and sessions",
        )
    table, assumed = table_of(schedule, campaign)
    return PlannedTrials(table=table, source=source, assumed=assumed, drawn=drawn)


def draw(campaign: Campaign, seed: int, planned: Planned | None = None) -> TrialSchedule:
    """A random schedule of a `[design]`: visits in random order, throttles balanced, each station
    from both sides where it can be.
    """
    wanted = planned or campaign.design
    assert wanted is not None
    drawn = randomised(
        wanted.distances,
        seed=seed,
        offset_m={side: campaign.rig.offset(side) for side in wanted.distances},
        throttles=wanted.throttles,
        visits=wanted.visits,
        sessions=wanted.sessions,
        trial_s=wanted.trial,
        move_s=wanted.move,
    )
    # the usual pause between sessions is the schedule's own; another one shifts all that follows
    starts = drawn.start_s + (wanted.change - 300.0) * drawn.session
    drawn = balanced(
        dataclasses.replace(drawn, start_s=np.round(starts - starts[0] + wanted.move, 1)), seed=seed
    )
    usual = OVERSHOOT_RADII * campaign.vehicle.rotor_radius
    overshoot = usual if wanted.overshoot is None else wanted.overshoot
    return from_both_sides(drawn, overshoot_m=overshoot, seed=seed) if overshoot > 0 else drawn


def as_schedule(drawn: TrialSchedule, campaign: Campaign) -> Schedule:
    """A drawn schedule as the reader would give it."""
    return Schedule(
        trial=drawn.trial,
        boundary=drawn.boundary,
        z_m=drawn.z_m,
        z_hat=drawn.z_m / campaign.vehicle.rotor_radius,
        throttle=drawn.throttle,
        visit=drawn.visit,
        covariates={
            "start_s": drawn.start_s,
            "session": drawn.session.astype(str).astype(object),
            "approach": drawn.approach,
        },
    )


def table_of(schedule: Schedule, campaign: Campaign) -> tuple[Trials, tuple[str, ...]]:
    """Planned trials in the shape of trials.parquet, and what was assumed of them."""
    far_N, assumed = _levels(campaign, schedule.throttle)
    covariates, more = _ranged(campaign.design, schedule)
    n = len(schedule)
    table = {
        **schedule.settings,
        "lift_N": far_N,
        "u_lift_N": np.zeros(n),
        "n_eff": np.ones(n),
        "visit": schedule.visit,
        "quality": np.full(n, "", dtype=object),
        **covariates,
    }
    return table, (*assumed, *more)


def _levels(campaign: Campaign, throttle: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """L_inf of each trial, N, and what was assumed to get it."""
    wanted = campaign.design
    if wanted is not None and wanted.lift is not None:
        known = dict(zip(wanted.throttles, wanted.lift, strict=True))
        lacking = sorted(set(throttle.tolist()) - set(known))
        if lacking:
            raise ManifestError(
                "design.lift",
                f"has no lift for the throttle {lacking[0]:g}",
                "list every throttle of the schedule in design.throttles",
            )
        return np.array([known[t] for t in throttle.tolist()]), ()
    full = FULL_WEIGHTS * campaign.vehicle.mass * GRAVITY
    text = (
        f"lift far away: {FULL_WEIGHTS:g} weights ({full:.3g} N) at full throttle, with throttle to"
        f" the power {THRUST_POWER:g}"
    )
    return full * throttle**THRUST_POWER, (text,)


def _ranged(
    wanted: Planned | None, schedule: Schedule
) -> tuple[dict[str, NDArray[Any]], tuple[str, ...]]:
    """Covariates: the schedule's numbers and what `[design]` expects; and what was assumed."""
    known = {
        k: v
        for k, v in schedule.covariates.items()
        if v.dtype.kind not in "fiu" or np.isfinite(np.asarray(v, dtype=float)).all()
    }
    if wanted is None:
        return known, ()
    n, said = len(schedule), []
    session = known.get("session", np.zeros(n))
    if wanted.supply and "supply_V" not in known:
        share = np.zeros(n)
        for label in np.unique(session):
            here = session == label
            share[here] = np.linspace(0, 1, int(here.sum()))
        known["supply_V"] = wanted.supply[0] + (wanted.supply[1] - wanted.supply[0]) * share
        said.append(
            f"supply falls from {wanted.supply[0]:g} to {wanted.supply[1]:g} V in every session"
        )
    if wanted.temperature and "temperature_K" not in known:
        low, high = wanted.temperature
        known["temperature_K"] = low + (high - low) * np.sin(np.linspace(0, 3 * np.pi, n)) ** 2
        said.append(f"temperature swings three times between {low:g} and {high:g} K")
    if wanted.tilt and "tilt_rad" not in known:
        known["tilt_rad"] = np.resize(np.asarray(wanted.tilt), int(schedule.visit.max()) + 1)[
            schedule.visit
        ]
        said.append("tilt takes the listed values visit by visit")
    return known, tuple(said)


def scatter(
    campaign: Campaign, boundary: Boundary, floors: Mapping[Boundary, Noise] | None = None
) -> Noise:
    """Expected scatter of trials: an earlier campaign's noise floor, that of another boundary if
    need be; else `[design.noise]`; else `ASSUMED`.
    """
    if floors:
        floor = floors.get(boundary) or next(iter(floors.values()))
        return dataclasses.replace(floor, dof=np.inf)
    if campaign.design is not None and campaign.design.noise is not None:
        given = campaign.design.noise
        return Noise(
            relative=given.relative,
            force_N=given.force,
            height_m=given.height,
            source="[design.noise]",
        )
    return ASSUMED
