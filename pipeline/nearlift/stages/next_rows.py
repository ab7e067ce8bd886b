"""The next visits as further rows of a campaign's own schedule."""

from __future__ import annotations

import itertools
import string
from collections.abc import Iterator, Sequence

import numpy as np

from nearlift.results.next_visits import NextVisits
from nearlift.run.engine import Job
from nearlift.schedule import columns_of, csv_text, schedule_file, text_of
from nearlift.stages.design import outside
from nearlift.stages.ingest import TRIALS


def as_schedule(job: Job, batches: Sequence[NextVisits]) -> str:
    """The visits as further rows of the campaign's own schedule, CSV: its columns in its order, and
    a supply where that is moved; blank what is only known once a trial was run.

    Trials are numbered on, in the last session, at times after the last one's where `start` has a
    unit.
    """
    campaign, trials = job.campaign, job.read(TRIALS)
    path = schedule_file(campaign, job.root)
    columns, constants = columns_of(campaign, path, text_of(path)), campaign.trials.constants
    header = [name for name in columns if name not in constants]
    moved = any(v.supply_V is not None for batch in batches for v in batch.visits)
    if moved and "supply" not in header:
        header.append("supply")
    rows: list[list[str]] = []
    ids = _numbered_on(trials["trial"].tolist())
    timed = "start" in campaign.trials.units and "start_s" in trials
    start_s = trials["start_s"] if timed else np.zeros(1)
    spacing = float(np.median(np.diff(start_s))) if len(start_s) > 1 else 0.0
    session = str(trials["session"][-1]) if "session" in trials else ""
    for batch in batches:
        for visit in batch.visits:
            # records that hold several throttles are listed once
            throttles = visit.throttles if "throttle" in header else (np.nan,)
            side = "none" if np.isinf(visit.z_hat) else str(batch.boundary)
            for i, throttle in enumerate(throttles):
                at = float(start_s[-1]) + spacing * (len(rows) + 1)
                cells = {
                    "trial": next(ids),
                    "boundary": side,
                    "distance": outside(campaign, "distance", visit.distance_m),
                    "throttle": outside(campaign, "throttle", throttle),
                    "start": outside(campaign, "start", round(at, 1)) if timed else "",
                    "session": session,
                    "approach": f"{visit.approach:+d}",
                    # driven once, on the way to the visit
                    "via": outside(campaign, "distance", visit.via_m or np.nan) if i == 0 else "",
                    "supply": outside(campaign, "supply", visit.supply_V or np.nan),
                }
                rows.append([cells.get(name, "") for name in header])
    return csv_text(header, rows)


def _numbered_on(known: Sequence[str]) -> Iterator[str]:
    """Ids of trials that go on from the last one that ends in a number, none of them known."""
    counted = [text for text in known if text[-1:] and text[-1] in string.digits]
    last = counted[-1] if counted else "next-0"
    before = last.rstrip(string.digits)
    digits = last.removeprefix(before)
    taken = set(known)
    numbers = (f"{before}{i:0{len(digits)}d}" for i in itertools.count(int(digits) + 1))
    return (text for text in numbers if text not in taken)
