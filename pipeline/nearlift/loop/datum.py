"""Stated zero error of the distance: a parameter of every candidate of a search.

Near a boundary the lift is far from linear in the distance, so a column of the covariance does not
carry it. It is the effect `height_offset` with the stated uncertainty as its prior. It belongs to
no explanation.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from nearlift import catalogue
from nearlift.declare import Effect, LiftModel, Prior
from nearlift.fit import height_error
from nearlift.likelihood.budget import Component
from nearlift.results import Observations

#: Its name, in place of that of the effect.
DATUM = "distance_datum"


def is_datum(part: Component) -> bool:
    """Whether a stated uncertainty is of the distance of all trials."""
    return part.on == "height" and part.standard > 0 and part.scope in ("boundary", "campaign")


def stated_datum(parts: Iterable[Component], model: LiftModel, data: Observations) -> Effect | None:
    """The zero error of the distance as an effect, within bounds that move no trial through the
    boundary; None where no uncertainty is stated.
    """
    stated = [part for part in parts if is_datum(part)]
    if not stated:
        return None
    effect, sd = catalogue.effect("height_offset"), height_error.standard_m(stated)
    (offset,) = effect.parameters
    low, high = offset.bounds
    offset = replace(
        offset,
        prior=Prior(distribution="norm", scale=sd),
        bounds=(max(low, -height_error.room_m(model, data)), high),
    )
    return replace(effect, name=DATUM, parameters=(offset,))
