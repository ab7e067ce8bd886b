"""Candidates of a diagnosis, ranked by evidence."""

from __future__ import annotations

import math
from dataclasses import dataclass

from nearlift.results.diagnosis import BoundaryDiagnosis, TriedCandidate


@dataclass(frozen=True, slots=True, kw_only=True)
class RankedCandidate:
    """A candidate that was tried, and its rank.

    Attributes
    ----------
    tried : TriedCandidate
    place : (int, int)
        Its round, and its index there.
    behind : float
        Twice the log evidence by which it trails the best that was accepted (of all, if none was).
    kind : str
        ``named``, ``rival`` (among the accepted explanations), ``worse``
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
    """Every candidate of every round, as it was tried last: the identified one, its rivals, then by
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
