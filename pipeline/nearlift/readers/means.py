"""Mean lifts without samples, as published: columns `lift`, `lift_sd` and `n` of the schedule."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.readers.base import Reader
from nearlift.schedule import Schedule


def columns_of(schedule: Schedule, source: str, sha256: str) -> dict[str, NDArray[Any]]:
    """Columns of trials.parquet from a schedule in the file `source`.

    `n` is 1 where it is not given. ``u_lift_N = lift_sd / sqrt(n)``, and 0 where no spread is
    given: then only the scatter between trials shows how well they repeat.
    """
    assert schedule.means is not None
    lift = schedule.means["lift_N"].astype(float)
    sd = schedule.means.get("lift_sd_N", np.full(len(lift), np.nan)).astype(float)
    n = schedule.means.get("n", np.ones(len(lift)))
    n = np.where(np.isfinite(n), n, 1.0)
    return {
        "lift_N": lift,
        "u_lift_N": np.where(np.isfinite(sd), np.abs(sd) / np.sqrt(n), 0.0),
        "n_eff": n,
        "drift_N_s": np.full(len(lift), np.nan),
        "sd_N": sd,
        "n": n.astype(np.int64),
        "n_removed": np.zeros(len(lift), dtype=np.int64),
        "samples": n.astype(np.int64),
        "source_sha256": np.full(len(lift), sha256, dtype=object),
        "source": np.full(len(lift), source, dtype=object),
        "fault": np.full(len(lift), "", dtype=object),
    }


READER = Reader(name="means", title="mean lift per trial in the schedule, no samples")
