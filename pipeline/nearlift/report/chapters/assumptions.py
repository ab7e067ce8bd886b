"""Assumptions behind Delta L: throttle, held quantity, rotor coefficient."""

from __future__ import annotations

from dataclasses import replace

from markupsafe import Markup

from nearlift.report import blocks
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, Place
from nearlift.report.tables import typeset
from nearlift.stages.fit import FIT

TESTS = {
    "coefficient": "one coefficient",
    "curve": "one curve",
    "cells": "same ΔL per cell, no model",
}


def facts(evidence: Evidence) -> Markup:
    """Results on each assumption, for the boundaries that have one."""
    collapse, held, rotor = (
        [p for b in evidence.boundaries if (p := Place(evidence, FIT, (question, b))).content]
        for question in ("throttle_collapse", "held_quantity", "rotor_coefficient")
    )
    return blocks.join(*_throttle(collapse), *(_held(held) if held else ()), *_rotor(rotor))


def chance(place: Place) -> Number:
    """A p-value; below a thousandth only that."""
    p = place.number("p_value", digits=2)
    return replace(p, text="< 0.001", how="below a thousandth") if p.value < 1e-3 else p


def _said(places: list[Place]) -> list[Markup]:
    """Sentence of each boundary."""
    return [
        blocks.paragraph(
            "{} {}", blocks.bold(f"{str(p.key).capitalize()}."), typeset(p.content["text"])
        )
        for p in places
    ]


def _throttle(places: list[Place]) -> list[Markup]:
    heads = (
        *("boundary", *(f"p, {t}" for t in TESTS.values())),
        *("coefficient, at most", "ΔL, at most"),
    )
    rows = [
        (
            str(p.key).capitalize(),
            *(chance(p.at("tests", t)) if p.content["tests"][t] else "–" for t in TESTS),
            _departure(p, "coefficient"),
            _departure(p, "delta_L"),
        )
        for p in places
    ]
    each = []
    for p in places:
        for t in p.every("per_throttle"):
            q = t.quote(name=p.content["coefficient"])
            value = Markup("{} = {}").format(q.symbol, q.estimate)
            apart = t.number("u_apart", digits=2)
            each.append((str(p.key).capitalize(), _percent(t), value, q.interval, apart))
    caption = "Coefficient of the base fit at each throttle"
    return [
        blocks.heading("Dependence on throttle"),
        blocks.table(
            "Test of equal relative lift at all throttles, and 95 % upper limits of the difference"
            " between two throttles",
            heads,
            rows,
        ),
        *_said(places),
        blocks.fold(
            caption,
            blocks.table(
                caption,
                (
                    *("boundary", "throttle", "coefficient", "90 %"),
                    "u of its difference from the mean",
                ),
                each,
                hidden=True,
            ),
        ),
    ]


def _departure(place: Place, of: str) -> Markup | str:
    most = place.content["largest_departure"][of]
    if not most or most["bound95"] is None:
        return "–"
    digits = 2 if most["bound95"] < 1 else 3
    number = place.percent("largest_departure", of, "bound95", digits=digits)
    return Markup("{} %").format(number)


def _percent(place: Place) -> str:
    return f"{100 * float(place.key):.4g} %"


def _held(places: list[Place]) -> list[Markup]:
    rows = []
    for h in places:
        for r in h.every("plausible"):
            u = r.content["u"]
            name, value = h.content["coefficient"], r.number("value", like_u=u)
            rows.append(
                (
                    str(h.key).capitalize(),
                    r.number("n", digits=2),
                    r.content["supposes"],
                    Markup("{} = {}").format(typeset(name), value),
                    r.ends(like_u=u),
                    chance(r),
                )
            )
    caption = "Coefficient of the base fit at each exponent"
    heads = (
        *("boundary", "exponent", "assumption", "coefficient", "90 %"),
        "p against the best exponent",
    )
    return [
        blocks.heading("Held quantity"),
        blocks.paragraph("{}", places[0].content["declared_text"]),
        *_said(places),
        blocks.fold(caption, blocks.table(caption, heads, rows, hidden=True)),
    ]


def _rotor(places: list[Place]) -> list[Markup]:
    parts = [blocks.heading("Lift coefficient of the rotor")]
    known = [r for r in places if r.every("per_throttle")]
    for r in known:
        rows = []
        for x in r.every("per_throttle"):
            q = x.quote()
            rows.append((_percent(x), x.number("speed_Hz"), q.estimate, q.interval))
        caption = f"{str(r.key).capitalize()}: lift coefficient of the rotor at each throttle"
        parts += _said([r])
        parts.append(
            blocks.table(caption, ("throttle", "speed, Hz", "C_L", "90 %"), rows, hidden=True)
        )
    if places and not known:
        parts.append(blocks.paragraph("{}", places[0].content["text"]))
    return parts
