"""The page in a real browser: it renders, says nothing on the console, asks for nothing; pointing,
switching and keys do what they say.
"""

from __future__ import annotations

import io
import re

import pytest
from PIL import Image
from tests.unit.browser import CHROMIUM, browser

from nearlift.report import charts
from nearlift.report.page import render
from nearlift.stages.gathering import gather
from nearlift.stages.reduce import LIFT

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed")
FIG2 = "[data-chart=fig2]"
HOSTILE = "<img src=x onerror=alert(1)></script><script>alert(2)</script>"


@pytest.fixture(scope="module")
def job(make_job):
    def rename(table):
        table["trial"][5] = HOSTILE

    return make_job(simulated=True, edit=rename, note=HOSTILE)


@pytest.fixture(scope="module")
def address(job):
    evidence = gather(job)
    dot = io.BytesIO()
    Image.new("RGB", (1200, 600), "white").save(dot, "PNG")
    file = job.reports / "index.html"
    file.parent.mkdir()
    pictures = [
        render.Picture(name=n, title="t", caption="c", alt=f"{n} in words", png=dot.getvalue())
        for n in ("fig2", "residuals")
    ]
    file.write_bytes(render.page(evidence, pictures, chart=charts.fig2(evidence)))
    return file.as_uri()


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


def unfold(page, chapter):
    """Open a chapter as its link does."""
    page.run(f"location.hash = ''; location.hash = '{chapter}'")
    page.wait(f"document.querySelector('#{chapter} details').open")


def marks(page, view):
    return page.run(
        f"document.querySelectorAll('{FIG2} [data-view={view}] [aria-roledescription=cell]').length"
    )


@pytest.mark.parametrize(("name", "width"), [("light", 1200), ("dark", 1200), ("phone", 360)])
def test_it_renders_without_a_word_and_asks_for_nothing(page, address, tmp_path, name, width):
    page.open(address, width=width, dark=name == "dark")
    assert page.run("document.documentElement.dataset.charts") == "drawn"
    assert page.errors == []
    assert [r for r in page.requests if not r.startswith("data:")] == [address]
    assert page.run("document.documentElement.scrollWidth <= window.innerWidth")
    page.screenshot(tmp_path / "page.png", whole=False)
    corner = Image.open(tmp_path / "page.png").convert("L").getpixel((2, 2))
    assert corner < 60 if name == "dark" else corner > 240


def test_the_whole_page_with_flow_and_flights_is_light_silent_and_asks_for_nothing(page, demo):
    file = demo / "reports" / "demo" / "index.html"
    # 1,984 trials; vega.js alone is 0.9 MB
    assert file.stat().st_size < 4_000_000
    page.open(file.as_uri())
    assert page.run("document.documentElement.dataset.charts") == "drawn"
    for chapter in ("fig2", "residuals", "flow", "safety"):
        unfold(page, chapter)
    assert page.run(
        "['fig2', 'residuals', 'flow', 'safety'].every(id =>"
        " document.getElementById(id).querySelector('img, svg'))"
    )
    assert page.errors == []
    assert [r for r in page.requests if not r.startswith("data:")] == [file.as_uri()]


def test_every_cell_is_a_mark_described_by_its_numbers(page, address, job):
    page.open(address)
    cells = job.read(LIFT)
    for boundary in ("ground", "ceiling", "sidewall"):
        assert marks(page, boundary) == (cells["boundary"] == boundary).sum()
    words = page.run(
        "document.querySelector('[aria-roledescription=cell]').getAttribute('aria-label')"
    )
    assert words.startswith("ground, throttle 25 %; ẑ 1.14 (26.2 mm); ΔL ")
    assert "trials 5 averaged" in words or "trials 6 averaged" in words


def test_the_legend_shows_one_throttle(page, address):
    page.open(address)
    before = marks(page, "ground")
    page.run(
        "document.querySelector('[data-chart=fig2] [data-view=ground] .role-legend-symbol path')"
        ".dispatchEvent(new MouseEvent('click', {bubbles: true}))"
    )
    page.wait(
        "document.querySelectorAll('[data-chart=fig2] [data-view=ground]"
        f" [aria-roledescription=cell]').length === {before // 4}"
    )
    assert marks(page, "ceiling") > before // 4
    assert page.errors == []


def test_arrow_keys_go_from_point_to_point(page, address):
    page.open(address)
    page.run("document.querySelector('[data-chart=fig2] [data-view=sidewall] .drawing').focus()")
    page.press("ArrowRight")
    first = page.wait(
        "document.querySelector('[data-chart=fig2] [data-view=sidewall] [aria-live]').textContent"
    )
    assert first.startswith("sidewall, throttle")
    assert page.wait("document.querySelector('#vg-tooltip-element.visible')?.innerText")
    page.press("End")
    last = page.wait(
        "document.querySelector('[data-chart=fig2] [data-view=sidewall] [aria-live]').textContent"
    )
    assert "ẑ 10.7" in last
    page.press("Escape")
    assert (
        page.run(
            "document.querySelector('[data-chart=fig2] [data-view=sidewall]"
            " [aria-live]').textContent"
        )
        == ""
    )


def test_text_from_files_stays_text(page, address):
    page.open(address)
    assert page.run("document.querySelectorAll('script').length") == 3
    assert page.run("document.querySelectorAll('img[src=x]').length") == 0
    # even a script that got in would not run: the policy knows its own by their digests
    page.run(
        "document.body.append(Object.assign(document.createElement('script'), {textContent:"
        " 'window.intruder = true'}))"
    )
    assert page.run("window.intruder === undefined")
    assert any("Content Security Policy" in e for e in page.errors)


def test_on_paper_every_chapter_and_every_chart_stands(page, address):
    page.open(address, media="print")
    page.wait("[...document.querySelectorAll('.view')].every(v => v.querySelector('svg.marks'))")
    folds = "[...document.querySelectorAll('main details')].map(d => d.open)"
    before = page.run(folds)
    page.run("dispatchEvent(new Event('beforeprint'))")
    assert page.run("[...document.querySelectorAll('details.chapter')].every(d => d.open)")
    assert page.run(
        "[...document.querySelectorAll('.view svg.marks')].every(s => s.getBoundingClientRect()"
        ".width > 100)"
    )
    page.run("dispatchEvent(new Event('afterprint'))")
    assert page.run(folds) == before
    assert page.pdf().startswith(b"%PDF")


#: Words that can be read without opening anything: those of elements that are laid out, charts and
#: what is for ears alone aside.
OPEN_WORDS = """(() => {
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  let text = '';
  while (walker.nextNode()) {
    const own = walker.currentNode.parentElement;
    if (own.closest('script, style, svg, .hidden, .skip') || !own.checkVisibility()) continue;
    text += ' ' + walker.currentNode.textContent;
  }
  return text;
})()"""


@pytest.mark.parametrize(("width", "height", "screens"), [(1280, 800, 3), (390, 844, 8)])
def test_the_page_is_read_in_two_minutes(page, demo, width, height, screens):
    page.open((demo / "reports" / "demo" / "index.html").as_uri(), width=width)
    words = re.findall(r"\w[^\s]*", page.run(OPEN_WORDS))
    assert 200 < len(words) <= 900
    for card in range(3):
        own = f"document.querySelectorAll('.card')[{card}].innerText"
        assert len(re.findall(r"\w[^\s]*", page.run(own))) <= 350
    assert page.run("document.documentElement.scrollHeight") <= screens * height
    assert page.run("document.documentElement.scrollWidth <= window.innerWidth")
    assert "_" not in "".join(words).replace("K_b", "")


def test_links_unfold_what_they_lead_to_and_the_contents_stay_in_view(page, address):
    page.open(address)
    assert not page.run("document.querySelector('#budget details').open")
    page.run("document.querySelector('.card .headline a').click()")
    page.wait("document.querySelector('#budget details').open")
    # a part of one chapter is that chapter
    page.run("document.querySelector('nav a[href=\"#origin\"]').click()")
    page.wait("document.querySelector('#provenance details').open")
    page.run("scrollTo(0, document.documentElement.scrollHeight)")
    assert page.wait("Math.abs(document.querySelector('nav').getBoundingClientRect().top) < 2")


def test_a_number_leads_to_its_file(page, address):
    page.open(address)
    page.run("location.hash = 'budget'")
    page.wait("document.querySelector('#budget details').open")
    page.run("document.querySelector('#budget td data').click()")
    told = page.wait("document.getElementById('source').innerText")
    assert "results.json /boundaries/ground/coefficients/K_b/budget/" in told
    file = page.run("document.querySelector('#source a').href")
    assert file.endswith("/processed/small/results.json")
    page.run("document.querySelector('h1').click()")
    assert page.run("document.getElementById('source').hidden")


def test_a_keyboard_is_enough(page, address):
    """The menu of a phone, a chapter, and a control, by keys alone."""
    page.open(address, width=390)
    page.run("document.querySelector('nav button').focus()")
    page.ask("Input.dispatchKeyEvent", type="keyDown", key="Enter", code="Enter", text="\r")
    page.ask("Input.dispatchKeyEvent", type="keyUp", key="Enter", code="Enter")
    page.wait("document.querySelector('nav ul').checkVisibility()")
    page.press("Escape")
    page.wait("!document.querySelector('nav ul').checkVisibility()")
    page.run("document.querySelector('#noise summary').focus()")
    page.ask("Input.dispatchKeyEvent", type="keyDown", key="Enter", code="Enter", text="\r")
    page.wait("document.querySelector('#noise details').open")
    reached = page.run(
        "[...document.querySelectorAll('a, button, summary, input, [tabindex]')].filter(e =>"
        " e.checkVisibility() && e.tabIndex < 0).length"
    )
    assert reached == 0
    assert page.errors == []


def test_a_screen_reader_is_told_what_everything_is(page, address):
    """The tree that the browser gives to assistive technology, every chapter unfolded."""
    page.open(address)
    page.run("document.querySelectorAll('details').forEach(d => d.open = true)")
    page.wait(f"document.querySelector('{FIG2} [aria-roledescription=cell]') !== null")
    told = [
        (node["role"]["value"], node.get("name", {}).get("value", "").strip())
        for node in page.ask("Accessibility.getFullAXTree")["nodes"]
        if not node["ignored"] and "role" in node
    ]
    speaking = "link button checkbox radio image img heading table columnheader DisclosureTriangle"
    assert {role for role, name in told if role in speaking.split() and not name} == set()
    roles = {role for role, _ in told}
    assert {"main", "navigation", "article", "table", "heading"} <= roles
    assert any(
        role == "heading" and name.startswith("Ground Sanchez-Cuevas") for role, name in told
    )
