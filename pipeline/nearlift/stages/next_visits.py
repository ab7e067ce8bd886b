"""`next`: the visits that a campaign had best make next, for a question of the user's.

Not a stage: it makes no product and writes nothing. It reads trials.parquet, and diagnosis.json
where there is one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary, Effect, FloatArray, LiftModel
from nearlift.errors import InputRefused, NotConverged, UsageError
from nearlift.fit import inputs
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget
from nearlift.likelihood.covariates import derive
from nearlift.likelihood.problem import lift_ratio, usable
from nearlift.loop import next_visits
from nearlift.loop.admission import could_act
from nearlift.loop.candidate_fit import Point, search
from nearlift.loop.coefficients import spread
from nearlift.loop.diagnose import set_up
from nearlift.loop.foresight import Foresight
from nearlift.loop.handle import handles
from nearlift.loop.next_visits import Plan, Question
from nearlift.loop.search_problem import Options, SearchProblem
from nearlift.loop.separation import APART
from nearlift.loop.visibility import SILENT, visibility
from nearlift.nomenclature import letter
from nearlift.randomness import generator
from nearlift.results import Observations
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.next_visits import NextVisit, NextVisits
from nearlift.results.outlook import NextSession
from nearlift.results.quotation import Results
from nearlift.rounding import plain
from nearlift.run import tables
from nearlift.run.engine import Job
from nearlift.stages.asked import AskedQuestion
from nearlift.stages.choices import choice, diagnosed, search_options
from nearlift.stages.fit import RESULTS
from nearlift.stages.ingest import TRIALS
from nearlift.stages.observe import boundaries, observe
from nearlift.stages.traverse import Traverse, traverse

COUNT = 10
#: An effect whose fit lowers chi2 by less is supposed at its plausible size.
FITTED = 9.0
#: A quoted uncertainty so many times that of the noise floor is told.
BEYOND = 1.5


def run(
    job: Job, asked: AskedQuestion, count: int = COUNT
) -> tuple[tuple[NextVisits, ...], tuple[str, ...]]:
    """The next visits at every boundary at which the question can be asked, and why not at others.

    Raises
    ------
    UsageError
        No boundary's base model has the coefficient.
    InputRefused
        No boundary has enough trials, or none has rivals, with the reasons.
    """
    trials = job.read(TRIALS)
    options = search_options(job.campaign, job.seed)
    loop = diagnosed(job.processed)
    present = boundaries(trials)
    if not present:
        raise InputRefused(
            job.campaign.name,
            "no trial was accepted, so there is nothing to plan from",
            "`nearlift design` draws the first schedule; trials.parquet says why none was",
        )
    bases = {boundary: choice(job.campaign, boundary)[0] for boundary in present}
    if asked.coefficient:
        known = {b: [p.name for p in base.parameters] for b, base in bases.items()}
        present = [b for b in present if asked.coefficient in known[b]]
        if not present:
            listed = ", ".join(dict.fromkeys(n for names in known.values() for n in names))
            raise UsageError(
                f"--for {asked.coefficient}",
                "no base model of this campaign has that coefficient",
                f"ask for {listed or 'nothing here'}, separate or drift",
            )
    batches, refused = [], []
    for i, boundary in enumerate(present):
        job.say(f"next visits: {boundary}", i / len(present))
        base, diagnosis = bases[boundary], loop.get(boundary)
        try:
            data = observe(trials, job.campaign, boundary)
            batches.append(_at(job, trials, data, base, diagnosis, asked, count, options))
        except (NotConverged, InputRefused) as fault:
            refused.append((boundary, fault))
    if not batches:
        raise InputRefused(
            job.campaign.name,
            "; ".join(f"{b}: {fault.what}" for b, fault in refused),
            "; ".join(dict.fromkeys(fault.remedy for _, fault in refused)),
        )
    return tuple(batches), tuple(f"{b}: {fault.what}; {fault.remedy}" for b, fault in refused)


def _at(
    job: Job,
    trials: tables.Table,
    data: Observations,
    base: LiftModel,
    loop: BoundaryDiagnosis | None,
    asked: AskedQuestion,
    count: int,
    options: Options,
) -> NextVisits:
    """One boundary."""
    stage, library, notes = _ground(data, base, budget.components(job.campaign), options, loop)
    z_hat = _stations(trials, data.boundary, base)
    question, aim = (
        _coefficient(stage, asked.coefficient, library, loop)
        if asked.coefficient
        else _rivals(stage, asked, library, loop)
    )
    if asked.coefficient:
        notes += _quoted(job, stage, asked.coefficient)
    move = asked.drift or "supply_sag" in aim
    menu = next_visits.menu(stage.data, z_hat, move)
    plan = next_visits.plan(stage, question, menu, asked.rounds)
    if loop is not None and not asked.coefficient:
        # the same two explanations, weighed for sessions at other places too
        notes += [
            f"the diagnosis proposes {n.measure}: expected evidence {plain(n.expected_evidence, 2)}"
            f" in {n.trials} trials"
            for n in loop.next_experiment
            if isinstance(n, NextSession) and n.separates == aim
        ]
    if data.record is not None:
        notes.append("records are cut into trials here: a visit is a record of its own")
    if job.campaign.records.reader == "means":
        notes.append("a table of means: fill in the mean lift of each row before it is read")
    if not data.ordered:
        notes.append("the order of the trials is unknown: what drifts is not planned for")
    along = traverse(trials, stage.data, job.campaign)
    return _document(plan, stage, aim, asked.until, count, notes, along)


def _document(
    plan: Plan,
    stage: SearchProblem,
    aim: tuple[str, ...],
    until: float | None,
    count: int,
    notes: list[str],
    along: Traverse,
) -> NextVisits:
    """The batch, and what is to be said of it."""
    boundary, seed, parts = stage.data.boundary, stage.options.seed, len(aim) > 1
    visits = plan.batch(count, generator(seed, "next visits", boundary, *aim))
    ahead = generator(seed, "visits after the next", boundary, *aim)
    u_wanted = 1 / np.sqrt(APART) if parts else until
    wanted = evenly = None
    end = plan.after(visits)
    if u_wanted is not None and plan.u(plan.now) > u_wanted:
        wanted = plan.until(u_wanted, count, ahead) if plan.least < u_wanted else None
        evenly = plan.evenly(u_wanted)
        end = end if wanted is None else plan.after(wanted)
    as_much = plan.evenly(float(plan.u(end)))
    reached = u_wanted is not None and plan.u(plan.now) <= u_wanted
    known = (lambda u: float(u**-2)) if parts else float
    menu = plan.menu
    visit = menu.trials.throttle.reshape(len(menu), -1)
    z_hat = [float(menu.z_hat[menu.station[v]]) for v in visits]
    sides = generator(seed, "sides", boundary, *aim)
    ways = along.ways(z_hat, float(menu.z_hat[plan.last]), sides)
    return NextVisits(
        boundary=boundary,
        base_model=stage.base.name,
        trials=stage.data.n,
        throttles=menu.throttles,
        aim=aim,
        now=known(plan.u(plan.now)),
        after=known(plan.u(plan.after(visits))),
        wanted=APART if parts else until,
        visits_wanted=0 if reached else None if wanted is None else len(wanted),
        visits_evenly=0 if reached else None if evenly is None else int(np.ceil(evenly)),
        best=known(plan.least),
        sees=(
            float("nan")
            if as_much is None
            else plan.sees(
                end,
                plan.now + as_much * plan.of_round,
                10.0 ** stage.nothing_added[0].threshold,
            )
        ),
        sees_evenly=next_visits.SEEN,
        visits=tuple(
            NextVisit(
                z_hat=z_hat[i],
                distance_m=along.shown_m[z_hat[i]],
                approach=ways[i][0],
                via_m=ways[i][1],
                throttles=tuple(
                    generator(seed, "throttles", boundary, str(i)).permutation(visit[v])
                ),
                supply_V=float(menu.supply_V[v]) if np.isfinite(menu.supply_V[v]) else None,
            )
            for i, v in enumerate(visits)
        ),
        notes=tuple(notes),
    )


def _ground(
    data: Observations,
    base: LiftModel,
    parts: tuple[budget.Component, ...],
    options: Options,
    loop: BoundaryDiagnosis | None,
) -> tuple[SearchProblem, tuple[Effect, ...], list[str]]:
    """What a diagnosis stands on; where trials are too few for one, the fit and its scatter."""
    try:
        stage, library, _ = set_up(data, base, parts, options)
    except NotConverged as few:
        kept = data.take(usable(base, data))
        first = fit(base, kept, parts)
        kept = derive(
            kept,
            kept.lift_inf_N(first.level_coefficients),
            lift_ratio(base, kept, base.named(first.theta)),
        )
        library = could_act(kept, base)[0]
        stage = SearchProblem(
            data=kept,
            base=base,
            effects=tuple(e for e in library if not e.within_trial),
            parts=inputs.acting(parts, base, first.theta),
            noise=first.noise,
            log_lift=np.log(kept.lift_N),
            theta=first.theta,
            options=options,
        )
        note = f"{few.what} for a diagnosis; the noise is the {first.noise.source}"
        return stage, library, [note]
    if loop is not None:
        # beside a large effect the noise is known only after the loop
        stage = dataclasses.replace(stage, noise=loop.noise)
    return stage, library, []


def _coefficient(
    stage: SearchProblem,
    name: str,
    library: tuple[Effect, ...],
    loop: BoundaryDiagnosis | None,
) -> tuple[Question, tuple[str, ...]]:
    """The coefficient beside the effects that the diagnosis names."""
    known = {e.name: e for e in library}
    named = tuple(known[e.name] for e in loop.effects if e.name in known) if loop else ()
    fitted = stage.explain(named).fitted if named else stage.base_fit
    at = [p.name for p in stage.base.parameters].index(name)
    return next_visits.of_coefficient(fitted, at), (name,)


def _quoted(job: Job, stage: SearchProblem, name: str) -> list[str]:
    """A note where results.json quotes much more than the noise floor leaves."""
    results = tables.load_if_whole(job.processed / RESULTS.file, Results(boundaries={}))
    result = results.boundaries.get(stage.data.boundary)
    if result is None or name not in result.coefficients:
        return []
    at = [p.name for p in stage.base.parameters].index(name)
    u, floor = result.coefficients[name].u, spread(stage, stage.base_fit)[1][at]
    if not u > BEYOND * floor:
        return []
    note = (
        f"results.json quotes u({letter(name)}) = {plain(u, 2)}, which rests on more than the"
        " noise floor: few visits, or confounded explanations"
    )
    return [note]


def _rivals(
    stage: SearchProblem,
    asked: AskedQuestion,
    library: tuple[Effect, ...],
    loop: BoundaryDiagnosis | None,
) -> tuple[Question, tuple[str, ...]]:
    """The two explanations as fitted, or at a plausible size where these trials do not show one."""
    where = f"next visits at the {stage.data.boundary}"
    known = {e.name: e for e in library}
    one: tuple[str, ...]
    other: tuple[str, ...]
    if asked.pair:
        one, other = ((name,) for name in asked.pair)
    else:
        listed = (loop.explanations or ()) if loop else ()
        if len(listed) < 2:
            raise InputRefused(
                where,
                "the diagnosis names no two explanations that it cannot distinguish",
                "name them: --for separate=supply_sag,gain_drift",
            )
        one, other = listed[:2]
    for name in (*one, *other):
        if name not in known:
            needs = catalogue.effect(name).log_next_time
            raise InputRefused(
                where,
                f"{name} cannot be tested",
                f"log {', '.join(needs)}, and let it vary"
                if needs
                else "choose an effect that occurs at this boundary",
            )
    question = next_visits.of_rivals(stage, *_points(stage, known, one, other))
    return question, (" + ".join(one), " + ".join(other))


def _points(
    stage: SearchProblem, known: Mapping[str, Effect], one: Sequence[str], other: Sequence[str]
) -> tuple[Point, Point]:
    def fitted(names: Sequence[str], log_lift: FloatArray) -> Point:
        candidate = stage.candidate(*(known[n] for n in names))
        return search(candidate, stage.starts, log_lift).point

    mine = stage.explain(tuple(known[n] for n in one))
    if mine.gain > FITTED or len(one) > 1:
        return mine.fitted.point, fitted(other, stage.log_lift)
    effect = known[one[0]]
    if visibility(stage, effect) <= SILENT:
        raise InputRefused(
            f"next visits at the {stage.data.boundary}",
            f"{effect.name} leaves no mark beside the coefficients and L_inf",
            "another measurement is wanted, not more visits",
        )
    handle = handles(effect)[0]
    vector = Foresight(stage=stage).vector(handle, min(handle.plausible, handle.largest))
    supposed = stage.candidate(effect).log_ratio(vector)
    return ((effect,), vector), fitted(other, supposed)


def _stations(trials: tables.Table, boundary: Boundary, base: LiftModel) -> FloatArray:
    """Every distance that the schedule lists, measured or not, of which the model speaks."""
    z_hat = np.asarray(
        trials["z_hat"][np.isin(trials["boundary"], [boundary, "none"])], dtype=float
    )
    low, high = base.valid_z_hat
    return np.unique(z_hat[(z_hat > low) & ((z_hat <= high) | np.isinf(z_hat))])
