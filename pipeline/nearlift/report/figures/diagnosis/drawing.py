"""The loop in pictures: a block for each boundary, headed by its verdict; above the residuals,
beneath them what follows.
"""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from nearlift.catalogue import titled
from nearlift.report.evidence import Rows, distinct, where
from nearlift.report.figures.diagnosis import panels as loop_panels
from nearlift.report.figures.residuals.drawing import in_units
from nearlift.report.figures.style import Style, plain_text

#: Heights in inches at 6.75 in of width.
TALL, LOW = 3.15, 1.72
#: What a candidate of two effects, beneath one another, takes more.
PAIR = 0.1


def draw(table: Rows, look: Style) -> Figure:
    """Blocks from top to bottom, no higher than the page."""
    table = in_units(table, look)
    boundaries = distinct(table["panel"])
    blocks = [where(table, panel=b) for b in boundaries]
    heights = [TALL + _more(b) if _two_lines(b) else LOW for b in blocks]
    height = min(look.double_in / 6.75 * sum(heights), look.height_in)
    figure = Figure(figsize=(look.double_in, height), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.04, h_pad=0.03, hspace=0.03, wspace=0.03)  # type: ignore[union-attr, call-arg]
    parts = figure.subfigures(len(blocks), 1, height_ratios=heights, squeeze=False)[:, 0]
    for part, boundary, block in zip(parts, boundaries, blocks, strict=True):
        verdict = where(block, part="verdict")
        kind, headline = str(verdict["kind"][0]), plain_text(titled(str(verdict["label"][0])))
        part.suptitle(
            f"{boundary.capitalize()}. {kind.capitalize()}: {headline}",
            x=0.008,
            ha="left",
            fontsize=look.text_pt + 0.5,
            fontweight="bold",
        )
        _block(part, block, look, named=kind == "effect")
    return figure


def _block(part: SubFigure, block: Rows, look: Style, named: bool) -> None:
    above = distinct(where(block, part="residual")["letter"])
    several = len(distinct(where(block, part="coefficient")["label"])) > 1
    wide = {"candidate": 1.7, "error": 0.9, "coefficient": 2.0 if several else 1.25}
    beneath = [(x, kind) for kind in wide for x in distinct(where(block, part=kind)["letter"])]
    widths = [wide[kind] for _, kind in beneath]
    if _two_lines(block):
        ratios = (1.0, 1.05 + 2.05 * _more(block) / TALL)
        two: Any = part.subfigures(2, 1, height_ratios=ratios, hspace=0.0)
        upper = two[0].subplots(1, max(len(above), 1), sharey=True, squeeze=False)[0]
        lower = (
            two[1].subplots(1, len(beneath), width_ratios=widths, squeeze=False)[0]
            if beneath
            else []
        )
    else:
        widths = [1.6] * len(above) + widths
        row = part.subplots(1, len(widths), width_ratios=widths, squeeze=False)[0]
        upper, lower = row[: len(above)], row[len(above) :]
    for ax, letter in zip(upper, above, strict=False):
        rows = where(block, letter=letter)
        loop_panels.residual(ax, rows, look, first=ax is upper[0])
        _title(ax, letter, f"residual {rows['when'][0]}" if named else "residual")
    for ax, (letter, kind) in zip(lower, beneath, strict=True):
        rows = where(block, letter=letter)
        if kind == "candidate":
            loop_panels.candidates(ax, rows)
            rejected = (rows["kind"] == "rejected").all()
            _title(ax, letter, "candidates, all rejected" if rejected else "candidates")
        elif kind == "error":
            loop_panels.error(ax, rows)
            _title(ax, letter, "held-out error")
        else:
            _title(loop_panels.coefficients(ax, rows), letter, "coefficient")


def _two_lines(block: Rows) -> bool:
    """Whether the residuals stand above what follows from them, and not beside it."""
    residuals = distinct(where(block, part="residual")["letter"])
    return "candidate" in block["part"] or len(residuals) > 1


def _more(block: Rows) -> float:
    """Height in inches that pairs of effects among the candidates need."""
    names = where(block, part="candidate")["label"].tolist()
    return PAIR * sum(" + " in name for name in names)


def _title(ax: Axes, letter: str, text: str) -> None:
    ax.set_title(f"{letter}) {text}", pad=3)
