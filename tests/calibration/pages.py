"""Sections of a page in docs/ that a run writes, between markers that name them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any


def section(page: Path, name: str) -> str:
    """The section with its markers; empty where the page has none."""
    text = page.read_text(encoding="utf-8") if page.exists() else ""
    found = re.search(_pattern(name), text, flags=re.DOTALL)
    return found[0] if found else ""


def write(page: Path, name: str, body: str) -> None:
    """Put a section in the place of the one that the page has, or at the page's end."""
    whole = f"<!-- {name} -->\n{body.strip()}\n<!-- end of {name} -->\n"
    text = page.read_text(encoding="utf-8")
    before = section(page, name)
    text = text.replace(before, whole) if before else f"{text.rstrip()}\n\n{whole}"
    page.write_text(text, encoding="utf-8")


def table(rows: list[dict[str, Any]]) -> str:
    """Rows of equal keys as a table in Markdown, numbers to two decimals."""
    cells = [[f"{v:.2f}" if isinstance(v, float) else str(v) for v in r.values()] for r in rows]
    lines = [list(rows[0]), ["---"] * len(rows[0]), *cells]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _pattern(name: str) -> str:
    return rf"<!-- {name} -->\n.*<!-- end of {name} -->\n"
