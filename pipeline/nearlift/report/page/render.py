"""The page itself: one file, which fetches nothing."""

from __future__ import annotations

import base64
import functools
import hashlib
import re
from collections.abc import Mapping, Sequence
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
#: The chart of the first screen.
PLACED = "fig2"
#: Places of figures that were not made.
NOT_MADE = re.compile(r"<!--figure \w+-->")


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A figure on the page; without `png` where a chart takes its place."""

    name: str
    title: str
    caption: str
    alt: str
    png: bytes = b""

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


def rendered(template: str, charts: Sequence[Chart], **facts: object) -> bytes:
    """A whole page with these charts; without any it has only its own script."""
    run = scripts()[0 if charts else 1 :]
    text = (
        templates()
        .get_template(template)
        .render(
            policy=Markup(policy(run)),
            scripts=[Markup(s) for s in run],
            charts=Markup(embedded(charts)),
            **facts,
        )
    )
    return text.encode()


def page(
    evidence: Evidence,
    pictures: Sequence[Picture],
    chapters: Sequence[Chapter] = CHAPTERS,
    charts: Sequence[Chart] = (),
) -> bytes:
    """index.html: the first part open, every chapter of the others folded. Chapters whose products
    are missing are left out.
    """
    made, drawn = {p.name: p for p in pictures}, {c.name: c for c in charts}
    shown = [
        (chapter, facts)
        for chapter in chapters
        if evidence.has(*chapter.needs) and (facts := placed(chapter.facts(evidence), made, drawn))
    ]
    parts = [
        {"name": name, "title": title, "open": name == FIRST, "chapters": chapters_of}
        for name, title in PARTS.items()
        if (chapters_of := [(c, f) for c, f in shown if c.part == name])
    ]
    return rendered(
        "index.html.j2",
        [c for c in charts if c.name == PLACED or c.name in made],
        campaign=evidence.campaign,
        parts=parts,
        placed=drawn.get(PLACED),
        shown=[c.name for c, _ in shown],
    )


def placed(facts: Any, made: Mapping[str, Picture], drawn: Mapping[str, Chart]) -> Any:
    """The chapter with each figure in its place, or the chart that takes it."""
    if not isinstance(facts, Markup):
        return facts
    template: Any = templates().get_template("charts.html.j2").module
    for name, picture in made.items():
        chart = drawn.get(name) if name != PLACED else None
        facts = facts.replace(blocks.figure(name), template.picture(picture, chart))
    return Markup(NOT_MADE.sub("", facts).strip())
