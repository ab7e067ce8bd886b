"""What a diagnosis says about its candidates, ranked by evidence, and about what to log."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from nearlift.catalogue import titled
from nearlift.results.diagnosis import BoundaryDiagnosis, TriedCandidate

#: What the loop looks along, where its name is not the word for it.
ALONG = {
    "start": "time",
    "approach": "the direction of approach",
    "supply": "the supply voltage",
    "previous_lift_N": "the lift of the trial before",
    "previous_throttle": "the throttle of the trial before",
    "previous_distance": "the distance of the trial before",
    "order_in_visit": "the order within a visit",
}


def along(covariate: str) -> str:
    """A covariate in words."""
    return ALONG.get(covariate, covariate.replace("_", " "))


def structure_along(diagnosis: BoundaryDiagnosis) -> str:
    """The covariates along which structure is significant, the foremost two by name; the foremost
    where none is by itself.
    """
    shown = [s for s in diagnosis.structure if s.significant] or diagnosis.structure[:1]
    every = [along(s.covariate) for s in shown]
    return listed(every if len(every) < 3 else [*every[:2], "others"])


def coverage(coefficient: str) -> str:
    """What follows ±, where the coefficient may itself be called k."""
    return "one standard uncertainty" if coefficient == "k" else "k = 1"


def listed(words: Sequence[str], last: str = "and") -> str:
    """``a, b and c``."""
    return f" {last} ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def to_log(diagnosis: BoundaryDiagnosis | None) -> list[str]:
    """What to record next time, once each."""
    every = diagnosis.untestable.values() if diagnosis else ()
    return list(dict.fromkeys(word for words in every for word in words))


def others(diagnosis: BoundaryDiagnosis | None, last: str = "or") -> str:
    """What this design cannot tell from the named effects, by title; empty where there is none."""
    rivals = [r for e in diagnosis.effects for r in diagnosis.stand_ins(e)] if diagnosis else []
    return listed([*dict.fromkeys(titled(r.replace(" + ", " with ")) for r in rivals)], last)


@dataclass(frozen=True, slots=True, kw_only=True)
class RankedCandidate:
    """A candidate that was tried, beside the others.

    Attributes
    ----------
    tried : TriedCandidate
    place : (int, int)
        Its round, and where it stands there.
    behind : float
        Twice the log evidence by which it trails the best that was accepted (of all, if none was).
    kind : str
        ``named``, ``rival`` (among the explanations that the design cannot tell apart), ``worse``
        (accepted, and beyond their reach) or ``rejected``.
    refuted : bool
        Visits left out gain nothing from it.
    """

    tried: TriedCandidate
    place: tuple[int, int]
    behind: float
    kind: str
    refuted: bool


def ranked(diagnosis: BoundaryDiagnosis) -> list[RankedCandidate]:
    """Every candidate of every round, as it was tried last: the named one, its rivals, then by
    evidence.
    """
    known = {
        c.name: (c, (i, j))
        for i, r in enumerate(diagnosis.rounds)
        for j, c in enumerate(r.candidates)
        if math.isfinite(c.log_evidence)
    }
    every = [c.log_evidence for c, _ in known.values()]
    best = max([c.log_evidence for c, _ in known.values() if c.accepted] or every, default=0.0)
    explanations = [{*e} for e in diagnosis.explanations or ()]
    refuted = [{*names} for names in diagnosis.not_confirmed or ()]
    listed = []
    for c, place in known.values():
        kind = "worse" if c.accepted else "rejected"
        effects = {*c.name.split(" + ")}
        if effects in refuted:
            kind = "rejected"
        elif effects in explanations:
            kind = "rival" if explanations.index(effects) else "named"
        listed.append(
            RankedCandidate(
                tried=c,
                place=place,
                behind=2 * (best - c.log_evidence),
                kind=kind,
                refuted=effects in refuted,
            )
        )
    order = {"named": 0, "rival": 1}
    # where visits left out decide, a second effect that did not earn its place is no better for its
    # score
    return sorted(
        listed,
        key=lambda c: (order.get(c.kind, 2), c.place[0] if c.tried.judged_by else 0, c.behind),
    )
