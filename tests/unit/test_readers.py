"""Readers: every road to the same bits, damage named, nothing read outside the folder."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import BUILT_IN, csv_trial, reader, readers, scanner, table

from .manifests import manifest


def parse(
    text: str | bytes, *, compiled: bool = True, time: str | None = None
) -> tuple[np.ndarray, np.ndarray | None, tuple[str, ...]]:
    with pytest.MonkeyPatch.context() as patched:
        if not compiled:
            patched.setattr(scanner, "scan", lambda *_: None)
        return csv_trial.parse(
            text if isinstance(text, bytes) else text.encode(), "t.csv", "force", time
        )


# ---- CSV


@pytest.mark.parametrize("compiled", [False, True])
def test_columns_are_found_by_name(compiled: bool) -> None:
    force, time, codes = parse(
        "note,t,force\nx,0.000,1.5\ny,0.001,-2.25e1\n", compiled=compiled, time="t"
    )
    np.testing.assert_array_equal(force, [1.5, -22.5])
    assert time is not None
    np.testing.assert_array_equal(time, [0.0, 0.001])
    assert codes == ()


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(
    "text",
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
def test_harmless_dialects(text: str, compiled: bool) -> None:
    np.testing.assert_array_equal(parse(text, compiled=compiled)[0], [1.0, 2.0])


@settings(max_examples=300)
@given(
    st.lists(
        st.one_of(
            st.floats(allow_nan=False, allow_infinity=False).map(repr),
            st.integers(-(10**18), 10**18).map(str),
            st.decimals(-1000, 1000, places=4).map(str),
        ),
        min_size=1,
    )
)
def test_all_roads_give_the_bits_of_float(texts: list[str]) -> None:
    want = np.array([float(t) for t in texts])
    content = ("force\n" + "\n".join(texts) + "\n").encode()
    roads = [
        scanner.scan(content, 6, 1, [0]),
        table._by_arrow(content[6:], 1, [0], table.COMMAS),
        table._explained(content[6:], "t.csv", 2, ["force"], [0], table.COMMAS),
    ]
    assert roads[1] is not None
    for road in roads:
        if road is not None:
            np.testing.assert_array_equal(road[0].view(np.int64), want.view(np.int64))


def test_the_scanner_takes_what_loggers_write() -> None:
    content = b"t,force\n" + b"".join(
        b"%.3f,%.4f\n" % (i / 1000, 123.4567 * np.sin(i)) for i in range(1000)
    )
    assert scanner.scan(content, 8, 2, [1, 0]) is not None


@pytest.mark.parametrize("word", ["nan", "NaN", "OVER", "#NV", "1.#INF", "-1.#IND", "inf", ""])
def test_no_number_is_nan_and_counted_later(word: str) -> None:
    force, _, codes = parse(f"t,force\n0,1\n1,{word}\n2,3\n")
    np.testing.assert_array_equal(force, [1, np.nan, 3])
    assert codes == ()


def test_a_quote_may_stand_for_inches() -> None:
    assert parse('force,prop\n1,5" prop\nOVER,5" prop\n')[0].tolist()[0] == 1


@pytest.mark.parametrize(
    ("text", "force", "codes"),
    [
        (b"", [], ("EMPTY",)),
        (b"\0\0\0", [], ("EMPTY",)),
        (b"force\n", [], ("NO_DATA",)),
        (b"force\n\n\n", [], ("NO_DATA",)),
        (b"forc", [], ("NO_DATA", "truncated")),
        (b"force\n1\n2\n3", [1, 2], ("truncated",)),
        (b"force\n1\n2\n3.1\0\0\0\0", [1, 2], ("truncated",)),
        (b"force\n1\n2\n\0\0\0\0", [1, 2], ("truncated",)),
        (b"force\n12", [], ("truncated", "NO_DATA")),
    ],
)
def test_half_written_files(text: bytes, force: list[float], codes: tuple[str, ...]) -> None:
    got, _, found = parse(text)
    np.testing.assert_array_equal(got, force)
    assert found == codes


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("force\n1\n2x\n3\n", r"t\.csv, line 3: '2x' in column 'force' is not a number"),
        ("force\n1\n1_000\n", "line 3: '1_000'"),
        ("force\n1\n0x10\n", "line 3: '0x10'"),
        ('t,force\n0,"1,5"\n', "line 2: '1,5'.*\n  write decimals with a point"),
        ("t,force\n0,1,5\n", "line 2: has 3 cells under 2 column names"),
        ("t,force\n0,1\n1\n", "line 3: has 1 cells under 2 column names"),
        ("t;force\n0;1\n", "line 1: is not separated by commas"),
        ("0,1\n1,2\n", "line 1: holds numbers where the columns' names should stand"),
        ("t,forze\n0,1\n", "line 1: no column 'force'\n  records.force.column = \"forze\"?"),
        ("t,lift\n0,1\n", "no column 'force'\n  it has 't', 'lift'"),
        ("force,force\n0,1\n", "more than one column 'force'"),
        ("force\n1\nforce\n2\n", "line 3: repeats the header"),
        ("t,force\ns,mN\n0,1\n", "line 2: 'mN' in column 'force' is not a number"),
        ("force\n1\n\0\n2\n", "line 3: holds NUL bytes"),
        ('force\n1\n"3\n0"\n', "line 3: is not a row of cells: unexpected end of data"),
        ('t,force\n0,1\n1,"3\r\n0"\n', "line 3: is not a row of cells: unexpected end of data"),
    ],
)
def test_the_first_bad_line_is_named(text: str, match: str, compiled: bool) -> None:
    with pytest.raises(InputRefused, match=match):
        parse(text, compiled=compiled)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("force\n1\n".encode("utf-16"), "UTF-16"),
        (b"kr\xe4fte,force\n1,1\n", "line 1: is not UTF-8"),
        (b"x,force\na,1\n\xe4,2x\n", "line 3: is not UTF-8"),
    ],
)
def test_other_encodings_are_refused(text: bytes, match: str) -> None:
    with pytest.raises(InputRefused, match=match):
        parse(text)


def test_sign_calibration_and_clock(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("ms,counts\n0,130\n5,140\n")
    force = {
        "column": "counts",
        "unit": "count",
        "sign": -1,
        "calibration": {"gain": "2 mN/count", "offset": "120 count"},
    }
    given = manifest(
        records={"files": "{trial}.csv", "force": force, "time": {"column": "ms", "unit": "ms"}}
    )
    (record,) = reader("csv").read(given, tmp_path, ["a"])
    np.testing.assert_allclose(record.force_N, [-0.02, -0.04])
    np.testing.assert_allclose(record.time_s, [0, 0.005])
    assert record.source == "a.csv"


def test_the_plan_leaves_out_what_is_not_there(tmp_path: Path) -> None:
    for trial in "ac":
        (tmp_path / f"{trial}.csv").write_text("force\n1\n")
    given = manifest(records={"files": "{trial}.csv"})
    assert [r.trial for r in reader("csv").read(given, tmp_path, ["a", "b", "c"])] == ["a", "c"]
    assert [p.name for p in reader("csv").files(given, tmp_path, ["a", "b", "c"])] == [
        "a.csv",
        "c.csv",
    ]


@settings(max_examples=150)
@given(
    st.lists(
        st.one_of(st.integers(-(10**9), 10**9), st.integers(-3000, 3000)), min_size=20, max_size=30
    ),
    st.integers(0, 15),
    st.sampled_from(["{}\n", "{}\r\n", "7,{}\n", "{},x\n"]),
    st.integers(0, 10**6),
    st.sampled_from('x ;+e/:".,-\n0\0'),
)
def test_numbers_laid_out_like_the_one_above_are_those_of_the_strict_reader(
    numbers: list[int], down: int, row: str, place: int, damage: str
) -> None:
    """Columns as loggers print them, to eight characters, to sixteen and beyond, with other layouts
    between; then the same with one byte spoilt.
    """
    texts = [f"{n / 997:.{down}f}" if n % 7 else f"{n // 7}." for n in numbers]
    header = "force" if row[:3] in ("{}\n", "{}\r") else "t,force" if row[0] == "7" else "force,t"
    content = f"{header}\n{''.join(map(row.format, texts))}".encode()
    found = parse(content)[0]
    np.testing.assert_array_equal(
        found.view(np.int64), np.array([float(t) for t in texts]).view(np.int64)
    )
    place = len(header) + 1 + place % (len(content) - len(header) - 2)
    spoilt = content[:place] + damage.encode() + content[place + 1 :]
    assert told(spoilt, compiled=True) == told(spoilt, compiled=False)


def told(content: bytes, *, compiled: bool) -> tuple[bytes, tuple[str, ...]] | str:
    """The bits that a reader finds, or its refusal."""
    try:
        force, _, codes = parse(content, compiled=compiled)
    except InputRefused as refusal:
        return str(refusal)
    return force.tobytes(), codes


def test_a_record_keeps_its_samples_when_the_next_is_read(tmp_path: Path) -> None:
    for trial, shift in (("a", 0.0), ("b", 1.0)):
        (tmp_path / f"{trial}.csv").write_text(
            "t,force\n" + "".join(f"{i / 1000:.3f},{shift + i:.4f}\n" for i in range(50))
        )
    given = manifest(records={"files": "{trial}.csv", "time": {"column": "t", "unit": "s"}})
    first, second = reader("csv").read(given, tmp_path, ["a", "b"])
    np.testing.assert_allclose(second.force_N - first.force_N, 1e-3)
    assert first.time_s is not None
    np.testing.assert_array_equal(first.time_s, np.arange(50) / 1000)


# ---- what may be read at all


def test_nothing_outside_the_folder_is_read(tmp_path: Path) -> None:
    root = tmp_path / "campaign"
    root.mkdir()
    (tmp_path / "secret.csv").write_text("force\n1\n")
    (root / "linked.csv").symlink_to(tmp_path / "secret.csv")
    (root / "loop.csv").symlink_to(root / "loop.csv")
    (root / "folder.csv").mkdir()
    os.mkfifo(root / "pipe.csv")
    given = manifest(records={"files": "{trial}.csv"})
    for trial, match in (
        ("linked", "leads outside"),
        ("loop", "loop of symbolic links"),
        ("folder", "not a regular file"),
        ("pipe", "not a regular file"),
    ):
        with pytest.raises(InputRefused, match=match):
            reader("csv").files(given, root, [trial])
    with pytest.raises(InputRefused, match="leads outside"):
        reader("csv").files(manifest(records={"files": "../{trial}.csv"}), root, ["secret"])
    with pytest.raises(ManifestError, match="cannot stand in a file name"):
        reader("csv").files(given, root, ["../secret"])


def test_a_link_within_the_folder_is_followed(tmp_path: Path) -> None:
    (tmp_path / "real.csv").write_text("force\n1\n")
    (tmp_path / "a.csv").symlink_to(tmp_path / "real.csv")
    assert (
        len(reader("csv").files(manifest(records={"files": "{trial}.csv"}), tmp_path, ["a"])) == 1
    )


@pytest.mark.parametrize(
    "pattern",
    [
        "trials/{trial}.csv",
        "{trial}.csv",
        "{trial}/force.csv",
        "{trial}/{trial}.csv",
        "[{trial}].csv",
    ],
)
@pytest.mark.parametrize("name", ["csv", "text"])
def test_a_record_without_a_row_is_told(tmp_path: Path, pattern: str, name: str) -> None:
    for trial in ("a", "b", "c-1", "d"):
        path = tmp_path / pattern.replace("{trial}", trial)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("t,force\n0,1\n1,2\n")
    chosen = manifest(
        records={
            "reader": name,
            "files": pattern,
            "force": {"column": "force", "unit": "mN", "sign": 1},
        }
    )
    (note,) = reader(name).plan(chosen, tmp_path, ["b", "d", "elsewhere"]).notes
    assert note.startswith(f"{pattern.replace('{trial}', 'a')} and 1 more are no trial's record")
    assert reader(name).plan(chosen, tmp_path, ["a", "b", "c-1", "d"]).notes == ()


def test_a_pattern_without_the_trial_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ManifestError, match=r"write \{trial\} in it"):
        reader("csv").files(manifest(records={"files": "all.csv"}), tmp_path, ["a"])


def test_an_unknown_reader_gets_the_nearest_name() -> None:
    with pytest.raises(ManifestError, match="did you mean 'parquet'"):
        reader("parket")
    assert [r.name for r in readers()[: len(BUILT_IN)]] == list(BUILT_IN)
