"""Ways to turn an effect up, and the chances with which a design sees and names it by size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from nearlift.declare import Effect, FloatArray, Parameter
from nearlift.loop.candidate import moments

#: A detection limit is the size seen with this chance.
LIMIT_POWER = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class Handle:
    """One way to turn an effect up: which of its sizes, with which shape. `shape` maps shape
    parameters to values.
    """

    effect: Effect
    parameter: Parameter
    shape: Mapping[str, float]

    @property
    def plausible(self) -> float:
        """The size that physics leads one to expect: the prior's standard deviation."""
        return moments(self.parameter)[1]

    @property
    def largest(self) -> float:
        """How far from its null the parameter may go."""
        low, high = self.parameter.bounds
        return max(high - self.parameter.value, self.parameter.value - low)

    @property
    def direction(self) -> float:
        """The side of the null that leaves more room."""
        low, high = self.parameter.bounds
        return 1.0 if high - self.parameter.value >= self.parameter.value - low else -1.0


def handles(effect: Effect) -> tuple[Handle, ...]:
    """One for each size of the effect, with the shape nearest to what its prior expects."""
    shape = {
        p.name: min(p.grid, key=lambda g, p=p: abs(g - moments(p)[0]))  # type: ignore[misc]
        for p in effect.parameters
        if p.grid
    }
    return tuple(
        Handle(effect=effect, parameter=p, shape=shape) for p in effect.parameters if not p.grid
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Power:
    """Chances against size (away from the null, in the parameter's unit); arrays (m,).

    `seen`: the test of everything exceeds its threshold. `within`: the effect is then among the
    names or their rivals; `first`: it is the one named; `alone`: named without a rival. All before
    the confirmation on held-out visits.
    """

    size: FloatArray
    seen: FloatArray
    within: FloatArray
    first: FloatArray
    alone: FloatArray

    def limit(self, of: str = "seen", at: float = LIMIT_POWER) -> float | None:
        """The size that reaches the chance `at`; None if the largest one here does not."""
        chance = np.maximum.accumulate(getattr(self, of))
        if chance[-1] < at:
            return None
        above = int(np.argmax(chance >= at))
        if above == 0:
            return float(self.size[0])
        low, high = chance[above - 1], chance[above]
        return float(
            self.size[above - 1]
            + (at - low) / (high - low) * (self.size[above] - self.size[above - 1])
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Contest:
    """What an effect of one size would be taken for. Chances before the confirmation on held-out
    visits.

    `rivals`: every other candidate's chance to be named or a rival, given that structure is seen.
    """

    seen: float
    within: float
    first: float
    alone: float
    rivals: Mapping[str, float]
