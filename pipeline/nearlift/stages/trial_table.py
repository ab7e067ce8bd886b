"""Trial table of the report: every trial from its file to the figures, and the influence of each
exclusion.

The base model is fitted again with excluded trials put back. They return all together, by quality
code, and the first few one by one. The noise is that of the accepted trials. The influence of a
trial that the fit names is that of a fit without it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary
from nearlift.errors import NotConverged
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget
from nearlift.observed import boundaries, choice, observe
from nearlift.reduction.quality import CODES, rejected
from nearlift.report.trial_table import Exclusions, Refit, TrialCounts, TrialRow, TrialTable
from nearlift.results.fit import FitResults
from nearlift.run.engine import Job
from nearlift.run.tables import Table
from nearlift.stages.ingest import TRIALS

#: Excluded trials of one boundary that are put back one at a time.
ONE_BY_ONE = 40


def trial_table(job: Job) -> TrialTable:
    """The table of a campaign's trials, from trials.parquet and fit.json."""
    trials, fitted = job.read(TRIALS), job.load(FitResults)
    out = rejected(trials["quality"])
    outside = {
        (str(boundary), e.trial)
        for boundary in fitted.boundaries
        for e in fitted.of_base(boundary).excluded
    }
    keys = zip(trials["boundary"].tolist(), trials["trial"].tolist(), strict=True)
    unfitted = np.array([key in outside for key in keys], dtype=bool)
    rows = tuple(_row(trials, i, bool(out[i]), bool(unfitted[i])) for i in range(len(out)))
    files = sorted({str(s) for s in trials["source"] if s}) if "source" in trials else []
    sizes = [path.stat().st_size for name in files if (path := job.root / name).is_file()]
    return TrialTable(
        files=len(files),
        bytes=sum(sizes),
        samples=int(trials["samples"].sum()) if "samples" in trials else None,
        averaged=int(trials["n"].sum()),
        counts=TrialCounts(
            scheduled=len(rows),
            recorded=sum(row.completeness != "missing" for row in rows),
            accepted=int((~out).sum()),
            remarked=sum(bool(row.codes) for row, no in zip(rows, out, strict=True) if not no),
            fitted=int((~out & ~unfitted).sum()),
        ),
        trials=rows,
        # a model without a free coefficient has no headline that a trial could move
        put_back={
            b: _exclusions(job, trials, b, out, fitted)
            for b in boundaries(trials)
            if b in fitted.boundaries and choice(job.campaign, b)[0].parameters
        },
    )


def _row(trials: Table, i: int, out: bool, outside: bool) -> TrialRow:
    """The row of one trial."""

    def text(column: str) -> str:
        return str(trials[column][i]) if column in trials else ""

    return TrialRow(
        trial=text("trial"),
        boundary=text("boundary"),
        source=text("source"),
        sha256=text("source_sha256"),
        completeness=text("completeness"),
        samples=int(trials["samples" if "samples" in trials else "n"][i]),
        averaged=int(trials["n"][i]),
        lift_N=float(trials["lift_N"][i]),
        codes=tuple(text("quality").split()),
        # every accepted trial is in a mean of Figure 2, but only trials within the model's range
        # have a residual
        figures=() if out else ("fig2",) if outside else ("fig2", "residuals"),
    )


def _left_out(fitted: FitResults, boundary: Boundary) -> dict[str, Refit]:
    """The fit without each trial or visit that it names, and keeps."""
    u = next((e.u for e in fitted.of_base(boundary).parameters.values()), math.inf)
    return {
        s.id if s.kind == "trial" else f"visit {s.id}": (
            Refit(
                trials=len(s.trials),
                change=s.shift,
                change_in_u=s.shift / u if 0 < u < math.inf else math.nan,
            )
            if s.without
            else Refit(trials=len(s.trials), change=math.nan, change_in_u=math.nan, why_not=s.text)
        )
        for s in fitted.influence[boundary].suspects
    }


def _exclusions(
    job: Job, trials: Table, boundary: Boundary, out: NDArray[np.bool_], fitted: FitResults
) -> Exclusions:
    """The headline coefficient without the excluded trials, and with them."""
    model, _ = choice(job.campaign, boundary)
    name = model.parameters[0].name
    parts = budget.components(job.campaign)
    accepted = fit(model, observe(trials, job.campaign, boundary), parts)
    before = accepted.estimates[name]
    mine = out & np.isin(trials["boundary"], [boundary, "none"])
    with np.errstate(invalid="ignore"):
        able = mine & (trials["lift_N"] > 0) & np.isfinite(trials["lift_N"])
    low, high = model.valid_z_hat
    within = (trials["z_hat"] > low) & ((trials["z_hat"] <= high) | np.isinf(trials["z_hat"]))

    def put_back(chosen: NDArray[np.bool_]) -> Refit:
        """The coefficient with these trials among the others."""
        codes = np.where(chosen, "", trials["quality"])
        data = observe({**trials, "quality": codes}, job.campaign, boundary)
        n = int(chosen.sum())
        try:
            after = fit(model, data, parts, accepted.noise).estimates[name]
        except NotConverged as fault:
            return Refit(trials=n, change=math.nan, change_in_u=math.nan, why_not=fault.what)
        change = after.value - before.value
        in_u = change / before.u if 0 < before.u < math.inf else math.nan
        return Refit(trials=n, change=change, change_in_u=in_u)

    back = able & within
    if back.any():
        job.say(f"report {boundary}: {int(back.sum())} trials put back")
    with_code = {
        code.name: back & np.array([code.name in text.split() for text in trials["quality"]])
        for code in CODES
        if code.rejects
    }
    return Exclusions(
        model=model.name,
        parameter=name,
        excluded=int(mine.sum()),
        cannot_be_put_back={
            str(trials["trial"][i]): "it has no mean lift"
            if not able[i]
            else f"the model has no value at z_hat = {trials['z_hat'][i]:.4g}"
            for i in np.flatnonzero(mine & ~back)
        },
        all=put_back(back) if back.any() else None,
        codes={name: put_back(chosen) for name, chosen in with_code.items() if chosen.any()},
        trials={
            str(trials["trial"][i]): put_back(np.arange(len(back)) == i)
            for i in np.flatnonzero(back)[:ONE_BY_ONE]
        },
        left_out=_left_out(fitted, boundary),
    )
