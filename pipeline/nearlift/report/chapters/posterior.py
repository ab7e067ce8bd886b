"""What is believed after the data: each model's posterior, how it was sampled, and what it does not
say.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Boundary
from nearlift.products import FIT
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place
from nearlift.rounding import plain


def facts(evidence: Evidence) -> dict[str, object]:
    """A table and its words for each boundary."""
    return {"tables": [_table(evidence, b) for b in evidence.boundaries]}


def _table(evidence: Evidence, boundary: Boundary) -> dict[str, object]:
    content = evidence.document(FIT)
    base, fits = content["base"][boundary], content["boundaries"][boundary]
    sampled = [m for m in sorted(fits, key=lambda m: m != base) if fits[m].get("posterior")]
    rows = [
        _row(evidence, boundary, m, p, m == base)
        for m in sampled
        for p in fits[m]["posterior"]["parameters"]
    ]
    words = [
        (fits[m]["title"], p["words"])
        for m in sampled
        for p in fits[m]["posterior"]["parameters"].values()
        if p["words"]
    ]
    return {
        "boundary": boundary,
        "rows": rows,
        "words": words,
        "how": how(fits[base].get("posterior") or {}),
        "base": fits[base]["title"],
        "chains": any(r["r_hat"] for r in rows),
    }


def _row(
    evidence: Evidence, boundary: str, model: str, parameter: str, base: bool
) -> dict[str, object]:
    place = Place(evidence, FIT, ("boundaries", boundary, model))
    entry = evidence.document(FIT)["boundaries"][boundary][model]
    after = place.at("posterior", "parameters", parameter)
    return {
        "model": entry["title"],
        "base": base,
        "of": after.quote(),
        "prior": entry["posterior"]["parameters"][parameter]["prior"]["text"],
        "prior_low": after.number("prior", "lo90", digits=3),
        "prior_high": after.number("prior", "hi90", digits=3),
        "ratio": after.percent("width_ratio", digits=2),
        "ess": after.number("ess", places=0),
        "r_hat": (
            after.number("r_hat", places=3) if entry["posterior"]["sampler"] == "emcee" else None
        ),
    }


def how(entry: dict[str, Any]) -> str:
    """How a posterior was sampled and what its judges said, in words."""
    if not entry:
        return "it has no posterior"
    if entry["sampler"] == "none":
        return "it has no free parameter, and nothing had to be sampled"
    n = entry["chains"] * entry["draws"]
    if entry["sampler"] == "emcee":
        told = (
            f"emcee took {entry['steps']} steps of {entry['chains']} walkers (differential"
            f" evolution and snooker moves, {100 * entry['acceptance']:.0f} % accepted, τ ="
            f" {plain(entry['tau'], 3)}); {n} draws are kept, worth {entry['ess']:.0f} independent"
            " ones"
        )
    else:
        told = (
            f"{n} independent draws by importance sampling from the peak (Pareto k ="
            f" {plain(entry['pareto_k'], 2)}; below 0.7 it can be used)"
        )
    judged = [
        f"the {c['by']} agrees, within {plain(c['apart'], 2)} Monte Carlo standard errors"
        for c in entry["checks"]
        if not c["unfit"]
    ]
    unfit = [f"the {c['by']} could not judge ({c['unfit']})" for c in entry["checks"] if c["unfit"]]
    return "; ".join([told, *judged, *unfit])
