"""What is believed of the lift near one boundary: the model that the loop ended with, its best estimate, and draws of its uncertainty.

Simulation, detection and export all take it from here. Where the loop named an effect that belongs to the vehicle (a saturated
ceiling, a sagging supply), the model is composed with it; one that belongs to the bench (a datum, a drift) stays there, and only the
coefficient that it corrected is taken along; draws then have the ends of the loop's intervals and the correlation of its refit.
Without an effect, draws come from the posterior where there is one, else from the fit's intervals and correlation. What no interval
bounds is drawn from its declared prior: it is not known, and does not fly as if it were.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary, Effect, FloatArray, LiftModel, Parameter, compose
from nearlift.products import DIAGNOSIS, FIT, POSTERIOR, TRIALS
from nearlift.randomness import generator
from nearlift.reduction.quality import rejected
from nearlift.stages.job import Job

#: The 95 % point of a standard normal: half of its 90 % interval.
HALF_90 = 1.6448536269514722


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
        return self.model.title.partition(" + ")[0] + "".join(f" with {e.replace('_', ' ')}" for e in self.effects)

    def parameters(self, member: int) -> dict[str, float]:
        """Parameters of one draw; -1 is the best estimate."""
        return dict(self.best) if member < 0 else {name: float(values[member]) for name, values in self.draws.items()}

    def ratio(self, member: int = -1, **changes: float) -> Callable[[FloatArray], FloatArray]:
        """L / L_inf as a function of z_hat for one draw; -1 is the best estimate. `changes` replace arguments of the model."""
        values = {**self.arguments, **self.parameters(member), **changes}
        return lambda z_hat: np.asarray(self.model(z_hat, **values), dtype=float)

    def spaced(self, factor: float) -> Callable[[FloatArray], FloatArray]:
        """The best estimate of L / L_inf for a vehicle whose rotors are so many times as far apart."""
        return self.ratio(-1, **{n: factor * float(v) for n, v in self.arguments.items() if n in ("spacing_hat", "diagonal_hat")})

    def droop(self, supply_end_V: float | None, member: int = -1) -> float:
        """Change of lift, as a fraction, that the supply has brought at the end of a flight: 0 unless the loop found that it matters."""
        exponent = self.parameters(member).get("sag_exponent", 0.0)
        end = self.supply_V[1] if supply_end_V is None else supply_end_V
        return float((end / self.supply_V[0]) ** exponent - 1.0) if exponent and np.isfinite(end / self.supply_V[0]) else 0.0


def believe(job: Job, boundary: Boundary, number: int) -> Belief:
    """The belief about one boundary, with so many draws."""
    fitted = job.read_json(FIT)
    name = fitted["base"][boundary]
    entry = fitted["boundaries"][boundary][name]
    model = catalogue.model(name)
    rng = generator(job.seed, "belief", boundary, name)
    found = _diagnosed(job, boundary)
    named = tuple(e for e in found.get("effects", [])) if found.get("verdict") == "effect" else ()
    flying = tuple(catalogue.effect(e["name"]) for e in named if catalogue.effect(e["name"]).belongs_to == "vehicle")
    if named or found.get("coefficients", {}).get("carried"):
        values = dict(found["coefficients"]["after"])
        for e in named:
            if e["name"] in {f.name for f in flying}:
                values |= e["parameters"]
        best, draws = _together(model, flying, values, found.get("joint"), number, rng)
        source = DIAGNOSIS.file
    elif (table := _posterior(job, boundary, name)) is not None:
        best = {p: float(e["value"]) for p, e in entry["parameters"].items()}
        pick = rng.permutation(len(next(iter(table.values()))))[:number]
        draws, source = {p: table[p][pick] for p in best}, POSTERIOR.file
    else:
        best, draws = _fitted(model, entry, number, rng)
        source = FIT.file
    whole = compose(model, *flying) if flying else model
    geometry = job.campaign.vehicle.geometry()
    trials = job.read(TRIALS)
    mine = (trials["boundary"] == boundary) & ~rejected(trials["quality"])
    z_hat = trials["z_hat"][mine]
    supply = trials["supply_V"][mine] if "supply_V" in trials else np.array([np.nan])
    known = np.isfinite(supply)
    volts = (float(np.median(supply[known])), float(supply[known].min())) if known.any() else (float("nan"), float("nan"))
    return Belief(
        boundary=boundary,
        model=whole,
        # the supply's fall over a flight is told apart, as its droop: here it stands at its reference
        arguments={n: geometry.get(n, 1.0) for n in whole.needs},
        best=best,
        number=len(next(iter(draws.values()))) if draws else 1,
        draws=draws,
        source=source,
        effects=tuple(f.name for f in flying),
        left=tuple(e["name"] for e in named if e["name"] not in {f.name for f in flying}),
        measured_z_hat=(float(z_hat.min()), float(z_hat[np.isfinite(z_hat)].max())),
        supply_V=volts,
    )


def _diagnosed(job: Job, boundary: Boundary) -> dict[str, Any]:
    if not (job.processed / DIAGNOSIS.file).is_file():
        return {}
    found: dict[str, Any] = job.read_json(DIAGNOSIS)["boundaries"].get(boundary, {})
    return found


def _posterior(job: Job, boundary: Boundary, model: str) -> dict[str, FloatArray] | None:
    """Draws of the base model's parameters, or None where the posterior was not sampled."""
    if not (job.processed / POSTERIOR.file).is_file():
        return None
    table = job.read(POSTERIOR)
    mine = (table["boundary"] == boundary) & (table["model"] == model)
    names = [p.name for p in catalogue.model(model).parameters]
    found = {n: np.asarray(table["value"][mine & (table["parameter"] == n)], dtype=float) for n in names}
    return found if names and all(len(v) for v in found.values()) else None


def _fitted(model: LiftModel, entry: Mapping[str, Any], number: int, rng: np.random.Generator) -> tuple[dict[str, float], dict[str, FloatArray]]:
    """Best estimate and draws from a fit's intervals and the correlation of its covariance."""
    names = list(entry["covariance"]["names"])
    covariance = np.asarray(entry["covariance"]["values"], dtype=float).reshape(len(names), len(names))
    u = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore"):
        known = covariance / np.outer(u, u)
    return _drawn(model.parameters, entry["parameters"], names, known, number, rng)


def _together(
    model: LiftModel,
    effects: tuple[Effect, ...],
    values: Mapping[str, Any],
    joint: Mapping[str, Any] | None,
    number: int,
    rng: np.random.Generator,
) -> tuple[dict[str, float], dict[str, FloatArray]]:
    """Best estimate and draws by the loop's intervals, which hold what rivals would say, with the correlation of its refit (independent
    where none is on record).
    """
    parameters = (*model.parameters, *(p for e in effects for p in e.parameters))
    names, known = ([], np.eye(0)) if joint is None else (joint["parameters"], np.asarray(joint["correlation"], dtype=float))
    return _drawn(parameters, values, names, known, number, rng)


def _drawn(
    parameters: Sequence[Parameter],
    values: Mapping[str, Any],
    names: Sequence[str],
    known: FloatArray,
    number: int,
    rng: np.random.Generator,
) -> tuple[dict[str, float], dict[str, FloatArray]]:
    """Best estimate and draws of parameters by their intervals, normal on either side of the estimate, with the correlation that is known.

    Draws have the interval's ends at 5 and 95 %, whatever its shape, and keep to the bounds. An interval without an end leaves the declared
    prior. A parameter without an entry, or whose entry has no interval at all (it was held), stays where it is.
    """
    if not parameters:
        return {}, {}
    correlation = np.eye(len(parameters))
    at = {n: i for i, n in enumerate(names)}
    for i, a in enumerate(parameters):
        for j, b in enumerate(parameters):
            if i != j and a.name in at and b.name in at:
                # a parameter at its bound may have no variance, and then no correlation
                correlation[i, j] = np.nan_to_num(known[at[a.name], at[b.name]])
    normal = rng.multivariate_normal(np.zeros(len(parameters)), correlation, size=number, method="eigh")
    best, draws = {}, {}
    for p, n in zip(parameters, normal.T, strict=True):
        e = values.get(p.name)
        best[p.name] = p.value if e is None else float(e["value"])
        ends = None if e is None or "lo90" not in e else (e["lo90"], e["hi90"])
        if ends is None:
            drawn = np.full(number, best[p.name])
        elif None in ends:
            prior = p.prior.frozen()
            first, last = prior.cdf(p.bounds)
            drawn = prior.ppf(first + (last - first) * _share(n))
        else:
            below, above = (best[p.name] - float(ends[0])) / HALF_90, (float(ends[1]) - best[p.name]) / HALF_90
            drawn = best[p.name] + np.where(n < 0, below, above) * n
        draws[p.name] = np.clip(drawn, *p.bounds)
    return best, draws


def _share(normal: FloatArray) -> FloatArray:
    """Where each lies in the standard normal distribution, 0 to 1."""
    from scipy.special import ndtr

    shares: FloatArray = ndtr(normal)
    return shares
