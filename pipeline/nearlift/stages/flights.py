"""Flight logs to rows: each is read once, cut into windows and forgotten; the motors' lag is
estimated over all of them, and the commands behind it become the trials' throttles.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearlift import readers
from nearlift.errors import InputRefused
from nearlift.manifest.campaign import Campaign
from nearlift.readers import flights
from nearlift.readers.channel import Contents, Malformed
from nearlift.readers.expanded import schedule_of_trials
from nearlift.readers.files import source_of
from nearlift.readers.flights import FlightPiece
from nearlift.readers.row import Row
from nearlift.readers.schedule import Schedule
from nearlift.readers.seam import Reader
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
#: The power of the command that lift goes with where no flight tells it.
USUAL_POWER = 1.7


@dataclass(frozen=True, slots=True, kw_only=True)
class Flown(Answer):
    """What one worker answers for one log; its pieces are windows of flight."""

    windows: tuple[FlightPiece, ...] = ()
    stretches: tuple[Moments, ...] = ()


def from_records(job: Job, reader: Reader, schedule: Schedule) -> tuple[Schedule, Rows, list[str]]:
    """The schedule of all windows, their rows, and notes.

    Raises
    ------
    InputRefused
        No log is there, most are not as the manifest says (the first one's refusal), or their lag
        cannot be told.
    """
    answers = answers_of(job, reader, schedule, cut_logs)
    lag, notes = _lag(job.campaign, answers)
    pieces = {r: _behind(a.windows, lag) for r, a in answers.items()}
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
            reduced=_reduced(piece, whole.step_s, whole.codes),
            samples=len(piece.force_N),
            notes=whole.notes if piece is whole.pieces[-1] else (),
            source=source,
            source_sha256=sha,
        )
        for piece in whole.pieces
    )
    bare = tuple(replace(p, force_N=np.empty(0)) for p in whole.pieces)
    return Flown(
        record=record,
        rows=rows,
        windows=bare,
        stretches=whole.stretches,
        counts=whole.counts,
    )


def _reduced(piece: FlightPiece, step_s: float, codes: tuple[str, ...]) -> Reduced:
    """Mean lift of a window, and its standard error from the scatter about a straight line: what a
    vehicle does in a quarter of a second is no noise. What windows share, the noise model finds.
    """
    force = piece.force_N[np.isfinite(piece.force_N)]
    n = len(force)
    codes = (*piece.codes, *(c for c in codes if not quality.code(c).rejects))
    if n < 3:
        return Reduced(codes=codes if piece.codes else (*codes, "NO_DATA"))
    along = np.arange(n) - (n - 1) / 2
    slope = float(along @ force / (along @ along))
    rest = force - force.mean() - slope * along
    sd = float(np.sqrt(rest @ rest / (n - 2)))
    return Reduced(
        lift_N=float(force.mean()),
        u_lift_N=sd / np.sqrt(n),
        n=n,
        n_eff=float(n),
        drift_N_s=slope / step_s,
        sd_N=float(force.std(ddof=1)),
        codes=codes,
    )


def _lag(campaign: Campaign, answers: Mapping[str, Flown]) -> tuple[Lag, list[str]]:
    """The lag of all logs, given or estimated, and what is said of it."""
    flight = campaign.flight
    assert flight is not None
    given = None if flight.lag == "auto" else flight.lag
    stretches = [s for a in answers.values() for s in a.stretches]
    found = motor_lag.estimate(stretches, given)
    if found is None:
        if given is None and any(not r.reduced.codes for a in answers.values() for r in a.rows):
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


def _behind(windows: Sequence[FlightPiece], lag: Lag) -> tuple[FlightPiece, ...]:
    """The windows with the command behind the lag for a throttle, and what log lift changes by
    were the lag another.
    """
    step = float(GRID[1] - GRID[0])
    # what each point of the grid weighs at the lag and a step to either side
    weights = np.array(
        [np.interp(lag.value_s + away, GRID, unit) for away in (-step, 0.0, step) for unit in UNITS]
    ).reshape(3, -1)
    found = []
    for piece in windows:
        if piece.codes:
            found.append(piece)
            continue
        at = weights @ piece.command
        slope = lag.power * float(np.log(at[2] / at[0])) / (2 * step)
        found.append(
            replace(
                piece,
                brought={**piece.brought, "throttle": float(at[1])},
                covariates={
                    **piece.covariates,
                    SLOPE: (slope, np.nan),
                    "u_lag_s": (lag.u_s, np.nan),
                },
            )
        )
    return tuple(found)


def _counted(answers: Sequence[Flown]) -> list[str]:
    """What was kept and what was not, in one line."""
    total: Counter[str] = sum((a.counts for a in answers), Counter())
    whole = sum(total.values())
    if not whole:
        return []
    kept = sum(not r.reduced.codes for a in answers for r in a.rows)
    logs = sum(bool(a.windows) for a in answers)
    lost = ", ".join(f"{code} {100 * n / whole:.3g} %" for code, n in total.most_common() if code)
    return [
        f"{logs} log{'s' * (logs != 1)} cut into {kept} windows, {100 * total[''] / whole:.3g} % of"
        f" the samples" + (f"; left out: {lost}" if lost else "")
    ]
