"""Flight logs to rows: each is read once, cut into windows and forgotten; the motors' lag is
estimated over all of them, and the commands behind it become the trials' throttles.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from nearlift import readers
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.manifest.campaign import Campaign
from nearlift.readers import flights
from nearlift.readers.channel import Contents, Malformed
from nearlift.readers.files import source_of
from nearlift.readers.flights import Weighed
from nearlift.readers.row import Row
from nearlift.readers.schedule import Schedule
from nearlift.readers.seam import Reader
from nearlift.readers.segments import Pieces
from nearlift.reduction import motor_lag, quality
from nearlift.reduction.motor_lag import GRID, Lag
from nearlift.reduction.record import Reduced
from nearlift.reduction.stretch import distinct
from nearlift.run.job import Job
from nearlift.stages.rows import Rows, Task, digest_of
from nearlift.stages.segments import CutRecord, answers_of, expanded

#: What a trial's log lift changes by per second of lag: the covariate by which a lag left over, and
#: the estimate's own uncertainty, act.
SLOPE = "lag_slope"
#: A command that acts behind one lag of the grid alone.
UNITS = np.eye(len(GRID))
STEP_S = float(GRID[1] - GRID[0])
#: The power of the command that lift goes with where no flight tells it.
USUAL_POWER = 1.7


def from_records(job: Job, reader: Reader, schedule: Schedule) -> tuple[Schedule, Rows, list[str]]:
    """The schedule of all windows, their rows, and notes.

    Raises
    ------
    InputRefused
        No log is there, most are not as the manifest says (the first one's refusal), or their lag
        cannot be told.
    """
    answers = answers_of(job, reader, schedule, _answer)
    lag, notes = _lag(job.campaign, answers)
    weights = _weights(lag)
    pieces = {r: _behind(a, lag, weights) for r, a in answers.items()}
    trials, rows, unlisted = expanded(job, schedule, answers, pieces)
    counted = _counted(list(answers.values()))
    return trials, rows, [*unlisted, *counted, *notes, *rows.remarks()]


# damaged numbers may be anything
@np.errstate(all="ignore")
def _answer(task: Task, i: int, digests: dict[str, str]) -> CutRecord:
    campaign, record, path = task.campaign, task.piece.trials[i], task.piece.paths[i]
    source = source_of(task.root, path)
    fault = ""
    try:
        reader = readers.reader(campaign.records.reader)
        whole = flights.read(campaign, task.root, reader, path, task.offset_m.get(record))
    except Malformed as damage:
        whole = Contents(channels=(), codes=("MALFORMED",))
        fault = f"{source}: {damage}"
    sha = digest_of(task, source, digests)
    if isinstance(whole, Contents):
        row = Row(
            trial=record,
            reduced=Reduced(codes=whole.codes),
            notes=whole.notes,
            fault=fault,
            source=source,
            source_sha256=sha,
        )
        return CutRecord(record=record, rows=Rows.gathered([row]))
    rows = _reduced(whole)
    rows.columns["source"][:], rows.columns["source_sha256"][:] = source, sha
    rows.notes = dict.fromkeys(whole.notes, (1, source))
    return CutRecord(
        record=record,
        rows=rows,
        pieces=whole.pieces,
        clean=whole.clean,
        command=whole.command,
        stretches=whole.stretches,
        counts=whole.counts,
    )


def _reduced(whole: Weighed) -> Rows:
    """Mean lift of each window, and its standard error from the scatter about a straight line: what
    a vehicle does in a quarter of a second is no noise. What windows share, the noise model finds.
    """
    rows = Rows(len(whole.pieces))
    rows.columns["samples"] = np.diff([*whole.first, len(whole.lift_N)])
    also = tuple(c for c in whole.codes if not quality.code(c).rejects)
    known = np.isfinite(whole.lift_N)
    places = np.flatnonzero(known)
    held = np.add.reduceat(known, whole.first, dtype=np.int64)
    begins = np.cumsum(held) - held
    # windows of as many samples are reduced together
    for n in distinct(held).tolist():
        if n < 3:
            continue
        alike = np.flatnonzero(held == n)
        force = whole.lift_N[places[begins[alike, None] + np.arange(n)]]
        along = np.asarray(np.arange(n) - (n - 1) / 2, dtype=np.float64)
        mean = force.mean(axis=1)
        slope = _dot(force, along) / (along @ along)
        rest = force - mean[:, None] - slope[:, None] * along
        u = np.sqrt(_dot(rest, rest) / (n - 2)) / np.sqrt(n)
        reduced = {
            "lift_N": mean,
            "u_lift_N": u,
            "n_eff": n,
            "drift_N_s": slope / whole.step_s,
            "sd_N": force.std(axis=1, ddof=1),
            "n": n,
        }
        for name, values in reduced.items():
            rows.columns[name][alike] = values
    codes = {code: ((code,) if code else ()) + also for code in {*whole.codes_of}}
    empty = (*also, "NO_DATA")
    rows.codes = [
        codes[code] if code or n >= 3 else empty
        for code, n in zip(whole.codes_of, held.tolist(), strict=True)
    ]
    return rows


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """The products of rows, summed."""
    return np.asarray((a[:, None, :] @ b[..., None])[:, 0, 0])


def _lag(campaign: Campaign, answers: Mapping[str, CutRecord]) -> tuple[Lag, list[str]]:
    """The lag of all logs, given or estimated, and what is said of it."""
    flight = campaign.flight
    assert flight is not None
    given = None if flight.lag == "auto" else flight.lag
    # a log that is there twice has flown once
    apart: dict[str, CutRecord] = {}
    for answer in answers.values():
        apart.setdefault(answer.rows.columns["source_sha256"][0], answer)
    stretches = [s for a in apart.values() for s in a.stretches]
    lag = motor_lag.estimate(stretches, given)
    if lag is None:
        if given is None and any(a.clean.any() for a in answers.values()):
            raise InputRefused(
                "flight.lag",
                f"{len(stretches)} stretches of flight cannot tell the motors' lag",
                'give it, such as lag = "70 ms", or log longer flights',
            )
        # nothing flies: why, the codes say
        return Lag(value_s=given or 0.0, u_s=0.0, power=USUAL_POWER), []
    if given is not None:
        return lag, []
    if lag.at_edge:
        raise InputRefused(
            "flight.lag",
            f"the best lag is {1e3 * lag.value_s:.0f} ms, the end of what is tried: lift does not"
            " follow the command as a motor does",
            'mend [flight] command, or give the lag, such as "70 ms"',
        )
    note = (
        f"the motors' lag is {1e3 * lag.value_s:.1f} ms, standard uncertainty"
        f" {1e3 * lag.u_s:.1f} ms, from {len(stretches)} stretches of flight"
    )
    return lag, [note]


def _weights(lag: Lag) -> FloatArray:
    """What each point of the grid weighs at the lag and a step to either side, (3, T)."""
    places = lag.value_s + STEP_S * np.array([-1.0, 0.0, 1.0])
    return np.stack([np.interp(places, GRID, unit) for unit in UNITS], axis=1)


def _behind(answer: CutRecord, lag: Lag, weights: FloatArray) -> Pieces:
    """The windows with the command behind the lag for a throttle, and log lift's slope by lag."""
    pieces, clean = answer.pieces, answer.clean
    throttle, slope = np.full((2, len(pieces)), np.nan)
    less, throttle[clean], more = (weights @ answer.command[clean][..., None])[..., 0].T
    slope[clean] = lag.power * np.log(more / less) / (2 * STEP_S)
    of_lag = {SLOPE: slope, "u_lag_s": np.where(clean, lag.u_s, np.nan)}
    return replace(
        pieces,
        brought={**pieces.brought, "throttle": throttle},
        covariates={**pieces.covariates, **of_lag},
    )


def _counted(answers: Sequence[CutRecord]) -> list[str]:
    """What was kept and what was not, in one line."""
    total: Counter[str] = sum((a.counts for a in answers), Counter())
    whole = sum(total.values())
    if not whole:
        return []
    kept = sum(int(a.clean.sum()) for a in answers)
    logs = sum(len(a.pieces) > 0 for a in answers)
    lost = ", ".join(f"{code} {100 * n / whole:.3g} %" for code, n in total.most_common() if code)
    return [
        f"{logs} log{'s' * (logs != 1)} cut into {kept} windows, {100 * total[''] / whole:.3g} % of"
        f" the samples" + (f"; left out: {lost}" if lost else "")
    ]
