"""Exported lift models of a campaign: parameters, tables, closed forms and provenance."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from nearlift import catalogue
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.flight.export.closed_form import closed_form, evaluate, fold
from nearlift.flight.export.hermite import (
    HermiteTable,
    UncertaintyTable,
    hermite_table,
    uncertainty_table,
)
from nearlift.flight.fitted_lift import FittedLift
from nearlift.flight.proximity.inverse import refuse_folds

#: Number of heights at which L / L_inf is stated with its interval.
TOLD = 5
#: Largest relative difference of a closed form from its declaration; more is a defect.
AGREE = 1e-12
#: Why an effect is left out, by what it belongs to; anything else belongs to the bench.
OMITTED = {
    "vehicle": "acts in time, and this ratio holds at its reference",
    "flight": "belongs to the flights in which it was found",
}


#: Header comment of an exported file, a paragraph to a line.
ABOUT = """\
Lift near boundaries, campaign {0.campaign}: L / L_inf as a function of z_hat = z / r, r = {mm:g}
mm,

z from the rotor plane to ground or ceiling, from the nearest blade tip to a sidewall. Written by
nearlift {0.nearlift}; do not edit.

Data: SHA-256 of trials.parquet {0.digest}

Date of the newest raw file: {0.date}. Held in each trial: {0.held}. Uncertainty from {0.source}.

Nearer than measured, a ratio is that of the nearest station (flag -1); farther, what the boundary
adds falls smoothly, in the end as the square of distance (+1); of what is no number it is 1 (2).

Standard uncertainties are of the parameters alone; beyond the range they are those at its ends.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedNumber:
    """A number and its 90 % interval."""

    value: float
    lo90: float
    hi90: float
    unit: str = "1"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedLift:
    """Exported lift model of one boundary.

    Attributes
    ----------
    formula : str
        LaTeX of the base model.
    effects, omitted : tuple of str
        Named effects within the ratio; and those left out, because they act in time or belong to
        the bench or to the flights in which they were found.
    covariance : mapping of str to tuple of float
        Rows of the parameters' covariance matrix over the draws.
    known : mapping of str to float
        Geometry that the model needs.
    at : mapping of float to ExportedNumber
        L / L_inf and its interval by z_hat.
    rotors : tuple of HermiteTable
        Ratio of each rotor at the tilt of the trials, where the model gives it.
    inverse : str or None
        Why no inverse is exported; None where one is.
    closed : ast.expr or None
        Folded expression in `z`; None where the model has no closed form.
    """

    boundary: str
    model: str
    title: str
    formula: str
    effects: tuple[str, ...]
    omitted: tuple[str, ...]
    parameters: Mapping[str, ExportedNumber]
    covariance: Mapping[str, tuple[float, ...]]
    known: Mapping[str, float]
    at: Mapping[float, ExportedNumber]
    table: HermiteTable
    uncertainty: UncertaintyTable
    rotors: tuple[HermiteTable, ...]
    inverse: str | None
    closed: ast.expr | None


def exported(lift: FittedLift) -> ExportedLift:
    """Exported lift model of one boundary, over its stations within the model's validity.

    Raises
    ------
    InputRefused
        The closed form differs from the declaration, or no table is accurate enough.
    """
    low = max(lift.measured_z_hat[0], lift.model.valid_z_hat[0])
    high = min(lift.measured_z_hat[1], lift.model.valid_z_hat[1])
    known = {n: float(v) for n, v in lift.arguments.items() if np.ndim(v) == 0}
    closed = closed_form(lift.model)
    if closed is not None:
        closed = fold(closed, {**known, **lift.best})
        z_hat = np.linspace(low, high, 2001)
        error = float(np.max(np.abs(evaluate(closed, z_hat) / lift.ratio()(z_hat) - 1)))
        if error > AGREE:
            raise InputRefused(
                f"export {lift.boundary}",
                f"the closed form strays {error:.1g} from the model",
                "this is a defect of nearlift",
            )
    ratio = lift.ratio()
    inverse = None
    try:
        refuse_folds(ratio, low, high, "export")
    except InputRefused as refusal:
        inverse = refusal.what
    within = tuple(e for e in lift.effects if catalogue.effect(e).closed_form != "r")
    # an effect that acts in time stays at its reference: none of its parameters is in the ratio
    outside = {
        p.name for e in lift.effects if e not in within for p in catalogue.effect(e).parameters
    }
    inside = [n for n in lift.best if n not in outside]
    spread = np.atleast_2d(np.cov([lift.draws[n] for n in inside])).tolist() if inside else []
    return ExportedLift(
        boundary=lift.boundary,
        model="_with_".join((lift.model.name.partition("_with_")[0], *within)),
        title=lift.model.title.partition(" + ")[0],
        formula=lift.model.formula,
        effects=within,
        omitted=(*(e for e in lift.effects if e not in within), *lift.left),
        parameters={
            n: ExportedNumber(
                value=x.value, lo90=x.lo90, hi90=x.hi90, unit=lift.model.parameter(n).unit
            )
            for n, x in lift.intervals.items()
            if n not in outside
        },
        covariance={n: tuple(row) for n, row in zip(inside, spread, strict=True)},
        known={n: v for n, v in known.items() if not n.startswith("supply")},
        at=_ratios(lift, np.geomspace(low, high, TOLD)) if low > 0 else {},
        table=hermite_table(ratio, low, high),
        uncertainty=uncertainty_table(lift.drawn, low, high),
        rotors=_rotors(lift, low, high),
        inverse=inverse,
        closed=closed,
    )


def _rotors(lift: FittedLift, low: float, high: float) -> tuple[HermiteTable, ...]:
    per_rotor = lift.model.per_rotor
    if per_rotor is None:
        return ()
    values = {**lift.arguments, **lift.best}

    def rotor(i: int) -> HermiteTable:
        return hermite_table(lambda z_hat: per_rotor(z_hat, **values)[..., i], low, high)

    return tuple(rotor(i) for i in range(len(per_rotor(low, **values))))


def _ratios(lift: FittedLift, z_hat: FloatArray) -> dict[float, ExportedNumber]:
    bounds = np.percentile(lift.drawn(z_hat), [5, 95], axis=0)
    rows = np.stack([z_hat, lift.ratio()(z_hat), *bounds]).T.tolist()
    return {z: ExportedNumber(value=value, lo90=lo, hi90=hi) for z, value, lo, hi in rows}


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelExport:
    """Exported lift models of one campaign, with their provenance: `digest` is the SHA-256 of
    trials.parquet, `date` that of the newest raw file, `held` what each trial held constant.
    """

    campaign: str
    nearlift: str
    digest: str
    date: str
    source: str
    radius_m: float
    held: str
    lifts: tuple[ExportedLift, ...]

    def about(self) -> list[str]:
        """Header comment of an exported file, by lines."""
        lines = [p.format(self, mm=1e3 * self.radius_m) for p in ABOUT.split("\n\n")]
        for lift in self.lifts:
            effects = f" with {', '.join(lift.effects)}" if lift.effects else ""
            lines += [
                "",
                (
                    f"{lift.boundary}: {lift.title}{effects}; valid for {lift.table.low:.6g} <="
                    f" z_hat <= {lift.table.high:.6g}"
                ),
            ]
            lines += [
                f"  {name} = {p.value:.6g} {p.unit if p.unit != '1' else ''} (90 %: {p.lo90:.6g} to"
                f" {p.hi90:.6g})"
                for name, p in lift.parameters.items()
            ]
            lines += [
                f"  at z_hat = {z:.4g}: {r.value:.5f} (90 %: {r.lo90:.5f} to {r.hi90:.5f})"
                for z, r in lift.at.items()
            ]
            lines += [
                f"  {effect} was found too and is left out: it"
                f" {OMITTED.get(catalogue.effect(effect).belongs_to, 'belongs to the bench')}"
                for effect in lift.omitted
            ]
            if lift.inverse is not None:
                lines.append(f"  no inverse: {lift.inverse}")
            if lift.closed is None:
                lines.append("  table only: this model has no closed form on record")
        return [
            " ".join(line.split()) if not line.startswith("  ") else "  " + " ".join(line.split())
            for line in lines
        ]
