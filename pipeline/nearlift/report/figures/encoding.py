"""A drawn figure as bytes: PDF and PNG for print, a light WebP for the page. The same table gives
the same bytes.
"""

from __future__ import annotations

import gc
import io
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from matplotlib.ticker import AutoLocator, MaxNLocator
from matplotlib.transforms import Bbox
from PIL import Image

from nearlift.report.figures.style import Style, context

Draw = Callable[[Mapping[str, Any], Style], Figure]
#: Colours of a PNG for print: what is drawn here has few, and so a third of the bytes.
PRINT_COLOURS = 256
#: Width in pixels of the pictures in index.html, and their colours: a tenth of the bytes.
PAGE_WIDTH = 1200
COLOURS = 32
#: Parts into which ticks divide an axis, at most.
TICKS = 5
#: Decimal places of where a panel stands, as parts of the figure's width and height.
PLACES = 6


@contextmanager
def _swept_once() -> Iterator[None]:
    """Garbage is collected afterwards, among what was made meanwhile: matplotlib makes so many
    objects that to look among all of them as they come takes an eighth of the time.
    """
    if not gc.isenabled():
        yield
        return
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.collect()
        gc.unfreeze()


@_swept_once()
def render(draw: Draw, table: Mapping[str, object], look: Style) -> dict[str, bytes]:
    """Draw once and encode: ``{"pdf": ..., "png": ..., "page": ...}``, free of dates and of the
    software's name.
    """
    with context(look):
        figure = draw(table, look)
        _thin_out(figure)
        _measured_once(figure)
        # laid out once, with the letters of the PDF, which are free of pixels
        FigureCanvasPdf(figure)
        if (layout := figure.get_layout_engine()) is not None:
            layout.execute(figure)
            figure.set_layout_engine(None)
            _settle(figure)
        pdf = io.BytesIO()
        nameless = {"CreationDate": None, "Producer": None, "Creator": None}
        figure.savefig(pdf, format="pdf", dpi=look.dpi, metadata=nameless)
        figure.set_dpi(look.dpi)
        canvas: Any = FigureCanvasAgg(figure)
        canvas.draw()
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        png = io.BytesIO()
        _few(picture, PRINT_COLOURS).save(png, "PNG", dpi=(look.dpi, look.dpi))
        return {"pdf": pdf.getvalue(), "png": png.getvalue(), "page": light(picture)}


def _thin_out(figure: Figure) -> None:
    """Fewer numbers along axes whose ticks nobody chose: half of the time goes into ticks."""
    for axis in (axis for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)):
        if isinstance(axis.get_major_locator(), AutoLocator):
            axis.set_major_locator(MaxNLocator(TICKS, steps=[1, 2, 2.5, 5, 10]))


def _measured_once(figure: Figure) -> None:
    """Spare what asks for all ticks of an axis again: spines, beyond which no tick reaches since
    all point inwards, and the place of a label without words. Nothing moves.
    """
    for ax in figure.axes:
        for spine in ax.spines.values():
            spine.set_in_layout(False)
            spine.axis = None
        for axis in (ax.xaxis, ax.yaxis):
            if not axis.get_label_text():
                axis.set_label_coords(0.5, 0.5)


def _settle(figure: Figure) -> None:
    """Round the places of all panels: the solver's last digits depend on where in memory its
    unknowns stand.
    """
    for part in figure.subfigs:
        box: Any = part.bbox_relative
        box.p0, box.p1 = np.round(box.p0, PLACES), np.round(box.p1, PLACES)
    for ax in figure.axes:
        place = ax.get_position(original=True)
        ax.set_position(Bbox(np.round(place.get_points(), PLACES)))


def _few(picture: Image.Image, colours: int) -> Image.Image:
    return picture.quantize(colours, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)


def light(picture: Image.Image) -> bytes:
    """The same picture for a page: at most `PAGE_WIDTH` wide, with a palette, as lossless WebP."""
    if picture.width > PAGE_WIDTH:
        size = PAGE_WIDTH, round(picture.height * PAGE_WIDTH / picture.width)
        picture = picture.resize(size, Image.Resampling.HAMMING)
    sink = io.BytesIO()
    _few(picture, COLOURS).convert("RGB").save(sink, "WEBP", lossless=True, quality=40, method=4)
    return sink.getvalue()
