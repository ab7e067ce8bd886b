"""Reduction of downwash against distance: by PIV, and as lift models imply it."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from nearlift import catalogue
from nearlift.declare import Boundary, FloatArray
from nearlift.flow.downwash import LEVEL_RAD, NOT_AT_THE_DISK
from nearlift.report.evidence import Evidence, Part, frame, pick
from nearlift.report.figures import style
from nearlift.report.figures.flow_panels import origin
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import REFERENCES, SERIES
from nearlift.stages.fit import FIT
from nearlift.stages.flow import DOWNWASH, FLOW

POINTS = 120
#: Models of lift with an inflow, and their labels.
MODELS = {
    "cheeseman_bennett_fixed": "C-B (theory)",
    "sanchez_cuevas": "S-C",
    "hsiao_chirarattananon": "H-C",
}
BOUNDARIES: tuple[Boundary, ...] = ("ground", "ceiling")
COLUMNS = ("panel", "kind", "label", "z_hat", "reduction_percent", "lo90_percent", "hi90_percent")


def table(evidence: Evidence) -> pd.DataFrame:
    """A row for each point, with reductions of downwash in percent of the control's.

    `kind` is measured or model. The label of a measured one gives the reason why a cut is not at
    the disk.
    """
    cuts = evidence.frame(DOWNWASH, rotor="all")
    cuts = cuts[(cuts["tilt_rad"].abs() < LEVEL_RAD) & np.isfinite(cuts["reduction"])]
    parts: list[Part] = []
    for boundary in BOUNDARIES:
        mine = pick(cuts, boundary=boundary)
        if not len(mine):
            continue
        warned = [sorted({*str(w).split()} & {*NOT_AT_THE_DISK}) for w in mine["warnings"]]
        ends = {"reduction": "", "lo90": "_lo90", "hi90": "_hi90"}
        values = {f"{n}_percent": 100 * mine[f"reduction{end}"] for n, end in ends.items()}
        said = {"label": [" ".join(w) for w in warned], "z_hat": mine["z_hat"]}
        parts.append({"panel": boundary, "kind": "measured", **said, **values})
        grid = np.geomspace(0.8 * mine["z_hat"].min(), 1.25 * mine["z_hat"].max(), POINTS)
        for name, label in MODELS.items():
            model = catalogue.model(name)
            if model.boundary != boundary or model.downwash is None:
                continue
            if model.parameters and name in evidence.fits.boundaries.get(boundary, {}):
                label += ", quoted" if name == evidence.fits.base.get(boundary) else ", fitted"
            drawn = {"z_hat": grid, "reduction_percent": reduction(evidence, name, grid)}
            parts.append({"panel": boundary, "kind": "model", "label": label, **drawn})
    return frame(parts, COLUMNS)


def reduction(evidence: Evidence, name: str, z_hat: FloatArray) -> FloatArray:
    """Percent by which a model's induced velocity at the disk is below its value far away.

    The base model has the quoted coefficients, another model its fitted parameters, where there are
    some.
    """
    model, geometry = catalogue.model(name), evidence.campaign.geometry()
    assert model.downwash is not None
    if any(n not in geometry for n in model.needs):
        return np.full(np.shape(z_hat), np.nan)
    fit = evidence.fits.boundaries.get(model.boundary, {}).get(name)
    known: Part = {n: geometry[n] for n in model.needs}
    known |= fit.values if fit else {p.name: p.value for p in model.parameters}
    if name == evidence.fits.base.get(model.boundary):
        known |= {n: c.value for n, c in evidence.quoted(model.boundary).coefficients.items()}
    with np.errstate(invalid="ignore", divide="ignore"):
        velocity = np.asarray(model.downwash(z_hat, **known), dtype=float)
    return 100 * (1 - np.broadcast_to(velocity, np.shape(z_hat)))


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
    """Caption."""
    measured = set(evidence.table(DOWNWASH)["case"])
    cases = [n for n in evidence.document(FLOW)["cases"] if n in measured]
    return (
        "Reduction of the downwash beneath the rotors against the control, at equal thrust."
        " Symbols: PIV with 90 % intervals; hollow where the cut is not at the disk. Lines: inflow"
        " at the disk that lift models imply."
        f" {origin(evidence, cases)}"
    )


def draw(table: pd.DataFrame) -> Figure:
    """A panel for each boundary."""
    panels = list(table["panel"].unique())
    figure, axes = style.canvas(1, len(panels), 2.4 * style.DOUBLE_IN / 6.75)
    style.title(axes[0], panels)
    for panel, ax in zip(panels, axes[0], strict=True):
        style.zero(ax)
        rows, curves = (pick(table, panel=panel, kind=kind) for kind in ("measured", "model"))
        disk = rows["label"] == ""
        for name, fill, mine in (
            ("PIV", SERIES[0][0], rows[disk]),
            ("PIV, not at the disk", "white", rows[~disk]),
        ):
            value = mine["reduction_percent"]
            if len(value):
                reach = [value - mine["lo90_percent"], mine["hi90_percent"] - value]
                style.bars(
                    ax, mine.z_hat, value, reach, SERIES[0], markerfacecolor=fill, label=name
                )
        for (grey, dashes), name in zip(REFERENCES, curves["label"].unique(), strict=False):
            curve = pick(curves, label=name)
            ax.plot(curve.z_hat, curve.reduction_percent, color=grey, linestyle=dashes, label=name)
        style.log_distance(ax, f"distance {style.Z_HAT}")
        ax.legend(loc="upper right")
    axes[0, 0].set_ylabel("reduction of downwash (%)")
    return figure


FIGURE = FigureSpec(
    "downwash", "Downwash by PIV, and by lift models", (FIT, DOWNWASH, FLOW), table, caption, draw,
    "reduction_percent", ("panel", "kind"),
)  # fmt: skip
