"""The bench's page in a real browser."""

from __future__ import annotations

import shutil

import pytest

from . import small_run
from .browser import CHROMIUM, browser
from .test_serve import served

pytest.importorskip("starlette", reason="nearlift[serve] is not installed")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed")


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    base = tmp_path_factory.mktemp("page")
    root = base / "work"
    small_run.write(root / "raw" / "small", visits=2)
    with served(root) as own, browser(base) as page:
        page.open(own.link)
        page.wait("location.pathname === '/' && document.querySelector('h1') !== null")
        yield page, f"http://{own.host}", root


@pytest.mark.parametrize("width", [1200, 390])
@pytest.mark.parametrize(
    "path",
    [
        "/",
        "/live?campaign=raw/small",
        "/new",
        "/edit?campaign=raw/small",
    ],
)
def test_pages_fit_and_say_nothing_on_the_console(opened, path, width):
    page, address, _ = opened
    page.open(address + path, width=width)
    page.wait("document.querySelector('h1')?.textContent")
    assert page.errors == []
    assert all(r.startswith((address, "data:")) for r in page.requests)
    assert page.run("document.documentElement.scrollWidth <= window.innerWidth")


def test_a_point_comes_with_its_record(opened):
    page, address, root = opened
    record = sorted((root / "raw" / "small" / "trials").iterdir())[7]
    shutil.move(record, root / record.name)
    page.open(address + "/live?campaign=raw/small")
    page.wait("document.querySelector('#state')?.textContent.startsWith('55 of 56')")
    shutil.move(root / record.name, record)
    page.wait(f"document.querySelector('#trials [data-trial={record.stem}]') !== null")
    assert page.run("document.querySelector('#trials tbody tr').dataset.trial") == record.stem
    drawn = "document.querySelector('#fig2 svg').getAttribute('aria-label')"
    assert "ground: 56 points" in page.run(drawn)
    assert page.errors == []
