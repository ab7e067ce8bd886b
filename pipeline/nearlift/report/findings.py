"""What a diagnosis says about its candidates: the ranking by evidence, stand-ins of a named effect,
and what few trials could have seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

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


def listed(words: Sequence[str], last: str = "and") -> str:
    """``a, b and c``."""
    return f" {last} ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def to_log(found: Mapping[str, Any]) -> list[str]:
    """What to record next time, once each."""
    return list(
        dict.fromkeys(
            word
            for u in found.get("untestable", [])
            for word in u.get("log_next_time") or u.get("needs") or []
        )
    )


def stand_ins(found: Mapping[str, Any], effect: Mapping[str, Any]) -> list[str]:
    """What this design cannot tell from a named effect: single effects in its place, then two where
    one was named, as "a + b".
    """
    rivals = [str(r) for r in effect.get("rivals", [])]
    explanations = found.get("explanations", [])
    together = [e for e in explanations if len(e) > len(found["effects"])]
    alone = {name for e in explanations if e not in together for name in e}
    return [r for r in rivals if r in alone or not together] + [" + ".join(e) for e in together]


def tried(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every candidate of every round: the named one, its rivals, then by evidence.

    `behind` is twice the log evidence by which it trails the best that was accepted (of all, if
    none was); `kind` is named, rival (among the explanations that the design cannot tell apart),
    worse (accepted, and beyond their reach) or rejected.
    """
    known: dict[str, dict[str, Any]] = {}
    for i, r in enumerate(found.get("rounds", [])):
        known |= {
            str(c["name"]): {**c, "round": i}
            for c in r.get("candidates", [])
            if c.get("log_evidence") is not None
        }
    accepted = [float(c["log_evidence"]) for c in known.values() if c.get("accepted")]
    best = max(accepted or [float(c["log_evidence"]) for c in known.values()], default=0.0)
    explanations = [{*e} for e in found.get("explanations", [])]
    refuted = [set(names) for names in found.get("not_confirmed", [])]
    listed = []
    for c in known.values():
        behind = 2 * (best - float(c["log_evidence"]))
        kind = "rejected"
        effects = {*str(c["name"]).split(" + ")}
        if effects in explanations:
            kind = "rival" if explanations.index(effects) else "named"
        elif c.get("accepted"):
            kind = "worse"
        if effects in refuted:
            kind, c = "rejected", {**c, "refuted": True}
        listed.append({**c, "behind": behind, "kind": kind})
    order = {"named": 0, "rival": 1}
    # where visits left out decide, a second effect that did not earn its place is no better for its
    # score
    return sorted(
        listed,
        key=lambda c: (
            order.get(c["kind"], 2),
            c["round"] if c.get("judged_by") else 0,
            c["behind"],
        ),
    )


def could_have_seen(found: Mapping[str, Any]) -> str:
    """What a diagnosis of few trials could have seen, and what not, in words; empty where trials
    are not few.
    """
    block = found.get("sensitivity")
    if not block:
        return ""
    seen = [str(row["text"]) for row in block["limits"] if row["size"] is not None]
    unseen = list(
        dict.fromkeys(str(row["effect"]) for row in block["limits"] if row["size"] is None)
    )
    if not seen:
        return "could have seen no effect at any size that is possible"
    words = (
        f"could have seen {', '.join(seen)} (each with a chance of {100 * block['chance']:.0f} %)"
    )
    return f"{words}; not, at any size that is possible, {', '.join(unseen)}" if unseen else words
