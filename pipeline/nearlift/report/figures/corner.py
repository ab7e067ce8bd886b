"""Corner plots of the base models' posteriors, a boundary beside the other: histograms of the
parameters and one throttle's L_inf on the diagonal, regions of highest density beneath it.
"""

from __future__ import annotations

import itertools
import re
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, ScalarFormatter

from nearlift import units
from nearlift.declare import Boundary, FloatArray
from nearlift.nomenclature import letter
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, stack, where
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import FITTED, Style, headed, labelled
from nearlift.rounding import plain
from nearlift.stages.fit import FIT, POSTERIOR

COLUMNS = ("panel", "kind", "x_name", "y_name", "x_low", "x_high", "y_low", "y_high", "value")
BINS, CELLS = 40, 26
#: Binomial weights of neighbouring cells: counts of a few draws scatter more than the density.
WINDOW = np.array((1, 4, 6, 4, 1)) / 16
#: Shares of the draws between which an axis runs.
SHOWN = (0.001, 0.999)
#: L_inf of a throttle, with the unit in which it is shown.
LEVEL = re.compile(r"L_inf_(\w+)\[(.+)\]")
#: Share of the posterior within a region, and its grey.
REGIONS = {0.5: "#555555", 0.9: "#9A9A9A", 0.99: "#DADADA"}


def draws(evidence: Evidence, boundary: Boundary) -> dict[str, FloatArray]:
    """Draws of the base model's parameters, and of L_inf at the highest throttle, (n,) each; in
    mN unless the manifest asks for another unit.
    """
    model, _ = evidence.base(boundary)
    table = where(evidence.table(POSTERIOR), boundary=boundary, model=model.name)
    drawn = {n: where(table, parameter=n)["value"] for n in distinct(table["parameter"])}
    levels = [n for n in drawn if n.startswith("L_inf_N")]
    shown = {n: x for n, x in drawn.items() if n not in levels}
    asked = evidence.campaign.report.units.force
    unit = "mN" if asked == "auto" else asked
    newtons, _ = units.to_si(unit, "force", "report.units.force")
    return shown | {n.replace("_N[", f"_{unit}["): drawn[n] / newtons for n in levels[-1:]}


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each: `panel` (boundary), `kind` (histogram or region),
    `x_name`, `y_name` (empty for a histogram), the cell's `x_low`, `x_high`, `y_low`, `y_high`, and
    `value`: of a histogram the density over its greatest, of a region the share of the posterior
    that lies where it is at least as dense as here.
    """
    rows = []
    for boundary in evidence.boundaries:
        drawn = list(draws(evidence, boundary).items())
        for i, first in enumerate(drawn):
            parts = [_histogram(*first), *(_region(first, second) for second in drawn[i + 1 :])]
            rows += [{"panel": boundary, **part} for part in parts]
    return stack(rows, COLUMNS)


def _edges(x: FloatArray, bins: int) -> FloatArray:
    low, high = np.quantile(x, SHOWN)
    if not high > low:
        # a parameter without spread still has a place
        reach = 1e-3 * max(abs(float(low)), 1e-6)
        low, high = low - reach, high + reach
    margin = 0.04 * (high - low)
    return np.linspace(float(low - margin), float(high + margin), bins + 1)


def _histogram(name: str, x: FloatArray) -> dict[str, object]:
    edges = _edges(x, BINS)
    count = np.histogram(x, edges)[0]
    return {
        "kind": "histogram",
        "x_name": name,
        "x_low": edges[:-1],
        "x_high": edges[1:],
        "value": count / max(int(count.max()), 1),
    }


def _region(first: tuple[str, FloatArray], second: tuple[str, FloatArray]) -> dict[str, object]:
    (x_name, x), (y_name, y) = first, second
    x_edges, y_edges = _edges(x, CELLS), _edges(y, CELLS)
    count = np.histogram2d(x, y, (x_edges, y_edges))[0]
    for axis in (0, 1):
        count = np.apply_along_axis(np.convolve, axis, count, WINDOW, "same")
    order = np.argsort(-count, axis=None)
    share = np.empty(count.size)
    share[order] = np.cumsum(count.ravel()[order]) / count.sum()
    i, j = (index.ravel() for index in np.indices(count.shape))
    keep = (count.ravel() > 0) & (share < 0.995)
    i, j = i[keep], j[keep]
    return {
        "kind": "region",
        "x_name": x_name,
        "y_name": y_name,
        "x_low": x_edges[i],
        "x_high": x_edges[i + 1],
        "y_low": y_edges[j],
        "y_high": y_edges[j + 1],
        "value": share[keep],
    }


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption, numbers included."""
    shown = (
        "Posterior of each base model: histograms of the draws and, for each pair, the regions of"
        " highest density with 50, 90 and 99 %."
    )
    parts = [shown]
    for boundary in evidence.boundaries:
        drawn = draws(evidence, boundary)
        model, fit = evidence.base(boundary)
        n = next((len(x) for x in drawn.values()), 0)
        pairs = [
            (_correlation(x, y), _word(a), _word(b))
            for (a, x), (b, y) in itertools.combinations(drawn.items(), 2)
        ]
        text = (
            f"{boundary.capitalize()}: {model.title}, {n} draws by"
            f" {SAMPLERS[fit.posterior.sampler if fit.posterior else 'none']}"
        )
        if pairs:
            strongest, a, b = max(pairs, key=lambda pair: abs(pair[0]))
            text += f"; strongest correlation {plain(strongest, 2)}, of {a} and {b}"
        parts.append(f"{text}.")
    return " ".join(parts)


SAMPLERS = {"grid": "a grid", "emcee": "emcee", "none": "its closed form"}


def _correlation(x: FloatArray, y: FloatArray) -> float:
    return float(np.corrcoef(x, y)[0, 1]) if np.ptp(x) > 0 and np.ptp(y) > 0 else 0.0


def _word(name: str) -> str:
    if level := LEVEL.fullmatch(name):
        return f"L∞ at {100 * float(level[2]):.3g} %"
    return letter(name)


def alt(evidence: Evidence, table: Columns) -> str:
    """Description for screen readers."""
    parts = [
        f"{b.capitalize()}: {', '.join(_word(name) for name in draws(evidence, b))}."
        for b in evidence.boundaries
    ]
    return f"Corner plots of the posteriors. {' '.join(parts)}"


def draw(table: Rows, look: Style) -> Figure:
    """A triangle of panels for each boundary."""
    boundaries = distinct(table["panel"])
    names = {b: distinct(table["x_name"][table["panel"] == b]) for b in boundaries}
    sizes = [max(len(names[b]), 1) for b in boundaries]
    side = min(look.double_in / sum(sizes), 1.7 * look.double_in / 6.75)
    figure = Figure(figsize=(look.double_in, side * max(sizes) + 0.75), layout="constrained")
    blocks = figure.subfigures(1, len(boundaries), squeeze=False, width_ratios=sizes)[0]
    for title, boundary, block in zip(headed(boundaries), boundaries, blocks, strict=True):
        block.suptitle(title, fontsize=look.text_pt, x=0.02, ha="left")
        _triangle(block, where(table, panel=boundary), names[boundary], max(sizes))
    figure.legend(
        handles=[Patch(color=c, label=f"{100 * share:g} %") for share, c in REGIONS.items()],
        title="share of the posterior within",
        loc="outside lower center",
        ncols=len(REGIONS),
    )
    return figure


def _triangle(block: Any, rows: Rows, names: list[str], height: int) -> None:
    axes = block.subplots(height, len(names), squeeze=False)
    for i in range(height):
        for j, x_name in enumerate(names):
            ax = axes[i][j]
            if i >= len(names) or j > i:
                ax.set_axis_off()
                continue
            whole = where(rows, x_name=x_name, kind="histogram")
            if i == j:
                _draw_histogram(ax, whole)
            else:
                _draw_region(ax, where(rows, x_name=x_name, y_name=names[i]))
                if j == 0:
                    ax.set_ylabel(_label(names[i]))
                else:
                    ax.tick_params(labelleft=False)
            ax.xaxis.set_major_locator(MaxNLocator(3, prune="both"))
            ax.set_xlim(whole["x_low"].min(), whole["x_high"].max())
            if i == len(names) - 1:
                ax.set_xlabel(_label(x_name))
                ax.xaxis.set_major_formatter(_numbers())
            else:
                ax.tick_params(labelbottom=False)


def _numbers() -> ScalarFormatter:
    shown = ScalarFormatter(useOffset=False)
    shown.set_powerlimits((-4, 5))
    return shown


def _draw_histogram(ax: Axes, rows: Rows) -> None:
    ax.stairs(rows["value"], [*rows["x_low"], rows["x_high"][-1]], color=FITTED, linewidth=0.8)
    ax.set_ylim(0, 1.12)
    ax.set_yticks([])


def _draw_region(ax: Axes, rows: Rows) -> None:
    middles, places = [], []
    for low, high in (("x_low", "x_high"), ("y_low", "y_high")):
        width = rows[high][0] - rows[low][0]
        first = float(rows[low].min())
        place = np.rint((rows[low] - first) / width).astype(int)
        places.append(place)
        middles.append(first + width * (np.arange(int(place.max()) + 1) + 0.5))
    share = np.ones((len(middles[1]), len(middles[0])))
    share[places[1], places[0]] = rows["value"]
    levels, colours = zip(*REGIONS.items(), strict=True)
    ax.contourf(*middles, share, levels=[0.0, *levels], colors=colours)
    ax.yaxis.set_major_locator(MaxNLocator(3, prune="both"))
    ax.yaxis.set_major_formatter(_numbers())
    ax.set_ylim(rows["y_low"].min(), rows["y_high"].max())


def _label(name: str) -> str:
    if level := LEVEL.fullmatch(name):
        return rf"$L_\infty$ at {100 * float(level[2]):.3g} % ({level[1]})"
    return labelled(name)


FIGURE = FigureSpec(
    name="corner",
    title="Posterior of the base models",
    needs=(FIT, POSTERIOR),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
