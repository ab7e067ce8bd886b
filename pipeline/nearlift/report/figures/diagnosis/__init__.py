"""The figure `diagnosis`: residual, candidates, held-out error and coefficient of each boundary."""

from nearlift.report.figures.diagnosis import caption, drawing, table
from nearlift.report.figures.spec import FigureSpec
from nearlift.stages.diagnose import DIAGNOSIS, LOOP_RESIDUALS
from nearlift.stages.fit import FIT
from nearlift.stages.ingest import TRIALS

FIGURE = FigureSpec(
    name="diagnosis",
    title="The loop: residual, candidates, error, coefficient",
    needs=(TRIALS, FIT, DIAGNOSIS, LOOP_RESIDUALS),
    summarise=table.summarise,
    draw=drawing.draw,
    caption=caption.caption,
    alt=caption.alt,
)
