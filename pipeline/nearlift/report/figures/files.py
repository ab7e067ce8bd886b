"""A drawn figure as files: PDF for print, PNG for the page and for slides."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from matplotlib.ticker import AutoLocator, MaxNLocator
from PIL import Image

from nearlift.report.figures import style
from nearlift.report.figures.style import DPI

Draw = Callable[[pd.DataFrame], Figure]
#: Intervals between the ticks of an axis, at most.
TICKS = 5
#: Decimals of positions, as fractions of a figure. The layout's solver depends on the order of sets
#: in its last digits.
DECIMALS = 4
#: A PDF without date and program, so that version control sees no change where there is none.
METADATA = {"CreationDate": None, "Producer": None, "Creator": None}


def drawn(draw: Draw, table: pd.DataFrame, simulated: bool = False) -> Figure:
    """The figure as the report shows it, with its layout engine on; marked where its records are
    simulated.
    """
    with style.context():
        figure = draw(table)
        for ax in figure.axes:
            # the layout would place all ticks again for each side of a frame, which is the panel's
            ax.spines[:].set_in_layout(False)
            for axis in (ax.xaxis, ax.yaxis):
                if isinstance(axis.get_major_locator(), AutoLocator):
                    axis.set_major_locator(MaxNLocator(TICKS, steps=[1, 2, 2.5, 5, 10]))
        if simulated:
            _mark(figure)
        return figure


def _mark(figure: Figure) -> None:
    """Say in the image that the records are simulated."""
    share = 0.14 / float(figure.get_figheight())
    layout: Any = figure.get_layout_engine()
    if layout is not None:
        layout.set(rect=(0.012, share, 0.976, 1 - share))
    figure.text(
        0.995, 0.1 * share, "simulated records, not measured", ha="right", va="bottom",
        color="0.35", fontsize=style.SMALL_PT, in_layout=False,
    )  # fmt: skip


def render(draw: Draw, table: pd.DataFrame, simulated: bool = False) -> dict[str, bytes]:
    """Draw a figure and save it: ``{"pdf": ..., "png": ...}``.

    The layout is solved once, with the letters of the PNG, and serves both files.
    """
    with style.context():
        figure = drawn(draw, table, simulated)
        figure.set_dpi(DPI)
        canvas: Any = FigureCanvasAgg(figure)
        settle(figure)
        canvas.draw()
        pdf, png = io.BytesIO(), io.BytesIO()
        # indexed colours take a third of the bytes
        Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB").quantize(
            256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
        ).save(png, "PNG", dpi=(DPI, DPI))
        # savefig would draw the whole figure once more, to find its size
        paper: Any = FigureCanvasPdf(figure)
        paper.print_pdf(pdf, metadata=METADATA)
    return {"pdf": pdf.getvalue(), "png": png.getvalue()}


def settle(figure: Figure) -> None:
    """Lay out once, round every position, and turn the layout engine off: the same bytes from every
    process.
    """
    engine = figure.get_layout_engine()
    if engine is None:
        return
    engine.execute(figure)
    figure.set_layout_engine("none")
    parts: list[Any] = [figure, *figure.subfigs]
    for part in parts[1:]:
        part.bbox_relative.p0 = np.round(part.bbox_relative.p0, DECIMALS)
        part.bbox_relative.p1 = np.round(part.bbox_relative.p1, DECIMALS)
    for ax in figure.axes:
        ax.set_position(np.round(ax.get_position(original=True).bounds, DECIMALS).tolist())
    for text in (text for part in parts for text in part.texts):
        text.set_position(np.round(text.get_position(), DECIMALS).tolist())
