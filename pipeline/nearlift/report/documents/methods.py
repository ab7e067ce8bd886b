"""The methods paragraphs of a paper, as pandoc's Markdown, and the BibTeX of what they cite."""

from __future__ import annotations

import functools
import re
from importlib import resources

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import Boundary, Declaration, Effect
from nearlift.likelihood import budget
from nearlift.nomenclature import mathematics
from nearlift.reduction.quality import rejected
from nearlift.report import phrases, words
from nearlift.report.documents.text import environment
from nearlift.report.evidence import Evidence
from nearlift.results.quotation import BoundaryResult
from nearlift.stages.fit import POSTERIOR
from nearlift.stages.ingest import TRIALS
from nearlift.version import __version__

CITED = re.compile(r"\[@([a-z0-9_]+(?:; @[a-z0-9_]+)*)\]")
PROGRAMS = {"NumPy": "numpy", "SciPy": "scipy", "Matplotlib": "matplotlib"}


@functools.lru_cache(maxsize=1)
def markdown(evidence: Evidence) -> bytes:
    """methods.md: design, reduction, fits, loop, results and programs, a paragraph each, in
    pandoc's Markdown: ``$K_b$``, ``[@key]``.
    """
    briefs, trials = words.briefs(evidence), evidence.frame(TRIALS)
    removed, lost = words.removed(evidence), int(rejected(trials["quality"].to_numpy()).sum())
    fits = [evidence.base(b.boundary)[1] for b in briefs]
    diagnosed = [b.diagnosis for b in briefs if b.diagnosis]
    stated = [
        f"{_inert(c.name)} (shared by {c.scope})"
        for c in budget.components(evidence.campaign)
        if not c.is_measured
    ]
    versions = evidence.versions
    programs = [
        f"{name} {versions[key]} [@{key}]" for name, key in PROGRAMS.items() if key in versions
    ]

    def rival_models(boundary: Boundary) -> list[Declaration]:
        base = evidence.fits.base[boundary]
        return [catalogue.model(n) for n in evidence.fits.boundaries[boundary] if n != base]

    text = environment().overlay()
    text.filters["inert"] = _inert
    rendered = text.get_template("methods.md.j2").render(
        evidence=evidence,
        trials=trials,
        briefs=briefs,
        rate=diagnosed[0].false_alarm_rate if diagnosed else None,
        prior_odds=phrases.PRIOR_ODDS,
        removed=removed.replace(" left out", f" {'was' if lost < 2 else 'were'} left out", 1),
        excluded=sum(len(fit.excluded) for fit in fits),
        cite=_cite,
        rival_models=rival_models,
        noise=[*{evidence.fits.noise[b.boundary].source.partition(" (")[0]: 0 for b in briefs}],
        stated=stated,
        sampled=evidence.has(POSTERIOR)
        and any(fit.posterior and fit.posterior.sampler == "emcee" for fit in fits),
        untestable=[*{titled(name): 0 for d in diagnosed for name in d.untestable}],
        effects=lambda b: _effects(b.quoted),
        confused=words.confused,
        power=words.power,
        explanation=phrases.explanation,
        forms=phrases.forms,
        is_sure=phrases.is_sure,
        probability=phrases.probability,
        sizes=phrases.sizes,
        estimates=lambda b: [
            f"{mathematics(n)} = {phrases.coefficient_text(c)}"
            for n, c in b.quoted.coefficients.items()
        ],
        programs=[f"Python {versions.get('python', '')}".strip(), *programs],
        version=__version__,
    )
    paragraphs = [re.sub(r" ([,.;:)])", r"\1", " ".join(p.split())) for p in rendered.split("¶")]
    return ("\n\n".join(filter(None, paragraphs)) + "\n").encode()


def references(evidence: Evidence) -> bytes:
    """references.bib: what the paragraphs cite, and nothing else."""
    groups = CITED.findall(markdown(evidence).decode())
    cited = dict.fromkeys(key for group in groups for key in group.split("; @"))
    declared: dict[str, Declaration] = {
        d.name: d for d in (*catalogue.models(), *catalogue.effects())
    }
    declared |= {e.name: e for b in words.briefs(evidence) for e in _effects(b.quoted)}
    entries = [_known().get(key) or _declared(declared[key]) for key in cited]
    return ("\n\n".join(entries) + "\n").encode()


def _effects(quoted: BoundaryResult) -> list[Effect]:
    """The identified effects, each in its form."""
    return [catalogue.effect(name, quoted.form(name)) for name in quoted.effects]


def _cite(*declared: Declaration) -> str:
    """Citation of sources; of a declaration by its own name where its source gives no entry."""
    keys = dict.fromkeys(key for d in declared for key in d.source.bibtex or (d.name,))
    return f"[@{'; @'.join(keys)}]"


def _inert(text: str) -> str:
    """A name from a file, with nothing in it that Markdown or this module would act upon."""
    return " ".join(re.sub(r"[$\[\]@`*\\<>]", " ", text).split())


@functools.cache
def _known() -> dict[str, str]:
    """references.bib by key: only fields that the publications or the declarations give."""
    folder = resources.files("nearlift.report.documents")
    text = folder.joinpath("references.bib").read_text(encoding="utf-8")
    return {e.partition("{")[2].partition(",")[0]: e for e in text.strip().split("\n\n")}


def _declared(declaration: Declaration) -> str:
    citation = re.sub(r"([&_$])", r"\\\1", re.sub(r"[\\{}%#~^]", " ", declaration.source.citation))
    library = "nearlift, library of models and effects"
    if citation.startswith("Physics of the bench"):
        fields = [
            "author = {{nearlift developers}}",
            f"title = {{{{{declaration.title}}}}}",
            f"howpublished = {{{library}}}",
            f"note = {{{citation}}}",
        ]
    else:
        fields = [
            f"title = {{{{{citation}}}}}",
            f"note = {{{declaration.title} of {library}}}",
        ]
    lines = [
        f"@misc{{{declaration.name}",
        *(f"  {field}" for field in fields),
        *([f"  doi = {{{declaration.source.doi}}}"] if declaration.source.doi else []),
    ]
    return ",\n".join(lines) + "\n}"
