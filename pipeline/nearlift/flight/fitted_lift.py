"""Lift near one boundary as it is quoted: the model that the loop ended with, its best estimate,
and draws of its uncertainty. Simulation, detection and export fly, invert and write this.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nearlift.catalogue import titled
from nearlift.declare import Boundary, FloatArray, LiftModel, Parameter
from nearlift.results.quotation import Correlation

#: The 95 % point of a standard normal: half of its 90 % interval.
HALF_90 = 1.6448536269514722
Ratio = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class QuotedInterval:
    """An estimate and its 90 % interval; `bounded` is whether the data bound it at all."""

    value: float
    lo90: float
    hi90: float
    bounded: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedLift:
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
    intervals : mapping of str to QuotedInterval
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
        """The model in words, with the effects that fly."""
        return self.model.title.partition(" + ")[0] + "".join(
            f" with {titled(e)}" for e in self.effects
        )

    def parameters(self, member: int) -> dict[str, float]:
        """Parameters of one draw; -1 is the best estimate."""
        return (
            dict(self.best)
            if member < 0
            else {name: float(values[member]) for name, values in self.draws.items()}
        )

    def ratio(self, member: int = -1, **changes: float) -> Ratio:
        """L / L_inf as a function of z_hat for one draw; -1 is the best estimate. `changes` replace
        arguments of the model.
        """
        values = {**self.arguments, **self.parameters(member), **changes}
        return lambda z_hat: np.asarray(self.model(z_hat, **values), dtype=float)

    @property
    def largest_change(self) -> float:
        """Change of lift at the nearest station, as a fraction."""
        return float(self.ratio()(np.array(self.measured_z_hat[:1]))[0] - 1.0)

    @property
    def ratios(self) -> list[Ratio]:
        """The best estimate and every draw after it."""
        return [self.ratio(m) for m in range(-1, self.number)]

    def drawn(self, z_hat: FloatArray) -> FloatArray:
        """L / L_inf of every draw, (number, n)."""
        columns = {name: values[:, None] for name, values in self.draws.items()}
        ratio = np.asarray(self.model(z_hat, **{**self.arguments, **columns}), dtype=float)
        return np.broadcast_to(ratio, (self.number, np.size(z_hat)))

    def spaced(self, factor: float) -> Ratio:
        """The best estimate of L / L_inf for a vehicle whose rotors are so many times as
        far apart.
        """
        spacings = ("spacing_hat", "diagonal_hat")
        changes = {n: factor * float(v) for n, v in self.arguments.items() if n in spacings}
        return self.ratio(-1, **changes)

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


def drawn_parameters(
    parameters: Sequence[Parameter],
    intervals: Mapping[str, QuotedInterval],
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
            drawn = quoted.value + np.where(n < 0, below / HALF_90, above / HALF_90) * n
        else:
            prior = p.prior.frozen()
            first, last = prior.cdf(p.bounds)
            drawn = prior.ppf(first + (last - first) * ndtr(n))
        draws[p.name] = np.clip(drawn, *p.bounds)
    return best, draws
