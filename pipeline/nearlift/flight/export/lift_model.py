"""Exported lift models of a campaign: parameters, tables and provenance, as JSON, C and Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import jinja2
import numpy as np
from pydantic import Field, TypeAdapter

from nearlift import catalogue
from nearlift.flight.energy import Held
from nearlift.flight.export.table import LiftTable, lift_table
from nearlift.flight.quoted_lift import AT_REFERENCE, QuotedLift


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedNumber:
    """A parameter and its 90 % interval."""

    value: float
    lo90: float
    hi90: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedLift:
    """Exported lift model of one boundary.

    Attributes
    ----------
    formula : str
        LaTeX of the base model.
    effects : tuple of str
        Effects within the ratio.
    omitted : mapping of str to str
        Identified effects that are left out, and why.
    covariance : mapping of str to tuple of float
        Rows of the parameters' covariance matrix over the draws, in the same order.
    known : mapping of str to float
        Geometry that the model needs.
    """

    model: str
    title: str
    formula: str
    effects: tuple[str, ...]
    omitted: Mapping[str, str]
    parameters: Mapping[str, ExportedNumber]
    covariance: Mapping[str, tuple[float, ...]]
    known: Mapping[str, float]
    table: LiftTable


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelExport:
    """Exported lift models of one campaign, with their provenance.

    `date` is that of the newest raw file, `held` the quantity held in each trial, `source` the
    product that uncertainties come from.
    """

    schema: str = "nearlift.lift_model/5"
    campaign: str
    nearlift: str
    trials_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    date: str
    rotor_radius_m: Annotated[float, Field(gt=0)]
    held: Held
    boundaries: Mapping[str, ExportedLift]
    source: str


def exported(lift: QuotedLift) -> ExportedLift:
    """Exported lift model of one boundary, over its stations within the model's validity.

    Raises
    ------
    InputRefused
        No table is accurate enough.
    """
    model, ratio = lift.model, lift.ratio()
    low = max(lift.measured_z_hat[0], model.valid_z_hat[0])
    high = min(lift.measured_z_hat[1], model.valid_z_hat[1])
    # an effect in time stays at its reference, so none of its parameters is in the ratio
    effects = [catalogue.effect(name) for name in lift.effects]
    in_time = [e for e in effects if not set(AT_REFERENCE).isdisjoint(e.needs)]
    within = tuple(e.name for e in effects if e not in in_time)
    outside = {p.name for e in in_time for p in e.parameters}
    inside = [n for n in lift.best if n not in outside]
    rows = np.atleast_2d(np.cov([lift.draws[n] for n in inside])).tolist() if inside else []
    omitted = {e.name: "acts in time, and this ratio holds at its reference" for e in in_time}
    return ExportedLift(
        model="_with_".join((model.name.partition("_with_")[0], *within)),
        title=model.title.partition(" + ")[0],
        formula=model.formula,
        effects=within,
        omitted=omitted | dict.fromkeys(lift.left, "belongs to the bench"),
        parameters={
            n: ExportedNumber(value=x.value, lo90=x.lo90, hi90=x.hi90, unit=model.parameter(n).unit)
            for n, x in lift.intervals.items()
            if n not in outside
        },
        covariance={n: tuple(row) for n, row in zip(inside, rows, strict=True)},
        known={
            n: float(v)
            for n, v in lift.arguments.items()
            if np.ndim(v) == 0 and n not in AT_REFERENCE
        },
        table=lift_table(ratio, lift.drawn, low, high),
    )


def json_schema() -> dict[str, object]:
    """JSON Schema of lift_model.json."""
    schema = TypeAdapter(ModelExport).json_schema(mode="serialization")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def c_header(export: ModelExport) -> str:
    """C99 header for firmware: metres in, single or double precision, no heap, state or library."""
    name = "".join(c.lower() if c.isalnum() else "_" for c in export.campaign)
    about = _rendered("about.txt", export).replace("*/", "* /")
    return _rendered("lift_model.h", export, about=about.splitlines(), name=name)


def python_module(export: ModelExport) -> str:
    """Python module without dependencies."""
    # the header comment becomes a docstring, which quotes or backslashes could end
    about = _rendered("about.txt", export).replace("\\", "/").replace('"', "'")
    return _rendered("lift_model.py", export, about=about)


def _rendered(template: str, export: ModelExport, **values: object) -> str:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("nearlift.flight.export", "."),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters["real"] = lambda number: f"NEARLIFT_REAL({float(number)!r})"
    return environment.get_template(f"{template}.jinja").render(export=export, zip=zip, **values)
