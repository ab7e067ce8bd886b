"""The schedule as a table of cells in a real browser: typed, pasted and refused there, and written
as the same text.
"""

from __future__ import annotations

import pytest

from . import driven, small_run
from .browser import CHROMIUM, browser
from .test_serve import served

pytest.importorskip("starlette", reason="nearlift[serve] is not installed")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed")
TEXT = "document.querySelector('#schedule').value"
FOCUS = "document.activeElement.closest('#grid') && [document.activeElement.parentElement.dataset.row, document.activeElement.cellIndex].join()"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("grid")
    root = small_run.write(folder / "work" / "raw" / "small", visits=2)
    # a remark, a quoted cell and a blank line are nothing that a table needs to change
    lines = (root / "trials.csv").read_text().splitlines()
    lines[0] += ",note"
    lines[1:] = [f"{line}," for line in lines[1:]]
    lines[2] += '"late, by a minute"'
    lines.insert(4, "")
    (root / "trials.csv").write_text("# as it was run\n" + "\n".join(lines) + "\n")
    with served(folder / "work") as own, browser(folder) as page:
        page.open(own.link)
        page.file = root / "trials.csv"
        page.edit = f"http://{own.host}/edit?campaign=raw/small"
        yield page


@pytest.fixture
def opened(page):
    page.open(page.edit)
    page.wait(f"{driven.STATE}.endsWith('nothing is refused')")
    yield page
    assert page.errors == []


def cell(row, column):
    """One of the table, row 0 its names."""
    return f"#grid tr[data-row='{row}'] > :nth-child({column + 2})"


def value(page, row, column):
    return page.run(f"document.querySelector({cell(row, column)!r}).textContent".replace('"', "`"))


def changed(page):
    """Lines of the text that differ from those of the file."""
    old, new = page.file.read_text().split("\n"), page.run(TEXT).split("\n")
    assert len(old) == len(new)
    return [(i, b) for i, (a, b) in enumerate(zip(old, new, strict=True)) if a != b]


def test_every_line_stands_in_the_table_and_none_changes(opened):
    text = opened.file.read_text()
    assert opened.run(TEXT) == text
    rows = opened.run(
        "[...document.querySelectorAll('#grid tbody tr')].map(r => [...r.cells].map(c => c.textContent))"
    )
    assert [r[0] for r in rows[:4]] == ["3", "4", "5", "7"]
    assert rows[1][-2] == "late, by a minute"
    assert len(rows) == len(text.splitlines()) - 3 + 1


def test_a_cell_is_typed_into_and_its_line_alone_changes(opened):
    header = opened.file.read_text().splitlines()[1].split(",")
    opened.write(cell(1, header.index("distance")), "31.5")
    ((line, text),) = changed(opened)
    assert line == 2
    assert text.split(",")[header.index("distance")] == "31.5"
    # Tab went on along the row
    assert opened.run(FOCUS) == f"1,{header.index('distance') + 2}"
    opened.run("document.querySelector('#undo').click()")
    assert changed(opened) == []


def test_a_refusal_stands_at_its_cell(opened):
    header = opened.file.read_text().splitlines()[1].split(",")
    opened.write(cell(3, header.index("boundary")), "grund")
    fault = opened.wait("document.querySelector('#grid [aria-invalid]')?.dataset.fault")
    assert "grund" in fault
    assert opened.run("document.querySelector('#grid [aria-invalid]').textContent") == "grund"
    assert "line 5, boundary" in opened.run("document.querySelector('#faults').textContent")
    opened.click("#faults button")
    assert opened.run(FOCUS) == f"3,{header.index('boundary') + 1}"
    opened.write(cell(3, header.index("boundary")), "ground")
    driven.settled(opened)
    assert not opened.run("document.querySelectorAll('#grid [aria-invalid]').length")


def test_cells_of_a_spreadsheet_are_pasted_where_the_cursor_is(opened):
    header = opened.file.read_text().splitlines()[1].split(",")
    at = header.index("distance")
    opened.paste(cell(1, at), "33\t50\r\n34\t75\r\n")
    assert [value(opened, r, at) for r in (1, 2)] == ["33", "34"]
    assert [value(opened, r, at + 1) for r in (1, 2)] == ["50", "75"]
    assert [i for i, _ in changed(opened)] == [2, 3]
    assert '"late, by a minute"' in opened.run(TEXT)
    opened.run("document.querySelector('#undo').click()")
    assert changed(opened) == []


def test_rows_and_columns_are_added_by_typing_beyond_them_and_taken_out(opened):
    text = opened.file.read_text()
    rows, header = len(text.splitlines()) - 1, text.splitlines()[1].split(",")
    opened.write(cell(rows, 0), "t9999")
    assert opened.run(TEXT) == text + "t9999" + "," * (len(header) - 1) + "\n"
    opened.click(cell(rows, 0))
    opened.click("#no-row")
    assert opened.run(TEXT) == text
    opened.write(cell(0, len(header)), "humidity")
    opened.write(cell(1, len(header)), "40")
    got = opened.run(TEXT).splitlines()
    assert got[1].endswith(",humidity")
    assert got[2].endswith(",40")
    opened.click(cell(0, len(header)))
    opened.click("#no-column")
    assert opened.run(TEXT) == text


def test_a_keyboard_is_enough(opened):
    opened.click(cell(1, 0))
    for key, where in (
        ("ArrowRight", "1,2"),
        ("ArrowDown", "2,2"),
        ("ArrowLeft", "2,1"),
        ("Enter", "3,1"),
        ("ArrowUp", "2,1"),
        ("Tab", "2,2"),
    ):
        opened.press(key)
        assert opened.run(FOCUS) == where
    # the row's end lets go of the focus
    for _ in range(20):
        opened.press("Tab")
    assert not opened.run(FOCUS)


def test_text_and_table_are_one(opened):
    opened.run("document.querySelector('details:has(#schedule)').open = true")
    opened.write("#schedule", "trial,boundary\na,none\n")
    assert value(opened, 1, 0) == "a"
    assert opened.run("document.querySelectorAll('#grid tbody tr').length") == 2
