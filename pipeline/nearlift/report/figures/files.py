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

from nearlift.report.figures.style import DPI, Style, context

Draw = Callable[[pd.DataFrame, Style], Figure]
#: Intervals between the ticks of an axis, at most.
TICKS = 5
#: Decimals of positions, as fractions of a figure. The layout's solver depends on the order of sets
#: in its last digits.
DECIMALS = 4
#: A PDF without date and program, so that version control sees no change where there is none.
METADATA = {"CreationDate": None, "Producer": None, "Creator": None}


def drawn(draw: Draw, table: pd.DataFrame, look: Style) -> Figure:
    """The figure as the report shows it, with its layout engine on."""
    with context(look):
        figure = draw(table, look)
        for axis in (axis for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)):
            if isinstance(axis.get_major_locator(), AutoLocator):
                axis.set_major_locator(MaxNLocator(TICKS, steps=[1, 2, 2.5, 5, 10]))
        if look.simulated:
            _mark(figure, look)
        return figure


def render(draw: Draw, table: pd.DataFrame, look: Style) -> dict[str, bytes]:
    """Draw a figure and save it: ``{"pdf": ..., "png": ...}``."""
    with context(look):
        figure = drawn(draw, table, look)
        # one layout for both files, by the letters of the PDF
        FigureCanvasPdf(figure)
        settle(figure)
        pdf, png = io.BytesIO(), io.BytesIO()
        figure.savefig(pdf, format="pdf", metadata=METADATA)
        figure.set_dpi(DPI)
        canvas: Any = FigureCanvasAgg(figure)
        canvas.draw()
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        # indexed colours take a third of the bytes
        picture.quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(
            png, "PNG", dpi=(DPI, DPI)
        )
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
    parts: list[Any] = [*figure.subfigs]
    for part in parts:
        parts += part.subfigs
        part.bbox_relative.p0 = np.round(part.bbox_relative.p0, DECIMALS)
        part.bbox_relative.p1 = np.round(part.bbox_relative.p1, DECIMALS)
    for ax in figure.axes:
        place = ax.get_position(original=True)
        ends = np.round([place.x0, place.y0, place.width, place.height], DECIMALS)
        ax.set_position((ends[0], ends[1], ends[2], ends[3]))
    for part in (figure, *parts):
        for text in part.texts:
            text.set_position(np.round(text.get_position(), DECIMALS).tolist())


def _mark(figure: Figure, look: Style) -> None:
    """Say in the image that the records are simulated."""
    share = 0.14 / float(figure.get_figheight())
    layout: Any = figure.get_layout_engine()
    if layout is not None:
        layout.set(rect=(0.012, share, 0.976, 1 - share))
    small, words = look.text_pt - 1, "simulated records, not measured"
    figure.text(
        0.995, 0.1 * share, words, ha="right", va="bottom", color="0.35", fontsize=small,
        in_layout=False,
    )  # fmt: skip
