"""Reduction of downwash against distance: by PIV, and as lift models imply it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from nearlift import catalogue
from nearlift.declare import Boundary, FloatArray
from nearlift.flow.downwash import NOT_AT_THE_DISK
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, stack, where
from nearlift.report.figures.flow_panels import origin
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import REFERENCES, SERIES, Style, distance, headed, plain_log
from nearlift.rounding import fixed, plain
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
LEVEL_RAD = 1e-4


def summarise(evidence: Evidence) -> Columns:
    """A row for each point: `kind` is measured (the label says why a cut is not at the disk) or
    model; reductions of downwash in percent of the control's.
    """
    table = evidence.table(DOWNWASH)
    level = np.abs(np.asarray(table["tilt_rad"], dtype=float)) < LEVEL_RAD
    usable = (table["rotor"] == "all") & level & np.isfinite(table["reduction"])
    parts: list[dict[str, object]] = []
    for boundary in BOUNDARIES:
        mine = usable & (table["boundary"] == boundary)
        if not mine.any():
            continue
        z_hat = np.asarray(table["z_hat"][mine], dtype=float)
        warned = [{*str(w).split()} & {*NOT_AT_THE_DISK} for w in table["warnings"][mine]]
        ends = {"reduction": "", "lo90": "_lo90", "hi90": "_hi90"}
        parts.append(
            {
                "panel": boundary,
                "kind": "measured",
                "label": [" ".join(sorted(w)) for w in warned],
                "z_hat": z_hat,
                **{f"{n}_percent": 100 * table[f"reduction{end}"][mine] for n, end in ends.items()},
            }
        )
        grid = np.geomspace(0.8 * z_hat.min(), 1.25 * z_hat.max(), POINTS)
        for name, label in MODELS.items():
            model = catalogue.model(name)
            if model.boundary != boundary or model.downwash is None:
                continue
            curve = {"z_hat": grid, "reduction_percent": reduction(evidence, name, grid)}
            fitted = name in evidence.fits.boundaries.get(boundary, {}) and model.parameters
            shown = f"{label}, fitted" if fitted else label
            parts.append({"panel": boundary, "kind": "model", "label": shown, **curve})
    return stack(parts, COLUMNS)


def reduction(evidence: Evidence, name: str, z_hat: FloatArray) -> FloatArray:
    """Percent by which a model's induced velocity at the disk is below its value far away, at
    fitted parameters where there are some.
    """
    model, geometry = catalogue.model(name), evidence.campaign.geometry()
    assert model.downwash is not None
    if any(n not in geometry for n in model.needs):
        return np.full(np.shape(z_hat), np.nan)
    fit = evidence.fits.boundaries.get(model.boundary, {}).get(name)
    values = fit.values if fit else {p.name: p.value for p in model.parameters}
    known: dict[str, Any] = {n: geometry[n] for n in model.needs} | dict(values)
    with np.errstate(invalid="ignore", divide="ignore"):
        velocity = np.asarray(model.downwash(z_hat, **known), dtype=float)
    return 100 * (1 - np.broadcast_to(velocity, np.shape(z_hat)))


def implied(evidence: Evidence, boundary: Boundary, z_hat: float) -> float:
    """Reduction of downwash in percent that the base model implies; nan without an inflow."""
    base = evidence.fits.base.get(boundary, "")
    if not base or catalogue.model(base).downwash is None:
        return math.nan
    return float(reduction(evidence, base, np.array([z_hat]))[0])


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption."""
    cases = [
        n for n in evidence.document(FLOW)["cases"] if n in set(evidence.table(DOWNWASH)["case"])
    ]
    return (
        "Reduction of the downwash beneath the rotors against the control, at equal thrust."
        " Symbols: PIV with 90 % intervals; hollow where the cut is not at the disk. Lines: inflow"
        f" at the disk that lift models imply. {origin(evidence, cases)}"
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """Description for screen readers."""
    rows = where(table, kind="measured")
    each = zip(*(rows[n] for n in COLUMNS[3:]), rows["panel"], strict=True)
    parts = [
        f"{panel}, ẑ = {plain(float(z), 3)}: {fixed(value, 1)} % ({fixed(low, 1)} to"
        f" {fixed(high, 1)})"
        for z, value, low, high, panel in each
    ]
    return f"Measured reductions of downwash. {'; '.join(parts)}."


def draw(table: Rows, look: Style) -> Figure:
    """A panel for each boundary."""
    panels = distinct(table["panel"])
    factor, label = distance(look)
    width = look.single_in if len(panels) == 1 else look.double_in
    figure = Figure(figsize=(width, 2.4 * look.double_in / 6.75), layout="constrained")
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    colour, marker = SERIES[0]
    for title, panel, ax in zip(headed(panels), panels, axes, strict=True):
        ax.set_xscale("log")
        ax.axhline(0, color="0.6", linewidth=0.5, zorder=0.1)
        rows, curves = (where(table, panel=panel, kind=kind) for kind in ("measured", "model"))
        for at_disk, fill, name in (
            (True, colour, "PIV"),
            (False, "white", "PIV, not at the disk"),
        ):
            mine = {n: x[(rows["label"] == "") == at_disk] for n, x in rows.items()}
            value = mine["reduction_percent"]
            if len(value):
                reach = [value - mine["lo90_percent"], mine["hi90_percent"] - value]
                look_of: dict[str, Any] = {"color": colour, "markerfacecolor": fill, "label": name}
                ax.errorbar(factor * mine["z_hat"], value, reach, fmt=marker, **look_of, zorder=3)
        for (grey, dashes), name in zip(REFERENCES, distinct(curves["label"]), strict=False):
            curve = where(curves, label=name)
            style: dict[str, Any] = {"color": grey, "linestyle": dashes, "label": name}
            ax.plot(factor * curve["z_hat"], curve["reduction_percent"], **style)
        plain_log(ax.xaxis)
        ax.set_title(title)
        ax.set_xlabel(f"distance {label}")
        ax.legend(loc="upper right")
    axes[0].set_ylabel("reduction of downwash (%)")
    return figure


FIGURE = FigureSpec(
    name="downwash",
    title="Downwash by PIV, and by lift models",
    needs=(FIT, DOWNWASH, FLOW),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
