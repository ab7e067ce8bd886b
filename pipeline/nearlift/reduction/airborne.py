"""When a vehicle flies, from its log: contact, starts, samples that tell no lift, and windows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.declare import BoolArray, FloatArray, IntArray
from nearlift.reduction.cuts import windows

#: A landing is contact from so far above the height at which the motors stopped, m: feet and ground
#: take turns there.
LANDING_M = 0.05
#: Rest before a start whose height is zero, s, and how much of it before the climb is not rest.
REST_S, LEAVING_S = 0.5, 0.2
#: When an estimator has seen the floor, s behind the start of a climb, and a step of it, m; below
#: the floor by as much no vehicle flies.
SEEN_S, STEP_M = (0.2, 0.6), 0.02
#: What a motor is told that stands, and one that can do no more, as shares of full throttle.
STANDS, FULL = 0.01, 0.995
#: Time behind a hole in the log for which what the motors were told is not known, s.
FORGETS_S = 0.2
#: Codes of samples, the one that is told first where several hold; clean ones have none.
CODES = ("CONTACT", "GAPS", "ZERO_COMMAND", "OUT_OF_RANGE", "NO_HEIGHT", "FULL_COMMAND", "TILTED")
CLEAN = len(CODES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Phases:
    """What each sample is: an index into `CODES`, or `CLEAN`; whether the motors carried the
    vehicle; which start it follows, from 1 (0 before the first); and the height of the floor at
    that start, as logged.
    """

    aloft: BoolArray
    code: IntArray
    start: IntArray
    floor_m: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """Samples from `first` to before `end` of one code ("": clean), and the start they follow."""

    first: int
    end: int
    code: str
    start: int


def starts_and_contacts(
    climb_m_s: FloatArray, height_m: FloatArray, command: FloatArray, airborne: float
) -> tuple[BoolArray, BoolArray, IntArray]:
    """Which samples are flight or landing, which are flight, and which start each follows.

    A start is where the climb first exceeds `airborne` with the motors on; it ends where they stop,
    or where the log was on the floor again: height alone does not tell, since after a landing an
    estimator's height may be off by centimetres.
    """
    n = len(climb_m_s)
    turning = np.nanmax(command, axis=1, initial=0.0) > STANDS
    # a command lost for a moment is no landing
    stopped = _lasting(~turning, 5)
    rising = turning & (np.nan_to_num(climb_m_s) > airborne)
    aloft, landing, start = *np.zeros((2, n), dtype=bool), np.zeros(n, dtype=np.int64)
    at = count = 0
    while True:
        up = np.flatnonzero(rising[at:])
        if not len(up):
            break
        first = at + int(up[0])
        down = np.flatnonzero(stopped[first:])
        end = first + int(down[0]) if len(down) else n
        count += 1
        start[first:] = count
        aloft[first:end] = True
        if end < n:
            above = np.flatnonzero(~(height_m[first:end] < height_m[end] + LANDING_M))
            landing[first + (int(above[-1]) + 1 if len(above) else 0) : end] = True
        at = end
    return aloft, aloft & ~landing, start


def _lasting(mask: BoolArray, samples: int) -> BoolArray:
    """The mask less its stretches of fewer samples, those at the end of the series aside."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0))
    kept = np.zeros(len(mask), dtype=bool)
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        kept[a:b] = b - a >= samples or b == len(mask)
    return kept


def floors(
    height_m: FloatArray, climb_m_s: FloatArray, flying: BoolArray, start: IntArray, rate_Hz: float
) -> tuple[FloatArray, BoolArray]:
    """The height of the floor at each sample, as logged: the median over the rest before its start,
    or, of a log that begins in flight, zero.

    An estimator that comes to see the floor only in the air steps: by what its height then differs
    from the way that it has climbed, the floor is moved; until then it says nothing of the height,
    and the second array is true.
    """
    floor_m, unseen = np.zeros(len(height_m)), np.zeros(len(height_m), dtype=bool)
    for number in range(1, int(start.max(initial=0)) + 1):
        mine = np.flatnonzero(start == number)
        end = int(mine[0]) - round(LEAVING_S * rate_Hz)
        first = max(end - round(REST_S * rate_Hz), 0)
        if end <= 0:
            continue
        rest = height_m[first:end][~flying[first:end]]
        rest = rest[np.isfinite(rest)]
        if not len(rest):
            continue
        floor = float(np.median(rest))
        soon = slice(end, int(mine[0]) + round(SEEN_S[1] * rate_Hz))
        way = np.cumsum(np.nan_to_num(climb_m_s[soon])) / rate_Hz
        stepped = (height_m[soon] - floor - way)[int(mine[0]) - end + round(SEEN_S[0] * rate_Hz) :]
        if len(stepped) and abs(step := float(np.nanmedian(stepped))) > STEP_M:
            floor += step
            unseen[soon] = True
        floor_m[mine] = floor
    return floor_m, unseen


def phases(
    series: dict[str, FloatArray],
    command: FloatArray,
    run: IntArray,
    rate_Hz: float,
    airborne: float,
    limits: tuple[float, tuple[float, float] | None],
    each_start: bool,
) -> Phases:
    """What each sample is, by `series` (n,): `climb_m_s`, `height_m`, `lift_N` and, where they were
    logged, `supply_V`, `tilt_rad`; by the `command` (n, rotors) in shares of full throttle; and by
    `run` (n,), which counts the stretches between holes.

    `limits` are the largest tilt, rad, and, if known, the lowest and highest of the height sensor's
    range, m.
    """
    height, tilt = series["height_m"], series.get("tilt_rad")
    aloft, flying, start = starts_and_contacts(series["climb_m_s"], height, command, airborne)
    n, floor = len(height), np.zeros(len(height))
    lost = np.zeros(n, dtype=bool)
    if each_start:
        floor, lost = floors(height, series["climb_m_s"], flying, start, rate_Hz)
    lost = lost | (height - floor < -STEP_M)
    most_tilt, seen = limits
    known = np.all([np.isfinite(values) for values in series.values()], axis=0)
    first = np.concatenate([[False], run[1:] != run[:-1]])
    behind = np.zeros(n, dtype=bool)
    for at in np.flatnonzero(first):
        behind[at : at + round(FORGETS_S * rate_Hz)] = True
    least, most = command.min(axis=1), command.max(axis=1)
    holds = {
        "CONTACT": ~flying,
        "GAPS": behind,
        "ZERO_COMMAND": least <= STANDS,
        "OUT_OF_RANGE": ~known | ~np.isfinite(least),
        "NO_HEIGHT": lost if seen is None else lost | (height <= seen[0]) | (height >= seen[1]),
        "FULL_COMMAND": most >= FULL,
        "TILTED": np.zeros(n, dtype=bool) if tilt is None else tilt > most_tilt,
    }
    code = np.full(n, CLEAN, dtype=np.int64)
    for place in reversed(range(CLEAN)):
        code[holds[CODES[place]]] = place
    return Phases(aloft=aloft, code=code, start=start, floor_m=floor)


def windows_of(phases: Phases, run: IntArray, length: int) -> list[Window]:
    """The log cut where its samples' code, start or run changes, clean stretches on into windows.

    What is left of a stretch that is shorter than half a window is a piece that is FRAGMENT; where
    a flaw comes and goes faster than that, it is one.
    """
    code, half = phases.code.copy(), max((length + 1) // 2, 1)
    changes = np.concatenate([[True], (np.diff(run) != 0) | (np.diff(phases.start) != 0)])
    edges = _edges(code, changes)
    for k, (a, b) in enumerate(edges[1:-1], 1):
        before, behind = code[edges[k - 1][0]], code[edges[k + 1][0]]
        if code[a] == CLEAN and b - a < half and before == behind and not changes[a]:
            code[a:b] = before
    pieces = []
    for a, b in _edges(code, changes):
        start = int(phases.start[a])
        if code[a] != CLEAN:
            pieces.append(Window(first=a, end=b, code=CODES[code[a]], start=start))
            continue
        cut = windows(a, b, length)
        pieces += [Window(first=x, end=y, code="", start=start) for x, y in cut]
        if (left := cut[-1][1] if cut else a) < b:
            pieces.append(Window(first=left, end=b, code="FRAGMENT", start=start))
    return pieces


def _edges(code: IntArray, changes: BoolArray) -> list[tuple[int, int]]:
    first = np.flatnonzero(changes | np.concatenate([[True], np.diff(code) != 0]))
    return list(zip(first.tolist(), [*first[1:].tolist(), len(code)], strict=True))
