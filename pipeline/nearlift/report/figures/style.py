"""The look of figures: column widths, type, colours and markers, in matplotlib's own fonts."""

from __future__ import annotations

import itertools
import string
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from nearlift import nomenclature
from nearlift.campaign.manifest import Campaign
from nearlift.catalogue import titled
from nearlift.errors import UsageError
from nearlift.report.phrases import along

#: Metres per inch.
INCH_M = 0.0254
#: Dots per inch of a PNG, and of what is a raster in a PDF.
DPI = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """Sizes of a figure.

    Attributes
    ----------
    single_in, double_in : float
        Width of one column and of the full text, in inches.
    height_in : float
        Largest height, in inches.
    text_pt, line_pt, marker_pt : float
        Type, lines and symbols, in points.
    radius_mm : float or None
        Rotor radius; if given, distances are shown in millimetres.
    simulated : bool
        Whether each figure is marked as one of simulated records.
    """

    single_in: float = 3.25
    double_in: float = 6.75
    height_in: float = 9.0
    text_pt: float = 8.0
    line_pt: float = 1.0
    marker_pt: float = 3.2
    radius_mm: float | None = None
    simulated: bool = False


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
#: Size of each series' symbols over the style's.
NESTED = (1.3, 1.15, 1.0, 0.85, 0.7, 0.6)
#: Theory in grey and black, with different dashes.
REFERENCES = (
    ("#555555", (0, (5, 2))),
    ("#111111", (0, (1, 1.2))),
    ("#777777", (0, (6, 1.5, 1, 1.5))),
)
FITTED = "#000000"
BAND = "#C2C2C2"
OVERLAYS = ("x", "+", "1", "2", "*")
#: A cloud of more dots than this is a raster in the PDF.
CLOUD = 3000
#: Numbers in each decade of a logarithmic axis, by how many times its lower end the upper is.
SUBS: tuple[tuple[float, tuple[float, ...]], ...] = (
    (500.0, (1.0,)),
    (20.0, (1.0, 2.0, 5.0)),
    (0.0, (1.0, 2.0, 3.0, 5.0)),
)
#: Many levels of one quantity: even in lightness, also to colour-blind eyes.
SEQUENTIAL = "cividis"


def style_of(campaign: Campaign) -> Style:
    """The style that a manifest asks for."""
    report = campaign.report
    return Style(
        single_in=report.column_width / INCH_M,
        double_in=report.full_width / INCH_M,
        radius_mm=1e3 * campaign.vehicle.rotor_radius if report.units.distance == "mm" else None,
        simulated=campaign.simulated,
    )


@contextmanager
def context(look: Style) -> Iterator[None]:
    """The settings of matplotlib for one look, put back afterwards; the user's own settings have no
    part in it.
    """
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        current: Any = matplotlib.rcParams
        current.update(_settings(look))
        yield


def _settings(look: Style) -> dict[str, object]:
    small = look.text_pt - 1
    return {
        # the second serves letters that the first lacks
        "font.family": ["STIXGeneral", "DejaVu Sans"],
        "mathtext.fontset": "stix",
        "font.size": look.text_pt,
        "axes.labelsize": look.text_pt,
        "axes.titlesize": look.text_pt,
        "xtick.labelsize": small,
        "ytick.labelsize": small,
        "legend.fontsize": small,
        "legend.frameon": False,
        "legend.handlelength": 2.2,
        "legend.handletextpad": 0.5,
        "legend.borderaxespad": 0.4,
        "legend.labelspacing": 0.3,
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
        "lines.linewidth": look.line_pt,
        "lines.markersize": look.marker_pt,
        "axes.unicode_minus": True,
        "savefig.dpi": DPI,
        "figure.dpi": 100,
        "pdf.fonttype": 42,
        "svg.hashsalt": "nearlift",
        "path.simplify": True,
        "hatch.linewidth": 0.35,
    }


def distance(look: Style) -> tuple[float, str]:
    """Factor from distance over rotor radius to what is shown, and the label of its axis."""
    if look.radius_mm is None:
        return 1.0, r"$\hat{z}$"
    return look.radius_mm, "$z$ (mm)"


def plain_log(axis: Axis) -> None:
    """Plain numbers along a logarithmic axis whose ends are set: 0.1, 0.2, 0.5, 1, ..."""
    low, high = axis.get_view_interval()
    subs = next(subs for span, subs in SUBS if high > span * low or span == 0)
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    # ticks between decades show that the axis is logarithmic, unless their numbers do
    axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)) if len(subs) == 1 else NullLocator())
    axis.set_minor_formatter(NullFormatter())


def dots(ax: Axes, x: Any, y: Any, colour: str = SERIES[0][0]) -> None:
    """Trials as a cloud."""
    ax.plot(
        x,
        y,
        ".",
        color=colour,
        markersize=2.0,
        markeredgewidth=0,
        alpha=0.45,
        zorder=1,
        rasterized=len(x) > CLOUD,
    )


def circles(ax: Axes, x: Any, y: Any, colour: str, **more: Any) -> list[Line2D]:
    """Open circles."""
    look: dict[str, Any] = {"color": colour, "markerfacecolor": "white", "markeredgewidth": 0.8}
    return ax.plot(x, y, "o", **look | more)


def grid(
    axes: Any, rows: Sequence[str], columns: Sequence[str]
) -> Iterator[tuple[str, Any, str, str]]:
    """Letter, axes, row and column of each panel of a grid, line by line."""
    places = itertools.product(rows, columns)
    for letter, ax, (row, column) in zip(string.ascii_lowercase, axes.flat, places, strict=False):
        yield letter, ax, row, column


def headed(panels: Sequence[str]) -> list[str]:
    """Titles of panels side by side; lettered where there are several."""
    if len(panels) == 1:
        return [*panels]
    return [f"{a}) {name}" for a, name in zip(string.ascii_lowercase, panels, strict=False)]


def note(
    ax: Axes, text: str, at: tuple[float, float], apart: tuple[float, float], **more: Any
) -> None:
    """Small words near a place, so many points away from it."""
    small = matplotlib.rcParams["legend.fontsize"]
    ax.annotate(text, at, apart, textcoords="offset points", fontsize=small, **more)


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
    """An axis label: the symbol of a coefficient, with its unit or with that given; what has no
    symbol is set as it is named.
    """
    try:
        return nomenclature.label(name, unit)
    except UsageError:
        return plain_text(name) if unit in (None, "", "1") else f"{plain_text(name)} ({unit})"


def quantity(name: str, unit: str | None = None) -> str:
    """An axis label: the words and the symbol of a column such as `supply_V`; what has no symbol is
    set as it is named.
    """
    try:
        symbol = nomenclature.symbol(name)
    except UsageError:
        return plain_text(along(name))
    word = along(name.split("_")[0]).removeprefix("the ")
    shown = nomenclature.label(name, unit)
    if symbol.latex.startswith(r"\mathrm{"):
        return word
    return shown if name in ("z_hat", "delta_L") else f"{word} {shown}"
