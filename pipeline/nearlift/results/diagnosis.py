"""diagnosis.json: what the loop found in the residuals of each boundary's base fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from nearlift.declare import Boundary
from nearlift.results.document import Below, IfAny, Json, NumberKey, Real, as_json
from nearlift.results.estimate import Estimate, Noise
from nearlift.results.fit import ParameterCovariance
from nearlift.results.outlook import (
    NextExperiment,
    NextSession,
    Sensitivity,
    SilentEffect,
    UntestableEffect,
)
from nearlift.results.quotation import Verdict

#: An effect's true form is known to about this relative, smooth deviation.
FORM_SD = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopEstimate(Estimate):
    """A coefficient, or an effect's parameter, over all rivals, their form uncertain.

    Two further 90 % intervals: `conditional` on the named explanation; `constrained` with every
    effect that was not found as a nuisance of its physical size.
    """

    conditional: IfAny[tuple[float, float]] = None
    constrained: IfAny[tuple[float, float]] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedEffect:
    """An effect that the residuals demanded, and its rivals in this design."""

    name: str
    rivals: tuple[str, ...]
    parameters: Mapping[str, LoopEstimate]
    mechanism: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationProbability:
    """Probability of one explanation of the residuals: its effects; else `nameless` structure along
    a covariate; else nothing. It is that of `other` further explanations where these are summed.
    """

    effects: tuple[str, ...]
    nameless: IfAny[str] = None
    other: IfAny[int] = None
    probability: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class AcceptedExplanation:
    """The most probable explanation by itself: values that belong together and draw one curve.

    The quoted coefficients are means over rival explanations; together they may draw none of them.
    `probability` is None where visits left out decided. `parameters` are the base model's and the
    effects', at their joint optimum. Their intervals include the uncertain form, and exclude the
    choice between rivals; their `covariance` has the form exact, that of the curve that is drawn.
    """

    effects: tuple[str, ...]
    probability: IfAny[float] = None
    parameters: Mapping[str, Estimate]
    covariance: ParameterCovariance


@dataclass(frozen=True, slots=True, kw_only=True)
class PartialEffect:
    """The share of the structure that an effect would explain which may not take the credit."""

    name: str
    share: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class StructureTest:
    """The foremost test of structure along one covariate."""

    covariate: str
    family: str
    p_value: Real
    significant: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class TriedCandidate:
    """An explanation that was tried.

    `gain` is the fall of chi2; `p_value` that of what it leaves, along `left_in`. `sizes` are its
    parameters, those aside that differ by session; `at_bound`: a size that is not possible.
    `judged_by` is what decided, where it was not the evidence.
    """

    name: str
    gain: Real
    p_value: Real
    accepted: bool
    sizes: Mapping[str, Real]
    at_bound: bool
    log_evidence: Below
    left_in: str | None
    judged_by: IfAny[str] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopRound:
    """One round of the search: what was tried, what was decided, and why."""

    candidates: tuple[TriedCandidate, ...]
    decision: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class InterimClaim:
    """Threshold of a claim at an interim analysis."""

    trials: int
    scheduled: int
    p_value_needed: Real
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutRmse:
    """Root mean square error on visits that took no part in choosing, with its 90 % interval."""

    held_out_rmse: Real
    lo90: Real
    hi90: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopError:
    """Held-out errors before and after the loop; `change` where an effect was named."""

    unit: str = "fraction of lift"
    noise_floor: Real
    before: HeldOutRmse
    after: HeldOutRmse
    change: IfAny[Estimate] = None
    chosen_in_folds: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopCoefficients:
    """Coefficients of the base model without and with the named effects, and the covariates along
    which what has no name was carried.
    """

    before: Mapping[str, LoopEstimate]
    after: Mapping[str, LoopEstimate]
    carried: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CoefficientLimit:
    """Reason for which a coefficient is not identifiable: it depends on one visit (its `z_hat`), or
    free levels absorb it. `share` is that of its information.
    """

    coefficient: str
    rests_on: IfAny[Mapping[str, Real]] = None
    absorbed_by: IfAny[str] = None
    share: Real
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class WithinTrial:
    """Change of lift over a record, and the effects that may be at work in it."""

    change_over_record: Estimate
    p_value: Real
    significant: bool
    candidates: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryDiagnosis:
    """Findings of the loop at one boundary; `p_value` is of the largest of all tests.

    `effects` are empty unless the verdict is ``effect``, `accepted` is None. `explanations` are
    rivals, the best first; `probabilities` those of everything that was weighed, in sum 1.
    `not_confirmed` are explanations from which visits left out gain nothing. `partial` explain part
    of the structure. `at_bound` would explain half of it or more with a size at a bound of its
    range. `contradicted` is evidence against a model that no test of structure rejects.

    `random_walk_gain` is the root mean square, as a fraction of lift, of the gain's random walk
    besides the answer, along nothing that was logged. `error` is None where no
    visit can be predicted from the others. `L_inf_N` is by the accepted model, in the average
    conditions of its trials.
    """

    base_model: str
    false_alarm_rate: Real
    verdict: Verdict
    effects: tuple[NamedEffect, ...]
    explanations: IfAny[tuple[tuple[str, ...], ...]] = None
    accepted: IfAny[AcceptedExplanation] = None
    probabilities: IfAny[tuple[ExplanationProbability, ...]] = ()
    partial: IfAny[tuple[PartialEffect, ...]] = None
    at_bound: IfAny[tuple[str, ...]] = None
    contradicted: IfAny[tuple[str, ...]] = None
    random_walk_gain: IfAny[float] = None
    p_value: Real
    structure: tuple[StructureTest, ...]
    rounds: tuple[LoopRound, ...]
    not_confirmed: IfAny[tuple[tuple[str, ...], ...]] = None
    look: IfAny[InterimClaim] = None
    error: IfAny[LoopError] = None
    noise: Annotated[Noise, Field(alias="noise_floor")]
    L_inf_N: Mapping[NumberKey, Estimate]
    coefficients: LoopCoefficients
    limits: tuple[CoefficientLimit, ...]
    within_trial: WithinTrial | None
    not_testable: Annotated[tuple[UntestableEffect, ...], Field(alias="untestable")]
    sensitivity: IfAny[Sensitivity] = None
    silent: tuple[SilentEffect, ...]
    next_experiment: tuple[NextSession | NextExperiment, ...]

    def stand_ins(self, effect: NamedEffect) -> list[str]:
        """Rivals of an identified effect: single effects, then pairs as "a + b"."""
        together = [e for e in self.explanations or () if len(e) > len(self.effects)]
        alone = {n for e in self.explanations or () if e not in together for n in e}
        return [r for r in effect.rivals if r in alone or not together] + [
            " + ".join(e) for e in together
        ]

    @property
    def untestable(self) -> dict[str, tuple[str, ...]]:
        """Effects that nothing can be said of, and what to log next time."""
        return {u.effect: u.log_next_time or u.needs for u in self.not_testable}

    @property
    def content(self) -> Json:
        """Content of the file."""
        return as_json(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class NotDiagnosed:
    """A boundary that could not be diagnosed, and why."""

    verdict: Literal["not_diagnosed"] = "not_diagnosed"
    reason: str
    base_model: str
    effects: tuple[NamedEffect, ...] = ()
    structure: tuple[StructureTest, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagnosisResults:
    """The whole file."""

    file: ClassVar[str] = "diagnosis.json"

    schema: str = "nearlift.diagnosis/1"
    false_alarm_rate: Real
    boundaries: Mapping[Boundary, BoundaryDiagnosis | NotDiagnosed]


#: Of a campaign without a diagnosis.
NOTHING = DiagnosisResults(false_alarm_rate=float("nan"), boundaries={})
