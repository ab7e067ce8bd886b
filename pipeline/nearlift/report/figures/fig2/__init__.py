"""Figure 2: Delta L against distance at each boundary, on paper and as an interactive chart."""

from nearlift.report.figures.fig2 import caption, chart, drawing, table
from nearlift.report.figures.spec import FigureSpec
from nearlift.stages.fit import FIT
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT

FIGURE = FigureSpec(
    name="fig2",
    title="Lift change near each boundary",
    needs=(TRIALS, LIFT, FIT),
    summarise=table.summarise,
    draw=drawing.draw,
    caption=caption.caption,
    alt=caption.alt,
    chart=chart.chart,
)
