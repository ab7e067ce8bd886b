"""Figure 2: Delta L against distance at each boundary, on paper and as an interactive chart."""

from nearlift.products import FIT, LIFT, TRIALS
from nearlift.report.figures.fig2 import chart, drawing, table
from nearlift.report.figures.spec import FigureSpec

FIGURE = FigureSpec(
    name="fig2",
    title="Lift change near each boundary",
    needs=(TRIALS, LIFT, FIT),
    summarise=table.summarise,
    draw=drawing.draw,
    caption=table.caption,
    alt=table.alt,
    chart=chart.chart,
)
