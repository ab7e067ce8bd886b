"""Every interactive chart: what it needs, and how it is made. A new chart is one more entry, and
its name in a chapter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from nearlift.products import FIT, LIFT, TRIALS, Product
from nearlift.report.evidence import Evidence
from nearlift.report.figures.fig2 import chart as fig2
from nearlift.report.figures.residuals import chart as residuals
from nearlift.report.page.chart import Chart


@dataclass(frozen=True, slots=True, kw_only=True)
class ChartSpec:
    """One chart; it is made when every product in `needs` exists, and left out where it has no
    views.
    """

    name: str
    make: Callable[[Evidence], Chart]
    needs: tuple[Product, ...]


CHARTS: tuple[ChartSpec, ...] = (
    ChartSpec(name="fig2", make=fig2.chart, needs=(TRIALS, LIFT, FIT)),
    ChartSpec(name="residuals", make=residuals.chart, needs=(TRIALS, LIFT, FIT)),
)


def charts(evidence: Evidence) -> tuple[Chart, ...]:
    """Those that this campaign's products suffice for."""
    made = [spec.make(evidence) for spec in CHARTS if evidence.has(*spec.needs)]
    return tuple(chart for chart in made if chart.views)
