"""The methods paragraphs of a paper, as pandoc's Markdown, and the BibTeX of what they cite."""

from __future__ import annotations

import re

import numpy as np
from markupsafe import Markup

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import Boundary
from nearlift.likelihood import budget
from nearlift.nomenclature import GREEK, mathematics
from nearlift.reduction.quality import rejected
from nearlift.report import blocks, words
from nearlift.report.documents.references import bibtex, keys
from nearlift.report.evidence import Evidence
from nearlift.report.phrases import (
    coefficient_text,
    explanation,
    is_sure,
    listed,
    probability,
    sentence,
    several,
    sizes,
)
from nearlift.rounding import plain
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import POSTERIOR
from nearlift.stages.ingest import TRIALS
from nearlift.version import __version__

VERDICTS = {
    "adequate": "no residual structure was detected",
    "unexplained": "no candidate effect explains the residual structure",
}
CITED = re.compile(r"\[@([a-z0-9_]+(?:; @[a-z0-9_]+)*)\]")
PROGRAMS = {"NumPy": "numpy", "SciPy": "scipy", "Matplotlib": "matplotlib"}


def paragraphs(evidence: Evidence) -> list[str]:
    """Design, reduction, fits, loop, results and programs, a paragraph each, in pandoc's Markdown:
    ``$K_b$``, ``[@key]``.
    """
    written = (_design, _reduction, _fits, _loop, _results, _programs)
    return [" ".join(p.split()) for write in written if (p := write(evidence))]


def facts(evidence: Evidence) -> Markup:
    """The paragraphs as plain text, for the page."""
    text = blocks.join(*(blocks.paragraph("{}", _read(p)) for p in paragraphs(evidence)))
    files = ("methods.md", "references.bib", "tables/coefficients.tex")
    links = Markup(", ").join(Markup('<a href="{}">{}</a>').format(f, f) for f in files)
    return blocks.join(
        blocks.paragraph("With citations: {}.", links, note=True),
        Markup('<div id="methods-text">{}</div>').format(text),
        blocks.copies("methods-text"),
    )


def markdown(evidence: Evidence) -> bytes:
    """methods.md."""
    return ("\n\n".join(paragraphs(evidence)) + "\n").encode()


def references(evidence: Evidence) -> bytes:
    """references.bib: what the paragraphs cite, and nothing else."""
    groups = (group for p in paragraphs(evidence) for group in CITED.findall(p))
    cited = [key for group in groups for key in group.split("; @")]
    return bibtex(cited, (*catalogue.models(), *catalogue.effects())).encode()


def _cite(*names: str) -> str:
    return f"[@{'; @'.join(dict.fromkeys(names))}]"


def _safe(text: str) -> str:
    """A name from a file, with nothing in it that Markdown or this module would act upon."""
    return " ".join(re.sub(r"[$\[\]@`*\\<>]", " ", text).split())


def _plural(n: int, word: str) -> str:
    return f"{n} {word}{'s' if n != 1 else ''}"


def _design(evidence: Evidence) -> str:
    vehicle, trials = evidence.campaign.vehicle, evidence.frame(TRIALS)
    made = "simulated" if evidence.campaign.simulated else "measured"
    text = (
        f"Lift of a tethered rotorcraft ({_safe(vehicle.name)}:"
        f" {_plural(vehicle.rotors, 'rotor')} of radius {plain(1e3 * vehicle.rotor_radius)} mm)"
        f" was {made} at constant {evidence.campaign.rig.held}."
        r" $\hat z$ is the distance over the rotor radius."
    )
    for boundary in evidence.boundaries:
        mine = trials[(trials["boundary"] == boundary) & np.isfinite(trials["z_hat"])]
        z = mine["z_hat"]
        visits = f" in {_plural(mine['visit'].nunique(), 'visit')}" if "visit" in mine else ""
        text += (
            f" Near the {boundary}, {_plural(len(mine), 'trial')}{visits} at"
            f" {_plural(z.nunique(), 'distance')}"
            rf" ($\hat z$ from {plain(z.min(), 3)} to {plain(z.max(), 3)}) and"
            rf" {_plural(mine['throttle'].nunique(), 'throttle')}."
        )
    if free := int((trials["boundary"] == "none").sum()):
        text += f" In free air, {_plural(free, 'trial')}."
    return f"The records were simulated, not measured. {text}" if made == "simulated" else text


def _reduction(evidence: Evidence) -> str:
    trials, cell = evidence.table(TRIALS), evidence.campaign.load_cell
    text = "Mean lifts of trials were taken as they were recorded."
    if evidence.campaign.records.reader != "means":
        rate = f" at {plain(cell.sample_rate)} Hz" if cell.sample_rate else ""
        tare = {"none": "without a tare", 0.0: "tared beforehand"}.get(
            cell.tare or 0.0, "tare removed"
        )
        text = f"Each trial is the mean of a load-cell record{rate}, {tare}."
    n = len(trials["quality"])
    lost = "was" if rejected(trials["quality"]).sum() < 2 else "were"
    removed = words.removed(evidence).replace(" left out", f" {lost} left out", 1)
    text += f" Of {_plural(n, 'trial')}, {removed}."
    if excluded := sum(len(evidence.base(b)[1].excluded) for b in evidence.boundaries):
        text += f" {_plural(excluded, 'accepted trial')} outside a base model's range took no part."
    return text


def _fits(evidence: Evidence) -> str:
    parts = []
    for boundary in evidence.boundaries:
        model, fit = evidence.base(boundary)
        others = [n for n in evidence.fits.boundaries[boundary] if n != model.name]
        rivals = [catalogue.model(n) for n in others]
        cited = _cite(*(k for r in rivals for k in keys(r))) if rivals else ""
        also = f", with {_plural(len(rivals), 'rival')} {cited}" if rivals else ""
        parts.append(
            f" Near the {boundary}: {model.title} {_cite(*keys(model))}{also}, to"
            f" {_plural(fit.n_trials, 'trial')}."
        )
    declared = [
        f"{_safe(c.name)} (shared by {c.scope})"
        for c in budget.components(evidence.campaign)
        if not c.is_measured
    ]
    shared = f". It includes the stated uncertainties: {listed(declared)}" if declared else ""
    curve = evidence.campaign.levels
    levels = "free for every throttle"
    if curve is not None and curve.by != "throttle":
        levels = f"a curve (its logarithm a polynomial of those of {_safe(listed(curve.of))})"
    sources = dict.fromkeys(evidence.fits.noise[b].source for b in evidence.boundaries)
    noise = dict.fromkeys(source.partition(" (")[0] for source in sources)
    posteriors = [evidence.base(b)[1].posterior for b in evidence.boundaries]
    drawn = evidence.has(POSTERIOR) and any(p and p.sampler == "emcee" for p in posteriors)
    sampled = f" Their posteriors were drawn by ensemble sampling {_cite('emcee')}."
    return (
        r"Models of $L/L_\infty$ were fitted to the logarithm of the lift of single trials, with"
        rf" $L_\infty$ {levels}.{''.join(parts)}"
        f" Least squares (trust region {_cite('lmfit')}) used the full covariance of the"
        f" {listed(list(noise))}{shared}."
        f" Uncertainties are standard ones, by the GUM {_cite('gum2008')}."
        f"{sampled if drawn else ''}"
    )


def _loop(evidence: Evidence) -> str:
    if not evidence.has(DIAGNOSIS):
        return ""
    said = [_verdict(evidence, b) for b in evidence.boundaries]
    diagnosed = [d for d in map(evidence.diagnosed, evidence.boundaries) if d]
    if diagnosed:
        rate = plain(100 * diagnosed[0].false_alarm_rate, 2)
        tested = (
            "Residuals of the base models were tested against run order, distance, throttle, logged"
            " quantities and nearlift's library of effects. The false-alarm rate is"
            f" {rate} % per boundary."
        )
        untested = dict.fromkeys(titled(name) for d in diagnosed for name in d.untestable)
        if untested:
            tested += f" Untestable with what was logged: {several([*untested])}."
        said.insert(0, tested)
    return " ".join(said)


def _verdict(evidence: Evidence, boundary: Boundary) -> str:
    """The loop's answer at one boundary, with its error."""
    diagnosis, quoted = evidence.diagnosed(boundary), evidence.quoted(boundary)
    if diagnosis is None:
        reason = evidence.not_diagnosed(boundary)
        return f"Residuals near the {boundary} were not diagnosed: {reason}." if reason else ""
    said = VERDICTS.get(diagnosis.verdict, "")
    if diagnosis.verdict == "effect":
        known = {e.name: e for e in catalogue.effects()}
        effects = [known[e.name] for e in diagnosis.effects if e.name in known]
        cited, rivals = _cite(*(k for e in effects for k in keys(e))), words.rivals_of(diagnosis)
        said = f"the residuals are explained by {explanation(quoted, diagnosis)} {cited}"
        if is_sure(quoted):
            said += probability(quoted)
            said += (
                f": {sizes(quoted, evidence.campaign.vehicle.rotor_radius)}" if quoted.sizes else ""
            )
            said += f". The design cannot distinguish this from {rivals}" if rivals else ""
    if diagnosis.look:
        said += f" ({diagnosis.look.text})"
    text = f"Near the {boundary}, {said}."
    if diagnosis.error:
        error = words.error(quoted, evidence.left_out)
        text += f" {sentence(f'cross-validated error: {error}')}"
    if could := diagnosis.sensitivity:
        text += f" {words.power(could)}."
    return text


def _results(evidence: Evidence) -> str:
    """The coefficients to quote, with what their intervals hold."""
    parts = []
    for boundary in evidence.boundaries:
        coefficients = evidence.quoted(boundary).coefficients
        estimates = [f"{mathematics(n)} = {coefficient_text(c)}" for n, c in coefficients.items()]
        for first in [*coefficients.values()][:1]:
            holds = _safe(titled(first.holds)).removesuffix(".")
            parts.append(f"Near the {boundary}, {listed(estimates)}. {holds}.")
    return " ".join(parts)


def _programs(evidence: Evidence) -> str:
    versions = evidence.versions
    named = [
        f"{name} {versions[key]} {_cite(key)}" for name, key in PROGRAMS.items() if key in versions
    ]
    programs = listed([f"Python {versions.get('python', '')}".strip(), *named])
    return f"All numbers are those of nearlift {__version__} with {programs}, seed {evidence.seed}."


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
