"""Figure 2: three panels of Delta L against distance, on a logarithmic axis.

Distances go from a tenth of a radius to ten and more: only a logarithmic axis shows the structure
near the boundary and the farthest station at once, without a break.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from nearlift.nomenclature import INDEXED
from nearlift.report.evidence import Rows, distinct, where
from nearlift.report.figures.style import (
    BAND,
    FITTED,
    NESTED,
    OVERLAYS,
    REFERENCES,
    SEQUENTIAL,
    SERIES,
    Style,
    circles,
    distance,
    headed,
    plain_log,
    plain_text,
)

Corner = Literal["upper right", "lower right"]
#: About zero: how well L_inf is known.
UNSURE = "#CFE3F3"


def draw(table: Rows, look: Style) -> Figure:
    """Panels for the boundaries present, the throttles' legend (or colour bar) once, a legend of
    curves in each panel.
    """
    panels = distinct(table["panel"])
    factor, label = distance(look)
    table = {**table, "z_hat": factor * table["z_hat"]}
    width = look.single_in if len(panels) == 1 else look.double_in
    height = {1: 0.86, 2: 0.46, 3: 0.40}[len(panels)] * width
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    throttles = np.unique(where(table, kind="data")["throttle_fraction"])
    shade = None
    if len(throttles) > len(SERIES):
        ends = Normalize(100 * throttles.min(), 100 * throttles.max())
        shade = ScalarMappable(ends, SEQUENTIAL)
    for title, boundary, ax in zip(headed(panels), panels, axes, strict=True):
        loc: Corner = "lower right" if boundary == "sidewall" else "upper right"
        _panel(ax, where(table, panel=boundary), throttles, shade, loc)
        without = len(where(table, panel=boundary, kind="without")["label"])
        out = f", corrected for effect{'s' * (without > 1)}" if without else ""
        ax.set_title(title + out)
        ax.set_xlabel(f"distance {label}")
    (reference, *_) = where(table, kind="L_inf")["label"]
    axes[0].set_ylabel(rf"$\Delta L$ from {reference} $L_\infty$ (%)")
    if shade is not None:
        figure.colorbar(shade, ax=axes.tolist(), label="throttle (%)", pad=0.02, aspect=30)
    else:
        handles = [Line2D([], [], linestyle="none")]
        handles += [
            Line2D([], [], color=c, marker=m, linestyle="none", markerfacecolor="white")
            for (c, m), _ in zip(SERIES, throttles, strict=False)
        ]
        names = ["throttle:", *(f"{100 * t:.3g} %" for t in throttles)]
        figure.legend(
            handles,
            names,
            loc="outside upper center",
            ncols=len(names),
            columnspacing=0.8,
            handletextpad=0.1,
            handlelength=1.4,
        )
    return figure


def _panel(ax: Axes, rows: Rows, throttles: Any, shade: ScalarMappable | None, loc: Corner) -> None:
    ax.set_xscale("log")
    zero = ax.axhline(0, color="0.6", linewidth=0.5, zorder=0.1)
    handles: list[Any] = []
    names: list[str] = []
    data, curve, overlays, fitted, theories, ring, level = (
        where(rows, kind=kind)
        for kind in ("data", "band", "overlay", "least squares", "model", "influence", "L_inf")
    )
    low, high = curve["lo90_percent"], curve["hi90_percent"]
    banded = bool(np.isfinite(low).any())
    for label in distinct(curve["label"]):
        handles += ax.plot(curve["z_hat"], curve["delta_L_percent"], color=FITTED, zorder=3)
        shown = INDEXED.sub(r"$\1_\2$", plain_text(label))
        names.append(f"{shown}, 90 %" if banded else shown)
    for i, throttle in enumerate(throttles):
        mine = where(data, throttle_fraction=throttle)
        if shade is None:
            colour, marker = SERIES[i]
            _bars(
                ax,
                mine,
                fmt=marker,
                color=colour,
                markerfacecolor="white",
                markeredgewidth=0.8,
                # throttles often fall on one another: each next symbol is smaller, so that all can
                # be seen
                markersize=NESTED[i] * rcParams["lines.markersize"],
                elinewidth=0.6,
                zorder=4,
            )
        else:
            _bars(
                ax,
                mine,
                fmt="o",
                color=shade.to_rgba(100 * throttle),
                markeredgewidth=0.3,
                markersize=2.2,
                elinewidth=0.3,
                alpha=0.7,
                zorder=2,
            )
    for mark, label in zip(OVERLAYS, distinct(overlays["label"]), strict=False):
        mine = where(overlays, label=label)
        handles.append(_bars(ax, mine, fmt=mark, color="0.25", elinewidth=0.5, zorder=2))
        names.append(plain_text(label))
    # theory, and the band of a fit that says little, may leave the panel; data and fit decide its
    # limits
    ax.set_ylim(ax.get_ylim())
    ax.set_xlim(ax.get_xlim())
    band = ax.fill_between(curve["z_hat"], low, high, color=BAND, linewidth=0, zorder=1)
    if banded:
        handles[:1] = [(band, handles[0])]
    for label in distinct(fitted["label"]):
        # thin, and in front of the band: the posterior's line is the one to read
        handles += ax.plot(
            fitted["z_hat"],
            fitted["delta_L_percent"],
            color=FITTED,
            linewidth=0.5 * rcParams["lines.linewidth"],
            zorder=2.8,
        )
        names.append(plain_text(label))
    for (colour, dashes), label in zip(REFERENCES, distinct(theories["label"]), strict=False):
        theory = where(theories, label=label)
        handles += ax.plot(
            theory["z_hat"], theory["delta_L_percent"], color=colour, linestyle=dashes, zorder=2.5
        )
        names.append(plain_text(label))
    # about symbols or, where throttles are many, about dots
    size, width = (2.6, 0.8) if shade is None else (1.2, 0.5)
    if len(ring["z_hat"]):
        handles += circles(
            ax,
            ring["z_hat"],
            ring["delta_L_percent"],
            FITTED,
            markerfacecolor="none",
            markersize=size * rcParams["lines.markersize"],
            markeredgewidth=width,
            zorder=5,
        )
        names.append("influential")
    (u,) = level["u_delta_L_percent"]
    if np.isfinite(u):
        handles.append((ax.axhspan(-u, u, color=UNSURE, linewidth=0, zorder=0), zero))
        names.append(r"uncertainty of $L_\infty$")
    plain_log(ax.xaxis)
    ax.legend(handles, names, loc=loc)


def _bars(ax: Axes, mine: Rows, **look: Any) -> Any:
    z_hat, delta, u = (mine[name] for name in ("z_hat", "delta_L_percent", "u_delta_L_percent"))
    return ax.errorbar(z_hat, delta, u, **look)
