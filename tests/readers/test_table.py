"""Rows of a text: pyarrow and Python's csv give the same bits, and the first bad line is named."""

from __future__ import annotations

import json
import re

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearlift.errors import InputRefused
from nearlift.readers import table


@pytest.mark.parametrize("line", ["STOP", "T: 0.01 \t C: 0.65 \t V: 1.48", "volts,amps,rpm"])
def test_a_line_of_another_kind_is_refused_with_what_would_leave_it_out(line: str) -> None:
    begin = re.escape(json.dumps(line))
    with pytest.raises(InputRefused, match=f"names\n.* ignore = .{begin}.*own$"):
        table.Layout(names=("a", "b")).row(line, "f, line 3")


@settings(max_examples=200, deadline=None)
@given(
    st.lists(
        st.one_of(
            st.floats(allow_nan=False, allow_infinity=False).map(repr),
            st.integers(-(10**18), 10**18).map(str),
            st.decimals(-1000, 1000, places=4).map(str),
        ),
        min_size=1,
    ),
    st.sampled_from(["", ",", " "]),
)
def test_both_ways_give_the_bits_of_float(texts: list[str], separator: str) -> None:
    want = np.array([float(t) for t in texts])
    names = ("force", "x") if separator else ("force",)
    rows = "".join(t + (f"{separator}7" if separator else "") + "\n" for t in texts)
    one = table.Layout(separator=separator, names=names, first=2)
    lines = table.Lines(body=rows.encode(), where="f", line=2)
    for reading in (table.parse, table.by_line):
        found, _ = reading(lines, one, [0])
        np.testing.assert_array_equal(found[0].view(np.int64), want.view(np.int64))


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.integers(-(10**6), 10**6).map(str), min_size=3, max_size=9),
    st.sampled_from(["{}\n", "{}\r\n", "7,{}\n", "{},x\n"]),
    st.integers(0, 10**6),
    st.sampled_from('x ;+e/:".,-\n0\0'),
)
def test_both_ways_agree_on_damage(texts: list[str], row: str, place: int, damage: str) -> None:
    body = "".join(map(row.format, texts)).replace("\r\n", "\n").encode()
    names = {"{": ("force",), "7": ("t", "force")}[row[0]]
    one = table.Layout(names=("force", "t") if row == "{},x\n" else names, first=2)
    place %= len(body) - 1
    spoilt = body[:place] + damage.encode() + body[place + 1 :]

    def answer(by_csv: bool) -> object:
        wanted = [one.names.index("force")]
        try:
            reading = table.by_line if by_csv else table.parse
            rows = table.Lines(body=spoilt, where="f", line=2)
            return reading(rows, one, wanted)[0][0].tobytes()
        except InputRefused as refusal:
            return str(refusal)

    assert answer(by_csv=False) == answer(by_csv=True)


@pytest.mark.parametrize(("start", "length"), [(0, 5), (1, 3), (2, 1), (1, 0)])
def test_a_null_is_not_a_number_and_its_neighbours_are_themselves(start: int, length: int) -> None:
    whole = pa.array([1.5, None, 3.5, None, 5.5])
    expected = np.array([1.5, np.nan, 3.5, np.nan, 5.5])[start : start + length]
    np.testing.assert_array_equal(table.floats(whole.slice(start, length)), expected)
    np.testing.assert_array_equal(table.floats(pa.array([7, None, -2])), [7, np.nan, -2])
