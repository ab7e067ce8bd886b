"""Profile likelihoods of the base models' coefficients, a panel each, their intervals marked, with
the parabola that a standard uncertainty implies.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nearlift.nomenclature import letter, mathematics
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, select, stack, where
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import REFERENCES, SERIES, Style, headed
from nearlift.stages.fit import FIT, PROFILES

#: Profiles are drawn up to this rise of chi2.
TOP = 6.5
LEVELS = {68: SERIES[2], 90: SERIES[4], 95: SERIES[1]}
#: Halves of a 90 % interval that differ by more than this are called lopsided.
LOPSIDED = 0.1
COLUMNS = 4


def summarise(evidence: Evidence) -> Columns:
    """A row for each point of a curve and each interval: `panel` (boundary), `parameter`, `unit`,
    `kind` (``profile``, or ``68``, ``90``, ``95`` for the ends of an interval), `x`, `rise` of
    chi2, of an interval the profile's at that end, `quadratic` the parabola's. An open end has no
    row.
    """
    table = evidence.table(PROFILES)
    table = select(table, np.minimum(table["rise"], table["quadratic"]) < TOP + 3)
    rows = []
    for boundary in evidence.boundaries:
        model, entry = evidence.base(boundary)
        for name, interval in entry.profiles.items():
            curve = where(table, boundary=boundary, model=model.name, parameter=name)
            x, rise, quadratic = (curve[c] for c in ("value", "rise", "quadratic"))
            if not len(x):
                continue
            parts = [{"kind": "profile", "x": x, "rise": rise, "quadratic": quadratic}]
            for level in LEVELS:
                ends = np.array([getattr(interval, f"{end}{level}") for end in ("lo", "hi")])
                ends = ends[np.isfinite(ends)]
                there = {
                    "rise": np.interp(ends, x, rise),
                    "quadratic": np.interp(ends, x, quadratic),
                }
                parts.append({"kind": str(level), "x": ends, **there})
            shared = {"panel": boundary, "parameter": name, "unit": entry.parameters[name].unit}
            rows += [{**shared, **part} for part in parts]
    return stack(rows)


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption, with the cases where the parabola misleads."""
    lopsided, straight, open_ends = [], [], []
    for boundary in evidence.boundaries:
        for name, profile in evidence.base(boundary)[1].profiles.items():
            what = f"{letter(name)} ({boundary})"
            if profile.open:
                ends = sorted({end for ends in profile.open.values() for end in ends})
                open_ends.append(f"{what}: no {' or '.join(ends)} end within the bounds")
            elif abs(np.log(profile.skew)) > LOPSIDED:
                lopsided.append(f"{what}: {profile.skew:.2f}")
            else:
                straight.append(what)
    said = (
        ("the parabola suffices for", ", ".join(straight)),
        ("upper over lower half of the 90 % interval:", "; ".join(lopsided)),
        ("no end of the profile:", "; ".join(open_ends)),
    )
    text = ". ".join(f"{head[0].upper()}{head[1:]} {which}" for head, which in said if which)
    return (
        "Rise of chi² above its minimum with one coefficient fixed and everything else optimised"
        " (line). Dashed: the parabola of its standard uncertainty. Base fits, without effects."
        " Marks: ends of the 68, 90 and 95 % intervals."
        f" {text}."
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """Description for screen readers."""
    n = len(distinct(table["panel"], table["parameter"]))
    return (
        f"Curves of chi² against the coefficient in {n} panel{'s' if n != 1 else ''}, each with a"
        " parabola. " + caption(evidence, table).rsplit("intervals. ", 1)[1]
    )


def draw(table: Rows, look: Style) -> Figure:
    """Panels in rows of four, one axis of chi2."""
    panels = distinct(table["panel"], table["parameter"])
    columns = min(len(panels), COLUMNS)
    rows = -(-len(panels) // columns)
    width = look.single_in if columns == 1 else look.double_in
    height = 1.9 * look.double_in / 6.75 * rows + (0.25 if columns > 1 else 0.4)
    figure = Figure(figsize=(width, min(height, look.height_in)), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for ax in axes.flat[len(panels) :]:
        ax.set_axis_off()
    titles = headed([boundary for boundary, _ in panels])
    for ax, title, (boundary, parameter) in zip(axes.flat, titles, panels, strict=False):
        mine = where(table, panel=boundary, parameter=parameter)
        _panel(ax, mine, look)
        unit = str(mine["unit"][0])
        ax.set_xlabel(mathematics(parameter) + (f" ({unit})" if unit != "1" else ""), labelpad=1)
        ax.set_title(title)
    for line in axes:
        line[0].set_ylabel(r"rise of $\chi^2$")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=len(labels) if columns > 1 else 3
    )
    return figure


def _panel(ax: Axes, rows: Rows, look: Style) -> None:
    curve, (grey, dashes) = where(rows, kind="profile"), REFERENCES[0]
    x, rise = curve["x"], curve["rise"]
    ax.plot(x, curve["quadratic"], color=grey, linestyle=dashes, label="parabola", zorder=1)
    ax.plot(x, rise, color=SERIES[0][0], label="profile", zorder=2)
    for level, (colour, marker) in LEVELS.items():
        ends = where(rows, kind=str(level))
        ax.plot(
            ends["x"],
            ends["rise"],
            marker,
            color=colour,
            markersize=look.marker_pt + 0.6,
            markeredgecolor="white",
            markeredgewidth=0.4,
            label=f"{level} %",
            zorder=3,
        )
        ax.vlines(ends["x"], 0, ends["rise"], color=colour, linewidth=0.6, zorder=1)
    ax.set_ylim(0, TOP)
    low, high = x[rise < TOP].min(), x[rise < TOP].max()
    margin = 0.06 * (high - low)
    ax.set_xlim(low - margin, high + margin)
    ax.xaxis.set_major_locator(MaxNLocator(4))


FIGURE = FigureSpec(
    name="profiles",
    title="Profile likelihoods",
    needs=(FIT, PROFILES),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
