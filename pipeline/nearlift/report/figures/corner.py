"""Corner plots: the quoted coefficients, or before a diagnosis the base model's parameters and one
throttle's L_inf.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pandas as pd
from corner.core import corner_impl
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nearlift import units
from nearlift.declare import Boundary
from nearlift.nomenclature import letter
from nearlift.report.evidence import Evidence, frame, pick
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import DEFAULT, SERIES, Style, labelled, lettered
from nearlift.rounding import plain
from nearlift.stages.diagnose import QUOTED_POSTERIOR
from nearlift.stages.fit import FIT, POSTERIOR

COLUMNS = ("panel", "name", "draw", "value")
#: Draws that are drawn, evenly chosen.
MOST_DRAWS = 4000
#: L_inf of a throttle, with the unit in which it is shown.
LEVEL = re.compile(r"L_inf_(\w+)\[(.+)\]")
#: Shares of the posterior within the contours.
REGIONS = (0.5, 0.9, 0.99)
#: Width of a panel, in inches.
MAX_PANEL_IN = 2.5
SAMPLERS = {"grid": "a grid", "emcee": "emcee", "none": "its closed form"}


def draws(evidence: Evidence, boundary: Boundary) -> pd.DataFrame:
    """Draws of the quoted coefficients, a column each.

    Where there are none, of the base model: its parameters, and L_inf at the highest throttle, in
    mN unless the manifest asks for another unit.
    """
    if evidence.has(QUOTED_POSTERIOR):
        long = evidence.frame(QUOTED_POSTERIOR, boundary=boundary)
        if len(long):
            each = long.groupby("parameter", sort=False)["value"]
            return pd.DataFrame({str(n): x.to_numpy() for n, x in each})
    model, _ = evidence.base(boundary)
    long = evidence.frame(POSTERIOR, boundary=boundary, model=model.name)
    wide = {n: x.to_numpy() for n, x in long.groupby("parameter", sort=False)["value"]}
    levels = [str(n) for n in wide if str(n).startswith("L_inf_N")]
    asked = evidence.campaign.report.units.force
    unit = "mN" if asked == "auto" else asked
    newtons, _ = units.to_si(unit, "force", "report.units.force")
    shown = {str(n): x for n, x in wide.items() if n not in levels}
    shown |= {n.replace("_N[", f"_{unit}["): wide[n] / newtons for n in levels[-1:]}
    return pd.DataFrame(shown)


def table(evidence: Evidence) -> pd.DataFrame:
    """A row for each draw of each parameter: `panel` (boundary), `name`, `draw`, `value`."""
    parts = []
    for boundary in evidence.boundaries:
        wide = draws(evidence, boundary)
        kept = np.unique(np.linspace(0, len(wide) - 1, min(len(wide), MOST_DRAWS)).astype(int))
        for name, x in wide.items():
            parts.append({"panel": boundary, "name": name, "draw": kept, "value": x.iloc[kept]})
    return frame(parts, COLUMNS)


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
    """Caption, numbers included."""
    parts = [
        "Posterior of the quoted coefficients: histograms of the draws; contours hold 50, 90, 99 %."
    ]
    for boundary in evidence.boundaries:
        wide, (model, fit) = draws(evidence, boundary), evidence.base(boundary)
        sampler = SAMPLERS[fit.posterior.sampler if fit.posterior else "none"]
        text = f"{boundary.capitalize()}: {model.title}, {len(wide)} draws by {sampler}"
        # nan where a parameter has no spread
        r = np.nan_to_num(np.tril(wide.corr().to_numpy(), -1))
        if r.any():
            i, j = divmod(int(np.argmax(np.abs(r))), len(r))
            names = [_word(str(wide.columns[k])) for k in (j, i)]
            text += f"; strongest correlation {plain(float(r[i, j]), 2)}, of {' and '.join(names)}"
        parts.append(f"{text}.")
    return " ".join(parts)


def _word(name: str) -> str:
    if level := LEVEL.fullmatch(name):
        return f"L∞ at {100 * float(level[2]):.3g} %"
    return letter(name)


def draw(table: pd.DataFrame, look: Style = DEFAULT) -> Figure:
    """A triangle of panels for each boundary."""
    boundaries = list(table["panel"].unique())
    wide = [
        pick(table, panel=b).pivot(index="draw", columns="name", values="value")[
            pick(table, panel=b)["name"].unique()
        ]
        for b in boundaries
    ]
    sizes = [w.shape[1] for w in wide]
    panel = min(look.double_in / sum(sizes), MAX_PANEL_IN)
    figure = Figure(figsize=(panel * sum(sizes), panel * max(sizes) + 0.2))
    blocks: Any = figure.subfigures(1, len(boundaries), squeeze=False, width_ratios=sizes)
    for title, drawn, block in zip(lettered(boundaries), wide, blocks[0], strict=True):
        low, high = drawn.min(), drawn.max()
        # a parameter without spread still has a place
        room = (1e-3 * drawn.mean().abs().clip(lower=1e-6)).where(low == high, 0.0)
        corner_impl(
            drawn.to_numpy(),
            fig=block,
            labels=[_label(str(n)) for n in drawn],
            levels=REGIONS,
            range=list(zip(low - room, high + room, strict=True)),
            color=SERIES[0][0],
            bins=30,
            smooth=1.0,
            plot_datapoints=False,
            max_n_ticks=3,
            label_kwargs={"fontsize": look.text_pt},
            quiet=True,
        )
        n = drawn.shape[1]
        # a histogram alone has no axis on its left; fewer panels than elsewhere are no taller
        left = 0.32 / n + 0.08 if n > 1 else 0.15
        bottom = 0.9 - 0.7 * n / max(sizes)
        block.subplots_adjust(left=left, bottom=bottom, top=0.9, wspace=0.16)
        block.suptitle(title, fontsize=look.text_pt, x=0.02, ha="left")
        for ax in block.axes:
            ax.tick_params(labelsize=look.text_pt - 1.5, labelrotation=0)
            ax.yaxis.set_label_coords(-0.46, 0.5)
            ax.xaxis.set_label_coords(0.5, -0.22)
            for axis in (ax.xaxis, ax.yaxis):
                if isinstance(axis.get_major_locator(), MaxNLocator):
                    axis.set_major_locator(MaxNLocator(3, prune="both"))
    return figure


def _label(name: str) -> str:
    if level := LEVEL.fullmatch(name):
        return rf"$L_\infty$ at {100 * float(level[2]):.3g} % ({level[1]})"
    return labelled(name)


FIGURE = FigureSpec(
    name="corner",
    title="Posterior of the quoted coefficients",
    needs=(FIT, POSTERIOR),
    rows=table,
    draw=draw,
    caption=caption,
    shows="value",
    within=("panel", "name"),
)
