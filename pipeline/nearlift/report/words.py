"""Sentences of a report: verdict, sizes of effects, omitted errors, doubts and next steps.

Page, summary, methods, captions and messages take their sentences from here.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import Boundary
from nearlift.likelihood.budget import components
from nearlift.likelihood.noise import REPEATS
from nearlift.nomenclature import letter, noun
from nearlift.reduction.quality import CODES, rejected
from nearlift.report import curves
from nearlift.report.evidence import Evidence
from nearlift.report.phrases import (
    along,
    chance,
    counted,
    dependence,
    explanation,
    implausible,
    is_sure,
    listed,
    probability,
    random_walk,
    sentence,
    several,
    sizes,
    structure_along,
    titles,
)
from nearlift.report.sources import PlausibleError, leads, missing_for, undeclared, undetected
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.fit import LevelFit, Suspect
from nearlift.results.outlook import NextExperiment, NextSession, Sensitivity
from nearlift.results.quotation import BoundaryResult, CoefficientResult
from nearlift.rounding import decimals, fixed, like, plain, signed
from nearlift.schedule import BY_NAME
from nearlift.stages.diagnose import DIAGNOSIS, NOT_DIAGNOSED
from nearlift.stages.ingest import TRIALS

#: A base model whose chi2 has a smaller p-value than this is rejected.
REJECTED_P = 1e-3
#: Stations nearer than `NEAR_HAT` rotor radii leave lift in free air undetermined; from `FAR_HAT`
#: on they do not (docs/planning.md).
NEAR_HAT, FAR_HAT = 6.0, 12.0
#: A further source is printed where u without it is below this part of u.
SMALL = 0.8
#: Errors of inputs below this part of u are not listed.
LEAST_IN_U = 0.01
#: Reasons of rejected trials, rivals and detection limits in a sentence; tables have all.
MAX_REASONS, MAX_RIVALS, MAX_POWERS = 3, 4, 3
#: An experiment of so many times the campaign's trials is not proposed.
MOST_REPEATS = 10
#: Change of lift whose distance is printed.
SEEN = 0.02
#: Inputs of the load cell in `[[uncertainty]] on`.
CELL = {"force", "gain", "linearity"}


@dataclass(frozen=True)
class Brief:
    """Sentences about one boundary, each empty where there is nothing to say."""

    evidence: Evidence
    boundary: Boundary

    @cached_property
    def quoted(self) -> BoundaryResult:
        """The result to quote."""
        return self.evidence.quoted(self.boundary)

    @cached_property
    def diagnosis(self) -> BoundaryDiagnosis | None:
        """The loop's findings; None where the boundary could not be diagnosed."""
        return self.evidence.diagnosed(self.boundary)

    @property
    def headline(self) -> CoefficientResult | None:
        """The first coefficient to quote."""
        return self.quoted.coefficients.get(self.quoted.headline)

    @cached_property
    def unstated(self) -> list[PlausibleError]:
        """Errors of inputs without a stated uncertainty, the largest first."""
        return undeclared(self.evidence, self.boundary)

    @property
    def model(self) -> str:
        """Title of the base model."""
        return catalogue.model(self.quoted.base_model).title

    # the answer

    @property
    def verdict(self) -> str:
        """Verdict, with its probability and the identified effects' sizes."""
        quoted, diagnosis, sure = self.quoted, self.diagnosis, probability(self.quoted)
        if quoted.verdict == NOT_DIAGNOSED:
            return f"Not diagnosed: {quoted.reason.removesuffix(f'; {quoted.wanted}')}."
        if quoted.verdict == "effect":
            return f"{self.model} alone does not fit. {self._explained}"
        if quoted.verdict == "adequate":
            few = diagnosis.sensitivity if diagnosis else None
            within = f" in {few.trials} trials" if few else ""
            return f"{self.model} fits; no residual structure detected{within}{sure}."
        where = structure_along(diagnosis)
        text = f"{self.model} does not fit{f': residuals vary with {where}' if where else ''}{sure}"
        pairs = (diagnosis.not_confirmed if diagnosis else ()) or ()
        if not pairs:
            return f"{text}. No effect testable here explains them."
        names = several([titled(" with ".join(p)) for p in pairs], 2, "or")
        but = f"but without better predictions of {self.evidence.left_out} left out"
        return f"{text}. {sentence(f'{names} would fit, {but}')}"

    @property
    def _explained(self) -> str:
        """The explanation of the residuals, with sizes and rivals."""
        quoted, named = self.quoted, titles(self.quoted.effects)
        size = sizes(quoted, self.evidence.campaign.vehicle.rotor_radius)
        if not is_sure(quoted) and self.diagnosis and self.diagnosis.probabilities:
            causes = explanation(quoted, self.diagnosis)
            under = f" If it is {named}: {size}." if size else ""
            return f"The residuals are explained by {causes}.{under}"
        one = len(quoted.effects) == 1
        text = f"{named} {'explains' if one else 'explain'} the residuals{probability(quoted)}"
        if size:
            # a rival has a size of its own
            text += f": {size}" if one else f". {size}"
        rivals, also = rivals_of(self.diagnosis), ""
        further = {n for r in rivals for n in r.split(" + ")} - {*quoted.effects}
        if rivals and further and all(" + " in r for r in rivals):
            pairs = titles(sorted(further), "or")
            also = f" It may act alone or with {pairs}; this design cannot distinguish these."
        elif rivals:
            also = f" This design cannot distinguish {confused(self.diagnosis)}."
        return f"{sentence(text)}{also}"

    @property
    def omits(self) -> str:
        """Inputs without a stated uncertainty, each with the shift by a plausible error."""
        errors = [e for e in self.unstated if e.in_u > LEAST_IN_U]
        words = []
        for i, e in enumerate(errors):
            shifts = ":" if i else f" shifts {noun(self.quoted.headline)} by"
            largest = "largest; " if not i and len(errors) > 1 else ""
            words.append(f"{e.title} ({largest}{e.text}{shifts} {plain(e.shift, 2)})")
        if not words:
            return ""
        if not {part.on for part in components(self.evidence.campaign)} & CELL:
            words.append("load cell")
        them = "them" if len(words) > 1 else "it"
        return f"Not included: {listed(words)}. No uncertainty is stated for {them}."

    @property
    def error(self) -> str:
        """Cross-validated error before and after, in percent of lift."""
        error = self.quoted.error
        if error is None:
            return ""
        floor = 100 * error.noise_floor
        # two decimals at most, but for a floor below 0.1 %
        places = max(decimals(floor) + 1, 1) if floor > 0 else 2
        places = min(places, 2) if floor >= 0.1 else places
        before, after, noise = (
            fixed(100 * e, places) for e in (error.before, error.after, error.noise_floor)
        )
        then = f", {after} % with the effect" if self.quoted.verdict == "effect" else ""
        left_out = self.evidence.left_out
        return f"{before} % of lift on {left_out} left out of the fit{then}; noise floor {noise} %"

    @property
    def sources(self) -> str:
        """The headline's u, and u without each source that matters."""
        c = self.headline
        if not c or not (sources := leads(c)):
            return ""
        mostly = "mostly" if sources[0][1] < c.u / 2 else "from"
        parts = [
            f"{titled(name)} ({plain(u, 2)}{'' if i else ' without it'})"
            for i, (name, u) in enumerate(sources)
            if not i or u < SMALL * c.u
        ]
        return f"u({letter(self.quoted.headline)}) = {plain(c.u, 2)}, {mostly} {', '.join(parts)}."

    @property
    def influence(self) -> str:
        """The trial and the visit that move the headline most."""
        c, parts = self.headline, list[str]()
        if c is None or not 0 < c.u < math.inf:
            return ""
        places = decimals(c.u) + 1
        for kind, one in (("trial", c.influence.trial), ("visit", c.influence.visit)):
            if one is not None and float(f"{one.shift:.{places}f}"):
                shift = signed(one.shift, places)
                if not parts:
                    shift = f"{letter(self.quoted.headline)} {shift} without it"
                parts.append(f"{kind} {one.id} ({shift})")
        return f"Most influential: {', '.join(parts)}." if parts else ""

    @cached_property
    def reach(self) -> str:
        """Distance at which the quoted model's lift change is `SEEN`; empty beyond the trials."""
        z_hat = self.evidence.observations[self.boundary].z_hat
        z_hat = z_hat[np.isfinite(z_hat) & (z_hat > 0)]
        if not len(z_hat):
            return ""
        grid = np.geomspace(z_hat.min(), z_hat.max(), 41)
        for _ in range(3):
            # the last interval in which the change falls below, finer and finer
            change = np.abs(curves.line(self.evidence, self.boundary, grid).middle) - SEEN
            larger = np.flatnonzero(change >= 0)
            if not len(larger) or larger[-1] == len(grid) - 1:
                return ""
            grid = np.geomspace(grid[larger[-1]], grid[larger[-1] + 1], 9)
        at = float(grid[4])
        mm = 1e3 * at * self.evidence.campaign.vehicle.rotor_radius
        where = f"a recorded ẑ = {plain(at, 3)} ({plain(mm, 3)} mm)"
        return f"Lift changes by less than {100 * SEEN:g} % beyond {where}."

    @property
    def findings(self) -> list[str]:
        """Further findings of the loop, a sentence or two each."""
        diagnosis = self.diagnosis
        if diagnosis is None:
            return []
        said = [diagnosis.look.text] if diagnosis.look else []
        if self.error:
            said.append(f"cross-validated error: {self.error}")
        if diagnosis.error and (folds := diagnosis.error.chosen_in_folds):
            named = {e.name for e in diagnosis.effects} or {diagnosis.verdict}
            same = sum({part.strip() for part in c.split("+")} == named for c in folds)
            said.append(
                "repeated searches without the held-out trials gave the same answer in"
                f" {same} of {len(folds)} folds"
            )
        if carried := listed([along(c) for c in diagnosis.coefficients.carried]):
            said.append(f"the intervals include an unexplained dependence on {carried}")
        if within := diagnosis.within_trial:
            change = within.change_over_record
            u = 100 * (change.hi90 - change.lo90) / 3.3
            value, low, high = (like(100 * x, u) for x in (change.value, change.lo90, change.hi90))
            names = titles(within.candidates, "or") if within.significant else ""
            cause = f", as by {names}" if names else ""
            ends = f"(90 %: {low} to {high})"
            said.append(f"within a record, lift changes by {value} % {ends}{cause}")
        if could := diagnosis.sensitivity:
            said += [f"with {could.trials} trials only single effects were tested", power(could)]
        return [sentence(text) for text in (*said, *(limit.text for limit in diagnosis.limits))]

    # doubts

    @property
    def doubts(self) -> list[str]:
        """Doubts, the most serious first; those shared by several boundaries last. What `omits`
        says with the number is left out.
        """
        every = sorted(doubts(self.evidence).items(), key=lambda d: len(d[1]) != 1)
        mine = [text for text, of in every if self.boundary in of or not of]
        return [text for text in mine if text != self.inputs]

    @property
    def rejected(self) -> bool:
        """Whether chi2 rejects the base model, where repeats show the noise."""
        by_repeats = self.evidence.fits.noise[self.boundary].source.startswith(REPEATS)
        return by_repeats and self.evidence.base(self.boundary)[1].p_value < REJECTED_P

    @property
    def goodness(self) -> str:
        """The meaning of chi2."""
        source = self.evidence.fits.noise[self.boundary].source
        if not source.startswith(REPEATS):
            return f"no test, as the noise is the {source}"
        if self.rejected:
            effects = titles(self.quoted.effects)
            which = "the base model without effects is rejected" if effects else "rejected"
            valid = "The interval is valid only if the model is"
            p = chance(self.evidence.base(self.boundary)[1].p_value)
            return (
                f"{which}, as cell means deviate from the curve by more than scatter ({p})."
                f" {f'The quoted model includes {effects}' if effects else valid}"
            )
        undiagnosed = (
            ". Effects on the repeats themselves (sessions, supply, drift) need the diagnosis"
        )
        text = "cell means deviate no more than repeats scatter"
        return text + ("" if self.evidence.has(DIAGNOSIS) else undiagnosed)

    @property
    def reservations(self) -> list[str]:
        """Doubts about this boundary alone, the most serious first."""
        quoted, diagnosis, headline = self.quoted, self.diagnosis, self.headline
        on = quoted.most_influential
        suspects = [
            s
            for s in self.evidence.fits.influence[self.boundary].suspects
            if on is None or (s.kind, s.id) != (on[0], on[1].id)
        ]
        said = [dependence(quoted), *implausible(quoted)]
        if self.evidence.not_diagnosed(self.boundary):
            # a known shift out of the interval is more serious than a possible one
            reach = 0.5 * (headline.hi90 - headline.lo90) if headline else math.inf
            large = [s for s in suspects if abs(s.shift) > reach]
            said += [s.text for s in sorted(large, key=lambda s: -abs(s.shift))]
            said.append("not diagnosed: the coefficient may include an effect of any size")
        if diagnosis and diagnosis.look:
            said.append(f"the campaign is still growing: {diagnosis.look.text}")
        if self.rejected and quoted.verdict in ("adequate", NOT_DIAGNOSED):
            # the other verdicts are not about the base model alone
            only_if = "the interval is valid only if the model is"
            said.append(f"cell means deviate significantly from {self.model}: {only_if}")
        if diagnosis:
            said += [*(diagnosis.contradicted or ()), *map(titled, diagnosis.at_bound or ())]
            said += (
                [random_walk(diagnosis.random_walk_gain)]
                if diagnosis.random_walk_gain is not None
                else []
            )
            if diagnosis.verdict == "unexplained" and not diagnosis.contradicted:
                where = structure_along(diagnosis)
                vary = f" vary with {where}" if where else " have structure"
                said.append(f"residuals{vary}, unexplained: the coefficient may be affected too")
        said += [s.text for s in suspects if _is_serious(s, headline)]
        at_bound = [n for n, c in quoted.coefficients.items() if c.at_bound]
        said += [f"{letter(name)} is at a bound of its range" for name in at_bound]
        if quoted.verdict == NOT_DIAGNOSED:
            # after the loop the other conditions show it
            said += [d.text for d in self.evidence.base(self.boundary)[1].degeneracies[:1]]
        # the interval covers the rivals: where they agree, what it leaves out is more serious
        apart = headline is not None and any(
            d.explanation and abs(d.value - headline.value) > headline.u for d in headline.doubts
        )
        said += [*self._alike, *self._hidden] if apart else [*self._hidden, *self._alike]
        said += [s.text for s in suspects]
        if diagnosis and diagnosis.untestable:
            unlogged = several([titled(name) for name in diagnosis.untestable])
            said.append(f"untestable with what was logged: {unlogged}")
        return [sentence(text) for text in dict.fromkeys(said) if text]

    @property
    def _alike(self) -> list[str]:
        """Rivals of each identified effect, pairs last, with the headline under each."""
        doubts = self.headline.doubts if self.headline else ()
        values = {d.explanation: plain(d.value, 2) for d in doubts}

        def with_value(name: str, equals: str = "") -> str:
            title = name.replace(" + ", " with ")
            return f"{title} ({equals}{values[name]})" if name in values else title

        said: list[str] = []
        diagnosis = self.diagnosis
        if diagnosis is None:
            return said
        for effect in diagnosis.effects:
            others = sorted(diagnosis.stand_ins(effect), key=lambda o: " + " in o)
            rivals = several([with_value(o) for o in others], MAX_RIVALS, "or")
            best = with_value(effect.name, f"{letter(self.quoted.headline)} = ")
            said += [f"this design cannot distinguish {best} from {rivals}"] if rivals else []
        return said

    @property
    def _hidden(self) -> list[str]:
        """Doubts beyond the interval by more than u, the larger first: an undetected effect, and
        errors of inputs without a stated uncertainty.
        """
        said = [(self.unstated[0].shift, self.inputs)] if self.inputs else []
        if hidden := undetected(self.evidence, self.boundary):
            shift, effect = hidden
            what = f"undetected {titled(effect)}"
            if effect == "held_quantity":
                what = f"an undetected violation of constant {self.evidence.campaign.rig.held}"
            moved = f"could shift {noun(self.quoted.headline)} by up to {plain(shift, 2)}"
            said.append((shift, f"Not in the interval: {what} {moved}."))
        return [text for _, text in sorted(said, reverse=True)]

    @property
    def inputs(self) -> str:
        """The sentence on inputs whose error would shift the headline by more than u."""
        errors = [e for e in self.unstated if e.in_u > 1]
        parts: list[str] = []
        for e in errors:
            size = f"{e.text} " if not parts or e.text != errors[0].text else ""
            shifts = "" if parts else f" shifts {noun(self.quoted.headline)}"
            what = f"{size}{'' if parts else 'error '}in {e.title}{shifts}"
            # a larger error would be detected
            parts.append(f"{what} by {'up to ' if e.at_most else ''}{plain(e.shift, 2)}")
        states = {1: "does not state it", 2: "states neither"}
        which = states.get(len(errors), "states none of them")
        return f"A {', '.join(parts)}. The manifest {which}." if parts else ""

    # next steps

    @property
    def next(self) -> str:
        """Next steps, and the quantities to log.

        The steps are to distinguish rivals or to be diagnosed. Otherwise they are to detect hidden
        effects, to state what is not stated, or to lower the largest source.
        """
        on, z_hat = self.quoted.most_influential, self.evidence.observations[self.boundary].z_hat
        visit = on[1] if on and on[0] == "visit" else None
        unexplained, diagnosis = self.quoted.verdict == "unexplained", self.diagnosis
        if asked := self.feasible:
            # the visit that the answer depends on comes first
            ranked = sorted(asked, key=lambda n: (visit is None) != isinstance(n, NextSession))
            steps = [_proposal(n) for n in ranked[: 2 if visit else 1]]
            return _steps(steps + (self._logging() if unexplained else []))
        steps = [f"for a diagnosis, {self.quoted.wanted}"] if self.quoted.wanted else []
        if steps and z_hat.max() < NEAR_HAT:
            steps[-1] += f", in new visits, one at z_hat = {FAR_HAT:g} or more for lift in free air"
        elif steps and visit and visit.z_hat is not None:
            steps.append(f"add visits around z_hat = {plain(visit.z_hat, 2)}")
        done: set[str] = set()
        for experiment in diagnosis.next_experiment[:1] if diagnosis else ():
            # no feasible session distinguishes them; what one acts through may be logged
            effects = dict.fromkeys(" + ".join(experiment.separates).split(" + "))
            wanted = [c for e in effects for c in catalogue.effect(e).log_next_time]
            if columns := self._unlogged(wanted):
                steps.append(f"log {listed(columns)}, to distinguish {_against(experiment)}")
                done |= {*columns}
        if unexplained:
            # an input's error does not explain structure
            where = structure_along(diagnosis)
            more = [f"whatever else changes with {where}"] if where else []
            return _steps(steps + self._logging(more, done))
        detect, columns = self._to_detect
        steps += detect if done.isdisjoint(columns) else []
        if large := [e.title for e in self.unstated if e.in_u > 1]:
            steps.append(f"state the uncertainty of {listed(large)}")
        elif self.headline and not steps:
            # the measurement that would lower its uncertainty most
            lines = {line.source: line for line in self.headline.budget}
            for source in [s for s, _ in leads(self.headline) if lines[s].scope][:1]:
                repeats = lines[source].kind == "A"
                steps.append(
                    f"add trials: {source} dominates" if repeats else f"improve the {source}"
                )
        return _steps(steps + self._logging(done=done.union(columns)))

    @property
    def feasible(self) -> list[NextExperiment]:
        """Experiments that take at most `MOST_REPEATS` times the trials of the campaign."""
        most = MOST_REPEATS * self.evidence.observations[self.boundary].n
        return [
            n
            for n in (self.diagnosis.next_experiment if self.diagnosis else ())
            if not isinstance(n, NextSession) or n.trials_to_separate <= most
        ]

    @property
    def _to_detect(self) -> tuple[list[str], list[str]]:
        """Advice on detecting the least visible effect, and the columns that it needs."""
        hidden = undetected(self.evidence, self.boundary)
        if hidden is None:
            return [], []
        effect, data = catalogue.effect(hidden[1]), self.evidence.observations[self.boundary]
        columns = [n for n in effect.log_next_time if n in BY_NAME]
        if not columns:
            missing = missing_for(effect, data)
            return ([f"to detect {effect.name}: {missing}"] if missing else []), []
        if len(self._unlogged(columns)) < len(columns):
            return [], []
        held = f"the constant-{self.evidence.campaign.rig.held} assumption"
        test = held if effect.name == "held_quantity" else effect.name
        return [f"log {listed(columns)}, to test {test}"], columns

    def _unlogged(self, columns: Sequence[str]) -> list[str]:
        """Columns of the schedule that are not logged, each once."""
        known = self.evidence.observations[self.boundary].covariates
        named = (c for c in dict.fromkeys(columns) if c in BY_NAME)
        return [c for c in named if BY_NAME[c].inside not in known]

    def _logging(self, more: Sequence[str] = (), done: Sequence[str] | set[str] = ()) -> list[str]:
        """Quantities to record next time, without those asked for already, and what that makes
        testable.
        """
        untestable = self.diagnosis.untestable if self.diagnosis else {}
        asked = dict.fromkeys(w for log in untestable.values() for w in log)
        words = [*(w for w in asked if w not in done), *more]
        if not words:
            return []
        text = f"log {listed([w.replace('_', ' ') for w in words])}"
        if len(untestable) > 2:
            return [f"{text}: {len(untestable)} more effects become testable"]
        become = "becomes" if len(untestable) == 1 else "become"
        return [text + (f": {titles([*untestable])} {become} testable" if untestable else "")]


@lru_cache(maxsize=1)
def briefs(evidence: Evidence) -> list[Brief]:
    """Sentences about every boundary."""
    return [Brief(evidence, b) for b in evidence.boundaries]


def doubts(evidence: Evidence) -> dict[str, tuple[Boundary, ...]]:
    """Doubts about the numbers, the most serious first, each with its boundaries: none where it
    concerns the campaign.
    """
    every: dict[str, tuple[Boundary, ...]] = {}
    for brief in briefs(evidence):
        for text in brief.reservations:
            every[text] = (*every.get(text, ()), brief.boundary)
    quality = evidence.table(TRIALS)["quality"] if evidence.has(TRIALS) else np.array([])
    if out := int(rejected(quality).sum()):
        text = f"{out} of {len(quality)} trials were left out. Quality of trials lists them."
        every[text] = ()
    if not components(evidence.campaign):
        text = "The manifest states no uncertainty shared by trials, so no interval includes any."
        every[text] = ()
    return every


def removed(evidence: Evidence) -> str:
    """Trials left out with their reasons, and readings.

    Examples: ``none left out``; ``1 left out: the cell saturated (1); 12 impossible readings in 3
    trials were left out``.
    """
    table = evidence.table(TRIALS)
    out = rejected(table["quality"])
    names = Counter(n for q in table["quality"][out] for n in q.split() if n.isupper())
    why = listed([f"{CODES[n]} ({k})" for n, k in names.most_common(MAX_REASONS)])
    said = f"{int(out.sum()) or 'none'} left out{f': {why}' if why else ''}"
    readings = np.nan_to_num(np.asarray(table.get("n_removed", ()), dtype=float))
    if n := int(readings.sum()):
        trials = counted(int((readings > 0).sum()), "trial")
        were = "were" if n != 1 else "was"
        said += f"; {counted(n, 'impossible reading')} in {trials} {were} left out"
    return said


def power(could: Sensitivity) -> str:
    """Effects that a few trials could have detected."""
    texts = [titled(row.text) for row in could.limits if row.size is not None]
    if not texts:
        return f"{could.trials} trials could not have detected any effect of a possible size"
    chances = f"with {100 * could.chance:.0f} % power each"
    return f"{could.trials} trials could have detected {several(texts, MAX_POWERS)}, {chances}"


def level_curve(fit: LevelFit) -> str:
    """Sentences on the curve of L_inf: its variables, degree and cross-validated error."""
    curve = fit.curve
    words = [along(name.rpartition("_")[0] or name) for name in curve.of]
    errors = ", ".join(f"{100 * e:.2f} % (degree {d})" for d, e in fit.held_out.items())
    return (
        f"log L∞ is a polynomial of degree {curve.degree} in the logarithms of {listed(words)}."
        f" Cross-validated error over visits: {errors}. The table is at the medians."
    )


def rivals_of(diagnosis: BoundaryDiagnosis | None) -> list[str]:
    """Rivals of all identified effects."""
    return [r for e in diagnosis.effects for r in diagnosis.stand_ins(e)] if diagnosis else []


def confused(diagnosis: BoundaryDiagnosis | None) -> str:
    """``fountain length from airframe pressure``; a lone identified effect is ``it``."""
    effects = diagnosis.effects if diagnosis else ()
    name = {e.name: titles([e.name]) if len(effects) > 1 else "it" for e in effects}
    rivals = {e.name: titles(diagnosis.stand_ins(e), "or") for e in effects} if diagnosis else {}
    return listed([f"{name[e]} from {others}" for e, others in rivals.items() if others])


def _is_serious(suspect: Suspect, headline: CoefficientResult | None) -> bool:
    """Whether the headline without it shifts by more than u, or loses half its precision."""
    without = suspect.without
    if headline is None or without is None:
        return True
    return abs(suspect.shift) > headline.u or without.u > 2 * headline.u


def _steps(steps: Sequence[str]) -> str:
    return " ".join(map(sentence, steps))


def _against(experiment: NextExperiment) -> str:
    return " from ".join(experiment.separates).replace(" + ", " with ")


def _proposal(experiment: NextExperiment) -> str:
    """One experiment, with what it distinguishes and in how many trials."""
    if not isinstance(experiment, NextSession):
        return experiment.measure
    about = plain(experiment.trials_to_separate or experiment.trials, 2)
    return f"to distinguish {_against(experiment)}: {experiment.measure} (about {about} trials)"
