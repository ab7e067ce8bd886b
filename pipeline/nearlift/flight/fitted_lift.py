"""Fitted lift near one boundary: the quoted model, best estimate and draws of its parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nearlift.catalogue import titled
from nearlift.declare import Boundary, FloatArray, LiftModel, Parameter
from nearlift.flight import Ratio
from nearlift.likelihood import student
from nearlift.results.quotation import Correlation

#: Arguments of a model held at their reference value 1 in flight, where their effects change
#: nothing: the supply's fall is simulated as droop, and the rotor speed follows from the throttle.
AT_REFERENCE = ("supply_V", "supply_ref_V", "speed_hat")


@dataclass(frozen=True, slots=True)
class QuotedInterval:
    """An estimate and its 90 % interval; `bounded` is False where the data do not determine it."""

    value: float
    lo90: float
    hi90: float
    bounded: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedLift:
    """Fitted lift model of one boundary, with best estimate and draws of its parameters.

    Attributes
    ----------
    model : LiftModel
        The base model composed with the vehicle's effects.
    arguments : mapping
        Keyword arguments of the model other than its parameters.
    best : mapping of str to float
        Best estimates of the parameters.
    intervals : mapping of str to QuotedInterval
        Quoted 90 % intervals of the parameters that have one.
    number : int
        Number of draws.
    draws : mapping of str to array (number,)
        Draws of the parameters; empty, with `number` 1, where the model has no parameters.
    source : str
        Product that the draws come from.
    effects, left : tuple of str
        Named effects composed with the model, and those left out (of the bench, say).
    measured_z_hat : (float, float)
        Nearest and farthest station.
    supply_V : (float, float)
        Median and lowest supply voltage on record; nan where none was recorded.
    """

    boundary: Boundary
    model: LiftModel
    arguments: Mapping[str, Any]
    best: Mapping[str, float]
    intervals: Mapping[str, QuotedInterval]
    number: int
    draws: Mapping[str, FloatArray]
    source: str
    effects: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    measured_z_hat: tuple[float, float]
    supply_V: tuple[float, float] = (float("nan"), float("nan"))

    @property
    def title(self) -> str:
        """Title of the base model and of the effects composed with it."""
        return self.model.title.partition(" + ")[0] + "".join(
            f" with {titled(e)}" for e in self.effects
        )

    def parameters(self, member: int) -> dict[str, float]:
        """Parameters of draw `member`; -1 is the best estimate."""
        if member < 0:
            return dict(self.best)
        return {name: float(values[member]) for name, values in self.draws.items()}

    def ratio(self, member: int = -1, **changes: float) -> Ratio:
        """L / L_inf over z_hat of draw `member` (-1: best); `changes` replace model arguments."""
        values = {**self.arguments, **self.parameters(member), **changes}

        def ratio(z_hat: FloatArray) -> FloatArray:
            # a model that is constant may return one number
            lift = np.asarray(self.model(z_hat, **values), dtype=float)
            return np.broadcast_to(lift, np.shape(z_hat))

        return ratio

    @property
    def largest_change(self) -> float:
        """L / L_inf - 1 at the nearest station, best estimate."""
        return float(self.ratio()(np.array(self.measured_z_hat[:1]))[0] - 1.0)

    @property
    def ratios(self) -> list[Ratio]:
        """L / L_inf as functions of z_hat: the best estimate, then every draw."""
        return [self.ratio(m) for m in range(-1, self.number)]

    def drawn(self, z_hat: FloatArray) -> FloatArray:
        """L / L_inf of every draw at heights (n,): shape (number, n)."""
        columns = {name: values[:, None] for name, values in self.draws.items()}
        ratio = np.asarray(self.model(z_hat, **{**self.arguments, **columns}), dtype=float)
        return np.broadcast_to(ratio, (self.number, np.size(z_hat)))

    def droop(self, supply_end_V: float | None, member: int = -1) -> float:
        """Relative change of lift once the supply has fallen to `supply_end_V` (None: the lowest on
        record); 0 without a sag exponent or a known supply.
        """
        exponent = self.parameters(member).get("sag_exponent", 0.0)
        end = self.supply_V[1] if supply_end_V is None else supply_end_V
        left = end / self.supply_V[0]
        return float(left**exponent - 1.0) if exponent and np.isfinite(left) else 0.0


def drawn_parameters(
    parameters: Sequence[Parameter],
    intervals: Mapping[str, QuotedInterval],
    known: Correlation,
    number: int,
    rng: np.random.Generator,
) -> tuple[dict[str, float], dict[str, FloatArray]]:
    """Best estimates and draws of parameters: a split normal on each quoted 90 % interval,
    correlated as quoted (Gaussian copula).

    The 5 and 95 % points are the interval's ends, however asymmetric; draws are clipped to the
    parameter's bounds. A parameter that the data do not bound is drawn from its declared prior
    within the bounds; one without an interval keeps its declared value.
    """
    from scipy.special import ndtr

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
        quoted = intervals.get(p.name, QuotedInterval(p.value, p.value, p.value))
        best[p.name] = float(quoted.value)
        if quoted.bounded:
            below, above = quoted.value - quoted.lo90, quoted.hi90 - quoted.value
            u = np.where(n < 0, below, above) / student.NORMAL_90
            drawn = quoted.value + u * n
        else:
            prior = p.prior.frozen()
            first, last = prior.cdf(p.bounds)
            drawn = prior.ppf(first + (last - first) * ndtr(n))
        draws[p.name] = np.clip(drawn, *p.bounds)
    return best, draws
