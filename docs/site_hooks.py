"""Hooks of mkdocs: list the generated pages in the navigation, draw formulas as pictures.

matplotlib sets the formulas, so that the site needs no script and no network.
"""

from __future__ import annotations

import functools
import html
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib import mathtext

DOCS = Path(__file__).parent
#: What matplotlib calls otherwise.
SYNONYMS = {
    r"\lvert": "|",
    r"\rvert": "|",
    r"\lVert": r"\Vert",
    r"\rVert": r"\Vert",
    r"\dfrac": r"\frac",
    r"\tfrac": r"\frac",
    r"\text": r"\mathrm",
}
#: A fenced block or code, which is left alone; a formula on a line of its own; a formula within a
#: line.
PIECES = re.compile(
    r"(?P<code>^```.*?^```|^(?:   "
    r" ).*?$|`[^`\n]*`)|^\$\$(?P<block>.+?)\$\$$|(?<![\\$])\$(?P<inline>[^$\n]+?)\$(?!\$)",
    re.M | re.S,
)


def on_config(config: Any) -> Any:
    """Replace REFERENCE in the navigation by the generated pages."""
    folders = {"Models": "models", "Effects": "effects", "Products": "products"}
    reference: list[Any] = [
        {name: _listed(f"reference/{folder}")} for name, folder in folders.items()
    ]
    known = {
        "REFERENCE": [
            *reference,
            "reference/stages.md",
            "reference/nomenclature.md",
            "reference/cli.md",
        ]
    }
    config.nav = _filled(config.nav, known)
    # pages that mkdocs.yml does not list
    placed = set(_pages(config.nav))
    others = [
        p.relative_to(DOCS).as_posix()
        for p in sorted(DOCS.rglob("*.md"))
        if p.relative_to(DOCS).as_posix() not in placed
    ]
    config.nav += [{"More": others}] if others else []
    return config


def _pages(nav: Any) -> Iterator[str]:
    if isinstance(nav, str):
        yield nav
    else:
        for item in nav if isinstance(nav, list) else nav.values():
            yield from _pages(item)


def _listed(folder: str) -> list[str]:
    names = sorted(path.name for path in (DOCS / folder).glob("*.md") if path.name != "index.md")
    return [f"{folder}/index.md", *(f"{folder}/{name}" for name in names)]


def _filled(nav: Any, known: dict[str, list[Any]]) -> Any:
    if isinstance(nav, list):
        return [
            inner
            for item in nav
            for inner in (
                known[item] if isinstance(item, str) and item in known else [_filled(item, known)]
            )
        ]
    if isinstance(nav, dict):
        return {
            title: (
                known.get(item, _filled(item, known))
                if isinstance(item, str)
                else _filled(item, known)
            )
            for title, item in nav.items()
        }
    return nav


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Formulas to pictures."""

    def drawn(found: re.Match[str]) -> str:
        if found["code"]:
            return found[0]
        if found["block"]:
            return f'<p style="text-align:center">{picture(found["block"].strip(), 13)}</p>'
        return picture(found["inline"].strip(), 9.5)

    return PIECES.sub(drawn, markdown)


@functools.cache
def picture(latex: str, size_pt: float) -> str:
    """A formula as SVG in the colour of the text, its baseline on the line's; read out as its
    LaTeX.
    """
    sink = io.StringIO()
    set_as = latex
    for name, known in SYNONYMS.items():
        set_as = set_as.replace(name, known)
    with matplotlib.rc_context(
        {"mathtext.fontset": "stix", "svg.hashsalt": latex, "font.size": size_pt}
    ):
        depth = mathtext.math_to_image(f"${set_as}$", sink, format="svg", color="#123456")
    drawing = sink.getvalue()
    drawing = drawing[drawing.index("<svg") :].replace("#123456", "currentColor")
    drawing = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", drawing, flags=re.S)
    # one line: markdown would take a blank line for the end
    drawing = " ".join(drawing.split()).replace(
        "<svg ", f'<svg style="vertical-align:{-depth:.2f}pt" ', 1
    )
    return f'<span role="img" aria-label="{html.escape(latex)}">{drawing}</span>'.replace(
        "|", "&#124;"
    )
