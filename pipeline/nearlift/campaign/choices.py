"""Choices of the manifest, each with a default: fit, levels, quality, closed loop, and the
predictions of `[design]`, `[simulate]` and `[detect]`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from nearlift.campaign import quantities as si
from nearlift.campaign.quantities import Section
from nearlift.declare import Boundary

Positive = Annotated[float, Field(gt=0)]
Probability = Annotated[float, Field(gt=0, lt=1)]
Rare = Annotated[float, Field(gt=0, lt=0.5)]


class Levels(Section):
    """Dependence of L_inf on throttle: one level for each, or a curve.

    A curve is a polynomial of ln L_inf in the logarithms of the schedule's columns `of`. `degree` 1
    is a power law; without a degree, cross-validation over visits chooses it.
    """

    by: Literal["throttle", "curve"]
    of: Annotated[list[str], si.Distinct] = ["throttle"]
    degree: int | None = Field(default=None, ge=1, le=4)

    @model_validator(mode="after")
    def _of_a_curve(self) -> Self:
        given = self.model_fields_set - {"by"}
        if self.by == "throttle" and given:
            raise ValueError(f'{" and ".join(sorted(given))} go with by = "curve"')
        if "throttle" not in self.of:
            raise ValueError('of needs "throttle": without it all throttles would share one L_inf')
        return self


class FitChoice(Section):
    """The base model of one boundary and its rivals."""

    base: str | None = None
    rivals: list[str] | None = None


class FitOptions(Section):
    """Models of each boundary, and sampling of their posteriors.

    `ess` is the number of effective draws, `steps` the limit of emcee's steps; `netcdf` writes
    posterior.nc as well.
    """

    ground: FitChoice = FitChoice()
    ceiling: FitChoice = FitChoice()
    sidewall: FitChoice = FitChoice()
    ess: int = Field(default=4000, ge=100, le=1_000_000)
    steps: int = Field(default=20_000, ge=400, le=10_000_000)
    netcdf: bool = False


class Quality(Section):
    """Limits of the quality codes, as fractions of the trial's lift; `height` of rotor radius.

    With `near_reference`, a throttle without a far station takes its L_inf from its farthest one.
    `exclude` maps the ids of excluded trials to the reasons; a list of ids gives none.
    """

    drift: Positive = 0.05
    missing: Probability = 0.05
    out_of_range: float = Field(default=0.01, ge=0, lt=1)
    height: Positive = 0.02
    near_reference: bool = False
    exclude: dict[str, str] = {}

    @field_validator("exclude", mode="before")
    @classmethod
    def _reasons(cls, value: Any) -> Any:
        return {str(trial): "" for trial in value} if isinstance(value, list) else value


class Diagnose(Section):
    """Choices of the closed loop.

    `not_feasible` lists moves that the bench cannot make, so that they are not proposed.
    `planned_trials` is the final number of trials, if the schedule does not list all of them.
    """

    false_alarm_rate: Probability = 0.05
    planned_trials: int | None = Field(default=None, ge=1)
    not_feasible: list[Literal["closer", "farther", "both directions"]] = []


class PlannedNoise(Section):
    """Expected scatter of trials: proportional to lift, additive, and of a visit's height."""

    relative: si.Share
    force: si.Scatter = 0.0
    height: si.Length = 0.0


class Planned(Section):
    """A planned campaign for `nearlift design`.

    `distances` are readings of the traverse; one that is listed twice is visited twice a round.
    `lift` is L_inf at each throttle. `supply` is the range within each session, `temperature` over
    the campaign; `tilt` lists the values of visits.
    """

    distances: dict[Boundary, Annotated[list[si.Length], Field(min_length=1)]] = Field(min_length=1)
    throttles: Annotated[list[si.Share], Field(min_length=1), si.Distinct]
    lift: list[si.Force] | None = None
    visits: int = Field(default=15, ge=1, le=10_000)
    sessions: int = Field(default=5, ge=1, le=10_000)
    trial: si.Duration = 20.0
    move: si.Duration = 8.0
    change: si.Duration = 300.0
    overshoot: si.Length | None = None
    supply: list[si.Voltage] | None = Field(default=None, min_length=2, max_length=2)
    temperature: list[si.Temperature] | None = Field(default=None, min_length=2, max_length=2)
    tilt: list[si.Angle] | None = None
    logs: list[str] = []
    noise: PlannedNoise | None = None
    expected: dict[Boundary, dict[str, float]] = {}

    @model_validator(mode="after")
    def _lift_of_each_throttle(self) -> Self:
        if self.lift is not None and len(self.lift) != len(self.throttles):
            raise ValueError(
                f"lift lists {len(self.lift)} values for {len(self.throttles)} throttles"
            )
        return self


def _no_wall(boundary: Boundary) -> Boundary:
    if boundary == "sidewall":
        raise ValueError("flights go up and down: ground or ceiling")
    return boundary


Flown = Annotated[Boundary, AfterValidator(_no_wall)]


class GainSet(Section):
    """Gains of Eq. 5 at one boundary, negative above a ground, positive below a ceiling."""

    proportional: si.ProportionalGain
    derivative: si.DerivativeGain
    integral: si.IntegralGain


class Gusts(Section):
    """The random vertical force: standard deviation, N; hold time and correlation time, s."""

    sd: si.Force
    hold: si.PositiveDuration
    correlation: si.Duration = 0.0


class Simulate(Section):
    """Simulated flights near the boundaries.

    Without gains or gusts, a vehicle gets the paper's at equal dimensionless groups.
    """

    flights: int = Field(default=1000, ge=20, le=1_000_000)
    presets: Annotated[list[Literal["paper", "converged"]], si.Distinct] = ["paper", "converged"]
    gains: dict[Flown, GainSet] = {}
    gusts: Gusts | None = None
    set_points: dict[Flown, Annotated[list[Positive], Field(min_length=2), si.Ascending]] = {}
    draws: int = Field(default=16, ge=2, le=100_000)
    risks: Annotated[list[Probability], Field(min_length=1), si.Distinct] = [0.5, 0.01]
    roll_inertia: si.Inertia | None = None


class LiftReading(Section):
    """A measured lift ratio or hover throttle, to be converted to a distance.

    `u` is the standard uncertainty of the ratio or throttle, a fraction. `weight` and `supply` are
    relative standard uncertainties, for a throttle only (default: the first of [detect]'s lists).
    `mass` includes the payload, kg.
    """

    boundary: Boundary
    ratio: Positive | None = None
    throttle: si.Share | None = None
    u: si.Fraction
    weight: si.Fraction | None = None
    supply: si.Fraction | None = None
    mass: si.Mass | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.ratio is None) == (self.throttle is None):
            raise ValueError(
                'takes a ratio or a throttle, one of both\nratio = 1.12, or throttle = "55 percent"'
            )
        return self


class Detect(Section):
    """Detection of a boundary from lift or hover throttle; uncertainties are standard, fractions.

    `false_alarm_rate` is per decision; `significant` is the smallest change of lift that matters.
    """

    false_alarm_rate: Rare = 0.01
    miss_rate: Rare = 0.1
    significant: si.Share = 0.02
    averaging: list[si.Duration] = [0.01, 0.1, 1.0, 10.0, 100.0]
    force_noise: si.Force | None = None
    force_bandwidth: si.Rate | None = None
    payload: list[si.Fraction] = Field(default=[0.0, 0.01, 0.05], min_length=1)
    supply: list[si.Fraction] = Field(default=[0.0], min_length=1)
