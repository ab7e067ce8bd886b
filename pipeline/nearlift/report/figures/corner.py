"""Corner plots: the quoted coefficients, or the base model's where those have no draws."""

from __future__ import annotations

import importlib
import sys
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nearlift.declare import Boundary
from nearlift.nomenclature import letter
from nearlift.report.evidence import Evidence, frame
from nearlift.report.figures import style
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SERIES, TEXT_PT
from nearlift.rounding import plain
from nearlift.stages.diagnose import NOT_DIAGNOSED, QUOTED_POSTERIOR
from nearlift.stages.fit import FIT, POSTERIOR

COLUMNS = ("panel", "name", "draw", "value")
#: Draws that are drawn, evenly chosen.
MOST_DRAWS = 4000
#: Largest width of a panel, in inches.
MAX_PANEL_IN = 2.5
SAMPLERS = {"grid": "a grid", "emcee": "emcee", "none": "its closed form"}


def quoted_rows(evidence: Evidence, boundary: Boundary) -> pd.DataFrame:
    """Rows of quoted_posterior.parquet of a boundary; none before a diagnosis."""
    has = evidence.has(QUOTED_POSTERIOR)
    return evidence.frame(QUOTED_POSTERIOR, boundary=boundary) if has else pd.DataFrame()


def draws(evidence: Evidence, boundary: Boundary) -> pd.DataFrame:
    """Draws of the quoted coefficients, a column each; where there are none, of the parameters of
    the base model.
    """
    long = quoted_rows(evidence, boundary)
    if long.empty:
        model, _ = evidence.base(boundary)
        long = evidence.frame(POSTERIOR, boundary=boundary, model=model.name)
        long = long[long["parameter"].isin([p.name for p in model.parameters])]
    each = long.groupby("parameter", sort=False)["value"]
    return pd.DataFrame({str(name): x.to_numpy() for name, x in each})


def explanation(evidence: Evidence, boundary: Boundary) -> str:
    """Phrase for what the draws are of; empty where it is the quoted value itself."""
    quoted = evidence.quoted(boundary)
    if quoted.verdict != NOT_DIAGNOSED and quoted_rows(evidence, boundary).empty:
        return "base model alone"
    answers = max((c.answers for c in quoted.coefficients.values()), default=1)
    return f"best of {answers} explanations" if answers > 1 else ""


def table(evidence: Evidence) -> pd.DataFrame:
    """A row for each draw of each parameter: `panel` (boundary, then `explanation`), `name`,
    `draw`, `value`.
    """
    parts = []
    for boundary in evidence.boundaries:
        wide = draws(evidence, boundary)
        panel = ": ".join(filter(None, (boundary, explanation(evidence, boundary))))
        kept = np.unique(np.linspace(0, len(wide) - 1, min(len(wide), MOST_DRAWS)).astype(int))
        for name, x in wide.items():
            parts.append({"panel": panel, "name": name, "draw": kept, "value": x.iloc[kept]})
    return frame(parts, COLUMNS)


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
    """Caption, numbers included."""
    parts = ["Posterior: histograms of the draws; contours hold 50, 90, 99 %."]
    for boundary in evidence.boundaries:
        wide, (model, fit) = draws(evidence, boundary), evidence.base(boundary)
        sampler = SAMPLERS[fit.posterior.sampler if fit.posterior else "none"]
        which = explanation(evidence, boundary)
        text = f"{boundary.capitalize()}: {model.title}, {len(wide)} draws by {sampler}"
        text += f" ({which}; results.json has the quoted interval)" if which else ""
        # nan where a parameter has no spread
        r = np.nan_to_num(np.tril(wide.corr().to_numpy(), -1))
        if r.any():
            i, j = divmod(int(np.argmax(np.abs(r))), len(r))
            names = " and ".join(letter(str(wide.columns[k])) for k in (j, i))
            text += f"; strongest correlation {plain(float(r[i, j]), 2)}, of {names}"
        parts.append(f"{text}.")
    return " ".join(parts)


def _corner() -> Any:
    """Module of corner that draws arrays, without arviz, whose import takes longer."""
    absent = "arviz" not in sys.modules
    if absent:
        sys.modules["arviz"] = None  # type: ignore[assignment]
    try:
        return importlib.import_module("corner.core")
    finally:
        if absent:
            del sys.modules["arviz"]


def draw(table: pd.DataFrame) -> Figure:
    """A triangle of panels for each boundary."""
    corner = _corner()
    wide = {
        boundary: rows.pivot(index="draw", columns="name", values="value")[rows["name"].unique()]
        for boundary, rows in table.groupby("panel", sort=False)
    }
    sizes = [draws.shape[1] for draws in wide.values()]
    panel = min(style.DOUBLE_IN / sum(sizes), MAX_PANEL_IN)
    figure = Figure(figsize=(panel * sum(sizes), panel * max(sizes) + 0.2))
    blocks: Any = figure.subfigures(1, len(wide), squeeze=False, width_ratios=sizes)[0]
    heads = style.lettered([str(boundary) for boundary in wide])
    for block, head, draws, n in zip(blocks, heads, wide.values(), sizes, strict=True):
        low, high = draws.min(), draws.max()
        # a parameter without spread still has a place
        room = (1e-3 * draws.mean().abs().clip(lower=1e-6)).where(low == high, 0.0)
        corner.corner_impl(
            draws.to_numpy(), fig=block, labels=[style.labelled(str(name)) for name in draws],
            levels=(0.5, 0.9, 0.99), range=list(zip(low - room, high + room, strict=True)),
            color=SERIES[0][0], bins=30, smooth=1.0, plot_datapoints=False, max_n_ticks=3,
            label_kwargs={"fontsize": TEXT_PT}, quiet=True,
        )  # fmt: skip
        # a histogram alone has no axis on its left; fewer panels than elsewhere are no taller
        left = 0.32 / n + 0.08 if n > 1 else 0.15
        block.subplots_adjust(left=left, bottom=0.9 - 0.7 * n / max(sizes), top=0.9, wspace=0.16)
        block.suptitle(head, fontsize=TEXT_PT, x=0.02, ha="left")
        for ax in block.axes:
            ax.tick_params(labelsize=TEXT_PT - 1.5, labelrotation=0)
            ax.yaxis.set_label_coords(-0.46, 0.5)
            ax.xaxis.set_label_coords(0.5, -0.22)
            for axis in (ax.xaxis, ax.yaxis):
                if isinstance(axis.get_major_locator(), MaxNLocator):
                    axis.set_major_locator(MaxNLocator(3, prune="both"))
    return figure


FIGURE = FigureSpec(
    "corner", "Posterior", (FIT, POSTERIOR), table, caption, draw,
    "value", ("panel", "name"),
)  # fmt: skip
