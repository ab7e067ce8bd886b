"""Planned trials: from a schedule or from `[design]`, with their expected scatter; and as rows of a
schedule.
"""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from nearlift import units
from nearlift.campaign.choices import Planned
from nearlift.campaign.manifest import Campaign
from nearlift.declare import FloatArray
from nearlift.errors import ManifestError, UsageError
from nearlift.observed import Trials
from nearlift.results import Noise
from nearlift.results.answers import NextVisits
from nearlift.schedule import BY_NAME, SETTINGS, Schedule
from nearlift.synthetic.records import GRAVITY
from nearlift.synthetic.trial_schedule import TrialSchedule, balanced, from_both_sides, randomised

#: Scatter of a small rig in good order, where `[design]` does not give it.
ASSUMED = Noise(
    relative=5e-3,
    force_N=3e-4,
    height_m=5e-5,
    source="assumed: 0.5 % of lift, 0.3 mN, 0.05 mm per visit",
)
#: Full throttle lifts twice the weight, and lift scales as this power of throttle: Bitcraze's table
#: of the Crazyflie has 1.3 to 1.5.
FULL_WEIGHTS, THRUST_POWER = 2.0, 1.4
#: Distance past a station to which the traverse goes, to arrive from the other side.
OVERSHOOT_RADII = 0.1
#: Units of a schedule's columns where the manifest gives none.
USUAL = {"distance": "mm", "throttle": "percent", "start": "s", "supply": "V"}


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedTrials:
    """Planned trials as columns of trials.parquet, `lift_N` being L_inf.

    `source` is the schedule's name or ``[design]``, `assumed` what was assumed of the trials, and
    `drawn` the random schedule of a `[design]`.
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
    trials: Schedule | TrialSchedule
    if listed is not None:
        trials, source = listed
        logged = dict(trials.covariates)
    elif campaign.design is not None:
        trials = drawn = draw(campaign, seed)
        source, session = "[design]", drawn.session.astype(str).astype(object)
        logged = {"start_s": drawn.start_s, "session": session, "approach": drawn.approach}
    else:
        raise UsageError(
            campaign.name,
            "has neither a schedule with trials nor a [design]",
            "write [design] with distances, throttles, visits and sessions",
        )
    settings = {name: getattr(trials, name) for name in SETTINGS if name != "z_hat"}
    settings["z_hat"] = trials.z_m / campaign.vehicle.rotor_radius
    visit = trials.visit
    n = len(visit)
    far_N, assumed = _levels(campaign, settings["throttle"])
    table = {**settings, "lift_N": far_N, "u_lift_N": np.zeros(n), "n_eff": np.ones(n)}
    table |= {"visit": visit, "quality": np.full(n, "", dtype=object)}
    # a column of numbers with gaps is not yet logged
    table |= {
        name: v
        for name, v in logged.items()
        if v.dtype.kind not in "fiu" or np.isfinite(v.astype(float)).all()
    }
    ranges = _ranged(campaign.design, table) if campaign.design else {}
    table |= {name: values for name, (values, _) in ranges.items()}
    said = (*assumed, *(words for _, words in ranges.values()))
    return PlannedTrials(table=table, source=source, assumed=said, drawn=drawn)


def draw(campaign: Campaign, seed: int, planned: Planned | None = None) -> TrialSchedule:
    """A random schedule of a `[design]`: visits in random order, throttles balanced, each station
    from both sides where it can be.
    """
    wanted = planned or campaign.design
    assert wanted is not None
    drawn = randomised(
        wanted.distances,
        seed=seed,
        offset_m={side: campaign.distance_reference(side).offset_m for side in wanted.distances},
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


def _levels(campaign: Campaign, throttle: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """L_inf of each trial, N, and what was assumed to get it."""
    wanted = campaign.design
    if wanted is not None and wanted.lift is not None:
        known = dict(zip(wanted.throttles, wanted.lift, strict=True))
        if lacking := sorted(set(throttle.tolist()) - set(known)):
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


def _ranged(wanted: Planned, known: Trials) -> dict[str, tuple[FloatArray, str]]:
    """Covariates that `[design]` expects and the schedule does not have, with the assumption."""
    visit = known["visit"]
    n, ranges = len(visit), {}
    if wanted.supply:
        first, last = wanted.supply
        session = pd.Series(known.get("session", np.zeros(n)))
        place = session.groupby(session).cumcount()
        share = place / (session.groupby(session).transform("size") - 1).clip(lower=1)
        words = f"supply falls from {first:g} to {last:g} V in every session"
        ranges["supply_V"] = first + (last - first) * share.to_numpy(), words
    if wanted.temperature:
        low, high = wanted.temperature
        swing = np.sin(np.linspace(0, 3 * np.pi, n)) ** 2
        words = f"temperature swings three times between {low:g} and {high:g} K"
        ranges["temperature_K"] = low + (high - low) * swing, words
    if wanted.tilt:
        tilt = np.resize(np.asarray(wanted.tilt), int(visit.max()) + 1)[visit]
        ranges["tilt_rad"] = tilt, "tilt takes the listed values visit by visit"
    return {name: given for name, given in ranges.items() if name not in known}


def scatter(campaign: Campaign) -> Noise:
    """Expected scatter of trials: `[design.noise]`, else `ASSUMED`."""
    given = campaign.design.noise if campaign.design else None
    if given is None:
        return ASSUMED
    return Noise(
        relative=given.relative, force_N=given.force, height_m=given.height, source="[design.noise]"
    )


# ---- schedules as CSV


def schedule_text(drawn: TrialSchedule, campaign: Campaign) -> str:
    """A schedule as CSV in the manifest's units, with a blank column for everything that `[design]
    logs` names.

    `via` is the distance to drive to before the station, to arrive from the other side.
    """
    columns = {
        "trial": drawn.trial,
        "boundary": drawn.boundary,
        "distance": [outside(campaign, "distance", d) for d in drawn.recorded_m],
        "throttle": [outside(campaign, "throttle", t) for t in drawn.throttle],
        "session": drawn.session,
        "start": [outside(campaign, "start", s) for s in drawn.start_s],
        "approach": [f"{a:+.0f}" for a in drawn.approach],
    }
    if np.isfinite(via := drawn.further.get("via_m", np.full(len(drawn), np.nan))).any():
        # a detour is made once, on the way to the visit
        arrives = np.r_[True, drawn.visit[1:] != drawn.visit[:-1]]
        via = np.where(arrives, via, np.nan)
        columns["via"] = [outside(campaign, "distance", d) for d in via]
    logs = campaign.design.logs if campaign.design else []
    # blank until the campaign is run
    columns |= {name: "" for name in logs if name in BY_NAME and name not in columns}
    frame = pd.DataFrame(columns).drop(columns=[*campaign.trials.constants], errors="ignore")
    return frame.to_csv(index=False, lineterminator="\n")


def outside(campaign: Campaign, name: str, value: float | None) -> str:
    """A schedule's cell in the manifest's unit, else the usual one; blank where it is no number."""
    if value is None or not np.isfinite(value):
        return ""
    unit = campaign.trials.units.get(name, USUAL[name])
    factor, offset = units.to_si(unit, BY_NAME[name].dimension, f"trials.units.{name}")
    return f"{(value - offset) / factor:.6g}"


def further_rows(
    batches: Sequence[NextVisits], trials: Trials, campaign: Campaign, columns: Iterable[str]
) -> str:
    """Visits as further rows of a schedule with these columns, and a supply where that is moved.

    Cells that a trial's run will fill are blank. Trials are numbered on, in the last session.
    """
    header = [name for name in columns if name not in campaign.trials.constants]
    if any(v.supply_V is not None for batch in batches for v in batch.visits):
        header = list(dict.fromkeys((*header, "supply")))
    ids = _numbered_on(trials["trial"].tolist())
    rows = [
        {
            "boundary": "none" if np.isinf(visit.z_hat) else batch.boundary,
            "distance": outside(campaign, "distance", visit.distance_m),
            "throttle": outside(campaign, "throttle", throttle),
            "session": str(trials["session"][-1]) if "session" in trials else "",
            "approach": f"{visit.approach:+d}",
            "supply": outside(campaign, "supply", visit.supply_V),
        }
        for batch in batches
        for visit in batch.visits
        # records that hold several throttles are listed once
        for throttle in (visit.throttles if "throttle" in header else (None,))
    ]
    frame = pd.DataFrame(rows)
    frame["trial"] = [next(ids) for _ in rows]
    return frame.reindex(columns=header).to_csv(index=False, lineterminator="\n")


def _numbered_on(known: Sequence[str]) -> Iterator[str]:
    """Ids of trials that go on from the last one that ends in a number, none of them known."""
    counted = [match for text in known if (match := re.search(r"(?<![0-9])[0-9]+\Z", text))]
    before, digits = "next-", "0"
    if counted:
        before, digits = counted[-1].string[: counted[-1].start()], counted[-1][0]
    numbers = (f"{before}{i:0{len(digits)}d}" for i in itertools.count(int(digits) + 1))
    return (text for text in numbers if text not in {*known})
