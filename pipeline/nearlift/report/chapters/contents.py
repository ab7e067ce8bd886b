"""The chapters of index.html, in order. A new chapter is one more entry and its template."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from nearlift.products import (
    DETECTION,
    DIAGNOSIS,
    FIT,
    FLOW_PRODUCTS,
    POSTERIOR,
    PROXIMITY,
    QUALITY,
    SAFETY,
    TRIALS,
    Product,
)
from nearlift.report.chapters import (
    assumptions,
    diagnosis,
    flow,
    ledger,
    models,
    posterior,
    proximity,
    records,
    safety,
    uncertainty,
    verdict,
)
from nearlift.report.documents import methods
from nearlift.report.evidence import Evidence


def nothing(evidence: Evidence) -> dict[str, Any]:
    """No facts: the chapter is its figures."""
    return {}


@dataclass(frozen=True, slots=True, kw_only=True)
class Chapter:
    """One chapter. It stands on the page when every product in `needs` exists.

    Attributes
    ----------
    name : str
        Anchor, and the template ``templates/<name>.html.j2`` unless it has only figures.
    title : str
    facts : callable
        Evidence to what the template prints.
    needs : tuple of Product
    figures : tuple of str
        Names of figures shown beneath, those that were made.
    charts : tuple of str
        Names of interactive charts; the figure of the same name then stands on paper only.
    template : bool
        Whether there is a template.
    pictures_lead : bool
        Whether the figures stand above the text instead of beneath it.
    """

    name: str
    title: str
    facts: Callable[[Evidence], dict[str, Any]] = nothing
    needs: tuple[Product, ...] = ()
    figures: tuple[str, ...] = ()
    charts: tuple[str, ...] = ()
    template: bool = True
    pictures_lead: bool = False


CHAPTERS: tuple[Chapter, ...] = (
    Chapter(name="verdict", title="Verdict", facts=verdict.facts, needs=(FIT,)),
    Chapter(
        name="fig2",
        title="Lift change near each boundary",
        needs=(FIT,),
        figures=("fig2",),
        charts=("fig2",),
        template=False,
    ),
    Chapter(
        name="diagnosis",
        title="What the residuals say",
        facts=diagnosis.facts,
        needs=(DIAGNOSIS,),
        figures=("diagnosis",),
        pictures_lead=True,
    ),
    Chapter(name="models", title="Models compared", facts=models.comparison, needs=(FIT,)),
    Chapter(
        name="prediction",
        title="Models compared by prediction",
        facts=uncertainty.held_out,
        needs=(FIT,),
    ),
    Chapter(
        name="posterior",
        title="What is believed after the data",
        facts=posterior.facts,
        needs=(FIT, POSTERIOR),
        figures=("corner", "prior_posterior"),
    ),
    Chapter(
        name="budget",
        title="Uncertainty budget",
        facts=uncertainty.budget,
        needs=(FIT,),
        figures=("budget",),
        pictures_lead=True,
    ),
    Chapter(
        name="limits",
        title="What the data cannot say",
        facts=uncertainty.limits,
        needs=(FIT,),
        figures=("profiles",),
    ),
    Chapter(
        name="safety",
        title="Safety",
        facts=safety.facts,
        needs=(SAFETY,),
        figures=("fig6", "safety", "crash_map", "routes"),
        pictures_lead=True,
    ),
    Chapter(
        name="proximity",
        title="Proximity",
        facts=proximity.facts,
        needs=(DETECTION, PROXIMITY),
        figures=("detection",),
        pictures_lead=True,
    ),
    Chapter(
        name="residuals",
        title="Residuals",
        needs=(FIT, TRIALS),
        figures=("residuals",),
        charts=("residuals",),
        template=False,
    ),
    Chapter(
        name="flow",
        title="Flow",
        facts=flow.facts,
        needs=(FIT, *FLOW_PRODUCTS),
        figures=("fig3", "fig4", "fig5", "flow_topology"),
        pictures_lead=True,
    ),
    Chapter(name="levels", title="Lift far from the boundary", facts=models.levels, needs=(FIT,)),
    Chapter(
        name="assumptions",
        title="What the ratio takes for granted",
        facts=assumptions.facts,
        needs=(FIT,),
        figures=("assumptions",),
    ),
    Chapter(name="noise", title="Noise and declared uncertainty", facts=models.noise, needs=(FIT,)),
    Chapter(name="quality", title="Quality ledger", facts=records.ledger, needs=(TRIALS, FIT)),
    Chapter(name="ledger", title="From raw byte to figure", facts=ledger.facts, needs=(QUALITY,)),
    Chapter(name="methods", title="Methods, for a paper", facts=methods.facts, needs=(TRIALS, FIT)),
    Chapter(name="provenance", title="Provenance", facts=records.provenance),
)
