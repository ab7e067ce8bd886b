"""Planned trials: from a schedule or from `[design]`, with their expected scatter; as rows of a
schedule; and how the traverse arrives at a visit.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import string
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from nearlift import units
from nearlift.campaign.forecasts import Planned
from nearlift.campaign.manifest import Campaign
from nearlift.declare import Boundary, FloatArray
from nearlift.errors import ManifestError, UsageError
from nearlift.observed import Trials
from nearlift.results import Noise, Observations
from nearlift.results.next_visits import NextVisits
from nearlift.schedule import BY_NAME, Schedule
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


# ---- schedules as CSV

#: Units of a schedule's columns where the manifest gives none.
USUAL = {"distance": "mm", "throttle": "percent", "start": "s", "supply": "V"}


def schedule_text(drawn: TrialSchedule, campaign: Campaign) -> str:
    """A schedule as CSV in the manifest's units, with a blank column for everything that `[design]
    logs` names.

    `via` is the distance to drive to before the station, to arrive from the other side.
    """
    constant = campaign.trials.constants

    def listed(values: FloatArray, name: str) -> list[str]:
        return [outside(campaign, name, v) for v in values]

    columns: dict[str, list[str]] = {
        "trial": [str(t) for t in drawn.trial],
        "boundary": [str(b) for b in drawn.boundary],
        "distance": listed(drawn.recorded_m, "distance"),
        "throttle": listed(drawn.throttle, "throttle"),
        "session": [str(s) for s in drawn.session],
        "start": listed(drawn.start_s, "start"),
        "approach": [f"{a:+.0f}" for a in drawn.approach],
    }
    if np.isfinite(drawn.further.get("via_m", np.nan)).any():
        # a detour is made once, on the way to the visit
        arrives = np.r_[True, drawn.visit[1:] != drawn.visit[:-1]]
        columns["via"] = listed(np.where(arrives, drawn.further["via_m"], np.nan), "distance")
    logs = campaign.design.logs if campaign.design else []
    # blank until the campaign is run
    columns |= {name: [""] * len(drawn) for name in logs if name in BY_NAME and name not in columns}
    columns = {name: cells for name, cells in columns.items() if name not in constant}
    return pd.DataFrame(columns).to_csv(index=False, lineterminator="\n")


def outside(campaign: Campaign, name: str, value: float) -> str:
    """A schedule's cell in the manifest's unit, else the usual one; blank where it is no number."""
    if not np.isfinite(value):
        return ""
    dimension = BY_NAME[name].dimension
    unit = campaign.trials.units.get(name, USUAL[name])
    factor, offset = units.to_si(unit, dimension, f"trials.units.{name}")
    return f"{(value - offset) / factor:.6g}"


def further_rows(
    batches: Sequence[NextVisits], trials: Trials, campaign: Campaign, columns: Iterable[str]
) -> str:
    """Visits as further rows of a schedule with these columns, and a supply where that is moved.

    Cells that a trial's run will fill are blank. Trials are numbered on, in the last session; with
    a unit of `start`, at times after the last one's.
    """
    header = [name for name in columns if name not in campaign.trials.constants]
    moved = any(v.supply_V is not None for batch in batches for v in batch.visits)
    if moved and "supply" not in header:
        header.append("supply")
    rows: list[list[str]] = []
    ids = _numbered_on(trials["trial"].tolist())
    timed = "start" in campaign.trials.units and "start_s" in trials
    start_s = trials["start_s"] if timed else np.zeros(1)
    spacing = float(np.median(np.diff(start_s))) if len(start_s) > 1 else 0.0
    session = str(trials["session"][-1]) if "session" in trials else ""
    for batch in batches:
        for visit in batch.visits:
            # records that hold several throttles are listed once
            throttles = visit.throttles if "throttle" in header else (np.nan,)
            side = "none" if np.isinf(visit.z_hat) else str(batch.boundary)
            for i, throttle in enumerate(throttles):
                at = float(start_s[-1]) + spacing * (len(rows) + 1)
                cells = {
                    "trial": next(ids),
                    "boundary": side,
                    "distance": outside(campaign, "distance", visit.distance_m),
                    "throttle": outside(campaign, "throttle", throttle),
                    "start": outside(campaign, "start", round(at, 1)) if timed else "",
                    "session": session,
                    "approach": f"{visit.approach:+d}",
                    # driven once, on the way to the visit
                    "via": outside(campaign, "distance", visit.via_m or np.nan) if i == 0 else "",
                    "supply": outside(campaign, "supply", visit.supply_V or np.nan),
                }
                rows.append([cells.get(name, "") for name in header])
    return pd.DataFrame(rows, columns=header).to_csv(index=False, lineterminator="\n")


def _numbered_on(known: Sequence[str]) -> Iterator[str]:
    """Ids of trials that go on from the last one that ends in a number, none of them known."""
    counted = [text for text in known if text[-1:] and text[-1] in string.digits]
    last = counted[-1] if counted else "next-0"
    before = last.rstrip(string.digits)
    digits = last.removeprefix(before)
    taken = set(known)
    numbers = (f"{before}{i:0{len(digits)}d}" for i in itertools.count(int(digits) + 1))
    return (text for text in numbers if text not in taken)


@dataclass(frozen=True, slots=True, kw_only=True)
class Traverse:
    """Stations of a boundary by z_hat.

    Attributes
    ----------
    shown_m : mapping
        Reading of the traverse at each, m; infinite in free air.
    balance : mapping
        Visits made that arrived moving away, less those that came closer.
    overshoot_m : float
        Distance past a station to which it drives, to arrive from the other side; 0 where sides are
        not logged.
    """

    shown_m: Mapping[float, float]
    balance: Mapping[float, float]
    overshoot_m: float

    def ways(
        self, z_hat: Iterable[float], last: float, rng: np.random.Generator
    ) -> list[tuple[int, float | None]]:
        """Side and detour of each visit, from the station `last` on.

        The side is +1 where the last move leads away from the boundary. It is the one from which
        the station was visited less often, at random where both are even. The nearest and the
        farthest station have one side only. The detour is where to drive to first, or None.
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


def traverse(trials: Trials, data: Observations, campaign: Campaign) -> Traverse:
    """Traverse of a boundary: every scheduled distance, and the sides of its trials."""
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
