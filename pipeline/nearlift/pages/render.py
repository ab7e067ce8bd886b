"""The page itself: one file, which fetches nothing."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jinja2

from nearlift.pages.chapters import CHAPTERS, Chapter, nothing
from nearlift.summaries.evidence import Evidence

NAMES = {"ground": "Ground", "ceiling": "Ceiling", "sidewall": "Sidewall"}


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
        """The picture as a data address."""
        return "data:image/png;base64," + base64.b64encode(self.png).decode()


def page(evidence: Evidence, pictures: Sequence[Picture], chapters: Sequence[Chapter] = CHAPTERS) -> bytes:
    """index.html. Chapters whose products are missing are left out; figures that no chapter names come at the end."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("nearlift.pages", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["capfirst"] = lambda text: text[:1].upper() + text[1:]
    made = {p.name: p for p in pictures}
    named = {n for c in chapters for n in c.figures}
    further = tuple(n for n in made if n not in named)
    if further:
        chapters = [*chapters, Chapter(name="further", title="Further figures", facts=nothing, figures=further, template=False)]
    shown: list[Mapping[str, Any]] = []
    for chapter in chapters:
        own = [made[n] for n in chapter.figures if n in made]
        if not evidence.has(*chapter.needs) or not (chapter.template or own):
            continue
        template = f"{chapter.name}.html.j2" if chapter.template else ""
        facts = chapter.facts(evidence)
        shown.append(
            {"name": chapter.name, "title": chapter.title, "template": template, "facts": facts, "pictures": own, "lead": chapter.pictures_lead}
        )
    text = environment.get_template("index.html.j2").render(campaign=evidence.campaign, chapters=shown, names=NAMES)
    return text.encode()
