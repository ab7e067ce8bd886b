"""Influence of single trials and visits on the base fit, in numbers and in words."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import replace

import numpy as np

from nearlift.fit import influential
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.likelihood.budget import Component
from nearlift.reduction import outliers
from nearlift.results.fit import Influence, Suspect
from nearlift.rounding import like, plain, plus_minus

#: A standard uncertainty that changes by less than this, in its logarithm, is not worth a word.
ANOTHER_U = 0.2


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
    outlying = {*marked, *data.trial[seen.outlying]} & {*data.trial}
    odd = {str(t) for t in data.trial[np.abs(np.nan_to_num(seen.sigmas)) > outliers.ODD_TRIAL]}
    odd_visits = outliers.odd_visits(left, data.z_hat, throttle, data.visit)
    influence = influential.screen(fitted, parts, outlying, odd, odd_visits)
    return replace(
        influence,
        suspects=tuple(replace(s, text=_said(fitted, influence, s)) for s in influence.suspects),
        unscreened=int(np.isnan(seen.sigmas).sum()),
        why_not=influence.why_not or seen.why_not,
    )


def _said(fitted: LeastSquaresFit, influence: Influence, s: Suspect) -> str:
    """How far the headline moves without a suspect."""
    what = (
        s.id
        if s.kind == "trial"
        else f"visit {s.id} (trials {s.trials[0]} to {s.trials[-1]}, one stop)"
    )
    if s.without is None or not fitted.names:
        return f"{what} is an outlier, and without it the base model does not fit"
    name = fitted.names[0]
    headline = fitted.estimates[name]
    in_u = abs(s.shift) / min(headline.u, s.without.u)
    others = (
        " and the trials named"
        if s.kind == "visit" and any(o.kind == "trial" for o in influence.suspects)
        else ""
    )
    if s.outlying:
        without = f"{what} is an outlier: without it"
    elif s.kind == "visit" or abs(s.shift) > influential.MOVES * min(headline.u, s.without.u):
        without = f"without {what}"
    else:
        without = f"{what} moves {name} together with outliers: without it"
    moved = f"{like(abs(s.shift), s.without.u)} {'higher' if s.shift > 0 else 'lower'}"
    known = (
        f", and its u {plain(s.without.u, 2)} instead of {plain(headline.u, 2)}"
        if abs(math.log(s.without.u / headline.u)) > ANOTHER_U
        else ""
    )
    return f"{without}{others} the base fit’s {name} is {moved}, {plain(in_u, 2)} u{known}"


def notes(boundary: str, entry: Influence) -> Iterable[str]:
    """Notes on them for the console, with the remedy."""
    for suspect in entry.suspects:
        ids = ", ".join(f'"{t}"' for t in suspect.trials)
        yield (f"{boundary}: {suspect.text}; to leave it out, set [quality] exclude = [{ids}]")
    if both := entry.without_all:
        yield (
            f"{boundary}: without all the trials named the base fit has"
            f" {plus_minus(both.value, both.u)}"
        )
    if entry.why_not:
        yield f"{boundary}: trials were not screened: {entry.why_not}"
