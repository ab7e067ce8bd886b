"""Pages by address: the list of campaigns, one campaign live, products as they are."""

from __future__ import annotations

import functools
import hashlib
import mimetypes
import os
from datetime import datetime
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from markupsafe import Markup, escape

from nearlift import catalogue
from nearlift.errors import NearliftError
from nearlift.nomenclature import INDEXED
from nearlift.reduction import quality
from nearlift.report import phrases
from nearlift.results.diagnosis import NOTHING, BoundaryDiagnosis, DiagnosisResults
from nearlift.results.quotation import Results
from nearlift.rounding import plain, plus_minus
from nearlift.run import tables
from nearlift.run.watch import LATEST
from nearlift.serve.server import HEADERS, HTML, TEXT, HttpAnswer
from nearlift.stages.ingest import TRIALS

#: Trials listed, and trials with quality codes listed.
NEWEST, REMARKED = 40, 12
TONES = {"adequate": "good", "effect": "fair", "unexplained": "bad", "not_diagnosed": "none"}
NAMES = {"ground": "Ground", "ceiling": "Ceiling", "sidewall": "Sidewall", "none": "Free air"}
#: Figures of the report that the page shows, with headings.
FIGURES = {"fig2": "Lift near the boundary", "residuals": "Residuals by covariate"}
STATIC = {
    "page.css": ("nearlift.report.page", "text/css"),
    "serve.css": ("nearlift.serve", "text/css"),
    "live.js": ("nearlift.serve", "text/javascript"),
}


class NotThere(NearliftError):
    """The workspace holds no such campaign, file or page."""


def respond(root: Path, path: str, query: dict[str, str]) -> HttpAnswer:
    """Answer to one address of the workspace `root`; a refusal is a page too."""
    kind, _, rest = path.removeprefix("/").partition("/")
    root = root.resolve()
    try:
        match kind:
            case "" if not rest:
                return _page(root, "Campaigns", listed=_listed(root))
            case "campaign":
                return _campaign(root, rest, query)
            case "processed" | "reports":
                return _product(root, f"{kind}/{rest}")
            case "static" if rest in STATIC:
                package, content = STATIC[rest]
                body = resources.files(package).joinpath("templates", rest).read_bytes()
                return HttpAnswer(body=body, kind=f"{content}; charset=utf-8")
            case "favicon.ico":
                return HttpAnswer(status=204)
        raise NotThere(path[:200], "is no page", "begin with the list of campaigns")
    except NearliftError as refusal:
        status = 404 if isinstance(refusal, NotThere) else 409
        return _page(root, "Refused", status, refusal=refusal)


def campaigns(root: Path) -> list[str]:
    """Names of the campaigns that have trials, in order; none behind a link out of `root`."""
    files = root.glob(f"processed/*/{TRIALS.file}")
    return sorted(p.parent.name for p in files if p.resolve().is_relative_to(root))


def _listed(root: Path) -> list[dict[str, Any]]:
    return [
        {"name": name, "report": (root / "reports" / name / "index.html").is_file()}
        | _cards(root / "processed" / name)
        for name in campaigns(root)
    ]


def _campaign(root: Path, name: str, query: dict[str, str]) -> HttpAnswer:
    """One campaign; empty where the browser has `seen` this state of it."""
    if name not in campaigns(root):
        raise NotThere(name[:200], "is no campaign that was run here", "choose one of the list")
    processed, reports = root / "processed" / name, root / "reports" / name
    state = stamp(processed, reports)
    if query.get("seen") == state:
        return HttpAnswer(status=204)
    facts = {
        "stamp": state,
        "figures": {n: title for n, title in FIGURES.items() if (reports / f"{n}.png").is_file()},
        "report": (reports / "index.html").is_file(),
        "watch": _last_round(processed),
        **_trials(processed),
        **_cards(processed),
    }
    return _page(root, name, **facts)


def _cards(processed: Path) -> dict[str, Any]:
    """Cards of all boundaries, none before the first fit; or the reason why there are none."""
    file = processed / Results.file
    try:
        quoted = tables.load(file, Results).boundaries if file.is_file() else {}
    except NearliftError as refusal:
        return {"cards": [], "fault": refusal}
    diagnosed = tables.load_if_whole(processed / DiagnosisResults.file, NOTHING).boundaries
    cards = []
    for boundary, result in quoted.items():
        diagnosis = diagnosed.get(boundary)
        look = diagnosis.look if isinstance(diagnosis, BoundaryDiagnosis) else None
        rivals = ", ".join(result.rivals) if phrases.is_sure(result) else ""
        notes = (
            f"not distinguished from {rivals}" if rivals else "",
            look.text if look else "",
            phrases.dependence(result),
        )
        card = {
            "boundary": NAMES[boundary],
            "claim": phrases.claim(result, diagnosis),
            "tone": TONES[result.verdict],
            "coefficients": [
                phrases.coefficient_text(c, n) for n, c in result.coefficients.items()
            ],
            "notes": [note for note in notes if note],
        }
        cards.append(card)
    return {"cards": cards, "fault": None}


def _trials(processed: Path) -> dict[str, Any]:
    """Number of trials, the newest, and those to check."""
    trials = pd.DataFrame(tables.read_table(processed / TRIALS.file, TRIALS))
    landed = trials[~trials["quality"].str.contains("MISSING")].iloc[::-1]
    newest = [
        [
            t["trial"],
            NAMES[t["boundary"]],
            "" if t["boundary"] == "none" else plain(t["z_hat"], 3),
            plain(100 * t["throttle"], 3),
            "" if pd.isna(t["lift_N"]) else plus_minus(1e3 * t["lift_N"], 1e3 * t["u_lift_N"]),
            t["quality"] or "good",
        ]
        for t in landed.head(NEWEST).to_dict("records")
    ]
    remarked = landed[landed["quality"] != ""].head(REMARKED)
    remarks = [
        (trial, "; ".join(f"{code}: {quality.CODES[code]}" for code in codes.split()))
        for trial, codes in zip(remarked["trial"], remarked["quality"], strict=True)
    ]
    return {"landed": len(landed), "scheduled": len(trials), "newest": newest, "remarks": remarks}


def stamp(processed: Path, reports: Path) -> str:
    """Digest that changes when a product that the page shows does."""
    files = [
        processed / name for name in (TRIALS.file, Results.file, DiagnosisResults.file, LATEST)
    ]
    files += [reports / name for name in (*(f"{n}.png" for n in FIGURES), "index.html")]
    states = [(s.st_size, s.st_mtime_ns) if (s := _status(path)) else None for path in files]
    return hashlib.sha256(repr(states).encode()).hexdigest()[:16]


def _last_round(processed: Path) -> dict[str, object] | None:
    """Last round of `nearlift run --watch`, unless a later run replaced the results."""
    latest, results = _status(processed / LATEST), _status(processed / Results.file)
    if latest is None or (results and results.st_mtime_ns > latest.st_mtime_ns):
        return None
    content = tables.read_json_if_whole(processed / LATEST)
    return {"time": datetime.fromtimestamp(latest.st_mtime), **content} if content else None


def _status(path: Path) -> os.stat_result | None:
    return path.stat() if path.is_file() else None


def _product(root: Path, relative: str) -> HttpAnswer:
    """File below ``processed/`` or ``reports/`` as it is, links resolved. A browser runs no script
    of it but those of nearlift's reports.
    """
    from nearlift.report.page.render import policy, scripts

    try:
        path = (root / relative).resolve(strict=True)
    except (OSError, ValueError, RuntimeError):
        path = root
    homes = (root / "processed", root / "reports")
    if not (path.is_file() and any(path.is_relative_to(home) for home in homes)):
        what, remedy = "is no product of this workspace", "run the campaign first"
        raise NotThere(relative[:200], what, remedy)
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


def _page(root: Path, title: str, status: int = 200, **facts: Any) -> HttpAnswer:
    about = {"title": title, "workspace": str(root)}
    text = _template().render({"listed": None, "refusal": None, **about, **facts})
    return HttpAnswer(body=text.encode(), status=status)


@functools.cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("nearlift.serve", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["spoken"] = spoken
    return environment.get_template("page.html.j2")


def spoken(text: str) -> Markup:
    """Text with titles for effects and models, and letters with their index as symbols."""
    words = escape(catalogue.titled(text).replace("z_hat", "ẑ"))
    return Markup(INDEXED.sub(r"<i>\1</i><sub>\2</sub>", str(words)))
