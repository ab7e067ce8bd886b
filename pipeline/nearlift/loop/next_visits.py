"""Sequential design: the next visits of a campaign for one question, and the information they add.

A question is one unknown: a coefficient, or the weight of one explanation against another. The
inverse variance of that weight is the evidence that discriminates the two (T-optimality). The
trials have an information matrix on the unknown and on its nuisance parameters: log L_inf, other
coefficients, named effects and their forms, stated errors. Every visit adds to it.

A share of each batch visits the stations in rotation, whatever the question. Visits chosen for the
question alone would never reveal that the model is wrong.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood import budget
from nearlift.likelihood.noise import trial_covariance
from nearlift.loop.candidate_fit import Fitted, Point
from nearlift.loop.search_problem import SearchProblem
from nearlift.loop.separation import join, session
from nearlift.results import IntArray, Observations
from nearlift.results.diagnosis import FORM_SD

#: Most stations of a menu; of more distances, these stand for all.
MOST_STATIONS = 20
#: Step of the supply voltage to either side, a fraction of its median.
SUPPLY_STEP = 0.025
#: Longest forecast, visits.
HORIZON = 2000
#: Relative ridge, which keeps information invertible where no trial determines an unknown.
RIDGE = 1e-13


@dataclass(frozen=True, kw_only=True)
class Menu:
    """Visits that could be made: `trials` holds them one after the other, each as in `session`.

    `station` (m,) indexes `z_hat`; `supply_V` (m,) is the voltage to set, nan where it is left as
    it is.
    """

    trials: Observations
    z_hat: FloatArray
    station: IntArray
    supply_V: FloatArray

    def __len__(self) -> int:
        return len(self.station)

    @property
    def throttles(self) -> int:
        """Number of trials per visit."""
        return self.trials.n // len(self)

    def nearest(self, z_hat: FloatArray) -> IntArray:
        """Index of the station nearest to each distance in log z_hat, (n,)."""
        here, there = (np.log(np.minimum(z, 1e9)) for z in (z_hat, self.z_hat))
        return np.asarray(np.argmin(np.abs(here[:, None] - there), axis=1), dtype=np.int64)


def menu(data: Observations, z_hat: FloatArray, move_supply: bool = False) -> Menu:
    """One visit to each of the stations `z_hat`; with `move_supply` two, at a lower and a higher
    supply voltage.
    """
    stations = np.unique(z_hat)
    if len(stations) > MOST_STATIONS:
        # evenly over the ranks, which keeps the density of stations
        stations = stations[np.linspace(0, len(stations) - 1, MOST_STATIONS).round().astype(int)]
    each = 2 if move_supply else 1
    places = tuple(np.repeat(stations, each).tolist())
    one = session(data, places[:1], trials=1)
    trials = session(data, places, trials=one.n * len(places))
    # after all other trials, with every drift at its last value
    late = {
        name: np.full(trials.n, data.covariates[name][-1])
        for name in ("start_s", "elapsed_hat", "elapsed_trials", "run_order")
        if name in data.covariates
    }
    supply = np.full(len(places), np.nan)
    if move_supply:
        usual = float(np.median(data.covariates["supply_V"]))
        supply = usual * (1 + SUPPLY_STEP * np.tile([-1.0, 1.0], len(stations)))
        late["supply_V"] = np.repeat(supply, one.n)
    return Menu(
        trials=dataclasses.replace(trials, covariates={**trials.covariates, **late}),
        z_hat=stations,
        station=np.repeat(np.arange(len(stations)), each),
        supply_V=supply,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """The unknown `target` among q: `columns` gives the derivatives (n, q) of log lift for any
    trials, `held` (q,) the prior precisions.
    """

    columns: Callable[[Observations], FloatArray]
    held: FloatArray
    target: int


def of_coefficient(fitted: Fitted, i: int) -> Question:
    """Question of coefficient i of a fit, with its effects' sizes and forms as nuisances."""
    candidate, vector = fitted.candidate, fitted.vector

    def columns(data: Observations) -> FloatArray:
        there = dataclasses.replace(candidate, data=data)
        return np.hstack([there.jacobian(vector), there.form_discrepancy(vector, FORM_SD)])

    forms = candidate.form_discrepancy(vector, FORM_SD).shape[1]
    return Question(
        columns=columns, held=np.r_[1 / candidate.prior[1] ** 2, np.ones(forms)], target=i
    )


def of_rivals(problem: SearchProblem, one: Point, other: Point) -> Question:
    """Question of the weight of one explanation against another: the first is held fixed, the
    parameters and form of the other are nuisances.
    """
    mine, theirs = problem.candidate(*one[0]), problem.candidate(*other[0])

    def columns(data: Observations) -> FloatArray:
        fixed, free = (dataclasses.replace(c, data=data) for c in (mine, theirs))
        apart = fixed.log_ratio(one[1]) - free.log_ratio(other[1])
        form = free.form_discrepancy(other[1], problem.options.form_sd)
        return np.hstack([np.nan_to_num(apart)[:, None], free.jacobian(other[1]), form])

    forms = columns(problem.data).shape[1] - 1 - theirs.size
    held = np.r_[0.0, 1 / theirs.prior[1] ** 2, np.ones(forms)]
    return Question(columns=columns, held=held, target=0)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Information on a question from the trials so far, and from each visit of a menu.

    Attributes
    ----------
    menu : Menu
    now : (q, q)
        Information of the trials so far on the question's unknowns, L_inf and the stated errors.
    added : (m, q, q)
        Information of each visit of the menu.
    made : (s,) int
        Visits to each station so far.
    last : int
        Station of the last trial.
    rotating : float
        Share of a batch in rotation over the stations; 1 ignores the question.
    """

    menu: Menu
    now: FloatArray
    added: FloatArray
    target: int
    made: IntArray
    last: int
    rotating: float

    def u(self, information: FloatArray) -> FloatArray:
        """Standard uncertainty of the target given information (..., q, q)."""
        size = np.sqrt(np.maximum(np.diagonal(information, axis1=-2, axis2=-1), 1e-300))
        unit = information / (size[..., :, None] * size[..., None, :])
        unit = unit + RIDGE * np.eye(len(self.now))
        aim = np.zeros((len(self.now), 1))
        aim[self.target] = 1.0
        variance = np.linalg.solve(unit, np.broadcast_to(aim, (*unit.shape[:-1], 1)))
        return np.asarray(
            np.sqrt(np.maximum(variance[..., self.target, 0], 0.0)) / size[..., self.target]
        )

    def after(self, visits: IntArray) -> FloatArray:
        """Information once these visits of the menu are made."""
        return np.asarray(self.now + self.added[visits].sum(axis=0), dtype=np.float64)

    def batch(
        self,
        count: int,
        rng: np.random.Generator,
        before: IntArray | None = None,
    ) -> IntArray:
        """The next `count` visits, (count,) indices into the menu, in random order.

        First come those of the rotating share, then those that reduce the target's uncertainty
        most. No station is repeated in succession where that is possible.

        Parameters
        ----------
        before : (k,) int or None
            Visits that will have been made by then.
        """
        before = np.zeros(0, dtype=np.int64) if before is None else before
        here = self.after(before)
        made = self.made + np.bincount(self.menu.station[before], minlength=len(self.made))
        so_far = int(made.sum())
        turn = int(self.rotating * so_far)
        due = int(self.rotating * (so_far + count)) - turn
        chosen = self._round(due, made, turn, rng)
        here = here + self.added[chosen].sum(axis=0)
        # of more than half of a batch at one station, some would have to follow each other
        most = max(count // 2, 1)
        for _ in range(count - len(chosen)):
            often = np.bincount(self.menu.station[chosen], minlength=len(made))
            u = np.where(often[self.menu.station] < most, self.u(here + self.added), np.inf)
            pick = int(np.argmin(u))
            chosen = np.append(chosen, pick)
            here = here + self.added[pick]
        last = int(self.menu.station[before[-1]]) if len(before) else self.last
        return self._apart(rng.permutation(chosen), last)

    def _round(self, count: int, made: IntArray, turn: int, rng: np.random.Generator) -> IntArray:
        """The next `count` visits of the rotation after `turn` others, unvisited stations first."""
        stations = len(made)
        lap = np.random.default_rng(turn // stations).permutation(stations)
        place = np.empty(stations, dtype=np.int64)
        place[lap] = np.arange(stations)
        due = np.lexsort(((place - turn) % stations, made > 0))
        chosen = np.resize(due, count)
        settings = len(self.menu) // stations
        side = rng.permutation(np.resize(np.arange(settings), count))
        return np.asarray(chosen * settings + side, dtype=np.int64)

    def _apart(self, visits: IntArray, last: int) -> IntArray:
        """The visits in an order that repeats no station in succession, from `last` on, where there
        is such an order.
        """
        left, order = visits.tolist(), []
        while left:
            station = self.menu.station[left]
            often = np.bincount(station)
            most = int(np.argmax(often))
            # a station with more than half of the remaining visits must come now
            due = station == most if 2 * often[most] > len(left) else station != last
            pick = int(np.argmax(due & (station != last))) if np.any(station != last) else 0
            last = int(station[pick])
            order.append(left.pop(pick))
        return np.array(order, dtype=np.int64)

    def until(self, u: float, count: int, rng: np.random.Generator) -> IntArray | None:
        """Visits of further batches until the target's standard uncertainty is `u`; None if
        `HORIZON` of them are not enough.
        """
        visits = np.zeros(0, dtype=np.int64)
        while len(visits) < HORIZON:
            if self.u(self.after(visits)) <= u:
                return visits
            for pick in self.batch(count, rng, visits):
                visits = np.append(visits, pick)
                if self.u(self.after(visits)) <= u:
                    return visits
        return None

    @property
    def least(self) -> float:
        """Limit of the target's standard uncertainty for any number of visits."""
        return float(self.u(self.now + 1e9 * self.added.mean(axis=0)))


def plan(problem: SearchProblem, question: Question, offered: Menu, rotating: float) -> Plan:
    """Plan from a problem's trials and the visits on offer; see `Plan` for `rotating`."""
    n, both = problem.data.n, join(problem.data, offered.trials)
    slope = problem.height_slope(both)
    declared = budget.shared(both, problem.linear_parts, slope)
    asked = question.columns(both)
    columns = np.hstack([asked, both.level_design, declared])
    levels, errors = both.level_design.shape[1], declared.shape[1]
    held = np.r_[question.held, np.zeros(levels), np.ones(errors)]
    bare = dataclasses.replace(problem.space.covariance, shared=np.zeros((n, 0)))
    white = bare.whiten(columns[:n].T)
    added = []
    for rows in np.split(np.arange(offered.trials.n), len(offered)):
        visit, at = offered.trials.take(rows), slope[n + rows]
        covariance = trial_covariance(
            visit, problem.noise, at, extra=budget.own_variance(visit, problem.parts, at)
        )
        there = covariance.whiten(columns[n + rows].T)
        added.append(there @ there.T)
    first = np.unique(problem.data.visit, return_index=True)[1]
    station = offered.nearest(problem.data.z_hat)
    return Plan(
        menu=offered,
        now=white @ white.T + np.diag(held),
        added=np.array(added),
        target=question.target,
        made=np.bincount(station[first], minlength=len(offered.z_hat)).astype(np.int64),
        last=int(station[-1]),
        rotating=rotating,
    )
