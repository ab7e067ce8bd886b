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
HOSTILE = "<img src=x onerror=alert(1)></script><script>alert(2)</script>"
CELL = "[aria-roledescription=cell]"
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
def browsed(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


@pytest.fixture
def page(browsed, address):
    """The page, opened."""
    browsed.open(address)
    return browsed


def unfold(page, chapter):
    """Open a chapter as its link does."""
    page.run(f"location.hash = ''; location.hash = '{chapter}'")
    page.wait(f"document.querySelector('#{chapter} details').open")


def view(boundary, selector):
    """Selector within the panel of a boundary in Figure 2."""
    return f"[data-chart=fig2] [data-view={boundary}] {selector}"


def marks(page, boundary):
    return page.run(f"document.querySelectorAll('{view(boundary, CELL)}').length")


def fits(page):
    return page.run("document.documentElement.scrollWidth <= window.innerWidth")


@pytest.mark.parametrize(("name", "width"), [("light", 1200), ("dark", 1200), ("phone", 360)])
def test_it_renders_without_a_word_and_asks_for_nothing(browsed, address, name, width):
    browsed.open(address, width=width, dark=name == "dark")
    assert browsed.run("document.documentElement.dataset.charts") == "drawn"
    assert browsed.errors == []
    assert [r for r in browsed.requests if not r.startswith("data:")] == [address]
    assert fits(browsed)
    corner = Image.open(io.BytesIO(browsed.screenshot())).convert("L").getpixel((2, 2))
    assert corner < 60 if name == "dark" else corner > 240


def test_the_whole_page_with_flow_and_flights_is_light_silent_and_asks_for_nothing(browsed, demo):
    file = demo / "reports" / "demo" / "index.html"
    # 1,984 trials; vega.js alone is 0.9 MB
    assert file.stat().st_size < 4_000_000
    browsed.open(file.as_uri())
    assert browsed.run("document.documentElement.dataset.charts") == "drawn"
    for chapter in ("fig2", "residuals", "flow", "safety"):
        unfold(browsed, chapter)
        assert browsed.run(f"document.querySelector('#{chapter} img, #{chapter} svg') !== null")
    assert browsed.errors == []
    assert [r for r in browsed.requests if not r.startswith("data:")] == [file.as_uri()]


def test_every_cell_is_a_mark_described_by_its_numbers_and_the_legend_shows_one_throttle(page, job):
    cells = job.read(LIFT)
    for boundary in ("ground", "ceiling", "sidewall"):
        assert marks(page, boundary) == (cells["boundary"] == boundary).sum()
    words = page.run(f"document.querySelector('{CELL}').getAttribute('aria-label')")
    assert words.startswith("ground, throttle 25 %; ẑ 1.14 (26.2 mm); ΔL ")
    assert re.search("trials [56] averaged", words)
    before = marks(page, "ground")
    symbol = view("ground", ".role-legend-symbol path")
    click = "dispatchEvent(new MouseEvent('click', {bubbles: true}))"
    page.run(f"document.querySelector('{symbol}').{click}")
    shown = f"document.querySelectorAll('{view('ground', CELL)}').length"
    page.wait(f"{shown} === {before // 4}")
    assert marks(page, "ceiling") > before // 4
    assert page.errors == []


def test_arrow_keys_go_from_point_to_point(page):
    said = f"document.querySelector('{view('sidewall', '[aria-live]')}').textContent"
    page.run(f"document.querySelector('{view('sidewall', '.drawing')}').focus()")
    page.press("ArrowRight")
    assert page.wait(said).startswith("sidewall, throttle")
    assert page.wait("document.querySelector('#vg-tooltip-element.visible')?.innerText")
    page.press("End")
    assert "ẑ 10.7" in page.wait(said)
    page.press("Escape")
    assert page.run(said) == ""


def test_text_from_files_stays_text(page):
    assert page.run("document.querySelectorAll('script').length") == 3
    assert page.run("document.querySelectorAll('img[src=x]').length") == 0
    # even a script that got in would not run: the policy knows its own by their digests
    script = "Object.assign(document.createElement('script'), {textContent: 'window.intruder = 1'})"
    page.run(f"document.body.append({script})")
    assert page.run("window.intruder === undefined")
    assert any("Content Security Policy" in e for e in page.errors)


def test_on_paper_every_chapter_and_every_chart_is_there(browsed, address):
    browsed.open(address, media="print")
    views = "[...document.querySelectorAll('.view')]"
    browsed.wait(f"{views}.every(v => v.querySelector('svg.marks'))")
    folds = "[...document.querySelectorAll('main details')].map(d => d.open)"
    before = browsed.run(folds)
    browsed.run("dispatchEvent(new Event('beforeprint'))")
    assert browsed.run("[...document.querySelectorAll('details.chapter')].every(d => d.open)")
    width = "v.querySelector('svg.marks').getBoundingClientRect().width"
    assert browsed.run(f"{views}.every(v => {width} > 100)")
    browsed.run("dispatchEvent(new Event('afterprint'))")
    assert browsed.run(folds) == before
    assert browsed.pdf().startswith(b"%PDF")


@pytest.mark.parametrize(("width", "height", "screens"), [(1280, 800, 3), (390, 844, 8)])
def test_the_page_is_read_in_two_minutes(browsed, demo, width, height, screens):
    browsed.open((demo / "reports" / "demo" / "index.html").as_uri(), width=width)
    words = re.findall(r"\w[^\s]*", browsed.run(OPEN_WORDS))
    assert 200 < len(words) <= 900
    for card in range(3):
        text = browsed.run(f"document.querySelectorAll('.card')[{card}].innerText")
        assert len(re.findall(r"\w[^\s]*", text)) <= 350
    assert browsed.run("document.documentElement.scrollHeight") <= screens * height
    assert fits(browsed)
    assert "_" not in "".join(words).replace("K_b", "")


def test_links_unfold_what_they_lead_to_and_a_number_leads_to_its_file(page):
    assert not page.run("document.querySelector('#budget details').open")
    page.run("document.querySelector('.card .headline a').click()")
    page.wait("document.querySelector('#budget details').open")
    page.run("document.querySelector('#budget td data').click()")
    source = page.wait("document.getElementById('source').innerText")
    assert "results.json /boundaries/ground/coefficients/K_b/budget/" in source
    file = page.run("document.querySelector('#source a').href")
    assert file.endswith("/processed/small/results.json")
    page.run("document.querySelector('h1').click()")
    assert page.run("document.getElementById('source').hidden")
    # a part of one chapter is that chapter
    page.run("document.querySelector('nav a[href=\"#origin\"]').click()")
    page.wait("document.querySelector('#provenance details').open")
    page.run("scrollTo(0, document.documentElement.scrollHeight)")
    assert page.wait("Math.abs(document.querySelector('nav').getBoundingClientRect().top) < 2")


def test_a_keyboard_is_enough(browsed, address):
    """The menu of a phone, a chapter, and a control, by keys alone."""
    browsed.open(address, width=390)
    browsed.run("document.querySelector('nav button').focus()")
    browsed.press("Enter", "\r")
    browsed.wait("document.querySelector('nav ul').checkVisibility()")
    browsed.press("Escape")
    browsed.wait("!document.querySelector('nav ul').checkVisibility()")
    browsed.run("document.querySelector('#noise summary').focus()")
    browsed.press("Enter", "\r")
    browsed.wait("document.querySelector('#noise details').open")
    controls = "[...document.querySelectorAll('a, button, summary, input, [tabindex]')]"
    out = f"{controls}.filter(e => e.checkVisibility() && e.tabIndex < 0).length"
    assert browsed.run(out) == 0
    assert browsed.errors == []


def test_a_screen_reader_hears_what_everything_is(page):
    """The tree that the browser gives to assistive technology, every chapter unfolded."""
    page.run("document.querySelectorAll('details').forEach(d => d.open = true)")
    page.wait(f"document.querySelector('{CELL}') !== null")
    heard = [
        (node["role"]["value"], node.get("name", {}).get("value", "").strip())
        for node in page.ask("Accessibility.getFullAXTree")["nodes"]
        if not node["ignored"] and "role" in node
    ]
    speaking = "link button checkbox radio image img heading table columnheader DisclosureTriangle"
    assert {role for role, name in heard if role in speaking.split() and not name} == set()
    assert {"main", "navigation", "article", "table", "heading"} <= {role for role, _ in heard}
    assert any(r == "heading" and n.startswith("Ground Sanchez-Cuevas") for r, n in heard)
