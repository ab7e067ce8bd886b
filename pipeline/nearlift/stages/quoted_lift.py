"""What flies, is detected and is exported: the fitted lift of one boundary, from results.json.

Where the loop named an effect that belongs to the vehicle (a saturated ceiling, a sagging supply),
the model is composed with it; one that belongs to the bench (a datum, a drift) stays there, and
only the coefficient that it corrected is taken along. Draws have the ends of the intervals that are
quoted and their correlation. What no interval bounds is drawn from its declared prior: it is not
known, and does not fly as if it were.
"""

from __future__ import annotations

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary, compose
from nearlift.flight.fitted_lift import FittedLift, QuotedInterval, drawn_parameters
from nearlift.products import RESULTS, TRIALS
from nearlift.randomness import generator
from nearlift.reduction.quality import rejected
from nearlift.results.diagnosis import DiagnosisResults
from nearlift.results.quotation import Results
from nearlift.run.job import Job


def fitted_lift(job: Job, boundary: Boundary, number: int) -> FittedLift:
    """The lift of one boundary, with so many draws."""
    quoted = job.load(Results).boundaries[boundary]
    model = catalogue.model(quoted.base_model)
    named = job.load(DiagnosisResults).boundaries[boundary].effects if quoted.effects else ()
    intervals = {
        name: QuotedInterval(c.value, c.lo90, c.hi90, bounded=c.dof > 0)
        for name, c in quoted.coefficients.items()
    }
    flying, left = [], []
    for block in named:
        effect = catalogue.effect(block.name)
        if effect.belongs_to == "vehicle":
            flying.append(effect)
            intervals |= {
                name: QuotedInterval(p.value, p.lo90, p.hi90)
                for name, p in block.parameters.items()
            }
        else:
            left.append(effect.name)
    parameters = (*model.parameters, *(p for e in flying for p in e.parameters))
    rng = generator(job.seed, "belief", boundary, model.name)
    best, draws = drawn_parameters(parameters, intervals, quoted.correlation, number, rng)
    whole = compose(model, *flying) if flying else model
    geometry = job.campaign.vehicle.geometry()
    trials = job.read(TRIALS)
    mine = (trials["boundary"] == boundary) & ~rejected(trials["quality"])
    z_hat = trials["z_hat"][mine]
    supply = trials["supply_V"][mine] if "supply_V" in trials else np.array([np.nan])
    supply = supply[np.isfinite(supply)] if np.isfinite(supply).any() else np.array([np.nan])
    return FittedLift(
        boundary=boundary,
        model=whole,
        # the supply's fall over a flight is told apart, as its droop: here it stands at its
        # reference
        arguments={n: geometry.get(n, 1.0) for n in whole.needs},
        best=best,
        intervals={name: intervals[name] for name in best if name in intervals},
        number=len(next(iter(draws.values()))) if draws else 1,
        draws=draws,
        source=RESULTS.file,
        effects=tuple(f.name for f in flying),
        left=tuple(left),
        measured_z_hat=(float(z_hat.min()), float(z_hat[np.isfinite(z_hat)].max())),
        supply_V=(float(np.median(supply)), float(supply.min())),
    )
