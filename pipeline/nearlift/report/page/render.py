"""The page itself: one file, which fetches nothing."""

from __future__ import annotations

import base64
import functools
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import jinja2
from markupsafe import Markup

from nearlift.report import blocks
from nearlift.report.charts import Chart, embedded
from nearlift.report.evidence import Evidence
from nearlift.report.phrases import along
from nearlift.report.registry import CHAPTERS, PARTS, Chapter
from nearlift.report.tables import spoken, typeset

#: The part that is open.
FIRST = "verdict"
NAMES = {"ground": "Ground", "ceiling": "Ceiling", "sidewall": "Sidewall"}


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
    licence = here.joinpath("vendor", "vega.LICENSE.txt").read_text(encoding="utf-8")
    library = here.joinpath("vendor", "vega.js").read_text(encoding="utf-8")
    return f"/*! {licence}*/\n{library}", here.joinpath("templates", "report.js").read_text(
        encoding="utf-8"
    )


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


def _placed(facts: Any, pictures: Sequence[Picture]) -> Any:
    """The chapter with its pictures where its text has them; those that were not made are left
    out.
    """
    if not isinstance(facts, Markup):
        return facts
    shown: Any = templates().get_template("charts.html.j2").module
    for p in pictures:
        facts = facts.replace(blocks.figure(p.name), shown.picture(p, []))
    return facts


def page(
    evidence: Evidence,
    pictures: Sequence[Picture],
    chapters: Sequence[Chapter] = CHAPTERS,
    charts: Sequence[Chart] = (),
) -> bytes:
    """index.html: the first part open, every chapter of the others folded. Chapters whose products
    are missing are left out; figures that no chapter names come at the end.
    """
    made = {p.name: p for p in pictures}
    drawn = {c.name: c for c in charts}
    shown: list[dict[str, Any]] = []
    for chapter in chapters:
        placed = next((drawn.pop(f.name) for f in chapter.places if f.name in drawn), None)
        figures = [made.pop(f.name) for f in chapter.figures if f.name in made]
        interactive = [drawn[f.name] for f in chapter.figures if f.name in drawn]
        if not evidence.has(*chapter.needs) or not (chapter.facts or figures or interactive):
            continue
        shown.append(
            {
                "chapter": chapter,
                "facts": _placed(chapter.facts(evidence), figures) if chapter.facts else "",
                "pictures": figures,
                "placed": placed,
                "charts": interactive,
            }
        )
    if made:
        further = Chapter(name="further", title="Further figures")
        shown.append(
            {
                "chapter": further,
                "facts": "",
                "pictures": list(made.values()),
                "placed": None,
                "charts": [],
            }
        )
    parts = [
        {"name": name, "title": title, "open": name == FIRST, "chapters": chapters_of}
        for name, title in PARTS.items()
        if (chapters_of := [c for c in shown if c["chapter"].part == name])
    ]
    every = [c for s in shown for c in (s["placed"], *s["charts"]) if c]
    return rendered(
        "index.html.j2",
        every,
        campaign=evidence.campaign,
        parts=parts,
        shown=[c["chapter"].name for c in shown],
        names=NAMES,
    )
