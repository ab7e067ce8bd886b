"""results.json: of every coefficient the one value to quote, what its interval allows for, and on
what conditions it would be another.

Written by `diagnose`, and by `fit` alone until the residuals have been diagnosed. Whatever prints a
coefficient of a campaign prints it from here. The rule of quotation, by verdict:

:adequate: The base fit at the loop's noise.
:effect: Over the named effects and their rivals, their form uncertain.
:unexplained: Over the base fit with structure that has no name as a random discrepancy, and the
    refused explanations that are not improbable.
:not_diagnosed: The base fit at the scatter of repeats.

Numbers are in each coefficient's own unit. A coefficient's interval ends where its declared range
ends: the truth is not beyond, so cutting loses no coverage. null in the file is infinity: endless
degrees of freedom, or an uncertainty that no trial bounds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from nearlift.declare import Boundary
from nearlift.results.document import IfAny, Real, Unbounded
from nearlift.results.estimate import Estimate
from nearlift.rounding import plain

#: Levels of the intervals, in percent.
LEVELS = (68, 90, 95)
#: Half the difference of an interval's two arms over their mean, up to which ± still says the
#: interval: as much as rounding moves an uncertainty.
UNEVEN = 1 / 6

Verdict = Literal["adequate", "effect", "unexplained", "not_diagnosed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetLine:
    """One source of error of one coefficient; `kind`: ``"A"`` from repeats, ``"B"`` stated or
    assumed (`type` in the file).

    `u` is what it adds to the coefficient. `u_without` is the coefficient's standard uncertainty if
    the source were known exactly. Sources are correlated through the fit, so this is not what `u`
    suggests. `distribution`, `scope` and `u_input` (in `unit`) are of the input, if it has them;
    `sensitivity` is the change of the coefficient per unit of it.
    """

    source: str
    kind: Annotated[Literal["A", "B"], Field(alias="type")]
    u: Real
    u_without: Real
    distribution: str = ""
    scope: str = ""
    u_input: float | None = None
    unit: str = ""
    sensitivity: float | None = None
    dof: Unbounded = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class Shift:
    """A trial or visit, its mean distance (None in free air), and the coefficient without
    it less what it is.

    `standardised` is the shift by a visit over its standard deviation. `shift_per_mm` is the change
    of the coefficient per millimetre of error in the visit's distance. Both exist where a new
    diagnosis gives the shift.
    """

    id: str
    shift: Real
    z_hat: float | None = None
    standardised: IfAny[Real] = None
    shift_per_mm: IfAny[Real] = None

    @classmethod
    def at(cls, z_hat: float, name: str, shift: float) -> Shift:
        """Shift by a trial or visit at a distance, infinite in free air."""
        return cls(id=name, shift=shift, z_hat=z_hat if math.isfinite(z_hat) else None)

    @property
    def place(self) -> str:
        """Trial or visit in words."""
        return self.id if self.z_hat is None else f"{self.id} (z_hat = {plain(self.z_hat, 2)})"


@dataclass(frozen=True, slots=True, kw_only=True)
class LargestShifts:
    """The single trial and the single visit that move a coefficient most; None where no single one
    does.
    """

    trial: Shift | None = None
    visit: Shift | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Doubt(Estimate):
    """Coefficient under another `condition` (``if`` in the file); `explanation`: the effects that
    it assumes, as "a + b".
    """

    condition: Annotated[str, Field(alias="if")]
    explanation: IfAny[str] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CoefficientResult(Estimate):
    """The value to quote, with its intervals within the coefficient's declared range.

    `u` is one standard uncertainty (k = 1). Over rivals: half the 90 % interval over Student's t,
    whatever its shape. `dof` is 0 where no repeats tell `u`. `holds` is what the interval allows
    for, in a sentence; `answers` the number of explanations that it covers.
    """

    holds: str
    budget: tuple[BudgetLine, ...] = ()
    influence: LargestShifts = LargestShifts()
    doubts: tuple[Doubt, ...] = ()
    answers: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class RestsOn:
    """The trial or the visit without which the boundary's answer would be another: by search and
    fit made again from the start without it.

    `z_hat` is the distance of a visit, None in free air. `shift` is the headline coefficient
    without it less what it is; `verdict` and `effects` are those without it.
    """

    trial: IfAny[str] = None
    visit: IfAny[str] = None
    z_hat: IfAny[float] = None
    shift: Real
    verdict: Verdict
    effects: tuple[str, ...] = ()

    @property
    def moved(self) -> Shift:
        """Shift of the headline without it."""
        return Shift(id=self.visit or self.trial or "", shift=self.shift, z_hat=self.z_hat)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutError:
    """Root mean square error of predicting visits that took no part in choosing, before and after
    the loop, and the noise floor.
    """

    unit: str = "fraction of lift"
    before: Real
    after: Real
    noise_floor: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class Correlation:
    """Correlation of the estimates of coefficients and, where effects are named, of the effects'
    parameters: (k, k) as rows.
    """

    parameters: tuple[str, ...]
    values: tuple[tuple[Real, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifiedSize(Estimate):
    """One size of an identified effect, with its 90 % interval.

    `lift_percent` is the range of its contribution to lift over the trials, in percent of lift.
    """

    effect: str
    parameter: str
    lift_percent: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryResult:
    """The result to quote of one boundary; this design cannot distinguish the `rivals` from the
    identified `effects`, whose `sizes` are given.

    `probability` is that of the identified effects, of nameless structure, or of nothing, by the
    verdict; None where nothing was diagnosed. `wanted` is what a diagnosis would take where there
    is none. `rests_on` is a single trial without which the verdict changes, or the headline moves
    by more than its standard uncertainty. `rests_on_visit` is a single visit without which the
    verdict changes. `forms` are the forms of identified effects that have several.
    """

    verdict: Verdict
    reason: str = ""
    wanted: str = ""
    base_model: str
    effects: tuple[str, ...] = ()
    forms: IfAny[Mapping[str, str]] = None
    rivals: tuple[str, ...] = ()
    probability: IfAny[float] = None
    coefficients: Mapping[str, CoefficientResult]
    sizes: tuple[IdentifiedSize, ...] = ()
    error: HeldOutError | None = None
    correlation: Correlation = Correlation(parameters=(), values=())
    rests_on: RestsOn | None = None
    rests_on_visit: IfAny[RestsOn] = None

    def form(self, effect: str) -> str:
        """The form of an identified effect; empty where it has one alone."""
        return (self.forms or {}).get(effect, "")

    @property
    def headline(self) -> str:
        """Name of the first coefficient; empty where the base model has none that is free."""
        return next(iter(self.coefficients), "")

    @property
    def most_influential(self) -> tuple[Literal["visit", "trial"], Shift] | None:
        """The single visit or trial that the answer depends on, whichever moves it more; None where
        it depends on none.
        """
        c, on = self.coefficients.get(self.headline), self.rests_on
        visit, trial = (c.influence.visit, c.influence.trial) if c else (None, None)
        least = abs(on.shift) if on else 0.0
        if c and visit and abs(visit.shift) > max(c.u, least):
            return "visit", visit
        if on and trial:
            return "trial", replace(trial, shift=on.shift)
        return ("visit", self.rests_on_visit.moved) if c and self.rests_on_visit else None

    def doubting(self, more: Mapping[str, Sequence[Doubt]]) -> BoundaryResult:
        """Result with further doubts, by coefficient."""
        known = {
            n: replace(c, doubts=(*c.doubts, *more.get(n, ())))
            for n, c in self.coefficients.items()
        }
        return replace(self, coefficients=known)


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """The whole file."""

    file: ClassVar[str] = "results.json"

    schema: str = "nearlift.results/1"
    boundaries: Mapping[Boundary, BoundaryResult]
