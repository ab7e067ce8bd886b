"""Chapters on trials: rejections, the trial table with influence, and provenance."""

from __future__ import annotations

import math
import shlex

import numpy as np

from nearlift.declare import BOUNDARIES, Boundary
from nearlift.nomenclature import letter
from nearlift.reduction.quality import CODES, code, reason, rejected
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, count, pointer
from nearlift.report.trial_table import Refit, TrialRow
from nearlift.rounding import bytes_text, plain
from nearlift.stages.fit import FIT
from nearlift.stages.ingest import TRIALS
from nearlift.version import __version__

NAMES = {"none": "free air"}
#: Trials that the page lists; all of them are in trials.parquet.
MOST_ROWS = 5000


def quality(evidence: Evidence) -> dict[str, object]:
    """Counts per boundary and per quality code, and every rejected trial with its reason."""
    trials = evidence.table(TRIALS)
    out = rejected(trials["quality"])
    noted = np.array([bool(q) for q in trials["quality"]])
    kinds = {
        "scheduled": (np.ones_like(out), ""),
        "accepted": (~out, " and no code in capitals in `quality`"),
        "rejected": (out, " and a code in capitals in `quality`"),
        "noted": (~out & noted, " and only lower-case codes in `quality`"),
    }
    counts: list[dict[str, object]] = []
    for boundary in (*BOUNDARIES, "none"):
        mine = trials["boundary"] == boundary
        if not mine.any():
            continue
        numbers = {
            kind: count(TRIALS, int((mine & rows).sum()), f"rows with boundary {boundary}{which}")
            for kind, (rows, which) in kinds.items()
        }
        counts.append({"boundary": NAMES.get(boundary, boundary), **numbers})
    words = [set(q.split()) for q in trials["quality"]]
    return {
        "counts": counts,
        "codes": [
            (c, count(TRIALS, n, f"rows with {c.name} in `quality`"))
            for c in CODES
            if (n := sum(c.name in w for w in words))
        ],
        "rejected": [
            {
                "trial": str(trials["trial"][i]),
                "boundary": NAMES.get(str(trials["boundary"][i]), str(trials["boundary"][i])),
                "z_hat": plain(float(trials["z_hat"][i]), 4),
                "throttle": f"{100 * float(trials['throttle'][i]):.4g} %",
                "reason": reason(
                    str(trials["quality"][i]), str(trials["fault"][i]) if "fault" in trials else ""
                ),
            }
            for i in np.flatnonzero(out)
        ],
        "bases": {b: evidence.base(b) for b in evidence.boundaries},
    }


def trial_table(evidence: Evidence) -> dict[str, object]:
    """Numbers of files, samples and trials at each step; influence of exclusions; a row a trial."""
    assert evidence.trial_table is not None
    table = evidence.trial_table()
    numbers = {
        "files": count(TRIALS, table.files, "different `source`"),
        "bytes": Number(
            text=bytes_text(table.bytes),
            value=float(table.bytes),
            source=TRIALS.file,
            how="bytes of the files in `source`",
        ),
        "samples": None
        if table.samples is None
        else count(TRIALS, table.samples, "sum of `samples`"),
        "averaged": count(TRIALS, table.averaged, "sum of `n`"),
        "scheduled": count(TRIALS, table.counts.scheduled, "rows"),
        "recorded": count(TRIALS, table.counts.recorded, "rows not `missing`"),
        "accepted": count(TRIALS, table.counts.accepted, "rows without a code in capitals"),
        "remarked": count(TRIALS, table.counts.remarked, "rows with only lower-case codes"),
        "fitted": count(TRIALS, table.counts.fitted, "accepted rows within the model's range"),
    }

    def changes(boundary: Boundary, refit: Refit) -> tuple[Number, ...]:
        """The change of the headline coefficient, in its unit and in standard uncertainties."""
        entry = table.put_back[boundary]
        where = ("boundaries", boundary, entry.model, "parameters", entry.parameter)
        return tuple(
            Number(
                text=plain(value, 2) if math.isfinite(value) else "\u2013",
                value=value,
                source=pointer(FIT, *where, key),
                how=how,
            )
            for value, key, how in (
                (refit.change, "value", "over this: value of a fit of the other choice of trials"),
                (refit.change_in_u, "u", "over this: change of the value"),
            )
        )

    return {
        "table": table,
        "counts": numbers,
        "changes": changes,
        "most_rows": MOST_ROWS,
        "letter": letter,
        "code": code,
        "lift_mN": _lift_mN,
    }


def _lift_mN(trial: TrialRow) -> str:
    return "\u2013" if math.isnan(trial.lift_N) else plain(1e3 * trial.lift_N, 5)


def provenance(evidence: Evidence) -> dict[str, object]:
    """Digests, versions, and the command that makes this again; nothing that changes from one run
    to the next.
    """
    seed = f" --seed {evidence.seed}" if evidence.seed else ""
    return {
        "command": f"nearlift run {shlex.quote(evidence.campaign.name)}{seed}",
        "nearlift": __version__,
        "evidence": evidence,
    }
