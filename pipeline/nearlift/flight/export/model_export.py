"""Exported lift models of a campaign: parameters, tables and provenance.

`ModelExport` is the content of lift_model.json as it is written; C and Python source are made from
it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field, TypeAdapter

from nearlift import catalogue
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.flight.detection import refuse_folds
from nearlift.flight.energy import Held
from nearlift.flight.export.hermite import (
    HermiteTable,
    UncertaintyTable,
    hermite_table,
    uncertainty_table,
)
from nearlift.flight.fitted_lift import AT_REFERENCE, FittedLift
from nearlift.results.document import Unwritten

#: Number of heights at which L / L_inf is stated with its interval.
N_STATED = 5
IN_TIME = "acts in time, and this ratio holds at its reference"

#: Header comment of an exported file, a paragraph to a line.
ABOUT = """\
Lift near boundaries, campaign {0.campaign}: L / L_inf as a function of z_hat = z / r, r = {mm:g}
mm,

z from the rotor plane to ground or ceiling, from the nearest blade tip to a sidewall. Written by
nearlift {0.nearlift}; do not edit.

Data: SHA-256 of trials.parquet {0.trials_sha256}

Date of the newest raw file: {0.date}. Held in each trial: {0.held}. Uncertainty from {0.source}.

Nearer than measured, the ratio is that of the nearest station (flag -1). Farther, the ratio less 1
fades as the inverse square of distance (flag +1). For NaN the ratio is 1 (flag 2).

Standard uncertainties include the parameters alone; beyond the range they are those at its ends.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedNumber:
    """A number and its 90 % interval."""

    value: float
    lo90: float
    hi90: float
    unit: str = "1"


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedRatio:
    """L / L_inf with its 90 % interval at a height."""

    z_hat: float
    value: float
    lo90: float
    hi90: float
    unit: str = "1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fading:
    """Farther than valid_z_hat the ratio less 1 falls as 1 / (1 + power s + s^2), with s = z_hat /
    valid_z_hat[1] - 1.
    """

    power: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedLift:
    """Exported lift model of one boundary.

    Attributes
    ----------
    formula : str
        LaTeX of the base model.
    effects, omitted : tuple of str
        Effects within the ratio, and identified effects that are left out. The latter are left
        out since they act in time or belong to the bench.
    covariance : mapping of str to tuple of float
        Rows of the parameters' covariance matrix over the draws, in the same order.
    known : mapping of str to float
        Geometry that the model needs.
    ratio : tuple of StatedRatio
        L / L_inf and its interval at some heights.
    rotors : tuple of HermiteTable
        Ratio of each rotor at the tilt of the trials, where the model gives it.
    inverse : str or None
        Why no inverse is exported; None where one is.
    """

    model: str
    title: Unwritten[str]
    formula: str
    effects: tuple[str, ...]
    omitted: tuple[str, ...]
    parameters: Mapping[str, ExportedNumber]
    covariance: Mapping[str, tuple[float, ...]]
    known: Mapping[str, float]
    valid_z_hat: tuple[float, float]
    ratio: tuple[StatedRatio, ...]
    table: HermiteTable
    uncertainty: UncertaintyTable
    rotors: tuple[HermiteTable, ...]
    beyond: Fading
    inverse: Unwritten[str | None]

    def about(self, boundary: str) -> list[str]:
        """Lines of the header comment on this boundary."""
        effects = f" with {', '.join(self.effects)}" if self.effects else ""
        valid = f"{self.table.low:.6g} <= z_hat <= {self.table.high:.6g}"
        lines = [
            "",
            f"{boundary}: {self.title}{effects}; valid for {valid}",
        ]
        for name, p in self.parameters.items():
            unit = "" if p.unit == "1" else f" {p.unit}"
            lines.append(f"  {name} = {p.value:.6g}{unit} (90 %: {p.lo90:.6g} to {p.hi90:.6g})")
        for r in self.ratio:
            lines.append(
                f"  at z_hat = {r.z_hat:.4g}: {r.value:.5f} (90 %: {r.lo90:.5f} to {r.hi90:.5f})"
            )
        for effect in self.omitted:
            reason = IN_TIME if _in_time(effect) else "belongs to the bench"
            lines.append(f"  {effect} was found too and is left out: it {reason}")
        if self.inverse is not None:
            lines.append(f"  no inverse: {self.inverse}")
        return lines


def exported(lift: FittedLift) -> ExportedLift:
    """Exported lift model of one boundary, over its stations within the model's validity.

    Raises
    ------
    InputRefused
        No table is accurate enough.
    """
    low = max(lift.measured_z_hat[0], lift.model.valid_z_hat[0])
    high = min(lift.measured_z_hat[1], lift.model.valid_z_hat[1])
    ratio = lift.ratio()
    inverse = None
    try:
        refuse_folds(ratio, low, high, "export")
    except InputRefused as refusal:
        inverse = refusal.what
    # an effect in time stays at its reference, so none of its parameters is in the ratio
    in_time = [e for e in lift.effects if _in_time(e)]
    within = tuple(e for e in lift.effects if e not in in_time)
    outside = {p.name for e in in_time for p in catalogue.effect(e).parameters}
    inside = [n for n in lift.best if n not in outside]
    rows = np.atleast_2d(np.cov([lift.draws[n] for n in inside])).tolist() if inside else []
    table = hermite_table(ratio, low, high)
    return ExportedLift(
        model="_with_".join((lift.model.name.partition("_with_")[0], *within)),
        title=lift.model.title.partition(" + ")[0],
        formula=lift.model.formula,
        effects=within,
        omitted=(*in_time, *lift.left),
        parameters={
            n: ExportedNumber(
                value=x.value, lo90=x.lo90, hi90=x.hi90, unit=lift.model.parameter(n).unit
            )
            for n, x in lift.intervals.items()
            if n not in outside
        },
        covariance={n: tuple(row) for n, row in zip(inside, rows, strict=True)},
        known={
            n: float(v)
            for n, v in lift.arguments.items()
            if np.ndim(v) == 0 and n not in AT_REFERENCE
        },
        valid_z_hat=(low, high),
        ratio=_stated(lift, np.geomspace(low, high, N_STATED)) if low > 0 else (),
        table=table,
        uncertainty=uncertainty_table(lift.drawn, low, high),
        rotors=_rotors(lift, low, high),
        beyond=Fading(power=table.power),
        inverse=inverse,
    )


def _in_time(effect: str) -> bool:
    return not set(AT_REFERENCE).isdisjoint(catalogue.effect(effect).needs)


def _rotors(lift: FittedLift, low: float, high: float) -> tuple[HermiteTable, ...]:
    per_rotor = lift.model.per_rotor
    if per_rotor is None:
        return ()
    values = {**lift.arguments, **lift.best}

    def rotor(i: int) -> HermiteTable:
        return hermite_table(lambda z_hat: per_rotor(z_hat, **values)[..., i], low, high)

    return tuple(rotor(i) for i in range(len(per_rotor(low, **values))))


def _stated(lift: FittedLift, z_hat: FloatArray) -> tuple[StatedRatio, ...]:
    bounds = np.percentile(lift.drawn(z_hat), [5, 95], axis=0)
    rows = np.stack([z_hat, lift.ratio()(z_hat), *bounds]).T.tolist()
    return tuple(StatedRatio(z_hat=z, value=value, lo90=lo, hi90=hi) for z, value, lo, hi in rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelExport:
    """Exported lift models of one campaign, with their provenance.

    `date` is that of the newest raw file, `held` the quantity held in each trial, `source` the
    product that uncertainties come from.
    """

    schema: str = "nearlift.lift_model/2"
    campaign: str
    nearlift: str
    trials_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    date: str
    rotor_radius_m: Annotated[float, Field(gt=0)]
    held: Held
    boundaries: Mapping[str, ExportedLift]
    source: Unwritten[str]

    def about(self) -> list[str]:
        """Header comment of an exported file, by lines."""
        paragraphs = ABOUT.format(self, mm=1e3 * self.rotor_radius_m).split("\n\n")
        lines = [" ".join(paragraph.split()) for paragraph in paragraphs]
        return lines + [line for b, lift in self.boundaries.items() for line in lift.about(b)]


def json_schema() -> dict[str, object]:
    """JSON Schema of lift_model.json."""
    schema = TypeAdapter(ModelExport).json_schema(mode="serialization")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
