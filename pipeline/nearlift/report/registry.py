"""The chapters of index.html, in order, with their figures: the one list of what a report holds.

A new figure is its file and its name here; a new chapter its file, its template and its entry.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from markupsafe import Markup

from nearlift.report import charts as interactive
from nearlift.report.chapters import (
    assumptions,
    diagnosis,
    doubts,
    flow,
    models,
    posterior,
    proximity,
    records,
    safety,
    uncertainty,
    verdict,
)
from nearlift.report.charts import Chart
from nearlift.report.documents import methods
from nearlift.report.evidence import Evidence
from nearlift.report.figures.spec import FigureSpec
from nearlift.run.engine import Stage
from nearlift.run.tables import Product
from nearlift.stages import STAGES
from nearlift.stages.detect import DETECTION, PROXIMITY
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import FIT, POSTERIOR
from nearlift.stages.flow import FLOW_PRODUCTS
from nearlift.stages.ingest import TRIALS
from nearlift.stages.simulate import SAFETY


@dataclass(frozen=True, slots=True, kw_only=True)
class Chapter:
    """One chapter. It is on the page when every product in `needs` exists.

    Attributes
    ----------
    name, title : str
        Anchor, and the template ``templates/<name>.html.j2`` of `facts`; heading.
    facts : callable or None
        Evidence to what the template prints; None where the chapter is its figures.
    needs : tuple of Product
    part : str
        Of `PARTS`.
    figures : tuple of FigureSpec
        Shown below the text, those that were made.
    places : tuple of FigureSpec
        Those whose chart the template itself places.
    pictures : {"above", "beneath", "within"}
        Position of the figures; within the text the template places each.
    """

    name: str
    title: str
    part: str = "further"
    facts: Callable[[Evidence], Mapping[str, object] | Markup] | None = None
    needs: tuple[Product, ...] = (FIT,)
    figures: tuple[FigureSpec, ...] = ()
    places: tuple[FigureSpec, ...] = ()
    pictures: Literal["above", "beneath", "within"] = "beneath"


def _figures(*names: str) -> tuple[FigureSpec, ...]:
    """Figures that these modules declare."""
    return tuple(importlib.import_module(f"nearlift.report.figures.{n}").FIGURE for n in names)


def declared(stages: Iterable[Stage]) -> tuple[Chapter, ...]:
    """The chapters that stages declare; each is on the page when all that its stage writes
    exists.
    """
    chapters = []
    for stage in stages:
        if stage.chapter is None:
            continue
        module, _, name = stage.chapter.facts.partition(":")
        chapters.append(
            Chapter(
                name=stage.name,
                title=stage.chapter.title,
                facts=getattr(importlib.import_module(module), name) if module else None,
                needs=stage.writes,
                figures=_figures(*stage.chapter.figures),
            )
        )
    return tuple(chapters)


#: What the contents list names, in order; the first part is the first screen.
PARTS = {
    "verdict": "Answer",
    "why": "Why",
    "number": "The number",
    "data": "The data",
    "others": "Other models",
    "velocity": "Flow",
    "flight": "Flight",
    "further": "Further",
    "paper": "Methods",
    "origin": "Provenance",
}

CHAPTERS: tuple[Chapter, ...] = (
    Chapter(
        name="verdict",
        title="Verdict",
        part="verdict",
        facts=verdict.facts,
        places=_figures("fig2"),
    ),
    Chapter(
        name="diagnosis",
        title="Diagnosis",
        part="why",
        facts=diagnosis.facts,
        needs=(DIAGNOSIS,),
        figures=_figures("diagnosis"),
        pictures="above",
    ),
    Chapter(
        name="doubts",
        title="Doubts, and coefficients under other assumptions",
        part="number",
        facts=doubts.facts,
    ),
    Chapter(
        name="budget",
        title="Uncertainty budget",
        part="number",
        facts=uncertainty.budget,
        figures=_figures("budget"),
        pictures="above",
    ),
    Chapter(
        name="limits",
        title="Degeneracies",
        part="number",
        facts=uncertainty.limits,
        figures=_figures("profiles"),
    ),
    Chapter(
        name="posterior",
        title="Posterior",
        part="number",
        facts=posterior.facts,
        needs=(FIT, POSTERIOR),
        figures=_figures("corner"),
    ),
    Chapter(
        name="levels",
        title="Lift far from the boundary",
        part="number",
        facts=models.levels,
    ),
    Chapter(
        name="fig2",
        title="Figure 2: lift change near each boundary",
        part="data",
        figures=_figures("fig2"),
    ),
    Chapter(
        name="residuals",
        title="Residuals",
        part="data",
        needs=(FIT, TRIALS),
        figures=_figures("residuals"),
    ),
    Chapter(
        name="noise",
        title="Noise and stated uncertainty",
        part="data",
        facts=models.noise,
    ),
    Chapter(
        name="quality",
        title="Quality of trials",
        part="data",
        facts=records.quality,
        needs=(TRIALS, FIT),
    ),
    Chapter(
        name="trial_table",
        title="Trial table and influence",
        part="data",
        facts=records.trial_table,
        needs=(TRIALS, FIT),
    ),
    Chapter(
        name="assumptions",
        title="Assumptions behind Delta L",
        part="data",
        facts=assumptions.facts,
    ),
    Chapter(
        name="models",
        title="Models compared",
        part="others",
        facts=models.comparison,
    ),
    Chapter(
        name="prediction",
        title="Models compared by prediction",
        part="others",
        facts=uncertainty.held_out,
    ),
    Chapter(
        name="flow",
        title="Velocity fields and downwash",
        part="velocity",
        facts=flow.facts,
        needs=(FIT, *FLOW_PRODUCTS),
        figures=_figures("downwash", "fig3", "fig4", "fig5"),
        pictures="within",
    ),
    Chapter(
        name="safety",
        title="Safety",
        part="flight",
        facts=safety.facts,
        needs=(SAFETY,),
        figures=_figures("fig6", "safety"),
        pictures="within",
    ),
    Chapter(
        name="proximity",
        title="Proximity",
        part="flight",
        facts=proximity.facts,
        needs=(DETECTION, PROXIMITY),
        figures=_figures("detection"),
        pictures="within",
    ),
    *declared(STAGES),
    Chapter(
        name="methods",
        title="Methods, for a paper",
        part="paper",
        facts=methods.facts,
        needs=(TRIALS, FIT),
    ),
    Chapter(
        name="provenance",
        title="Provenance",
        part="origin",
        facts=records.provenance,
        needs=(),
    ),
)

FIGURES: tuple[FigureSpec, ...] = tuple(f for chapter in CHAPTERS for f in chapter.figures)


def charts(evidence: Evidence) -> tuple[Chart, ...]:
    """The interactive charts that this campaign's products suffice for."""
    drawn = {"fig2": interactive.fig2, "residuals": interactive.residuals}
    made = [drawn[f.name](evidence) for f in FIGURES if f.name in drawn and evidence.has(*f.needs)]
    return tuple(chart for chart in made if chart.views)
