"""Who cannot see, point, or run scripts reads the same page; and what draws its charts is what it
says it is.
"""

from __future__ import annotations

import itertools
import re
from html.parser import HTMLParser
from importlib import resources

import pytest

from nearlift.report import charts as interactive
from nearlift.report.page.render import Picture, page
from nearlift.report.registry import charts
from nearlift.stages.gathering import gather

STYLE = (
    resources.files("nearlift.report.page")
    .joinpath("templates", "page.css")
    .read_text(encoding="utf-8")
)
VOID = {"meta", "link", "img", "br", "input", "path"}


class Outline(HTMLParser):
    """Elements in order, each with its ancestors' tags."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None], tuple[str, ...]]] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs), tuple(self.open)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def every(self, *tags):
        return [(attributes, inside) for name, attributes, inside in self.elements if name in tags]


@pytest.fixture(scope="module")
def outline(small_job):
    evidence = gather(small_job)
    picture = Picture(name="fig2", title="t", caption="c", alt="a")
    return Outline(page(evidence, [picture], charts=charts(evidence)).decode())


def test_every_element_is_closed_where_it_was_opened(outline):
    assert outline.open == []


def test_headings_skip_no_level_and_landmarks_are_there(outline):
    levels = [int(name[1]) for name, _, _ in outline.elements if re.fullmatch("h[1-6]", name)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
    for landmark in ("header", "nav", "main", "footer"):
        assert len(outline.every(landmark)) == 1
    ids = {a["id"] for _, a, _ in outline.elements if "id" in a}
    assert all(a["aria-labelledby"] in ids for a, _ in outline.every("section"))
    first = next(a for name, a, inside in outline.elements if "body" in inside)
    assert first["class"] == "skip"
    assert first["href"][1:] in ids


def test_tables_have_captions_and_heads_have_scopes(outline):
    tables, captions = outline.every("table"), outline.every("caption")
    assert len(tables) == len(captions) > 8
    assert all(a.get("scope") in ("col", "row") for a, _ in outline.every("th"))
    assert all("div" in inside for _, inside in tables)


def colours(block):
    return dict(re.findall(r"--([a-z0-9]+): (#[0-9a-f]{3,6})", block))


def luminance(colour):
    digits = colour[1:] if len(colour) == 7 else "".join(2 * c for c in colour[1:])
    parts = [int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(a, b):
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


def schemes():
    light, dark = (colours(block) for block in re.findall(r":root \{(.*?)\}", STYLE, re.S)[:2])
    return {"light": light, "dark": dark}


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_contrast_is_that_of_wcag_aa(scheme):
    own = schemes()[scheme]
    for name in ("text", "soft", "link", "good", "fair", "bad"):
        for ground in ("paper", "card"):
            assert contrast(own[name], own[ground]) >= 4.5, (name, ground)
    # of marks and lines three to one is asked
    for name in ("s0", "s1", "s2", "s3", "s4", "s5"):
        assert contrast(own[name], own["paper"]) >= 3, name
    assert set(schemes()["light"]) == set(schemes()["dark"])
    assert all(f"--s{i}" in STYLE for i in range(interactive.MOST_COLOURS))


def test_the_library_is_what_the_pinned_package_bundles():
    bundler = pytest.importorskip("vl_convert", reason="vl-convert is not installed")
    held = (
        resources.files("nearlift.report.page")
        .joinpath("vendor", "vega.js")
        .read_text(encoding="utf-8")
    )
    assert bundler.javascript_bundle() == held
    assert "<!--" not in held
    assert "<script" not in held
    assert "</script" not in held
