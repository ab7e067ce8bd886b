"""The chapters of index.html, in order, with their figures: the one list of what a report holds.

A new figure is its file and its name here; a new chapter its function and its entry.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial

from markupsafe import Markup

from nearlift.report import blocks
from nearlift.report.chapters import (
    assumptions,
    diagnosis,
    flow,
    models,
    numbers,
    proximity,
    records,
    safety,
    verdict,
)
from nearlift.report.evidence import Evidence
from nearlift.report.figures.spec import FigureSpec
from nearlift.run.tables import Product
from nearlift.stages.detect import DETECTION, PROXIMITY
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import FIT, POSTERIOR
from nearlift.stages.flow import FLOW_PRODUCTS
from nearlift.stages.ingest import TRIALS
from nearlift.stages.simulate import SAFETY


@dataclass(frozen=True)
class Chapter:
    """One chapter. It is on the page when every product in `needs` exists.

    Attributes
    ----------
    part : str
        Of `PARTS`.
    name, title : str
        Anchor; heading.
    facts : callable
        Evidence to HTML, with a place for each figure; to a mapping for the template of the first
        screen.
    needs : tuple of Product
    drawn : str
        Modules of the figures that it places.
    """

    part: str
    name: str
    title: str
    facts: Callable[[Evidence], Markup | Mapping[str, object]]
    needs: tuple[Product, ...] = (FIT,)
    drawn: str = ""

    @cached_property
    def figures(self) -> tuple[FigureSpec, ...]:
        """Figures that it places."""
        modules = (f"nearlift.report.figures.{name}" for name in self.drawn.split())
        return tuple(importlib.import_module(module).FIGURE for module in modules)


def _pictures(names: str, evidence: Evidence) -> Markup:
    """A chapter that is its figures."""
    return blocks.join(*map(blocks.figure, names.split()))


#: What the contents list names, in order; the first part is the first screen.
PARTS = {
    "verdict": "Answer",
    "why": "Why",
    "number": "The number",
    "data": "The data",
    "others": "Other models",
    "velocity": "Flow",
    "flight": "Flight",
    "origin": "Provenance",
}

CHAPTERS: tuple[Chapter, ...] = (
    Chapter("verdict", "verdict", "Verdict", verdict.facts),
    Chapter("why", "diagnosis", "Diagnosis", diagnosis.facts, (DIAGNOSIS,), "diagnosis"),
    Chapter("number", "doubts", "Doubts, and coefficients under other assumptions", numbers.doubts),
    Chapter("number", "budget", "Uncertainty budget", numbers.budget),
    Chapter("number", "limits", "Degeneracies", numbers.limits),
    Chapter("number", "posterior", "Posterior", numbers.posterior, (FIT, POSTERIOR), "corner"),
    Chapter("number", "levels", "Lift far from the boundary", numbers.levels),
    Chapter(
        "data",
        "fig2",
        "Figure 2: lift change near each boundary",
        partial(_pictures, "fig2"),
        drawn="fig2",
    ),
    Chapter(
        "data",
        "residuals",
        "Residuals",
        partial(_pictures, "residuals"),
        (FIT, TRIALS),
        "residuals",
    ),
    Chapter("data", "noise", "Noise and stated uncertainty", numbers.noise),
    Chapter("data", "quality", "Quality of trials", records.quality, (TRIALS, FIT)),
    Chapter("data", "assumptions", "Assumptions behind Delta L", assumptions.facts),
    Chapter("others", "models", "Models compared", models.facts),
    Chapter(
        "velocity",
        "flow",
        "Velocity fields and downwash",
        flow.facts,
        (FIT, *FLOW_PRODUCTS),
        "downwash fig3 fig4 fig5",
    ),
    Chapter("flight", "safety", "Safety", safety.facts, (SAFETY,), "fig6 safety"),
    Chapter("flight", "proximity", "Proximity", proximity.facts, (DETECTION, PROXIMITY)),
    Chapter("origin", "provenance", "Inputs, versions and command", records.provenance, ()),
)

FIGURES: tuple[FigureSpec, ...] = tuple(f for chapter in CHAPTERS for f in chapter.figures)
