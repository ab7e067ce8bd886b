"""Lift of each boundary as it is quoted, for flights, detection and exports.

An identified effect of the vehicle, such as supply sag, is part of the model. One of the bench,
such as a drift, is not; only the coefficient that it corrected is used. Values and intervals are
the most probable explanation's where effects are identified, else those quoted. Draws have the ends
of these intervals and their correlation. What no interval bounds is drawn from its declared prior:
it is not known, and does not fly as if it were.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import catalogue
from nearlift.campaign.manifest import Campaign, boundaries_of
from nearlift.declare import Boundary, LiftModel, compose
from nearlift.errors import InputRefused
from nearlift.flight.fitted_lift import AT_REFERENCE, FittedLift, QuotedInterval, drawn_parameters
from nearlift.randomness import generator
from nearlift.reduction.quality import rejected
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.fit import FitResults
from nearlift.results.quotation import Results


@dataclass(frozen=True, slots=True, kw_only=True)
class QuotedLifts:
    """Results of a campaign in which its lift is quoted, and its trials.

    Attributes
    ----------
    fits, results : FitResults, Results
        fit.json and results.json.
    findings : mapping
        Findings of the loop at each boundary that was diagnosed.
    """

    campaign: Campaign
    seed: int
    trials: Mapping[str, NDArray[Any]]
    fits: FitResults
    results: Results
    findings: Mapping[Boundary, BoundaryDiagnosis]

    @property
    def boundaries(self) -> list[Boundary]:
        """Boundaries that were fitted, in the order ground, ceiling, sidewall."""
        return boundaries_of(self.fits.boundaries)

    def levels(self, boundary: Boundary) -> tuple[dict[float, tuple[float, float]], float]:
        """L_inf and its standard uncertainty by throttle, N, and the relative scatter of trials.

        They are those of the accepted model where the boundary was diagnosed, else of the base fit.
        """
        if self.results.boundaries[boundary].verdict == "not_diagnosed":
            fitted = self.fits.of_base(boundary).L_inf_N
            relative = self.fits.noise[boundary].relative
            return {t: (e.value, e.u) for t, e in fitted.items()}, relative
        loop = self.findings[boundary]
        return {t: (e.value, e.u) for t, e in loop.L_inf_N.items()}, loop.noise.relative

    def lift(self, boundary: Boundary, number: int) -> FittedLift:
        """The lift of one boundary, with so many draws."""
        quoted = self.results.boundaries[boundary]
        model = catalogue.model(quoted.base_model)
        intervals = {
            name: QuotedInterval(c.value, c.lo90, c.hi90, bounded=c.dof > 0)
            for name, c in quoted.coefficients.items()
        }
        if accepted := self.findings[boundary].accepted if quoted.effects else None:
            # means over rivals draw none of them
            open_ended = {name for name, c in intervals.items() if not c.bounded}
            intervals |= {
                name: QuotedInterval(p.value, p.lo90, p.hi90, bounded=name not in open_ended)
                for name, p in accepted.parameters.items()
            }
        flying, left = [], []
        for effect in map(catalogue.effect, quoted.effects):
            if effect.belongs_to == "vehicle":
                flying.append(effect)
            else:
                left.append(effect.name)
        parameters = (*model.parameters, *(p for e in flying for p in e.parameters))
        rng = generator(self.seed, "belief", boundary, model.name)
        best, draws = drawn_parameters(parameters, intervals, quoted.correlation, number, rng)
        whole = compose(model, *flying) if flying else model
        trials = self.trials
        mine = (trials["boundary"] == boundary) & ~rejected(trials["quality"])
        z_hat = trials["z_hat"][mine]
        supply = trials["supply_V"][mine] if "supply_V" in trials else np.array([np.nan])
        supply = supply[np.isfinite(supply)] if np.isfinite(supply).any() else np.array([np.nan])
        return FittedLift(
            boundary=boundary,
            model=whole,
            arguments=_arguments(whole, self.campaign, trials, mine),
            best=best,
            intervals={name: intervals[name] for name in best if name in intervals},
            number=len(next(iter(draws.values()))) if draws else 1,
            draws=draws,
            source=Results.file,
            effects=tuple(f.name for f in flying),
            left=tuple(left),
            measured_z_hat=(float(z_hat.min()), float(z_hat[np.isfinite(z_hat)].max())),
            supply_V=(float(np.median(supply)), float(supply.min())),
        )


def _arguments(
    model: LiftModel,
    campaign: Campaign,
    trials: Mapping[str, NDArray[Any]],
    mine: NDArray[np.bool_],
) -> dict[str, Any]:
    """Arguments of a model that are constant over a flight; refused where trials differ in them, or
    one distance is not enough.
    """
    known = dict.fromkeys(AT_REFERENCE, 1.0) | campaign.geometry()
    if "gap_hat" in model.needs:
        raise InputRefused(
            f"model {model.name}",
            "lift between two boundaries is for fits; flights, detection and exports have one"
            " distance to one boundary",
            "choose another `base` for them",
        )
    for name in (n for n in model.needs if n not in known):
        values = np.unique(trials[name][mine]) if name in trials else np.array([np.nan])
        if len(values) != 1 or np.isnan(values[0]):
            raise InputRefused(
                f"model {model.name}",
                f"needs {name}, which is not one and the same in all trials, and a flight has one",
                "choose another `base`, or exclude the trials that differ",
            )
        known[name] = float(values[0])
    return {n: known[n] for n in model.needs}
