"""The budget of each coefficient, degeneracies, and prediction by each model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from markupsafe import Markup

from nearlift.declare import Boundary
from nearlift.report import blocks, tables
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place, quotation
from nearlift.report.phrases import coefficient_text
from nearlift.report.sources import badly_known
from nearlift.results.fit import ModelScore
from nearlift.rounding import fixed, plain
from nearlift.stages.fit import FIT

#: A difference of predictive scores below so many units is none, whatever its interval: there the
#: standard error is no guide.
LEAST_SCORE = 4.0
#: A difference of AIC beyond this is explained where prediction sees none.
AIC_APART = 10.0
#: What is said of models that are better or worse.
EXCLUDES = " The 95 % interval of the score difference over visits excludes zero."


def budget(evidence: Evidence) -> Markup:
    """A table for each coefficient to quote, and how errors of height enter."""
    whole = tables.budget(evidence)
    boundary, coefficient = whole.frame["boundary"], whole.frame["coefficient"]
    shown = {k: v for k, v in whole.shown.items() if k != "coefficient"}
    parts = [
        blocks.paragraph(
            "Standard uncertainties <i>u</i> (k = 1) of the coefficients as quoted. Type A: from"
            " repeats; type B: stated or assumed. <i>u</i> without: if that source were known"
            " exactly. Sources are correlated through the fit, so the two columns differ."
        )
    ]
    for b in evidence.boundaries:
        for name, c in evidence.quoted(b).coefficients.items():
            if not c.budget:
                continue
            mine = replace(
                whole, shown=shown, main=whole.main & (boundary == b) & (coefficient == name)
            )
            title = tables.typeset(f"{b.capitalize()}: {coefficient_text(c, name)}")
            low, high = (
                quotation(evidence, b, name).number(k, like_u=c.u) for k in ("lo95", "hi95")
            )
            few = badly_known(c)
            upper = (
                " Poorly determined (under 2 degrees of freedom), upper limits only:"
                f" {', '.join(few)}."
            )
            text = "95 % interval: {} to {}. Smaller sources are in tables/budget.csv.{}"
            parts += [
                tables.html(mine, title),
                blocks.paragraph(text, low, high, upper if few else "", note=True),
            ]
    return blocks.join(*parts, *(_heights(evidence, b) for b in evidence.boundaries))


def _heights(evidence: Evidence, boundary: Boundary) -> Markup:
    """The height error that the fit estimates; empty where there is none."""
    model, fit = evidence.base(boundary)
    if not fit.height_error:
        return Markup("")
    place = Place(evidence, FIT, ("boundaries", boundary, model.name, "height_error"))
    value, u = (
        place.number(k, like_u=fit.height_error.u, scale=1000, how="in mm") for k in ("value", "u")
    )
    return blocks.paragraph(
        "{} The fit estimates a height error of {} ± {} mm.",
        blocks.bold(f"{boundary.capitalize()}."),
        value,
        u,
    )


def limits(evidence: Evidence) -> Markup:
    """Remedies that would halve each uncertainty, and coefficients at a bound."""
    parts = []
    for boundary in evidence.boundaries:
        side = boundary.capitalize()
        halves = [
            tables.typeset(text)
            for halving in evidence.base(boundary)[1].would_halve.values()
            for text in (*(k.text for k in halving.knowledge), halving.repeats.text)
        ]
        bound = [name for name, c in evidence.quoted(boundary).coefficients.items() if c.at_bound]
        if bound:
            text = "At a bound, {}: {}. The interval is one-sided."
            parts.append(blocks.paragraph(text, side, ", ".join(bound)))
        if halves:
            text = "{}: how to reduce the uncertainty of the base fit"
            parts += [blocks.paragraph(text, side), blocks.items(halves)]
    return blocks.join(*parts)


def held_out(evidence: Evidence) -> Markup:
    """Models of each boundary by their prediction of visits left out, with the criteria that count
    parameters, and R².
    """
    whole = tables.comparison(evidence)
    parts = [
        blocks.paragraph(
            "Each visit is predicted from all others, its trials jointly. The score is the log"
            " predictive density, with a standard error over visits. The table also has AIC, BIC,"
            " the evidence and <i>R</i>²."
        )
    ]
    for b, c in evidence.fits.comparison.items():
        mine = replace(whole, main=whole.frame["boundary"] == b)
        count = f"{c.models[c.reference].visits} {evidence.left_out}"
        titles = {n: f.title for n, f in evidence.fits.boundaries[b].items()}
        parts.append(tables.html(mine, f"{b.capitalize()}: {count}"))
        parts += [blocks.paragraph("{}", w) for w in verdicts(c.models, c.reference, titles)]
    return blocks.join(*parts)


def _half(score: ModelScore) -> float:
    """Half of the 95 % interval of a difference of scores, over visits."""
    from scipy.special import stdtrit

    return float(stdtrit(max(score.visits - 1, 1), 0.975)) * score.u_d_elpd


def _difference(score: ModelScore) -> str:
    """Difference of scores with its 95 % interval."""
    half = _half(score)
    return (
        f"{fixed(score.d_elpd, 1)}, 95 %: {fixed(score.d_elpd - half, 1)} to"
        f" {fixed(score.d_elpd + half, 1)}"
    )


def verdicts(models: Mapping[str, ModelScore], base: str, titles: Mapping[str, str]) -> list[str]:
    """Sentences on the models that predict better, as well and worse than the base."""
    worse: list[str] = []
    same: list[str] = []
    better: list[str] = []
    for name, score in models.items():
        if name == base or not score.u_d_elpd >= 0 or score.visits < models[base].visits:
            continue
        size = max(_half(score), LEAST_SCORE)
        (worse if score.d_elpd < -size else better if score.d_elpd > size else same).append(name)

    def listed(names: list[str]) -> str:
        return ", ".join(titles[n] for n in names)

    words = [
        f"{lead}: {'; '.join(f'{titles[n]} ({_difference(models[n])})' for n in names)}.{tail}"
        for names, lead, tail in (
            (better, "Better than the base", EXCLUDES),
            (same, "Prediction does not distinguish these from the base", ""),
            (worse, "Worse", EXCLUDES),
        )
        if names
    ]
    behind = {n: models[n].aic - models[base].aic for n in same}
    torn = [n for n in same if abs(behind[n]) > AIC_APART]
    if torn:
        listing = "; ".join(
            f"{titles[n]} {abs(behind[n]):.0f} {'behind' if behind[n] > 0 else 'ahead of'} the base"
            for n in torn
        )
        words.append(
            f"AIC disagrees: {listing}. AIC penalises fitted shifts of shared unknowns (a datum, a"
            " gain) from their stated values; the score does not. With well stated uncertainties"
            " believe AIC; otherwise neither decides."
        )
    if not better and not same and worse:
        words.append("No other model predicts as well as the base.")
    known = {n: m.r2 for n, m in models.items() if math.isfinite(m.r2)}
    fooled = [n for n in worse if n in known and known[n] > 0.9]
    if fooled:
        words.append(
            f"R² cannot decide: it is above 0.9 for {len([n for n in known if known[n] > 0.9])} of"
            f" {len(known)} models, {listed(fooled)} among them ({plain(known[fooled[0]], 3)}),"
            " which prediction rejects."
        )
    elif same and base in known:
        close = [n for n in same if n in known and abs(known[n] - known[base]) > 0.002]
        if close:
            words.append(
                f"R² distinguishes {listed(close)} from the base although prediction does not: it"
                " counts the trials' noise in the means as merit."
            )
    return words
