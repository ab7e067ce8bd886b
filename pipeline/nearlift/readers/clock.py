"""Times of day as seconds.

The forms are ISO 8601 with or without a zone, another date before a time of day, and AM and PM.
Minutes and seconds are read as spreadsheets write them.
"""

from __future__ import annotations

import contextlib
import datetime
import functools
import math
import re
from collections.abc import Sequence

import numpy as np

from nearlift.declare import FloatArray

DAY_S, HOUR_S = 86400.0, 3600.0
#: Times such as ``14h05m03.2s`` and ``14時05分03秒``.
_HOURS = re.compile(
    r"(?<!\w)(\d{1,2})[h時](\d{1,2})(?:m(?:in)?|分)(\d{2}(?:[.,]\d+)?)[s秒]?(?!\w)", re.IGNORECASE
)
_TIME = re.compile(
    r"(?:(?P<hour>\d{1,2}):)?(?P<minute>\d{1,2}):(?P<second>\d{2})(?:[.,:](?P<fraction>\d+))?"
    r"(?:\s*(?P<half>[ap])\.?m\.?)?"
    r"(?:\s*(?P<zone>z|utc|gmt|[a-z]{2,4}t|[-+]\d{2}:?\d{2}))?",
    re.IGNORECASE,
)
#: End of the name of a column of whole seconds, or (with a prefix) of their fractions.
_IN_SECONDS = re.compile(
    r"(?<![a-zµμ])(n|nano|u|µ|μ|micro|m|milli|)s(?:ec(?:ond)?s?)?[)\]]?$", re.IGNORECASE
)
_FRACTIONS = {"n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3}
_FRACTIONS |= {"nano": 1e-9, "micro": 1e-6, "milli": 1e-3}


def is_time(cell: str) -> bool:
    """Whether a cell is a time of day that can be read as seconds."""
    return _parts(cell) is not None


def seconds_of(cells: Sequence[str]) -> tuple[FloatArray, int | None]:
    """Seconds from the first of these times (n,), and the index of the first cell that is no time.

    Seconds are NaN where a cell is blank. The index is None if every cell is a time or blank.

    A date in ISO 8601 counts. Without one, a time that falls by more than half a day is one of the
    next day. Times of minutes and seconds that fall by more than half an hour are of the next hour.
    """
    values, days, period = np.full(len(cells), np.nan), np.zeros(len(cells)), 0.0
    for i, cell in enumerate(cells):
        if not cell.strip():
            continue
        if (parts := _parts(cell)) is None:
            return values, i
        values[i], days[i], period = parts
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return values, None
    if period:
        days[known[1:]] = np.cumsum(np.diff(values[known]) < -period / 2) * (period / DAY_S)
    # days first: a date's own seconds leave no digits for a sample's
    return values - values[known[0]] + DAY_S * (days - days[known[0]]), None


@functools.lru_cache(maxsize=64)
def two_columns(names: tuple[str, ...]) -> list[tuple[str, str, float]]:
    """Clocks in two columns, such as ROS's ``stamp.secs`` and ``stamp.nsecs``: names of the whole
    seconds and of their fractions, and the unit of these, s.
    """
    parts: dict[str, dict[str, str]] = {}
    for name in names:
        if match := _IN_SECONDS.search(name):
            parts.setdefault(name[: match.start()].lower(), {})[match[1].lower()] = name
    return [
        (pair[""], pair[sign], unit_s)
        for pair in parts.values()
        for sign, unit_s in _FRACTIONS.items()
        if "" in pair and sign in pair
    ]


def same_clock(name: str, column: str) -> bool:
    """Whether two names, the second perhaps without its group, may be of a clock in two columns."""
    # most columns are no clocks, and files may have thousands of names
    if (asked := _IN_SECONDS.search(column)) is None or (part := _IN_SECONDS.search(name)) is None:
        return False
    return name[: part.start()].lower().endswith(column[: asked.start()].lower())


def joined(whole: FloatArray, fractions: FloatArray, unit_s: float) -> FloatArray | None:
    """Seconds from the first whole one (n,) of a clock in two columns; None where they are none."""
    if len(whole) != len(fractions):
        return None
    known = np.isfinite(whole) & np.isfinite(fractions)
    parts = unit_s * fractions[known]
    if not (known.any() and (whole[known] % 1 == 0).all() and ((parts >= 0) & (parts < 1)).all()):
        return None
    seconds: FloatArray = whole - whole[known][0] + unit_s * fractions
    return seconds


def _divided(text: str) -> tuple[str, str]:
    """Date (empty if there is none) and time of day; no time where no sign is between them."""
    colon = text.find(":")
    start = max(colon, 0)
    while start > 0 and text[start - 1].isdigit() and colon - start < 2:
        start -= 1
    head = text[:start]
    date = head.rstrip()
    if date and date[-1] in "Tt,":
        date = date[:-1].rstrip()
    elif date and date == head:
        return "", ""
    return (date, text[start:]) if not head or any(map(str.isdigit, date)) else ("", "")


def _parts(cell: str) -> tuple[float, int, float] | None:
    """Seconds of the day, the day (0 without a date), and the seconds' period (0: none).

    The seconds begin again after a period. None where the cell is no time.
    """
    plain = _HOURS.sub(r"\1:\2:\3", cell.strip(" \t[]()"))
    date, of_day_text = _divided(plain)
    match = _TIME.fullmatch(of_day_text)
    if match is None and "T" in plain:
        # ISO 8601 without its signs
        with contextlib.suppress(ValueError):
            date, of_day_text = _divided(datetime.datetime.fromisoformat(plain).isoformat())
            match = _TIME.fullmatch(of_day_text)
    # two numbers without a fraction may be hours and minutes
    if match is None or not (match["hour"] or match["fraction"]):
        return None
    hour, minute = int(match["hour"] or 0), int(match["minute"])
    if match["half"]:
        hour = hour % 12 + 12 * (match["half"].lower() == "p")
    second = float(f"{match['second']}.{match['fraction'] or 0}")
    if hour > 23 or minute > 59 or second >= 61:
        return None
    zone = 0.0
    if match["zone"] and match["zone"][0] in "+-":
        sign = math.copysign(1.0, float(match["zone"][0] + "1"))
        zone = sign * (HOUR_S * int(match["zone"][1:3]) + 60 * int(match["zone"][-2:]))
    of_day = HOUR_S * hour + 60 * minute + second - zone
    try:
        day = datetime.date.fromisoformat(date)
    except ValueError:
        return of_day, 0, DAY_S if match["hour"] else HOUR_S
    return of_day, day.toordinal(), 0.0
