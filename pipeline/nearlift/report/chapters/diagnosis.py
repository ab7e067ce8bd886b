"""Findings of the closed loop, a section for each boundary."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from markupsafe import Markup

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import BOUNDARIES
from nearlift.report import blocks, sources, words
from nearlift.report.evidence import Evidence
from nearlift.report.findings import ranked
from nearlift.report.number import Number, Place
from nearlift.report.phrases import (
    PRIOR_ODDS,
    along,
    displayed,
    listed,
    sentence,
    titles,
    without_unit,
)
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.rounding import plain
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import RESULTS

#: So many lines of structure, and of silent effects, are shown.
MAX_LINES = 12
#: Nearer to a bound than this part of the allowed range, a parameter is at it.
AT_BOUND = 1e-6
#: A size that is printed as the distance of which it is the square.
SATURATION = {"gap_hat2": "ẑ"}


def facts(evidence: Evidence) -> Markup:
    """The loop's figure, a section for each boundary that was diagnosed, and why the others were
    not.
    """
    rate = Place(evidence, DIAGNOSIS, ("false_alarm_rate",)).percent(digits=3)
    parts = [blocks.figure("diagnosis")]
    parts.append(blocks.paragraph("False-alarm rate: {} % per boundary. {}", rate, PRIOR_ODDS))
    for b in BOUNDARIES:
        if reason := evidence.not_diagnosed(b):
            parts += [
                blocks.heading(f"{b.capitalize()}: not diagnosed"),
                blocks.paragraph("{}", sentence(reason)),
            ]
        elif diagnosis := evidence.diagnosed(b):
            parts.append(_section(evidence, words.Brief(evidence, b), diagnosis))
    return blocks.join(*parts)


def _section(evidence: Evidence, brief: words.Brief, diagnosis: BoundaryDiagnosis) -> Markup:
    place = Place(evidence, DIAGNOSIS, ("boundaries", brief.boundary))
    experiments = {n: i for i, n in enumerate(diagnosis.next_experiment)}
    return blocks.join(
        blocks.heading(brief.boundary.capitalize()),
        Markup('<p class="verdict">{}</p>').format(blocks.shown(brief.verdict)),
        blocks.items(brief.findings),
        blocks.table(
            "Identified effects",
            ("effect", "mechanism", "size", "90 %", "not distinguished from"),
            _effects(evidence, brief, diagnosis),
        ),
        _table(
            "Partial explanations",
            ("effect", "% of what exceeds the noise"),
            [
                (titled(p.content["name"]), p.percent("share", digits=2))
                for p in place.every("partial")
            ],
        ),
        *(_next(place.at("next_experiment", experiments[n])) for n in brief.feasible),
        _table(
            "Smallest effects detected with 80 % power",
            ("effect", "parameter", "size", "unit"),
            _limits(place),
        ),
        _table("Tests of residual structure", ("along", "p", "significant"), _tests(place)),
        _table(
            "Every candidate",
            ("candidate", "drop of χ²", "2 ln B behind the best", "leaves structure along"),
            _candidates(place, diagnosis),
        ),
        _table(
            "Untestable here",
            ("effect", "log next time"),
            [(titled(name), listed(log)) for name, log in diagnosis.untestable.items()],
        ),
        _table(
            "Effects that the coefficients can absorb",
            ("effect", "absorbed by", "bias undetected, in u", "detectable at plausible size"),
            [
                (
                    titled(s.effect),
                    titled(s.absorbed_by),
                    place.number("silent", i, "bias_at_detection_limit", digits=2),
                    "no" if s.hidden else "yes",
                )
                for i, s in enumerate(diagnosis.silent[:MAX_LINES])
                if not sources.is_the_coefficient(s)
            ],
        ),
    )


def _table(title: str, heads: tuple[str, ...], rows: list[tuple[object, ...]]) -> Markup:
    """A folded table with its number of rows."""
    caption = f"{title} ({len(rows)})"
    return blocks.fold(caption, blocks.table(caption, heads, rows, hidden=True))


def _effects(
    evidence: Evidence, brief: words.Brief, diagnosis: BoundaryDiagnosis
) -> Iterator[tuple[object, ...]]:
    """A row for each size of an identified effect, as results.json quotes it where it does."""
    at = ("boundaries", brief.boundary)
    quoted = {(s.effect, s.parameter): i for i, s in enumerate(brief.quoted.sizes)}
    for i, effect in enumerate(diagnosis.effects):
        rivals = titles(diagnosis.stand_ins(effect), "or")
        for name, known in effect.parameters.items():
            place = Place(evidence, DIAGNOSIS, (*at, "effects", i, "parameters", name))
            if (j := quoted.get((effect.name, name))) is not None:
                place = Place(evidence, RESULTS, (*at, "sizes", j))
            stated = place.content.get("unit", "1")
            show, unit = displayed(name, stated)
            # an exponent needs no unit in words
            unit = "" if unit.startswith("exponent") else unit
            q = place.quote(
                name=SATURATION.get(name, without_unit(name, stated)), show=show, unit=unit
            )
            q = replace(q, u=None, at_bound=_is_at_bound(effect.name, name, known.value))
            form = brief.quoted.form(effect.name)
            cause = f"{effect.mechanism} ({form} form)" if form else effect.mechanism
            yield titled(effect.name), cause, q.equation, q.interval, rivals


def _is_at_bound(effect: str, parameter: str, value: float) -> bool:
    known = {e.name: e for e in catalogue.effects()}
    forms = known[effect].forms if effect in known else ()
    for p in (p for form in forms for p in form.parameters):
        if p.name == parameter.partition("[")[0]:
            low, high = p.bounds
            # of a larger rig the bounds are wider than declared
            return abs(min(value - low, high - value)) < AT_BOUND * (high - low)
    return False


def _limits(place: Place) -> list[tuple[object, ...]]:
    """The detection limit of each effect's size, in few trials."""
    limits = place.every("sensitivity", "limits") if place.content.get("sensitivity") else []
    return [
        (
            titled(r.content["effect"]),
            r.content["parameter"].replace("_", " "),
            r.number("size", digits=2),
            "" if r.content["unit"] == "1" else r.content["unit"],
        )
        for r in limits
        if r.content["size"] is not None
    ]


def _tests(place: Place) -> list[tuple[object, ...]]:
    """The most significant test along each covariate, and of drift within records."""
    tests = [(along(t.content["covariate"]), t) for t in place.every("structure")[:MAX_LINES]]
    if place.content.get("within_trial"):
        tests.append(("time within a record", place.at("within_trial")))
    return [
        (name, t.chance("p_value"), "yes" if t.content["significant"] else "no")
        for name, t in tests
    ]


def _candidates(place: Place, diagnosis: BoundaryDiagnosis) -> list[tuple[object, ...]]:
    """Every candidate with its gain, its evidence and what it leaves."""
    rows: list[tuple[object, ...]] = []
    for c in ranked(diagnosis):
        i, j = c.place
        at = place.at("rounds", i, "candidates", j)
        behind = Number(
            text=plain(c.behind, 3),
            value=c.behind,
            source=at.source("log_evidence"),
            how="less that of the best, times −2",
        )
        left = along(c.tried.left_in) if c.tried.left_in else "too little explained"
        if c.tried.accepted:
            left = "nothing"
        elif c.tried.judged_by and not c.tried.left_in:
            left = "decided by visits left out"
        name = f"{titled(c.tried.name)}{' (accepted)' if c.tried.accepted else ''}"
        rows.append((name, at.number("gain", places=1), behind, left))
    return rows


def _next(at: Place) -> Markup:
    """An experiment that would distinguish, with its cost."""
    n = at.content
    cost = ""
    if n.get("trials") and n.get("expected_evidence"):
        cost = Markup(" ({} trials, expected 2 ln <i>B</i> = {})").format(
            at.number("trials", digits=6), at.number("expected_evidence", digits=2)
        )
    pair = " from ".join(titled(s) for s in n.get("separates") or ())
    return blocks.paragraph(
        "{} {}{}{}.",
        blocks.bold("Next:"),
        n["measure"],
        f", to distinguish {pair}" if pair else "",
        cost,
    )
