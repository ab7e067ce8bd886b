"""What became of every trial, from raw byte to figure, and what made this page."""

from __future__ import annotations

import math
import shlex

import numpy as np

import nearlift
from nearlift.declare import BOUNDARIES
from nearlift.nomenclature import letter
from nearlift.products import QUALITY, TRIALS
from nearlift.reduction.quality import CODES, code, reason, rejected
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, Place, count, pointer
from nearlift.results.quality import QualityLedger, TrialRecord
from nearlift.results.serial import decode
from nearlift.rounding import plain
from nearlift.run.lock import size

NAMES = {"none": "free air"}
#: Trials that the page lists; all of them stand in quality.json.
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


def ledger(evidence: Evidence) -> dict[str, object]:
    """How much went in and came out at each step, the coefficient with exclusions put back, and a
    row for every trial.
    """
    whole = decode(QualityLedger, evidence.document(QUALITY), QUALITY.file)
    bytes_read = Number(
        text=size(whole.files.bytes),
        value=float(whole.files.bytes),
        source=pointer(QUALITY, "files", "bytes"),
    )
    return {
        "bytes": bytes_read,
        "ledger": whole,
        "root": Place(evidence, QUALITY),
        "most_rows": MOST_ROWS,
        "letter": letter,
        "code": code,
        "lift_mN": _lift_mN,
    }


def _lift_mN(trial: TrialRecord) -> str:
    return "\u2013" if math.isnan(trial.lift_N) else plain(1e3 * trial.lift_N, 5)


def provenance(evidence: Evidence) -> dict[str, object]:
    """Digests, versions, and the command that makes this again; nothing that changes from one run
    to the next.
    """
    seed = f" --seed {evidence.seed}" if evidence.seed else ""
    return {
        "command": f"nearlift run {shlex.quote(evidence.campaign.name)}{seed}",
        "nearlift": nearlift.__version__,
        "evidence": evidence,
    }
