"""Every trial from raw byte to figure, and what each exclusion is worth."""

from __future__ import annotations

import math

from nearlift.declare import Boundary
from nearlift.products import QUALITY
from nearlift.reduction.quality import code
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, Place, pointer
from nearlift.results.quality import (
    Exclusions,
    HeadlineWithout,
    NotPutBack,
    PutBack,
    QualityLedger,
    TrialRecord,
)
from nearlift.results.serial import decode, encode
from nearlift.rounding import plain
from nearlift.run.lock import size

#: Trials that the page lists; all of them stand in quality.json.
MOST_ROWS = 5000
NAMES = {"none": "free air"}


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
        "files": _whole(evidence, "files", "number"),
        "read": _whole(evidence, "samples", "read") if ledger.samples.read is not None else None,
        "averaged": _whole(evidence, "samples", "averaged"),
        "counts": {name: _whole(evidence, "counts", name) for name in encode(ledger.counts)},
        "back": [_back(evidence, boundary, entry) for boundary, entry in ledger.put_back.items()],
        "trials": [_row(trial) for trial in ledger.trials[:MOST_ROWS]],
        "further": max(len(ledger.trials) - MOST_ROWS, 0),
    }


def _whole(evidence: Evidence, *place: str) -> Number:
    return Place(evidence, QUALITY, place).number(places=0)


def _back(evidence: Evidence, boundary: Boundary, entry: Exclusions) -> dict[str, object]:
    """One boundary's table: by how much the base fit's coefficient changes with exclusions put
    back.
    """
    place = Place(evidence, QUALITY, ("put_back", boundary))
    rows = [_change("all that can be", entry.all, place.at("all"))] if entry.all else []
    rows += [
        _change(name, outcome, place.at("codes", name), code(name).meaning)
        for name, outcome in entry.codes.items()
    ]
    rows += [
        _change(f"{without.what} left out", without, place.at("left_out", i))
        for i, without in enumerate(entry.left_out)
    ]
    single = [
        _change(name, outcome, place.at("trials", name)) for name, outcome in entry.trials.items()
    ]
    head, _, sub = entry.parameter.partition("_")
    return {
        "boundary": boundary,
        "excluded": place.number("excluded", places=0),
        "head": {"alpha": "\u03b1", "lambda": "\u03bb"}.get(head, head),
        "sub": sub,
        "rows": rows,
        "single": single,
        "never": list(entry.cannot_be_put_back.items()),
    }


def _change(
    what: str, outcome: PutBack | NotPutBack | HeadlineWithout, place: Place, meaning: str = ""
) -> dict[str, object]:
    """One line: what is put back or left out, with the `meaning` of a quality code."""
    line = {
        "what": what,
        "code": bool(meaning),
        "meaning": meaning,
        "trials": place.number("trials", places=0),
    }
    if not isinstance(outcome, PutBack) and outcome.value is None:
        return line | {"why_not": outcome.why_not}
    return line | {**place.numbers("change", "change_in_u", digits=2), "why_not": ""}


def _row(trial: TrialRecord) -> dict[str, object]:
    """One trial as printed."""
    return {
        "trial": trial.trial,
        "boundary": NAMES.get(trial.boundary, trial.boundary),
        "source": trial.source,
        "sha": trial.sha256[:8],
        "completeness": trial.completeness,
        "samples": trial.samples,
        "averaged": trial.averaged,
        "lift": "\u2013" if math.isnan(trial.lift_N) else plain(1e3 * trial.lift_N, 5),
        "codes": " ".join(trial.codes),
        "figures": ", ".join(
            {"fig2": "Figure 2", "residuals": "residuals"}[name] for name in trial.figures
        )
        or "none",
    }
