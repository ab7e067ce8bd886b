"""Whether the answer rests on a single trial.

The closed form says which trial moves the headline most, and the residuals on which ones a name
hangs that is hardly earned; the whole diagnosis made again without it, noise, search and all, says
how far the headline moves and whether anything else would be said. Where that is more than one
standard uncertainty, or another verdict, the answer rests on the trial.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.results.quotation import BoundaryResult, Doubt, RestsOn, Shift, Verdict

#: No trial is left out if the closed form says that none moves the headline by this part of its
#: standard uncertainty.
LOOK = 0.05
#: Left out are so many trials on each of which at least this part of a name's margin hangs.
PART, TRIES = 0.5, 3
#: The median of a squared normal deviate.
MEDIAN = 0.455


@dataclass(frozen=True, slots=True, kw_only=True)
class Without:
    """What a campaign without one trial comes to: `intervals` are value, lo90 and hi90 by
    coefficient.
    """

    verdict: Verdict
    effects: tuple[str, ...]
    intervals: Mapping[str, tuple[float, float, float]]


def tipping(
    margin: float, before: FloatArray, after: FloatArray, trial: NDArray[np.str_], z_hat: FloatArray
) -> tuple[Shift, ...]:
    """The trials on which a name hangs, the foremost first: of their share in its log evidence.

    `margin` is what the evidence exceeds the least by that earns a name; `before` and `after` (n,)
    are the residuals without and with it, `z_hat` (n,) where the trials stood.
    """
    gain = 0.5 * (before**2 - after**2) * MEDIAN / np.median(after**2)
    foremost = np.argsort(-gain)[:TRIES]
    return tuple(
        Shift.at(float(z_hat[i]), str(trial[i]), 0.0) for i in foremost if gain[i] > PART * margin
    )


def told(
    quoted: BoundaryResult, without: Callable[[str], Without], others: Sequence[Shift] = ()
) -> BoundaryResult:
    """The result with the headline's largest shift by a single trial made exact, and where the
    answer rests on that trial, saying so.

    `without` makes the diagnosis again without one trial, by its id; besides the trial of the
    largest influence the `others` are tried.
    """
    name = quoted.headline
    most = quoted.coefficients[name].influence.trial if name else None
    if most is None or not np.isfinite(quoted.coefficients[name].u):
        return quoted
    headline = quoted.coefficients[name]
    tried = [
        (one, again, again.intervals[name][0] - headline.value)
        for one in (*([most] if abs(most.shift) >= LOOK * headline.u else []), *others)
        for again in [without(one.id)]
    ]
    if not tried:
        return quoted
    most, again, shift = max(
        tried,
        key=lambda one: (
            abs(one[2]) > headline.u or one[1].verdict != quoted.verdict,
            abs(one[2]),
        ),
    )
    value, low, high = again.intervals[name]
    influence = replace(headline.influence, trial=replace(most, shift=shift))
    coefficients = {
        **quoted.coefficients,
        name: replace(headline, influence=influence),
    }
    found = replace(quoted, coefficients=coefficients)
    if abs(shift) <= headline.u and again.verdict == quoted.verdict:
        return found
    doubt = Doubt(condition=f"trial {most.id} is left out", value=value, lo90=low, hi90=high)
    rests = RestsOn(trial=most.id, shift=shift, verdict=again.verdict, effects=again.effects)
    return replace(found, rests_on=rests).doubting({name: (doubt,)})
