"""The page in a real browser: it renders, says nothing on the console, asks for nothing; pointing, switching and keys do what they say."""

from __future__ import annotations

import io
import json

import pytest
from PIL import Image

from nearlift.pages import render
from nearlift.pages.charts.gallery import charts
from nearlift.products import LIFT, TRIALS
from nearlift.stages import report

from .browser import CHROMIUM, browser

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed")
HOSTILE = "<img src=x onerror=alert(1)></script><script>alert(2)</script>"


@pytest.fixture(scope="module")
def job(make_job):
    def rename(table):
        table["trial"][5] = HOSTILE

    return make_job(simulated=True, edit=rename, note=HOSTILE)


@pytest.fixture(scope="module")
def address(job):
    evidence = report.gather(job)
    dot = io.BytesIO()
    Image.new("RGB", (1500, 600), "white").save(dot, "PNG")
    file = job.reports / "index.html"
    file.parent.mkdir()
    file.write_bytes(
        render.page(evidence, [render.Picture(name="fig2", title="t", caption="c", alt="a", png=dot.getvalue())], charts=charts(evidence))
    )
    return file.as_uri()


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


def marks(page, view):
    return page.run(f"document.querySelectorAll('[data-view={view}] [aria-roledescription=cell]').length")


def tick(page, signal, value, view=""):
    own = f'[data-view="{view}"]' if view else ""
    page.run(f"""document.querySelector('input[data-signal={signal}]{own}[value="{value}"]').click()""")


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


def test_every_cell_is_a_mark_described_by_its_numbers(page, address, job):
    page.open(address)
    cells = job.read(LIFT)
    for boundary in ("ground", "ceiling", "sidewall"):
        assert marks(page, boundary) == (cells["boundary"] == boundary).sum()
    words = page.run("document.querySelector('[aria-roledescription=cell]').getAttribute('aria-label')")
    assert words.startswith("ground, throttle 25 %, ẑ = 1.14 (26.2 mm): ΔL ")
    assert "trials: 5 averaged, 1 rejected" in words or "trials: 6 averaged" in words


def test_hovering_shows_trials_counts_uncertainty_and_quality(page, address, job):
    page.open(address)
    page.run("document.querySelector('[data-view=sidewall] .drawing').scrollIntoView({block: 'center', behavior: 'instant'})")
    x, y = page.run(
        "(r => [r.x + r.width / 2, r.y + r.height / 2])([...document.querySelectorAll('[aria-roledescription=cell]')].at(-8).getBoundingClientRect())"
    )
    page.point(x - 40, y)
    page.point(x, y)
    shown = page.wait("document.querySelector('#vg-tooltip-element.visible')?.innerText")
    assert "±" in shown
    assert "averaged" in shown
    assert "quality" in shown
    trials = job.read(TRIALS)["trial"]
    assert any(str(t) in shown for t in trials)
    page.point(2, 2)
    page.wait("!document.querySelector('#vg-tooltip-element.visible')")


def test_switches_do_what_they_say(page, address):
    page.open(address)
    labels = "[...document.querySelectorAll('[data-view=ground] .drawing text')].map(t => t.textContent)"
    before = marks(page, "ground")
    tick(page, "throttles", "0.25")
    page.wait(f"document.querySelectorAll('[data-view=ground] [aria-roledescription=cell]').length === {before * 3 // 4}")
    assert marks(page, "ceiling") > 0

    assert "ΔL (%)" in page.run(labels)
    tick(page, "quantity", "force")
    page.wait(f"({labels}).includes('lift (mN)')")

    paths = "document.querySelectorAll('[data-view=ground] .drawing .mark-area path').length"
    assert page.run(paths) == 3  # a band for each throttle that is left
    tick(page, "bands", "bands")
    page.wait(f"{paths} === 0")

    lines = "document.querySelectorAll('[data-view=ground] .drawing .mark-line path').length"
    three = page.run(lines)
    tick(page, "models", "power_law", "ground")
    page.wait(f"{lines} === {three + 3}")

    ticks = "JSON.stringify([...document.querySelectorAll('[data-view=ground] .role-axis-label')][0].textContent)"
    log = page.run(ticks)
    tick(page, "x_scale", "linear")
    page.wait(f"{ticks} !== {json.dumps(log)}")
    # what was chosen before still holds
    assert marks(page, "ground") == before * 3 // 4
    assert page.run(paths) == 0
    assert page.errors == []


def test_arrow_keys_go_from_point_to_point(page, address):
    page.open(address)
    page.run("document.querySelector('[data-view=sidewall] .drawing').focus()")
    page.press("ArrowRight")
    first = page.wait("document.querySelector('[data-view=sidewall] [aria-live]').textContent")
    assert first.startswith("sidewall, throttle")
    assert page.wait("document.querySelector('#vg-tooltip-element.visible')?.innerText")
    page.press("End")
    last = page.wait("document.querySelector('[data-view=sidewall] [aria-live]').textContent")
    assert "ẑ = 10.7" in last
    page.press("Escape")
    assert page.run("document.querySelector('[data-view=sidewall] [aria-live]').textContent") == ""


def test_text_from_files_stays_text(page, address):
    page.open(address)
    assert page.run("document.querySelectorAll('script').length") == 3
    assert page.run("document.querySelectorAll('img[src=x]').length") == 0
    # even a script that got in would not run: the policy knows its own by their digests
    page.run("document.body.append(Object.assign(document.createElement('script'), {textContent: 'window.intruder = true'}))")
    assert page.run("window.intruder === undefined")
    assert any("Content Security Policy" in e for e in page.errors)


def test_on_paper_stands_the_printed_figure(page, address):
    page.open(address, media="print")
    shown = page.run("[...document.querySelectorAll('.instead')].map(e => getComputedStyle(e).display !== 'none')")
    assert shown == [True]
    assert page.run("getComputedStyle(document.querySelector('.chart')).display") == "none"
    assert page.pdf().startswith(b"%PDF")
