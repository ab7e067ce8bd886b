"""The methods paragraph of a paper, from what was done: Markdown as pandoc reads it, LaTeX, and the
BibTeX of what both cite.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.likelihood import budget
from nearlift.nomenclature import GREEK, mathematics
from nearlift.reduction.quality import code, rejected
from nearlift.report import blocks
from nearlift.report.documents.references import bibtex, keys
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place
from nearlift.report.phrases import SCALES, coefficient_text, explanation, is_sure, listed, sizes
from nearlift.report.sources import badly_known
from nearlift.report.tables import escaped
from nearlift.report.words import rivals_of
from nearlift.results.posterior import PosteriorSummary
from nearlift.results.quotation import CoefficientResult
from nearlift.rounding import plain
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import POSTERIOR
from nearlift.stages.ingest import TRIALS
from nearlift.version import __version__

VERDICTS = {
    "adequate": "no residual structure was detected",
    "unexplained": "no candidate effect explains the residual structure",
}
#: A part of the scatter with less of the headline's variance goes unmentioned.
LEAST_SHARE = 0.01
CITED = re.compile(r"\[@([a-z0-9_]+(?:; @[a-z0-9_]+)*)\]")
APART = re.compile(r"(\$[^$]+\$|\[@[a-z0-9_; @]+\])")


def paragraphs(evidence: Evidence) -> list[str]:
    """Design, reduction, fits, loop, results and programs, a paragraph each, in pandoc's Markdown:
    ``$K_b$``, ``[@key]``.
    """
    written = (_design, _reduction, _fits, _loop, _results, _programs)
    return [p for p in (write(evidence) for write in written) if p]


def facts(evidence: Evidence) -> Markup:
    """The paragraphs as plain text, for the page."""
    text = blocks.join(*(blocks.paragraph("{}", _read(p)) for p in paragraphs(evidence)))
    files = ("methods.md", "methods.tex", "references.bib", "tables/coefficients.tex")
    links = Markup(", ").join(Markup('<a href="{}">{}</a>').format(f, f) for f in files)
    return blocks.join(
        blocks.paragraph("With citations: {}.", links, note=True),
        Markup('<div id="methods-text">{}</div>').format(text),
        blocks.copies("methods-text"),
    )


def markdown(evidence: Evidence) -> bytes:
    """methods.md."""
    return ("\n\n".join(paragraphs(evidence)) + "\n").encode()


def tex(evidence: Evidence) -> bytes:
    r"""methods.tex: paragraphs to ``\input``; cites with ``\cite``, needs nothing but
    ``inputenc``.
    """
    return ("\n\n".join(_tex(p) for p in paragraphs(evidence)) + "\n").encode()


def references(evidence: Evidence) -> bytes:
    """references.bib: what the paragraphs cite, and nothing else."""
    cited = [
        key
        for p in paragraphs(evidence)
        for group in CITED.findall(p)
        for key in group.split("; @")
    ]
    return bibtex(cited, (*catalogue.models(), *catalogue.effects())).encode()


def _cite(*names: str) -> str:
    return f"[@{'; @'.join(dict.fromkeys(names))}]"


def _safe(text: str) -> str:
    """A name from a file, with nothing in it that Markdown or this module would act upon."""
    return " ".join(re.sub(r"[$\[\]@`*\\<>]", " ", text).split())


def _plural(n: int, word: str) -> str:
    return f"{n} {word}{'s' if n != 1 else ''}"


def _design(evidence: Evidence) -> str:
    vehicle, rig, trials = evidence.campaign.vehicle, evidence.campaign.rig, evidence.table(TRIALS)
    parts = []
    for boundary in evidence.boundaries:
        mine = (trials["boundary"] == boundary) & np.isfinite(trials["z_hat"])
        z, levels = trials["z_hat"][mine], np.unique(trials["throttle"][mine])
        visits = (
            f" in {_plural(len(np.unique(trials['visit'][mine])), 'visit')}"
            if "visit" in trials
            else ""
        )
        parts.append(
            f"Near the {boundary}, {_plural(int(mine.sum()), 'trial')}{visits} at"
            f" {_plural(len(np.unique(z)), 'distance')} "
            rf"($\hat z$ from {plain(float(z.min()), 3)} to {plain(float(z.max()), 3)}) and"
            rf" {_plural(len(levels), 'throttle')}"
        )
    if free := int((trials["boundary"] == "none").sum()):
        parts.append(f"In free air, {_plural(free, 'trial')}")
    radius = plain(1e3 * vehicle.rotor_radius)
    simulated = "The records were simulated, not measured. " if evidence.campaign.simulated else ""
    return (
        f"{simulated}Lift of a tethered rotorcraft"
        f" ({_safe(vehicle.name)}: {_plural(vehicle.rotors, 'rotor')} of radius {radius} mm) was"
        f" {'simulated' if simulated else 'measured'}"
        f" at constant {rig.held}. "
        rf"$\hat z$ is the distance over the rotor radius. {'. '.join(parts)}."
    )


def _reduction(evidence: Evidence) -> str:
    trials, cell = evidence.table(TRIALS), evidence.campaign.load_cell
    out = rejected(trials["quality"])
    if evidence.campaign.records.reader == "means":
        text = "Mean lifts of trials were taken as they were recorded. "
    else:
        rate = f" at {plain(cell.sample_rate)} Hz" if cell.sample_rate else ""
        tare = {"none": "without a tare", 0.0: "tared beforehand"}.get(
            cell.tare or 0.0, "tare removed"
        )
        text = f"Each trial is the mean of a load-cell record{rate}, {tare}. "
    names = Counter(
        n for q in trials["quality"][out].tolist() for n in q.split() if code(n).rejects
    )
    if out.any():
        why = listed([f"{code(n).meaning} ({k})" for n, k in names.most_common()])
        text += (
            f"Of {_plural(len(out), 'trial')}, {int(out.sum())}"
            f" {'was' if out.sum() == 1 else 'were'} left out: {why}. "
        )
    else:
        text += f"None of the {_plural(len(out), 'trial')} was left out. "
    excluded = sum(len(evidence.base(b)[1].excluded) for b in evidence.boundaries)
    if excluded:
        text += (
            f"{_plural(excluded, 'accepted trial')} outside the range of a base model took no part"
            " in its fit. "
        )
    return text.rstrip()


def _fits(evidence: Evidence) -> str:
    fits = evidence.fits
    parts = []
    for boundary in evidence.boundaries:
        model, fit = evidence.base(boundary)
        rivals = [catalogue.model(n) for n in fits.boundaries[boundary] if n != model.name]
        beside = (
            f", with {_plural(len(rivals), 'rival')} {_cite(*(k for r in rivals for k in keys(r)))}"
            if rivals
            else ""
        )
        parts.append(
            f" Near the {boundary}: {model.title} {_cite(*keys(model))}{beside}, to"
            f" {_plural(fit.n_trials, 'trial')}."
        )
    declared = [
        f"{_safe(c.name)} (shared by {c.scope})"
        for c in budget.components(evidence.campaign)
        if not c.is_measured
    ]
    shared = f". It includes the stated uncertainties: {listed(declared)}" if declared else ""
    curve = evidence.campaign.levels
    levels = (
        "free for every throttle"
        if curve is None or curve.by == "throttle"
        else f"a curve (its logarithm a polynomial of those of {_safe(listed(curve.of))})"
    )
    sources = dict.fromkeys(fits.noise[b].source.partition(" (")[0] for b in evidence.boundaries)
    text = (
        r"Models of $L/L_\infty$ were fitted to the logarithm of the lift of single trials, with"
        rf" $L_\infty$ {levels}.{''.join(parts)}"
        f" Least squares (trust region {_cite('lmfit')}) used the full covariance of the"
        f" {listed(list(sources))}{shared}."
        f" Uncertainties are standard ones, by the GUM {_cite('gum2008')}."
    )
    if evidence.has(POSTERIOR):
        drawn = [evidence.base(b)[1].posterior for b in evidence.boundaries]
        text += _posteriors([p for p in drawn if p])
    return text


def _posteriors(fits: Sequence[PosteriorSummary]) -> str:
    """How the base models' posteriors were drawn, and who judged them."""
    if not any(p.sampler == "emcee" for p in fits):
        return ""
    checks = [c for p in fits for c in p.checks if not c.unfit]
    judged = listed(["effective draws", *(["an exact grid"] if checks else [])])
    return (
        f" Posteriors of these models were drawn by ensemble sampling {_cite('emcee')}, and judged"
        f" by {judged}."
    )


def _loop(evidence: Evidence) -> str:
    if not evidence.has(DIAGNOSIS):
        return ""
    known = {e.name: e for e in catalogue.effects()}
    parts, silent = [], []
    for boundary in evidence.boundaries:
        if reason := evidence.not_diagnosed(boundary):
            silent.append(f"Residuals near the {boundary} were not diagnosed: {reason}.")
        diagnosis = evidence.diagnosed(boundary)
        if not diagnosis:
            continue
        said = VERDICTS.get(diagnosis.verdict, "")
        if diagnosis.verdict == "effect":
            named = [
                f"{titled(e.name)} {_cite(*keys(known[e.name]))}"
                for e in diagnosis.effects
                if e.name in known
            ]
            rivals = rivals_of(diagnosis, "and")
            size = f": {sizes(quoted)}" if (quoted := evidence.quoted(boundary)).sizes else ""
            quoted = evidence.quoted(boundary)
            if is_sure(quoted) or not diagnosis.probabilities:
                also = f". The design cannot distinguish this from {rivals}" if rivals else ""
                said = f"the residuals are explained by {listed(named)}{size}{also}"
            else:
                cited = _cite(*(k for e in diagnosis.effects for k in keys(known[e.name])))
                said = f"the residuals are explained by {explanation(quoted, diagnosis)} {cited}"
        if diagnosis.look:
            said += f" ({diagnosis.look.text})"
        if diagnosis.error:
            before, after, floor = (
                f"{plain(100 * e, 3)} %"
                for e in (
                    diagnosis.held_out_before,
                    diagnosis.held_out_after,
                    diagnosis.noise_floor,
                )
            )
            then = f" to {after}" if diagnosis.verdict == "effect" else ""
            said += (
                f". Cross-validated error over {evidence.left_out}: {before}{then} of lift; noise"
                f" floor {floor}"
            )
        if could := diagnosis.sensitivity:
            said += f". {could.trials} trials {titled(str(could))}"
        parts.append(f"near the {boundary}, {said}")
    if not parts:
        return " ".join(silent)
    rate = Place(evidence, DIAGNOSIS, ("false_alarm_rate",)).percent(digits=2).text
    untested = dict.fromkeys(
        titled(name)
        for diagnosis in map(evidence.diagnosed, evidence.boundaries)
        if diagnosis
        for name in diagnosis.untestable
    )
    unlogged = f" Untestable with what was logged: {listed([*untested])}." if untested else ""
    tested = (
        "Residuals of the base models were tested against run order, distance, throttle, logged"
        f" quantities and nearlift's library of effects. The false-alarm rate is {rate} % per"
        f" boundary.{unlogged}"
    )
    sentence = [f"{part[0].upper()}{part[1:]}." for part in parts]
    return " ".join([tested, *sentence, *silent])


def _results(evidence: Evidence) -> str:
    """The coefficients to quote, with what their intervals hold and the scatter behind them."""
    parts = []
    for boundary in evidence.boundaries:
        quoted = evidence.quoted(boundary)
        estimates = [
            f"{mathematics(name)} = {coefficient_text(c)}"
            for name, c in quoted.coefficients.items()
        ]
        for first in [*quoted.coefficients.values()][:1]:
            holds = _safe(titled(first.holds)).removesuffix(".")
            parts.append(f"Near the {boundary}, {listed(estimates)}. {holds}.{_scatter(first)}")
    return " ".join(parts)


def _scatter(headline: CoefficientResult) -> str:
    """Sources of scatter with at least a hundredth of the headline's variance, the largest first;
    poorly determined ones by name.
    """
    lines = [
        line
        for line in headline.budget
        if line.kind == "A" and line.u**2 >= LEAST_SHARE * headline.u**2 and line.u_input
    ]
    few = badly_known(headline)
    sized = [
        f"{line.source} {plain(SCALES[line.unit][0] * (line.u_input or 0.0), 2)}"
        f" {SCALES[line.unit][1]}"
        for line in lines
        if line.source not in few
    ]
    parts = [listed(sized)] if sized else []
    if unknown := [line.source for line in lines if line.source in few]:
        parts.append(f"poorly determined, {listed(unknown)}")
    return f" Its type A sources are {', and, '.join(parts)}." if parts else ""


def _programs(evidence: Evidence) -> str:
    versions = evidence.versions
    named = [
        f"{name} {versions[key]} {_cite(key)}"
        for name, key in (("NumPy", "numpy"), ("SciPy", "scipy"), ("Matplotlib", "matplotlib"))
        if key in versions
    ]
    with_what = f"Python {versions.get('python', '')}, {listed(named)}" if named else "Python"
    return (
        f"All numbers are those of nearlift {__version__} with {with_what}, seed {evidence.seed}."
    )


def _tex(text: str) -> str:
    parts = APART.split(text)
    return "".join(_apart(p) if i % 2 else escaped(p) for i, p in enumerate(parts))


def _apart(part: str) -> str:
    return part if part.startswith("$") else r"\cite{" + part[2:-1].replace("; @", ",") + "}"


def _read(text: str) -> str:
    """For the eye: no cites, and symbols as letters."""
    text = CITED.sub("", text)
    for spelled, shown in (
        (r"\hat z", "ẑ"),
        (r"\Delta", "Δ"),
        (r"_\infty", "∞"),
        *GREEK.items(),
        ("$", ""),
    ):
        text = text.replace(spelled, shown)
    return re.sub(r"(?<!\s)\s++([,.;:)])", r"\1", re.sub(r" {2,}", " ", text))
