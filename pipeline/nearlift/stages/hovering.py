"""Flights of each declared condition held against sound ones, by what hover asks of the motors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import InputRefused
from nearlift.fit import hover
from nearlift.manifest.campaign import Campaign
from nearlift.readers.schedule import CONDITION
from nearlift.reduction.quality import rejected
from nearlift.results.hover import HoverComparison
from nearlift.run.store import Table

#: Hover: so slow, m/s, and so far from the boundary, in rotor radii, that lift is the weight.
SLOW_M_S, FAR = 0.1, 8.0
#: Windows that a start's mean rests on.
FEWEST = 5


def compared(campaign: Campaign, trials: Table, boundary: Boundary) -> list[HoverComparison]:
    """Every other condition against the sound one, and each sound log against the other sound ones;
    none where `[flight] sound` is not given.

    Raises
    ------
    InputRefused
        The schedule has no such condition, or too few sound logs hover.
    """
    assert campaign.flight is not None
    sound = campaign.flight.sound
    if sound is None:
        return []
    if CONDITION not in trials:
        raise InputRefused(
            campaign.trials.file,
            f"has no column {CONDITION!r}, and flight.sound = {sound!r} is one of them",
            "say of every log what was changed before it flew",
        )
    voltages, conditions = means(trials, boundary)
    rate = campaign.diagnose.false_alarm_rate
    groups = {
        c: tuple(r for r in voltages if conditions[r] == c)
        for c in dict.fromkeys(conditions.values())
    }
    healthy = groups.pop(sound, ())
    if len(healthy) <= hover.FEWEST_SOUND:
        raise InputRefused(
            "flight.sound",
            f"{len(healthy)} logs whose {CONDITION} is {sound!r} hover far from the {boundary}",
            f"more than {hover.FEWEST_SOUND} tell what sound flights differ by: fly more",
        )
    pairs = [(c, logs, healthy) for c, logs in groups.items()]
    pairs += [(sound, (r,), tuple(q for q in healthy if q != r)) for r in healthy]
    comparisons = []
    for condition, logs, reference in pairs:
        each, other = (np.array([voltages[r] for r in group]) for group in (logs, reference))
        shifts = hover.shifts(each, other, rate)
        comparisons.append(HoverComparison.compared(condition, logs, len(reference), shifts))
    return comparisons


def means(trials: Table, boundary: Boundary) -> tuple[dict[str, FloatArray], dict[str, str]]:
    """Log voltages (starts, rotors) that hover takes, by log; and each log's condition."""
    hovers: NDArray[np.bool_] = (
        (trials["boundary"] == boundary)
        & ~rejected(trials["quality"])
        & (np.abs(trials["climb_m_s"]) < SLOW_M_S)
        & (trials["z_hat"] > FAR)
    )
    shares = [trials[n] for n in sorted(trials) if n.startswith("command_share_")]
    volts = np.log(trials["throttle"] * trials.get("supply_V", 1.0)) + np.log(
        np.array(shares or [np.ones(len(hovers))])
    )
    starts = int(trials["flight"][hovers].max(initial=0))
    voltages: dict[str, FloatArray] = {}
    conditions: dict[str, str] = {}
    for record in dict.fromkeys(trials["record"][hovers]):
        mine = hovers & (trials["record"] == record)
        means = np.full((starts, len(volts)), np.nan)
        for start in range(starts):
            here = mine & (trials["flight"] == start + 1)
            if here.sum() >= FEWEST:
                means[start] = volts[:, here].mean(axis=1)
        if np.isfinite(means).any():
            voltages[record] = means
            conditions[record] = str(trials[CONDITION][mine][0])
    return voltages, conditions
