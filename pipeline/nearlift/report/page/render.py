"""The page itself: one file, which fetches nothing."""

from __future__ import annotations

import base64
import functools
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import jinja2
from markupsafe import Markup

from nearlift.report import blocks
from nearlift.report.charts import Chart, embedded
from nearlift.report.evidence import Evidence
from nearlift.report.phrases import along, spoken, typeset
from nearlift.report.registry import CHAPTERS, PARTS, Chapter

#: The part that is open.
FIRST = "verdict"
#: Places of figures that were not made.
NOT_MADE = re.compile(r"<!--figure \w+-->")


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A figure on the page."""

    name: str
    title: str
    caption: str
    alt: str
    png: bytes

    @property
    def data(self) -> str:
        """The image as an address that holds it."""
        return f"data:image/png;base64,{base64.b64encode(self.png).decode()}"


@functools.cache
def scripts() -> tuple[str, str]:
    """The drawing library with its licence, and the page's own script."""
    here = resources.files("nearlift.report.page")
    licence, library, script = (
        here.joinpath(*path).read_text(encoding="utf-8")
        for path in (
            ("vendor", "vega.LICENSE.txt"),
            ("vendor", "vega.js"),
            ("templates", "report.js"),
        )
    )
    return f"/*! {licence}*/\n{library}", script


@functools.cache
def templates() -> jinja2.Environment:
    """The templates of all pages: text from files stays text, and a name that is not given is an
    error.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("nearlift.report.page", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "capfirst": lambda text: text[:1].upper() + text[1:],
        "titled": typeset,
        "spoken": spoken,
        "along": along,
    }
    return environment


def policy(allowed: Sequence[str]) -> str:
    """Content policy of the page: its own scripts, pictures and styles, nothing else."""
    digests = " ".join(
        f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'"
        for s in allowed
    )
    return f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {digests}"


def page(
    evidence: Evidence,
    pictures: Sequence[Picture],
    chapters: Sequence[Chapter] = CHAPTERS,
    chart: Chart | None = None,
) -> bytes:
    """index.html: the first part open with the chart, every chapter of the others folded. Chapters
    whose products are missing are left out; without a chart the page has only its own script.
    """
    shown = [
        (chapter, facts)
        for chapter in chapters
        if evidence.has(*chapter.needs) and (facts := placed(chapter.facts(evidence), pictures))
    ]
    parts = [
        {"name": name, "title": title, "open": name == FIRST, "chapters": chapters_of}
        for name, title in PARTS.items()
        if (chapters_of := [(c, f) for c, f in shown if c.part == name])
    ]
    run = scripts()[0 if chart else 1 :]
    text = (
        templates()
        .get_template("index.html.j2")
        .render(
            policy=Markup(policy(run)),
            scripts=[Markup(s) for s in run],
            charts=Markup(embedded(chart)),
            campaign=evidence.campaign,
            parts=parts,
            placed=chart,
            shown=[c.name for c, _ in shown],
        )
    )
    return text.encode()


def placed(facts: Any, pictures: Sequence[Picture]) -> Any:
    """The chapter with each figure in its place."""
    if not isinstance(facts, Markup):
        return facts
    template: Any = templates().get_template("charts.html.j2").module
    for picture in pictures:
        facts = facts.replace(blocks.figure(picture.name), template.picture(picture))
    return Markup(NOT_MADE.sub("", facts).strip())
