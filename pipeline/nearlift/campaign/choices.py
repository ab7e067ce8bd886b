"""Choices of the manifest, each with a default: fit, levels, report, quality, closed loop."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from nearlift.campaign.quantities import PositiveLength, Section
from nearlift.declare import Boundary


class Levels(Section):
    """How the lift far from every boundary hangs on throttle.

    Attributes
    ----------
    by : str
        "throttle": a level for each; "curve": its logarithm is a polynomial of the logarithms of
        `of`.
    of : list of str
        Columns of the schedule, the throttle among them, such as ``["throttle", "supply"]``.
    degree : int or None
        Of the polynomial, 1 being a power law; judged by visits left out where it is not given.
    """

    by: Literal["throttle", "curve"]
    of: list[str] = ["throttle"]
    degree: Annotated[int, Field(ge=1, le=4)] | None = None

    @model_validator(mode="after")
    def _of_a_curve(self) -> Self:
        given = self.model_fields_set - {"by"}
        if self.by == "throttle" and given:
            raise ValueError(f'{" and ".join(sorted(given))} go with by = "curve"')
        if "throttle" not in self.of:
            raise ValueError('of needs "throttle": without it all throttles would share one L_inf')
        if len(set(self.of)) < len(self.of):
            raise ValueError("of names a column twice")
        return self


class FitChoice(Section):
    """The base model of one boundary and the models that it is compared with."""

    base: str | None = None
    rivals: list[str] | None = None


class FitOptions(Section):
    """How models are fitted: the choice of models by boundary, and how their posteriors are
    sampled.

    `sampler` is "auto" (importance sampling where its check passes, else emcee), "emcee" or
    "importance"; `ess` the effective draws wanted; `steps` the most that emcee may take; `netcdf`
    asks for posterior.nc as well.
    """

    ground: FitChoice | None = None
    ceiling: FitChoice | None = None
    sidewall: FitChoice | None = None
    sampler: Literal["auto", "emcee", "importance"] = "auto"
    ess: int = Field(default=4000, ge=100, le=1_000_000)
    steps: int = Field(default=20_000, ge=400, le=10_000_000)
    netcdf: bool = False

    def choice(self, boundary: Boundary) -> FitChoice | None:
        """The choice of models for one boundary, where there is one."""
        chosen: FitChoice | None = getattr(self, boundary)
        return chosen


class Overlay(Section):
    """Further data for Figure 2: a CSV with the columns z_hat, delta_L and u (fractions)."""

    file: str
    label: str
    boundary: Boundary


class Units(Section):
    """Units in which the report shows forces (`auto`: N or mN, as suits the vehicle) and distances
    (`z_hat`: over rotor radius). Products and CSV files keep theirs.
    """

    force: Literal["auto", "N", "mN", "gf"] = "auto"
    distance: Literal["z_hat", "mm"] = "z_hat"


class Report(Section):
    """How figures look.

    `column_width`, `full_width`: width of a figure of one column and of the whole text; 3.25 in and
    6.75 in by default.

    `reference`: what Figure 2 takes Delta L from: the `fit` (its L_inf, with named effects taken
    out) or the `farthest` station, as the paper does.
    """

    column_width: PositiveLength = Field(default=0.08255, ge=0.05, le=0.5)
    full_width: PositiveLength = Field(default=0.17145, ge=0.05, le=0.5)
    units: Units = Units()
    reference: Literal["fit", "farthest"] = "fit"
    overlay: list[Overlay] = []


class Quality(Section):
    """Limits of the quality codes; fractions are of the trial's own lift, `height` of the rotor's
    radius.

    `near_reference`: a throttle without a station far from the boundary takes its L_inf from the
    farthest that it has, else it has no Delta L. `exclude`: trials to leave out, with the reason; a
    list of ids in the manifest has none.
    """

    drift: float = Field(default=0.05, gt=0)
    missing: float = Field(default=0.05, gt=0, lt=1)
    out_of_range: float = Field(default=0.01, ge=0, lt=1)
    height: float = Field(default=0.02, gt=0)
    near_reference: bool = False
    exclude: dict[str, str] = {}

    @field_validator("exclude", mode="before")
    @classmethod
    def _reasons(cls, value: Any) -> Any:
        return {str(trial): "" for trial in value} if isinstance(value, list) else value


class Diagnose(Section):
    """Choices of the closed loop.

    `not_feasible`: what this bench cannot do, so that it is not proposed: go closer than it did, go
    farther, arrive from both directions. `planned_trials`: how long the campaign will be, where the
    schedule does not say: it grows with the records, or the rest will not be measured.
    """

    false_alarm_rate: float = Field(default=0.05, gt=0, lt=1)
    planned_trials: int | None = Field(default=None, ge=1)
    not_feasible: list[Literal["closer", "farther", "both directions"]] = []
