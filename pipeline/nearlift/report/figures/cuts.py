"""Picture of records that are cut into trials: force against time, kept pieces shaded."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nearlift.readers.segments import Segmented
from nearlift.report.figures.style import SERIES, context, plain_text

#: Records in one picture, and points of a line: more than a page has pixels show nothing.
MOST_RECORDS, MOST_POINTS = 12, 4000
WIDTH_IN, HEIGHT_IN = 6.75, 1.6


def picture(records: Sequence[Segmented], rate_Hz: float) -> bytes:
    """The first records as PNG, one below the other.

    Force in N as read, with its tare; behind it each kept piece from its first settled sample on,
    with its number. What is not shaded is thrown away.
    """
    shown = [r for r in records if len(r.record.force_N)][:MOST_RECORDS]
    rows = max(len(shown), 1)
    with context():
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN * rows + 0.6), layout="constrained")
        axes = figure.subplots(rows, 1, squeeze=False)
        for ax, record in zip(axes[:, 0], shown, strict=False):
            _draw(ax, record, rate_Hz)
        axes[-1, 0].set_xlabel("time from the record's first sample (s)")
        out = io.BytesIO()
        figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


def _draw(ax: Axes, whole: Segmented, rate_Hz: float) -> None:
    force = whole.record.force_N
    step = max(math.ceil(len(force) / MOST_POINTS), 1)
    at_s = np.arange(0, len(force), step) / rate_Hz
    ax.plot(at_s, force[::step], color=SERIES[0][0], linewidth=0.6)
    kept = {piece.number for piece in whole.pieces}
    for piece in (p for p in whole.cuts.pieces if p.number in kept):
        start, end = piece.start / rate_Hz, piece.end / rate_Hz
        ax.axvspan(start, end, color=SERIES[4][0], alpha=0.35, linewidth=0)
        place = ax.get_xaxis_transform()
        ax.text((start + end) / 2, 0.96, str(piece.number), transform=place, ha="center", va="top")
    ax.set_ylabel("force (N)")
    title = f"{whole.record.trial}: {len(kept)} pieces, {whole.cuts.short} too short"
    ax.set_title(plain_text(title))
    ax.set_xlim(0, len(force) / rate_Hz)
