"""The site builds without a warning, is whole, and asks for nothing from elsewhere."""

from __future__ import annotations

import html
import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
#: What a page loads by itself.
LOADED = re.compile(
    r'<(?:script|img|iframe|source)\b[^>]*\bsrc="([^"]+)"|'
    r'<link\b(?![^>]*rel="(?:canonical|prev|next)")[^>]*\bhref="([^"]+)"'
)


def _program(name: str) -> ModuleType:
    """A program of docs/, imported from its file."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.nightly
def test_the_site_is_whole_and_loads_nothing_from_elsewhere(tmp_path):
    _program("build_reference").main()
    words = ["-W", "ignore", "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir"]
    done = subprocess.run(
        [sys.executable, *words, str(tmp_path)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    for page in DOCS.rglob("*.md"):
        assert (tmp_path / page.relative_to(DOCS).with_suffix(".html")).is_file(), page
    for page in tmp_path.rglob("*.html"):
        for target in map("".join, LOADED.findall(page.read_text(encoding="utf-8"))):
            assert not re.match(r"(https?:)?//", target), f"{page.name} loads {target}"
            if not target.startswith("data:") and page.name != "404.html":
                file = page.parent / unquote(target.split("?")[0].split("#")[0])
                assert file.exists(), f"{page.name}: {target}"
    # formulas are drawn, and included code is the file's
    text = (tmp_path / "reference/models/sanchez_cuevas.html").read_text(encoding="utf-8")
    assert 'role="img" aria-label="\\frac{L}{L_\\infty}' in text
    assert "$$" not in text
    text = (tmp_path / "extending.html").read_text(encoding="utf-8")
    text = html.unescape(re.sub(r"<[^>]+>", "", text))
    assert "Ground: Cheeseman and Bennett's image, its strength free" in text
    assert "--8<--" not in text


def test_the_picture_of_the_packages_is_up_to_date():
    module = _program("draw_architecture")
    picture = module.FILE.read_text(encoding="utf-8")
    assert picture == module.picture(), "docs/architecture.svg is out of date: make docs"
    folders = (ROOT / "pipeline" / "nearlift").iterdir()
    packages = {p.name for p in folders if (p / "__init__.py").exists()}
    assert packages <= set(re.findall(r">(\w+)</text>", picture))
