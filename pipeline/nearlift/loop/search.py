"""One pass of the search: is there structure, which single effect or pair leaves none, and which of
them are rivals.
"""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, FloatArray, LiftModel
from nearlift.likelihood import budget, noise
from nearlift.likelihood.frame import framed
from nearlift.likelihood.noise import orthonormal, trial_covariance
from nearlift.likelihood.problem import Problem, height_slope
from nearlift.loop import structure
from nearlift.loop.candidate import (
    SESSION_SPREADS,
    Candidate,
    Fitted,
    bends_along,
    fit,
    search,
)
from nearlift.loop.families import STEP, families
from nearlift.loop.setting import SCHEDULE_WORDS, varies
from nearlift.loop.structure import Hypothesis, Null, Structure
from nearlift.quotation import Verdict
from nearlift.results import IntArray, Noise, Observations

#: Twice the log evidence by which an explanation may trail the best and still be its rival.
RIVAL = 9.0
PAIRS = 40
#: What stands before the name of a hypothesis that is an effect.
EFFECT = "effect "
#: A column that keeps less than this share of its energy beside theta and L_inf cannot be seen.
SILENT = 1e-4
#: An explanation must beat "no effect" by this in log evidence, or chance would be given a name.
CREDIT = 2.0
#: A gain in chi2 beyond this many times the number of trials is large beside the noise.
LARGE = 0.3
#: A name must account for this share of the structure that is there without it, give or take so
#: many standard deviations of its noise.
GREATER_PART = 0.6
BY_CHANCE = 1.0
#: An explanation that leaves something may still be named if it accounts for this share of the
#: structure, and plainly (log evidence).
NEARLY_ALL = 0.8
PLAIN = 15.0
#: One effect whose declared form leaves more than so many standard deviations of noise gives way to
#: two that are as likely.
LEAVES = 2.3
#: Its form is then granted this many times the usual uncertainty.
LOOSER = 2.0
#: What else a covariate is called where it has families of its own.
ALSO = {"previous_lift_N": ("previous_throttle", "previous_distance")}
#: An effect's true form is known to about this relative, smooth deviation.
FORM_SD = 0.2


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
class Explanation:
    """One candidate after the whole test was run again on what it leaves, its form uncertain by
    `form_sd`.

    `needed` says whether each of its effects accounts for the greater part of the structure that is
    there without it, in its declared form: a form's uncertainty, granted to a large effect that the
    coefficients absorb, could account for anything.
    """

    fitted: Fitted
    form_sd: float
    left: Structure
    gain: float
    log_evidence: float
    over_none: float
    plausibility: float
    needed: bool = True
    confirmed: bool | None = None

    @property
    def accepted(self) -> bool:
        """Whether it may be named: nothing is left beyond the threshold, each name is `needed` and
        plainly likelier than none.

        `confirmed` is set where something else decides: visits left out (`few_visits`), or nearly
        all being accounted for (`second_look`).
        """
        settled = (
            not self.left.present and self.over_none > CREDIT
            if self.confirmed is None
            else self.confirmed
        )
        return settled and self.needed and not self.fitted.at_bound

    @property
    def possible(self) -> bool:
        """Whether it may stand beside one that was accepted, by its evidence alone.

        `over_none` is its log evidence over no effect's. A size that runs into the end of what is
        physically possible is no explanation, nor are two effects of which one would do.
        """
        return (
            self.over_none > 0
            and not self.fitted.at_bound
            and (self.needed or len(self.effects) == 1)
        )

    @property
    def tube(self) -> FloatArray:
        """Columns (n, t) of its form's uncertainty."""
        return self.fitted.candidate.tube(self.fitted.vector, self.form_sd)

    @property
    def name(self) -> str:
        """Names of its effects."""
        return self.fitted.candidate.name

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of its effects, one by one."""
        return tuple(e.name for e in self.fitted.candidate.effects)


@dataclass(frozen=True, kw_only=True)
class Stage:
    """Everything that one boundary's search stands on: trials, base fit, noise, whitened
    hypotheses.

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
        return height_slope(
            self.base,
            self.data,
            dict(zip((p.name for p in self.base.parameters), self.theta, strict=True)),
        )

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
        named = [(f.name, f.covariate, f.columns) for f in families(self.data)]
        named += [(f"{EFFECT}{e.name}", e.varies_with, columns) for e, columns in self.library]
        words = [(name, SCHEDULE_WORDS.get(c, c)) for name, c, _ in named]
        # thousands of trials by hundreds of columns: what is done with is let go
        white = [self.space.project(columns.T).T for _, _, columns in named]
        del named
        basis = framed(orthonormal(np.hstack([self.base_fit.jacobian, *white])))
        reduced = tuple(
            Hypothesis(
                name=name,
                covariate=covariate,
                columns=basis.T @ (orthonormal(w) if w.shape[1] > 1 else w),
            )
            for (name, covariate), w in zip(words, white, strict=True)
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

    def structure(self, fitted: Fitted, tube: FloatArray) -> tuple[Structure, float, float]:
        """The whole test on what `fitted` leaves, its form uncertain by `tube`; also its log
        evidence, by unit information and by its priors.

        The coefficients of the base model are projected out. The effects' parameters have priors,
        so they are integrated over, linearised about the fit: as columns of prior size in the
        covariance, with the residual taken at the priors' centres.
        """
        hypotheses, basis = self.hypotheses
        p = len(self.theta)
        mean, sd = fitted.candidate.prior
        jacobian, white_tube = fitted.jacobian, self.space.project(tube.T).T
        # an entry held at its bound is known, not free on both sides
        low, high = fitted.candidate.bounds
        free = np.flatnonzero(
            (fitted.vector > low) & (fitted.vector < high) & (np.arange(len(mean)) >= p)
        )
        both = np.hstack([jacobian[:, :p], jacobian[:, free], white_tube])
        outside = both - basis @ (basis.T @ both)
        outside = outside[
            :,
            np.linalg.norm(outside, axis=0)
            > 1e-6 * np.maximum(np.linalg.norm(both, axis=0), 1e-300),
        ]
        whole = np.hstack([basis, framed(orthonormal(outside))])

        def left(
            fixed: IntArray, random: IntArray
        ) -> tuple[FloatArray, float, FloatArray, _Deform]:
            """Scores and chi2 with the entries `fixed` projected out and those `random` integrated
            over; what was removed; what deforms.
            """
            residual = fitted.residual + jacobian[:, random] @ (fitted.vector - mean)[random]
            deform = _Deform(whole.T @ np.hstack([jacobian[:, random] * sd[random], white_tube]))
            remove = orthonormal(deform(whole.T @ jacobian[:, fixed]))
            raw = whole.T @ residual
            scores = deform(raw)
            scores = scores - remove @ (remove.T @ scores)
            return scores, float(scores @ scores + residual @ residual - raw @ raw), remove, deform

        scores, chi2, remove, deform = left(np.arange(p), free)
        padded = structure.mapped(
            hypotheses,
            lambda x: deform(np.vstack([x, np.zeros((whole.shape[1] - len(x), x.shape[1]))])),
        )
        found = structure.examine(scores, padded, remove, self.null, self.options.false_alarm_rate)
        marginal = -0.5 * (chi2 + deform.log_det)
        # evidence: by unit information, so that no effect gains or loses by how wide its prior
        # happens to be declared; what differs by session is one population, integrated over
        by_session = fitted.candidate.by_session[free]
        own, session = free[~by_session], free[by_session]
        _, chi2, _, deform = left(np.r_[np.arange(p), own], session)
        penalty = float(np.sum(((fitted.vector - mean)[own] / sd[own]) ** 2))
        count = len(own) + (1 if len(session) else 0)
        return (
            found,
            -0.5 * (chi2 + deform.log_det + penalty + count * float(np.log(self.data.n))),
            marginal,
        )

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
            key=lambda e: e.log_evidence,
        )

    def judged(self, fitted: Fitted, form_sd: float, without: tuple[float, ...]) -> Explanation:
        """A fit whose form is uncertain by `form_sd`, after the whole test was run again on what it
        leaves.
        """
        left, log_evidence, plausibility = self.structure(
            fitted, fitted.candidate.tube(fitted.vector, form_sd)
        )
        gain = self.base_fit.chi2 - fitted.chi2
        return Explanation(
            fitted=fitted,
            form_sd=form_sd,
            left=left,
            gain=gain,
            needed=all(bool(self.greater_part(gain - g, self.excess - g)) for g in without),
            log_evidence=log_evidence,
            over_none=log_evidence - self.nothing_added[1],
            plausibility=plausibility,
        )

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

    def leaves(self, e: Explanation) -> float:
        """Chi2 that an explanation leaves in its declared form beyond what noise has, in standard
        deviations of the latter.
        """
        return (self.excess - e.gain) * BY_CHANCE / self.chance

    def straight_line(self, e: Explanation) -> float:
        """Log evidence over no effect's of a straight line along the covariates of an explanation's
        effects, in gain or in force; the larger.

        To first order, by unit information; minus infinity where no covariate of its own was
        logged.
        """
        data, absorbed = self.data, orthonormal(self.base_fit.jacobian)
        lift_N = data.covariates["lift_inf_N"] * np.exp(
            self.base_fit.candidate.log_ratio(self.base_fit.vector)
        )
        found = -np.inf
        for name in (effect.varies_with for effect in e.fitted.candidate.effects):
            if name in data.covariates and varies(data, name):
                along = data.covariates[name] - data.covariates[name].mean()
                white = self.space.project(np.stack([along, along * np.median(lift_N) / lift_N])).T
                white = white - absorbed @ (absorbed.T @ white)
                gain = (white.T @ self.base_fit.residual) ** 2 / np.maximum(
                    np.sum(white**2, axis=0), 1e-300
                )
                found = max(found, 0.5 * (float(gain.max()) - float(np.log(data.n))))
        return found

    def dispersion(self, e: Explanation) -> float:
        """Variance along the families and effects that an explanation leaves, in units of the noise
        floor's; 1 where it leaves nothing.
        """
        return 1.0 + e.left.present * max(self.excess - e.gain, 0.0) / float(
            self.hypotheses[1].shape[1]
        )

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
    def nothing_added(self) -> tuple[Structure, float]:
        """The test on what the base model alone leaves, and its log evidence."""
        none = np.zeros((self.data.n, 0))
        found, log_evidence, _ = self.structure(self.base_fit, none)
        return found, log_evidence


class _Deform:
    """(1 + T T')^(-1/2) for a few columns T."""

    def __init__(self, tube: FloatArray) -> None:
        self.basis, length, _ = np.linalg.svd(tube, full_matrices=False)
        self.shrink = 1 - 1 / np.sqrt(1 + length**2)
        self.log_det = float(np.log1p(length**2).sum())

    def __call__(self, x: FloatArray) -> FloatArray:
        result: FloatArray = x - (self.basis * self.shrink) @ (self.basis.T @ x)
        return result


def library_columns(
    base: LiftModel, effects: tuple[Effect, ...], data: Observations, theta: FloatArray
) -> list[tuple[Effect, FloatArray]]:
    """Each effect's first-order columns at its null, one entry per combination of shapes."""
    found = []
    for effect in effects:
        candidate = Candidate(base=base, effects=(effect,), data=data)
        for vector in candidate.shapes():
            vector = vector.copy()
            vector[: len(theta)] = theta
            columns = candidate.jacobian(vector)[:, candidate.sizes()]
            if np.any(columns):
                found.append((effect, columns))
    return found


#: Families of time: the drifts stand for them where noise is estimated.
TIME = (
    "time, slow",
    "time, slow, additive",
    "time, fast",
    STEP,
    "session",
    "session, additive",
    "time since start",
)
#: Noise is estimated anew until the coefficients move by less than this many of their standard
#: uncertainties, at most so many times; each time they go this part of the way, since noise and
#: coefficients pull each other to and fro.
SETTLED, ROUNDS, WAY = 0.1, 5, 0.62


def what_may_be(
    candidate: Candidate, vector: FloatArray, effects: tuple[Effect, ...]
) -> list[FloatArray]:
    """What the trials may hold beside a candidate: the families that are not of time, and every
    effect; a list of (n, k) of any rank.
    """
    data, theta = candidate.data, vector[: len(candidate.base.parameters)]
    found = [f.columns for f in families(data) if f.name not in TIME]
    shapes: dict[str, list[FloatArray]] = defaultdict(list)
    for effect, columns in library_columns(candidate.base, effects, data, theta):
        shapes[effect.name].append(columns)
    return [*found, *(np.hstack(each) for each in shapes.values())]


def prepare(
    data: Observations,
    base: LiftModel,
    effects: tuple[Effect, ...],
    parts: tuple[budget.Component, ...],
    theta: FloatArray,
    options: Options,
    about: Fitted | None = None,
    start: Noise | None = None,
) -> Stage:
    """Noise first, beside all that the trials may hold; then everything else.

    It is estimated about the base model at `theta`, or about the explanation `about`: beside an
    effect of many times the noise, the base model's slope and the families' curvature are not good
    enough to tell noise and outliers by. `start` is the noise of nearly the same trials.
    """
    p, found = len(theta), start
    candidate, vector = (
        (Candidate(base=base, effects=(), data=data), theta)
        if about is None
        else (about.candidate, about.vector)
    )
    for _ in range(ROUNDS):
        log_ratio = candidate.log_ratio(vector)
        slope = height_slope(
            base, data, dict(zip((q.name for q in base.parameters), vector[:p], strict=True))
        )
        levels = np.eye(len(data.levels))[data.level]
        found, target = noise.estimate(
            data,
            np.log(data.lift_N) - log_ratio,
            np.hstack([levels, candidate.jacobian(vector)]),
            what_may_be(candidate, vector, effects),
            slope,
            budget.shared(data, parts, slope),
            budget.own_variance(data, parts, slope),
            found,
        )
        stage = Stage(
            data=data,
            base=base,
            effects=effects,
            parts=parts,
            noise=found,
            log_lift=target + log_ratio,
            theta=vector[:p],
            options=options,
        )
        if about is not None:
            break
        if not p:
            break
        moved, jacobian = stage.base_fit.vector - vector, stage.base_fit.jacobian
        if np.all(
            np.abs(moved) < SETTLED * np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian)))
        ):
            break
        vector = vector + WAY * moved
    return stage


def settle(stage: Stage) -> Answer:
    """Search; where the structure is large beside the noise, take the noise floor about the best
    explanation and search again.
    """
    # a search keeps what it worked out; a copy of the stage, so that it goes with the search
    stage = dataclasses.replace(stage)
    answer = run(stage)
    for _ in range(2):
        tried = answer.accepted or sorted(
            (*answer.singles, *answer.pairs), key=lambda e: -e.log_evidence
        )
        if not tried or tried[0].gain < LARGE * stage.data.n:
            break
        ground, about = (
            (stage.data, stage.base, stage.effects, stage.parts, stage.theta, stage.options),
            tried[0].fitted,
        )
        del answer, tried, stage
        stage = prepare(*ground, about=about)
        answer = run(stage)
    return answer


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What one pass found. `accepted` is ordered, best first; `singles` and `pairs` are all that
    were tried.

    `contradicted` says what speaks against a base model that nothing structured does.
    """

    stage: Stage
    first: Structure
    singles: tuple[Explanation, ...]
    pairs: tuple[Explanation, ...]
    accepted: tuple[Explanation, ...]
    contradicted: tuple[str, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """adequate, effect or unexplained."""
        if not self.first.present:
            return "unexplained" if self.contradicted else "adequate"
        return "effect" if self.accepted else "unexplained"

    def claimed_below(self, threshold: float) -> Answer:
        """The same, but that nothing is claimed unless a test's log10 p lies below `threshold`."""
        first = dataclasses.replace(self.first, threshold=threshold)
        return dataclasses.replace(
            self, first=first, accepted=self.accepted if first.present else ()
        )

    @property
    def best(self) -> Fitted:
        """The model to predict with: the best explanation, else the base model."""
        return self.accepted[0].fitted if self.accepted else self.stage.base_fit


def run(stage: Stage) -> Answer:
    """Test, then single effects, then pairs if no single one will do.

    An effect that would do, but whose covariate's straight line in gain or force is plainly
    likelier, is what happens along that covariate, and not that effect.
    """
    first, _ = stage.nothing_added
    if not first.present:
        return Answer(stage=stage, first=first, singles=(), pairs=(), accepted=())
    seen = {e.name: e for e, _ in stage.library}
    visible = [e for e in seen.values() if visibility(stage, e) > SILENT]
    # one that has no value at some trial, beyond a pole, explains nothing
    tried = [(e, stage.explain((e,))) for e in visible]
    visible = [e for e, s in tried if np.isfinite(s.gain)]
    singles = tuple(s for _, s in tried if np.isfinite(s.gain))
    alone = [s for s in singles if s.accepted]
    clean = bool(alone)
    if not clean:
        singles = second_look(stage, singles)
    disowned = {
        s.name for s in singles if s.accepted and s.over_none < stage.straight_line(s) - PLAIN
    }
    if disowned:
        singles = tuple(
            dataclasses.replace(s, needed=s.needed and s.name not in disowned) for s in singles
        )
        visible = [e for e in visible if e.name not in disowned]
    alone = [s for s in singles if s.accepted]
    best = max(alone, key=lambda e: e.log_evidence, default=None)
    gains = {s.name: s.gain for s in singles}
    pairs = tuple(
        stage.explain((one, two), (gains[one.name], gains[two.name]))
        for one, two in promising(stage, visible, best)
    )
    if not clean and not any(p.accepted for p in pairs):
        pairs = second_look(stage, pairs)
    return Answer(
        stage=stage,
        first=first,
        singles=singles,
        pairs=pairs,
        accepted=contenders(stage, singles, pairs),
    )


def contenders(
    stage: Stage, singles: tuple[Explanation, ...], pairs: tuple[Explanation, ...]
) -> tuple[Explanation, ...]:
    """The explanations that this design cannot tell apart, the one to be named first; empty if none
    was accepted.

    Two effects take the place of one that would do alone only where the second earns it: one effect
    of uncertain form can imitate two, and two one of strange form. What both leave is noise to that
    judgement, so the price grows with it.
    """
    alone, together = [e for e in singles if e.accepted], [e for e in pairs if e.accepted]
    most = max((e.log_evidence for e in alone), default=-np.inf)
    ahead = {
        p.name: p.log_evidence - most - RIVAL / 2 * (stage.dispersion(p) - 1) for p in together
    }
    earned = max(ahead.values(), default=-np.inf) > RIVAL / 2 or not alone
    if alone and stage.leaves(max(alone, key=lambda e: e.log_evidence)) > LEAVES:
        # so much of its form would have to be wrong that two effects, of which neither is, need not
        # be likelier
        earned = earned or any(
            stage.leaves(p) <= LEAVES and 2 * (most - p.log_evidence) <= RIVAL for p in together
        )
    tried, accepted = (pairs, together) if earned else (singles, alone)
    if not accepted:
        return ()
    # who belongs is for the evidence to say; who comes first among those also for how large such an
    # effect may plausibly be
    most = max(e.log_evidence for e in accepted)
    rivals = [e for e in tried if e.possible and 2 * (most - e.log_evidence) <= RIVAL]
    if not stage.options.pairs:
        # beside few trials the form of a large effect that the coefficients absorb can explain
        # anything
        rivals = [e for e in rivals if e.needed]
    rivals.sort(key=lambda e: (not e.accepted, -e.plausibility))
    if not earned:
        # two effects that are likelier, if not plainly, could still be what is there
        rivals += sorted((p for p in together if ahead[p.name] > 0), key=lambda e: -e.plausibility)
    return tuple(rivals)


def promising(
    stage: Stage, visible: list[Effect], alone: Explanation | None
) -> list[tuple[Effect, Effect]]:
    """Pairs by what they could gain to first order, the best first; beside an effect that will do
    alone, those that could gain plainly more.
    """
    if not stage.options.pairs:
        return []
    least = -np.inf if alone is None else alone.gain + RIVAL
    gains = pair_gains(stage)
    projected = ((gains[one.name, two.name], (one, two)) for one, two in combinations(visible, 2))
    return [
        pair
        for _, pair in sorted((p for p in projected if p[0] > least), key=lambda p: -p[0])[:PAIRS]
    ]


def pair_gains(stage: Stage) -> dict[tuple[str, str], float]:
    """Drop of chi2 that two effects could give to first order, over their shapes, beside the
    coefficients; by names, in either order.
    """
    hypotheses, basis = stage.hypotheses
    named = tuple(h for h in hypotheses if h.name.startswith(EFFECT))
    which, stacked, ranks = structure.bases(named, stage.absorbed)
    score, product = stacked.T @ (basis.T @ stage.base_fit.residual), stacked.T @ stacked
    ends = np.cumsum(ranks)
    shapes = [
        (named[i].name.removeprefix(EFFECT), np.arange(end - rank, end))
        for i, rank, end in zip(which, ranks, ends, strict=True)
    ]
    best: dict[tuple[str, str], float] = defaultdict(float)
    for (one, left), (two, right) in combinations(shapes, 2):
        both = np.r_[left, right]
        gain = float(
            score[both] @ np.linalg.lstsq(product[np.ix_(both, both)], score[both], rcond=1e-8)[0]
        )
        best[one, two] = best[two, one] = max(best[one, two], gain)
    return best


def second_look(stage: Stage, tried: tuple[Explanation, ...]) -> tuple[Explanation, ...]:
    """Those that account for nearly all of the structure, taken again with a form twice as
    uncertain, and accepted.

    An effect of many times the noise betrays its form's errors to a much finer degree than any form
    is known. What the library does not hold is told from it by its share: the nearest effect rarely
    accounts for half of it. A size of its own for every session has no form that could be wrong,
    and imitates any step: such an effect is not looked at again, nor one that explains less than a
    bare step does. And what is left must lie along what its form bends along: no error of a form
    puts structure elsewhere.
    """
    least = max(NEARLY_ALL * stage.excess, stage.best_step)

    def again(e: Explanation) -> Explanation:
        if (
            e.form_sd <= 0
            or e.gain < least
            or e.over_none <= PLAIN
            or e.fitted.candidate.by_session.any()
        ):
            return e
        looser = stage.judged(e.fitted, LOOSER * e.form_sd, ())
        bends = [name for effect in e.fitted.candidate.effects for name in bends_along(effect)]
        along = {
            word for name in bends for word in (SCHEDULE_WORDS.get(name, name), *ALSO.get(name, ()))
        }
        of_the_form = not looser.left.present or next(iter(looser.left.by_covariate())) in along
        return dataclasses.replace(
            looser, needed=e.needed, confirmed=looser.over_none > PLAIN and of_the_form
        )

    return tuple(map(again, tried))


def visibility(stage: Stage, effect: Effect) -> float:
    """Largest share of the energy of an effect's columns that theta and L_inf leave, over its
    shapes.
    """
    shares, basis = [], orthonormal(stage.base_fit.jacobian)
    for e, columns in stage.library:
        if e.name == effect.name:
            whole = stage.space.covariance.whiten(columns.T).T
            white = stage.space.project(columns.T).T
            left = white - basis @ (basis.T @ white)
            shares.append(float(np.sum(left**2) / max(np.sum(whole**2), 1e-300)))
    return max(shares, default=0.0)
