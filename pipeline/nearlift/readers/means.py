"""Mean lifts without samples, as published: columns `lift`, `lift_sd` and `n` of the schedule."""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.readers.base import Reader
from nearlift.schedule import Schedule


def lift_of(schedule: Schedule) -> dict[str, FloatArray]:
    """`lift_N`, `u_lift_N`, `n` and `sd_N` of every trial.

    `n` is 1 where it is not given. ``u_lift_N = lift_sd / sqrt(n)``, and 0 where no spread is
    given: then only the scatter between trials shows how well they repeat.
    """
    assert schedule.means is not None
    lift = schedule.means["lift_N"]
    sd = schedule.means.get("lift_sd_N", np.full(len(lift), np.nan))
    n = schedule.means.get("n", np.ones(len(lift)))
    n = np.where(np.isfinite(n), n, 1.0)
    return {
        "lift_N": lift,
        "u_lift_N": np.where(np.isfinite(sd), np.abs(sd) / np.sqrt(n), 0.0),
        "n": n,
        "sd_N": sd,
    }


READER = Reader(name="means", title="mean lift per trial in the schedule, no samples")
