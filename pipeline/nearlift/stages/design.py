"""`design`: a campaign weighed before it is run, and a random schedule for it.

Not a stage: it makes no product. It reads the manifest, and the schedule where there is one, and
writes ``reports/<campaign>/design/``. The schedule it draws goes there too, or where `--write`
says, but never over anything: a campaign's folder is its owner's.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from nearlift import units
from nearlift.campaign.forecasts import Planned
from nearlift.campaign.manifest import Campaign
from nearlift.declare import Boundary, FloatArray
from nearlift.errors import NotConverged, UsageError
from nearlift.likelihood import budget
from nearlift.likelihood.covariates import derive
from nearlift.likelihood.problem import lift_ratio, usable
from nearlift.loop.outlook import outlook
from nearlift.loop.rehearsal import planned
from nearlift.results.design import BoundaryOutlook, DesignOutlook, DrawnSchedule
from nearlift.run import tables
from nearlift.run.engine import Job
from nearlift.schedule import BY_NAME, csv_text
from nearlift.stages.choices import choice, search_options
from nearlift.stages.gathering import for_print
from nearlift.stages.observe import boundaries, observe
from nearlift.stages.plans import PlannedTrials, as_schedule, draw, plan, scatter, table_of
from nearlift.synthetic.trial_schedule import TrialSchedule

SCHEDULE = "trials.csv"
#: Units of a schedule's columns where the manifest gives none.
USUAL = {"distance": "mm", "throttle": "percent", "start": "s", "supply": "V"}


def run(job: Job, *, earlier: Path | None = None, write: Path | None = None) -> DesignOutlook:
    """Weigh the planned campaign; writes the figure, the numbers and a random schedule, and returns
    what the console shows.

    `earlier` is ``processed/<campaign>`` of one whose noise floor is expected here too, `write` a
    file, or existing folder, for the schedule, in place of
    ``reports/<campaign>/design/trials.csv``.

    Raises
    ------
    UsageError
        Neither a schedule nor a `[design]`, or `write` names a file that exists.
    NotConverged
        No boundary has enough planned trials.
    """
    target = _target(job, write)
    made = plan(job.campaign, job.root, job.seed)
    parts = budget.components(job.campaign)
    options = search_options(job.campaign, job.seed)
    weighed: dict[Boundary, BoundaryOutlook] = {}
    notes = []
    present = boundaries(made.table)
    for i, boundary in enumerate(present):
        job.say(f"design {boundary}", i / len(present))
        base, _ = choice(job.campaign, boundary)
        given = job.campaign.design.expected.get(boundary, {}) if job.campaign.design else {}
        unknown = sorted(given.keys() - {p.name for p in base.parameters})
        if unknown:
            raise UsageError(
                f"design.expected.{boundary}",
                f"{base.name} has no {unknown[0]}",
                f"it has {', '.join(p.name for p in base.parameters)}",
            )
        theta = np.array([given.get(p.name, p.value) for p in base.parameters])
        data = observe(made.table, job.campaign, boundary)
        noise = scatter(job.campaign, boundary, earlier)
        try:
            foresight, library, untestable = planned(data, base, parts, noise, options, theta)
        except NotConverged as fault:
            notes.append(f"{boundary}: {fault.what}; {fault.remedy}")
            continue
        variants = {}
        if made.design is None and "both directions" not in options.not_feasible:
            for text, table in _otherwise(job.campaign, made, job.seed).items():
                other = observe(table, job.campaign, boundary)
                other = other.take(usable(base, other))
                variants[text] = derive(
                    other,
                    other.level_medians(other.lift_N)[other.level],
                    lift_ratio(base, other, base.named(theta)),
                )
        weighed[boundary] = outlook(foresight, library, untestable, noise, variants)
    if not weighed:
        raise NotConverged(
            f"design of {job.campaign.name}",
            "; ".join(notes) or "no trial is planned",
            "plan more trials",
        )
    drawn = made.design or draw(job.campaign, job.seed, _read_off(job.campaign, made))
    answer = DesignOutlook(
        campaign=job.campaign.name,
        plan=made.source,
        assumed=made.assumed,
        boundaries=weighed,
        notes=tuple(notes),
        schedule=_write(job, drawn, target),
    )
    return dataclasses.replace(answer, files=_draw(job, answer))


def _target(job: Job, write: Path | None) -> Path:
    if write is None:
        return job.reports / "design" / SCHEDULE
    path = write / SCHEDULE if write.is_dir() else write
    if path.exists():
        raise UsageError(
            str(path),
            "exists",
            "name another file; a schedule that may have been run is never overwritten",
        )
    return path


def _read_off(campaign: Campaign, made: PlannedTrials) -> Planned:
    """A `[design]` that has what a schedule tells; the rest is the manifest's or the default."""
    table = made.table
    distances: dict[Boundary, list[float]] = {}
    visits = []
    for side in boundaries(table):
        mine = table["boundary"] == side
        recorded = np.round(table["z_m"][mine] - campaign.rig.offset(side), 9)
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


def _otherwise(campaign: Campaign, made: PlannedTrials, seed: int) -> dict[str, tables.Table]:
    """The schedule's trials in random order, and from both sides."""
    drawn = draw(campaign, seed, _read_off(campaign, made))
    table, _ = table_of(as_schedule(drawn, campaign), campaign)
    # what only the schedule on disk knows cannot be ordered anew, so only the usual covariates are
    # compared
    if {"supply_V", "temperature_K", "tilt_rad"} & made.table.keys() - table.keys():
        return {}
    return {"the same trials in random order, each distance from both sides": table}


def _write(job: Job, drawn: TrialSchedule, target: Path) -> DrawnSchedule:
    text = schedule_text(drawn, job.campaign)
    if target.is_relative_to(job.reports):
        job.publish(str(target.relative_to(job.reports)), text.encode())
    else:
        tables.write_whole(target, text.encode())
    wanted = job.campaign.design
    trial_s = wanted.trial if wanted else 20.0
    via = drawn.further.get("via_m", np.full(len(drawn), np.nan))
    stops = np.unique(drawn.visit, return_index=True)[1]
    sides = drawn.approach[stops]
    return DrawnSchedule(
        file=str(target),
        trials=len(drawn),
        visits=len(stops),
        sessions=len(np.unique(drawn.session)),
        hours=float((drawn.start_s[-1] + trial_s) / 3600),
        from_afar=float(np.mean(sides < 0)),
        detours=int(np.isfinite(via[stops]).sum()),
        seed=job.seed,
    )


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
    # a schedule whose every cell of a known column is blank is refused by nobody: it is filled in
    # while the campaign is run
    columns |= {name: [""] * len(drawn) for name in logs if name in BY_NAME and name not in columns}
    columns = {name: cells for name, cells in columns.items() if name not in constant}
    return csv_text(columns, zip(*columns.values(), strict=True))


def outside(campaign: Campaign, name: str, value: float) -> str:
    """A schedule's cell in the manifest's unit, else the usual one; blank where it is no number."""
    if not np.isfinite(value):
        return ""
    dimension = BY_NAME[name].dimension
    unit = campaign.trials.units.get(name, USUAL[name])
    factor, offset = units.to_si(unit, dimension, f"trials.units.{name}")
    return f"{(value - offset) / factor:.6g}"


def _draw(job: Job, answer: DesignOutlook) -> tuple[str, ...]:
    """Numbers as JSON, the figure as pdf, png and csv; the paths written."""
    # whoever wants a schedule waits for no picture
    from nearlift.report.figures import design as picture

    files = for_print(picture.draw, picture.rows(answer), job.campaign)
    content = {"json": tables.json_bytes(answer), **files}
    return tuple(str(job.publish(f"design/design.{kind}", data)) for kind, data in content.items())
