"""Influence of single trials and visits on the headline coefficient, and its value without them.

The closed form (`fit.deletion`) selects candidates; a fit without the trial, scatter included,
decides. Outliers inflate the scatter that they are judged by, and two can mask each other. The
search therefore goes forward: an outlier is left out, and the rest is examined again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import BoolArray, FloatArray
from nearlift.errors import NotConverged
from nearlift.fit import deletion
from nearlift.fit.least_squares import LeastSquaresFit, fit
from nearlift.likelihood.budget import Component
from nearlift.reduction import outliers
from nearlift.results import Estimate
from nearlift.results.fit import Influence, Suspect
from nearlift.rounding import like, plain, plus_minus

#: Median relative variance up to which trials repeat exactly: just above the variance floor,
#: `likelihood.covariance.LEAST_VARIANCE`.
EXACT_VARIANCE = 1.1e-12
#: Shift of the headline in closed form, in its standard uncertainties, from which the fit is
#: repeated without a trial; and without a visit that is an outlier as a whole. Ours: `NAMED_SHIFT`
#: less a margin, since the closed form holds the scatter that an outlier inflates.
TRIED_SHIFT, TRIED_SHIFT_ODD = 0.6, 0.25
#: Shift of the headline between fits, in its standard uncertainties, from which a trial is named.
#: Below one, since leaving out a glitch shifts it by less than the glitch did: the information of
#: the trial is lost too (docs/decisions.md#outliers).
NAMED_SHIFT = 0.8
#: Maximum number of trials named, and of fits for each name. Ours: they bound the time; a campaign
#: with more outliers has another fault.
MAX_NAMED, MAX_FITS = 10, 4


def screen(
    fitted: LeastSquaresFit, parts: tuple[Component, ...], marked: Collection[str] = ()
) -> Influence:
    """Outlying or influential trials and visits of one boundary; `marked` trials were outlying
    before there was a curve.
    """
    problem, data = fitted.problem, fitted.problem.data
    left = np.log(data.lift_N) - problem.log_ratio(fitted.theta)
    # trials without repeats could not be compared before there was a curve
    throttle = data.throttle
    if data.curve is not None:
        left, throttle = left - data.of_trials(fitted.level_coefficients), data.levels[data.level]
    seen = outliers.screen(left, data.z_hat, throttle, data.visit, curve_removed=True)
    influence = search(
        fitted,
        parts,
        {*marked, *data.trial[seen.outlying]},
        data.trial[np.abs(np.nan_to_num(seen.sigmas)) > outliers.ODD_TRIAL],
        outliers.odd_visits(left, data.z_hat, throttle, data.visit),
    )
    return replace(influence, why_not=influence.why_not or seen.why_not)


def search(
    whole: LeastSquaresFit,
    parts: tuple[Component, ...],
    outlying: Collection[str] = (),
    odd: Collection[str] | NDArray[np.object_] = (),
    odd_visits: Collection[int] | NDArray[np.int64] = (),
) -> Influence:
    """Name the outlying trials, and the trials and visits that move the headline by `NAMED_SHIFT`.

    Parameters
    ----------
    whole : LeastSquaresFit
        To all accepted trials; they all stay in it.
    parts : tuple of Component
        The whole budget.
    outlying : collection of str
        Trials that repeats and neighbours contradict (`reduction.outliers`).
    odd : collection of str
        Trials far from the rest, though no farther than noise allows. They may mask each other, so
        they are also left out together.
    odd_visits : collection of int
        Visits far from the rest: since few visits determine the scatter of visits, the closed form
        understates their influence.

    Returns
    -------
    Influence
        No fit is made where none of these is an outlier and none is near the limit.
    """
    data, trials = whole.problem.data, np.arange(whole.problem.data.n)
    if not whole.names:
        return Influence(why_not=f"{whole.model.name} has no free coefficient")
    if np.median(whole.problem.covariance.variance) <= EXACT_VARIANCE:
        why = "the trials repeat exactly, so nothing shows how far noise may move a coefficient"
        return Influence(why_not=why)

    @cache
    def refitted(out: bytes) -> LeastSquaresFit | None:
        try:
            return fit(whole.model, data.take(~np.frombuffer(out, dtype=bool)), parts)
        except NotConverged:
            return None

    def without(out: BoolArray) -> LeastSquaresFit | None:
        """The model fitted without the trials `out`, scatter included; None where that fails."""
        return refitted(out.tobytes()) if out.any() else whole

    out = np.isin(data.trial, list(outlying))
    clean = without(out) or whole
    out |= _masked(without, clean, out, np.isin(data.trial, list(odd)) & ~out)
    clean = without(out) or clean
    named = np.flatnonzero(out).tolist()
    while len(named) < MAX_NAMED:
        kept, moved = np.flatnonzero(~out), deletion.influence(clean)
        far = kept[_far(moved.of_trial[:, 0], moved.residual**2, clean)]
        moving = (i for i in far if _moves(clean, without(out | (trials == i))))
        if (i := next(moving, None)) is None:
            break
        out[i] = True
        clean = without(out) or clean
        named.append(int(i))
    suspects = []
    for i in named[:MAX_NAMED]:
        name, again = str(data.trial[i]), without(trials == i)
        verdict = f"{name} is an outlier: without it" if name in outlying else f"without {name}"
        suspects.append(_suspect("trial", name, (name,), name in outlying, verdict, whole, again))
    moved = deletion.influence(clean)
    look = np.where(np.isin(moved.visit, list(odd_visits)), TRIED_SHIFT_ODD, TRIED_SHIFT)
    for j in _far(moved.of_visit[:, 0], moved.chi2, clean, look):
        members = (data.visit == moved.visit[j]) & ~out
        again = without(members | out) if members.sum() > 1 else None
        if _moves(clean, again):
            name, ids = str(moved.visit[j]), tuple(str(t) for t in data.trial[members])
            verdict = f"without visit {name} (trials {ids[0]} to {ids[-1]}, one stop)"
            verdict += " and the trials named" if out.any() else ""
            suspects.append(_suspect("visit", name, ids, False, verdict, clean, again))
    return Influence(
        suspects=tuple(suspects), without_all=_headline(clean) if len(named) > 1 else None
    )


def _masked(
    without: Callable[[BoolArray], LeastSquaresFit | None],
    clean: LeastSquaresFit,
    out: BoolArray,
    odd: BoolArray,
) -> BoolArray:
    """Odd trials that shift the headline by `NAMED_SHIFT` with the other odd ones left out; all of
    them, if only all do.
    """
    single = np.zeros_like(odd)
    base = without(out | odd)
    if base is None or not _moves(clean, base):
        return single
    for i in np.flatnonzero(odd)[:MAX_NAMED]:
        again = without((out | odd) & (np.arange(len(odd)) != i))
        single[i] = again is None or _moves(base, again)
    return single if single.any() else odd


def _suspect(
    kind: Literal["trial", "visit"],
    name: str,
    trials: tuple[str, ...],
    outlying: bool,
    verdict: str,
    reference: LeastSquaresFit,
    again: LeastSquaresFit | None,
) -> Suspect:
    """A trial or visit, with the headline of the fit `again` without it, and its shift."""
    without, shift, text = None, float("nan"), f"{verdict} the base model does not fit"
    if again:
        without, headline = _headline(again), _headline(reference)
        shift = without.value - headline.value
        text = (
            f"{verdict} the base fit’s {again.names[0]} is {like(abs(shift), without.u)}"
            f" {'higher' if shift > 0 else 'lower'},"
            f" {plain(abs(shift) / min(headline.u, without.u), 2)} u"
        )
    return Suspect(
        kind=kind,
        id=name,
        trials=trials,
        outlying=outlying,
        without=without,
        shift=shift,
        text=text,
    )


def _headline(fitted: LeastSquaresFit) -> Estimate:
    return fitted.estimates[fitted.names[0]]


def _far(
    shift: FloatArray,
    chi2: FloatArray,
    clean: LeastSquaresFit,
    look: FloatArray | float = TRIED_SHIFT,
) -> list[int]:
    """The few largest shifts of the headline that deserve a fit, the largest first.

    An outlier inflates the scatter and with it the uncertainty that its shift is compared with; its
    share of chi2 corrects for that.
    """
    narrower = np.sqrt(np.clip(1 - chi2 / max(clean.chi2, clean.dof), 0.0, 1.0))
    ratio = np.abs(shift) / (look * _headline(clean).u * np.maximum(narrower, 1e-3))
    order = np.argsort(-np.nan_to_num(ratio), kind="stable")[:MAX_FITS]
    return [int(i) for i in order if ratio[i] > 1]


def _moves(clean: LeastSquaresFit, again: LeastSquaresFit | None) -> bool:
    """Whether the headlines differ by more than `NAMED_SHIFT` of the smaller u."""
    if again is None:
        return False
    u = min(_headline(clean).u, _headline(again).u)
    return bool(abs(again.theta[0] - clean.theta[0]) > NAMED_SHIFT * u)


def notes(boundary: str, entry: Influence) -> Iterable[str]:
    """Notes on them for the console, with the remedy."""
    for suspect in entry.suspects:
        ids = ", ".join(f'"{t}"' for t in suspect.trials)
        yield f"{boundary}: {suspect.text}; to leave it out, set [quality] exclude = [{ids}]"
    if both := entry.without_all:
        value = plus_minus(both.value, both.u)
        yield f"{boundary}: without all the trials named the base fit has {value}"
    if entry.why_not:
        yield f"{boundary}: trials were not screened: {entry.why_not}"
