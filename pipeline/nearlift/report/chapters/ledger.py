"""Every trial from raw byte to figure, and what each exclusion is worth."""

from __future__ import annotations

import math

from nearlift.nomenclature import letter
from nearlift.products import QUALITY
from nearlift.reduction.quality import code
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, Place, pointer
from nearlift.results.quality import QualityLedger, TrialRecord
from nearlift.results.serial import decode
from nearlift.rounding import plain
from nearlift.run.lock import size

#: Trials that the page lists; all of them stand in quality.json.
MOST_ROWS = 5000


def facts(evidence: Evidence) -> dict[str, object]:
    """How much went in and came out at each step, the coefficient with exclusions put back, and a
    row for every trial.
    """
    ledger = decode(QualityLedger, evidence.document(QUALITY), QUALITY.file)
    bytes_read = Number(
        text=size(ledger.files.bytes),
        value=float(ledger.files.bytes),
        source=pointer(QUALITY, "files", "bytes"),
    )
    return {
        "bytes": bytes_read,
        "ledger": ledger,
        "root": Place(evidence, QUALITY),
        "most_rows": MOST_ROWS,
        "letter": letter,
        "code": code,
        "lift_mN": _lift_mN,
    }


def _lift_mN(trial: TrialRecord) -> str:
    return "\u2013" if math.isnan(trial.lift_N) else plain(1e3 * trial.lift_N, 5)
