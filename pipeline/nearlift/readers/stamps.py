"""Times of day as seconds: ISO 8601 with or without a zone, 12-hour clocks, dates in the usual
orders, ``mm:ss.0`` of spreadsheets, ``hh:mm:ss:fff`` of terminals.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence

import numpy as np

from nearlift.declare import FloatArray

_STAMP = re.compile(
    r"""\s*[\[(]?\s*
    (?:(?P<date>\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4})(?:[T\s,]\s*|_))?
    (?P<a>\d{1,2}):(?P<b>\d{2})(?::(?P<c>\d{2}))?(?:[.,:](?P<fraction>\d{1,9}))?
    \s*(?P<half>[AaPp]\.?\s?[Mm]\.?)?
    \s*(?P<zone>Z|UTC|GMT|[-+]\d{2}:?\d{2}|[-+]\d{2})?
    \s*[\])]?\s*""",
    re.X,
)
MINUTE_S, HOUR_S, DAY_S = 60.0, 3600.0, 86400.0
#: A clock without a date begins again after so much; a smaller step back is no new round.
_ROUND = 0.5


def is_stamp(cell: str) -> bool:
    """Whether a cell is a time of day, with or without a date."""
    return _STAMP.fullmatch(cell) is not None


def seconds(cells: Sequence[str]) -> FloatArray | None:
    """Seconds since the first of these times, NaN for a blank cell; None where one is no time, or
    is written otherwise than the first.

    A clock without a date may pass midnight, or the full hour where it shows minutes only.
    """
    found = [_STAMP.fullmatch(cell) for cell in cells]
    first = next((m for m in found if m), None)
    if first is None or any(
        m is None and cell.strip() for m, cell in zip(found, cells, strict=True)
    ):
        return None
    forms = {
        tuple(k for k, v in m.groupdict().items() if v and k != "fraction") for m in found if m
    }
    if len(forms) > 1:
        return None
    # two numbers are minutes and seconds where there is a fraction, else hours and minutes
    short = first["c"] is None
    minutes = short and any(m["fraction"] for m in found if m) and not first["half"]
    times = np.array([np.nan if m is None else _of_day(m, minutes) for m in found])
    if first["date"] is None:
        times = _unrolled(times, HOUR_S if minutes else DAY_S)
    else:
        days = _days([m["date"] if m else first["date"] for m in found])
        if days is None:
            return None
        times = times + DAY_S * days
    known = times[np.isfinite(times)]
    since_first: FloatArray = times - known[0]
    return since_first


def _of_day(match: re.Match[str], minutes: bool) -> float:
    """Seconds since midnight, by Greenwich where the zone is given."""
    a, b, c = int(match["a"]), int(match["b"]), int(match["c"] or 0)
    fraction = float(f"0.{match['fraction']}") if match["fraction"] else 0.0
    if minutes:
        return MINUTE_S * a + b + fraction
    if match["half"]:
        a = a % 12 + 12 * (match["half"][0] in "pP")
    time = HOUR_S * a + MINUTE_S * b + c + fraction
    zone = match["zone"]
    if zone and zone[0] in "+-":
        digits = zone[1:].replace(":", "").ljust(4, "0")
        away = HOUR_S * int(digits[:2]) + MINUTE_S * int(digits[2:])
        time -= away if zone[0] == "+" else -away
    return time


def _unrolled(times: FloatArray, period: float) -> FloatArray:
    """The times of a clock that begins again after a period."""
    known = np.isfinite(times)
    steps = np.diff(times[known], prepend=times[known][:1])
    unrolled = times.copy()
    unrolled[known] += period * np.cumsum(steps < -_ROUND * period)
    return unrolled


def _days(dates: Sequence[str]) -> FloatArray | None:
    """Days of the dates; where day and month could be either, the order with the shorter span."""
    numbers = {date: [int(p) for p in re.split(r"[-/.]", date)] for date in dict.fromkeys(dates)}
    spans: list[tuple[float, dict[str, int]]] = []
    for order in ((0, 1, 2), (2, 1, 0), (2, 0, 1)):
        try:
            days = {
                date: datetime.date(p[order[0]], p[order[1]], p[order[2]]).toordinal()
                for date, p in numbers.items()
                if p[order[0]] > 31
                or len(date.replace(".", "-").replace("/", "-").split("-")[order[0]]) in (2, 4)
            }
        except ValueError:
            continue
        if len(days) == len(numbers):
            spans.append((max(days.values()) - min(days.values()), days))
    if not spans:
        return None
    _, best = min(spans, key=lambda s: s[0])
    return np.array([float(best[date]) for date in dates])
