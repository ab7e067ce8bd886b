"""Sections of a page that runs write, and the table of verdicts."""

from tests.calibration import pages
from tests.calibration.figures import by_verdict


def test_a_section_takes_the_place_of_its_own(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# Title\n\nText.\n")
    pages.write(page, "one", "first\n")
    pages.write(page, "two", "second")
    pages.write(page, "one", "new \\1 one")
    assert page.read_text() == (
        "# Title\n\nText.\n\n<!-- one -->\nnew \\1 one\n<!-- end of one -->\n\n"
        "<!-- two -->\nsecond\n<!-- end of two -->\n"
    )
    assert pages.section(page, "two") == "<!-- two -->\nsecond\n<!-- end of two -->\n"
    assert pages.section(page, "three") == pages.section(tmp_path / "none.md", "one") == ""


def test_intervals_are_counted_by_campaign_and_verdict():
    def row(kind, truth, verdict, holds, width):
        given = {"kind": kind, "truth": truth, "verdict": verdict, "cover_quoted": holds}
        return given | {"width_quoted": width, "oracle_width": 2.0}

    rows = [
        row("null", [], "adequate", True, 2.0),
        row("null", [], "adequate", False, 4.0),
        row("lost_steps", ["lost_steps"], "unexplained", True, 8.0),
    ]
    null, strange, every = by_verdict(rows)
    assert null == {
        "campaign": "null",
        "adequate": "1 of 2 (1-99), 1.50",
        "effect": "-",
        "unexplained": "-",
        "all": "1 of 2 (1-99), 1.50",
    }
    assert strange["unexplained"] == "1 of 1 (3-100), 4.00"
    assert every["all"] == "2 of 3 (9-99), 2.00"
