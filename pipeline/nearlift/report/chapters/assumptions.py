"""Assumptions behind Delta L: throttle, held quantity, rotor coefficient."""

from __future__ import annotations

from markupsafe import Markup

from nearlift.report import blocks
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place
from nearlift.stages.fit import FIT


def facts(evidence: Evidence) -> Markup:
    """Results on each assumption, for the boundaries that have one."""
    collapse, held, rotor = (
        [p for b in evidence.boundaries if (p := Place(evidence, FIT, (question, b))).content]
        for question in ("throttle_collapse", "held_quantity", "rotor_coefficient")
    )
    throttles = [(p, t) for p in collapse for t in p.every("per_throttle")]
    exponents = [(h, r) for h in held for r in h.every("plausible")]
    return blocks.join(
        blocks.heading("Dependence on throttle"),
        blocks.table(
            "Test of one curve for all throttles, and the 95 % upper limit of the difference of"
            " ΔL between two throttles",
            ("boundary", "p", "difference, %"),
            [
                (
                    p.title,
                    p.chance("test", "p_value") if p.content["test"] else "–",
                    p.percent("largest_departure", "bound95", digits=2),
                )
                for p in collapse
            ],
        ),
        blocks.items(p.text("text") for p in collapse),
        _folded(
            "Scale of the base fit's log ratio at each throttle",
            ("boundary", "throttle", "scale", "90 %"),
            [
                (p.title, _percent(t), q.estimate, q.interval)
                for p, t in throttles
                for q in [t.quote()]
            ],
        ),
        blocks.heading("Held quantity") if held else "",
        blocks.items(h.text("text") for h in held),
        _folded(
            "Coefficient of the base fit at each exponent",
            ("boundary", "exponent", "assumption", "value", "90 %"),
            [
                (
                    h.title,
                    r.number("n", digits=2),
                    r.content["supposes"],
                    r.number("value", like_u=r.content["u"]),
                    r.ends(like_u=r.content["u"]),
                )
                for h, r in exponents
            ],
        ),
        blocks.heading("Lift coefficient of the rotor") if rotor else "",
        blocks.items(dict.fromkeys(r.content["text"] for r in rotor)),
        _folded(
            "Lift coefficient of the rotor at each throttle",
            ("boundary", "throttle", "speed, Hz", "C_L", "90 %"),
            [
                (r.title, _percent(x), x.number("speed_Hz"), q.estimate, q.interval)
                for r in rotor
                for x in r.every("per_throttle")
                for q in [x.quote()]
            ],
        ),
    )


def _folded(caption: str, heads: tuple[str, ...], rows: list[tuple[object, ...]]) -> Markup:
    return blocks.fold(caption, blocks.table(caption, heads, rows, hidden=True))


def _percent(place: Place) -> str:
    return f"{100 * float(place.path[-1]):.4g} %"
