"""Each model parameter before the data, in grey, and after, in black: 90 % intervals in units of
the prior's.
"""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nearlift.products import FIT, POSTERIOR
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, select, stack, where
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import BAND, FITTED, Style, circles, labelled, note, plain_text
from nearlift.rounding import plain

#: Above this ratio of widths the prior still has a say; as `fit.prior` has it.
SHAPED = 0.3
#: The axis runs this far beyond the prior's interval at most; what lies farther is marked at the
#: edge.
BEYOND = 0.6


def summarise(evidence: Evidence) -> Columns:
    """A row for each parameter of each fitted model, base models first: `panel` (boundary), `model`
    (its title), `base` (1 or 0), `parameter`, `prior_lo90`, `prior_hi90`, `lo90`, `median`, `hi90`
    in the parameter's unit, the last three again as `low`, `middle`, `high` with the prior's
    interval going from 0 to 1, and `ratio`, the posterior's width over the prior's.
    """
    rows = []
    for boundary in evidence.boundaries:
        base = evidence.fits.base[boundary]
        fits = evidence.fits.boundaries[boundary].values()
        for fit in sorted(fits, key=lambda f: f.model != base):
            for name, posterior in fit.posterior.parameters.items() if fit.posterior else ():
                prior = posterior.prior
                width = prior.hi90 - prior.lo90
                rows.append(
                    {
                        "panel": boundary,
                        "model": fit.title,
                        "base": int(fit.model == base),
                        "parameter": name,
                        "prior_lo90": prior.lo90,
                        "prior_hi90": prior.hi90,
                        "lo90": posterior.lo90,
                        "median": posterior.median,
                        "hi90": posterior.hi90,
                        "low": (posterior.lo90 - prior.lo90) / width,
                        "middle": (posterior.median - prior.lo90) / width,
                        "high": (posterior.hi90 - prior.lo90) / width,
                        "ratio": posterior.width_ratio,
                    }
                )
    return stack(rows)


def caption(evidence: Evidence, table: Columns) -> str:
    """What the reader must know to read the figure, numbers included."""
    shaped, n = select(table, table["ratio"] > SHAPED), len(table["ratio"])
    columns = (shaped[name] for name in ("parameter", "model", "ratio"))
    kept = [f"{name} of {m} ({100 * ratio:.0f} %)" for name, m, ratio in zip(*columns, strict=True)]
    words = (
        f"All {n} parameters are known to better than {100 * SHAPED:.0f} % of their prior's width"
    )
    if kept:
        words = (
            f"{len(kept)} of {n} parameters keep more than {100 * SHAPED:.0f} % of their prior's"
            f" width: {', '.join(kept)}"
        )
    return (
        "Grey: each parameter's central 90 % before the data, from its declared prior, drawn from"
        " 0 to 1. Black: the same after the data, with the median; the number is the ratio of the"
        f" widths. {words}. An interval beside the grey says that prior and data disagree."
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    least, most = float(table["ratio"].min()), float(table["ratio"].max())
    times = f"{plain(least, 2)} to {plain(most, 2)} times as wide as the prior"
    return (
        f"Prior and posterior intervals of {len(table['ratio'])} parameters; the posterior is"
        f" {times}."
    )


def draw(table: Rows, look: Style) -> Figure:
    """One panel per boundary, beneath one another, sharing the axis."""
    panels = distinct(table["panel"])
    counts = [int((table["panel"] == p).sum()) for p in panels]
    height = min(0.2 * look.text_pt / 8 * sum(counts) + 0.45 * len(panels) + 0.4, look.height_in)
    figure = Figure(figsize=(look.double_in, height), layout="constrained")
    axes = figure.subplots(len(panels), 1, squeeze=False, sharex=True, height_ratios=counts)[:, 0]
    low = max(min(-0.05, float(table["low"].min()) - 0.05), -BEYOND)
    high = min(max(1.05, float(table["high"].max()) + 0.05), 1 + BEYOND)
    for letter, panel, ax in zip("abc", panels, axes, strict=False):
        _panel(ax, where(table, panel=panel), low, high)
        ax.set_title(f"{letter}) {panel}" if len(panels) > 1 else panel)
    note(axes[0], "width ratio", (1, 1), (4, 5), xycoords="axes fraction")
    axes[-1].set_xlabel("place between the ends of the prior's central 90 %")
    return figure


def _panel(ax: Axes, rows: Rows, low: float, high: float) -> None:
    n = len(rows["low"])
    places = range(n)
    ax.barh(places, [1.0] * n, height=0.62, color=BAND, linewidth=0)
    ax.hlines(places, rows["low"], rows["high"], color=FITTED, linewidth=2.2)
    circles(ax, rows["middle"], places, FITTED, markersize=3.4)
    for i, (middle, ratio) in enumerate(zip(rows["middle"], rows["ratio"], strict=True)):
        for beyond, edge, mark in ((middle < low, low, "<"), (middle > high, high, ">")):
            if beyond:
                ax.plot(edge, i, mark, color=FITTED, clip_on=False)
        ax.annotate(
            f"{ratio:.2f}" if ratio >= 0.095 else f"{ratio:.2g}",
            (1, i),
            xycoords=("axes fraction", "data"),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
        )
    labels = [
        f"{plain_text(m)}: {labelled(p, unit='')}"
        for m, p in zip(rows["model"], rows["parameter"], strict=True)
    ]
    ax.set_yticks(list(places), labels)
    for label, base in zip(ax.get_yticklabels(), rows["base"], strict=True):
        label.set_fontweight("bold" if base else "normal")
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(n - 0.5, -0.5)
    ax.set_xlim(low, high)


FIGURE = FigureSpec(
    name="prior_posterior",
    title="Prior against posterior",
    needs=(FIT, POSTERIOR),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
