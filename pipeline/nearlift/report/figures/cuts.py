"""Picture of records that are cut into trials: force against time, kept pieces shaded."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from nearlift.readers.segments import Segmented
from nearlift.report.figures.style import SERIES, Style, context, plain_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Records in one picture, and points of a line: more than a page has pixels show nothing.
MOST_RECORDS, MOST_POINTS = 12, 4000
HEIGHT_IN = 1.6


def picture(records: Sequence[Segmented], rate_Hz: float) -> bytes:
    """The first records as PNG, one below the other.

    Force in N as read, the tare in it; behind it each kept piece from its first settled sample on,
    with its number. What is not shaded is thrown away.
    """
    from matplotlib.figure import Figure

    shown = [r for r in records if len(r.record.force_N)][:MOST_RECORDS]
    look, rows = Style(), max(len(shown), 1)
    with context(look):
        figure = Figure(figsize=(look.double_in, HEIGHT_IN * rows + 0.6))
        axes = figure.subplots(rows, 1, squeeze=False)[:, 0]
        for ax, record in zip(axes, shown, strict=False):
            _draw(ax, record, rate_Hz)
        axes[-1].set_xlabel("time from the record's first sample (s)")
        figure.tight_layout()
        out = io.BytesIO()
        figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


def _draw(ax: Axes, whole: Segmented, rate_Hz: float) -> None:
    force = whole.record.force_N
    step = max(math.ceil(len(force) / MOST_POINTS), 1)
    ax.plot(
        np.arange(0, len(force), step) / rate_Hz, force[::step], color=SERIES[0][0], linewidth=0.6
    )
    kept = {piece.number for piece in whole.pieces}
    for piece in (p for p in whole.cuts.pieces if p.number in kept):
        ax.axvspan(piece.start / rate_Hz, piece.end / rate_Hz, color=SERIES[4][0], alpha=0.35, lw=0)
        ax.text(
            (piece.start + piece.end) / 2 / rate_Hz,
            0.96,
            str(piece.number),
            transform=ax.get_xaxis_transform(),
            ha="center",
            va="top",
            fontsize="x-small",
        )
    ax.set_ylabel("force (N)")
    title = f"{whole.record.trial}: {len(kept)} pieces, {whole.cuts.short} too short"
    ax.set_title(plain_text(title), loc="left", fontsize="small")
    ax.set_xlim(0, len(force) / rate_Hz)
