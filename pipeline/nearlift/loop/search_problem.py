"""What one boundary's search stands on: trials, base fit, noise, whitened hypotheses, and how an
explanation is judged by them.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, FloatArray, LiftModel
from nearlift.likelihood import budget
from nearlift.likelihood.covariates import varies
from nearlift.likelihood.noise import trial_covariance
from nearlift.likelihood.problem import Problem, height_slope
from nearlift.likelihood.subspace import framed, orthonormal
from nearlift.loop import structure
from nearlift.loop.candidate import SESSION_SPREADS, Candidate, library_columns
from nearlift.loop.candidate_fit import Fitted, fit, search
from nearlift.loop.evidence import (
    CREDIT,
    Deformation,
    ExplanationEvidence,
    FormReading,
    Integrated,
    Linearised,
    mean_evidence,
)
from nearlift.loop.explanation import Explanation
from nearlift.loop.families import STEP, families
from nearlift.loop.instruments import instruments
from nearlift.loop.structure import Hypothesis, Null, Structure
from nearlift.loop.wander import likeliest, price, waves
from nearlift.nomenclature import SCHEDULE_WORDS
from nearlift.results import Noise, Observations
from nearlift.results.diagnosis import FORM_SD

#: A name must account for this share of the structure that is there without it, give or take so
#: many standard deviations of its noise.
GREATER_PART = 0.6
BY_CHANCE = 1.0
#: A direction counts as outside the hypotheses' basis where it keeps this part of its length there.
OUTSIDE = 1e-6


@dataclass(frozen=True, kw_only=True)
class Options:
    """How the search is run; `form_sd` and `multiplicity` exist to show what breaks without them.

    `not_feasible` is what the bench cannot do, and what is not proposed: "closer", "farther", "both
    directions". Without `pairs`, as where trials are few, a single effect must do.
    """

    seed: int = 0
    false_alarm_rate: float = 0.05
    not_feasible: tuple[str, ...] = ()
    form_sd: float = FORM_SD
    multiplicity: bool = True
    pairs: bool = True


@dataclass(frozen=True, kw_only=True)
class SearchProblem:
    """Trials, base fit, noise and hypotheses of one boundary.

    With `independent`, trials are fitted as if nothing tied them together; see `few_visits`.
    """

    data: Observations
    base: LiftModel
    effects: tuple[Effect, ...]
    parts: tuple[budget.Component, ...]
    noise: Noise
    log_lift: FloatArray
    theta: FloatArray
    options: Options
    independent: bool = False

    @cached_property
    def space(self) -> Problem:
        """Whitening at the noise floor, with the declared budget, L_inf per throttle removed."""
        slope = self.slope
        if self.independent:
            return Problem(
                model=self.base,
                data=self.data,
                covariance=trial_covariance(self.data, self.assumed_noise, slope),
            )
        shared = budget.shared(self.data, self.parts, slope)
        covariance = trial_covariance(
            self.data,
            self.assumed_noise,
            slope,
            shared,
            budget.own_variance(self.data, self.parts, slope),
            instruments(self.data),
        )
        return Problem(model=self.base, data=self.data, covariance=covariance)

    @property
    def assumed_noise(self) -> Noise:
        """The noise floor, without what ties the trials of a visit together where they are fitted
        as if nothing did.
        """
        return (
            dataclasses.replace(self.noise, height_m=0.0, common=0.0, drift=())
            if self.independent
            else self.noise
        )

    @cached_property
    def slope(self) -> FloatArray:
        """D log ratio / dz of the base model."""
        return height_slope(self.base, self.data, self.base.named(self.theta))

    def candidate(self, *effects: Effect) -> Candidate:
        """The base model with these effects."""
        return Candidate(base=self.base, effects=effects, data=self.data)

    @cached_property
    def base_fit(self) -> Fitted:
        """The base model alone, at the noise floor."""
        return fit(self.candidate(), self.space, self.log_lift, self.theta)

    @cached_property
    def library(self) -> tuple[tuple[Effect, FloatArray], ...]:
        """Each effect with its first-order columns (n, k) of log lift, one entry per shape."""
        return tuple(library_columns(self.base, self.effects, self.data, self.theta))

    @cached_property
    def hypotheses(self) -> tuple[tuple[Hypothesis, ...], FloatArray]:
        """Families and library in the reduced space, and the space's orthonormal basis (n, d)."""
        sources = [("", f.name, f.covariate, f.columns) for f in families(self.data)]
        sources += [
            (e.name, f"effect {e.name}", e.varies_with, columns) for e, columns in self.library
        ]
        words = [(effect, name, SCHEDULE_WORDS.get(c, c)) for effect, name, c, _ in sources]
        # thousands of trials by hundreds of columns: what is done with is let go
        white = [self.space.project(columns.T).T for *_, columns in sources]
        del sources
        basis = framed(orthonormal(np.hstack([self.base_fit.jacobian, *white])))
        reduced = tuple(
            Hypothesis(
                name=name,
                covariate=covariate,
                columns=basis.T @ (orthonormal(w) if w.shape[1] > 1 else w),
                effect=effect,
            )
            for (effect, name, covariate), w in zip(words, white, strict=True)
        )
        return reduced, basis

    @cached_property
    def absorbed(self) -> FloatArray:
        """What the base model's coefficients absorb of the reduced space, orthonormal (d, p)."""
        return orthonormal(self.hypotheses[1].T @ self.base_fit.jacobian)

    @cached_property
    def null(self) -> Null:
        """What the most significant of all tests does by chance: one for everything that this
        search tries.
        """
        if not self.options.multiplicity:
            return structure.ALONE
        return structure.draw(
            self.hypotheses[0],
            self.absorbed,
            np.random.default_rng(self.options.seed),
            self.noise.dof,
        )

    @cached_property
    def waves(self) -> FloatArray:
        """The columns of a wander, whitened, (n, k)."""
        return self.space.project(waves(self.data).T).T

    @cached_property
    def waves_in_basis(self) -> FloatArray:
        """The same in the basis of the hypotheses, (d, k)."""
        return self.hypotheses[1].T @ self.waves

    def linearised(self, fitted: Fitted, form_sd: float, wander: float = 0.0) -> FormReading:
        """A fit with its form uncertain by `form_sd` and a `wander` beside it, in a basis that
        begins with that of the hypotheses and spans all that the fit moves along.
        """
        _, basis = self.hypotheses
        tube = self.space.project(fitted.candidate.tube(fitted.vector, form_sd).T).T
        if wander:
            tube = np.hstack([tube, wander * self.waves])
        jacobian = fitted.jacobian
        both = np.hstack([jacobian, tube])
        outside = both - basis @ (basis.T @ both)
        beyond = np.linalg.norm(outside, axis=0) > OUTSIDE * np.maximum(
            np.linalg.norm(both, axis=0), 1e-300
        )
        whole = np.hstack([basis, framed(orthonormal(outside[:, beyond]))])
        return FormReading(
            here=Linearised(fitted=fitted, jacobian=whole.T @ jacobian, tube=whole.T @ tube),
            basis=whole,
            wander=wander,
        )

    def remaining(self, left: Integrated) -> Structure:
        """The whole test on what an explanation leaves."""
        return structure.examine(
            left.scores[:, 0],
            structure.mapped(self.hypotheses[0], left.beside),
            left.removed,
            self.null,
            self.options.false_alarm_rate,
        )

    def least_without_each(self, reading: FormReading) -> FloatArray:
        """The smallest log10 p of the whole test on what a reading leaves without each trial, to
        first order, (n,).
        """
        left = reading.left
        hypotheses = structure.mapped(self.hypotheses[0], left.beside)
        _, stacked, ranks = structure.bases(hypotheses, left.removed)
        if not len(ranks):
            return np.zeros(self.data.n)
        return structure.least_log10_p(reading.without_each.T, stacked, ranks)

    def left_by(self, e: Explanation) -> Structure:
        """The whole test on what an explanation leaves, made now if nobody asked before."""
        if e.left is not None:
            return e.left
        return self.remaining(self.linearised(e.fitted, e.form_sd, e.wander).left)

    def waves_beside(self, left: Integrated) -> FloatArray:
        """The columns of a wander where these scores are, (d, k)."""
        columns = left.beside(self.waves_in_basis)
        return np.asarray(columns - left.removed @ (left.removed.T @ columns))

    def explain(
        self, effects: tuple[Effect, ...], without: tuple[float, ...] = (0.0,)
    ) -> Explanation:
        """Fit one candidate and test what it leaves; `without` are the gains of what stands when
        each of its effects is taken away.
        """
        spreads = (
            SESSION_SPREADS
            if any(p.per == "session" for e in effects for p in e.parameters)
            else (1.0,)
        )
        candidates = (
            dataclasses.replace(self.candidate(*effects), session_spread=s) for s in spreads
        )
        fits = (search(c, self.space, self.log_lift, self.base_fit.vector) for c in candidates)
        return max(
            (self.judged(f, self.options.form_sd, without) for f in fits),
            key=lambda e: e.evidence.log,
        )

    def readings(self, fitted: Fitted, form_sd: float) -> tuple[FormReading, FormReading]:
        """A fit with its form as printed, and uncertain by `form_sd`; each with the likeliest
        wander beside it.
        """
        uncertain = self.linearised(fitted, form_sd)
        certain = dataclasses.replace(uncertain.here, tube=uncertain.here.tube[:, :0])
        printed = dataclasses.replace(uncertain, here=certain)
        return self.with_wander(printed, 0.0), self.with_wander(uncertain, form_sd)

    def with_wander(self, reading: FormReading, form_sd: float) -> FormReading:
        """A reading, or where a wander beside it is worth its price, that."""
        left = reading.left_by_unit_information
        wander = likeliest(left.scores[:, 0], self.waves_beside(left), self.data.n)
        return self.linearised(reading.here.fitted, form_sd, wander) if wander else reading

    def judged(self, fitted: Fitted, form_sd: float, without: tuple[float, ...]) -> Explanation:
        """A fit whose form is uncertain by `form_sd`; what it leaves is tested where the effects
        could then be named.
        """
        printed, uncertain = self.readings(fitted, form_sd)
        gain = self.gain(fitted, form_sd)
        explanation = Explanation(
            fitted=fitted,
            form_sd=form_sd,
            wander=uncertain.wander,
            left=None,
            gain=gain,
            needed=all(bool(self.greater_part(gain - g, self.excess - g)) for g in without),
            evidence=ExplanationEvidence(
                as_printed=self.log_evidence(printed),
                uncertain=self.log_evidence(uncertain),
                unnamed=self.unnamed,
                plausibility=float(mean_evidence(printed.plausibility, uncertain.plausibility)),
            ),
        )
        if explanation.eligible and explanation.evidence.over_none > CREDIT:
            return dataclasses.replace(explanation, left=self.remaining(uncertain.left))
        return explanation

    def gain(self, fitted: Fitted, form_sd: float) -> float:
        """Drop of chi2 by effects of declared form; the size of one that restarts with every
        session differs each time.
        """
        columns = self.space.project(fitted.candidate.restarts(fitted.vector, form_sd).T).T
        left = Deformation(columns)(fitted.residual)
        return self.base_fit.chi2 - float(np.sum(left**2))

    def greater_part(
        self, gain: FloatArray | float, excess: FloatArray | float
    ) -> NDArray[np.bool_]:
        """Whether so much of chi2 is the greater part of a structure's `excess` over noise."""
        return np.asarray(gain >= GREATER_PART * excess - self.chance)

    @property
    def chance(self) -> float:
        """By what `excess` may err: so many standard deviations of a chi-square whose unit is
        estimated, too.
        """
        d = self.hypotheses[1].shape[1]
        return BY_CHANCE * float(np.sqrt(2 * d * (1 + d / self.noise.dof)))

    @cached_property
    def excess(self) -> float:
        """Chi2 of the structure beyond what noise would have."""
        _, basis = self.hypotheses
        return float(max(np.sum((basis.T @ self.base_fit.residual) ** 2) - basis.shape[1], 1e-12))

    def plain_change(self, e: Explanation) -> float:
        """Log evidence of a plain change along the covariates of an explanation's effects, over
        that of what has no name: a straight line in gain or in force, or where a size differs by
        session a step in gain at any time; the largest.

        To first order, by unit information; minus infinity where no covariate of its own was
        logged.
        """
        data, absorbed = self.data, orthonormal(self.base_fit.jacobian)
        lift_N = data.covariates["lift_inf_N"] * np.exp(
            self.base_fit.candidate.log_ratio(self.base_fit.vector)
        )
        gains = [-np.inf]
        for name in (effect.varies_with for effect in e.fitted.candidate.effects):
            if name in data.covariates and varies(data, name):
                along = data.covariates[name] - data.covariates[name].mean()
                white = self.space.project(np.stack([along, along * np.median(lift_N) / lift_N])).T
                white = white - absorbed @ (absorbed.T @ white)
                gain = (white.T @ self.base_fit.residual) ** 2 / np.maximum(
                    np.sum(white**2, axis=0), 1e-300
                )
                gains.append(float(gain.max()))
        if e.fitted.candidate.by_session.any():
            gains.append(self.best_step)
        beyond = self.unnamed - self.nothing_added[1]
        return 0.5 * (max(gains) - float(np.log(data.n))) - beyond

    def dispersion(self, e: Explanation) -> float:
        """Variance along the families and effects that an explanation leaves, in units of the noise
        floor's; 1 where it leaves nothing.
        """
        return 1.0 + (e.left is not None and e.left.present) * max(
            self.excess - e.gain, 0.0
        ) / float(self.hypotheses[1].shape[1])

    @cached_property
    def best_step(self) -> float:
        """Drop of chi2 by one step at the best of the times tried."""
        hypotheses, basis = self.hypotheses
        steps = [h.columns for h in hypotheses if h.name == STEP]
        if not steps:
            return 0.0
        columns = np.hstack(steps)
        columns = columns - self.absorbed @ (self.absorbed.T @ columns)
        along = columns.T @ (basis.T @ self.base_fit.residual)
        return float(np.max(along**2 / np.maximum(np.sum(columns**2, axis=0), 1e-12)))

    @cached_property
    def base_reading(self) -> FormReading:
        """The base model alone."""
        return self.linearised(self.base_fit, 0.0)

    @cached_property
    def _unnamed(self) -> FormReading:
        """What has no name: the base model, with a wander beside it if that is likelier."""
        return self.with_wander(self.base_reading, 0.0)

    @property
    def base_wander(self) -> float:
        """The likeliest wander beside the base model alone."""
        return self._unnamed.wander

    @cached_property
    def unnamed(self) -> float:
        """Log evidence of what has no name."""
        return self.log_evidence(self._unnamed)

    @cached_property
    def nothing_added(self) -> tuple[Structure, float]:
        """The test on what the base model alone leaves, and its log evidence."""
        return self.remaining(self.base_reading.left), self.log_evidence(self.base_reading)

    def log_evidence(self, reading: FormReading) -> float:
        """By unit information, a wander paid for."""
        return reading.log - price(reading.wander, self.data.n)
