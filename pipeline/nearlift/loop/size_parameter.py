"""Size parameters of effects, and the chances to detect and name an effect of one size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from nearlift.declare import Effect, Parameter
from nearlift.loop.candidate import moments

#: Power that defines a detection limit.
LIMIT_POWER = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeParameter:
    """One size parameter of an effect, with `shape` the values of its shape parameters."""

    effect: Effect
    parameter: Parameter
    shape: Mapping[str, float]

    @property
    def plausible(self) -> float:
        """Physically plausible size: the prior's width (`moments`)."""
        return moments(self.parameter)[1]

    @property
    def largest(self) -> float:
        """Largest distance from the null within the bounds."""
        low, high = self.parameter.bounds
        return max(high - self.parameter.value, self.parameter.value - low)

    @property
    def direction(self) -> float:
        """Side of the null that has more room within the bounds, 1 or -1."""
        low, high = self.parameter.bounds
        return 1.0 if high - self.parameter.value >= self.parameter.value - low else -1.0


def size_parameters(effect: Effect) -> tuple[SizeParameter, ...]:
    """Size parameters of the effect, each shape at the grid value nearest to its
    prior's centre.
    """
    shape = {
        p.name: min(p.grid, key=lambda g, p=p: abs(g - moments(p)[0]))  # type: ignore[misc]
        for p in effect.parameters
        if p.grid
    }
    return tuple(
        SizeParameter(effect=effect, parameter=p, shape=shape)
        for p in effect.parameters
        if not p.grid
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class NamingProbability:
    """Probabilities as in `Power`, for an effect of one size.

    `rivals`: probability that each other candidate is the name or a rival, given detection.
    """

    seen: float = 0.0
    within: float = 0.0
    first: float = 0.0
    alone: float = 0.0
    rivals: Mapping[str, float] = field(default_factory=dict)
