"""The page in a real browser."""

from __future__ import annotations

import json
import shutil
import time

import pytest
from tests.unit.browser import CHROMIUM, browser

from .client import served

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed")
#: Lowest contrast between text and ground, WCAG 2 AA, of all elements that hold text.
CONTRAST = """
(() => {
  const linear = v => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  const numbers = c => c.match(/[\\d.]+/g).map(Number);
  const luminance = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  const ground = e => { for (; e; e = e.parentElement) { const c = numbers(getComputedStyle(e).backgroundColor); if (c[3] !== 0) return c; } return [255, 255, 255]; };
  const ratio = e => { const [a, b] = [numbers(getComputedStyle(e).color), ground(e)].map(luminance).sort((x, y) => y - x); return (a + 0.05) / (b + 0.05); };
  const texts = [...document.querySelectorAll('body *')].filter(e => e.checkVisibility() && [...e.childNodes].some(n => n.nodeType === 3 && n.data.trim()));
  return texts.map(e => [ratio(e), e.textContent.trim().slice(0, 40)]).sort((x, y) => x[0] - y[0])[0];
})()
"""


@pytest.fixture(scope="module")
def opened(workspace, tmp_path_factory):
    base = tmp_path_factory.mktemp("page")
    root = base / "work"
    for folder in ("processed", "reports"):
        shutil.copytree(workspace / folder / "small", root / folder / "small", symlinks=True)
    with served(root) as own, browser(base) as page:
        page.open(own.link)
        page.wait("location.pathname === '/' && document.querySelector('h1') !== null")
        yield page, f"http://{own.host}", root


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("path", ["/", "/campaign/small", "/campaign/none"])
def test_pages_fit_are_readable_and_say_nothing_on_the_console(opened, path, width):
    page, address, _ = opened
    for dark in (False, True):
        page.open(address + path, width=width, dark=dark)
        page.wait("document.querySelector('h1')?.textContent")
        assert page.errors == ([] if "none" not in path else page.errors[:1])
        assert all(r.startswith((address, "data:")) for r in page.requests)
        assert page.run("document.documentElement.scrollWidth <= window.innerWidth")
        lowest, text = page.run(CONTRAST)
        assert lowest >= 4.5, text


def test_a_lift_stays_on_one_line_on_a_phone(opened):
    page, address, _ = opened
    page.open(f"{address}/campaign/small", width=390)
    lines = "[...document.querySelectorAll('#trials td:nth-child(5)')].map(c => { const r = document.createRange(); r.selectNodeContents(c); return r.getClientRects().length; })"
    assert set(page.run(lines)) == {1}


def test_a_new_state_is_shown_without_a_connection_that_stays_open(opened):
    page, address, root = opened
    page.open(f"{address}/campaign/small")
    page.wait("document.querySelector('#state').textContent.startsWith('84 of 112')")
    page.run("document.querySelector('#results').focus()")
    file = root / "processed/small/watch.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"next": ["next at the moon"]}))
    page.wait("document.querySelector('#live li')?.textContent === 'next at the moon'")
    assert page.run("document.activeElement.id") == "results"
    assert page.run("document.querySelector('#fig2')") is not None
    assert page.errors == []


@pytest.mark.nightly
def test_six_tabs_leave_room_for_a_seventh(opened):
    page, address, _ = opened
    page.open(f"{address}/campaign/small")
    for _ in range(7):
        page.ask("Target.createTarget", url=f"{address}/campaign/small")
    time.sleep(4)
    page.open(f"{address}/")
    page.wait("document.querySelector('h1')?.textContent === 'Campaigns'", patience_s=30)
    assert page.run("fetch('/static/serve.css').then(a => a.status)") == 200


def test_the_server_s_end_is_said(workspace, tmp_path):
    shutil.copytree(workspace / "processed" / "small", tmp_path / "processed" / "small")
    (tmp_path / "browser").mkdir()
    with browser(tmp_path / "browser") as page:
        with served(tmp_path) as own:
            page.open(own.link)
            page.wait("location.pathname === '/' && document.querySelector('h1') !== null")
            page.open(f"http://{own.host}/campaign/small")
        page.wait("document.querySelector('#state').textContent.includes('does not answer')")
