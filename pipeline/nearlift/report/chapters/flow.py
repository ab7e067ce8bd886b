"""Flow and lift: downwash measured, what each model implies, convergence, topology."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from nearlift import catalogue
from nearlift.declare import Boundary, LiftModel
from nearlift.flow.downwash import WARNINGS
from nearlift.report import blocks
from nearlift.report.evidence import Evidence
from nearlift.report.figures import fig5
from nearlift.report.figures.flow_panels import cut, manifest
from nearlift.report.number import Number, Place, pointer
from nearlift.rounding import fixed, like, plain
from nearlift.stages.fit import FIT
from nearlift.stages.flow import DOWNWASH, FLOW, FLOW_TOPOLOGY

#: Statements of the paper and their check; tests recompute every number.
CLAIMS = (
    (
        "22 % less downwash near the ceiling (ẑ = 2)",
        (
            "The paper's own Eq. 3 implies 0.8 % there, and its text calls that flow almost"
            " identical to the control: the labels are probably swapped."
        ),
    ),
    (
        "6 % less near the ground (ẑ = 3.4)",
        (
            "The cut is 1.4 radii above the floor, where the jet turns. It does not measure the"
            " inflow at the disk, which images reduce by 1.5 to 1.7 %."
        ),
    ),
    (
        "Cheeseman and Bennett predict 0.4 % at ẑ = 3.4",
        "Their formula gives 0.54 %; 0.4 % belongs to ẑ = 3.95.",
    ),
)
#: Row of downwash.parquet.
CutRow = Mapping[str, Any]
#: Smaller tilts are none, rad.
LEAST_TILT = 1e-4
CONVERGENCE = (
    *("case", "fields", "per independent one", "outliers, %", "vectors, %"),
    *("mean moved since half as many, %", "standard error of the mean, %", "fields for 0.1 %"),
)
#: Rows of the table of topology: title and decimals by column of flow_topology.parquet.
NUMBERS = {
    "vortices_ccw": ("vortices, counter-clockwise", 0),
    "vortices_cw": ("vortices, clockwise", 0),
    "stagnation_area_hat2": ("stagnation zone, area / r²", 2),
    "stagnation_height_hat": ("stagnation zone, height / r", 2),
}


def facts(evidence: Evidence) -> Markup:
    """Downwash measured and implied near each boundary, convergence, the wake, and the paper's
    statements.
    """
    piv = manifest(evidence)
    implied = [t for b in ("ground", "ceiling") if (t := _implied(evidence, b)) is not None]
    simulated = (
        "{}: a kinematic model with known downwash, neither measured nor a solution of the flow."
    )
    return blocks.join(
        blocks.paragraph(simulated, blocks.bold("Simulated velocity fields"))
        if evidence.campaign.simulated
        else "",
        *(t.sentence(piv.control) for t in implied),
        blocks.figure("downwash"),
        blocks.figure("fig3"),
        blocks.fold(
            "Every case, and what each model implies",
            *_cases(evidence),
            *(t.table() for t in implied),
            blocks.figure("fig4"),
        ),
        _topology(evidence),
        blocks.fold(
            "The paper's statements on downwash, checked",
            blocks.items([f"{statement}: {check}" for statement, check in CLAIMS]),
        ),
        _convergence(evidence),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """Downwash of one case as printed; `reduction` is of the control's downwash."""

    z_hat: str
    seen: bool
    reduction: Number
    lo90: Number
    hi90: Number
    warnings: list[str]

    @property
    def text(self) -> Markup | str:
        """Reduction with its interval."""
        if not self.seen:
            return "–"
        return Markup("{}{}").format(self.reduction, blocks.span("{} to {}", self.lo90, self.hi90))


def _entry(row: CutRow, key: str, text: str, how: str = "") -> Number:
    how = f"{key} of case {row['case']}, rotor {row['rotor']}{how}"
    return Number(text=text, value=float(row[key]), source=DOWNWASH.file, how=how)


def _measured(row: CutRow) -> Measured:
    u = 100 * row["u_reduction"]

    def percent(key: str) -> Number:
        value = 100 * row[key]
        text = like(value, u) if math.isfinite(u) and u > 0 else plain(value, 3)
        return _entry(row, key, text, ", in percent")

    return Measured(
        z_hat="∞" if math.isinf(row["z_hat"]) else plain(row["z_hat"], 3),
        seen=math.isfinite(row["reduction"]),
        reduction=percent("reduction"),
        lo90=percent("reduction_lo90"),
        hi90=percent("reduction_hi90"),
        warnings=row["warnings"].split(),
    )


def _cases(evidence: Evidence) -> list[Markup]:
    """Table of all cases, and the meaning of their remarks."""
    piv = manifest(evidence)
    rows, warnings = [], set()
    for case in piv.case:
        row = cut(evidence, case.name)
        m, u = _measured(row), row["u_downwash_m_s"]
        warnings |= {*m.warnings}
        tilted = abs(row["tilt_rad"]) > LEAST_TILT
        height = row["clearance_hat"]
        speeds = [
            _entry(row, k, like(row[k], u), ", in m/s") for k in ("downwash_m_s", "u_downwash_m_s")
        ]
        rows.append(
            (
                case.name,
                m.z_hat,
                fixed(math.degrees(row["tilt_rad"]), 1) if tilted else "0",
                _entry(row, "n_fields", str(row["n_fields"])),
                Markup("{} ± {}").format(*speeds) if m.seen else "–",
                _entry(row, "covered", fixed(100 * row["covered"], 0), ", in percent"),
                _entry(row, "clearance_hat", "–" if math.isinf(height) else plain(height, 3)),
                "control" if case.name == piv.control and m.seen else m.text,
                ", ".join(w.replace("_", " ") for w in m.warnings),
            )
        )
    return [
        blocks.table(
            f"Downwash through the cut beneath the rotors; reduction against “{piv.control}” with"
            " its 90 % interval",
            (
                *("case", "ẑ", "tilt, °", "fields", "downwash, m/s", "covered, %"),
                *("cut above boundary, r", "reduction, %", "remark"),
            ),
            rows,
        ),
        blocks.items([f"{w.replace('_', ' ')}: {WARNINGS[w]}." for w in sorted(warnings)]),
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Implied:
    """Downwash measured at the untilted cases of a boundary, the farthest first.

    `rows` are the downwash that each model implies, `base` that of the base model at the nearest.
    """

    boundary: Boundary
    measured: list[Measured]
    rows: list[tuple[object, ...]]
    base: Number | None

    def sentence(self, control: str) -> Markup:
        """Measured and implied downwash at the nearest case."""
        m = self.measured[-1]
        seen = Markup("the cut beneath the rotors shows {} % less downwash than “{}”{}").format(
            m.reduction, control, blocks.span("90 %: {} to {}", m.lo90, m.hi90)
        )
        base = Markup(". The base lift model implies {} % less at the disk").format(self.base)
        return blocks.paragraph(
            "{} {}{}.{}",
            blocks.bold(f"{self.boundary.capitalize()}, ẑ = {m.z_hat}:"),
            seen if m.seen else "the fields do not show the downwash beneath the rotors",
            base if self.base else "",
            "".join(f" Note: {WARNINGS[w]}." for w in m.warnings),
        )

    def table(self) -> Markup:
        """Reductions by model and distance, the measured ones last."""
        measured = [
            Markup("{}{}").format(m.text, blocks.note("not at the disk") if m.warnings else "")
            for m in self.measured
        ]
        return blocks.table(
            f"{self.boundary.capitalize()}: reduction of the induced velocity at the disk (%)"
            " implied by each model at equal thrust. Last row: measured in the cut",
            ("model", "coefficients", *(f"ẑ = {m.z_hat}" for m in self.measured)),
            [*self.rows, ("measured", "cut", *measured)],
        )


def _implied(evidence: Evidence, boundary: Boundary) -> Implied | None:
    """Downwash that each model implies at the untilted cases."""
    cases = sorted(
        (c for c in manifest(evidence).case if c.boundary == boundary and abs(c.tilt) < LEAST_TILT),
        key=lambda c: -(c.z_hat or 0),
    )
    if not cases:
        return None
    vehicle, geometry = evidence.campaign.vehicle, evidence.campaign.geometry()
    z_hat = np.array([c.z_hat for c in cases], dtype=float)
    fitted = evidence.fits.boundaries.get(boundary, {})
    rows: list[tuple[object, ...]] = []
    base = None
    for model in catalogue.models(boundary):
        classic = model.name in ("cheeseman_bennett_fixed", "cheeseman_bennett")
        if model.downwash is None or not (classic or model.suits(vehicle.rotors, geometry)):
            continue
        stated = {p.name: p.value for p in model.parameters}
        values = reduction_percent(model, z_hat, stated, geometry)
        source = f"model {model.name}"
        rows.append(
            (
                model.title,
                "declared",
                *(_shortfall(v, source, "its declared values") for v in values),
            )
        )
        source = pointer(FIT, "boundaries", boundary, model.name, "parameters")
        if (entry := fitted.get(model.name)) and model.parameters:
            values = reduction_percent(model, z_hat, entry.values, geometry)
            rows.append((model.title, "fitted", *(_shortfall(v, source, "these") for v in values)))
        if model.name == evidence.fits.base.get(boundary):
            base = _shortfall(values[-1], source, "these")
    measured = [_measured(cut(evidence, c.name)) for c in cases]
    return Implied(boundary=boundary, measured=measured, rows=rows, base=base)


def reduction_percent(
    model: LiftModel, z_hat: Any, parameters: dict[str, float], geometry: dict[str, object]
) -> list[float]:
    """Percent by which a model's induced velocity at the disk falls short of its value far away."""
    assert model.downwash is not None
    known = {n: geometry[n] for n in model.needs}
    with np.errstate(invalid="ignore", divide="ignore"):
        velocity = np.broadcast_to(
            np.asarray(model.downwash(z_hat, **parameters, **known), dtype=float), np.shape(z_hat)
        )
    return [100 * (1 - float(v)) for v in velocity]


def _shortfall(percent: float, source: str, values: str) -> Number:
    places = 2 if abs(percent) < 10 else 1
    return Number(
        text=fixed(percent, places) if math.isfinite(percent) else "–",
        value=percent,
        source=source,
        how=f"1 - downwash at {values}, in percent",
    )


def _topology(evidence: Evidence) -> Markup:
    cases = fig5.cases(evidence)
    if not cases:
        return Markup("")
    columns = [fig5.topology(evidence, c.name) for c in cases]
    rows: list[tuple[object, ...]] = [
        (
            title,
            *(
                Number(
                    text=fixed(float(column[name]), places),
                    value=float(column[name]),
                    source=FLOW_TOPOLOGY.file,
                    how=f"{name} of case {column['case']}",
                )
                for column in columns
            ),
        )
        for name, (title, places) in NUMBERS.items()
    ]
    rows.append(("jets along the ground", *(column["jets"] or "–" for column in columns)))
    caption = "The wake over a tilted ground"
    tilts = (f"{math.degrees(c.tilt):+.1f}°".replace("-", "−") for c in cases)
    table = blocks.table(caption, ("tilt", *tilts), rows, hidden=True)
    return blocks.fold(caption, blocks.figure("fig5"), table)


def _convergence(evidence: Evidence) -> Markup:
    """Convergence of the average of each case, and fields that were left out."""
    places = [Place(evidence, FLOW, ("cases", c.name)) for c in manifest(evidence).case]
    rows = [
        (
            str(c.key),
            c.number("fields", digits=6),
            c.number("tau_fields", digits=2),
            c.percent("outliers", digits=2),
            c.percent("vectors", places=0),
            c.every("convergence", "moved")[-1].percent(digits=2),
            c.percent("convergence", "relative_standard_error", digits=2),
            c.number("convergence", "fields_for_a_thousandth", digits=2),
        )
        for c in places
    ]
    lost = {
        c.key: "; ".join(f"{x['file']} ({x['reason']})" for x in c.content["left_out"])
        for c in places
    }
    caption = "Convergence of the averages"
    return blocks.fold(
        caption,
        blocks.table(
            caption,
            CONVERGENCE,
            rows,
            hidden=True,
        ),
        *(
            blocks.paragraph("{}: left out {}.", case, files, note=True)
            for case, files in lost.items()
            if files
        ),
    )
