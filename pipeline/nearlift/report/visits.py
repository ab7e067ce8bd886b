"""Next visits as text."""

from __future__ import annotations

import math

from nearlift.nomenclature import letter
from nearlift.results.answers import NextVisits
from nearlift.rounding import plain


def text(batch: NextVisits) -> str:
    """Table of the visits, then their gain and stopping point."""
    moved = any(v.supply_V is not None for v in batch.visits)
    table = [
        f"{batch.boundary}, {batch.trials} trials, {batch.base_model}",
        "",
        "visit   distance     z/R" + ("  supply" if moved else "") + "   throttles",
    ]
    for i, v in enumerate(batch.visits):
        free = v.z_hat == float("inf")
        where = f"{'free air':>11}" if free else f"{1e3 * v.distance_m:8.2f} mm"
        supply = f"{v.supply_V:6.2f} V" if v.supply_V is not None else ""
        throttles = " ".join(f"{100 * t:.3g}" for t in v.throttles)
        ratio = "" if free else f"{v.z_hat:.3g}"
        table.append(f"{i + 1:>5}{where}{ratio:>8}{supply}   {throttles} %")
    return "\n".join([*table, "", *lines(batch), *(f"note: {note}" for note in batch.notes)])


def lines(batch: NextVisits) -> list[str]:
    """Gain of the visits, and where to stop."""
    return [_gain(batch), *([stop(batch)] if batch.wanted is not None else [])]


def brief(batch: NextVisits) -> list[str]:
    """The visits in one line, and where to stop, or what they bring."""
    places = ", ".join(
        ("free air" if math.isinf(v.z_hat) else f"{1e3 * v.distance_m:.4g} mm")
        + (f" at {v.supply_V:.2f} V" if v.supply_V is not None else "")
        for v in batch.visits
    )
    outcome = _gain(batch) if batch.wanted is None else stop(batch)
    return [f"next at the {batch.boundary}: {places}", outcome]


def _name(batch: NextVisits) -> str:
    return " and ".join(batch.aim) if batch.parts else f"u({letter(batch.aim[0])})"


def _gain(batch: NextVisits) -> str:
    new = f"{len(batch.visits)} visits ({batch.throttles * len(batch.visits)} trials)"
    now, after = plain(batch.now, 2), plain(batch.after, 2)
    if batch.parts:
        return f"{_name(batch)}: expected evidence {now} now, {after} after these {new}"
    return f"{_name(batch)} = {now} now, about {after} after these {new}"


def stop(batch: NextVisits) -> str:
    """The line that says where to stop."""
    assert batch.wanted is not None
    what = (
        f"{_name(batch)} distinguished (expected evidence {plain(batch.wanted, 2)})"
        if batch.parts
        else f"{_name(batch)} = {plain(batch.wanted, 2)}"
    )
    if batch.visits_wanted == 0:
        return f"{what}: reached"
    if batch.visits_wanted is None:
        why = (
            "the unknown forms of the two"
            if batch.parts
            else "the stated uncertainties that all trials share"
        )
        if _out_of_reach(batch):
            return f"{what}: out of reach of these stations; {why} leave {plain(batch.best, 2)}"
        return f"{what}: not within thousands of visits of these stations"
    more = f"{_trials(batch, batch.visits_wanted)} more trials"
    return f"{what} after about {more}"


def _out_of_reach(batch: NextVisits) -> bool:
    assert batch.wanted is not None
    return batch.best < batch.wanted if batch.parts else batch.best > batch.wanted


def _trials(batch: NextVisits, visits: int) -> str:
    return f"{batch.throttles * visits:,}".replace(",", " ")
