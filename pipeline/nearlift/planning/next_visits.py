"""Next visits of a campaign, for a question of the user."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from nearlift import catalogue
from nearlift.campaign.manifest import Campaign
from nearlift.declare import Boundary, Effect, FloatArray
from nearlift.errors import InputRefused, NotConverged, UsageError
from nearlift.loop import next_visits
from nearlift.loop.candidate_fit import Point, search
from nearlift.loop.coefficients import spread
from nearlift.loop.next_visits import Plan
from nearlift.loop.next_visits import Question as Aim
from nearlift.loop.power import DesignPower, size_parameters
from nearlift.loop.search_problem import SILENT, SearchProblem
from nearlift.loop.separation import SEPARATED
from nearlift.nomenclature import letter
from nearlift.observed import Trials, boundaries, choice
from nearlift.planning.forecast import Forecast, of_trials
from nearlift.planning.question import VisitQuestion
from nearlift.randomness import generator
from nearlift.results.answers import NextVisit, NextVisits
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.outlook import NextSession
from nearlift.results.quotation import BoundaryResult, Results
from nearlift.rounding import plain

COUNT = 10
#: Fall of chi2 below which an effect is assumed at its plausible size.
MIN_GAIN = 9.0
#: A note says so where the quoted uncertainty is this many times that of the noise floor.
NOTED_RATIO = 1.5


def plan_visits(
    asked: VisitQuestion,
    trials: Trials,
    campaign: Campaign,
    diagnoses: Mapping[Boundary, BoundaryDiagnosis],
    quoted: Results,
    seed: int,
    count: int = COUNT,
) -> tuple[tuple[NextVisits, ...], tuple[str, ...]]:
    """Next visits at every boundary where the question can be asked; reasons for the others.

    Raises
    ------
    UsageError
        No boundary's base model has the coefficient.
    InputRefused
        No boundary has enough trials, or none has rivals, with the reasons.
    """
    present = boundaries(trials)
    if not present:
        raise InputRefused(
            campaign.name,
            "no trial was accepted, so there is nothing to plan from",
            "`nearlift design` draws the first schedule; trials.parquet says why none was",
        )
    if asked.coefficient:
        known = {b: [p.name for p in choice(campaign, b)[0].parameters] for b in present}
        present = [b for b in present if asked.coefficient in known[b]]
        if not present:
            listed = ", ".join(dict.fromkeys(n for names in known.values() for n in names))
            raise UsageError(
                f"--for {asked.coefficient}",
                "no base model of this campaign has that coefficient",
                f"ask for {listed or 'nothing here'}, or separate",
            )
    batches, refused = [], []
    for boundary in present:
        diagnosis = diagnoses.get(boundary)
        try:
            forecast = of_trials(trials, campaign, boundary, diagnosis, seed, few=True)
            question, aim = _aim(forecast, asked, diagnosis)
            notes = (
                *forecast.notes,
                *_notes(forecast, campaign, asked, aim, diagnosis, quoted.boundaries.get(boundary)),
            )
            # every scheduled distance by z_hat, measured or not, as the traverse shows it
            mine = np.isin(trials["boundary"], [boundary, "none"])
            shown_m = trials["z_m"][mine] - campaign.distance_reference(boundary).offset_m
            shown = dict(zip(trials["z_hat"][mine].tolist(), shown_m.tolist(), strict=True))
            low, high = forecast.problem.base.valid_z_hat
            stations = np.array([z for z in shown if low < z <= high or np.isinf(z)])
            menu = next_visits.menu(forecast.problem.data, stations, "supply_sag" in aim)
            plan = next_visits.plan(forecast.problem, question, menu, asked.rounds)
            batches.append(_batch(plan, forecast.problem, aim, asked.until, count, notes, shown))
        except (NotConverged, InputRefused) as fault:
            refused.append((boundary, fault))
    if not batches:
        raise InputRefused(
            campaign.name,
            "; ".join(f"{b}: {fault.what}" for b, fault in refused),
            "; ".join(dict.fromkeys(fault.remedy for _, fault in refused)),
        )
    return tuple(batches), tuple(f"{b}: {fault.what}; {fault.remedy}" for b, fault in refused)


def _notes(
    forecast: Forecast,
    campaign: Campaign,
    asked: VisitQuestion,
    aim: tuple[str, ...],
    diagnosis: BoundaryDiagnosis | None,
    quoted: BoundaryResult | None,
) -> Iterator[str]:
    """Remarks on the aim, and on a campaign whose schedule is not an ordinary one."""
    problem, data = forecast.problem, forecast.problem.data
    if asked.coefficient and quoted and asked.coefficient in quoted.coefficients:
        at = [p.name for p in problem.base.parameters].index(asked.coefficient)
        u, floor = quoted.coefficients[asked.coefficient].u, spread(problem, problem.base_fit)[1]
        if u > NOTED_RATIO * floor[at]:
            yield (
                f"results.json quotes u({letter(asked.coefficient)}) = {plain(u, 2)}, which depends"
                " on more than the noise floor: few visits, or confounded explanations"
            )
    if diagnosis and not asked.coefficient:
        # the same two explanations, for sessions at other places too
        for n in diagnosis.next_experiment:
            if isinstance(n, NextSession) and n.separates == aim:
                yield (
                    f"the diagnosis proposes {n.measure}: expected evidence"
                    f" {plain(n.expected_evidence, 2)} in {n.trials} trials"
                )
    if data.record is not None:
        yield "records are cut into trials here: a visit is a record of its own"
    if campaign.records.reader == "means":
        yield "a table of means: fill in the mean lift of each row before it is read"
    if not data.ordered:
        yield "the order of the trials is unknown: what drifts is not planned for"


def _batch(
    plan: Plan,
    problem: SearchProblem,
    aim: tuple[str, ...],
    until: float | None,
    count: int,
    notes: tuple[str, ...],
    shown_m: Mapping[float, float],
) -> NextVisits:
    """Batch of visits and its gain."""
    boundary, seed, parts = problem.data.boundary, problem.options.seed, len(aim) > 1
    visits = plan.batch(count, generator(seed, "next visits", boundary, *aim))
    u_wanted, u_now = 1 / np.sqrt(SEPARATED) if parts else until, plan.u(plan.now)
    more: int | None = None
    if u_wanted is not None and u_now <= u_wanted:
        more = 0
    elif u_wanted is not None and plan.least < u_wanted:
        ahead = generator(seed, "visits after the next", boundary, *aim)
        wanted = plan.until(u_wanted, count, ahead)
        more = None if wanted is None else len(wanted)
    menu = plan.menu
    throttles = menu.trials.throttle.reshape(len(menu), -1)
    z_hat = menu.z_hat[menu.station[visits]].tolist()
    places = [shown_m[z] for z in (float(menu.z_hat[plan.last]), *z_hat)]
    known = (lambda u: float(u**-2)) if parts else float
    return NextVisits(
        boundary=boundary,
        base_model=problem.base.name,
        trials=problem.data.n,
        throttles=menu.throttles,
        aim=aim,
        now=known(u_now),
        after=known(plan.u(plan.after(visits))),
        wanted=SEPARATED if parts else until,
        visits_wanted=more,
        best=known(plan.least),
        visits=tuple(
            NextVisit(
                z_hat=z,
                distance_m=place,
                approach=1 if place > before else -1,
                throttles=tuple(
                    generator(seed, "throttles", boundary, str(i)).permutation(throttles[v])
                ),
                supply_V=float(menu.supply_V[v]) if np.isfinite(menu.supply_V[v]) else None,
            )
            for i, (v, z, before, place) in enumerate(
                zip(visits.tolist(), z_hat, places, places[1:], strict=False)
            )
        ),
        notes=notes,
    )


def _aim(
    forecast: Forecast, asked: VisitQuestion, diagnosis: BoundaryDiagnosis | None
) -> tuple[Aim, tuple[str, ...]]:
    """Aim at the coefficient, with the effects that the diagnosis names in the model; or at two
    explanations as fitted.

    Where the trials show none, the first has its plausible size.
    """
    problem, known = forecast.problem, {e.name: e for e in forecast.effects}
    where = f"next visits at the {problem.data.boundary}"
    if asked.coefficient:
        identified = diagnosis.effects if diagnosis else ()
        named = tuple(known[e.name] for e in identified if e.name in known)
        fitted = problem.explain(named).fitted if named else problem.base_fit
        at = [p.name for p in problem.base.parameters].index(asked.coefficient)
        return next_visits.of_coefficient(fitted, at), (asked.coefficient,)
    rivals = [(name,) for name in asked.pair] or (diagnosis and diagnosis.explanations) or ()
    if len(rivals) < 2:
        raise InputRefused(
            where,
            "the diagnosis names no two explanations that it cannot distinguish",
            "name them: --for separate=supply_sag,gain_drift",
        )
    one, other = rivals[:2]
    for name in (*one, *other):
        if name not in known:
            needs = catalogue.effect(name).log_next_time
            remedy = "choose an effect that occurs at this boundary"
            if needs:
                remedy = f"log {', '.join(needs)}, and let it vary"
            raise InputRefused(where, f"{name} cannot be tested", remedy)
    question = next_visits.of_rivals(problem, *_points(problem, known, one, other))
    return question, (" + ".join(one), " + ".join(other))


def _points(
    problem: SearchProblem, known: Mapping[str, Effect], one: Sequence[str], other: Sequence[str]
) -> tuple[Point, Point]:
    def fitted(log_lift: FloatArray) -> Point:
        candidate = problem.candidate(*(known[n] for n in other))
        return search(candidate, problem.starts, log_lift).point

    mine = problem.explain(tuple(known[n] for n in one))
    if mine.gain > MIN_GAIN or len(one) > 1:
        return mine.fitted.point, fitted(problem.log_lift)
    effect = known[one[0]]
    if problem.visibility(effect) <= SILENT:
        raise InputRefused(
            f"next visits at the {problem.data.boundary}",
            f"{effect.name} is absorbed by the coefficients and L_inf",
            "make another measurement; more visits do not help",
        )
    size = size_parameters(effect)[0]
    vector = DesignPower(problem=problem).vector(size, min(size.plausible, size.largest))
    return ((effect,), vector), fitted(problem.candidate(effect).log_ratio(vector))
