"""diagnose: the closed loop on every boundary, to diagnosis.json."""

from __future__ import annotations

from typing import Any

from nearlift.diagnosis.loop import close_loop
from nearlift.errors import NotConverged
from nearlift.fitting import budget
from nearlift.products import DIAGNOSIS, TRIALS
from nearlift.stages.fit import choice
from nearlift.stages.job import Job, Outcome
from nearlift.stages.observe import boundaries, observe


def run(job: Job) -> Outcome:
    """Diagnose each boundary; one with too few trials for it is left out, and noted."""
    trials = job.read(TRIALS)
    parts = budget.components(job.campaign)
    found: dict[str, Any] = {}
    notes = []
    for boundary in boundaries(trials):
        job.say(f"diagnose {boundary}")
        base, _ = choice(job.campaign, boundary)
        data = observe(trials, job.campaign, boundary)
        try:
            found[boundary] = close_loop(data, base, parts, seed=job.seed, false_alarm_rate=job.campaign.diagnose.false_alarm_rate)
        except NotConverged as fault:
            notes.append(f"{boundary}: not diagnosed: {fault.what}; {fault.remedy}")
    job.write_json(DIAGNOSIS, {"schema": DIAGNOSIS.schema, "false_alarm_rate": job.campaign.diagnose.false_alarm_rate, "boundaries": found})
    return Outcome(notes=tuple(notes))
