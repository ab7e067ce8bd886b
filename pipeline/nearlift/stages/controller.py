"""The fitted lift models for a controller: C header, JSON with its schema, Python, CasADi; each a
file in export/ beside the products.
"""

from __future__ import annotations

import ast
import json
from datetime import UTC, datetime

import numpy as np

import nearlift
from nearlift.declare import Boundary
from nearlift.errors import InputRefused
from nearlift.flight.export import c, document, python
from nearlift.flight.export.card import Card, Deck, Interval
from nearlift.flight.export.closed import closed_form, evaluate, fold
from nearlift.flight.export.table import tabulate
from nearlift.manifest.campaign import boundaries_of
from nearlift.products import RESULTS, TRIALS
from nearlift.run import store
from nearlift.run.job import Job
from nearlift.stages.belief import Belief, believe

DRAWS = 400
FOLDER = "export"
#: Number of heights at which the ratio's interval is told.
TOLD = 5
#: A closed form that strays further than this from the declaration, relatively, is a defect and is
#: not exported.
AGREE = 1e-12


def deck(job: Job) -> Deck:
    """Everything that is exported. The date is that of the newest raw file, so that the same data
    give the same bytes.
    """
    cards = tuple(_card(job, b) for b in boundaries_of(job.read_json(RESULTS)["boundaries"]))
    raw = [p for name in job.inputs if (p := job.root / name).is_file()]
    newest = max((p.stat().st_mtime for p in raw), default=None)
    return Deck(
        campaign=job.campaign.name,
        nearlift=nearlift.__version__,
        digest=store.sha256(job.processed / TRIALS.file),
        date=datetime.fromtimestamp(newest, UTC).date().isoformat()
        if newest is not None
        else "unknown",
        source=", ".join(dict.fromkeys(card_source for _, card_source in cards)),
        radius_m=job.campaign.vehicle.rotor_radius,
        held=job.campaign.rig.held,
        cards=tuple(card for card, _ in cards),
    )


def _card(job: Job, boundary: Boundary) -> tuple[Card, str]:
    belief = believe(job, boundary, DRAWS)
    low, high = belief.measured_z_hat
    model_low, model_high = belief.model.valid_z_hat
    low, high = max(low, model_low), min(high, model_high)
    known = {n: float(v) for n, v in belief.arguments.items() if np.ndim(v) == 0}
    closed = closed_form(belief.model, belief.effects)
    error = 0.0
    if closed is not None:
        closed = fold(closed, {**known, **belief.best})
        error = _disagreement(closed, belief, low, high)
        if error > AGREE:
            raise InputRefused(
                f"export {boundary}",
                f"the closed form strays {error:.1g} from the model",
                "this is a defect of nearlift",
            )
    return (
        Card(
            boundary=boundary,
            model=belief.model.name,
            title=belief.model.title,
            formula=belief.model.formula,
            effects=belief.effects,
            parameters={
                n: Interval(
                    value=x.value, lo90=x.lo90, hi90=x.hi90, unit=belief.model.parameter(n).unit
                )
                for n, x in belief.spans.items()
            },
            known={n: v for n, v in known.items() if not n.startswith("supply")},
            at={float(z): _ratio(belief, z) for z in np.geomspace(low, high, TOLD)}
            if low > 0
            else {},
            table=tabulate(belief.ratio(), low, high),
            closed=closed,
            closed_error=error,
        ),
        belief.source,
    )


def _interval(value: float, draws: np.ndarray, unit: str = "1") -> Interval:
    lo90, hi90 = np.percentile(draws, [5, 95])
    return Interval(value=float(value), lo90=float(lo90), hi90=float(hi90), unit=unit)


def _ratio(belief: Belief, z_hat: float) -> Interval:
    at = np.array([z_hat])
    return _interval(
        float(belief.ratio()(at)[0]),
        np.array([belief.ratio(m)(at)[0] for m in range(belief.number)]),
    )


def _disagreement(form: ast.expr, belief: Belief, low: float, high: float) -> float:
    """Largest relative error of the closed form against the declaration."""
    z_hat = np.linspace(low, high, 2001)
    return float(np.max(np.abs(evaluate(form, z_hat) / belief.ratio()(z_hat) - 1)))


def _save(job: Job, name: str, text: str) -> str:
    return str(job.put(f"processed/{FOLDER}/{name}", text.encode()))


def write_c(job: Job) -> str:
    """lift_model.h."""
    return _save(job, "lift_model.h", c.header(deck(job)))


def write_json(job: Job) -> str:
    """lift_model.json, and its schema beside it."""
    _save(job, "lift_model.schema.json", json.dumps(document.SCHEMA, indent=1) + "\n")
    return _save(
        job,
        "lift_model.json",
        json.dumps(store.plain(document.document(deck(job))), indent=1, ensure_ascii=False) + "\n",
    )


def write_python(job: Job) -> str:
    """lift_model.py."""
    return _save(job, "lift_model.py", python.module(deck(job)))


def write_casadi(job: Job) -> str:
    """lift_model_casadi.py."""
    return _save(job, "lift_model_casadi.py", python.casadi(deck(job)))
