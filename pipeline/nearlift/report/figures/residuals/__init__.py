"""Residuals of the base model against every covariate, on paper and as an interactive chart."""

from nearlift.report.figures.residuals import chart, drawing, table
from nearlift.report.figures.spec import FigureSpec
from nearlift.stages.fit import FIT
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT

FIGURE = FigureSpec(
    name="residuals",
    title="Residuals of the base model",
    needs=(TRIALS, FIT),
    summarise=table.summarise,
    draw=drawing.draw,
    caption=table.caption,
    alt=table.alt,
    chart=chart.chart,
    chart_needs=(LIFT,),
)
