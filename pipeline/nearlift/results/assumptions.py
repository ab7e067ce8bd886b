"""Checks of the base fits' assumptions, blocks of fit.json: whether one curve serves all throttles,
what a trial held constant, and C_L.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from nearlift.results.document import IfAny, NumberKey, Real, Unbounded
from nearlift.results.estimate import Estimate


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrottleCoefficient(Estimate):
    """A coefficient of one throttle; `u_apart` is the standard uncertainty of what it differs from
    the mean over throttles.
    """

    u_apart: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class CollapseTest:
    """An F test: what the freedom of `dof[0]` more unknowns gains, over noise known with `dof[1]`
    degrees of freedom.

    A gain smaller than noise would leave is no confirmation (`quiet`): the noise was then assumed
    too large, or of another shape.
    """

    statistic: Annotated[Real, Field(alias="F")]
    dof: tuple[int, Unbounded]
    p_value: Real
    quiet: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class LargestDeparture:
    """The two throttles that may differ most: by what fraction, and what 95 % confidence cannot
    exclude.
    """

    between: tuple[Real, Real]
    value: Real
    u: Real
    bound95: Unbounded


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrottleCollapse:
    """Whether the headline `coefficient` and the curve are the same at all throttles. Tests and
    departures that these trials cannot make are None.
    """

    coefficient: str
    per_throttle: Mapping[NumberKey, ThrottleCoefficient]
    tests: Mapping[str, CollapseTest | None]
    largest_departure: Mapping[str, LargestDeparture | None]
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ExponentFit(Estimate):
    """The headline coefficient with the ratio raised to `n`; `p_value` of n against the best,
    `supposes` where somebody supposes that exponent.
    """

    supposes: IfAny[str] = None
    n: Real
    p_value: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedResponse:
    """How a logged quantity answers to the boundary, and the exponents that theory then allows."""

    quantity: str
    response: Estimate
    p_value: Real
    held: bool
    spread: Real
    exponents: tuple[Real, Real] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ExponentRange:
    """Least and most of the headline coefficient over exponents `source` (``from`` in the file)."""

    source: Annotated[str, Field(alias="from")]
    low: Real
    high: Real
    lo90: Real
    hi90: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldQuantity:
    """Dependence of the headline coefficient on the exponent of the ratio (the held quantity)."""

    declared: str
    declared_text: str
    coefficient: str
    plausible: tuple[ExponentFit, ...]
    exponent_from_lift: Estimate | None
    logged: tuple[LoggedResponse, ...]
    supported_exponents: tuple[Real, Real] | None
    range: ExponentRange | None
    curve: tuple[ExponentFit, ...]
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrottleLift(Estimate):
    """C_L at one throttle, and the speed in it."""

    speed_Hz: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedLaw:
    """C_L of the power law at a speed in the middle."""

    C_L: Real
    speed_Hz: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorTrend:
    """C_L per throttle: one constant, and a power law of speed.

    `exponent` and `p_trend` are None for one throttle. `excess` is the factor by which scatter
    about the law widened its interval, `paper` the constant of the paper.
    """

    speed_from: str
    air_density: Real
    air_density_from: str
    per_throttle: Mapping[NumberKey, ThrottleLift]
    mean: Estimate
    p_constant: float | None
    exponent: Estimate | None
    law: SpeedLaw
    p_trend: float | None
    excess: Real
    paper: Real
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorUnknown:
    """C_L cannot be had for want of what is `missing`."""

    missing: tuple[str, ...]
    text: str


RotorCoefficient = RotorTrend | RotorUnknown
