"""Predictions that the manifest asks for: `[design]`, `[simulate]` and `[detect]`."""

from __future__ import annotations

import itertools
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from nearlift.campaign.quantities import (
    Angle,
    DerivativeGain,
    Duration,
    Force,
    Fraction,
    Inertia,
    IntegralGain,
    Length,
    Mass,
    PositiveDuration,
    ProportionalGain,
    Rate,
    Scatter,
    Section,
    Share,
    Temperature,
    Voltage,
)
from nearlift.declare import Boundary


class PlannedNoise(Section):
    """Expected scatter of trials: proportional to lift, additive, and of a visit's height."""

    relative: Share
    force: Scatter = 0.0
    height: Length = 0.0


class Planned(Section):
    """A planned campaign for `nearlift design`.

    `distances` are readings of the traverse; one that is listed twice is visited twice a round.
    `lift` is L_inf at each throttle. `supply` is the range within each session, `temperature` over
    the campaign; `tilt` lists the values of visits.
    """

    distances: dict[Boundary, list[Length]]
    throttles: list[Share] = Field(min_length=1)
    lift: list[Force] | None = None
    visits: int = Field(default=15, ge=1, le=10_000)
    sessions: int = Field(default=5, ge=1, le=10_000)
    trial: Duration = 20.0
    move: Duration = 8.0
    change: Duration = 300.0
    overshoot: Length | None = None
    supply: list[Voltage] | None = Field(default=None, min_length=2, max_length=2)
    temperature: list[Temperature] | None = Field(default=None, min_length=2, max_length=2)
    tilt: list[Angle] | None = None
    logs: list[str] = Field(default=[])
    noise: PlannedNoise | None = None
    expected: dict[Boundary, dict[str, float]] = Field(default={})

    @model_validator(mode="after")
    def _coherent(self) -> Self:
        if self.lift is not None and len(self.lift) != len(self.throttles):
            raise ValueError(
                f"lift lists {len(self.lift)} values for {len(self.throttles)} throttles"
            )
        if len(set(self.throttles)) != len(self.throttles):
            raise ValueError("a throttle is listed twice")
        if not self.distances or not all(self.distances.values()):
            raise ValueError('distances lists no station; write { ground = ["30 mm", "40 mm"] }')
        return self


def _unlike(values: list[Any]) -> list[Any]:
    if len(set(values)) != len(values):
        raise ValueError("names one of its values twice")
    return values


def _ascending(values: list[float]) -> list[float]:
    if any(b <= a for a, b in itertools.pairwise(values)):
        raise ValueError("must ascend")
    return values


def _no_wall(boundary: Boundary) -> Boundary:
    if boundary == "sidewall":
        raise ValueError(
            "a sidewall turns the vehicle, and flights go up and down: ground or ceiling"
        )
    return boundary


Flown = Annotated[Boundary, AfterValidator(_no_wall)]
Positive = Annotated[float, Field(gt=0)]
Probability = Annotated[float, Field(gt=0, lt=1)]


class GainSet(Section):
    """Gains of Eq. 5 at one boundary, negative above a ground, positive below a ceiling."""

    proportional: ProportionalGain
    derivative: DerivativeGain
    integral: IntegralGain


class Gusts(Section):
    """The random vertical force: standard deviation, N; hold time and correlation time, s."""

    sd: Force
    hold: PositiveDuration
    correlation: Duration = 0.0


class Simulate(Section):
    """Simulated flights near the boundaries.

    Without gains or gusts, a vehicle gets the paper's at equal dimensionless groups. Gains and
    gusts are those of the vehicle without payload. With another `mass` in flight, `scale_gains`
    keeps the poles of the control loop.
    """

    flights: int = Field(default=1000, ge=20, le=1_000_000)
    presets: Annotated[list[Literal["paper", "converged"]], AfterValidator(_unlike)] = Field(
        default=["paper", "converged"]
    )
    gains: dict[Flown, GainSet] = Field(default={})
    gusts: Gusts | None = None
    mass: Mass | None = None
    scale_gains: bool = True
    lift_coefficient: float = Field(default=1.6, gt=0)
    step: PositiveDuration | None = None
    duration: PositiveDuration | None = None
    set_points: dict[
        Flown, Annotated[list[Positive], Field(min_length=2), AfterValidator(_ascending)]
    ] = Field(default={})
    bound_z_hat: dict[Flown, Positive] = Field(default={})
    draws: int = Field(default=16, ge=2, le=100_000)
    risks: Annotated[list[Probability], Field(min_length=1), AfterValidator(_unlike)] = Field(
        default=[0.5, 0.01]
    )
    supply_end: Voltage | None = None
    roll_inertia: Inertia | None = None
    roll_inertia_uncertainty: Fraction | None = None


class LiftReading(Section):
    """A measured lift ratio or hover throttle, to be converted to a distance.

    `u` is the standard uncertainty of the ratio or throttle, a fraction. `weight` and `supply` are
    relative standard uncertainties, for a throttle only (default: the first of [detect]'s lists).
    `mass` includes the payload, kg.
    """

    boundary: Boundary
    ratio: float | None = Field(default=None, gt=0)
    throttle: Share | None = None
    u: Fraction
    weight: Fraction | None = None
    supply: Fraction | None = None
    mass: Mass | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.ratio is None) == (self.throttle is None):
            raise ValueError(
                'takes a ratio or a throttle, one of both\nratio = 1.12, or throttle = "55 percent"'
            )
        return self


def _listed(value: object) -> object:
    return value if isinstance(value, list) else [value]


class Detect(Section):
    """Detection of a boundary from lift or hover throttle; uncertainties are standard, fractions.

    `false_alarm_rate` is per decision; `significant` is the smallest change of lift that matters.
    """

    false_alarm_rate: float = Field(default=0.01, gt=0, lt=0.5)
    miss_rate: float = Field(default=0.1, gt=0, lt=0.5)
    significant: Share = 0.02
    averaging: list[Duration] = Field(default=[0.01, 0.1, 1.0, 10.0, 100.0])
    force_noise: Force | None = None
    force_bandwidth: Rate | None = None
    payload: list[Fraction] = Field(default=[0.0, 0.01, 0.05], min_length=1)
    supply: Annotated[list[Fraction], BeforeValidator(_listed)] = Field(default=[0.0], min_length=1)
    reading: list[LiftReading] = Field(default=[])
