"""Forecast of a planned campaign, and a random schedule for it."""

from __future__ import annotations

import numpy as np

from nearlift.campaign.choices import Planned
from nearlift.campaign.manifest import Campaign
from nearlift.declare import Boundary, FloatArray, LiftModel
from nearlift.errors import NotConverged, UsageError
from nearlift.likelihood import budget
from nearlift.loop.expected_noise import planned
from nearlift.loop.predictions import outlook
from nearlift.observed import boundaries, choice, observe, search_options
from nearlift.planning.plans import PlannedTrials, draw, scatter
from nearlift.results.answers import BoundaryOutlook, DesignOutlook, DrawnSchedule
from nearlift.synthetic.trial_schedule import TrialSchedule

#: Duration of a trial where `[design]` gives none, s.
USUAL_TRIAL_S = 20.0


def design(
    campaign: Campaign, made: PlannedTrials, seed: int, file: str
) -> tuple[DesignOutlook, TrialSchedule]:
    """Forecast of the plan at each boundary, and a random schedule that `file` will hold.

    Raises
    ------
    UsageError
        ``[design.expected]`` names a coefficient that the base model does not have.
    NotConverged
        No boundary has enough planned trials.
    """
    forecasts: dict[Boundary, BoundaryOutlook] = {}
    notes, noise, parts = [], scatter(campaign), budget.components(campaign)
    for boundary in boundaries(made.table):
        base = choice(campaign, boundary)[0]
        theta = _expected(campaign, boundary, base)
        data = observe(made.table, campaign, boundary)
        options = search_options(campaign, boundary, seed)
        try:
            forecasts[boundary] = outlook(*planned(data, base, parts, noise, options, theta), noise)
        except NotConverged as fault:
            notes.append(f"{boundary}: {fault.what}; {fault.remedy}")
    if not forecasts:
        what = "; ".join(notes) or "no trial is planned"
        raise NotConverged(f"design of {campaign.name}", what, "plan more trials")
    drawn = made.drawn or draw(campaign, seed, _as_design(campaign, made))
    return DesignOutlook(
        campaign=campaign.name,
        plan=made.source,
        assumed=made.assumed,
        boundaries=forecasts,
        notes=tuple(notes),
        schedule=_summary(drawn, campaign, seed, file),
    ), drawn


def _expected(campaign: Campaign, boundary: Boundary, base: LiftModel) -> FloatArray:
    """Coefficients of the base model as ``[design.expected]`` or the declaration has them."""
    given = campaign.design.expected.get(boundary, {}) if campaign.design else {}
    unknown = sorted(given.keys() - {p.name for p in base.parameters})
    if unknown:
        raise UsageError(
            f"design.expected.{boundary}",
            f"{base.name} has no {unknown[0]}",
            f"it has {', '.join(p.name for p in base.parameters)}",
        )
    return np.array([given.get(p.name, p.value) for p in base.parameters])


def _as_design(campaign: Campaign, made: PlannedTrials) -> Planned:
    """Design with the stations, throttles and visits of the schedule."""
    table = made.table
    distances: dict[Boundary, list[float]] = {}
    visits = []
    for side in boundaries(table):
        mine = table["boundary"] == side
        recorded = np.round(table["z_m"][mine] - campaign.distance_reference(side).offset_m, 9)
        distances[side] = np.unique(recorded).tolist()
        visits.append(mine.sum() / len(distances[side]) / len(np.unique(table["throttle"])))
    sessions = len(np.unique(table["session"])) if "session" in table else 1
    throttles = np.unique(table["throttle"]).tolist()
    given = {
        "distances": distances,
        "throttles": throttles,
        "visits": max(int(np.ceil(np.mean(visits))), 1),
        "sessions": max(-(-sessions // len(distances)), 1),
    }
    return (
        campaign.design or Planned.model_construct(distances=distances, throttles=throttles)
    ).model_copy(update=given)


def _summary(drawn: TrialSchedule, campaign: Campaign, seed: int, file: str) -> DrawnSchedule:
    """Size and duration of a schedule."""
    trial_s = campaign.design.trial if campaign.design else USUAL_TRIAL_S
    via = drawn.further.get("via_m", np.full(len(drawn), np.nan))
    stops = np.unique(drawn.visit, return_index=True)[1]
    return DrawnSchedule(
        file=file,
        trials=len(drawn),
        visits=len(stops),
        sessions=len(np.unique(drawn.session)),
        hours=float((drawn.start_s[-1] + trial_s) / 3600),
        from_afar=float(np.mean(drawn.approach[stops] < 0)),
        detours=int(np.isfinite(via[stops]).sum()),
        seed=seed,
    )
