"""Chapters on the quoted number: doubts, budget, degeneracies, posterior, lift far away, noise."""

from __future__ import annotations

import math
from dataclasses import replace

from markupsafe import Markup

from nearlift.declare import Boundary
from nearlift.fit.information import UNITS
from nearlift.likelihood import budget as stated
from nearlift.report import blocks, tables, words
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, Place, quotation
from nearlift.report.phrases import coefficient_text, listed
from nearlift.report.sources import badly_known
from nearlift.rounding import plain
from nearlift.stages.fit import FIT

#: Throttles above which their table is folded.
MANY = 12
#: A campaign repeated more often is no remedy.
MOST_REPEATS = 100


def doubts(evidence: Evidence) -> Markup:
    """Every doubt, every coefficient under another assumption, and chi2."""
    return blocks.join(
        blocks.items(
            [
                Markup("{} {}").format(
                    blocks.bold(f"{', '.join(of) or 'all'}:".capitalize()), blocks.shown(text)
                )
                for text, of in words.doubts(evidence).items()
            ],
            "doubts",
        ),
        blocks.table(
            "Coefficients under other assumptions",
            ("boundary", "assumption", "coefficient", "90 %"),
            [row for b in evidence.boundaries for row in conditions(evidence, b)],
        ),
        *(
            blocks.paragraph(
                "{}: <i>χ</i>²/dof = {}: {}.",
                b.boundary.capitalize(),
                reduced(evidence, b.boundary, b.quoted.base_model),
                b.goodness,
            )
            for b in words.briefs(evidence)
        ),
    )


def conditions(evidence: Evidence, boundary: Boundary) -> list[tuple[object, ...]]:
    """Rows of each coefficient under other assumptions."""
    rows: list[tuple[object, ...]] = []
    for name, c in evidence.quoted(boundary).coefficients.items():
        for i, d in enumerate(c.doubts):
            q = quotation(evidence, boundary, name).quote("doubts", i, name=name)
            equation = replace(q, u=None).equation
            rows.append((boundary.capitalize(), d.condition, equation, q.interval))
    return rows


def reduced(evidence: Evidence, boundary: Boundary, model: str) -> Number:
    """chi2 over its degrees of freedom."""
    place = Place(evidence, FIT, ("boundaries", boundary, model))
    chi2, dof = place.number("chi2"), place.number("dof").value
    value = chi2.value / dof if dof else math.nan
    text = f"{value:.2f}" if math.isfinite(value) else "–"
    return replace(chi2, text=text, value=value, how="over dof of the same model")


def budget(evidence: Evidence) -> Markup:
    """A table for each coefficient to quote."""
    whole = tables.budget(evidence)
    boundary, coefficient = whole.frame["boundary"], whole.frame["coefficient"]
    shown = {k: v for k, v in whole.shown.items() if k != "coefficient"}
    parts = []
    for b in evidence.boundaries:
        for name, c in evidence.quoted(b).coefficients.items():
            if not c.budget:
                continue
            rows = whole.main & (boundary == b) & (coefficient == name)
            title = f"{b.capitalize()}: {coefficient_text(c, name)}"
            few = badly_known(c)
            limits = f" Upper limits only, with under 2 degrees of freedom: {', '.join(few)}."
            place = quotation(evidence, b, name)
            low, high = (place.number(k, like_u=c.u) for k in ("lo95", "hi95"))
            parts += [
                tables.html(replace(whole, shown=shown, main=rows), title),
                blocks.paragraph("95 %: {} to {}.{}", low, high, limits if few else "", note=True),
            ]
    note = "Standard uncertainties (k = 1) of correlated sources; all are in tables/budget.csv."
    return blocks.join(blocks.paragraph(note), *parts)


def limits(evidence: Evidence) -> Markup:
    """Remedies that would halve each uncertainty, and degeneracies."""
    parts = []
    for boundary in evidence.boundaries:
        side, fit = boundary.capitalize(), evidence.base(boundary)[1]
        halves = [
            text
            for halving in fit.would_halve.values()
            for text in (
                *(k.text for k in halving.knowledge),
                *([halving.repeats.text] if halving.repeats.times <= MOST_REPEATS else []),
            )
        ]
        pairs = [d.text for d in fit.degeneracies if d.text]
        for title, lines in (
            (f"{side}: what would reduce the uncertainty of the base fit", halves),
            (f"{side}: degeneracies of the base fit ({len(pairs)})", pairs),
        ):
            parts.append(blocks.fold(title, blocks.items(lines), opened=lines is halves))
    return blocks.join(*parts)


def posterior(evidence: Evidence) -> Markup:
    """Prior and posterior of each model's coefficients."""
    rows = []
    for boundary in evidence.boundaries:
        for name, fit in evidence.fits.boundaries[boundary].items():
            if not fit.posterior:
                continue
            place = Place(evidence, FIT, ("boundaries", boundary, name, "posterior"))
            for p in place.every("parameters"):
                u, drawn = p.content["u"], fit.posterior.parameters[str(p.path[-1])]
                rows.append(
                    (
                        f"{fit.title} ({boundary})",
                        p.quote().symbol,
                        drawn.prior.text,
                        p.number("median", like_u=u),
                        p.ends(like_u=u),
                        p.percent("width_ratio", digits=2),
                        p.number("ess", places=0),
                        drawn.words,
                    )
                )
    heads = (
        *("model", "of", "prior", "median", "90 %", "width, % of prior's", "effective draws"),
        "remark",
    )
    return blocks.join(
        blocks.figure("corner"), blocks.table("Posterior of each model fitted alone", heads, rows)
    )


def levels(evidence: Evidence) -> Markup:
    """L_inf of the base model per throttle and boundary, or the curve that it is."""
    cells: dict[float, dict[str, object]] = {}
    curves = []
    for boundary in evidence.boundaries:
        model, fit = evidence.base(boundary)
        place = Place(evidence, FIT, ("boundaries", boundary, model.name, "L_inf_N"))
        for throttle in fit.L_inf_N:
            cells.setdefault(throttle, {})[boundary] = place.quote(f"{throttle:g}").estimate
        if fit.levels:
            curves.append(f"{boundary.capitalize()}: {words.level_curve(fit.levels)}")
    caption = "Lift far from the boundary at each throttle"
    rows = [
        (f"{100 * t:.4g} %", *(mine.get(b, "–") for b in evidence.boundaries))
        for t, mine in sorted(cells.items())
    ]
    heads = ("throttle", *(b.capitalize() for b in evidence.boundaries))
    table = blocks.table(caption, heads, rows, hidden=True)
    shown = blocks.fold(f"{len(rows)} throttles", table) if len(rows) > MANY else table
    return blocks.join(*(blocks.paragraph("{}", text) for text in curves), shown)


def noise(evidence: Evidence) -> Markup:
    """Table of the scatter of trials, and the stated errors that repeats do not average down."""
    rows = []
    for boundary in evidence.boundaries:
        quoted = evidence.quoted(boundary).coefficients.values()
        few = sorted({source for c in quoted for source in badly_known(c)})
        place = Place(evidence, FIT, ("noise", boundary))
        upper = f"; upper limits only: {listed(few)}" if few else ""
        rows.append(
            (
                boundary.capitalize(),
                place.percent("relative", digits=3),
                place.number("force_N", digits=3, scale=1000, how="in mN"),
                place.number("height_m", digits=3, scale=1000, how="in mm"),
                place.percent("common", digits=3),
                place.percent("drift", digits=3),
                f"{place.content['source']}{upper}",
            )
        )
    components = []
    for c in stated.components(evidence.campaign):
        if not c.is_measured:
            _, scale, unit = UNITS[c.on]
            size = f"{plain(scale * c.standard, 3)} {unit}"
            components.append((c.name, c.on, size, c.distribution, c.scope))
    return blocks.join(
        blocks.table(
            "Scatter of trials in the base fit, one standard deviation",
            (
                *("boundary", "proportional, %", "additive, mN", "height, mm", "visit to visit, %"),
                *("slow drift, %", "estimated from"),
            ),
            rows,
        ),
        blocks.table(
            "Systematic errors stated by the manifest, as standard uncertainties",
            ("component", "on", "size", "distribution", "shared by"),
            components,
            source="campaign.toml",
        ),
    )
