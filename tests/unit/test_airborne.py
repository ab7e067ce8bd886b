"""When a vehicle flies, by series of a few samples: starts, landings, floor, codes, windows."""

from __future__ import annotations

import numpy as np
import pytest

from nearlift.declare import FloatArray
from nearlift.reduction.airborne import (
    CLEAN,
    CODES,
    Phases,
    Window,
    floors,
    phases,
    starts_and_contacts,
    windows_of,
)

CONTACT = CODES.index("CONTACT")
RATE_HZ = 100.0


def coded(*stretches: tuple[int, int]) -> Phases:
    """Stretches of (code, samples), all behind one start."""
    code = np.concatenate([np.full(samples, code) for code, samples in stretches])
    n = len(code)
    return Phases(
        aloft=np.ones(n, dtype=bool),
        code=code,
        start=np.ones(n, dtype=np.int64),
        floor_m=np.zeros(n),
    )


def cut(
    found: Phases, length: int = 10, run: list[int] | None = None
) -> list[tuple[int, int, str]]:
    runs = np.zeros(len(found.code), dtype=np.int64) if run is None else np.repeat([0, 1], run)
    return [(w.first, w.end, w.code) for w in windows_of(found, runs, length)]


def test_clean_flight_is_cut_into_windows_and_a_short_rest_is_a_fragment() -> None:
    assert windows_of(coded((CLEAN, 20)), np.zeros(20, dtype=np.int64), 10) == [
        Window(first=0, end=10, code="", start=1),
        Window(first=10, end=20, code="", start=1),
    ]
    assert cut(coded((CLEAN, 23))) == [(0, 10, ""), (10, 20, ""), (20, 23, "FRAGMENT")]
    # half a window is one
    assert cut(coded((CLEAN, 25))) == [(0, 10, ""), (10, 20, ""), (20, 25, "")]


@pytest.mark.parametrize("last", [3, 30])
def test_a_flaw_that_comes_and_goes_is_one(last: int) -> None:
    """Less than half a window of clean flight between two stretches of one flaw belongs to it."""
    flaw = CODES.index("FULL_COMMAND")
    found = coded((CLEAN, 10), (flaw, 5), (CLEAN, 4), (flaw, last))
    assert cut(found) == [(0, 10, ""), (10, 19 + last, "FULL_COMMAND")]
    # half a window between them, or a flaw of another kind, parts them
    found = coded((flaw, 5), (CLEAN, 5), (flaw, 5))
    assert [w[2] for w in cut(found)] == ["FULL_COMMAND", "", "FULL_COMMAND"]
    found = coded((flaw, 5), (CLEAN, 4), (CODES.index("TILTED"), 5))
    assert [w[2] for w in cut(found)] == ["FULL_COMMAND", "FRAGMENT", "TILTED"]


def test_no_window_reaches_over_a_hole_of_the_log() -> None:
    assert cut(coded((CLEAN, 20)), run=[12, 8]) == [(0, 10, ""), (10, 12, "FRAGMENT"), (12, 20, "")]


def flight(samples: int = 300) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Climb, height and commands: rest, a climb of 0.5 m from 1.0 s, hover, a landing at 2.5 s."""
    time_s = np.arange(samples) / RATE_HZ
    climb = np.where((time_s >= 1.0) & (time_s < 2.0), 0.5, 0.0)
    climb[(time_s >= 2.2) & (time_s < 2.45)] = -2.0
    command = np.where((time_s >= 0.9) & (time_s < 2.5), 0.6, 0.0)
    return climb, np.cumsum(climb) / RATE_HZ, np.stack([command, command], axis=1)


def test_a_start_is_where_it_climbs_and_ends_where_the_motors_stop() -> None:
    climb, height, command = flight()
    aloft, flying, start = starts_and_contacts(climb, height, command, 0.1)
    assert np.flatnonzero(np.diff(aloft)).tolist() == [99, 249]
    # contact from 0.05 m above the height at which the motors stopped
    landed = 100 + np.flatnonzero(height[100:250] >= height[250] + 0.05)[-1]
    assert np.flatnonzero(np.diff(flying)).tolist() == [99, landed]
    assert start.tolist() == [0] * 100 + [1] * 200


@pytest.mark.parametrize(("lost", "starts"), [(4, 1), (5, 2)])
def test_a_command_lost_for_a_moment_is_no_landing(lost: int, starts: int) -> None:
    climb, height, command = flight()
    command[150 : 150 + lost] = 0.0
    assert starts_and_contacts(climb, height, command, 0.1)[2].max() == starts


def test_the_floor_is_the_height_at_rest_and_moves_where_the_estimator_comes_to_see_it() -> None:
    climb, height, command = flight()
    _, flying, start = starts_and_contacts(climb, height, command, 0.1)
    found, unseen = floors(height + 0.3, climb, flying, start, RATE_HZ)
    np.testing.assert_allclose(found, np.where(start == 1, 0.3, 0.0))
    assert not unseen.any()
    stepped = height + 0.3 + 0.1 * (np.arange(300) >= 110)
    found, unseen = floors(stepped, climb, flying, start, RATE_HZ)
    np.testing.assert_allclose(found[start == 1], 0.4)
    # from 0.2 s before the start to 0.6 s behind it
    assert np.flatnonzero(unseen).tolist() == list(range(80, 160))


def test_each_sample_is_told_by_the_first_flaw_it_has() -> None:
    climb, height, command = flight()
    tilt = np.zeros(300)
    tilt[180:190] = 0.5
    command[185:188] = 1.0
    lift = np.ones(300)
    lift[170] = np.nan
    run = (np.arange(300) >= 130).astype(np.int64)
    series = {"climb_m_s": climb, "height_m": height, "lift_N": lift, "tilt_rad": tilt}
    found = phases(series, command, run, RATE_HZ, 0.1, (0.3, (0.01, 1.0)), each_start=False)
    names = [*CODES, ""]
    told = [names[k] for k in found.code]
    assert told[:100] == ["CONTACT"] * 100
    # the height sensor sees from 0.01 m on
    assert told[100:103] == ["NO_HEIGHT", "NO_HEIGHT", ""]
    assert told[129:131] == ["", "GAPS"]
    assert told[149:151] == ["GAPS", ""]
    assert told[169:172] == ["", "OUT_OF_RANGE", ""]
    assert told[179:191] == ["", *["TILTED"] * 5, *["FULL_COMMAND"] * 3, *["TILTED"] * 2, ""]
    assert told[-50:] == ["CONTACT"] * 50
