"""Flight logs to rows: each is read once, cut into windows and forgotten; the motors' lag is
estimated over all of them, and the commands behind it become the trials' throttles.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nearlift import readers
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.garbage import uncollected
from nearlift.manifest.campaign import Campaign
from nearlift.readers import flights
from nearlift.readers.channel import Contents, Malformed
from nearlift.readers.expanded import schedule_of_trials
from nearlift.readers.files import source_of
from nearlift.readers.flights import FlightPiece, Weighed
from nearlift.readers.row import Row
from nearlift.readers.schedule import Schedule
from nearlift.readers.seam import Reader
from nearlift.readers.segments import PieceOfRecord
from nearlift.reduction import motor_lag, quality
from nearlift.reduction.motor_lag import GRID, Lag, Moments
from nearlift.reduction.record import Reduced
from nearlift.run.job import Job
from nearlift.stages.rows import Rows, Task, digest_of
from nearlift.stages.segments import Answer, answers_of, each_record, rows_of

#: What a trial's log lift changes by per second of lag: the covariate by which a lag left over, and
#: the estimate's own uncertainty, act.
SLOPE = "lag_slope"
#: A command that acts behind one lag of the grid alone.
UNITS = np.eye(len(GRID))
STEP_S = float(GRID[1] - GRID[0])
#: The power of the command that lift goes with where no flight tells it.
USUAL_POWER = 1.7


@dataclass(frozen=True, slots=True, kw_only=True)
class Flown(Answer):
    """What one worker answers for one log; its pieces are windows of flight, `command` (windows, T)
    is what their rotors were told behind each lag of the grid.
    """

    windows: tuple[FlightPiece, ...] = ()
    command: FloatArray = field(default_factory=lambda: np.empty((0, len(GRID))))
    stretches: tuple[Moments, ...] = ()


def from_records(job: Job, reader: Reader, schedule: Schedule) -> tuple[Schedule, Rows, list[str]]:
    """The schedule of all windows, their rows, and notes.

    Raises
    ------
    InputRefused
        No log is there, most are not as the manifest says (the first one's refusal), or their lag
        cannot be told.
    """
    # windows come by the ten thousand
    with uncollected():
        answers = answers_of(job, reader, schedule, cut_logs)
        lag, notes = _lag(job.campaign, answers)
        weights = _weights(lag)
        pieces = {r: _behind(a, lag, weights) for r, a in answers.items()}
        trials = schedule_of_trials(job.campaign, job.root, pieces)
        rows, unlisted = rows_of(job, schedule, trials, answers, Rows(len(trials)))
        counted = _counted(list(answers.values()))
        return trials, rows, [*unlisted, *counted, *notes, *rows.told()]


def cut_logs(task: Task) -> list[Flown]:
    """Read, weigh and cut the logs of one task; runs in any thread or process.

    Whatever a log holds, it has an answer: what is raised over one makes it MALFORMED.

    Raises
    ------
    NearliftError
        The manifest is at fault.
    OSError, MemoryError
        The machine is at fault.
    """
    return each_record(task, _answer, Flown)


# damaged numbers may be anything
@np.errstate(all="ignore")
def _answer(task: Task, i: int, digests: dict[str, str]) -> Flown:
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
        return Flown(record=record, rows=(row,), counts=Counter())
    rows = tuple(
        Row(
            trial=f"{record}#{piece.number}",
            reduced=reduced,
            samples=piece.end - piece.first,
            notes=whole.notes if piece is whole.pieces[-1] else (),
            source=source,
            source_sha256=sha,
        )
        for piece, reduced in zip(whole.pieces, _reduced(whole), strict=True)
    )
    return Flown(
        record=record,
        rows=rows,
        windows=whole.pieces,
        command=whole.command,
        stretches=whole.stretches,
        counts=whole.counts,
    )


def _reduced(whole: Weighed) -> list[Reduced]:
    """Mean lift of each window, and its standard error from the scatter about a straight line: what
    a vehicle does in a quarter of a second is no noise. What windows share, the noise model finds.
    """
    known = np.isfinite(whole.lift_N)
    also = tuple(c for c in whole.codes if not quality.code(c).rejects)
    codes = [(*piece.codes, *also) for piece in whole.pieces]
    found = [
        Reduced(codes=own if piece.codes else (*own, "NO_DATA"))
        for piece, own in zip(whole.pieces, codes, strict=True)
    ]
    # windows of as many samples are reduced together
    alike: dict[int, list[tuple[int, NDArray[np.intp]]]] = {}
    for k, piece in enumerate(whole.pieces):
        mine = piece.first + np.flatnonzero(known[piece.first : piece.end])
        alike.setdefault(len(mine), []).append((k, mine))
    for n, windows in alike.items():
        if n < 3:
            continue
        force = whole.lift_N[np.array([mine for _, mine in windows])]
        along = np.asarray(np.arange(n) - (n - 1) / 2, dtype=np.float64)
        mean = force.mean(axis=1)
        slope = _dot(force, along) / (along @ along)
        rest = force - mean[:, None] - slope[:, None] * along
        u = np.sqrt(_dot(rest, rest) / (n - 2)) / np.sqrt(n)
        told = np.stack([mean, u, slope / whole.step_s, force.std(axis=1, ddof=1)])
        for (k, _), (lift, u_lift, drift, sd) in zip(windows, told.T.tolist(), strict=True):
            found[k] = Reduced(
                lift_N=lift,
                u_lift_N=u_lift,
                n=n,
                n_eff=float(n),
                drift_N_s=drift,
                sd_N=sd,
                codes=codes[k],
            )
    return found


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """The products of rows, summed."""
    return np.asarray((a[:, None, :] @ b[..., None])[:, 0, 0])


def _lag(campaign: Campaign, answers: Mapping[str, Flown]) -> tuple[Lag, list[str]]:
    """The lag of all logs, given or estimated, and what is said of it."""
    flight = campaign.flight
    assert flight is not None
    given = None if flight.lag == "auto" else flight.lag
    # a log that is there twice has flown once
    apart: dict[str, Flown] = {}
    for answer in answers.values():
        apart.setdefault(answer.rows[0].source_sha256, answer)
    stretches = [s for a in apart.values() for s in a.stretches]
    found = motor_lag.estimate(stretches, given)
    if found is None:
        if given is None and any(not w.codes for a in answers.values() for w in a.windows):
            raise InputRefused(
                "flight.lag",
                f"{len(stretches)} stretches of flight cannot tell the motors' lag",
                'give it, such as lag = "70 ms", or log longer flights',
            )
        # nothing flies: why, the codes say
        return Lag(value_s=given or 0.0, u_s=0.0, power=USUAL_POWER), []
    if given is not None:
        return found, []
    if found.at_edge:
        raise InputRefused(
            "flight.lag",
            f"the best lag is {1e3 * found.value_s:.0f} ms, the end of what is tried: lift does not"
            " follow the command as a motor does",
            'mend [flight] command, or give the lag, such as "70 ms"',
        )
    note = (
        f"the motors' lag is {1e3 * found.value_s:.1f} ms, standard uncertainty"
        f" {1e3 * found.u_s:.1f} ms, from {len(stretches)} stretches of flight"
    )
    return found, [note]


def _weights(lag: Lag) -> FloatArray:
    """What each point of the grid weighs at the lag and a step to either side, (3, T)."""
    places = lag.value_s + STEP_S * np.array([-1.0, 0.0, 1.0])
    return np.stack([np.interp(places, GRID, unit) for unit in UNITS], axis=1)


def _behind(answer: Flown, lag: Lag, weights: FloatArray) -> tuple[PieceOfRecord, ...]:
    """The windows with the command behind the lag for a throttle, and what log lift changes by
    were the lag another.
    """
    clean = [window for window in answer.windows if not window.codes]
    flown = np.array([not window.codes for window in answer.windows], dtype=bool)
    less, at, more = (weights @ answer.command[flown][..., None])[..., 0].T
    slopes = lag.power * np.log(more / less) / (2 * STEP_S)
    behind = {
        window.number: PieceOfRecord(
            number=window.number,
            since_s=window.since_s,
            brought={**window.brought, "throttle": throttle},
            covariates={
                **window.covariates,
                SLOPE: (slope, np.nan),
                "u_lag_s": (lag.u_s, np.nan),
            },
        )
        for window, throttle, slope in zip(clean, at.tolist(), slopes.tolist(), strict=True)
    }
    return tuple(behind.get(window.number, window) for window in answer.windows)


def _counted(answers: Sequence[Flown]) -> list[str]:
    """What was kept and what was not, in one line."""
    total: Counter[str] = sum((a.counts for a in answers), Counter())
    whole = sum(total.values())
    if not whole:
        return []
    kept = sum(not window.codes for a in answers for window in a.windows)
    logs = sum(bool(a.windows) for a in answers)
    lost = ", ".join(f"{code} {100 * n / whole:.3g} %" for code, n in total.most_common() if code)
    return [
        f"{logs} log{'s' * (logs != 1)} cut into {kept} windows, {100 * total[''] / whole:.3g} % of"
        f" the samples" + (f"; left out: {lost}" if lost else "")
    ]
