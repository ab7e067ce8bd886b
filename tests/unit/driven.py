"""A campaign made and run on the bench's page with mouse and keyboard, from dropped files to the
report within; nothing else touches the workspace.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .browser import Page

#: A whole run, where many programs share the machine.
RUN_S = 600.0
#: What is clicked or dropped before a page's script has run is lost.
LOADED = "location.pathname === '{}' && document.readyState === 'complete'"
STATE = "document.querySelector('#state').textContent"


def make(page: Page, name: str, *dropped: Path) -> None:
    """Drop files on *New campaign*, and make the campaign of them."""
    files = sum(len(list(p.iterdir())) if p.is_dir() else 1 for p in dropped)
    page.wait(LOADED.format("/"))
    page.click("nav a[href='/new']")
    page.wait(LOADED.format("/new"))
    page.drop("#drop", *dropped)
    page.write("[name=name]", name)
    page.wait(
        f"document.querySelector('#count').textContent === '{files} of {files} files are there'"
    )
    page.errors.clear()
    page.click("#fresh button")
    on(page, "edit")


def on(page: Page, name: str) -> None:
    """Wait for a page of that name, or say what refuses it."""
    page.wait(
        f"document.body?.dataset.page === '{name}' || document.querySelector('main > .refusal')"
    )
    assert page.run("document.body.dataset.page") == name, page.run("document.body.innerText")
    page.wait("document.querySelector('#state')?.textContent !== ''")


def fill(page: Page, values: Mapping[str, str]) -> None:
    """Each value into its field; a choice by its first letters, as a keyboard makes it."""
    for key, value in values.items():
        box = f"[data-key={json.dumps(key)}]"
        page.wait(f"document.querySelector({json.dumps(box)})")
        if page.run(f"document.querySelector({json.dumps(box)}).tagName") == "SELECT":
            page.run(f"document.querySelector({json.dumps(box)}).focus()")
            page.run(
                f"(b => {{ b.value = {json.dumps(value)};"
                " b.dispatchEvent(new Event('change', { bubbles: true })); })"
                f"(document.querySelector({json.dumps(box)}))"
            )
        else:
            page.write(box, value)
    says = "Object.fromEntries([...document.querySelectorAll('[data-key]')].map(b => [b.dataset.key, b.value]))"
    for key, value in values.items():
        page.wait(
            f"({says})[{json.dumps(key)}] === {json.dumps(value or None)} || {json.dumps(not value)}"
        )


def refusals(page: Page) -> list[str]:
    """What the page still refuses, each with its field."""
    found: list[str] = page.run(
        "[...document.querySelectorAll('.refusal')].filter(e => e.textContent)"
        ".map(e => `${e.id} ${e.textContent}`)"
    )
    return found


def settled(page: Page) -> None:
    """Wait until nothing is refused."""
    try:
        page.wait(f"{STATE}.endsWith('nothing is refused')")
    except AssertionError:
        raise AssertionError(refusals(page)) from None


def run(page: Page) -> dict[str, Any]:
    """Save, run, and read the report that opens: what it says in its frame."""
    page.click("button[name=then][value=run]")
    page.wait(
        "location.pathname === '/report' || document.querySelector('main > .refusal')"
        " || document.querySelector('#state')?.textContent.startsWith('refused')",
        RUN_S,
    )
    assert page.run("location.pathname") == "/report", page.run("document.body.innerText")
    page.wait("document.querySelector('iframe')?.contentDocument?.querySelectorAll('h1').length")
    frame = "document.querySelector('iframe').contentDocument"
    return {
        "title": page.run(f"{frame}.querySelector('h1').textContent"),
        "text": page.run(f"{frame}.body.innerText"),
        "figures": page.run(f"{frame}.querySelectorAll('figure svg, figure img').length"),
    }
