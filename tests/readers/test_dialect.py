"""The dialect of a text: one fits, or the file is refused with its line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.readers.reading import read

from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import dialect, table, text
from nearlift.readers.dialect import Dialect, NoNames, sniff


def layout(content: str | bytes, said: Dialect = dialect.UNSTATED) -> table.Layout:
    whole = content if isinstance(content, bytes) else content.encode()
    plain = text.plain(whole, "f.txt", said)
    return sniff(plain.lines, "f.txt", plain.said)


@pytest.mark.parametrize(
    ("content", "names", "separator", "decimal", "spoken"),
    [
        ("t,F\n1,5\n2,5\n", ("t", "F"), ",", ".", ""),
        ("t,F\r\n1.5,5\r\n", ("t", "F"), ",", ".", ""),
        ("t\tF\r0\t1\r1\t2\r", ("t", "F"), "\t", ".", "separated by tabs"),
        ("t;F\n1;5\n2;7,5\n", ("t", "F"), ";", ",", "separated by semicolons, decimal commas"),
        ("a b\n1 2\n 3  4\n", ("a", "b"), " ", ".", "separated by blanks"),
        ("F\n1\n2\n", ("F",), "", ".", ""),
        ("force\n1,5\n2,25\n", ("force",), "", ",", "decimal commas"),
        ("a,b,\n1,2,\n3,4,\n", ("a", "b"), ",", ".", ""),
        ("a,b\n1,2,\n3,4,\n", ("a", "b"), ",", ".", ""),
        # as spreadsheets save a sheet that was wider once
        ("a,b,,,\n1,2,,,\n3,,,,\n", ("a", "b"), ",", ".", ""),
        ("# a log\nrate: 1000\nt,F\n0,1\n", ("t", "F"), ",", ".", ""),
        ("# t,F\n0,1\n", ("t", "F"), ",", ".", ""),
        ('"t, s",F\n0,1\n', ("t, s", "F"), ",", ".", ""),
        ("t,F\n0,OVER\n1,#NV\n2,3\n", ("t", "F"), ",", ".", ""),
    ],
)
def test_one_dialect_fits(
    content: str, names: tuple[str, ...], separator: str, decimal: str, spoken: str
) -> None:
    found = layout(content)
    assert (found.names, found.separator, found.decimal) == (names, separator, decimal)
    assert found.spoken == spoken


@pytest.mark.parametrize(
    ("content", "match"),
    [
        ("1,5\n2,5\n", "line 1: has no columns' names above .*\n  name them: dialect = { columns"),
        ("966\n965\n", 'its rows of 1 cell\n  name them: dialect = { columns = \\["force"\\] }'),
        ("t,F\n0,5,1,5\n", "line 2: has 4 cells under 2 column names\n  a decimal comma splits a"),
        ("t;F\n1,234;5,678\n", "line 2: '1,234' may be 1.234 or 1234\n  say which: .*thousands"),
        ("a;b\n1;2\n3;x\n", "line 3: 'x' in column 'b' is not a number"),
        ("a,a\n1,2\n", "line 1: has more than one column 'a'"),
        ("t,F\n2,3\nt,F\n4,5\n", "line 3: repeats the header"),
        ("t,F\n2,3\n4\n5,6\n", "line 3: has 1 cells under 2 column names"),
        ("t,F\n2,3\n\nt,F,T\n4,5,6\n", "line 4: has 3 cells under 2 column names\n.* of its own"),
        ("a table\n-;-\n2;3\n4;5\n", "line 2: has more than one column '-'"),
        (b"\x1f\x8b\x08\x00abc", "is compressed\n  unpack it"),
        (b"t,F\n1,2\n\0\0\0\0\0\0 3,4\n", "line 3: holds NUL bytes"),
        (b"\xff\xfet\x00,", "holds no row of numbers"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_line(content: str | bytes, match: str) -> None:
    with pytest.raises(InputRefused, match=match):
        layout(content)


FORCES = ("Force 1", "Force 2", "Force 3")


@pytest.mark.parametrize(
    ("content", "names", "units", "first"),
    [
        # a row of units
        ("Zeit;Kraft\n[s];[gf]\n0,1;2,5\n", ("Zeit", "Kraft"), ("s", "gf"), 3),
        ("Zeit;Drehzahl;Kraft\ns;U/min;gf\n0,1;50,5;2,5\n", ("Zeit", "Drehzahl", "Kraft"), ("s", "rpm", "gf"), 3),
        ("t;state;F\ns;;gf\n0;1;2\n", ("t", "state", "F"), ("s", "", "gf"), 3),
        ("z,Thrust,\n[mm],mean [gf],sd [gf]\n5,20,1\n", ("z [mm]", "Thrust mean [gf]", "Thrust sd [gf]"), ("mm", "gf", "gf"), 3),
        ("force\nOVER\n1\n", ("force",), ("",), 2),
        # numbers under a merged cell
        ("Force,,\n1,2,3\n4,5,6\n", FORCES, ("", "", ""), 3),
        ("Time,Force,,\n,1,2,3\n0.1,4,5,6\n", ("Time", *FORCES), ("", "", "", ""), 3),
        ("Time,Force,,\ns,1,2,3\n0.1,4,5,6\n", ("Time [s]", *FORCES), ("s", "", "", ""), 3),
        ("Time,Force,,\n,1,2,3\ns,N,N,N\n0.1,4,5,6\n", ("Time", *FORCES), ("s", "N", "N", "N"), 4),
        ("t;F [N];\n;4;7\n0,1;2,5;0,3\n", ("t", "F 4 [N]", "F 7 [N]"), ("", "N", "N"), 3),
        ("t [s];A;;B;\n;1;2;1;2\n1;2;3;4;5\n", ("t [s]", "A 1", "A 2", "B 1", "B 2"), ("s", "", "", "", ""), 3),
        # row numbers of pandas and R
        (",t,F\n0,0.1,2\n1,0.2,3\n", ("index", "t", "F"), ("", "", ""), 2),
        ('"","t","F"\n"1",0.1,2\n"2",0.2,3\n', ("index", "t", "F"), ("", "", ""), 2),
        ("  t [s]   F [N]\n 0.1 2\n 0.2 3\n", ("t[s]", "F[N]"), ("s", "N"), 2),
        # names and values above the columns' names
        ("DMM\nSerial,123\nRange,10\n\nNo,F,Unit\n1,2,V dc\n2,3,V dc\n3,4,V dc\n", ("No", "F", "Unit"), ("", "", ""), 6),
        ("Devices\n1000\n,Plate,,\nFrame,Fx,Fy,Fz\n,N,N,N\n1,2,3,4\n2,3,4,5\n", ("Frame", "Fx", "Fy", "Fz"), ("", "N", "N", "N"), 6),
        ('"t","F"\n"0,5","1,25"\n"1,5","2,5"\n', ("t", "F"), ("", ""), 2),
    ],
)  # fmt: skip
def test_headers_as_programs_write_them(
    content: str, names: tuple[str, ...], units: tuple[str, ...], first: int
) -> None:
    shown = layout(content)
    assert (shown.names, shown.units, shown.first) == (names, units, first)


def test_lines_above_numbers_that_are_no_names() -> None:
    for content in ("=~= log of 2026.03.01 =~=\n0.1;2\n0.2;3\n", "Run 5,,\n7,9,4\n8,9,3\n"):
        with pytest.raises(NoNames):
            layout(content)
    with pytest.raises(InputRefused, match=r"has 3 cells under 2 .*\n.*skip = 1, columns"):
        layout("t;F\n1;0.1;2\n2;0.2;3\n")
    with pytest.raises(InputRefused, match="has one sign between cells and in numbers"):
        layout("t,F\n1,2\n", Dialect(separator="comma", decimal=","))


def test_two_readings_are_ambiguous_and_the_manifest_decides() -> None:
    two = "1,5\n2,5\n"
    assert layout(two, Dialect(columns=("a", "b"))).separator == ","
    assert layout(two, Dialect(columns=("F",))).decimal == ","
    assert layout("F;G\n1,234;5,678\n", Dialect(decimal=",")).decimal == ","
    # both separators cut each line in two, at different places
    mixed, columns = "x;1,2\ny;3,4\n", ("who", "force")
    with pytest.raises(InputRefused, match=r"can be read in two ways: separated by semicolons"):
        layout(mixed, Dialect(columns=columns))
    assert layout(mixed, Dialect(columns=columns, separator="semicolon")).decimal == ","


@pytest.mark.parametrize(
    ("said", "match"),
    [
        ({"seperator": ";"}, "did you mean 'separator'"),
        ({"skip": True}, "True is no int"),
        ({"skip": -1}, "-1 is negative"),
        ({"columns": ["a", 1]}, "holds more than texts"),
        ({"columns": ["a"], "units": ["s", "N"]}, "has not one for each column"),
        ({"decimal": "'"}, "is neither"),
        ({"thousands": "0"}, "is no sign between thousands"),
        ({"thousands": ".", "decimal": "."}, "is the decimal sign as well"),
        ({"encoding": "utf-99"}, "is no encoding"),
    ],
)
def test_a_dialect_is_checked(tmp_path: Path, said: dict[str, Any], match: str) -> None:
    with pytest.raises(ManifestError, match=match):
        read(tmp_path, "t;F\n1;2\n", said)
