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
from nearlift.loop import structure
from nearlift.loop.candidate_fit import Fitted, fit, search
from nearlift.loop.evidence import CREDIT, Linearised, mean_evidence
from nearlift.loop.handle import LIMIT_POWER, Handle, NamingProbability
from nearlift.loop.random_walk_gain import log_evidence_gain
from nearlift.loop.search_problem import SearchProblem
from nearlift.loop.visibility import SILENT, visibility, visible
from nearlift.randomness import generator
from nearlift.results.diagnosis import FORM_SD, RIVAL_MAX_2LNB
from nearlift.results.explanation import Power

#: Draws of the noise; a chance of 80 % is then known to 1.3 %.
DRAWS = 1000
#: A power curve has so many sizes, up to so many times the one whose visible part has a length of
#: four standard deviations.
STEPS, REACH = 16, 3.0
VISIBLE_LENGTH = 4.0


@dataclass(frozen=True, kw_only=True)
class Foresight:
    """A stage, and what can be known of every effect before any of them is looked for.

    `quiet` is the noise's true size over the stage's, which is what the loop would take it for.
    """

    stage: SearchProblem
    quiet: float = 1.0

    @property
    def _basis(self) -> FloatArray:
        """Orthonormal basis of the reduced space, (n, d)."""
        return self.stage.hypotheses[1]

    @cached_property
    def _bases(self) -> tuple[FloatArray, FloatArray]:
        """The hypotheses' bases there, side by side, and their ranks."""
        return structure.bases(self.stage.hypotheses[0], self.stage.absorbed)[1:]

    def _reduced(self, columns: FloatArray) -> FloatArray:
        """Columns of log lift, (n,) or (n, k), in the reduced space, unit noise, with what theta
        absorbs projected out; (d,) or (d, k).
        """
        reduced = self._basis.T @ self.stage.space.project(columns.T).T
        absorbed = self.stage.absorbed
        return np.asarray(reduced - absorbed @ (absorbed.T @ reduced))

    @cached_property
    def _noise(self) -> tuple[FloatArray, FloatArray]:
        """Draws of unit noise in the reduced space (m, d), and of the scale that the noise floor's
        own uncertainty gives them (m, 1).
        """
        rng = generator(self.stage.options.seed, "foresight")
        dof = min(self.stage.noise.dof, 1e6)
        draws = self.quiet * rng.standard_normal((DRAWS, self._basis.shape[1]))
        return draws, np.sqrt(dof / rng.chisquare(dof, size=(DRAWS, 1)))

    @cached_property
    def candidates(self) -> tuple[Effect, ...]:
        """The effects that theta and L_inf do not absorb entirely."""
        return visible(self.stage)

    def vector(self, handle: Handle, size: float) -> FloatArray:
        """The flat vector of the base model with this effect turned up by `size`, within its
        bounds.
        """
        candidate = self.stage.candidate(handle.effect)
        vector = candidate.null.copy()
        vector[: len(self.stage.theta)] = self.stage.base_fit.vector
        low, high = candidate.bounds
        for s in candidate.slots:
            if s.parameter.name in handle.shape:
                vector[s.start : s.stop] = handle.shape[s.parameter.name]
            elif s.parameter.name == handle.parameter.name:
                several = s.stop - s.start > 1
                vector[s.start : s.stop] += size * (
                    self._spread(s.stop - s.start) if several else handle.direction
                )
        return np.clip(vector, low, high)

    def _added(self, handle: Handle, size: float) -> FloatArray:
        """Contribution of an effect of this size to log lift, (n,)."""
        candidate = self.stage.candidate(handle.effect)
        return candidate.contribution(self.vector(handle, size), handle.effect)

    def _foretold(self, handle: Handle, size: float) -> FloatArray:
        """Noiseless log lift with it, (n,)."""
        base = self.stage.base_fit
        return base.candidate.log_ratio(base.vector) + self._added(handle, size)

    def signature(self, handle: Handle, size: float) -> tuple[FloatArray, FloatArray]:
        """Contribution of the effect to the log lift of each trial, and its part that theta and
        L_inf do not absorb; both (n,).
        """
        raw, base = self._added(handle, size), self.stage.base_fit
        columns = np.hstack([self.stage.data.level_columns, base.candidate.jacobian(base.vector)])
        whiten = self.stage.space.covariance.whiten
        solution = np.linalg.lstsq(whiten(columns.T).T, whiten(raw), rcond=None)[0]
        return raw, raw - columns @ solution

    def visible(self, handle: Handle, size: float) -> FloatArray:
        """The visible part in the reduced space, unit noise; (d,)."""
        return self._reduced(self._added(handle, size))

    @cached_property
    def _critical(self) -> FloatArray:
        """The chi-square that each hypothesis must exceed."""
        from scipy.stats import chi2

        level = 10.0 ** self.stage.nothing_added[0].threshold
        return np.asarray(chi2.isf(level, self._bases[1]), dtype=np.float64)

    def _elsewhere(self, handle: Handle, size: float) -> FloatArray:
        """How the visible part differs in other draws of what differs by session, (m, d); (1, d) of
        zeros for any other effect.
        """
        if handle.parameter.per != "session":
            return np.zeros((1, self._basis.shape[1]))
        candidate = self.stage.candidate(handle.effect)
        mine = candidate.entries(lambda s: s.parameter.name == handle.parameter.name)
        reduced = self._reduced(candidate.jacobian(self.vector(handle, 0.0))[:, mine])
        rng = generator(self.stage.options.seed, "foresight", "sessions", "all")
        others = _standard(rng.standard_normal((DRAWS, len(mine))))
        return np.asarray(size * (others - self._spread(len(mine))) @ reduced.T)

    def _spread(self, count: int) -> FloatArray:
        """One draw per session, of mean 0 and rms 1: what they have in common is L_inf."""
        rng = generator(self.stage.options.seed, "foresight", "sessions")
        return _standard(rng.standard_normal(count))

    def seen(self, signal: FloatArray) -> NDArray[np.bool_]:
        """Whether the test of all hypotheses exceeds its threshold, for each draw with this signal
        (d,) or (m, d) in the reduced space.
        """
        absorbed, (draws, scale) = self.stage.absorbed, self._noise
        scores = draws + signal
        scores = (scores - (scores @ absorbed) @ absorbed.T) * scale
        chi2 = structure.chi2_of_each(scores, *self._bases)
        return np.asarray(np.any(chi2 > self._critical, axis=1))

    def unit(self, handle: Handle) -> float:
        """The size whose visible part has a length of `VISIBLE_LENGTH` standard deviations, to
        first order; inf if nothing shows.
        """
        small = 1e-3 * min(handle.plausible, handle.largest)
        signal = self.visible(handle, small) + self._elsewhere(handle, small)
        length = float(np.sqrt(np.mean(np.sum(signal**2, axis=1))))
        return VISIBLE_LENGTH * small / length if length > 1e-12 else np.inf

    def _sizes(self, handle: Handle) -> FloatArray:
        return np.linspace(0.0, min(REACH * self.unit(handle), handle.largest), STEPS)

    def limit(self, handle: Handle) -> float | None:
        """The size seen with a chance of 80 %; None where no possible size is."""
        if visibility(self.stage, handle.effect) <= SILENT:
            return None
        size = self._sizes(handle)
        signals = (self.visible(handle, s) + self._elsewhere(handle, s) for s in size)
        chance = np.array([self.seen(signal).mean() for signal in signals])
        none = np.zeros_like(chance)
        curves = Power(size=size, seen=chance, within=none, first=none, alone=none)
        return curves.limit(LIMIT_POWER)

    def power(self, handle: Handle) -> Power:
        """Detection and naming against size, up to three times the size that is just visible or to
        the parameter's bound.
        """
        size = self._sizes(handle)
        contests = [self.contest(handle, s) for s in size]
        return Power(
            size=size,
            **{
                name: np.array([getattr(c, name) for c in contests])
                for name in ("seen", "within", "first", "alone")
            },
        )

    def contest(self, handle: Handle, size: float) -> NamingProbability:
        """Every candidate on noiseless data with this effect in them; noise drawn about
        the fits.
        """
        stage, log_lift = self.stage, self._foretold(handle, size)
        elsewhere = self._elsewhere(handle, size)
        seen = self.seen(self.visible(handle, size) + elsewhere)
        base = fit(stage.candidate(), stage.space, log_lift, stage.base_fit.vector)
        none = mean_evidence(*self._evidence(base, elsewhere)[:2])
        structure = self._left(base, elsewhere)
        by_name: dict[str, tuple[FloatArray, FloatArray]] = {}
        for effect in self.candidates:
            fits = [search(c, stage.starts, log_lift) for c in stage.candidates(effect)]
            fits = [f for f in fits if not f.at_bound]
            if fits:
                each = np.stack([self._evidence(f, elsewhere) for f in fits])
                left = np.stack([self._left(f, elsewhere) for f in fits])
                pick = mean_evidence(each[:, 0], each[:, 1]).argmax(axis=0)[None]
                by_name[effect.name] = (
                    np.take_along_axis(each, pick[:, None], 0)[0],
                    np.take_along_axis(left, pick, 0)[0],
                )
        names = list(by_name)
        # (effects, 2, draws) by both readings, and (effects, draws) by the priors
        every = np.stack([by_name[n][0] for n in names])
        readings, order = every[:, :2], every[:, 2]
        table = mean_evidence(readings[:, 0], readings[:, 1]) - none
        gain = structure - np.stack([by_name[n][1] for n in names])
        accepted = (
            (table > CREDIT) & seen & stage.greater_part(gain, structure - self._basis.shape[1])
        )
        best = np.where(accepted, table, -np.inf).argmax(axis=0)
        leads = np.take_along_axis(readings, best[None, None], 0) - readings
        # once one may be named, others stand beside it by their evidence alone
        member = accepted.any(axis=0) & (table > 0) & (2 * leads.min(axis=1) <= RIVAL_MAX_2LNB)
        leader = np.where(accepted & member, order, -np.inf).argmax(axis=0)
        total = max(int(seen.sum()), 1)
        rivals = {
            n: float(member[i].sum() / total)
            for i, n in enumerate(names)
            if n != handle.effect.name
        }
        if handle.effect.name not in names:
            return NamingProbability(seen=float(seen.mean()), rivals=rivals)
        mine = names.index(handle.effect.name)
        first = member[mine] & (leader == mine)
        return NamingProbability(
            seen=float(seen.mean()),
            within=float(member[mine].mean()),
            first=float(first.mean()),
            alone=float((first & (member.sum(axis=0) == 1)).mean()),
            rivals=rivals,
        )

    def _evidence(self, fitted: Fitted, elsewhere: FloatArray) -> FloatArray:
        """Log evidence of a fit for every draw of the noise, (3, m).

        By unit information with an exact and a discrepant form, and by the priors. Each has a
        random-walk gain where that is likelier.
        """
        basis = self._basis
        scores = (self._noise[0] + elsewhere + basis.T @ fitted.residual).T
        form_discrepancy = self.stage.space.project(
            fitted.candidate.form_discrepancy(fitted.vector, FORM_SD).T
        ).T
        jacobian, waves = basis.T @ fitted.jacobian, basis.T @ self.stage.waves

        def reading(form_discrepancy: FloatArray) -> tuple[FloatArray, FloatArray]:
            here = Linearised(
                fitted=fitted, jacobian=jacobian, form_discrepancy=basis.T @ form_discrepancy
            )
            left = here.by_unit_information(scores)
            random_walk_gain = log_evidence_gain(
                left.scores, left.residual(waves), self.stage.data.n
            )
            return here.log(left) + random_walk_gain, here.by_priors(
                scores
            ).log_likelihood + random_walk_gain

        printed, uncertain = reading(form_discrepancy[:, :0]), reading(form_discrepancy)
        return np.stack([printed[0], uncertain[0], mean_evidence(printed[1], uncertain[1])])

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

    def absorbed(self, handle: Handle) -> dict[str, float]:
        """Share of the visible part's energy that each other candidate takes over, at the best of
        its shapes, to first order.
        """
        mine = self.visible(handle, 1e-3 * min(handle.plausible, handle.largest))
        energy = float(mine @ mine)
        shares: dict[str, float] = {}
        if energy <= 0:
            return shares
        for effect, columns in self.stage.library:
            if effect.name == handle.effect.name:
                continue
            q = orthonormal(self._reduced(columns))
            share = float(np.sum((q.T @ mine) ** 2) / energy)
            shares[effect.name] = max(shares.get(effect.name, 0.0), min(share, 1.0))
        return dict(sorted(shares.items(), key=lambda item: -item[1]))

    def harm(self, handle: Handle, size: float) -> FloatArray:
        """Shift (p,) of the base model's coefficients by an undetected effect of this size."""
        base, log_lift = self.stage.base_fit, self._foretold(handle, size)
        moved = fit(base.candidate, self.stage.space, log_lift, base.vector)
        return np.asarray(moved.vector - base.vector)


def _standard(draw: FloatArray) -> FloatArray:
    """Mean 0 and rms 1 along the last axis; zeros where there is only one."""
    centred = draw - draw.mean(axis=-1, keepdims=True)
    rms = np.sqrt(np.mean(centred**2, axis=-1, keepdims=True))
    return np.asarray(centred / np.where(rms > 0, rms, 1.0))
