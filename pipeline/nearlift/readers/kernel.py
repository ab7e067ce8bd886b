"""A compiled scanner for plain decimal CSV: exact or not at all.

A number is taken here only if it has at most 18 digits that fit 53 bits: then mantissa and power of ten are both exact in binary
and one division rounds correctly (Clinger 1990), so the result is bit for bit Python's `float`. Everything else (more digits, powers
of ten, a plus, quotes, blanks, words, cells too many or too few) makes the scanner give the whole file back to the strict reader,
which reads it or says what is wrong.

Nothing here can raise or allocate, so that what the compiler makes of it needs neither Python nor numba (`readers.native`).

Two things make it fast. Every whole number is unsigned and 64 bits wide: a signed index costs a test at each byte, and a mixture of
both becomes floating point. And there are no loops but those over digits and cells: one for blanks or powers of ten, even if it
never runs, costs a factor of four, because the compiler then keeps the digits' loops out of registers.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numba import types

U = np.uint64
ZERO, ONE, TWO, NINE, TEN, ZERO_DIGIT = U(0), U(1), U(2), U(9), U(10), U(48)
NEWLINE, RETURN, QUOTE, COMMA, MINUS = (U(ord(c)) for c in '\n\r",-')
#: Digits that cannot wrap 64 bits, and the largest whole number below which every one is exact in binary.
MOST_DIGITS, EXACT = U(18), U(1 << 53)
#: The decimal point, as it comes out where a digit is looked for.
POINT_DIGIT = U((ord(".") - ord("0")) % (1 << 64))
IRREGULAR = np.int64(-1)


def _number(text: Any, at: Any, powers: Any) -> Any:
    """The number that starts at byte `at`, and the byte behind it, which is 0 where it is not plain."""
    negative = U(text[at]) == MINUS
    if negative:
        at = at + ONE
    mantissa, start, down = ZERO, at, ZERO
    digit = U(text[at]) - ZERO_DIGIT  # wraps below "0", so one comparison tells a digit
    while digit <= NINE:
        mantissa = mantissa * TEN + digit
        at = at + ONE
        digit = U(text[at]) - ZERO_DIGIT
    digits = at - start
    if digit == POINT_DIGIT:
        at = at + ONE
        start = at
        digit = U(text[at]) - ZERO_DIGIT
        while digit <= NINE:
            mantissa = mantissa * TEN + digit
            at = at + ONE
            digit = U(text[at]) - ZERO_DIGIT
        down = at - start
        digits = digits + down
    byte = U(text[at])
    plain = digits - ONE < MOST_DIGITS and mantissa <= EXACT
    if plain and (byte == COMMA or byte == NEWLINE or byte == RETURN):  # noqa: SIM109
        value = np.float64(mantissa) / powers[down]
        return -value if negative else value, at
    return np.nan, ZERO


_inlined_number = numba.njit(inline="always")(_number)


def _skip(text: Any, at: Any, cells: Any) -> Any:
    """The byte behind the comma of the last of so many cells, 0 where there are fewer. A quote may hide a comma; a NUL is damage."""
    while cells != ZERO:
        byte = U(text[at])
        while byte != COMMA:
            if byte == NEWLINE or byte == QUOTE or byte == ZERO:  # noqa: SIM109
                return ZERO
            at = at + ONE
            byte = U(text[at])
        at = at + ONE
        cells = cells - ONE
    return at


_inlined_skip = numba.njit(inline="always")(_skip)


def scan(text: Any, size: Any, at: Any, before: Any, between: Any, after: Any, first: Any, second: Any, room: Any, pair: Any, powers: Any) -> Any:
    """Fill `first` and `second` with a number each from every row of `text` behind byte `at`; returns the rows, or `IRREGULAR`.

    Arrays are bare pointers: `text` has `size` bytes, the others have `room` numbers, `powers` those of ten. Rows end in a newline and have so
    many cells `before`, `between` and `after` those two. Only the first is read unless `pair` is 1. The two have code of
    their own, since the processor learns the length of each one's numbers.
    """
    row = ZERO
    # with this, no loop below can run over the end
    if U(text[size - ONE]) != NEWLINE:
        return IRREGULAR
    while at < size:
        byte = U(text[at])
        if byte == NEWLINE:
            at = at + ONE
            continue
        if byte == RETURN:
            if U(text[at + ONE]) != NEWLINE:
                return IRREGULAR
            at = at + TWO
            continue
        if row == room:
            return IRREGULAR
        if before != ZERO:
            at = _inlined_skip(text, at, before)
            if at == ZERO:
                return IRREGULAR
        value, at = _inlined_number(text, at, powers)
        if at == ZERO:
            return IRREGULAR
        first[row] = value
        if pair != ZERO:
            if U(text[at]) != COMMA:
                return IRREGULAR
            at = at + ONE
            if between != ZERO:
                at = _inlined_skip(text, at, between)
                if at == ZERO:
                    return IRREGULAR
            value, at = _inlined_number(text, at, powers)
            if at == ZERO:
                return IRREGULAR
            second[row] = value
        if after != ZERO:
            if U(text[at]) != COMMA:
                return IRREGULAR
            at = _inlined_skip(text, at + ONE, after - ONE)
            if at == ZERO:
                return IRREGULAR
            byte = U(text[at])
            while byte != NEWLINE and byte != RETURN:
                if byte == COMMA or byte == QUOTE or byte == ZERO:  # noqa: SIM109
                    return IRREGULAR
                at = at + ONE
                byte = U(text[at])
        if U(text[at]) == RETURN:
            at = at + ONE
        if U(text[at]) != NEWLINE:
            return IRREGULAR
        at = at + ONE
        row = row + ONE
    return np.int64(row)


_BYTES: Any = types.CPointer(types.uint8)  # type: ignore[no-untyped-call]
_NUMBERS: Any = types.CPointer(types.float64)  # type: ignore[no-untyped-call]
#: What `readers.native` compiles.
SIGNATURE = types.int64(_BYTES, *(types.uint64,) * 5, _NUMBERS, _NUMBERS, types.uint64, types.uint64, _NUMBERS)
