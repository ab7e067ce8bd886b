"""A drawn figure as bytes: PDF and PNG for print, a smaller PNG for the page. The same table gives the same bytes."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from nearlift.figures.style import Style, context

Draw = Callable[[Mapping[str, Any], Style], Figure]
#: Resolution of the pictures in index.html.
PAGE_DPI = 200
#: Of what is a raster inside a PDF: clouds of thousands of dots.
RASTER_DPI = 300


def render(draw: Draw, table: Mapping[str, Any], look: Style) -> dict[str, bytes]:
    """Draw once and encode: ``{"pdf": ..., "png": ..., "page": ...}``, free of dates and of the software's name."""
    with context(look):
        figure = draw(table, look)
        FigureCanvasAgg(figure)
        # laid out once: the three files show the same picture
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        return {
            "pdf": _encode(figure, "pdf", RASTER_DPI, {"CreationDate": None, "Producer": None, "Creator": None}),
            "png": _encode(figure, "png", look.dpi, {"Software": None}),
            "page": _encode(figure, "png", PAGE_DPI, {"Software": None}),
        }


def _encode(figure: Figure, kind: str, dpi: int, metadata: dict[str, Any]) -> bytes:
    sink = io.BytesIO()
    figure.savefig(sink, format=kind, dpi=dpi, metadata=metadata)
    return sink.getvalue()
