"""Exported lift models of a campaign: parameters, tables and provenance, as JSON, C and Python.

All three are made of one object, the content of lift_model.json. Its `date` is that of the newest
raw file, `held` the quantity held in each trial, `source` the product that uncertainties come from.
"""

from __future__ import annotations

from collections.abc import Mapping

import jinja2
import numpy as np

from nearlift import catalogue
from nearlift.flight.export.table import lift_table
from nearlift.flight.quoted_lift import AT_REFERENCE, QuotedLift

SCHEMA = "nearlift.lift_model/5"


def exported(lift: QuotedLift) -> dict[str, object]:
    """Lift model of one boundary, over its stations within the model's validity.

    `effects` are those within the ratio, `omitted` those left out, with the reason. `covariance`
    has the rows of the parameters' covariance matrix over the draws, in the same order. `known` is
    the geometry that the model needs.

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
    within = [e.name for e in effects if e not in in_time]
    outside = {p.name for e in in_time for p in e.parameters}
    inside = [n for n in lift.best if n not in outside]
    rows = np.atleast_2d(np.cov([lift.draws[n] for n in inside])).tolist() if inside else []
    omitted = {e.name: "acts in time, and this ratio holds at its reference" for e in in_time}
    return {
        "model": "_with_".join((model.name.partition("_with_")[0], *within)),
        "title": model.title.partition(" + ")[0],
        "formula": model.formula,
        "effects": within,
        "omitted": omitted | dict.fromkeys(lift.left, "belongs to the bench"),
        "parameters": {
            n: {"value": x.value, "lo90": x.lo90, "hi90": x.hi90, "unit": model.parameter(n).unit}
            for n, x in lift.intervals.items()
            if n not in outside
        },
        "covariance": dict(zip(inside, rows, strict=True)),
        "known": {
            n: float(v)
            for n, v in lift.arguments.items()
            if np.ndim(v) == 0 and n not in AT_REFERENCE
        },
        "table": lift_table(ratio, lift.drawn, low, high),
    }


def c_header(export: Mapping[str, object]) -> str:
    """C99 header for firmware: metres in, single or double precision, no heap, state or library."""
    name = "".join(c.lower() if c.isalnum() else "_" for c in str(export["campaign"]))
    about = _rendered("about.txt", export).replace("*/", "* /")
    return _rendered("lift_model.h", export, about=about.splitlines(), name=name)


def python_module(export: Mapping[str, object]) -> str:
    """Python module without dependencies."""
    # the header comment becomes a docstring, which quotes or backslashes could end
    about = _rendered("about.txt", export).replace("\\", "/").replace('"', "'")
    return _rendered("lift_model.py", export, about=about)


def _rendered(template: str, export: Mapping[str, object], **values: object) -> str:
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
