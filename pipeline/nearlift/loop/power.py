"""Power of a design: the signature of each effect, its detection limit, its rivals, and its bias.

No measured lift is needed. A search problem (trials, base model, noise) is enough: noiseless data
with one effect in them are fitted by every candidate. The noise is drawn about those fits, which
are linear in it. `diagnose.set_up` makes the problem of a measured campaign, `planned` that of a
planned one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, FloatArray
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop import structure, weigh
from nearlift.loop.candidate_fit import Fitted, fit, search
from nearlift.loop.evidence import CREDIT, Linearised, mean_evidence
from nearlift.loop.random_walk_gain import log_evidence_gain
from nearlift.loop.search_problem import SearchProblem
from nearlift.loop.size_parameter import LIMIT_POWER, NamingProbability, SizeParameter
from nearlift.loop.visibility import SILENT, visibility, visible
from nearlift.randomness import generator
from nearlift.results.diagnosis import FORM_SD
from nearlift.results.explanation import Power

#: Draws of the noise; a chance of 80 % is then known to 1.3 %.
DRAWS = 1000
#: A power curve has so many sizes, up to so many times the one whose visible part has a length of
#: four standard deviations.
STEPS, REACH = 16, 3.0
VISIBLE_LENGTH = 4.0


@dataclass(frozen=True, kw_only=True)
class DesignPower:
    """A problem, and what can be known of every effect before any of them is looked for.

    `quiet` is the noise's true size over the problem's, which is what the loop would take it for.
    """

    problem: SearchProblem
    quiet: float = 1.0

    @property
    def _basis(self) -> FloatArray:
        """Orthonormal basis of the reduced space, (n, d)."""
        return self.problem.hypotheses[1]

    @cached_property
    def _bases(self) -> tuple[FloatArray, FloatArray]:
        """The hypotheses' bases there, side by side, and their ranks."""
        return structure.bases(self.problem.hypotheses[0], self.problem.absorbed)[1:]

    def _reduced(self, columns: FloatArray) -> FloatArray:
        """Columns of log lift, (n,) or (n, k), in the reduced space, unit noise, with what theta
        absorbs projected out; (d,) or (d, k).
        """
        reduced = self._basis.T @ self.problem.space.project(columns.T).T
        absorbed = self.problem.absorbed
        return np.asarray(reduced - absorbed @ (absorbed.T @ reduced))

    @cached_property
    def _noise(self) -> tuple[FloatArray, FloatArray]:
        """Draws of unit noise in the reduced space (m, d), and of the scale that the noise floor's
        own uncertainty gives them (m, 1).
        """
        rng = generator(self.problem.options.seed, "foresight")
        dof = min(self.problem.noise.dof, 1e6)
        draws = self.quiet * rng.standard_normal((DRAWS, self._basis.shape[1]))
        return draws, np.sqrt(dof / rng.chisquare(dof, size=(DRAWS, 1)))

    @cached_property
    def candidates(self) -> tuple[Effect, ...]:
        """The effects that theta and L_inf do not absorb entirely."""
        return visible(self.problem)

    def vector(self, size_parameter: SizeParameter, size: float) -> FloatArray:
        """The flat vector of the base model with this effect turned up by `size`, within its
        bounds.
        """
        candidate = self.problem.candidate(size_parameter.effect)
        vector = candidate.null.copy()
        vector[: len(self.problem.start)] = self.problem.base_fit.vector
        low, high = candidate.bounds
        for s in candidate.slots:
            if s.parameter.name in size_parameter.shape:
                vector[s.start : s.stop] = size_parameter.shape[s.parameter.name]
            elif s.parameter.name == size_parameter.parameter.name:
                several = s.stop - s.start > 1
                vector[s.start : s.stop] += size * (
                    self._spread(s.stop - s.start) if several else size_parameter.direction
                )
        return np.clip(vector, low, high)

    def _added(self, size_parameter: SizeParameter, size: float) -> FloatArray:
        """Contribution of an effect of this size to log lift, (n,)."""
        candidate = self.problem.candidate(size_parameter.effect)
        return candidate.contribution(self.vector(size_parameter, size), size_parameter.effect)

    def _foretold(self, size_parameter: SizeParameter, size: float) -> FloatArray:
        """Noiseless log lift with it, (n,)."""
        base = self.problem.base_fit
        return base.candidate.log_ratio(base.vector) + self._added(size_parameter, size)

    def signature(
        self, size_parameter: SizeParameter, size: float
    ) -> tuple[FloatArray, FloatArray]:
        """Contribution of the effect to the log lift of each trial, and its part that theta and
        L_inf do not absorb; both (n,).
        """
        raw, base = self._added(size_parameter, size), self.problem.base_fit
        columns = np.hstack([self.problem.data.level_columns, base.candidate.jacobian(base.vector)])
        whiten = self.problem.space.covariance.whiten
        solution = np.linalg.lstsq(whiten(columns.T).T, whiten(raw), rcond=None)[0]
        return raw, raw - columns @ solution

    def visible(self, size_parameter: SizeParameter, size: float) -> FloatArray:
        """The visible part in the reduced space, unit noise; (d,)."""
        return self._reduced(self._added(size_parameter, size))

    @cached_property
    def _critical(self) -> FloatArray:
        """The chi-square that each hypothesis must exceed."""
        from scipy.stats import chi2

        level = 10.0 ** self.problem.nothing_added[0].threshold
        return np.asarray(chi2.isf(level, self._bases[1]), dtype=np.float64)

    def _elsewhere(self, size_parameter: SizeParameter, size: float) -> FloatArray:
        """How the visible part differs in other draws of what differs by session, (m, d); (1, d) of
        zeros for any other effect.
        """
        if size_parameter.parameter.per != "session":
            return np.zeros((1, self._basis.shape[1]))
        candidate = self.problem.candidate(size_parameter.effect)
        mine = candidate.entries(lambda s: s.parameter.name == size_parameter.parameter.name)
        reduced = self._reduced(candidate.jacobian(self.vector(size_parameter, 0.0))[:, mine])
        rng = generator(self.problem.options.seed, "foresight", "sessions", "all")
        others = _standard(rng.standard_normal((DRAWS, len(mine))))
        return np.asarray(size * (others - self._spread(len(mine))) @ reduced.T)

    def _spread(self, count: int) -> FloatArray:
        """One draw per session, of mean 0 and rms 1: what they have in common is L_inf."""
        rng = generator(self.problem.options.seed, "foresight", "sessions")
        return _standard(rng.standard_normal(count))

    def seen(self, signal: FloatArray) -> NDArray[np.bool_]:
        """Whether the test of all hypotheses exceeds its threshold, for each draw with this signal
        (d,) or (m, d) in the reduced space.
        """
        absorbed, (draws, scale) = self.problem.absorbed, self._noise
        scores = draws + signal
        scores = (scores - (scores @ absorbed) @ absorbed.T) * scale
        chi2 = structure.chi2_of_each(scores, *self._bases)
        return np.asarray(np.any(chi2 > self._critical, axis=1))

    def unit(self, size_parameter: SizeParameter) -> float:
        """The size whose visible part has a length of `VISIBLE_LENGTH` standard deviations, to
        first order; inf if nothing shows.
        """
        small = 1e-3 * min(size_parameter.plausible, size_parameter.largest)
        signal = self.visible(size_parameter, small) + self._elsewhere(size_parameter, small)
        length = float(np.sqrt(np.mean(np.sum(signal**2, axis=1))))
        return VISIBLE_LENGTH * small / length if length > 1e-12 else np.inf

    def _sizes(self, size_parameter: SizeParameter) -> FloatArray:
        return np.linspace(
            0.0, min(REACH * self.unit(size_parameter), size_parameter.largest), STEPS
        )

    def limit(self, size_parameter: SizeParameter) -> float | None:
        """The size seen with a chance of 80 %; None where no possible size is."""
        if visibility(self.problem, size_parameter.effect) <= SILENT:
            return None
        size = self._sizes(size_parameter)
        signals = (
            self.visible(size_parameter, s) + self._elsewhere(size_parameter, s) for s in size
        )
        chance = np.array([self.seen(signal).mean() for signal in signals])
        none = np.zeros_like(chance)
        curves = Power(size=size, seen=chance, within=none, first=none, alone=none)
        return curves.limit(LIMIT_POWER)

    def power(self, size_parameter: SizeParameter) -> Power:
        """Detection and naming against size, up to three times the size that is just visible or to
        the parameter's bound.
        """
        size = self._sizes(size_parameter)
        contests = [self.contest(size_parameter, s) for s in size]
        return Power(
            size=size,
            **{
                name: np.array([getattr(c, name) for c in contests])
                for name in ("seen", "within", "first", "alone")
            },
        )

    def contest(self, size_parameter: SizeParameter, size: float) -> NamingProbability:
        """Every candidate on noiseless data with this effect in them; noise drawn about
        the fits.
        """
        problem, log_lift = self.problem, self._foretold(size_parameter, size)
        elsewhere = self._elsewhere(size_parameter, size)
        seen = self.seen(self.visible(size_parameter, size) + elsewhere)
        base = fit(problem.candidate(), problem.space, log_lift, problem.base_fit.vector)
        none = self._evidence(base, elsewhere)
        structure = self._left(base, elsewhere)
        by_name: dict[str, tuple[FloatArray, FloatArray]] = {}
        for effect in self.candidates:
            fits = [search(c, problem.starts, log_lift) for c in problem.candidates(effect)]
            fits = [f for f in fits if not f.at_bound]
            if fits:
                each = np.stack([self._evidence(f, elsewhere) for f in fits])
                left = np.stack([self._left(f, elsewhere) for f in fits])
                pick = each.argmax(axis=0)[None]
                by_name[effect.name] = (
                    np.take_along_axis(each, pick, 0)[0],
                    np.take_along_axis(left, pick, 0)[0],
                )
        names = list(by_name)
        table = np.stack([by_name[n][0] for n in names]) - none
        gain = structure - np.stack([by_name[n][1] for n in names])
        accepted = (
            (table > CREDIT)
            & seen
            & problem.explains_enough(gain, structure - self._basis.shape[1])
        )
        # once one may be named, others are rivals by their evidence alone
        allowed = accepted.any(axis=0) & (table > 0)
        member = weigh.in_credible_set(np.where(allowed, table, -np.inf) / weigh.TEMPERATURE)
        leader = np.where(allowed, table, -np.inf).argmax(axis=0)
        total = max(int(seen.sum()), 1)
        rivals = {
            n: float(member[i].sum() / total)
            for i, n in enumerate(names)
            if n != size_parameter.effect.name
        }
        if size_parameter.effect.name not in names:
            return NamingProbability(seen=float(seen.mean()), rivals=rivals)
        mine = names.index(size_parameter.effect.name)
        first = member[mine] & (leader == mine)
        return NamingProbability(
            seen=float(seen.mean()),
            within=float(member[mine].mean()),
            first=float(first.mean()),
            alone=float((first & (member.sum(axis=0) == 1)).mean()),
            rivals=rivals,
        )

    def _evidence(self, fitted: Fitted, elsewhere: FloatArray) -> FloatArray:
        """Log evidence of a fit for every draw of the noise, (m,): the mean over both form models.

        Each has a random-walk gain where that is likelier.
        """
        basis = self._basis
        scores = (self._noise[0] + elsewhere + basis.T @ fitted.residual).T
        form_discrepancy = self.problem.space.project(
            fitted.candidate.form_discrepancy(fitted.vector, FORM_SD).T
        ).T
        jacobian, waves = basis.T @ fitted.jacobian, basis.T @ self.problem.waves

        def evidence(form_discrepancy: FloatArray) -> FloatArray:
            here = Linearised(
                fitted=fitted, jacobian=jacobian, form_discrepancy=basis.T @ form_discrepancy
            )
            left = here.by_unit_information(scores)
            waves_left = left.residual(waves)
            return here.log(left) + log_evidence_gain(left.scores, waves_left, self.problem.data.n)

        return mean_evidence(evidence(form_discrepancy[:, :0]), evidence(form_discrepancy))

    def _left(self, fitted: Fitted, elsewhere: FloatArray) -> FloatArray:
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

    def absorbed(self, size_parameter: SizeParameter) -> dict[str, float]:
        """Share of the visible part's energy that each other candidate takes over, at the best of
        its shapes, to first order.
        """
        mine = self.visible(
            size_parameter, 1e-3 * min(size_parameter.plausible, size_parameter.largest)
        )
        energy = float(mine @ mine)
        shares: dict[str, float] = {}
        if energy <= 0:
            return shares
        for effect, columns in self.problem.library:
            if effect.name == size_parameter.effect.name:
                continue
            q = orthonormal(self._reduced(columns))
            share = float(np.sum((q.T @ mine) ** 2) / energy)
            shares[effect.name] = max(shares.get(effect.name, 0.0), min(share, 1.0))
        return dict(sorted(shares.items(), key=lambda item: -item[1]))

    def harm(self, size_parameter: SizeParameter, size: float) -> FloatArray:
        """Shift (p,) of the base model's coefficients by an undetected effect of this size."""
        base, log_lift = self.problem.base_fit, self._foretold(size_parameter, size)
        moved = fit(base.candidate, self.problem.space, log_lift, base.vector)
        return np.asarray(moved.vector - base.vector)


def _standard(draw: FloatArray) -> FloatArray:
    """Mean 0 and rms 1 along the last axis; zeros where there is only one."""
    centred = draw - draw.mean(axis=-1, keepdims=True)
    rms = np.sqrt(np.mean(centred**2, axis=-1, keepdims=True))
    return np.asarray(centred / np.where(rms > 0, rms, 1.0))
