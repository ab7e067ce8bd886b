"""Power of a design: signature, detection limit, rivals and bias of each effect.

No measured lift is needed: noiseless data with one effect in them are fitted by every candidate.
Noise is drawn about those fits, which are linear in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, FloatArray, Parameter
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop import structure, weigh
from nearlift.loop.candidate import moments
from nearlift.loop.candidate_fit import Fitted, fit, search
from nearlift.loop.evidence import CREDIT, LinearFit, mean_evidence
from nearlift.loop.random_walk_gain import log_evidence_gain
from nearlift.loop.search_problem import SILENT, SearchProblem
from nearlift.randomness import generator
from nearlift.results.answers import Power
from nearlift.results.diagnosis import FORM_SD

#: Power that defines a detection limit.
LIMIT_POWER = 0.8
#: Draws of the noise; a chance of 80 % is then known to 1.3 %.
DRAWS = 1000
#: Sizes of a power curve, up to so many times the one whose visible part has this length in
#: standard deviations.
STEPS, REACH, VISIBLE_LENGTH = 16, 3.0, 4.0
#: Share of a plausible size at which an effect is linear.
SMALL = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeParameter:
    """One size parameter of an effect, with `shape` the values of its shape parameters."""

    effect: Effect
    parameter: Parameter
    shape: Mapping[str, float]

    @property
    def plausible(self) -> float:
        """Physically plausible size: the prior's width (`moments`)."""
        return moments(self.parameter)[1]

    @property
    def largest(self) -> float:
        """Largest distance from the null within the bounds."""
        return max(abs(bound - self.parameter.value) for bound in self.parameter.bounds)

    @property
    def direction(self) -> float:
        """Side of the null that has more room within the bounds, 1 or -1."""
        low, high = self.parameter.bounds
        return 1.0 if high - self.parameter.value >= self.parameter.value - low else -1.0

    @property
    def expected(self) -> float:
        """Plausible size within the bounds."""
        return min(self.plausible, self.largest)


def size_parameters(effect: Effect) -> tuple[SizeParameter, ...]:
    """Size parameters of an effect, each shape at the grid value nearest to its prior's centre."""
    shape = {}
    for p in effect.parameters:
        if p.grid:
            centre = moments(p)[0]
            shape[p.name] = min(p.grid, key=lambda value, centre=centre: abs(value - centre))  # type: ignore[misc]
    return tuple(
        SizeParameter(effect=effect, parameter=p, shape=shape)
        for p in effect.parameters
        if not p.grid
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class NamingProbability:
    """Probabilities as in `Power`, for an effect of one size.

    `rivals`: probability that each other candidate is the name or a rival, given detection.
    """

    seen: float = 0.0
    within: float = 0.0
    first: float = 0.0
    alone: float = 0.0
    rivals: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class DesignPower:
    """Power of a problem's trials for every effect.

    `quiet` is the noise's true size over the problem's, at which the loop would estimate it.
    """

    problem: SearchProblem
    quiet: float = 1.0

    @property
    def _basis(self) -> FloatArray:
        """Orthonormal basis of the reduced space, (n, d)."""
        return self.problem.hypotheses[1]

    @cached_property
    def _tests(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The hypotheses' bases there side by side, their ranks, and the critical chi-square of
        each.
        """
        from scipy.stats import chi2

        _, stacked, ranks = structure.bases(self.problem.hypotheses[0], self.problem.absorbed)
        level = 10.0 ** self.problem.nothing_added[0].threshold
        return stacked, ranks, np.asarray(chi2.isf(level, ranks), dtype=np.float64)

    def _reduced(self, columns: FloatArray) -> FloatArray:
        """Columns of log lift, (n,) or (n, k), in the reduced space with unit noise, what theta
        absorbs projected out; (d,) or (d, k).
        """
        reduced = self._basis.T @ self.problem.space.project(columns.T).T
        absorbed = self.problem.absorbed
        return np.asarray(reduced - absorbed @ (absorbed.T @ reduced))

    @cached_property
    def _noise(self) -> tuple[FloatArray, FloatArray]:
        """Draws of unit noise in the reduced space (m, d), and of the scale of the estimated noise
        floor (m, 1).
        """
        rng = generator(self.problem.options.seed, "foresight")
        dof = min(self.problem.noise.dof, 1e6)
        draws = self.quiet * rng.standard_normal((DRAWS, self._basis.shape[1]))
        return draws, np.sqrt(dof / rng.chisquare(dof, size=(DRAWS, 1)))

    def _between_sessions(self, count: int, *keys: str) -> FloatArray:
        """Differences between sessions, of mean 0 and rms 1; draws (DRAWS, count) with further
        `keys`.
        """
        rng = generator(self.problem.options.seed, "foresight", "sessions", *keys)
        draw = rng.standard_normal((DRAWS, count) if keys else count)
        centred = draw - draw.mean(axis=-1, keepdims=True)
        rms = np.sqrt(np.mean(centred**2, axis=-1, keepdims=True))
        return np.asarray(centred / np.where(rms > 0, rms, 1.0))

    def vector(self, of: SizeParameter, size: float) -> FloatArray:
        """Flat vector of the base model with an effect of this size, within its bounds."""
        candidate = self.problem.candidate(of.effect)
        vector = candidate.null.copy()
        vector[: len(self.problem.start)] = self.problem.base_fit.vector
        for s in candidate.slots:
            if s.parameter.name in of.shape:
                vector[s.start : s.stop] = of.shape[s.parameter.name]
            elif s.parameter.name == of.parameter.name:
                width = s.stop - s.start
                vector[s.start : s.stop] += size * (
                    self._between_sessions(width) if width > 1 else of.direction
                )
        return np.clip(vector, *candidate.bounds)

    def _added(self, of: SizeParameter, size: float) -> FloatArray:
        """Contribution of an effect of this size to log lift, (n,)."""
        return self.problem.candidate(of.effect).contribution(self.vector(of, size), of.effect)

    def _log_lift(self, of: SizeParameter, size: float) -> FloatArray:
        """Noiseless log lift with an effect of this size, (n,)."""
        base = self.problem.base_fit
        return base.candidate.log_ratio(base.vector) + self._added(of, size)

    def signature(self, of: SizeParameter, size: float) -> tuple[FloatArray, FloatArray]:
        """Contribution of an effect to the log lift of each trial, and its part that theta and
        L_inf do not absorb; both (n,).
        """
        raw, base = self._added(of, size), self.problem.base_fit
        columns = np.hstack([self.problem.data.level_design, base.candidate.jacobian(base.vector)])
        whiten = self.problem.space.covariance.whiten
        solution = np.linalg.lstsq(whiten(columns.T).T, whiten(raw), rcond=None)[0]
        return raw, raw - columns @ solution

    def visible(self, of: SizeParameter, size: float) -> FloatArray:
        """The visible part in the reduced space, unit noise; (d,)."""
        return self._reduced(self._added(of, size))

    def _elsewhere(self, of: SizeParameter, size: float) -> FloatArray:
        """Change of the visible part by other draws of what differs by session, (m, d); zeros
        (1, d) for any other effect.
        """
        if of.parameter.per != "session":
            return np.zeros((1, self._basis.shape[1]))
        candidate = self.problem.candidate(of.effect)
        (slot,) = (s for s in candidate.slots if s.parameter.name == of.parameter.name)
        mine = np.arange(slot.start, slot.stop)
        reduced = self._reduced(candidate.jacobian(self.vector(of, 0.0))[:, mine])
        others = self._between_sessions(len(mine), "all")
        return np.asarray(size * (others - self._between_sessions(len(mine))) @ reduced.T)

    def seen(self, signal: FloatArray) -> NDArray[np.bool_]:
        """Whether the test of all hypotheses exceeds its threshold, for each draw with this signal
        (d,) or (m, d) in the reduced space.
        """
        absorbed, (draws, scale), (stacked, ranks, critical) = (
            self.problem.absorbed,
            self._noise,
            self._tests,
        )
        scores = draws + signal
        scores = (scores - (scores @ absorbed) @ absorbed.T) * scale
        chi2 = structure.chi2_of_each(scores, stacked, ranks)
        return np.asarray(np.any(chi2 > critical, axis=1))

    def _sizes(self, of: SizeParameter) -> FloatArray:
        """Sizes of a power curve, from 0 to the bound at most."""
        small = SMALL * of.expected
        signal = self.visible(of, small) + self._elsewhere(of, small)
        length = float(np.sqrt(np.mean(np.sum(signal**2, axis=1))))
        just_visible = VISIBLE_LENGTH * small / length if length > 1e-12 else np.inf
        return np.linspace(0.0, min(REACH * just_visible, of.largest), STEPS)

    def limit(self, of: SizeParameter) -> float | None:
        """The size seen with a power of `LIMIT_POWER`; None where no possible size is."""
        if self.problem.visibility(of.effect) <= SILENT:
            return None
        size = self._sizes(of)
        seen = [self.seen(self.visible(of, s) + self._elsewhere(of, s)).mean() for s in size]
        none = np.zeros(STEPS)
        return Power(size=size, seen=np.array(seen), within=none, first=none, alone=none).limit(
            LIMIT_POWER
        )

    def power(self, of: SizeParameter) -> Power:
        """Detection and naming against size."""
        size = self._sizes(of)
        contests = [self.contest(of, s) for s in size]
        curves = {
            name: np.array([getattr(c, name) for c in contests])
            for name in ("seen", "within", "first", "alone")
        }
        return Power(size=size, **curves)

    def contest(self, of: SizeParameter, size: float) -> NamingProbability:
        """Probabilities where every visible candidate is fitted to noiseless data with this effect
        in them, and noise is drawn about the fits.
        """
        problem, log_lift = self.problem, self._log_lift(of, size)
        elsewhere = self._elsewhere(of, size)
        seen = self.seen(self.visible(of, size) + elsewhere)
        base = fit(problem.candidate(), problem.space, log_lift, problem.base_fit.vector)
        unexplained = self._chi2(base, elsewhere)
        names, evidence, chi2 = [], [], []
        for effect in problem.visible:
            fits = [search(c, problem.starts, log_lift) for c in problem.candidates(effect)]
            fits = [f for f in fits if not f.at_bound]
            if fits:
                each = np.stack([self._evidence(f, elsewhere) for f in fits])
                left = np.stack([self._chi2(f, elsewhere) for f in fits])
                best = each.argmax(axis=0)[None]
                names.append(effect.name)
                evidence.append(np.take_along_axis(each, best, 0)[0])
                chi2.append(np.take_along_axis(left, best, 0)[0])
        over_none = np.stack(evidence) - self._evidence(base, elsewhere)
        enough = problem.explains_enough(
            unexplained - np.stack(chi2), unexplained - self._basis.shape[1]
        )
        # once one may be named, others are rivals by their evidence alone
        allowed = np.any((over_none > CREDIT) & seen & enough, axis=0) & (over_none > 0)
        log_weight = np.where(allowed, over_none, -np.inf)
        member, leader = (
            weigh.in_credible_set(log_weight / weigh.TEMPERATURE),
            log_weight.argmax(axis=0),
        )
        probability = float(seen.mean())
        rivals = {
            name: float(inside.sum() / max(int(seen.sum()), 1))
            for name, inside in zip(names, member, strict=True)
            if name != of.effect.name
        }
        if of.effect.name not in names:
            return NamingProbability(seen=probability, rivals=rivals)
        mine = names.index(of.effect.name)
        first = member[mine] & (leader == mine)
        return NamingProbability(
            seen=probability,
            within=float(member[mine].mean()),
            first=float(first.mean()),
            alone=float((first & (member.sum(axis=0) == 1)).mean()),
            rivals=rivals,
        )

    def _evidence(self, fitted: Fitted, elsewhere: FloatArray) -> FloatArray:
        """Log evidence of a fit for every draw of the noise, (m,): the mean over both form models.

        Each has a random-walk gain where that is likelier.
        """
        basis, problem = self._basis, self.problem
        scores = (self._noise[0] + elsewhere + basis.T @ fitted.residual).T
        columns = fitted.candidate.form_discrepancy(fitted.vector, FORM_SD)
        form = basis.T @ problem.space.project(columns.T).T
        jacobian, waves = basis.T @ fitted.jacobian, basis.T @ problem.waves

        def evidence(form_discrepancy: FloatArray) -> FloatArray:
            here = LinearFit(
                fitted=fitted, jacobian=jacobian, form_discrepancy=form_discrepancy, scores=scores
            )
            left = here.left_by_unit_information
            return here.log + log_evidence_gain(left.scores, left.residual(waves), problem.data.n)

        return mean_evidence(evidence(form[:, :0]), evidence(form))

    def _chi2(self, fitted: Fitted, elsewhere: FloatArray) -> FloatArray:
        """Chi2 of a fit in its declared form, for each draw of the noise, (m,)."""
        basis, draws = self._basis, self._noise[0] + elsewhere
        _, sd = fitted.candidate.prior
        low, high = fitted.candidate.bounds
        free = (fitted.vector > low) & (fitted.vector < high) | ~np.isfinite(sd)
        jacobian = basis.T @ fitted.jacobian[:, free]
        # about the optimum, where the priors' pull and the residual's balance
        information = jacobian.T @ jacobian + np.diag(1 / sd[free] ** 2)
        moved = draws @ jacobian @ np.linalg.pinv(information, rcond=1e-13, hermitian=True)
        left = draws + basis.T @ fitted.residual - moved @ jacobian.T
        return np.asarray(np.sum(left**2, axis=1))

    def absorbed(self, of: SizeParameter) -> dict[str, float]:
        """Share of the visible part's energy that each other candidate absorbs, at the best of its
        shapes, to first order; the largest first.
        """
        mine = self.visible(of, SMALL * of.expected)
        energy = float(mine @ mine)
        shares: dict[str, float] = {}
        for effect, columns in self.problem.library if energy > 0 else ():
            if effect.name != of.effect.name:
                basis = orthonormal(self._reduced(columns))
                share = min(float(np.sum((basis.T @ mine) ** 2) / energy), 1.0)
                shares[effect.name] = max(shares.get(effect.name, 0.0), share)
        return dict(sorted(shares.items(), key=lambda item: -item[1]))

    def harm(self, of: SizeParameter, size: float) -> FloatArray:
        """Shift (p,) of the base model's coefficients by an undetected effect of this size."""
        base, log_lift = self.problem.base_fit, self._log_lift(of, size)
        moved = fit(base.candidate, self.problem.space, log_lift, base.vector)
        return np.asarray(moved.vector - base.vector)
