"""ledger: every trial from raw byte to figure, and what each exclusion is worth, to quality.json.

What it is worth is found by putting the excluded trials back and fitting the base model again, with
the noise of the accepted ones: all of them, those of each quality code, and, for the first few, one
at a time. What a trial named by the fit is worth is a fit without it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary
from nearlift.errors import NotConverged
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget
from nearlift.products import TRIALS
from nearlift.reduction.quality import CODES, reason, rejected
from nearlift.results import quality
from nearlift.results.fit import FitResults
from nearlift.run.job import Job, Outcome
from nearlift.run.store import Table
from nearlift.stages.fit import choice
from nearlift.stages.observe import boundaries, observe

#: Excluded trials of one boundary that are put back one at a time.
ONE_BY_ONE = 40


def run(job: Job) -> Outcome:
    """Write quality.json."""
    trials, fitted = job.read(TRIALS), job.load(FitResults)
    out = rejected(trials["quality"])
    beyond = {
        (str(boundary), e.trial): e.reason
        for boundary in fitted.boundaries
        for e in fitted.of_base(boundary).excluded
    }
    entries = tuple(_entry(trials, i, bool(out[i]), beyond) for i in range(len(out)))
    words = [set(text.split()) for text in trials["quality"]]
    codes = {
        c.name: quality.CodeCount(trials=n, rejects=c.rejects, meaning=c.meaning)
        for c in CODES
        if (n := sum(c.name in w for w in words))
    }
    files = sorted({str(s) for s in trials["source"] if s}) if "source" in trials else []
    sizes = [path.stat().st_size for name in files if (path := job.root / name).is_file()]
    job.save(
        quality.QualityLedger(
            files=quality.SourceFiles(number=len(files), bytes=sum(sizes)),
            samples=quality.SampleCounts(
                read=int(trials["samples"].sum()) if "samples" in trials else None,
                averaged=int(trials["n"].sum()),
            ),
            counts=quality.TrialCounts(
                scheduled=len(entries),
                recorded=sum(e.completeness != "missing" for e in entries),
                accepted=int((~out).sum()),
                remarked=sum(bool(e.codes) and e.accepted for e in entries),
                fitted=sum(e.fitted for e in entries),
            ),
            codes=codes,
            trials=entries,
            # a model without a free coefficient has no headline that a trial could move
            put_back={
                b: _exclusions(job, trials, b, out, fitted)
                for b in boundaries(trials)
                if choice(job.campaign, b)[0].parameters
            },
        )
    )
    return Outcome()


def _entry(
    trials: Table, i: int, out: bool, beyond: dict[tuple[str, str], str]
) -> quality.TrialRecord:
    """What became of one trial."""

    def text(column: str) -> str:
        return str(trials[column][i]) if column in trials else ""

    outside = beyond.get((text("boundary"), text("trial")), "")
    return quality.TrialRecord(
        trial=text("trial"),
        boundary=text("boundary"),
        source=text("source"),
        sha256=text("source_sha256"),
        completeness=text("completeness"),
        samples=int(trials["samples" if "samples" in trials else "n"][i]),
        averaged=int(trials["n"][i]),
        lift_N=float(trials["lift_N"][i]),
        u_lift_N=float(trials["u_lift_N"][i]),
        codes=tuple(text("quality").split()),
        accepted=not out,
        fitted=not out and not outside,
        # every accepted trial stands in a mean of Figure 2, but only what the model speaks about
        # has a residual
        figures=() if out else ("fig2",) if outside else ("fig2", "residuals"),
        why=reason(text("quality"), text("fault")) or outside,
    )


def _left_out(fitted: FitResults, boundary: Boundary) -> tuple[quality.HeadlineWithout, ...]:
    """The headline coefficient without each trial or visit that the fit named, and kept."""
    u = next((e.u for e in fitted.of_base(boundary).parameters.values()), math.inf)
    return tuple(
        quality.HeadlineWithout(
            what=s.id if s.kind == "trial" else f"visit {s.id}",
            trials=len(s.trials),
            why_not=s.text,
            value=s.without.value if s.without else None,
            u=s.without.u if s.without else None,
            change=s.shift,
            change_in_u=s.shift / u if 0 < u < math.inf and s.without else None,
        )
        for s in fitted.influence[boundary].suspects
    )


def _exclusions(
    job: Job, trials: Table, boundary: Boundary, out: NDArray[np.bool_], fitted: FitResults
) -> quality.Exclusions:
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

    def put_back(chosen: NDArray[np.bool_]) -> quality.PutBack | quality.NotPutBack:
        """The coefficient with these trials among the others."""
        codes = np.where(chosen, "", trials["quality"])
        data = observe({**trials, "quality": codes}, job.campaign, boundary)
        n = int(chosen.sum())
        try:
            after = fit(model, data, parts, accepted.noise).estimates[name]
        except NotConverged as fault:
            return quality.NotPutBack(trials=n, why_not=fault.what)
        change = after.value - before.value
        return quality.PutBack(
            trials=n,
            value=after.value,
            u=after.u,
            change=change,
            change_in_u=change / before.u if 0 < before.u < math.inf else None,
        )

    back = able & within
    if back.any():
        job.say(f"ledger {boundary}: {int(back.sum())} trials put back")
    with_code = {
        code.name: back & np.array([code.name in text.split() for text in trials["quality"]])
        for code in CODES
        if code.rejects
    }
    return quality.Exclusions(
        model=model.name,
        parameter=name,
        accepted=quality.HeadlineOf(value=before.value, u=before.u, trials=accepted.problem.data.n),
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
