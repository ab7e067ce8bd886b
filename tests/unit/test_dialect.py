"""The sniffer: one dialect fits, or the file is refused; and what was sniffed is held to for the
rest of the file.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nearlift.errors import InputRefused
from nearlift.readers import dialect, table, text
from nearlift.readers.dialect import HEAD, NoRows, sniff
from nearlift.readers.layout import Given


def layout(content: str | bytes, given: Given | None = None) -> Any:
    return sniff(
        content if isinstance(content, bytes) else content.encode(), "f.txt", given or Given()
    )


def read(tmp_path: Path, content: bytes, dialect: Any = None, names: Any = None) -> Any:
    path = tmp_path / "f.txt"
    path.write_bytes(content)
    return text.contents(path, dialect or {}, names)


@pytest.mark.parametrize(
    ("content", "names", "separator", "decimal", "spoken"),
    [
        ("t,F\n1,5\n2,5\n", ("t", "F"), ",", ".", ""),
        ("t,F\r\n1.5,5\r\n", ("t", "F"), ",", ".", ""),
        ("t\tF\r0\t1\r1\t2\r", ("t", "F"), "\t", ".", "separated by tabs"),
        ("t;F\n1,5;2,25\n", ("t", "F"), ";", ",", "separated by semicolons, decimal commas"),
        ("t;F\n1;5\n2;7,5\n", ("t", "F"), ";", ",", "separated by semicolons, decimal commas"),
        ("a b\n1 2\n 3  4\n", ("a", "b"), " ", ".", "separated by blanks"),
        ("F\n1\n2\n", ("F",), "", ".", ""),
        ("force\n1,5\n2,25\n", ("force",), "", ",", "decimal commas"),
        ("a,b,\n1,2,\n3,4,\n", ("a", "b"), ",", ".", "a separator at the end of every line"),
        ("a,b\n1,2,\n3,4,\n", ("a", "b"), ",", ".", "a separator at the end of every line"),
        (
            "# a log\nrate: 1000\nt,F\n0,1\n",
            ("t", "F"),
            ",",
            ".",
            "2 lines above the columns' names left out",
        ),
        ("# t,F\n0,1\n", ("t", "F"), ",", ".", ""),
        ('"t, s",F\n0,1\n', ("t, s", "F"), ",", ".", ""),
        ("t,F\n0,OVER\n1,#NV\n2,3\n", ("t", "F"), ",", ".", ""),
    ],
)
def test_one_dialect_fits(
    content: str, names: tuple[str, ...], separator: str, decimal: str, spoken: str
) -> None:
    found = layout(content)
    assert (found.names, found.cells.separator, found.cells.decimal, found.spoken()) == (
        names,
        separator,
        decimal,
        spoken,
    )


@given(st.data())
def test_the_first_lines_give_the_dialect_that_all_lines_give(data: st.DataObject) -> None:
    separator = data.draw(st.sampled_from("\t;,| "))
    number = st.sampled_from(["1", "12", "1.5", "2,5", "1,234", "nan", "", "-3e2", "x"])
    usual = data.draw(
        st.lists(number, min_size=1, max_size=3).map(lambda cells: separator.join(cells))
    )
    header = separator.join("abc"[: usual.count(separator) + 1])
    lines = ["a log"] * data.draw(st.sampled_from([0, 2, 85, 120])) + [header] + [usual] * 150
    for at in data.draw(st.lists(st.integers(0, len(lines) - 1), max_size=4)):
        lines[at] = separator.join(data.draw(st.lists(number, min_size=1, max_size=3)))

    def answer() -> object:
        try:
            return layout("\n".join([*lines, ""]))
        except InputRefused as refusal:
            return str(refusal)

    quick = answer()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(dialect, "SHORT", 10**9)
        assert answer() == quick


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (
            "1,5\n2,5\n",
            (
                "line 1: has no columns' names above its rows of . cells?\n  name them: dialect = {"
                " columns"
            ),
        ),
        (
            "966\n965\n",
            (
                "has no columns' names above its rows of 1 cell\n  name them: dialect = { columns"
                ' = \\["force"\\] }'
            ),
        ),
        (
            "t,F\n0,5,1,5\n",
            "line 2: has 4 cells under 2 column names\n  a decimal comma makes two cells of one",
        ),
        (
            "t;F\n1,234;5,678\n",
            "line 2: '1,234' may be 1.234 or 1234\n  say which: dialect = { decimal = \",\" }",
        ),
        ("a;b\n1;2\n3;x\n", "line 3: 'x' in column 'b' is not a number"),
        ("a,a\n1,2\n", "line 1: has more than one column 'a'"),
        ("t,F\n2,3\nt,F\n4,5\n", "line 3: repeats the header"),
        ("t,F\n2,3\n4\n5,6\n", "line 3: has 1 cells under 2 column names"),
        (b"\x1f\x8b\x08\x00abc", "is compressed\n  unpack it"),
        (b"PK\x03\x04abc", "is compressed"),
        (b"t,F\n1,2\n\0\0\0\0\0\0 3,4\n", "is no text: it holds NUL bytes"),
        (b"\xff\xfet\x00,", "holds no row of numbers"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_line(content: str | bytes, match: str) -> None:
    with pytest.raises(InputRefused, match=match):
        layout(content)


def test_two_readings_are_ambiguous_and_the_manifest_decides() -> None:
    two = "1,5\n2,5\n"
    named = Given(columns=("a", "b"))
    assert layout(two, named).cells.separator == ","
    assert layout(two, Given(columns=("F",))).cells.decimal == ","
    both = "F;G\n1,234;5,678\n"
    assert layout(both, Given(decimal=",")).cells.decimal == ","
    # both separators cut each line in two, at different places
    mixed, named = "x;1,2\ny;3,4\n", Given(columns=("who", "force"))
    with pytest.raises(
        InputRefused,
        match=(
            r"can be read in two ways: separated by semicolons with decimal comma or commas with"
            r" decimal point"
        ),
    ):
        layout(mixed, named)
    assert (
        layout(mixed, Given(columns=("who", "force"), separator="semicolon")).cells.decimal == ","
    )


@pytest.mark.parametrize(
    "encoding",
    ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "latin-1", "cp1252"],
)
def test_every_usual_encoding(tmp_path: Path, encoding: str) -> None:
    sign = "\u2013" if encoding == "cp1252" else "\u00b5"
    content = f"t ({sign}s);Kraft [mN]\r\n0,5;1,25\r\n1,5;-2,75\r\n".encode(encoding)
    found = read(tmp_path, content)
    assert [c.name for c in found.channels] == [f"t ({sign}s)", "Kraft [mN]"]
    assert found.channels[1].unit == "mN"
    assert found.channels[1].values.tolist() == [1.25, -2.75]
    assert found.notes[0].startswith("text read as ")


def test_a_row_of_units_and_text_columns(tmp_path: Path) -> None:
    found = read(tmp_path, b"t,msg,F\ns,-,mN\n0,start,1\n1,,2\n")
    assert [(c.name, c.unit) for c in found.channels] == [("t", "s"), ("F", "mN")]


def test_words_for_no_number_become_gaps(tmp_path: Path) -> None:
    found = read(tmp_path, b"t;F\n0,0;1,5\n0,1;OVER\n0,2;#NV\n0,3;1.#INF\n0,4;2,5\n")
    np.testing.assert_array_equal(found.channels[1].values, [1.5, np.nan, np.nan, np.nan, 2.5])


def test_a_header_alone_is_no_data_and_an_empty_file_empty(tmp_path: Path) -> None:
    assert read(tmp_path, b"t,F\n").codes == ("NO_DATA",)
    assert read(tmp_path, b"t,F").codes == ("NO_DATA", "truncated")
    assert read(tmp_path, b"").codes == ("EMPTY",)
    assert read(tmp_path, b"\0" * 50).codes == ("EMPTY",)
    with pytest.raises(NoRows, match="holds no row of numbers"):
        read(tmp_path, b"so\nmuch\nfor\nthat\n")


@pytest.mark.parametrize("tail", [b"3,4", b"3,45\0\0\0\0\0", b"\0\0\0\0"])
def test_a_last_line_without_an_end_is_left_out(tmp_path: Path, tail: bytes) -> None:
    """Cut in the middle of a number, or with the NUL tail of a power cut: what is read is what was
    whole.
    """
    found = read(tmp_path, b"t,F\n1,2\n2,3\n" + tail)
    assert found.codes == ("truncated",)
    assert found.channels[1].values.tolist() == [2, 3]


def test_utf16_cut_within_a_character(tmp_path: Path) -> None:
    found = read(tmp_path, "t,F\n1,2\n2,3\n".encode("utf-16")[:-1])
    assert found.codes == ("truncated",)
    assert found.channels[1].values.tolist() == [2]


def test_blocks_give_what_the_whole_gives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    force = np.random.default_rng(1).normal(size=3000).round(6)
    rows = "".join(f"{i};{f}\r\n" for i, f in enumerate(force)).replace(".", ",")
    for encoding in ("utf-8", "utf-16"):
        content = ("t;F\r\n" + rows).encode(encoding)
        for block in (7, 101, 4096):
            monkeypatch.setattr(
                text, "BLOCK", block if len(content) < 10 * HEAD and block > 100 else 997
            )
            found = read(tmp_path, content, names=("F",))
            np.testing.assert_array_equal(found.channels[0].values, force)
            assert found.codes == ()


def test_a_bad_line_far_below_is_named(tmp_path: Path) -> None:
    rows = b"".join(b"%d,%d\n" % (i, i) for i in range(20000))
    with pytest.raises(
        InputRefused, match=r"f\.txt, line 20002: '7x' in column 'F' is not a number"
    ):
        read(tmp_path, b"t,F\n" + rows + b"1,7x\n2,3\n")


def test_a_recipe_reads_what_has_no_header(tmp_path: Path) -> None:
    found = read(tmp_path, b"965\r\n966\r\n", {"columns": ["count"], "units": ["count"]})
    assert (found.channels[0].name, found.channels[0].unit, found.channels[0].values.tolist()) == (
        "count",
        "count",
        [965, 966],
    )
    ramp = b"START\r\n0.02, -0.33\r\n0.04, -0.00\r\nSTOP\r\n"
    found = read(tmp_path, ramp, {"columns": ["thrust", "current"], "ignore": ["START", "STOP"]})
    assert found.channels[0].values.tolist() == [0.02, 0.04]


def test_labelled_cells(tmp_path: Path) -> None:
    found = read(tmp_path, b"T: 0.01 \t C: 0.65\nT: 0.02 \t C: 0.7\n", {"labels": True})
    assert [(c.name, c.values.tolist()) for c in found.channels] == [
        ("T", [0.01, 0.02]),
        ("C", [0.65, 0.7]),
    ]
    with pytest.raises(InputRefused, match="line 2: is labelled T, V, not T, C"):
        read(tmp_path, b"T: 0.01 \t C: 0.65\nT: 0.02 \t V: 0.7\n", {"labels": True})


# ---- what the fuzzer found


def test_a_carriage_return_within_a_header_is_refused() -> None:
    from nearlift.readers.csv_trial import parse

    with pytest.raises(InputRefused, match=r"line 1: is no header: new-line character seen"):
        parse(b"\x00\r,1.:5,1.5\n\n", "f.csv", "force", "t")


def test_a_cell_without_its_label_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputRefused, match=r"line 1: has a cell without a label: 'C0.02'"):
        read(tmp_path, b"T: 0.01 \t C0.02 \t C: 0.7\n", {"labels": True})


@pytest.mark.parametrize(
    ("line", "remedy"),
    [
        ("STOP", 'dialect = { ignore = ["STOP"] }'),
        ("T: 0.01 \t C: 0.65 \t V: 1.48", "dialect = { labels = true }"),
        ("1.5", "no cell may be left out"),
    ],
)
def test_a_line_of_another_kind_is_refused_with_what_would_read_it(line: str, remedy: str) -> None:
    with pytest.raises(InputRefused, match=re.escape(remedy)):
        table.row_of(line, "f, line 3", ["a", "b"], table.COMMAS)


def steps(head: str, marker: str, tail: str = "") -> bytes:
    """What an HX711's sketch writes: each throttle on a line of its own behind a marker."""
    lines = [head]
    for throttle in (1100, 1200, 1300):
        force = [f"{throttle / 10 - 100 + 0.1 * (i % 7):.1f}" for i in range(20)]
        lines += [marker, str(throttle), *force, *([tail] if tail else [])]
    return ("\n".join(filter(None, lines)) + "\n").encode()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (steps("force", "THROTTLE"), {"ignore": ["THROTTLE"]}),
        (steps("", "START", "STOP"), {"ignore": ["START", "STOP"], "columns": ["force"]}),
        (steps("", "START", "STOP"), {"ignore": ["START", "STOP"], "columns": ["force", "n"]}),
    ],
)
def test_throttles_among_forces_are_not_read_in_silence(tmp_path, content, said):
    """What the advice to ignore the markers would do."""
    if len(said.get("columns", ())) == 2:
        content = b"\n".join(
            line + b",7" if line[:1].isdigit() else line for line in content.split()
        )
        content += b"\n"
    with pytest.raises(
        InputRefused, match=r"another kind behind every ignored line: 1100, then 10"
    ):
        read(tmp_path, content, said, ("force",))


def test_blocks_whose_first_number_is_of_their_kind_are_read(tmp_path):
    lines = [b"START", *(b"%d" % (10 + i % 5) for i in range(20)), b"STOP"]
    said = {"ignore": ["START", "STOP"], "columns": ["force"]}
    once = read(tmp_path, b"\n".join([lines[0], b"900", *lines[1:]]) + b"\n", said, ("force",))
    assert len(once.channels[0].values) == 21
    assert len(read(tmp_path, b"\n".join(lines * 4) + b"\n", said).channels[0].values) == 80


def test_labels_that_differ_are_no_text_column(tmp_path):
    content = b"".join(
        b"Throttle: %d\n" % (1000 + 100 * i) + b"Force: 10.1\n" * 9 for i in range(4)
    )
    with pytest.raises(InputRefused, match=r"labels its cells: 'Throttle: 1000'"):
        read(tmp_path, content, {"columns": ["what", "force"]})
    with pytest.raises(InputRefused, match="is labelled Force, not Throttle"):
        read(tmp_path, content, {"labels": True})


def test_a_text_column_may_have_decimal_commas_beside_it(tmp_path):
    found = read(tmp_path, b"side;z;F\nground;5;1,5\nground;10;2,25\n")
    assert [c.name for c in found.channels] == ["z", "F"]
    assert found.channels[1].values.tolist() == [1.5, 2.25]


def test_a_label_between_values_is_what_a_record_is_cut_at(tmp_path):
    content = b"".join(b"Throttle: %d\n" % (10 * i) + b"10.1\n" * 60 for i in range(1, 5))
    with pytest.raises(InputRefused) as refusal:
        read(tmp_path, content)
    assert 'begin = "Throttle: {level}"' in str(refusal.value.remedy)
