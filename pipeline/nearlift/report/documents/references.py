"""References of a report as BibTeX: the sources of its models and effects, and the programs."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable
from importlib import resources

from nearlift.declare import Declaration


def keys(declared: Declaration) -> tuple[str, ...]:
    """Entries that a model or an effect cites; its own name where its source gives none."""
    return declared.source.bibtex or (declared.name,)


def bibtex(cited: Iterable[str], declared: Iterable[Declaration]) -> str:
    """The entries of these keys, each once, in their order."""
    known, by_name = _known(), {d.name: d for d in declared}
    entries = [known.get(key) or _declared(by_name[key]) for key in dict.fromkeys(cited)]
    return "\n\n".join(entries) + "\n"


@functools.cache
def _known() -> dict[str, str]:
    """references.bib by key: only fields that the publications or the declarations give."""
    folder = resources.files("nearlift.report.documents")
    text = folder.joinpath("references.bib").read_text(encoding="utf-8")
    entries = text.strip().split("\n\n")
    return {entry.partition("{")[2].partition(",")[0]: entry for entry in entries}


def _declared(declaration: Declaration) -> str:
    citation = (
        re.sub(r"[\\{}%#~^]", " ", declaration.source.citation)
        .replace("&", r"\&")
        .replace("_", r"\_")
        .replace("$", r"\$")
    )
    lines = [
        f"@misc{{{declaration.name}",
        "  author = {{nearlift developers}}",
        f"  title = {{{{{declaration.title}}}}}",
        "  howpublished = {nearlift, library of models and effects}",
        f"  note = {{{citation}}}",
        *([f"  doi = {{{declaration.source.doi}}}"] if declaration.source.doi else []),
    ]
    return ",\n".join(lines) + "\n}"
