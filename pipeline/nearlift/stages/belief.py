"""What is believed of the lift near one boundary: the model that the loop ended with, its best estimate, and draws of its uncertainty.

Simulation, detection and export all take it from here. Where the loop named an effect that belongs to the vehicle (a saturated
ceiling, a sagging supply), the model is composed with it; one that belongs to the bench (a datum, a drift) stays there, and only the
coefficient that it corrected is taken along; draws then have the widths of the loop's intervals and the correlation of its refit.
Without an effect, draws come from the posterior where there is one, else from the fit's estimate and covariance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary, Effect, FloatArray, LiftModel, compose
from nearlift.products import DIAGNOSIS, FIT, POSTERIOR, TRIALS
from nearlift.randomness import generator
from nearlift.reduction.quality import rejected
from nearlift.stages.job import Job

#: Width of a 90 % interval over the standard uncertainty of a normal.
WIDTH_90 = 3.2897072539029444
#: Effects whose trace in flight is another than on the bench: the supply falls with time, not from trial to trial.
IN_TIME = "supply_sag"


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
    draws : mapping of str to array (m,)
        Draws of the same.
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
    draws: Mapping[str, FloatArray]
    source: str
    effects: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    measured_z_hat: tuple[float, float]
    supply_V: tuple[float, float] = (float("nan"), float("nan"))

    @property
    def number(self) -> int:
        """How many draws there are."""
        return len(next(iter(self.draws.values()))) if self.draws else 0

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
    if named:
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
        best, draws = _normal(model, entry, number, rng)
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


def _normal(model: LiftModel, entry: Mapping[str, Any], number: int, rng: np.random.Generator) -> tuple[dict[str, float], dict[str, FloatArray]]:
    """Best estimate and draws from a fit's covariance, within the parameters' bounds."""
    names = list(entry["covariance"]["names"])
    best = {n: float(e["value"]) for n, e in entry["parameters"].items()}
    if not names:
        return best, {n: np.full(number, v) for n, v in best.items()}
    covariance = np.asarray(entry["covariance"]["values"], dtype=float).reshape(len(names), len(names))
    values = rng.multivariate_normal([best[n] for n in names], covariance, size=number, method="eigh")
    return best, {n: np.clip(values[:, names.index(n)], *model.parameter(n).bounds) if n in names else np.full(number, best[n]) for n in best}


def _together(
    model: LiftModel,
    effects: tuple[Effect, ...],
    values: Mapping[str, Any],
    joint: Mapping[str, Any] | None,
    number: int,
    rng: np.random.Generator,
) -> tuple[dict[str, float], dict[str, FloatArray]]:
    """Best estimate and draws: each parameter with the width of its interval, which holds what rivals would say, all together with the
    correlation of the loop's refit (independent where none is on record).
    """
    parameters = [*model.parameters, *(p for e in effects for p in e.parameters)]
    names = [p.name for p in parameters]
    correlation = np.eye(len(names))
    if joint is not None:
        at = {n: i for i, n in enumerate(joint["parameters"])}
        known = np.asarray(joint["correlation"], dtype=float)
        for i, a in enumerate(names):
            for j, b in enumerate(names):
                if i != j and a in at and b in at:
                    correlation[i, j] = known[at[a], at[b]]
    normal = rng.multivariate_normal(np.zeros(len(names)), correlation, size=number, method="eigh")
    best, draws = {}, {}
    for i, p in enumerate(parameters):
        e = values.get(p.name)
        best[p.name] = p.value if e is None else float(e["value"])
        wide = e is not None and e.get("lo90") is not None and e.get("hi90") is not None
        u = (float(e["hi90"]) - float(e["lo90"])) / WIDTH_90 if wide and e is not None else 0.0
        draws[p.name] = np.clip(best[p.name] + u * normal[:, i], *p.bounds)
    return best, draws
