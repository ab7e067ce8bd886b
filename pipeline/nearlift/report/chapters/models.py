"""The models side by side, L_inf, and the noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from markupsafe import Markup

from nearlift.declare import Boundary
from nearlift.fit.information import SCALES
from nearlift.likelihood import budget
from nearlift.nomenclature import letter
from nearlift.report import blocks
from nearlift.report.chapters.doubts import reduced
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, Place, Quoted, headline
from nearlift.report.sources import badly_known
from nearlift.results.fit import CoefficientEstimate, Degeneracy
from nearlift.results.levels import LevelFit
from nearlift.rounding import plain, signed
from nearlift.stages.fit import FIT

#: How a degeneracy names L_inf, before the throttle.
LEVEL = "L_inf at "
#: Throttles above which their table is folded.
MANY = 12


def comparison(evidence: Evidence) -> Markup:
    """A table of models for each boundary: the base first, then by AIC."""
    return blocks.join(
        blocks.paragraph(
            "All models of a boundary share the base model's noise. ΔAIC and ΔBIC are differences"
            " from the best model fitted to the same trials. The base model's coefficients are the"
            " quoted ones; all other numbers are of a model fitted alone. A difference counts where"
            " the next chapter confirms it by prediction."
        ),
        *(part for b in evidence.boundaries for part in _table(evidence, b)),
    )


def _table(evidence: Evidence, boundary: Boundary) -> list[Markup]:
    fits, base = evidence.fits.boundaries[boundary], evidence.fits.base[boundary]
    comparable = [n for n in fits if fits[n].n_trials == fits[base].n_trials]
    smallest = {key: min(getattr(fits[n], key) for n in comparable) for key in ("aic", "bic")}
    near = any(math.isfinite(f.r2_near) for f in fits.values() if f.r2_near is not None)
    rows, notes = [], []
    for name in sorted(fits, key=lambda n: (n != base, n not in comparable, fits[n].aic)):
        fit, place = fits[name], Place(evidence, FIT, ("boundaries", boundary, name))
        quoted = [_coefficient(evidence, boundary, name, p) for p in fit.parameters]
        values = [Markup("{} = {}").format(q.symbol, q.estimate) for q in quoted]
        over: list[object] = [
            place.excess(key, over=least, how="less the smallest of this boundary")
            for key, least in smallest.items()
        ]
        trials = Markup("fitted to {} trials").format(place.number("n_trials", digits=6))
        rows.append(
            (
                f"{fit.title} (base)" if name == base else fit.title,
                Markup("<br>").join(values) or "none",
                reduced(evidence, boundary, name),
                place.percent("rmse", places=2),
                place.number("r2", places=4),
                *([place.number("r2_near", places=4)] if near else []),
                *(over if name in comparable else [trials, "–"]),
            )
        )
        confounded = grouped(fit.degeneracies, fit.parameters)
        if confounded:
            listing = blocks.items(confounded)
            summary = f"Degeneracies of {fit.title} ({len(confounded)})"
            notes.append(blocks.fold(summary, listing, opened=name == base))
    heads = (
        *("model", "coefficients, if the model is right", "χ²/dof", "in-sample RMSE, %", "R²"),
        *(["R², 1 < ẑ < 3"] if near else []),
        *("ΔAIC", "ΔBIC"),
    )
    failed = [f"{n} ({why})" for n, why in sorted(evidence.fits.failed.get(boundary, {}).items())]
    return [
        blocks.table(boundary.capitalize(), heads, rows),
        *notes,
        blocks.paragraph("Not fitted: {}.", "; ".join(failed), note=True) if failed else Markup(""),
    ]


def _coefficient(evidence: Evidence, boundary: Boundary, model: str, name: str) -> Quoted:
    """A model's coefficient by its own fit; the base model's as it is quoted."""
    if model == evidence.quoted(boundary).base_model:
        return headline(evidence, boundary, name)
    return Place(evidence, FIT).quote("boundaries", boundary, model, "parameters", name)


def grouped(
    degeneracies: Sequence[Degeneracy], parameters: Mapping[str, CoefficientEstimate]
) -> list[str]:
    """Degeneracies in words, one sentence for all coefficients that are confounded with the same
    quantity.
    """
    together: dict[str, list[Degeneracy]] = {}
    for d in degeneracies:
        first, second = d.pair
        # pairs of the model's own coefficients, and what is not identifiable, have a sentence each
        alone = second in parameters or (d.u_if_free is None and not second.startswith(LEVEL))
        together.setdefault(
            f"{first} {second}" if alone else LEVEL if second.startswith(LEVEL) else second, []
        ).append(d)
    return [_sentence(second, group, parameters) for second, group in together.items()]


def _sentence(
    second: str, group: list[Degeneracy], parameters: Mapping[str, CoefficientEstimate]
) -> str:
    if len(group) == 1:
        return group[0].text
    each: dict[str, list[Degeneracy]] = {}
    for d in group:
        each.setdefault(d.pair[0], []).append(d)
    if second == LEVEL:
        throttles = list(dict.fromkeys(d.pair[1].removeprefix(LEVEL) for d in group))
        named = " and ".join(
            f"{letter(name)} ({_range([d.r for d in pairs])})" for name, pairs in each.items()
        )
        return (
            f"{named} {'are' if len(each) > 1 else 'is'} confounded with L_inf at"
            f" {', '.join(throttles)} throttle"
        )
    named = " and ".join(
        f"{letter(name)} ({_range([pairs[0].r])}, u from {plain(parameters[name].u, 2)} to"
        f" {plain(pairs[0].u_if_free or math.nan, 2)})"
        for name, pairs in each.items()
    )
    return f"{named} would be confounded with an unknown {second} (u = {group[0].known_to})"


def _range(r: list[float]) -> str:
    """``r = −0.984``, or from one to the other."""
    low, high = (signed(x, 3) for x in (min(r), max(r)))
    return f"r = {low}" if low == high else f"r = {low} to {high}"


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
            curves.append(f"{boundary.capitalize()}: {_curve(fit.levels)}")
    free = Markup("<i>L</i><sub>∞</sub> of the base fit, free for every throttle.")
    caption = "Lift far from the boundary at each throttle"
    heads = ("throttle", *(b.capitalize() for b in evidence.boundaries))
    rows = [
        (f"{100 * t:.4g} %", *(mine.get(b, "–") for b in evidence.boundaries))
        for t, mine in sorted(cells.items())
    ]
    table = blocks.table(caption, heads, rows, hidden=True)
    return blocks.join(
        *(blocks.paragraph("{}", text) for text in curves or [free]),
        blocks.fold(f"{len(rows)} throttles", table) if len(rows) > MANY else table,
    )


def _curve(fit: LevelFit) -> str:
    """Sentence on the curve of L_inf: its variables, degree and cross-validated error."""
    curve = fit.curve
    # columns of trials end with their unit
    parts = [(name, *name.rpartition("_")[::2]) for name in curve.of]
    names = [word or name for name, word, _ in parts]
    rest = [
        f"{word or name} {plain(typical, 3)}{' ' if word else ''}{unit if word else ''}"
        for (name, word, unit), typical in zip(parts, curve.typical, strict=True)
        if name != "throttle"
    ]
    errors = ", ".join(f"{100 * e:.2f} % (degree {d})" for d, e in fit.held_out.items())
    at = f" The table is at {' and '.join(rest)}, the median." if rest else ""
    return (
        f"log L∞ is a polynomial of degree {curve.degree} in the logarithms of"
        f" {' and '.join(names)}. Cross-validated error over visits, with any smooth curve of"
        f" distance: {errors}. Not valid beyond the range of the trials.{at}"
    )


def noise(evidence: Evidence) -> Markup:
    """How trials scatter, and what the manifest states that repeats cannot show."""
    rows = []
    for boundary in evidence.boundaries:
        quoted = evidence.quoted(boundary).coefficients.values()
        few = sorted({source for c in quoted for source in badly_known(c)})
        place = Place(evidence, FIT, ("noise", boundary))
        limits = f"; upper limits only: {', '.join(few)}" if few else ""
        rows.append(
            (
                boundary.capitalize(),
                place.percent("relative", digits=3),
                place.number("force_N", digits=3, scale=1000, how="in mN"),
                place.number("height_m", digits=3, scale=1000, how="in mm"),
                place.percent("common", digits=3),
                place.percent("drift", digits=3),
                f"{place.content['source']}{limits}",
            )
        )
    stated = [
        (c.name, c.on, _standard(c), c.distribution, c.scope)
        for c in budget.components(evidence.campaign)
        if not c.is_measured
    ]
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
            stated,
        )
        or blocks.paragraph(
            "The manifest states neither [[uncertainty]] nor the accuracy of the load cell. No"
            " interval of this page includes errors shared by trials."
        ),
    )


def _standard(part: budget.Component) -> Markup:
    """A standard uncertainty in the unit that a bench talks in."""
    scale, unit = SCALES[part.on]
    standard = Number(
        text=plain(scale * part.standard, 3),
        value=float(part.standard),
        source="campaign.toml",
        how=f"standard uncertainty, in {unit}",
    )
    return Markup("{} {}").format(standard, unit)
