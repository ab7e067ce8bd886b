"""ledger: every trial from raw byte to figure, and what each exclusion is worth, to quality.json.

What it is worth is found by putting the excluded trials back and fitting the base model again, with
the noise of the accepted ones: all of them, those of each quality code, and, for the first few, one
at a time. What a trial named by the fit is worth is a fit without it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary
from nearlift.errors import NotConverged
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget
from nearlift.products import FIT, QUALITY, TRIALS
from nearlift.reduction.quality import CODES, reason, rejected
from nearlift.run.job import Job, Outcome
from nearlift.run.store import Table
from nearlift.stages.fit import choice
from nearlift.stages.observe import boundaries, observe

#: Excluded trials of one boundary that are put back one at a time.
ONE_BY_ONE = 40


def run(job: Job) -> Outcome:
    """Write quality.json."""
    trials = job.read(TRIALS)
    fitted = job.read_json(FIT)
    out = rejected(trials["quality"])
    beyond = {
        (b, e["trial"]): e["reason"]
        for b, models in fitted["boundaries"].items()
        for e in models[fitted["base"][b]].get("excluded", ())
    }
    # a model without a free coefficient has no headline that a trial could move
    asked = [b for b in boundaries(trials) if choice(job.campaign, b)[0].parameters]
    entries = [_entry(trials, i, bool(out[i]), beyond) for i in range(len(out))]
    words = [set(text.split()) for text in trials["quality"]]
    codes = {
        c.name: {"trials": n, "rejects": c.rejects, "meaning": c.meaning}
        for c in CODES
        if (n := sum(c.name in w for w in words))
    }
    files = sorted({str(s) for s in trials["source"] if s}) if "source" in trials else []
    sizes = [path.stat().st_size for name in files if (path := job.root / name).is_file()]
    job.write_json(
        QUALITY,
        {
            "schema": QUALITY.schema,
            "files": {"number": len(files), "bytes": sum(sizes)},
            "samples": {
                "read": int(trials["samples"].sum()) if "samples" in trials else None,
                "averaged": int(trials["n"].sum()),
            },
            "counts": {
                "scheduled": len(entries),
                "recorded": sum(e["completeness"] != "missing" for e in entries),
                "accepted": int((~out).sum()),
                "remarked": sum(bool(e["codes"]) and e["accepted"] for e in entries),
                "fitted": sum(e["fitted"] for e in entries),
            },
            "codes": codes,
            "trials": entries,
            "put_back": {
                b: _put_back(job, trials, b, out) | {"left_out": _left_out(fitted, b)}
                for b in asked
            },
        },
    )
    return Outcome()


def _entry(trials: Table, i: int, out: bool, beyond: dict[tuple[str, str], str]) -> dict[str, Any]:
    """What became of one trial."""
    name, boundary, text = (
        str(trials["trial"][i]),
        str(trials["boundary"][i]),
        str(trials["quality"][i]),
    )
    outside = beyond.get((boundary, name), "")
    return {
        "trial": name,
        "boundary": boundary,
        "source": str(trials["source"][i]) if "source" in trials else "",
        "sha256": str(trials["source_sha256"][i]),
        "completeness": str(trials["completeness"][i]) if "completeness" in trials else "",
        "samples": int(trials["samples"][i]) if "samples" in trials else int(trials["n"][i]),
        "averaged": int(trials["n"][i]),
        "lift_N": float(trials["lift_N"][i]),
        "u_lift_N": float(trials["u_lift_N"][i]),
        "codes": text.split(),
        "accepted": not out,
        "fitted": not out and not outside,
        # every accepted trial stands in a mean of Figure 2, but only what the model speaks about
        # has a residual
        "figures": [] if out else ["fig2"] if outside else ["fig2", "residuals"],
        "why": reason(text, str(trials["fault"][i]) if "fault" in trials else "") or outside,
    }


def _left_out(fitted: dict[str, Any], boundary: Boundary) -> list[dict[str, Any]]:
    """The headline coefficient without each trial or visit that the fit named, all of which are in
    it.
    """
    base = fitted["boundaries"][boundary][fitted["base"][boundary]]
    u = next((e["u"] for e in base["parameters"].values()), None)
    return [
        {
            "what": s["id"] if s["kind"] == "trial" else f"visit {s['id']}",
            "trials": len(s["trials"]),
            "why_not": s["text"],
        }
        | {"value": s["without"] and s["without"]["value"], "u": s["without"] and s["without"]["u"]}
        | {"change": s["shift"], "change_in_u": s["shift"] / u if u and s["without"] else None}
        for s in fitted["influence"][boundary]["suspects"]
    ]


def _put_back(
    job: Job, trials: Table, boundary: Boundary, out: NDArray[np.bool_]
) -> dict[str, Any]:
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

    def with_these(chosen: NDArray[np.bool_]) -> dict[str, Any]:
        """The coefficient with these trials among the others."""
        quality = trials["quality"].copy()
        quality[chosen] = ""
        try:
            after = fit(
                model,
                observe({**trials, "quality": quality}, job.campaign, boundary),
                parts,
                accepted.noise,
            ).estimates[name]
        except NotConverged as fault:
            return {"trials": int(chosen.sum()), "value": None, "why_not": fault.what}
        return {
            "trials": int(chosen.sum()),
            "value": after.value,
            "u": after.u,
            "change": after.value - before.value,
            "change_in_u": (after.value - before.value) / before.u
            if before.u and math.isfinite(before.u)
            else None,
        }

    back = able & within
    found: dict[str, Any] = {
        "model": model.name,
        "parameter": name,
        "accepted": {"value": before.value, "u": before.u, "trials": accepted.n},
        "excluded": int(mine.sum()),
        "cannot_be_put_back": {
            str(trials["trial"][i]): "it has no mean lift"
            if not able[i]
            else f"the model has no value at z_hat = {trials['z_hat'][i]:.4g}"
            for i in np.flatnonzero(mine & ~back)
        },
        "all": None,
        "codes": {},
        "trials": {},
    }
    if not back.any():
        return found
    job.say(f"ledger {boundary}: {int(back.sum())} trials put back")
    found["all"] = with_these(back)
    for code in CODES:
        chosen = back & np.array([code.name in text.split() for text in trials["quality"]])
        if code.rejects and chosen.any():
            found["codes"][code.name] = with_these(chosen)
    for i in np.flatnonzero(back)[:ONE_BY_ONE]:
        found["trials"][str(trials["trial"][i])] = with_these(np.arange(len(back)) == i)
    return found
