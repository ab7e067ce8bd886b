"""The site builds without a warning, is whole, and asks for nothing from elsewhere."""

from __future__ import annotations

import html
import importlib.util
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[2]
LOADS = {("script", "src"), ("link", "href"), ("img", "src"), ("iframe", "src"), ("source", "src")}


def _program(name: str) -> ModuleType:
    """A program of docs/, imported from its file."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    _program("build_reference").main()
    folder = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-W",
        "ignore",
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--quiet",
        "--site-dir",
        str(folder),
    ]
    done = subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


class Loaded(HTMLParser):
    """What a page loads by itself."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if tag == "link" and values.get("rel") in ("canonical", "prev", "next"):
            return
        self.found += [values[name] for kind, name in LOADS if kind == tag and values.get(name)]


@pytest.mark.nightly
def test_every_page_is_there(site):
    written = {
        p.relative_to(ROOT / "docs").with_suffix(".html").as_posix()
        for p in (ROOT / "docs").rglob("*.md")
    }
    assert {p for p in written if not (site / p).is_file()} == set()


@pytest.mark.nightly
def test_nothing_is_loaded_from_elsewhere(site):
    for page in site.rglob("*.html"):
        for target in Loaded(page.read_text(encoding="utf-8")).found:
            assert not re.match(r"(https?:)?//", target), f"{page.name} loads {target}"
            if not target.startswith("data:") and page.name != "404.html":
                assert (page.parent / unquote(target.split("?")[0].split("#")[0])).exists(), (
                    f"{page.name}: {target}"
                )


@pytest.mark.nightly
def test_formulas_are_drawn(site):
    page = (site / "reference/models/sanchez_cuevas.html").read_text(encoding="utf-8")
    assert 'role="img" aria-label="\\frac{L}{L_\\infty}' in page
    assert "$$" not in page


@pytest.mark.nightly
def test_included_code_is_the_file(site):
    page = html.unescape(
        re.sub(r"<[^>]+>", "", (site / "extending.html").read_text(encoding="utf-8"))
    )
    assert (
        "Ground: Cheeseman and Bennett's image, its strength free, for a vehicle of several rotors."
        in page
    )
    assert "--8<--" not in page


def test_the_picture_of_the_rooms_is_up_to_date():
    module = _program("draw_architecture")
    assert module.FILE.read_text(encoding="utf-8") == module.picture(), (
        "docs/architecture.svg is out of date: make docs"
    )


def test_every_package_is_in_the_picture():
    named = set(
        re.findall(
            r">(\w+)</text>", (ROOT / "docs" / "architecture.svg").read_text(encoding="utf-8")
        )
    )
    packages = {
        p.name for p in (ROOT / "pipeline" / "nearlift").iterdir() if (p / "__init__.py").exists()
    }
    assert packages <= named
