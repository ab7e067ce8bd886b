"""Pages by address: the list of campaigns, one campaign live, products as they are."""

from __future__ import annotations

import functools
import mimetypes
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape

from nearlift import catalogue
from nearlift.errors import NearliftError
from nearlift.nomenclature import INDEXED
from nearlift.serve import live, workspace
from nearlift.serve.server import HEADERS, HTML, TEXT, HttpAnswer, Respond
from nearlift.serve.workspace import NotThere

STATIC = {
    "page.css": ("nearlift.report.page", "text/css"),
    "serve.css": ("nearlift.serve", "text/css"),
    "live.js": ("nearlift.serve", "text/javascript"),
}


def responder(root: Path) -> Respond:
    """Answers to what a browser asks of this workspace."""
    return functools.partial(respond, root.resolve())


def respond(root: Path, path: str, query: dict[str, str]) -> HttpAnswer:
    """HttpAnswer to one address; a refusal is a page too."""
    try:
        kind, _, rest = path.removeprefix("/").partition("/")
        match kind:
            case "" if not rest:
                return _campaigns(root)
            case "campaign":
                return _campaign(root, rest, query)
            case "processed" | "reports":
                return _product(root, f"{kind}/{rest}")
            case "static":
                return _static(rest)
            case "favicon.ico":
                return HttpAnswer(status=204)
        raise NotThere(path[:200], "is no page", "begin with the list of campaigns")
    except NearliftError as refusal:
        status = 404 if isinstance(refusal, NotThere) else 409
        return _page(root, "refusal", "Refused", status, refusal=refusal)


def _campaigns(root: Path) -> HttpAnswer:
    """List of all campaigns with verdicts and quoted numbers."""
    rows = []
    for name in workspace.campaigns(root):
        cards, refusal = live.verdicts_or_refusal(workspace.place(root, name))
        report = (root / "reports" / name / "index.html").is_file()
        rows.append({"name": name, "verdicts": cards, "refusal": refusal, "report": report})
    comparison = (root / "reports/comparison/index.html").is_file()
    return _page(root, "campaigns", "Campaigns", rows=rows, comparison=comparison)


def _campaign(root: Path, name: str, query: dict[str, str]) -> HttpAnswer:
    """One campaign; empty where the browser has `seen` this state of it."""
    place = workspace.place(root, name)
    if query.get("seen") == live.stamp(place):
        return HttpAnswer(status=204)
    return _page(root, "campaign", name, **live.facts(place))


def _product(root: Path, relative: str) -> HttpAnswer:
    """File as it is. A browser runs no script of it but those of nearlift's reports."""
    from nearlift.report.page.render import policy, scripts

    path = workspace.product(root, relative)
    kind, _ = mimetypes.guess_type(path.name)
    rules = HEADERS["Content-Security-Policy"].split(";")[0]
    if kind == "text/html":
        rules, kind = policy(scripts()) + "; base-uri 'none'; form-action 'none'", HTML
    elif path.suffix == ".parquet":
        kind = "application/octet-stream"
    elif kind is None or kind.startswith("text/"):
        kind = TEXT
    headers = {"Content-Security-Policy": f"{rules}; frame-ancestors 'none'"}
    return HttpAnswer(body=path.read_bytes(), kind=kind, headers=headers)


def _static(name: str) -> HttpAnswer:
    """Style sheet or script."""
    if name not in STATIC:
        raise NotThere(name[:200], "is no part of this page", "reload it")
    package, kind = STATIC[name]
    body = resources.files(package).joinpath("templates", name).read_bytes()
    return HttpAnswer(body=body, kind=f"{kind}; charset=utf-8")


def _page(root: Path, template: str, title: str, status: int = 200, **facts: Any) -> HttpAnswer:
    """Page of a template."""
    made = _templates().get_template(f"{template}.html.j2")
    text = made.render(title=title, workspace=str(root), **facts)
    return HttpAnswer(body=text.encode(), status=status)


@functools.cache
def _templates() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("nearlift.serve", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["spoken"] = spoken
    return environment


def spoken(text: str) -> Markup:
    """Text with titles for effects and models, and letters with their index as symbols."""
    words = escape(catalogue.titled(text).replace("z_hat", "ẑ"))
    return Markup(INDEXED.sub(r"<i>\1</i><sub>\2</sub>", str(words)))
