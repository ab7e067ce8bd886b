"""Whether the answer rests on a single trial.

The closed form says which trial moves the headline most; the whole diagnosis made again without it,
noise, search and all, says how far it moves and whether anything else would be said. Where that is
more than one standard uncertainty, or another verdict, the answer rests on the trial.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from nearlift.results.quotation import BoundaryResult, Doubt, RestsOn, Verdict

#: No trial is left out if the closed form says that none moves the headline by this part of its
#: standard uncertainty.
LOOK = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Without:
    """What a campaign without one trial comes to: `intervals` are value, lo90 and hi90 by
    coefficient.
    """

    verdict: Verdict
    effects: tuple[str, ...]
    intervals: Mapping[str, tuple[float, float, float]]


def told(quoted: BoundaryResult, without: Callable[[str], Without]) -> BoundaryResult:
    """The result with the headline's largest shift by a single trial made exact, and where the
    answer rests on that trial, saying so.

    `without` makes the diagnosis again without one trial, by its id.
    """
    name = quoted.headline
    most = quoted.coefficients[name].influence.trial if name else None
    if (
        most is None
        or not np.isfinite(quoted.coefficients[name].u)
        or abs(most.shift) < LOOK * quoted.coefficients[name].u
    ):
        return quoted
    again = without(most.id)
    headline = quoted.coefficients[name]
    value, low, high = again.intervals[name]
    shift = value - headline.value
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
