"""A drawn figure as files: PDF for print, PNG for the page and for slides."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from matplotlib.ticker import AutoLocator, MaxNLocator
from PIL import Image

from nearlift.report.figures.style import DPI, Style, context

Draw = Callable[[Mapping[str, Any], Style], Figure]
#: Intervals between the ticks of an axis, at most.
TICKS = 5
#: A PDF without date and program, so that version control sees no change where there is none.
METADATA = {"CreationDate": None, "Producer": None, "Creator": None}


def drawn(draw: Draw, table: Mapping[str, object], look: Style) -> Figure:
    """The figure as the report shows it."""
    with context(look):
        figure = draw(table, look)
        _simplify_axes(figure)
        if look.simulated:
            _mark(figure, look)
        return figure


def render(draw: Draw, table: Mapping[str, object], look: Style) -> dict[str, bytes]:
    """Draw a figure and save it: ``{"pdf": ..., "png": ...}``."""
    with context(look):
        figure = drawn(draw, table, look)
        # one layout for both files, by the letters of the PDF
        FigureCanvasPdf(figure)
        if (layout := figure.get_layout_engine()) is not None:
            layout.execute(figure)
            figure.set_layout_engine(None)
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


def _mark(figure: Figure, look: Style) -> None:
    """Say in the image that the records are simulated."""
    share = 0.14 / float(figure.get_figheight())
    layout: Any = figure.get_layout_engine()
    if layout is not None:
        layout.set(rect=(0.012, share, 0.976, 1 - share))
    text: dict[str, Any] = {
        "ha": "right",
        "va": "bottom",
        "color": "0.35",
        "fontsize": look.text_pt - 1,
    }
    figure.text(0.995, 0.1 * share, "simulated records, not measured", **text, in_layout=False)


def _simplify_axes(figure: Figure) -> None:
    """Set fewer ticks along axes that have matplotlib's own, and measure each axis once.

    Spines and empty labels would be measured with all ticks again, an eighth of the time; they
    take no room, since all ticks point inwards.
    """
    for ax in figure.axes:
        for spine in ax.spines.values():
            spine.set_in_layout(False)
            spine.axis = None
        for axis in (ax.xaxis, ax.yaxis):
            if isinstance(axis.get_major_locator(), AutoLocator):
                axis.set_major_locator(MaxNLocator(TICKS, steps=[1, 2, 2.5, 5, 10]))
            if not axis.get_label_text():
                axis.set_label_coords(0.5, 0.5)
