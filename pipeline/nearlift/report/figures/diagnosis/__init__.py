"""The figure `diagnosis`: residual, candidates, held-out error and coefficient of each boundary."""

from nearlift.products import DIAGNOSIS, FIT, LOOP_RESIDUALS, TRIALS
from nearlift.report.figures.diagnosis import caption, drawing, table
from nearlift.report.figures.spec import FigureSpec

FIGURE = FigureSpec(
    name="diagnosis",
    title="The loop: residual, candidates, error, coefficient",
    needs=(TRIALS, FIT, DIAGNOSIS, LOOP_RESIDUALS),
    summarise=table.summarise,
    draw=drawing.draw,
    caption=caption.caption,
    alt=caption.alt,
)
