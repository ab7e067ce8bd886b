"""What is believed of the lift near one boundary: the model that the loop ended with, its best
estimate, and draws of its uncertainty.

Simulation, detection and export all take it from here. Where the loop named an effect that belongs
to the vehicle (a saturated ceiling, a sagging supply), the model is composed with it; one that
belongs to the bench (a datum, a drift) stays there, and only the coefficient that it corrected is
taken along. Draws have the ends of the intervals that are quoted (results.json) and their
correlation. What no interval bounds is drawn from its declared prior: it is not known, and does not
fly as if it were.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary, FloatArray, LiftModel, Parameter, compose
from nearlift.products import DIAGNOSIS, RESULTS, TRIALS
from nearlift.quotation import Correlation, Results
from nearlift.randomness import generator
from nearlift.reduction.quality import rejected
from nearlift.run.job import Job

#: The 95 % point of a standard normal: half of its 90 % interval.
HALF_90 = 1.6448536269514722


class Span(NamedTuple):
    """An estimate and its 90 % interval; `told` is whether the data bound it at all."""

    value: float
    lo90: float
    hi90: float
    told: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Belief:
    """Lift near one boundary, with its uncertainty.

    Attributes
    ----------
    boundary : Boundary
    model : LiftModel
        With the vehicle's effects.
    arguments : mapping
        What the model needs besides its parameters.
    best : mapping of str to float
        Parameters at their best estimate.
    number : int
        How many draws there are.
    spans : mapping of str to Span
        The same with their 90 % intervals, as quoted.
    draws : mapping of str to array (number,)
        Draws of the same; empty, and one draw, where the model leaves nothing free.
    source : str
        The product that the draws come from.
    effects, left : tuple of str
        Named effects that fly, and those that stay on the bench.
    measured_z_hat : (float, float)
        Nearest and farthest station; nothing was measured beyond.
    supply_V : (float, float)
        Median and lowest supply on record; nan where none was.
    """

    boundary: Boundary
    model: LiftModel
    arguments: Mapping[str, Any]
    best: Mapping[str, float]
    spans: Mapping[str, Span]
    number: int
    draws: Mapping[str, FloatArray]
    source: str
    effects: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    measured_z_hat: tuple[float, float]
    supply_V: tuple[float, float] = (float("nan"), float("nan"))

    @property
    def title(self) -> str:
        """The model in words, with the effects that fly."""
        return self.model.title.partition(" + ")[0] + "".join(
            f" with {e.replace('_', ' ')}" for e in self.effects
        )

    def parameters(self, member: int) -> dict[str, float]:
        """Parameters of one draw; -1 is the best estimate."""
        return (
            dict(self.best)
            if member < 0
            else {name: float(values[member]) for name, values in self.draws.items()}
        )

    def ratio(self, member: int = -1, **changes: float) -> Callable[[FloatArray], FloatArray]:
        """L / L_inf as a function of z_hat for one draw; -1 is the best estimate. `changes` replace
        arguments of the model.
        """
        values = {**self.arguments, **self.parameters(member), **changes}
        return lambda z_hat: np.asarray(self.model(z_hat, **values), dtype=float)

    def spaced(self, factor: float) -> Callable[[FloatArray], FloatArray]:
        """The best estimate of L / L_inf for a vehicle whose rotors are so many times as
        far apart.
        """
        return self.ratio(
            -1,
            **{
                n: factor * float(v)
                for n, v in self.arguments.items()
                if n in ("spacing_hat", "diagonal_hat")
            },
        )

    def droop(self, supply_end_V: float | None, member: int = -1) -> float:
        """Change of lift, as a fraction, that the supply has brought at the end of a flight: 0
        unless the loop found that it matters.
        """
        exponent = self.parameters(member).get("sag_exponent", 0.0)
        end = self.supply_V[1] if supply_end_V is None else supply_end_V
        return (
            float((end / self.supply_V[0]) ** exponent - 1.0)
            if exponent and np.isfinite(end / self.supply_V[0])
            else 0.0
        )


def believe(job: Job, boundary: Boundary, number: int) -> Belief:
    """The belief about one boundary, with so many draws."""
    quoted = Results.model_validate(job.read_json(RESULTS)).boundaries[boundary]
    model = catalogue.model(quoted.base_model)
    rng = generator(job.seed, "belief", boundary, model.name)
    named = _named(job, boundary) if quoted.effects else []
    flying = tuple(
        catalogue.effect(e["name"])
        for e in named
        if catalogue.effect(e["name"]).belongs_to == "vehicle"
    )
    spans: dict[str, Span] = {
        name: Span(c.value, c.lo90, c.hi90, told=c.dof > 0)
        for name, c in quoted.coefficients.items()
    }
    for e in named:
        if e["name"] in {f.name for f in flying}:
            spans |= {
                name: Span(p["value"], p["lo90"], p["hi90"]) for name, p in e["parameters"].items()
            }
    parameters = (*model.parameters, *(p for e in flying for p in e.parameters))
    best, draws = _drawn(parameters, spans, quoted.correlation, number, rng)
    whole = compose(model, *flying) if flying else model
    geometry = job.campaign.vehicle.geometry()
    trials = job.read(TRIALS)
    mine = (trials["boundary"] == boundary) & ~rejected(trials["quality"])
    z_hat = trials["z_hat"][mine]
    supply = trials["supply_V"][mine] if "supply_V" in trials else np.array([np.nan])
    known = np.isfinite(supply)
    volts = (
        (float(np.median(supply[known])), float(supply[known].min()))
        if known.any()
        else (float("nan"), float("nan"))
    )
    return Belief(
        boundary=boundary,
        model=whole,
        # the supply's fall over a flight is told apart, as its droop: here it stands at its
        # reference
        arguments={n: geometry.get(n, 1.0) for n in whole.needs},
        best=best,
        spans={name: spans[name] for name in best if name in spans},
        number=len(next(iter(draws.values()))) if draws else 1,
        draws=draws,
        source=RESULTS.file,
        effects=tuple(f.name for f in flying),
        left=tuple(e["name"] for e in named if e["name"] not in {f.name for f in flying}),
        measured_z_hat=(float(z_hat.min()), float(z_hat[np.isfinite(z_hat)].max())),
        supply_V=volts,
    )


def _named(job: Job, boundary: Boundary) -> list[dict[str, Any]]:
    """The named effects with their parameters."""
    found: list[dict[str, Any]] = job.read_json(DIAGNOSIS)["boundaries"][boundary]["effects"]
    return found


def _drawn(
    parameters: Sequence[Parameter],
    spans: Mapping[str, Span],
    known: Correlation,
    number: int,
    rng: np.random.Generator,
) -> tuple[dict[str, float], dict[str, FloatArray]]:
    """Best estimate and draws of parameters by their intervals, normal on either side of the
    estimate, with the correlation that is known.

    Draws have the interval's ends at 5 and 95 %, whatever its shape, and keep to the bounds. What
    the data do not bound has its declared prior. A parameter without an interval stays at its
    declared value.
    """
    if not parameters:
        return {}, {}
    correlation = np.eye(len(parameters))
    at = {n: i for i, n in enumerate(known.parameters)}
    for i, a in enumerate(parameters):
        for j, b in enumerate(parameters):
            if i != j and a.name in at and b.name in at:
                correlation[i, j] = known.values[at[a.name]][at[b.name]]
    normal = rng.multivariate_normal(
        np.zeros(len(parameters)), correlation, size=number, method="eigh"
    )
    best, draws = {}, {}
    for p, n in zip(parameters, normal.T, strict=True):
        span = spans.get(p.name, Span(p.value, p.value, p.value))
        best[p.name] = float(span.value)
        if span.told:
            below, above = (span.value - span.lo90) / HALF_90, (span.hi90 - span.value) / HALF_90
            drawn = span.value + np.where(n < 0, below, above) * n
        else:
            prior = p.prior.frozen()
            first, last = prior.cdf(p.bounds)
            drawn = prior.ppf(first + (last - first) * _share(n))
        draws[p.name] = np.clip(drawn, *p.bounds)
    return best, draws


def _share(normal: FloatArray) -> FloatArray:
    """Where each lies in the standard normal distribution, 0 to 1."""
    from scipy.special import ndtr

    shares: FloatArray = ndtr(normal)
    return shares
