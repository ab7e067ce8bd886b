"""Facts of a campaign's page, from its products as they are at the moment."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import pandas as pd

from nearlift.errors import NearliftError
from nearlift.reduction import quality
from nearlift.report import phrases
from nearlift.report.phrases import coefficient_text
from nearlift.results.diagnosis import NOTHING, BoundaryDiagnosis
from nearlift.results.quotation import Results
from nearlift.rounding import plus_minus
from nearlift.run import tables
from nearlift.run.watch import LATEST
from nearlift.serve.workspace import CampaignFolder
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import RESULTS
from nearlift.stages.ingest import TRIALS

#: Trials listed, and trials with quality codes listed.
NEWEST, REMARKED = 40, 12
TONES = {"adequate": "good", "effect": "fair", "unexplained": "bad", "not_diagnosed": "none"}
NAMES = {"ground": "Ground", "ceiling": "Ceiling", "sidewall": "Sidewall", "none": "Free air"}
#: Figures of the report that the page shows, with headings.
FIGURES = {"fig2": "Lift near the boundary", "residuals": "Residuals by covariate"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Card of one boundary. `notes`: effects not distinguished from those named, the interim
    analysis while trials are missing, and the trial or visit that the answer depends on.
    """

    boundary: str
    coefficients: tuple[str, ...]
    claim: str
    tone: str
    notes: tuple[str, ...]


def verdicts(place: CampaignFolder) -> list[Verdict]:
    """Cards of all boundaries; none before the first fit.

    Raises
    ------
    ProductError
        results.json is damaged.
    """
    if _status(place.processed / RESULTS.file) is None:
        return []
    quoted = tables.load(place.processed / RESULTS.file, Results).boundaries
    diagnosed = tables.load_if_whole(place.processed / DIAGNOSIS.file, NOTHING).boundaries
    cards = []
    for boundary, result in quoted.items():
        diagnosis = diagnosed.get(boundary)
        look = diagnosis.look if isinstance(diagnosis, BoundaryDiagnosis) else None
        interim = look.text if look else ""
        rivals = ", ".join(result.rivals) if phrases.is_sure(result) else ""
        apart = f"not distinguished from {rivals}" if rivals else ""
        cards.append(
            Verdict(
                boundary=NAMES[boundary],
                coefficients=tuple(
                    coefficient_text(c, name) for name, c in result.coefficients.items()
                ),
                claim=phrases.claim(result, diagnosis),
                tone=TONES[result.verdict],
                notes=tuple(
                    filter(
                        None,
                        (
                            apart,
                            interim,
                            phrases.dependence(result),
                        ),
                    )
                ),
            )
        )
    return cards


def verdicts_or_refusal(place: CampaignFolder) -> tuple[list[Verdict], NearliftError | None]:
    """Cards, or none and the reason."""
    try:
        return verdicts(place), None
    except NearliftError as refusal:
        return [], refusal


def facts(place: CampaignFolder) -> dict[str, Any]:
    """Facts of the page."""
    state = stamp(place)
    cards, refusal = verdicts_or_refusal(place)
    trials = pd.DataFrame(tables.read_table(place.processed / TRIALS.file, TRIALS))
    landed = trials[~trials["quality"].str.contains("MISSING")].iloc[::-1]
    newest = landed.head(NEWEST)
    lifts = [
        "" if pd.isna(lift) else plus_minus(1e3 * lift, 1e3 * u)
        for lift, u in zip(newest["lift_N"], newest["u_lift_N"], strict=True)
    ]
    remarked = landed[landed["quality"] != ""].head(REMARKED)
    return {
        "stamp": state,
        "verdicts": cards,
        "refusal": refusal,
        "landed": len(landed),
        "scheduled": len(trials),
        "newest": newest.assign(lift=lifts, name=newest["boundary"].map(NAMES)).to_dict("records"),
        "remarks": [
            (trial, _meaning(str(codes)))
            for trial, codes in zip(remarked["trial"], remarked["quality"], strict=True)
        ],
        "figures": {n: t for n, t in FIGURES.items() if _status(place.reports / f"{n}.png")},
        "watch": _watch(place),
        "report": _status(place.reports / "index.html") is not None,
    }


def stamp(place: CampaignFolder) -> str:
    """Digest that changes when a product that the page shows does."""
    files = [
        *(place.processed / name for name in (TRIALS.file, RESULTS.file, DIAGNOSIS.file, LATEST)),
        *(place.reports / name for name in (*(f"{n}.png" for n in FIGURES), "index.html")),
    ]
    states = [(s.st_size, s.st_mtime_ns) if (s := _status(path)) else None for path in files]
    return hashlib.sha256(repr(states).encode()).hexdigest()[:16]


def _watch(place: CampaignFolder) -> dict[str, object] | None:
    """Last round of `nearlift run --watch`, unless a later run replaced the results."""
    latest, results = (_status(place.processed / name) for name in (LATEST, RESULTS.file))
    if latest is None or (results and results.st_mtime_ns > latest.st_mtime_ns):
        return None
    content = tables.read_json_if_whole(place.processed / LATEST)
    return {"time": datetime.fromtimestamp(latest.st_mtime), **content} if content else None


def _meaning(codes: str) -> str:
    return "; ".join(f"{name}: {quality.CODES[name]}" for name in codes.split())


def _status(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except OSError:
        return None
