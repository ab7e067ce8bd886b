"""A compiled scanner for plain decimal CSV: exact or not at all.

A number is taken here only if its digits fit 53 bits and its power of ten is within 10^22: then mantissa and power are both exact
in binary and one multiplication or division rounds correctly (Clinger 1990), so the result is bit for bit Python's `float`.
Everything else (more digits, quotes, words, cells too many or too few) makes the scanner give the whole file back to
the strict reader, which reads it or says what is wrong. The GIL is released throughout.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

POWERS = 10.0 ** np.arange(23)
COMMA, NEWLINE, RETURN, POINT, PLUS, MINUS, BLANK = 44, 10, 13, 46, 43, 45, 32
IRREGULAR = -1


def _compiled(function: Any) -> Any:
    """The function compiled and cached on disk, or only compiled where no cache folder can be written."""
    try:
        return numba.njit(cache=True, nogil=True)(function)
    except RuntimeError:
        return numba.njit(nogil=True)(function)


def _scan(text: Any, at: int, columns: int, force_column: int, time_column: int, force: Any, time: Any, powers: Any) -> int:
    """Fill `force` and `time` from the rows of `text`, which start at byte `at` and each end in a newline.

    `time_column` is -1 where there is none. Returns the number of rows, or `IRREGULAR`.
    """
    size, row = len(text), 0
    limit = np.uint64(1 << 53)
    ten = np.uint64(10)
    while at < size:
        if text[at] == NEWLINE:
            at += 1
            continue
        if text[at] == RETURN:
            if at + 1 >= size or text[at + 1] != NEWLINE:
                return IRREGULAR
            at += 2
            continue
        if row == len(force):
            return IRREGULAR
        for column in range(columns):
            if column == force_column or column == time_column:  # noqa: SIM109 (numba would build a tuple for each cell)
                while at < size and text[at] == BLANK:
                    at += 1
                negative = False
                if at < size and (text[at] == MINUS or text[at] == PLUS):
                    negative = text[at] == MINUS
                    at += 1
                mantissa = np.uint64(0)
                digits, exponent, point = 0, 0, False
                while at < size:
                    byte = text[at]
                    if 48 <= byte <= 57:
                        # a mantissa that fits stays below 2^53 after every digit, so the product cannot wrap
                        mantissa = mantissa * ten + np.uint64(byte - 48)
                        if mantissa > limit:
                            return IRREGULAR
                        digits += 1
                        if point:
                            exponent -= 1
                    elif byte == POINT and not point:
                        point = True
                    else:
                        break
                    at += 1
                if digits == 0:
                    return IRREGULAR
                if at < size and (text[at] == 101 or text[at] == 69):
                    at += 1
                    down = False
                    if at < size and (text[at] == MINUS or text[at] == PLUS):
                        down = text[at] == MINUS
                        at += 1
                    power, seen = 0, 0
                    while at < size and 48 <= text[at] <= 57 and seen < 4:
                        power = power * 10 + (text[at] - 48)
                        seen += 1
                        at += 1
                    if seen == 0:
                        return IRREGULAR
                    exponent += -power if down else power
                if exponent < -22 or exponent > 22:
                    return IRREGULAR
                value = np.float64(mantissa)
                value = value / powers[-exponent] if exponent < 0 else value * powers[exponent]
                if negative:
                    value = -value
                if column == force_column:
                    force[row] = value
                if column == time_column:
                    time[row] = value
                while at < size and text[at] == BLANK:
                    at += 1
            else:
                while at < size and text[at] != COMMA and text[at] != NEWLINE and text[at] != RETURN:
                    # a quote may hide a comma; a NUL is damage
                    if text[at] == 34 or text[at] == 0:
                        return IRREGULAR
                    at += 1
            if at >= size:
                return IRREGULAR
            if column < columns - 1:
                if text[at] != COMMA:
                    return IRREGULAR
                at += 1
        if text[at] == RETURN:
            at += 1
        if at >= size or text[at] != NEWLINE:
            return IRREGULAR
        at += 1
        row += 1
    return row


_compiled_scan = _compiled(_scan)


def scan(text: Any, at: int, columns: int, force_column: int, time_column: int, force: Any, time: Any) -> int | None:
    """Fill `force` and `time` from the bytes `text` after byte `at`; the number of rows, or None where a line is not plain.

    `time_column` is -1 where there is none.
    """
    rows = int(_compiled_scan(text, at, columns, force_column, time_column, force, time, POWERS))
    return None if rows == IRREGULAR else rows
