"""Files of a campaign: those that may be read, packed texts, spreadsheets."""

from __future__ import annotations

import gzip
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.readers.reading import contents, put, records
from tests.unit import written
from tests.unit.manifests import manifest

from nearlift.errors import InputRefused, ManifestError
from nearlift.onboarding.inspection import inspect
from nearlift.onboarding.new import write_from
from nearlift.readers import files, reader
from nearlift.readers.base import pick
from nearlift.schedule import _text_of as text_of


@pytest.mark.parametrize(
    "pattern", ["trials/{trial}.csv", "{trial}.csv", "{trial}/{trial}.csv", "[{trial}].csv"]
)
def test_the_plan_has_what_is_there_and_notes_what_is_no_trials(
    tmp_path: Path, pattern: str
) -> None:
    for trial in ("a", "b", "c-1", "d"):
        put(tmp_path, "force\n1\n", pattern.replace("{trial}", trial))
    chosen = manifest(records={"files": pattern})
    [piece], [note] = reader("csv").plan(chosen, tmp_path, ["b", "d", "elsewhere"])
    assert piece.trials == ("b", "d")
    assert note.startswith(f"{pattern.replace('{trial}', 'a')} and 1 more are no trial's record")
    assert reader("csv").plan(chosen, tmp_path, ["a", "b", "c-1", "d"])[1] == []


def test_a_link_within_the_folder_is_followed_and_a_pattern_has_the_trial(tmp_path: Path) -> None:
    (tmp_path / "a.csv").symlink_to(put(tmp_path, "force\n1\n", "real.csv"))
    assert reader("csv").places(manifest(records={"files": "{trial}.csv"}), tmp_path, ["a"])
    with pytest.raises(ManifestError, match=r"write \{trial\} in it"):
        reader("csv").places(manifest(records={"files": "all.csv"}), tmp_path, ["a"])


FORCE = [float(f) for f in np.round(np.random.default_rng(1).normal(100, 3, 60), 2)]
ANY = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def test_a_file_whose_places_name_two_trials_is_no_record(tmp_path: Path) -> None:
    for folder, name in (("a", "a"), ("a", "b")):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / f"{name}.csv").write_text("force\n1\n")
    (note,) = files.unlisted(tmp_path, "{trial}/{trial}.csv", ["c"], "trials.csv")
    assert "a/a.csv" in note
    assert "more" not in note


@pytest.mark.parametrize(
    ("name", "content", "column"),
    [
        ("text", written.german(FORCE), "Kraft"),
        ("rcbenchmark", written.rcbenchmark(FORCE), "Thrust"),
        ("flight-stand", written.tyto(FORCE), "Powertrain 1 - force Fz (thrust)"),
        ("crazyflie", written.crazyflie(FORCE), "weight"),
        ("lvm", written.lvm(FORCE), "force"),
    ],
)
def test_a_packed_text_is_read_as_what_is_inside(
    tmp_path: Path, name: str, content: bytes, column: str
) -> None:
    plain = contents(name, put(tmp_path, content))
    inside = contents(name, put(tmp_path, gzip.compress(content), "a.txt.gz"))
    assert inside.codes == plain.codes
    np.testing.assert_array_equal(
        pick(inside.channels, column, "k", "f").values,
        pick(plain.channels, column, "k", "f").values,
    )


@ANY
@given(cut=st.integers(2, len(gzip.compress(written.rcbenchmark(FORCE), mtime=0)) - 1))
def test_a_packed_text_cut_anywhere_is_refused(cut: int, tmp_path: Path) -> None:
    content = gzip.compress(written.rcbenchmark(FORCE), mtime=0)[:cut]
    with pytest.raises(InputRefused, match="is compressed, and damaged or cut off"):
        contents("rcbenchmark", put(tmp_path, content))


def test_a_packed_text_of_too_much_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "MOST_UNPACKED", 1 << 20)
    path = put(tmp_path, gzip.compress(b"t,force\n" + b"1,2\n" * 500_000))
    with pytest.raises(InputRefused, match="holds more than 1 MB"):
        files.unpacked(path, "gzip", None)


Rows = Sequence[Sequence[object]]
MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
PACKAGE = "http://schemas.openxmlformats.org/package/2006"
BOOK = "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet.main+xml"


def xlsx(path: Path, *sheets: Rows) -> Path:
    """A workbook of the least that a spreadsheet program opens."""

    def cell(value: object) -> str:
        if isinstance(value, str):
            return f'<c t="inlineStr"><is><t>{value}</t></is></c>'
        return f"<c><v>{value}</v></c>"

    def links(*targets: tuple[str, str]) -> str:
        each = (
            f'<Relationship Id="r{i}" Type="{OFFICE}/{kind}" Target="{target}"/>'
            for i, (kind, target) in enumerate(targets)
        )
        return f'<Relationships xmlns="{PACKAGE}/relationships">{"".join(each)}</Relationships>'

    numbers = range(len(sheets))
    listed = "".join(f'<sheet name="S{i + 1}" sheetId="{i + 1}" r:id="r{i}"/>' for i in numbers)
    parts = {
        "[Content_Types].xml": f'<Types xmlns="{PACKAGE}/content-types"><Override'
        f' PartName="/xl/workbook.xml" ContentType="{BOOK}"/></Types>',
        "_rels/.rels": links(("officeDocument", "xl/workbook.xml")),
        "xl/workbook.xml": f'<workbook xmlns="{MAIN}" xmlns:r="{OFFICE}"><sheets>{listed}</sheets>'
        "</workbook>",
        "xl/_rels/workbook.xml.rels": links(
            *(("worksheet", f"worksheets/s{i}.xml") for i in numbers)
        ),
    }
    for i, rows in enumerate(sheets):
        body = "".join(f"<row>{''.join(map(cell, row))}</row>" for row in rows)
        sheet = f'<worksheet xmlns="{MAIN}"><sheetData>{body}</sheetData></worksheet>'
        parts[f"xl/worksheets/s{i}.xml"] = sheet
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in parts.items():
            file.writestr(name, content)
    return path


RECORD: Rows = [["time (s)", "force (N)"], *([i / 100, 0.5 + i % 2] for i in range(50))]


def test_the_first_sheet_is_a_record(tmp_path: Path) -> None:
    """Blank rows and a title above its table are left out."""
    second = [["trial", "note"], ["a", 'say "x", y'], [7, 1.5]]
    path = xlsx(tmp_path / "a.xlsx", [["", ""], ["stand 7", ""], ["", ""], *RECORD], second)
    seen = inspect(path)
    kind = "spreadsheet, sheet 'S1'; 1 more left out"
    assert (seen.reader, seen.contents.kind) == ("sheet", kind)
    assert seen.force is not None
    assert (seen.force.unit, seen.force.rate_Hz) == ("N", pytest.approx(100))
    clock = {"column": "time", "unit": "s"}
    (record,) = records(tmp_path, "sheet", "force", "N", "{trial}.xlsx", "100 Hz", time=clock)
    assert record.force_N.tolist() == [0.5 + i % 2 for i in range(50)]
    assert record.time_s is not None
    assert record.time_s.tolist() == [i / 100 for i in range(50)]
    with pytest.raises(InputRefused, match="no rows of numbers in its first sheet, 'S1'; others"):
        inspect(xlsx(tmp_path / "b.xlsx", [["rig", "A"], ["by", "B"], ["on", "C"]], RECORD))
    assert text_of(xlsx(tmp_path / "c.xlsx", second)) == 'trial,note\na,"say ""x"", y"\n7,1.5\n'


def test_a_sheet_of_means_makes_a_campaign(tmp_path: Path) -> None:
    names = ["trial", "boundary", "distance (mm)", "throttle (percent)", "lift (N)"]
    rows: Rows = [[i, "ground", 20.0 + 10 * i, 50, 1.25 / (1 + i)] for i in range(1, 9)]
    write_from(tmp_path / "c", [xlsx(tmp_path / "means.xlsx", [names, *rows])])
    assert 'reader = "means"' in (tmp_path / "c" / "campaign.toml").read_text()
    first, second, *_ = (tmp_path / "c" / "trials.csv").read_text().splitlines()
    assert first == "trial,boundary,distance,throttle,lift"
    assert second == "1,ground,30,50,0.625"


def test_a_damaged_sheet_is_refused(tmp_path: Path) -> None:
    path = xlsx(tmp_path / "a.xlsx", RECORD)
    path.write_bytes(path.read_bytes()[:600])
    for read in (inspect, text_of):
        with pytest.raises(InputRefused, match="cannot be read as a spreadsheet"):
            read(path)


def test_times_and_truths_are_written_as_text() -> None:
    import datetime

    stamp = datetime.datetime(2026, 3, 1, 14, 5)
    cells = [stamp, stamp.time(), datetime.timedelta(seconds=1.5), True, 3.0, 0.1, "a\nb", ""]
    texts = ["2026-03-01T14:05:00", "14:05:00", "0:00:01.500000", "TRUE", "3", "0.1", "a b", ""]
    assert [files._cell(cell) for cell in cells] == texts
