"""Corner plots of the base models' posteriors: parameters and one throttle's L_inf."""

from __future__ import annotations

import itertools
import re
from typing import Any

import numpy as np
from corner.core import corner_impl
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nearlift import units
from nearlift.declare import Boundary, FloatArray
from nearlift.nomenclature import letter
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, stack, where
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SERIES, Style, headed, labelled
from nearlift.rounding import plain
from nearlift.stages.fit import FIT, POSTERIOR

COLUMNS = ("panel", "name", "draw", "value")
#: Draws that are drawn, evenly chosen.
MOST_DRAWS = 4000
#: L_inf of a throttle, with the unit in which it is shown.
LEVEL = re.compile(r"L_inf_(\w+)\[(.+)\]")
#: Shares of the posterior within the contours.
REGIONS = (0.5, 0.9, 0.99)
SAMPLERS = {"grid": "a grid", "emcee": "emcee", "none": "its closed form"}


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
    """A row for each draw of each parameter: `panel` (boundary), `name`, `draw`, `value`."""
    parts = []
    for boundary in evidence.boundaries:
        for name, x in draws(evidence, boundary).items():
            kept = np.unique(np.linspace(0, len(x) - 1, min(len(x), MOST_DRAWS)).astype(int))
            parts.append({"panel": boundary, "name": name, "draw": kept, "value": x[kept]})
    return stack(parts, COLUMNS)


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption, numbers included."""
    parts = [
        "Posterior of each base model: histograms of the draws; contours hold 50, 90 and 99 %."
    ]
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
    names = {b: distinct(where(table, panel=b)["name"]) for b in boundaries}
    sizes = [len(names[b]) for b in boundaries]
    figure = Figure(figsize=(look.double_in, look.double_in * max(sizes) / sum(sizes) + 0.2))
    blocks: Any = figure.subfigures(1, len(boundaries), squeeze=False, width_ratios=sizes)
    for title, boundary, block in zip(headed(boundaries), boundaries, blocks[0], strict=True):
        rows = where(table, panel=boundary)
        drawn = np.stack([where(rows, name=n)["value"] for n in names[boundary]], axis=1)
        centre, reach = drawn.mean(axis=0), np.ptp(drawn, axis=0)
        low, high = drawn.min(axis=0), drawn.max(axis=0)
        # a parameter without spread still has a place
        room = np.where(reach > 0, 0.0, 1e-3 * np.maximum(np.abs(centre), 1e-6))
        corner_impl(
            drawn,
            fig=block,
            labels=[_label(n) for n in names[boundary]],
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
        block.subplots_adjust(
            left=0.32 / len(names[boundary]) + 0.08, bottom=0.2, top=0.9, wspace=0.16
        )
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
    title="Posterior of the base models",
    needs=(FIT, POSTERIOR),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
