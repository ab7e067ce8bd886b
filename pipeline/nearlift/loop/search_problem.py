"""Input of one boundary's search (trials, base fit, noise, whitened hypotheses) and the judgement
of an explanation.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, FloatArray, LiftModel
from nearlift.likelihood import budget
from nearlift.likelihood.noise import trial_covariance
from nearlift.likelihood.problem import Likelihood, height_slope
from nearlift.likelihood.subspace import framed, orthonormal
from nearlift.loop import structure
from nearlift.loop.candidate import SESSION_SPREADS, Candidate, is_datum, library_columns
from nearlift.loop.candidate_fit import Fitted, Starts, fit, search
from nearlift.loop.evidence import (
    CREDIT,
    Explanation,
    Integrated,
    LinearFit,
    RandomEffectsWhitener,
)
from nearlift.loop.families import families
from nearlift.loop.inflow import MeasuredDownwash, log_density
from nearlift.loop.random_walk_gain import bic_penalty, likeliest, waves
from nearlift.loop.structure import Hypothesis, Null, Structure
from nearlift.nomenclature import SCHEDULE_WORDS
from nearlift.results import Noise, Observations
from nearlift.results.diagnosis import FORM_SD

#: A name must account for this share of the structure that is there without it, give or take so
#: many standard deviations of its noise.
GREATER_PART = 0.6
BY_CHANCE = 1.0
#: A direction counts as outside the hypotheses' basis where it keeps this part of its length there.
OUTSIDE = 1e-6
#: Visibility up to which an effect cannot be detected, a share of squared norm.
SILENT = 1e-4


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of the search; `form_sd` shows what fails without uncertain forms.

    `not_feasible` names what the bench cannot do: "closer", "farther", "both directions". Neither
    that nor a visit at or below `contact_z_hat` is proposed. Without `pairs`, as where trials are
    few, a single effect must suffice. `downwash` is what PIV measured at the disk near this
    boundary.
    """

    seed: int = 0
    false_alarm_rate: float = 0.05
    not_feasible: tuple[str, ...] = ()
    contact_z_hat: float = 0.0
    form_sd: float = FORM_SD
    pairs: bool = True
    downwash: tuple[MeasuredDownwash, ...] = ()


@dataclass(frozen=True, kw_only=True)
class SearchProblem:
    """Trials, base fit, noise and hypotheses of one boundary.

    With `independent`, trials are fitted without correlation; see `few_visits`. The noise was
    estimated about the candidate and vector `about`, about the base model if None. `drawn` is the
    null distribution of nearly the same trials, if that was drawn already. `datum` is the stated
    zero error of the distance, part of every candidate; None where it is carried to first order.
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
    about: tuple[Candidate, FloatArray] | None = None
    drawn: Null | None = None
    datum: Effect | None = None

    @property
    def linear_parts(self) -> tuple[budget.Component, ...]:
        """Stated uncertainties that the covariance carries to first order."""
        return tuple(part for part in self.parts if self.datum is None or not is_datum(part))

    @cached_property
    def space(self) -> Likelihood:
        """Whitening at the noise floor, with the declared budget, L_inf per throttle removed."""
        return self.whitening(self.linear_parts, self.slope)

    def whitening(self, parts: tuple[budget.Component, ...], slope: FloatArray) -> Likelihood:
        """Likelihood with these stated uncertainties, those of distance to first order by the
        `slope` (n,).
        """
        data, noise = self.data, self.assumed_noise
        if self.independent:
            covariance = trial_covariance(data, noise, self.slope)
        else:
            shared = budget.shared(data, parts, slope)
            variance = budget.own_variance(data, parts, self.slope)
            covariance = trial_covariance(data, noise, self.slope, shared, variance)
        return Likelihood(model=self.base, data=data, covariance=covariance)

    @property
    def correlated(self) -> SearchProblem:
        """The problem with correlated trials."""
        return dataclasses.replace(self, independent=False) if self.independent else self

    @property
    def assumed_noise(self) -> Noise:
        """The noise floor, without correlation within visits if trials count as independent."""
        if not self.independent:
            return self.noise
        return dataclasses.replace(self.noise, height_m=0.0, common=0.0, drift=())

    @cached_property
    def slope(self) -> FloatArray:
        """Slope of the log ratio with distance, 1/m, (n,)."""
        return self.height_slope(self.data)

    def height_slope(self, data: Observations) -> FloatArray:
        """Slope with distance of the log ratio of `data`, 1/m, (n,), by the candidate about which
        the noise was estimated, or by the base model.
        """
        if self.about is None:
            return height_slope(self.base, data, self.base.named(self.theta))
        candidate, vector = self.about
        return candidate.height_slope(vector, data)

    def candidate(self, *effects: Effect) -> Candidate:
        """The base model with these effects."""
        return Candidate(base=self.base, effects=effects, data=self.data, datum=self.datum)

    def candidates(self, *effects: Effect) -> list[Candidate]:
        """The base model with these effects, once for each of `SESSION_SPREADS` if one differs by
        session.
        """
        candidate = self.candidate(*effects)
        if not candidate.by_session.any():
            return [candidate]
        return [dataclasses.replace(candidate, session_spread=s) for s in SESSION_SPREADS]

    def best_fit(self, *effects: Effect) -> Fitted:
        """Fit of the base model with these effects over their starting values."""
        if not effects:
            return self.base_fit
        return search(self.candidate(*effects), self.starts, self.log_lift)

    @cached_property
    def base_fit(self) -> Fitted:
        """The base model alone, at the noise floor."""
        return fit(self.candidate(), self.space, self.log_lift, self.start)

    @property
    def start(self) -> FloatArray:
        """Vector of the base model alone at `theta`, without an error of the distance."""
        return self.theta if self.datum is None else np.append(self.theta, 0.0)

    @cached_property
    def base_jacobian(self) -> FloatArray:
        """Derivatives of the base model alone, whitened, (n, p)."""
        return self.base_fit.jacobian[:, : len(self.theta)]

    @cached_property
    def starts(self) -> Starts:
        """Starting values of candidates' fits."""
        return Starts(self.space, self.candidate(), self.base_fit.vector)

    @cached_property
    def library(self) -> tuple[tuple[Effect, FloatArray], ...]:
        """Each effect with its first-order columns (n, k) of log lift, one entry per shape."""
        return tuple(library_columns(self.base, self.effects, self.data, self.theta))

    @property
    def known_effects(self) -> tuple[Effect, ...]:
        """The effects of the library that change the lift of some trial."""
        return tuple({e.name: e for e, _ in self.library}.values())

    def visibility(self, effect: Effect) -> float:
        """Share of the squared norm of an effect's whitened columns outside the span of theta and
        L_inf, the largest over its shapes; 0 without columns.
        """
        shapes = [columns for e, columns in self.library if e.name == effect.name]
        if not shapes:
            return 0.0
        together = np.hstack(shapes).T
        whole, white = self.space.covariance.whiten(together), self.space.project(together)
        basis = orthonormal(self.base_jacobian)
        left = white - (white @ basis) @ basis.T
        first = np.cumsum([0, *(columns.shape[1] for columns in shapes[:-1])])
        part, of = (np.add.reduceat(np.sum(x**2, axis=1), first) for x in (left, whole))
        return float(np.max(part / np.maximum(of, 1e-300)))

    @cached_property
    def visible(self) -> tuple[Effect, ...]:
        """The effects of the library that theta and L_inf do not absorb."""
        return tuple(e for e in self.known_effects if self.visibility(e) > SILENT)

    @cached_property
    def hypotheses(self) -> tuple[tuple[Hypothesis, ...], FloatArray]:
        """Families and library in the reduced space, and the space's orthonormal basis (n, d)."""
        sources = [*families(self.data)]
        for e, x in self.library:
            along = SCHEDULE_WORDS.get(e.varies_with, e.varies_with)
            sources.append(Hypothesis(f"effect {e.name}", along, x, e.name))
        ends = np.cumsum([h.columns.shape[1] for h in sources])[:-1]
        white = self.space.project(np.hstack([h.columns for h in sources]).T).T
        basis = framed(orthonormal(np.hstack([self.base_jacobian, white])))
        return tuple(
            dataclasses.replace(h, columns=orthonormal(x) if x.shape[1] > 1 else x)
            for h, x in zip(sources, np.split(basis.T @ white, ends, axis=1), strict=True)
        ), basis

    @cached_property
    def absorbed(self) -> FloatArray:
        """Part of the reduced space absorbed by the base coefficients, orthonormal (d, p)."""
        return orthonormal(self.hypotheses[1].T @ self.base_jacobian)

    @cached_property
    def null(self) -> Null:
        """Null distribution of the smallest p-value of all tests: one for all explanations of this
        search, and with visits held out.
        """
        rng = np.random.default_rng(self.options.seed)
        return self.drawn or structure.draw(self.hypotheses[0], self.absorbed, rng, self.noise.dof)

    @cached_property
    def waves(self) -> FloatArray:
        """Columns of a random-walk gain, whitened, (n, k)."""
        return self.space.project(waves(self.data).T).T

    @cached_property
    def common(self) -> FloatArray:
        """Orthonormal basis (n, c) of the coefficients and of a random-walk gain."""
        return orthonormal(np.hstack([self.base_jacobian, self.waves]))

    def linearised(
        self,
        fitted: Fitted,
        form_sd: float,
        random_walk_gain: float = 0.0,
        basis: FloatArray | None = None,
    ) -> LinearFit:
        """A fit with its form discrepant by `form_sd` and a `random_walk_gain` of that size.

        Its coordinates begin with those of an orthonormal `basis` (n, d), the hypotheses' if None,
        and span all columns of the fit.
        """
        basis = self.hypotheses[1] if basis is None else basis
        discrepancy = fitted.candidate.form_discrepancy(fitted.vector, form_sd)
        both = np.hstack([fitted.jacobian, self.space.project(discrepancy.T).T])
        if random_walk_gain:
            both = np.hstack([both, random_walk_gain * self.waves])
        inside = basis.T @ both
        outside = both - basis @ inside
        length = np.maximum(np.linalg.norm(both, axis=0), 1e-300)
        rest = orthonormal(outside[:, np.linalg.norm(outside, axis=0) > OUTSIDE * length])
        jacobian, discrepancy = np.split(
            np.vstack([inside, rest.T @ outside]), [len(fitted.vector)], 1
        )
        scores = np.concatenate([b.T @ fitted.residual for b in (basis, rest)])
        return LinearFit(
            fitted=fitted,
            jacobian=jacobian,
            form_discrepancy=discrepancy,
            scores=scores[:, None],
            outside=-0.5 * float(np.sum(fitted.residual**2) - np.sum(scores**2)),
            random_walk_gain=random_walk_gain,
            basis=(basis, rest),
        )

    def linear_fits(self, fitted: Fitted, form_sd: float) -> tuple[LinearFit, LinearFit]:
        """Linear fits with an exact form, and with one discrepant by `form_sd`.

        Each has the likeliest random-walk gain, if that exceeds its penalty. Coordinates begin with
        the `common` ones.
        """
        discrepant = self.linearised(fitted, form_sd, basis=self.common)
        exact = dataclasses.replace(discrepant, form_discrepancy=discrepant.form_discrepancy[:, :0])
        return self._with_random_walk_gain(exact), self._with_random_walk_gain(discrepant)

    def _with_random_walk_gain(self, linear_fit: LinearFit) -> LinearFit:
        left, columns = linear_fit.left_by_unit_information, self.common.T @ self.waves
        gain = likeliest(left.scores[:, 0], left.residual(columns), self.data.n)
        if not gain:
            return linear_fit
        discrepancy = np.hstack([linear_fit.form_discrepancy, gain * left.embed(columns)])
        return dataclasses.replace(linear_fit, form_discrepancy=discrepancy, random_walk_gain=gain)

    def log_evidence(self, linear_fit: LinearFit) -> float:
        """Log evidence by unit information, with the penalty for a random-walk gain."""
        return float(linear_fit.log[0]) - bic_penalty(linear_fit.random_walk_gain, self.data.n)

    @cached_property
    def base_linear_fit(self) -> LinearFit:
        """The base model alone."""
        return self.linearised(self.base_fit, 0.0)

    @cached_property
    def nothing_added(self) -> tuple[Structure, float]:
        """The test on what the base model alone leaves, and its log evidence."""
        return self.remaining(self.base_linear_fit.left), self.log_evidence(self.base_linear_fit)

    @cached_property
    def null_fit(self) -> LinearFit:
        """Base model, with a random-walk gain if its evidence is higher."""
        return self._with_random_walk_gain(self.linearised(self.base_fit, 0.0, basis=self.common))

    @cached_property
    def unnamed(self) -> float:
        """Log evidence of the null."""
        return self.log_evidence(self.null_fit)

    def remaining(self, left: Integrated) -> Structure:
        """The whole test on what an explanation leaves."""
        return structure.examine(
            left.scores[:, 0],
            structure.mapped(self.hypotheses[0], left.whiten),
            left.removed,
            self.null,
            self.options.false_alarm_rate,
        )

    def left_by(self, e: Explanation) -> Structure:
        """Test for structure on the residuals of an explanation, computed if it was not yet."""
        if e.left is not None:
            return e.left
        return self.remaining(self.linearised(e.fitted, e.form_sd, e.random_walk_gain).left)

    def explain(
        self, effects: tuple[Effect, ...], without: tuple[Explanation, ...] = ()
    ) -> Explanation:
        """Fit one effect in its likeliest form, or a pair in given forms; test the residuals, if
        its effects could then be named.

        `without` are the explanations that lack one of a pair's effects. Forms are assumed to be as
        likely in a pair as alone.
        """
        gains = tuple(e.gain for e in without) or (0.0,)
        each = [(form,) for form in effects[0].forms] if len(effects) == 1 else [effects]
        judged = [self._likeliest(form, gains) for form in each]
        inside = [not e.fitted.at_bound for e in judged]
        log = np.nan_to_num([e.log_evidence for e in judged], nan=-np.inf)
        if any(inside):
            log[np.logical_not(inside)] = -np.inf
        best = judged[int(log.argmax())]
        other_forms = sum(e.other_forms for e in without) - float(np.log(len(log)))
        if np.isfinite(log.max()):  # no form has evidence where lift scatters over decades
            other_forms += float(np.logaddexp.reduce(log) - log.max())
        best = dataclasses.replace(best, other_forms=other_forms)
        if best.eligible and best.over_none > CREDIT:
            return dataclasses.replace(best, left=self.left_by(best))
        return best

    def _likeliest(self, effects: tuple[Effect, ...], without: tuple[float, ...]) -> Explanation:
        """Explanation by effects of given forms, the likeliest over `SESSION_SPREADS`."""
        first, *others = self.candidates(*effects)
        fits = [search(first, self.starts, self.log_lift)]
        for candidate in others:
            fits.append(fit(candidate, self.space, self.log_lift, fits[-1].vector))
        each = (self.judged(f, self.options.form_sd, without) for f in fits)
        return max(each, key=lambda e: e.log_evidence)

    def judged(self, fitted: Fitted, form_sd: float, without: tuple[float, ...]) -> Explanation:
        """Explanation of a fit with form discrepant by `form_sd`, its residuals not tested yet.

        `without` are the gains of the explanations that lack one of its effects.
        """
        exact, discrepant = self.linear_fits(fitted, form_sd)
        gain = self.gain(fitted, form_sd)
        inflow = log_density(self.options.downwash, fitted) - self._base_downwash
        return Explanation(
            fitted=fitted,
            form_sd=form_sd,
            random_walk_gain=discrepant.random_walk_gain,
            gain=gain,
            needed=all(bool(self.explains_enough(gain - g, self.excess - g)) for g in without),
            exact=self.log_evidence(exact) + inflow,
            discrepant=self.log_evidence(discrepant) + inflow,
            unnamed=self.unnamed,
        )

    @cached_property
    def _base_downwash(self) -> float:
        """Log density of the measured downwash given the base model."""
        return log_density(self.options.downwash, self.base_fit)

    def gain(self, fitted: Fitted, form_sd: float) -> float:
        """Drop of chi2 by effects of declared form; the size of one that restarts with every
        session differs each time.
        """
        columns = self.space.project(fitted.candidate.restarts(fitted.vector, form_sd).T).T
        left = RandomEffectsWhitener(columns)(fitted.residual)
        return float(self.base_fit.chi2 - np.sum(left**2) - fitted.datum_chi2)

    def explains_enough(
        self, gain: FloatArray | float, excess: FloatArray | float
    ) -> NDArray[np.bool_]:
        """Whether `gain`, a drop of chi2, is the greater part of a structure's `excess` over noise.
        `BY_CHANCE` standard deviations of that excess under noise of estimated scale are allowed.
        """
        d = self.hypotheses[1].shape[1]
        sd = float(np.sqrt(2 * d * (1 + d / self.noise.dof)))
        return np.asarray(gain >= GREATER_PART * excess - BY_CHANCE * sd)

    @cached_property
    def excess(self) -> float:
        """Chi2 of the structure beyond what noise would have."""
        basis, base = self.hypotheses[1], self.base_fit
        chi2 = float(np.sum((basis.T @ base.residual) ** 2) + base.datum_chi2)
        return max(chi2 - float(basis.shape[1]), 1e-12)
