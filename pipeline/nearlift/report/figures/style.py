"""The look of figures: matplotlib's settings, sizes and colours, and the marks that they share."""

from __future__ import annotations

import string
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from nearlift import nomenclature
from nearlift.catalogue import titled
from nearlift.errors import UsageError
from nearlift.report.phrases import along

#: Width of one column and of the full text, in inches.
SINGLE_IN, DOUBLE_IN = 3.25, 6.75
#: Label of an axis of distance over rotor radius.
Z_HAT = r"$\hat{z}$"
#: Dots per inch of a PNG, and of what is a raster in a PDF.
DPI = 200
#: Height of a page in inches; type in points.
PAGE_IN, TEXT_PT, SMALL_PT = 9.0, 8.0, 7.0
SETTINGS: dict[str, Any] = {
    # the second serves letters that the first lacks
    "font.family": ["STIXGeneral", "DejaVu Sans"],
    "mathtext.fontset": "stix",
    "font.size": TEXT_PT,
    "axes.labelsize": TEXT_PT,
    "axes.titlesize": TEXT_PT,
    "figure.labelsize": TEXT_PT,
    "xtick.labelsize": SMALL_PT,
    "ytick.labelsize": SMALL_PT,
    "legend.fontsize": SMALL_PT,
    "legend.frameon": False,
    "legend.handlelength": 2.2,
    "legend.handletextpad": 0.5,
    "legend.borderaxespad": 0.4,
    "legend.labelspacing": 0.3,
    "axes.labelpad": 2.5,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.direction": "in",
    "ytick.direction": "in",
    # no title has to make way for labels above a panel, so none is moved
    "axes.titley": 1.0,
    "axes.titlelocation": "left",
    "lines.linewidth": 1.0,
    "lines.markersize": 3.2,
    "savefig.dpi": DPI,
    "pdf.fonttype": 42,
    "svg.hashsalt": "nearlift",
    "hatch.linewidth": 0.35,
}
#: Okabe and Ito's colours that are clear on white, each with its own marker, so that greyscale
#: keeps them apart.
SERIES = (
    ("#0072B2", "o"),
    ("#D55E00", "s"),
    ("#009E73", "^"),
    ("#CC79A7", "D"),
    ("#E69F00", "v"),
    ("#56B4E9", "P"),
)
#: Theory in grey and black, with different dashes.
REFERENCES: tuple[tuple[str, Any], ...] = (
    ("#555555", (0, (5, 2))),
    ("#111111", (0, (1, 1.2))),
    ("#777777", (0, (6, 1.5, 1, 1.5))),
)
FITTED, BAND = "#000000", "#C2C2C2"
#: The noise of a single trial.
FLOOR = "0.88"
#: A cloud of more dots than this is a raster in the PDF.
CLOUD = 3000


@contextmanager
def context() -> Iterator[None]:
    """Draw with these settings of matplotlib alone, and put the user's back afterwards."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        current: Any = matplotlib.rcParams
        current.update(SETTINGS)
        yield


def canvas(
    down: int, across: int, height_in: float, width_in: float = 0.0, **more: Any
) -> tuple[Figure, Any]:
    """A figure of rows and columns of panels, and its axes.

    It is one column wide if it has one panel across, and no higher than a page.
    """
    width = width_in or (SINGLE_IN if across == 1 else DOUBLE_IN)
    figure = Figure(figsize=(width, min(height_in, PAGE_IN)), layout="constrained")
    return figure, figure.subplots(down, across, squeeze=False, **more)


def lettered(titles: Sequence[str]) -> list[str]:
    """Titles of panels with their letters; without where there is one."""
    if len(titles) == 1:
        return [*titles]
    return [f"{a}) {name}" for a, name in zip(string.ascii_lowercase, titles, strict=False)]


def title(axes: Iterable[Axes], titles: Sequence[str]) -> None:
    """Title panels, with their letters where there are several."""
    for ax, text in zip(axes, lettered(titles), strict=False):
        ax.set_title(text)


def plain_log(axis: Axis) -> None:
    """Plain numbers along a logarithmic axis whose ends are set: 0.1, 0.2, 0.5, 1, ..."""
    low, high = axis.get_view_interval()
    wide = high > 500 * low
    axis.set_major_locator(
        LogLocator(subs=(1,) if wide else (1, 2, 5) if high > 20 * low else (1, 2, 3, 5))
    )
    axis.set_major_formatter("{x:g}")
    # ticks between decades show that the axis is logarithmic, unless their numbers do
    axis.set_minor_locator(LogLocator(subs=(2, 5) if wide else ()))
    axis.set_minor_formatter(NullFormatter())


def log_distance(ax: Axes, label: str) -> None:
    """A logarithmic axis of distance whose data are drawn."""
    ax.set_xscale("log")
    plain_log(ax.xaxis)
    ax.set_xlabel(label)


def zero(ax: Axes) -> Any:
    """A line at zero behind everything."""
    return ax.axhline(0, color="0.5", linewidth=0.5, zorder=0.5)


def dots(ax: Axes, x: Any, y: Any, colour: str = SERIES[0][0]) -> None:
    """Trials as a cloud."""
    ax.plot(
        x, y, ".", color=colour, markersize=2.0, markeredgewidth=0, alpha=0.45, zorder=1,
        rasterized=len(x) > CLOUD,
    )  # fmt: skip


def bars(ax: Axes, x: Any, y: Any, u: Any, series: tuple[Any, str], **more: Any) -> Any:
    """Symbols with their error bars; `u` is one standard uncertainty, or both reaches."""
    colour, marker = series
    more = {"elinewidth": 0.7, "markeredgewidth": 0.7, "zorder": 3} | more
    return ax.errorbar(x, y, u, fmt=marker, color=colour, **more)


def band(ax: Axes, x: Any, low: Any, high: Any, colour: str = BAND, **more: Any) -> Any:
    """A shade between two curves."""
    return ax.fill_between(x, low, high, color=colour, linewidth=0, **{"zorder": 1} | more)


def note(
    ax: Axes, text: str, at: tuple[float, float], apart: tuple[float, float], **more: Any
) -> None:
    """Small words near a place, so many points away from it."""
    ax.annotate(text, at, apart, textcoords="offset points", fontsize=SMALL_PT, **more)


def words_alone(ax: Axes, text: str) -> None:
    """Words in the middle of a panel that has nothing else to show."""
    ax.text(0.5, 0.5, text, ha="center", va="center", transform=ax.transAxes)


def plain_text(text: str) -> str:
    """Text from a user, with nothing in it that matplotlib would set as mathematics; control
    characters left out.
    """
    return "".join(c for c in text if c.isprintable()).replace("$", r"\$")


def effects(name: str) -> str:
    """Label of a candidate: its effects by their titles, one a line."""
    return plain_text(titled(name)).replace(" + ", "\n+ ")


def labelled(name: str, unit: str | None = None) -> str:
    """An axis label: the symbol of a coefficient with a unit; its name where it has no symbol."""
    try:
        return nomenclature.label(name, unit)
    except UsageError:
        return plain_text(name) if unit in (None, "", "1") else f"{plain_text(name)} ({unit})"


def quantity(name: str, unit: str | None = None) -> str:
    """An axis label: the words and the symbol of a column such as `supply_V`; its name where it has
    no symbol.
    """
    try:
        symbol = nomenclature.symbol(name)
    except UsageError:
        return plain_text(along(name))
    word = along(name.split("_")[0]).removeprefix("the ")
    if symbol.latex.startswith(r"\mathrm{"):
        return word
    shown = nomenclature.label(name, unit)
    return shown if name in ("z_hat", "delta_L") else f"{word} {shown}"
