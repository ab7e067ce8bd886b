"""Text files: encodings, recipes, cut and damaged files, plain CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.readers.reading import of_trials, plain, put, read, values
from tests.unit.manifests import manifest
from tests.unit.small_run import nearlift

from nearlift.errors import InputRefused
from nearlift.readers import text
from nearlift.readers.dialect import NoRows


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
    assert values(found, 1) == [1.25, -2.75]
    assert found.notes[0].startswith("text read as ")


def test_a_row_of_units_text_columns_and_words_for_no_number(tmp_path: Path) -> None:
    found = read(tmp_path, "t,msg,F\ns,-,mN\n0,start,1\n1,,OVER\n2,,1.#INF\n")
    assert [(c.name, c.unit) for c in found.channels] == [("t", "s"), ("F", "mN")]
    np.testing.assert_array_equal(found.channels[1].values, [1, np.nan, np.nan])
    late = read(tmp_path, "t,F,note\n0,1,\n1,2,gust\n2,3,4\n")
    assert [c.name for c in late.channels] == ["t", "F"]
    beside = read(tmp_path, "side;z;F\nground;5;1,5\nground;10;2,25\n")
    assert {c.name: [*c.values] for c in beside.channels} == {"z": [5, 10], "F": [1.5, 2.25]}


def test_the_dialect_of_one_file_is_tried_on_the_next_and_not_forced_on_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(text, "_earlier", {})
    assert values(read(tmp_path, "t;F\n0;1\n1;2\n"), 1) == [1, 2]
    monkeypatch.setattr(text, "sniff", lambda *_, **__: pytest.fail("sniffed again"))
    assert values(read(tmp_path, "t;F\n0;3\n1;4.5\n"), 1) == [3, 4.5]
    monkeypatch.undo()
    assert values(read(tmp_path, "t;F\n0,5;3,5\n"), 1) == [3.5]
    # a column of words in one file may hold numbers in the next
    assert [c.name for c in read(tmp_path, "t;G\n0;x\n").channels] == ["t"]
    assert [c.name for c in read(tmp_path, "t;G\n0;1\n").channels] == ["t", "G"]
    assert values(read(tmp_path, "\nt;F\n0;7\n"), 1) == [7]
    with pytest.raises(InputRefused, match=r"'1,234' may be 1\.234 or 1234"):
        read(tmp_path, "t;F\n1,234;5,678\n")


@pytest.mark.parametrize(
    ("content", "said", "want"),
    [
        ("t;F\n1;1,234.5\n2;12,345,678\n3;-7.25\n", ",", [1234.5, 12345678, -7.25]),
        ("t;F\n1;1.234,5\n2;999,5\n", ".", [1234.5, 999.5]),
        ("t\tF\n1\t1 234\n2\t2 345.5\n", " ", [1234, 2345.5]),
        ("t;F\n1;1'234e1\n2;OVER\n", "'", [12340, np.nan]),
        ('t,F\n1,"1,234"\n2,"5"\n', ",", [1234, 5]),
        # as typesetters write them
        ("t,F\n1,\N{MINUS SIGN}1234.5\n2,7\n", "", [-1234.5, 7]),
        ("t;F\n1;-1\N{NO-BREAK SPACE}234,5\n2;7\n", " ", [-1234.5, 7]),
        ("t;F\n1;-1\N{NARROW NO-BREAK SPACE}234,5\n2;7\n", " ", [-1234.5, 7]),
    ],
)
def test_signs_between_thousands_are_read_where_they_are_declared(
    tmp_path: Path, content: str, said: str, want: list[float]
) -> None:
    found = read(tmp_path, content, {"thousands": said})
    np.testing.assert_array_equal(found.channels[1].values, want)
    assert not said or "between thousands" in found.notes[0]


def test_groups_that_are_not_of_three_digits_are_no_number(tmp_path: Path) -> None:
    with pytest.raises(InputRefused, match="line 3: '12,34' in column 'F' is not a number"):
        read(tmp_path, "t;F\n1;1,234\n2;12,34\n", {"thousands": ",", "separator": "semicolon"})
    with pytest.raises(InputRefused, match=r"'1,234\.5' .*\n.*thousands = \"\.\.\.\""):
        plain(tmp_path, 'force\n1\n"1,234.5"\n')


@pytest.mark.parametrize("bad", [5, 150, 9000])
@pytest.mark.parametrize("names", [None, ("force",)])
def test_a_bad_number_makes_no_column_of_words(tmp_path: Path, bad: int, names: object) -> None:
    """With decimal commas every force would be a word, as the bad number is."""
    rows = "".join(f"{i};{'7.x' if i == bad else i / 7}\n" for i in range(9100))
    with pytest.raises(InputRefused, match=f"line {bad + 2}: '7.x' in column 'force' is not a"):
        read(tmp_path, "t;force\n" + rows, names=names)


def test_a_column_that_is_not_asked_for_may_hold_anything(tmp_path: Path) -> None:
    content = "t,state,force\n" + "".join(f"{i},{'BAD' if i == 9 else i},2\n" for i in range(20))
    assert values(plain(tmp_path, content)) == [2] * 20
    with pytest.raises(InputRefused, match="line 11: 'BAD' in column 'state' is not a number"):
        read(tmp_path, content)


@pytest.mark.parametrize("by", ["text", "csv"])
def test_a_zeroed_sector_is_named_wherever_it_falls(tmp_path: Path, by: str) -> None:
    """Also within a column that nobody reads, where it makes one line of many."""
    rows = b"".join(b"%d,log entry,%d\n" % (1000 + i, i % 7) for i in range(9000))
    content = b"t,note,force\n" + rows
    assert len(content) > 2 * text.HEAD
    for at in np.random.default_rng(1).integers(text.HEAD, len(content) - 600, 6):
        spoilt = content[:at] + bytes(512) + content[at + 512 :]
        line = content[:at].count(b"\n") + 1
        reading = plain if by == "csv" else lambda *c: read(*c, names=("force",))
        with pytest.raises(InputRefused, match=f"line {line}: holds NUL bytes"):
            reading(tmp_path, spoilt)


def test_a_quote_without_its_other_half_swallows_no_lines(tmp_path: Path) -> None:
    with pytest.raises(InputRefused, match="line 3: is not a row of cells: unexpected end"):
        plain(tmp_path, 'note,force\na,1\n"a,2\nb,3\nc",4\n')
    assert values(plain(tmp_path, 'prop,force\n5" prop,1\n5" prop,OVER\n'))[0] == 1


def test_a_recipe_reads_what_has_no_header(tmp_path: Path) -> None:
    found = read(tmp_path, "965\r\n966\r\n", {"columns": ["count"], "units": ["count"]})
    assert (found.channels[0].unit, values(found)) == ("count", [965, 966])
    ramp = "START\r\n0.02, -0.33\r\n0.04, -0.00\r\nSTOP 2\r\n"
    found = read(tmp_path, ramp, {"columns": ["thrust", "current"], "ignore": ["START", "STOP*"]})
    assert values(found) == [0.02, 0.04]


@pytest.mark.parametrize(
    ("content", "unit"),
    [
        ("t,F\n0,0.123 N\n1,\n2,-1.5 N\n", "N"),
        ("t,F\n0,0.123mN\n1,nan mN\n2,-1.5mN\n", "mN"),
        ("t,F [g]\n0,0.123 g\n1,OVER\n2,-1.5 g\n", "g"),
        ("t;F\n0 s;0,123 N\n1 s;\n2 s;-1,5 N\n", "N"),
        ("t,F\n0:00:00,0.123 N\n0:00:01,ERR\n0:00:02,-1.5 N\n", "N"),
    ],
)
def test_units_in_cells(tmp_path: Path, content: str, unit: str) -> None:
    for names in (None, ("t", "F")):
        clock, force = read(tmp_path, content, names=names).channels
        assert force.unit == unit
        np.testing.assert_array_equal(clock.values, [0, 1, 2])
        np.testing.assert_array_equal(force.values, [0.123, np.nan, -1.5])


def test_units_that_differ_in_a_column_are_refused_with_their_line(tmp_path: Path) -> None:
    for content, line in (
        ("t,F\n0,2 N\n\n1,3 N\n2,12.3 mN\n", "line 5: has '12.3 mN' in column 'F', no number of N"),
        ("t,F\n0,2 N\n1,3\n", "line 3: has '3' in column 'F', no number of N"),
        ("t,F (N)\n0,2 mN\n1,3 mN\n", r"line 2: has '2 mN' in column 'F \(N\)', no number of N"),
    ):
        with pytest.raises(InputRefused, match=line):
            read(tmp_path, content, names=("t", "F"))
        noted = read(tmp_path, content)
        assert [c.name for c in noted.channels] == ["t"]
        assert "is not read: line" in " ".join(noted.notes)
    with pytest.raises(InputRefused, match=r"'1,234' may be 1\.234 or 1234"):
        read(tmp_path, "t;F\n0;1,234 N\n1;2,345 N\n")


def test_what_is_not_read_or_guessed_is_noted(tmp_path: Path) -> None:
    (noted,) = read(tmp_path, "t,Kraft [N],state\n1,0x10,on\n2,0x11,on\n").notes
    assert noted == "column 'Kraft [N]' is not read: '0x10' is neither a number nor a time of day"
    (noted,) = read(tmp_path, "时间,推力\n1,2\n".encode("gbk")).notes
    assert "text read as latin-1: if letters are wrong, state `encoding`" in noted


def test_labelled_cells(tmp_path: Path) -> None:
    found = read(tmp_path, "T: 0.01 \t C: 0.65\nT: 0.02 \t C: 0.7\n", {"labels": True})
    assert {c.name: [*c.values] for c in found.channels} == {"T": [0.01, 0.02], "C": [0.65, 0.7]}
    demo = "HX711 demo\nready\nReading: -1.5 g\nReading: 2.5 g\n"
    (force,) = read(tmp_path, demo, {"labels": True, "skip": 2}).channels
    assert (force.name, force.unit, list(force.values)) == ("Reading", "g", [-1.5, 2.5])
    steps = "".join(f"Throttle: {k}\n" + "Force: 10.1\n" * 9 for k in (1000, 1100, 1200))
    for content, said, match in (
        (
            "T: 0.01 \t C: 0.65\nT: 0.02 \t V: 0.7\n",
            {"labels": True},
            "line 2: is labelled T, V, not",
        ),
        (
            "T: 0.01 \t C: 0.65\nT: 0.02 \t C0.02\n",
            {"labels": True},
            "line 2: is labelled T, C0.02",
        ),
        (demo, {"labels": True}, "line 1: has no label\n.*skip = 1"),
        (steps, {"columns": ["what", "force"]}, "labels its cells: 'Throttle: 1000'"),
    ):
        with pytest.raises(InputRefused, match=match):
            read(tmp_path, content, said)


@pytest.mark.parametrize(
    "content",
    [
        "force\r\n1\r\n2\r\n",
        "\ufeffforce\n1\n2\n",
        'force\n"1"\n2\n',
        "force\n 1 \n+2.\n",
        "force\n1\n\n2\n",
        "a,force,b\n,1,\n,2,\n",
        "force\n1e0\n20E-1\n",
    ],
)
def test_harmless_dialects(tmp_path: Path, content: str) -> None:
    assert values(plain(tmp_path, content)) == [1, 2]


@pytest.mark.parametrize(
    ("content", "force", "codes"),
    [
        (b"\0\0\0", [], ("EMPTY",)),
        (b"force\n", [], ("NO_DATA",)),
        (b"forc", [], ("NO_DATA", "truncated")),
        (b"force\n1\n2\n3", [1, 2], ("truncated",)),
        (b"force\n1\n2\n3.1\0\0\0\0", [1, 2], ("truncated",)),
        (b"force\n1\n2\n\0\0\0\0", [1, 2], ("truncated",)),
        (b"force\n12", [], ("NO_DATA", "truncated")),
        ("force\n1\n2\n".encode("utf-16")[:-1], [1], ("truncated",)),
    ],
)
def test_half_written_files(
    tmp_path: Path, content: bytes, force: list[float], codes: tuple[str, ...]
) -> None:
    for given in (plain(tmp_path, content), read(tmp_path, content)):
        assert given.codes == codes
        assert [x for c in given.channels for x in c.values] == force
    with pytest.raises(NoRows, match="holds no row of numbers"):
        read(tmp_path, "so\nmuch\nfor\nthat\n")


@pytest.mark.parametrize(
    ("content", "match"),
    [
        ("force\n1\n2x\n3\n", r"t\.csv, line 3: '2x' in column 'force' is not a number"),
        ("force\n1\n1_000\n", "line 3: '1_000'"),
        ("force\n1\n0x10\n", "line 3: '0x10'"),
        ('t,force\n0,"1,5"\n', "line 2: '1,5'.*\n  correct the line"),
        ("t;force\n0;1\n1;2\n2;3\n", "line 1: is not parted by commas"),
        ("0,1\n1,2\n", "line 1: has no columns' names above its rows"),
        ("t,forze\n0,1\n", "line 1: has no column 'force'\n  records.force.column = \"forze\"?"),
        ("t,lift\n0,1\n", "has no column 'force'\n  it has 't', 'lift'"),
        ("t,force\n0,1\nvolts,amps\n0,1\n", "line 3: 'amps' in column 'force' is not a number"),
        ("force\n1\n\0\n2\n", "line 3: holds NUL bytes"),
        ('force\n1\n"3\n0"\n', "line 3: is not a row of cells: unexpected end of data"),
        (b"x,force\na,1\n\xe4,2x\n", "line 3: '2x' in column 'force' is not a number"),
    ],
)
def test_the_first_bad_line_is_named(tmp_path: Path, content: str | bytes, match: str) -> None:
    with pytest.raises(InputRefused, match=match):
        plain(tmp_path, content)


def test_sign_calibration_and_clock(tmp_path: Path) -> None:
    put(tmp_path, "ms,counts\n0,130\n5,140\n", "a.csv")
    force = {
        "column": "counts",
        "unit": "count",
        "sign": -1,
        "calibration": {"gain": "2 mN/count", "offset": "120 count"},
    }
    given = manifest(
        records={"files": "{trial}.csv", "force": force, "time": {"column": "ms", "unit": "ms"}}
    )
    (record,) = of_trials("csv", given, tmp_path, ["a"])
    np.testing.assert_allclose(record.force_N, [-0.02, -0.04])
    np.testing.assert_allclose(record.time_s, [0, 0.005])
    assert record.source == "a.csv"


def test_a_clock_of_many_digits_beside_no_force_is_shown(tmp_path: Path) -> None:
    """The clock comes first, and no name is that of a force."""
    rows = "".join(f"{1690000000 + i / 400:.9f},{i % 3},{i % 5}\n" for i in range(200))
    found = nearlift("inspect", put(tmp_path, "stamp,Inst,Val\n" + rows, "log.csv"))
    assert found.exit_code == 0, found.output
    assert "stamp" in found.output
    assert "Val" in found.output
