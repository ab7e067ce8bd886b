"""A series as a line of bars."""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray

BARS = "\u2581\u2582\u2583\u2584\u2585\u2586\u2587\u2588"
WIDTH = 24


def sparkline(values: FloatArray, width: int = WIDTH) -> str:
    """The mean of each of so many stretches of a series as bars; a gap where there is no number."""
    if len(values) == 0:
        return ""
    parts = np.array_split(values, min(width, len(values)))
    means = np.array(
        [np.mean(p[np.isfinite(p)]) if np.isfinite(p).any() else np.nan for p in parts]
    )
    known = means[np.isfinite(means)]
    low, span = (float(known.min()), float(np.ptp(known))) if len(known) else (0.0, 0.0)
    # what stands still is drawn in the middle
    place = np.where(np.isfinite(means), (means - low) / span if span > 0 else 0.5, 0)
    return "".join(
        " " if not np.isfinite(m) else BARS[min(int(p * len(BARS)), len(BARS) - 1)]
        for m, p in zip(means, place, strict=True)
    )
