"""A compiled scanner for plain decimal CSV: exact or not at all.

A number is taken here only if it has at most 18 digits that fit 53 bits: then mantissa and power of
ten are both exact in binary and one division rounds correctly (Clinger 1990), so the result is bit
for bit Python's `float`. Everything else (more digits, powers of ten, a plus, quotes, blanks,
words, cells too many or too few) makes the scanner give the whole file back to the strict reader,
which reads it or says what is wrong.

A logger prints most numbers of a column alike: so many characters, the point at the same place.
Each column's last layout is kept, and the next number is taken by its last eight characters and the
eight before them, each word checked and turned into a whole number at once (the arithmetic of
Lemire 2021, doi 10.1002/spe.2984). Where it is laid out otherwise, digits are read one by one and
the new layout is kept.

Nothing here can raise or allocate, so that what the compiler makes of it needs neither Python nor
numba (`nearlift.native`).

Every whole number is unsigned and 64 bits wide: a signed index costs a test at each byte, and a
mixture of both becomes floating point. There are no loops but those over digits and cells: one for
blanks or powers of ten, even if it never runs, costs a factor of four, because the compiler then
keeps the digits' loops out of registers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir

from nearlift.compiler import inlined, numba

types, intrinsic = numba.types, numba.extending.intrinsic

U = np.uint64
ZERO, ONE, TWO, EIGHT, NINE, TEN, SIXTEEN, ZERO_DIGIT = (U(i) for i in (0, 1, 2, 8, 9, 10, 16, 48))
NEWLINE, RETURN, QUOTE, COMMA, MINUS = (U(ord(c)) for c in '\n\r",-')
#: Digits that cannot wrap 64 bits, and the largest whole number below which every one is exact in
#: binary.
MOST_DIGITS, EXACT = U(18), U(1 << 53)
#: The decimal point, as it comes out where a digit is looked for.
POINT_DIGIT = U((ord(".") - ord("0")) % (1 << 64))
IRREGULAR = np.int64(-1)

#: What is kept of a column's layout: characters of its number, digits behind the point, the
#: character behind the number, the bytes behind byte 16 where it may start; then, for its last word
#: of eight characters, and again for the one before: the bytes that are the number's, what they are
#: if all digits are 0, what lifts a byte over 127 that is none of it, and the digits before the
#: point.
LENGTH, DOWN, STOP, ROOM, OWN, BLANK, LIFT, AHEAD = (U(i) for i in range(8))
UPPER, SECOND_COLUMN = U(4), U(16)
#: In every byte: the digit 0, what makes a point of it, what lifts 10 to 128, what beside that
#: lifts 1, and that bit.
ZEROS, TO_POINT, LIFT_TEN, LIFT_ONE, LIFTED = (
    U(0x0101010101010101 * b) for b in (0x30, 0x30 ^ 0x2E, 0x76, 0x09, 0x80)
)
#: Factors that make one number of two neighbours, and where the sums then stand.
TWO_DIGITS, TWO_PAIRS, TWO_FOURS = U(10 << 8 | 1), U(100 << 16 | 1), U(10000 << 32 | 1)
PAIRS, FOURS = U(0x00FF00FF00FF00FF), U(0x0000FFFF0000FFFF)
HALF, SEVEN_BYTES, HUNDRED_MILLION = U(32), U(56), U(10**8)


def instruction(function: Callable[..., Any]) -> Any:
    """An instruction of LLVM's that numba has no word for."""
    return intrinsic(function)


@instruction
def _word(_: Any, text: Any, at: Any) -> Any:
    """Eight bytes from byte `at`, the first in the lowest place."""

    def load(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        place = builder.bitcast(
            builder.gep(arguments[0], [arguments[1]]), ir.IntType(64).as_pointer()
        )
        return builder.load(place, align=1)

    return types.uint64(text, at), load


@instruction
def _guessed(_: Any, at: Any) -> Any:
    """`at` itself, in a way that the compiler cannot see through, so that the branch around it
    stays one.

    The processor guesses a branch and goes on; without one it would wait for every sign to know
    where the next number starts.
    """

    def same(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        return builder.asm(
            ir.FunctionType(ir.IntType(64), [ir.IntType(64)]),
            "",
            "=r,0",
            arguments,
            side_effect=True,
        )

    return types.uint64(at), same


@inlined
def _farther(word: Any, m: Any) -> Any:
    """The bytes of the last word (0) or the one before (1) that are over `m` from the end."""
    whole = EIGHT * (word + ONE)
    if whole <= m:
        return ZERO
    return (ONE << EIGHT * (whole - m)) - ONE if whole - m < EIGHT else ~ZERO


@inlined
def _keep(
    layouts: Any, column: Any, size: Any, length: Any, down: Any, pointed: Any, stop: Any
) -> None:
    """Keep the layout of a number of so many characters, `down` digits behind the point, if any."""
    layouts[column + LENGTH] = length
    layouts[column + DOWN] = down
    layouts[column + STOP] = stop
    # both words, and the character behind, shall lie within the text
    layouts[column + ROOM] = size - length - SIXTEEN if size > length + SIXTEEN else ZERO
    for word in (ZERO, ONE):
        inside = ~_farther(word, length)
        ahead = inside & _farther(word, down + ONE) if pointed else ZERO
        point = inside & _farther(word, down) ^ ahead if pointed else ZERO
        base = column + UPPER * word
        layouts[base + OWN] = inside
        layouts[base + BLANK] = ZEROS ^ point & TO_POINT
        layouts[base + LIFT] = LIFT_TEN + (point & LIFT_ONE)
        layouts[base + AHEAD] = ahead


@inlined
def _whole(digits: Any) -> Any:
    """The whole number of eight digits, one a byte, the first in the lowest."""
    digits = digits * TWO_DIGITS >> EIGHT
    digits = (digits & PAIRS) * TWO_PAIRS >> SIXTEEN
    return (digits & FOURS) * TWO_FOURS >> HALF


@inlined
def _alike(text: Any, end: Any, layouts: Any, column: Any) -> Any:
    """The mantissa of the number that ends before byte `end`, and whether that has the column's
    layout and is exact.

    What is left of a digit is 0 to 9, of the point 0, and the digits before the point then move up
    over it.
    """
    low = (_word(text, end - EIGHT) ^ layouts[column + BLANK]) & layouts[column + OWN]
    wrong = low + layouts[column + LIFT] | low
    ahead = low & layouts[column + AHEAD]
    low = low ^ ahead | ahead << EIGHT
    if layouts[column + LENGTH] <= EIGHT:
        return _whole(low), wrong & LIFTED == ZERO
    upper = column + UPPER
    high = (_word(text, end - SIXTEEN) ^ layouts[upper + BLANK]) & layouts[upper + OWN]
    wrong = wrong | high + layouts[upper + LIFT] | high
    ahead = high & layouts[upper + AHEAD]
    mantissa = _whole(high ^ ahead | ahead << EIGHT) * HUNDRED_MILLION + _whole(
        low | ahead >> SEVEN_BYTES
    )
    return mantissa, wrong & LIFTED == ZERO and mantissa <= EXACT


@inlined
def _number(text: Any, size: Any, at: Any, layouts: Any, column: Any, powers: Any) -> Any:
    """The number that starts at byte `at`, and the byte behind it: 0 where it is not plain."""
    negative = U(text[at]) == MINUS
    if negative:
        at = _guessed(at + ONE)
    end = at + layouts[column + LENGTH]
    if at - SIXTEEN < layouts[column + ROOM] and U(text[end]) == layouts[column + STOP]:
        mantissa, alike = _alike(text, end, layouts, column)
        if alike:
            value = np.float64(np.int64(mantissa)) / powers[layouts[column + DOWN]]
            return -value if negative else value, end
    begin, mantissa, down = at, ZERO, ZERO
    digit = U(text[at]) - ZERO_DIGIT  # wraps below "0", so one comparison tells a digit
    while digit <= NINE:
        mantissa = mantissa * TEN + digit
        at = at + ONE
        digit = U(text[at]) - ZERO_DIGIT
    digits = at - begin
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
        length = at - begin
        if length <= SIXTEEN:
            _keep(layouts, column, size, length, down, length != digits, byte)
        value = np.float64(np.int64(mantissa)) / powers[down]
        return -value if negative else value, at
    return np.nan, ZERO


@inlined
def _skip(text: Any, at: Any, cells: Any) -> Any:
    """The byte behind the comma of the last of so many cells, 0 where there are fewer. A quote may
    hide a comma; a NUL is damage.
    """
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


def scan(
    text: Any,
    size: Any,
    at: Any,
    before: Any,
    between: Any,
    after: Any,
    first: Any,
    second: Any,
    room: Any,
    pair: Any,
    powers: Any,
    layouts: Any,
) -> Any:
    """Fill `first` and `second` with a number each from every row of `text` behind byte `at`;
    returns the rows, or `IRREGULAR`.

    Arrays are bare pointers: `text` has `size` bytes, `first` and `second` have `room` numbers,
    `powers` those of ten, `layouts` 32 zeros at first. Rows end in a newline and have so many cells
    `before`, `between` and `after` those two. Only the first is read unless `pair` is 1. The two
    have code of their own, since the processor learns the length of each one's numbers.
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
            at = _skip(text, at, before)
            if at == ZERO:
                return IRREGULAR
        value, at = _number(text, size, at, layouts, ZERO, powers)
        if at == ZERO:
            return IRREGULAR
        first[row] = value
        if pair != ZERO:
            if U(text[at]) != COMMA:
                return IRREGULAR
            at = at + ONE
            if between != ZERO:
                at = _skip(text, at, between)
                if at == ZERO:
                    return IRREGULAR
            value, at = _number(text, size, at, layouts, SECOND_COLUMN, powers)
            if at == ZERO:
                return IRREGULAR
            second[row] = value
        if after != ZERO:
            if U(text[at]) != COMMA:
                return IRREGULAR
            at = _skip(text, at + ONE, after - ONE)
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


_BYTES: Any = types.CPointer(types.uint8)
_NUMBERS: Any = types.CPointer(types.float64)
_WORDS: Any = types.CPointer(types.uint64)
_SCAN: Any = types.int64(
    _BYTES, *(types.uint64,) * 5, _NUMBERS, _NUMBERS, types.uint64, types.uint64, _NUMBERS, _WORDS
)
#: What `nearlift.native` compiles.
KERNELS: dict[str, object] = {"scan": (scan, _SCAN, {})}
