"""diagnose: the closed loop on every boundary, to diagnosis.json, loop_residuals.parquet, and what
is to be quoted to results.json.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Boundary
from nearlift.errors import NotConverged
from nearlift.fit.base_result import base_result, shape_doubts
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget
from nearlift.loop.diagnose import diagnose
from nearlift.loop.search import Options
from nearlift.loop.search_problem import Options
from nearlift.products import DIAGNOSIS, LOOP_RESIDUALS, NOT_DIAGNOSED, TRIALS
from nearlift.report.findings import could_have_seen
from nearlift.results.fit import FitResults
from nearlift.results.quotation import BoundaryResult, Results
from nearlift.run import expense
from nearlift.run.job import Job, Outcome
from nearlift.run.store import Table, stacked
from nearlift.stages.fit import choice
from nearlift.stages.observe import boundaries, interim_look, observe


def run(job: Job) -> Outcome:
    """Diagnose each boundary; one that cannot be diagnosed has a block that says why, and
    is noted.
    """
    trials = job.read(TRIALS)
    parts = budget.components(job.campaign)
    options = chosen(job)
    findings: dict[str, Any] = {}
    residuals: list[Table] = []
    quoted: dict[Boundary, BoundaryResult] = {}
    fitted = job.load(FitResults)
    notes = []
    for boundary in boundaries(trials):
        job.say(f"diagnose {boundary}")
        data = observe(trials, job.campaign, boundary)
        expense.announce(
            job.announce,
            f"diagnose {boundary}",
            expense.DIAGNOSE,
            data,
            "; several times as long if there is structure to name",
        )
        base, _ = choice(job.campaign, boundary)
        try:
            found = diagnose(
                data, base, parts, options, look=interim_look(trials, job.campaign, boundary)
            )
        except NotConverged as fault:
            reason = f"{fault.what}; {fault.remedy}"
            findings[boundary] = {
                "verdict": NOT_DIAGNOSED,
                "reason": reason,
                "base_model": base.name,
                "effects": [],
                "structure": [],
            }
            quoted[boundary] = base_result(
                fit(base, data, parts), fitted.boundaries[boundary][base.name], reason
            )
            notes.append(f"{boundary}: not diagnosed: {reason}")
            continue
        findings[boundary] = found.findings
        if look := found.findings.get("look"):
            notes.append(f"{boundary}: {look['text']}")
        if could := could_have_seen(found.findings):
            notes.append(f"{boundary}: {data.n} trials {could}")
        # the same likelihood but for its noise
        quoted[boundary] = (
            found.quoted.doubting(shape_doubts(fitted.boundaries[boundary][base.name]))
            if found.quoted.verdict == "adequate"
            else found.quoted
        )
        notes += [
            f"{boundary}: {told}"
            for told in (*found.findings.get("contradicted", ()), found.quoted.leaning)
            if told
        ]
        residuals.append(
            {
                "boundary": np.full(len(found.residuals["trial"]), boundary, dtype=object),
                **found.residuals,
            }
        )
    job.write(LOOP_RESIDUALS, stacked(LOOP_RESIDUALS, residuals))
    job.write_json(
        DIAGNOSIS,
        {
            "schema": DIAGNOSIS.schema,
            "false_alarm_rate": options.false_alarm_rate,
            "boundaries": findings,
        },
    )
    job.save(Results(boundaries=quoted))
    return Outcome(notes=tuple(notes))


def chosen(job: Job) -> Options:
    """The search's options that a manifest may set."""
    asked = job.campaign.diagnose
    return Options(
        seed=job.seed,
        false_alarm_rate=asked.false_alarm_rate,
        not_feasible=tuple(asked.not_feasible),
    )
