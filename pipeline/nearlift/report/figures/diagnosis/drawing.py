"""The loop in pictures: a block for each boundary, headed by its verdict; above the residuals,
beneath them what follows.
"""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from nearlift.catalogue import titled
from nearlift.report.evidence import Rows, distinct, select
from nearlift.report.figures.diagnosis import clouds as loop_clouds
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
    blocks = [select(table, table["panel"] == b) for b in boundaries]
    heights = [
        TALL + _more(b)
        if (b["part"] == "candidate").any() or len(_letters(b, "residual")) > 1
        else LOW
        for b in blocks
    ]
    scale = look.double_in / 6.75
    figure = Figure(
        figsize=(look.double_in, min(scale * sum(heights), look.height_in)),
        layout="constrained",
    )
    figure.get_layout_engine().set(w_pad=0.04, h_pad=0.03, hspace=0.03, wspace=0.03)  # type: ignore[union-attr, call-arg]
    parts = figure.subfigures(len(blocks), 1, height_ratios=heights, squeeze=False)[:, 0]
    for part, boundary, block in zip(parts, boundaries, blocks, strict=True):
        verdict = select(block, block["part"] == "verdict")
        headline = plain_text(titled(str(verdict["label"][0])))
        kind = str(verdict["kind"][0])
        part.suptitle(
            f"{boundary.capitalize()}. {kind.capitalize()}: {headline}",
            x=0.008,
            ha="left",
            fontsize=look.text_pt + 0.5,
            fontweight="bold",
        )
        _block(part, block, look)
    return figure


def _block(part: SubFigure, block: Rows, look: Style) -> None:
    above = _letters(block, "residual")
    several = len(set(block["label"][block["part"] == "coefficient"].tolist())) > 1
    wide = {"candidate": 1.7, "error": 0.9, "coefficient": 2.0 if several else 1.25}
    beneath = [x for part_of in wide for x in _letters(block, part_of)]
    widths = [wide[str(_of(block, x)["part"][0])] for x in beneath]
    if (block["part"] == "candidate").any() or len(above) > 1:
        ratios = (1.0, 1.05 + 2.05 * _more(block) / TALL)
        two: Any = part.subfigures(2, 1, height_ratios=ratios, hspace=0.0)
        upper = two[0].subplots(1, max(len(above), 1), sharey=True, squeeze=False)[0]
        lower = (
            two[1].subplots(1, len(beneath), width_ratios=widths, squeeze=False)[0]
            if beneath
            else []
        )
    else:
        row = part.subplots(
            1, len(above) + len(beneath), width_ratios=[1.6] * len(above) + widths, squeeze=False
        )[0]
        upper, lower = row[: len(above)], row[len(above) :]
    for ax, letter in zip(upper, above, strict=False):
        loop_clouds.residual(ax, _of(block, letter), look, first=ax is upper[0])
        _title(ax, letter, _residual_title(block, letter))
    for ax, letter in zip(lower, beneath, strict=True):
        rows = _of(block, letter)
        kind = str(rows["part"][0])
        if kind == "candidate":
            loop_panels.candidates(ax, rows)
            rejected = (rows["kind"] == "rejected").all()
            _title(ax, letter, "candidates, all rejected" if rejected else "candidates")
        elif kind == "error":
            loop_panels.error(ax, rows)
            _title(ax, letter, "held-out error")
        else:
            _title(loop_panels.coefficients(ax, rows), letter, "coefficient")


def _more(block: Rows) -> float:
    """Height in inches that pairs of effects among the candidates need."""
    names = block["label"][block["part"] == "candidate"].tolist()
    return PAIR * sum(" + " in name for name in names)


def _residual_title(block: Rows, letter: str) -> str:
    verdict = str(block["kind"][block["part"] == "verdict"][0])
    if verdict != "effect":
        return "residual"
    return f"residual {_of(block, letter)['when'][0]}"


def _title(ax: Axes, letter: str, text: str) -> None:
    ax.set_title(f"{letter}) {text}", pad=3)


def _letters(block: Rows, part: str) -> list[str]:
    return distinct(block["letter"][block["part"] == part])


def _of(block: Rows, letter: str) -> dict[str, Any]:
    return select(block, block["letter"] == letter)
