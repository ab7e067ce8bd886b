"""Profile likelihoods of the base models' coefficients, a panel each, their intervals marked, with
the parabola that a standard uncertainty implies.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nearlift.nomenclature import letter, mathematics
from nearlift.report.evidence import Evidence, Part, frame, groups, pick
from nearlift.report.figures import style
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import REFERENCES, SERIES, Style
from nearlift.stages.fit import FIT, PROFILES

#: Profiles are drawn up to this rise of chi2.
TOP = 6.5
LEVELS = {68: SERIES[2], 90: SERIES[4], 95: SERIES[1]}
#: Halves of a 90 % interval that differ by more than this are called lopsided.
LOPSIDED = 0.1
ACROSS = 4
COLUMNS = ("panel", "parameter", "unit", "kind", "x", "rise", "quadratic")


def table(evidence: Evidence) -> pd.DataFrame:
    """A row for each point of a curve and each interval.

    `kind` is ``profile``, or ``68``, ``90``, ``95`` for the ends of an interval. `rise` is the rise
    of chi2 of the profile, `quadratic` that of the parabola. An open end has no row.
    """
    parts: list[Part] = []
    for boundary in evidence.boundaries:
        model, entry = evidence.base(boundary)
        every = evidence.frame(PROFILES, boundary=boundary, model=model.name)
        every = every[every[["rise", "quadratic"]].min(axis=1) < TOP + 3]
        for name, interval in entry.profiles.items():
            curve = every[every["parameter"] == name]
            if not len(curve):
                continue
            about = {"panel": boundary, "parameter": name, "unit": entry.parameters[name].unit}
            x, rises = curve["value"], curve[["rise", "quadratic"]]
            parts.append({**about, "kind": "profile", "x": x, **rises})
            for level in LEVELS:
                ends = np.array([getattr(interval, f"{end}{level}") for end in ("lo", "hi")])
                ends = ends[np.isfinite(ends)]
                there = {str(c): np.interp(ends, x, rise) for c, rise in rises.items()}
                parts.append({**about, "kind": str(level), "x": ends, **there})
    return frame(parts, COLUMNS)


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
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
        ("The parabola suffices for", ", ".join(straight)),
        ("Upper over lower half of the 90 % interval:", "; ".join(lopsided)),
        ("No end of the profile:", "; ".join(open_ends)),
    )
    text = " ".join(f"{head} {which}." for head, which in said if which)
    return (
        "Rise of chi² above its minimum with one coefficient fixed and everything else optimised"
        " (line). Dashed: the parabola of its standard uncertainty. Base fits, without effects."
        f" Marks: ends of the 68, 90 and 95 % intervals. {text}"
    )


def draw(table: pd.DataFrame, look: Style) -> Figure:
    """Panels in rows of four, one axis of chi2."""
    panels = groups(table, "panel", "parameter", "unit")
    across = min(len(panels), ACROSS)
    down = -(-len(panels) // across)
    height = 1.9 * look.double_in / 6.75 * down + 0.4
    figure, axes = style.canvas(look, down, across, height, sharey=True)
    for ax in axes.flat[len(panels) :]:
        ax.set_axis_off()
    style.title(axes.flat, [boundary for boundary, *_ in panels])
    for ax, (boundary, name, unit) in zip(axes.flat, panels, strict=False):
        _panel(ax, pick(table, panel=boundary, parameter=name))
        ax.set_xlabel(mathematics(name) + (f" ({unit})" if unit != "1" else ""))
    for ax in axes[:, 0]:
        ax.set_ylabel(r"rise of $\chi^2$")
    handles, names = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=5 if across > 1 else 3)
    return figure


def _panel(ax: Axes, rows: pd.DataFrame) -> None:
    curve, (grey, dashes) = pick(rows, kind="profile"), REFERENCES[0]
    ax.plot(curve.x, curve.quadratic, color=grey, linestyle=dashes, label="parabola", zorder=1)
    ax.plot(curve.x, curve.rise, color=SERIES[0][0], label="profile", zorder=2)
    for level, (colour, marker) in LEVELS.items():
        ends = pick(rows, kind=str(level))
        ax.plot(
            ends.x, ends.rise, marker, color=colour, label=f"{level} %", zorder=3,
            markeredgecolor="white", markeredgewidth=0.4,
        )  # fmt: skip
        ax.vlines(ends.x, 0, ends.rise, color=colour, linewidth=0.6, zorder=1)
    ax.set_ylim(0, TOP)
    low, high = curve["x"][curve["rise"] < TOP].agg(["min", "max"])
    ax.set_xlim(low - 0.06 * (high - low), high + 0.06 * (high - low))
    ax.xaxis.set_major_locator(MaxNLocator(4))


FIGURE = FigureSpec(
    "profiles", "Profile likelihoods", (FIT, PROFILES), table, caption, draw, "rise",
    ("panel", "parameter"),
)  # fmt: skip
