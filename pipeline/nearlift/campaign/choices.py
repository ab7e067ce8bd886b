"""Choices of the manifest, each with a default: fit, levels, report, quality, closed loop."""

from __future__ import annotations

from pathlib import PurePath
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from nearlift.campaign.quantities import PositiveLength, Section
from nearlift.declare import Boundary


class Levels(Section):
    """Dependence of L_inf on throttle: one level for each, or a curve.

    A curve is a polynomial of ln L_inf in the logarithms of the schedule's columns `of`. `degree` 1
    is a power law; without a degree, cross-validation over visits chooses it.
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
    """The base model of one boundary and its rivals."""

    base: str | None = None
    rivals: list[str] | None = None


class FitOptions(Section):
    """Models of each boundary, and sampling of their posteriors.

    `ess` is the number of effective draws, `steps` the limit of emcee's steps; `netcdf` writes
    posterior.nc as well.
    """

    ground: FitChoice | None = None
    ceiling: FitChoice | None = None
    sidewall: FitChoice | None = None
    ess: int = Field(default=4000, ge=100, le=1_000_000)
    steps: int = Field(default=20_000, ge=400, le=10_000_000)
    netcdf: bool = False

    def choice(self, boundary: Boundary) -> FitChoice | None:
        """The choice of models for one boundary, if there is one."""
        chosen: FitChoice | None = getattr(self, boundary)
        return chosen


class Overlay(Section):
    """Measured data of others for Figure 2.

    It is a CSV with the columns z_hat, delta_L and u (fractions). Or it is the name of a data set
    or campaign that was run in this workspace.

    A string is short for its file, with the file's name as label. Without `boundary` it is the
    CSV's own column, else the ground.
    """

    file: str
    label: str
    boundary: Boundary | None = None

    @model_validator(mode="before")
    @classmethod
    def _named(cls, value: object) -> object:
        if isinstance(value, str):
            return {"file": value, "label": PurePath(value).name.removesuffix(".csv")}
        return value


class Units(Section):
    """Units of forces (`auto`: N or mN by the vehicle) and distances in the report. Products and
    CSV files keep theirs.
    """

    force: Literal["auto", "N", "mN", "gf"] = "auto"
    distance: Literal["z_hat", "mm"] = "z_hat"


class Report(Section):
    """Figures of the report: widths of one column (3.25 in) and of the whole text (6.75 in)."""

    column_width: PositiveLength = Field(default=0.08255, ge=0.05, le=0.5)
    full_width: PositiveLength = Field(default=0.17145, ge=0.05, le=0.5)
    units: Units = Units()
    overlay: list[Overlay] = []


class Quality(Section):
    """Limits of the quality codes, as fractions of the trial's lift; `height` of rotor radius.

    With `near_reference`, a throttle without a far station takes its L_inf from its farthest one.
    `exclude` maps the ids of excluded trials to the reasons; a list of ids gives none.
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

    `not_feasible` lists moves that the bench cannot make, so that they are not proposed.
    `planned_trials` is the final number of trials, if the schedule does not list all of them.
    """

    false_alarm_rate: float = Field(default=0.05, gt=0, lt=1)
    planned_trials: int | None = Field(default=None, ge=1)
    not_feasible: list[Literal["closer", "farther", "both directions"]] = []
