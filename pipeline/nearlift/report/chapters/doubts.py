"""What a reader should hold against the numbers of the first screen, and what they would be on
other conditions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from nearlift import catalogue
from nearlift.declare import Boundary
from nearlift.likelihood.budget import components
from nearlift.likelihood.noise import REPEATS
from nearlift.nomenclature import letter, noun
from nearlift.products import DIAGNOSIS, FIT, NOT_DIAGNOSED, RESULTS, TRIALS
from nearlift.reduction.quality import rejected
from nearlift.report.chapters.uncertainty import SCALES
from nearlift.report.evidence import Evidence
from nearlift.report.findings import listed, structure_along
from nearlift.report.number import LEAST_CHANCE, Number, Place
from nearlift.results.diagnosis import BoundaryDiagnosis, NamedEffect, wandering
from nearlift.results.quotation import BoundaryResult
from nearlift.rounding import plain

#: A base model whose chi2 is less likely than this by chance is called rejected.
REJECTED = 1e-3
INPUT_WORDS = {
    "rotor_radius": "rotor radius",
    "rotor_spacing": "rotor spacing",
    "height": "distance datum",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reservation:
    """One reason to doubt headlines, and their boundaries: none where it concerns the campaign."""

    boundaries: tuple[str, ...]
    text: str


def facts(evidence: Evidence) -> dict[str, object]:
    """Every doubt, every condition on which a coefficient would be another, and chi2."""
    return {
        "doubts": doubts(evidence),
        "conditions": [
            {"boundary": b, **row} for b in evidence.boundaries for row in conditions(evidence, b)
        ],
        "goodness": [
            {
                "boundary": b,
                "reduced": reduced(evidence, b, evidence.base(b)[0].name),
                "words": goodness(evidence, b)[1],
            }
            for b in evidence.boundaries
        ],
    }


def doubts(evidence: Evidence) -> list[Reservation]:
    """What a reader should hold against the numbers, the gravest first; nothing that is not in a
    product.
    """
    # what is said of several boundaries is said once
    merged: dict[str, tuple[str, ...]] = {}
    for boundary in evidence.boundaries:
        for text in reservations(evidence, boundary):
            merged[text] = (*merged.get(text, ()), boundary)
    every = [Reservation(boundaries=of, text=text) for text, of in merged.items()]
    out = int(rejected(evidence.table(TRIALS)["quality"]).sum()) if evidence.has(TRIALS) else 0
    if out:
        trials = len(evidence.table(TRIALS)["quality"])
        text = f"{out} of {trials} trials were left out; the trial table has their influence"
        every.append(Reservation(boundaries=(), text=text))
    if not components(evidence.campaign):
        text = "the manifest declares no error that repeats share, so none is in these intervals"
        every.append(Reservation(boundaries=(), text=text))
    return every


def reservations(evidence: Evidence, boundary: Boundary) -> list[str]:
    """The doubts about one boundary, the gravest first."""
    model, fit = evidence.base(boundary)
    diagnosis, quoted = evidence.diagnosed(boundary), evidence.quoted(boundary)
    said = [quoted.leaning] if quoted.leaning else []
    hinge = quoted.hinge
    suspects = [
        s
        for s in evidence.fits.influence[boundary].suspects
        if hinge is None or (s.kind, s.id) != (hinge[0], hinge[1].id)
    ]
    if evidence.not_diagnosed(boundary):
        # what is known to move the headline out of its interval is graver than what might
        headline = quoted.coefficients.get(quoted.headline)
        reach = 0.5 * (headline.hi90 - headline.lo90) if headline else math.inf
        grave = sorted((s for s in suspects if abs(s.shift) > reach), key=lambda s: -abs(s.shift))
        said += [s.text for s in grave]
        said.append("not diagnosed, so an effect of any size may be in the coefficient")
    if diagnosis and diagnosis.look:
        said.append(f"the campaign is still growing: {diagnosis.look.text}")
    if goodness(evidence, boundary)[0] and not (diagnosis and diagnosis.effects):
        # where an effect is named, it is the base model's cells that stray, not the quoted one's
        said.append(
            f"means at one distance and throttle stray from {model.title} by more than chance"
            " allows, so the interval belongs to a curve that the data do not follow"
        )
    if diagnosis:
        said += diagnosis.contradicted or ()
        said += [wandering(diagnosis.wander)] if diagnosis.wander is not None else []
        if diagnosis.verdict == "unexplained" and not diagnosis.contradicted:
            where = structure_along(diagnosis)
            said.append(
                f"what the base model leaves{' along ' if where else ''}{where} is unexplained, and"
                " may be in the coefficient too"
            )
    said += [s.text for s in suspects if s.text not in said]
    said += [
        f"{letter(name)} ends at a bound of its range"
        for name, c in quoted.coefficients.items()
        if c.at_bound
    ]
    if quoted.verdict == NOT_DIAGNOSED:
        # by the noise of the fit; after the loop the conditions say it by the loop's
        said += [d.text for d in fit.degeneracies[:1]]
    rivals = (
        [text for e in diagnosis.effects for text in _alike(diagnosis, e, quoted)]
        if diagnosis
        else []
    )
    left_out = _hidden(evidence, boundary)
    # the interval is over rivals, so where they hardly differ what it leaves out is graver
    said += [*rivals, *left_out] if _apart(quoted) else [*left_out, *rivals]
    if diagnosis and diagnosis.untestable:
        unlogged = listed([catalogue.titled(name) for name in diagnosis.untestable])
        said.append(f"nothing was logged that could tell of {unlogged}")
    return said


def _apart(quoted: BoundaryResult) -> bool:
    """Whether the headline with some rival is farther than u from what is quoted."""
    headline = quoted.coefficients.get(quoted.headline)
    return headline is not None and any(
        d.explanation and abs(d.value - headline.value) > headline.u for d in headline.doubts
    )


def _alike(diagnosis: BoundaryDiagnosis, effect: NamedEffect, quoted: BoundaryResult) -> list[str]:
    """The rivals of a named effect, alone and two together, with the headline by each."""
    others = diagnosis.stand_ins(effect)
    alone, together = ([o for o in others if (" + " in o) == joint] for joint in (False, True))
    headline = quoted.coefficients.get(quoted.headline)
    values = {d.explanation: plain(d.value, 2) for d in headline.doubts} if headline else {}

    def with_value(name: str, equals: str = "") -> str:
        return f"{name} ({equals}{values[name]})" if name in values else name

    said = []
    if alone:
        best = with_value(effect.name, f"{letter(quoted.headline)} = ")
        rivals = [with_value(o) for o in alone]
        said.append(f"this design cannot tell {best} from {listed(rivals, 'or')}")
    if together:
        pairs = [with_value(o) for o in together]
        said.append(
            f"{listed(pairs, 'or')} together would be likelier than {effect.name} alone, if not"
            " plainly"
        )
    return said


@dataclass(frozen=True, slots=True, kw_only=True)
class PlausibleError:
    """What a plausible error of an input that nobody declared does to the headline: the `shift`,
    also `in_u`, by the `size`, in `unit`. `at_most`: a larger one would have been seen.
    """

    on: str
    size: float
    unit: str
    shift: float
    in_u: float
    at_most: bool


def undeclared(evidence: Evidence, boundary: Boundary) -> list[PlausibleError]:
    """Errors of the inputs whose uncertainty nobody declared, the gravest first."""
    quoted, diagnosis = evidence.quoted(boundary), evidence.diagnosed(boundary)
    u = quoted.coefficients[quoted.headline].u if quoted.headline else math.inf
    if not (u > 0 and math.isfinite(u)):
        return []
    listed = []
    for error in evidence.base(boundary)[1].undeclared:
        shift = abs(error.shift[quoted.headline])
        part = min(1.0, _unseen_shift(diagnosis, error.on, u) / shift) if shift else 0.0
        if part:
            listed.append(
                PlausibleError(
                    on=error.on,
                    size=part * error.size,
                    unit=error.unit,
                    shift=part * shift,
                    in_u=part * shift / u,
                    at_most=part < 1,
                )
            )
    return sorted(listed, key=lambda error: -error.in_u)


def _unseen_shift(diagnosis: BoundaryDiagnosis | None, on: str, u: float) -> float:
    """The most that an error of that input can move the headline without being seen: `u` where the
    diagnosis found no more worth telling, without end where it tells nothing of it.
    """
    names = {e.name for e in catalogue.effects() if e.error_of == on}
    if (
        not names
        or diagnosis is None
        or diagnosis.verdict != "adequate"
        or names & {*diagnosis.untestable}
    ):
        return math.inf
    hidden = [s for s in diagnosis.silent if s.effect in names]
    if any(s.hidden for s in hidden):
        return math.inf
    return max((s.shift for s in hidden), default=u)


def unseen(evidence: Evidence, boundary: Boundary) -> tuple[float, str] | None:
    """The shift of the headline by the effect that could move it most without being seen, where
    that is more than its u; and the effect.
    """
    quoted, diagnosis = evidence.quoted(boundary), evidence.diagnosed(boundary)
    headline = quoted.coefficients.get(quoted.headline)
    if not (headline and diagnosis and diagnosis.silent):
        return None
    most = max(diagnosis.silent, key=lambda s: s.bias_at_detection_limit)
    return (most.shift, most.effect) if headline.u < most.shift < math.inf else None


def _hidden(evidence: Evidence, boundary: Boundary) -> list[str]:
    """What could move the headline by more than its u without being seen: plausible errors that
    nobody declared, and the effect that hides best. In one text, the gravest first.
    """
    moves = f"could move {noun(evidence.quoted(boundary).headline)}"
    said: list[tuple[float, str, str]] = []
    if grave := [e for e in undeclared(evidence, boundary) if e.in_u > 1]:
        sizes = ", ".join(
            f"{plain(SCALES[e.unit][0] * e.size, 2)} {SCALES[e.unit][1]} in {INPUT_WORDS[e.on]} by"
            f" {plain(e.shift, 2)}{' (more would show)' if e.at_most else ''}"
            for e in grave
        )
        errors = "errors that are not declared"
        said.append((grave[0].shift, f"{errors} {moves}: {sizes}", f"{errors}: {sizes}"))
    if hidden := unseen(evidence, boundary):
        shift, name = hidden
        effect, by = f"{name}, though too small to be seen,", f"by {plain(shift, 2)}"
        said.append((shift, f"{effect} {moves} {by}", f"{effect} {by}"))
    ranked = sorted(said)[::-1]
    return ["; ".join([ranked[0][1], *(short for _, _, short in ranked[1:])])] if ranked else []


def conditions(evidence: Evidence, boundary: Boundary) -> list[dict[str, object]]:
    """What each coefficient would be, and what it takes to believe that."""
    rows = []
    for name, c in evidence.quoted(boundary).coefficients.items():
        place = Place(evidence, RESULTS, ("boundaries", boundary, "coefficients", name, "doubts"))
        rows += [
            {"condition": d.condition, "quoted": place.quote(i, name=name)}
            for i, d in enumerate(c.doubts)
        ]
    return rows


def reduced(evidence: Evidence, boundary: Boundary, model: str) -> Number:
    """chi2 over its degrees of freedom."""
    place = Place(evidence, FIT, ("boundaries", boundary, model))
    chi2, dof = (place.number(k).value for k in ("chi2", "dof"))
    value = chi2 / dof if dof else math.nan
    return Number(
        text=f"{value:.2f}" if math.isfinite(value) else "–",
        value=value,
        source=place.source("chi2"),
        how="over dof of the same model",
    )


def goodness(evidence: Evidence, boundary: Boundary) -> tuple[bool, str]:
    """Whether chi2 rejects the base model, and what that means in words."""
    source = evidence.fits.noise[boundary].source
    if not source.startswith(REPEATS):
        return False, f"chi² says nothing here: the noise is the {source}"
    p = evidence.base(boundary)[1].p_value
    if p < REJECTED:
        chance = f"p = {plain(p, 1)}" if p > LEAST_CHANCE else "p < 10⁻¹²"
        text = (
            "rejected: means at one distance and throttle stray from the curve by more than"
            f" repeats scatter ({chance}); the interval is right only if the model is"
        )
        return True, text
    text = "means at one distance and throttle stray no more than repeats scatter"
    if not evidence.has(DIAGNOSIS):
        text += (
            "; what moves the repeats themselves (sessions, supply, drift) shows only in the"
            " residuals"
        )
    return False, text
