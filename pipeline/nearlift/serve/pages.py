"""The pages and what their buttons begin: each a function of the workspace and of what was asked,
which answers bytes.
"""

from __future__ import annotations

import functools
import json
import mimetypes
from collections.abc import Callable
from dataclasses import asdict, replace
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

from nearlift.errors import NearliftError
from nearlift.serve.answers import TEXT, PageAnswer, PageQuery, as_json, see
from nearlift.serve.bench import MANIFEST, NotThere, ServedCampaign, ServedWorkspace, command_line
from nearlift.serve.gate import POLICY
from nearlift.stages.asked import ROUNDS

Handler = Callable[[ServedWorkspace, PageQuery], PageAnswer]


@functools.cache
def _templates() -> Any:
    import jinja2

    from nearlift import catalogue

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("nearlift.serve", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["titled"] = catalogue.titled
    return environment


def page(workspace: ServedWorkspace, name: str, title: str, **facts: Any) -> PageAnswer:
    """A page of the template of that name."""
    given: dict[str, object] = {"title": title, "workspace": str(workspace.root), **facts}
    template = _templates().get_template(f"{name}.html.j2")
    return PageAnswer(body=template.render(given).encode())


def refused(workspace: ServedWorkspace, refusal: NearliftError) -> PageAnswer:
    """The page that says why not."""
    answer = page(workspace, "refusal", "Refused", refusal=refusal)
    return PageAnswer(body=answer.body, status=404 if isinstance(refusal, NotThere) else 409)


def campaigns(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """All campaigns, each with what it says."""
    from nearlift.products import RESULTS
    from nearlift.results.quotation import Results
    from nearlift.run import store

    rows = []
    for folder, place in workspace.campaigns():
        if isinstance(place, NearliftError):
            rows.append({"folder": folder, "refusal": place})
            continue
        file = place.homes.processed / RESULTS.file
        results = store.load_if_whole(file, Results(boundaries={}))
        rows.append(
            {
                "folder": place.given,
                "name": place.name,
                "refusal": None,
                "boundaries": results.boundaries,
                "report": (place.homes.reports / "index.html").is_file(),
            }
        )
    works = list(reversed(workspace.works.values()))
    return page(workspace, "campaigns", "Campaigns", rows=rows, works=works)


def begin(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """A command that takes its time."""
    what, title, result, campaign = query.one("do"), "", "", ""
    if what == "compare":
        names = [workspace.campaign(given).name for given in query.all("campaign")]
        words, title = ("compare", *names), "Comparison"
        result = "/file/reports/comparison/index.html"
    elif what == "watch":
        place = workspace.campaign(query.one("campaign"))
        workspace.begin(watch_words(place), f"watch {place.name}", campaign=place.given)
        return see("/live", campaign=place.given)
    elif what in ("run", "verify", "segments"):
        place = workspace.campaign(query.one("campaign"))
        words = {
            "run": ("run", place.given, "-v"),
            "verify": ("run", "--check", place.given),
            "segments": ("inspect", "--cuts", place.given),
        }[what]
        title, campaign = f"{what} {place.name}", place.given
        result = {
            "run": f"/report?campaign={quote(place.given)}",
            "segments": f"/file/reports/{place.name}/segments.png",
        }.get(what, "")
    else:
        raise NotThere(what, "is not what this page can do", "type the command")
    return see("/work", key=workspace.begin(words, title, result, campaign).key)


def work(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """A command at work."""
    command = workspace.work(query.one("key"))
    stages = _stages(workspace.campaign(command.campaign)) if command.words[0] == "run" else []
    return page(workspace, "work", command.title, work=command, cmd=command.command, stages=stages)


def _stages(place: ServedCampaign) -> list[dict[str, object]]:
    """Each stage, and the seconds that it took the last time."""
    from nearlift.products import PROVENANCE
    from nearlift.results.provenance import ProvenanceLedger
    from nearlift.run import store
    from nearlift.run.registry import STAGES

    known = store.load_if_whole(place.homes.processed / PROVENANCE.file, ProvenanceLedger()).stages
    return [
        {
            "name": s.name,
            "summary": s.summary,
            "wall_s": known[s.name].wall_s if s.name in known else 0,
        }
        for s in STAGES
    ]


def cancel(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """End a command."""
    command = workspace.work(query.one("key"))
    command.cancel()
    return see("/work", key=command.key)


def watch_words(place: ServedCampaign) -> tuple[str, ...]:
    """The command that looks at a campaign whenever it has grown."""
    return ("run", place.given, "--watch", "--every", "1", "--json")


def live(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """A campaign while it is recorded."""
    from nearlift.serve.live import watching

    place = workspace.campaign(query.one("campaign"))
    work, cmd = watching(workspace, place), command_line(watch_words(place))
    title = f"{place.name}, live"
    return page(workspace, "live", title, place=place, work=work, cmd=cmd, rounds=ROUNDS)


def looked(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """What the last look at a campaign found."""
    from nearlift.serve.live import looked

    return as_json(looked(workspace.campaign(query.one("campaign"))))


def upcoming(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """The next visits, as JSON or as rows for the schedule."""
    place = workspace.campaign(query.one("campaign"))
    words = ["next", place.given, f"--for={query.one('for')}"]
    if query.one("until"):
        words.append(f"--until={query.one('until')}")
    if query.one("rounds") not in ("", str(ROUNDS)):
        words.append(f"--rounds={query.one('rounds')}")
    if query.one("as") == "csv":
        text = workspace.ask([*words, "--csv"])
        named = {"content-disposition": f'attachment; filename="{place.name}-next.csv"'}
        return PageAnswer(body=text.encode(), kind="text/csv; charset=utf-8", headers=named)
    try:
        visits = json.loads(workspace.ask([*words, "--json"]), parse_constant=lambda _: None)
    except NearliftError as refusal:
        visits = {"refusal": refusal.what}
    return as_json({**visits, "command": command_line(words)})


def report(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """The finished page, within."""
    place = workspace.campaign(query.one("campaign"))
    workspace.product(f"reports/{place.name}/index.html")
    return page(workspace, "report", f"Report of {place.name}", place=place)


def fresh(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """Where a new campaign begins."""
    folders = []
    for folder in sorted((workspace.root / "raw").glob("*")):
        inside = folder.is_dir() and folder.resolve().is_relative_to(workspace.root)
        if inside and not (folder / "campaign.toml").exists():
            folders.append(folder.relative_to(workspace.root).as_posix())
    return page(workspace, "new", "New campaign", folders=folders)


def make(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """The campaign of what was dropped, or of what lies in a folder."""
    from nearlift.serve import draft

    name, chosen = query.one("name"), query.one("folder")
    root = workspace.inside(chosen) if chosen else draft.folder_of(workspace, name)
    given = root.relative_to(workspace.root).as_posix()
    source = root / "trials" if (root / "trials").is_dir() else root
    if any(p.is_file() and not p.name.startswith(".") for p in source.glob("*")):
        workspace.ask(["new", given, "--from", source.relative_to(workspace.root).as_posix()])
    else:
        workspace.ask(["new", given])
    return see("/edit", campaign=given)


def edit(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """Manifest and schedule, as they stand."""
    from nearlift.serve import draft

    given = query.one("campaign")
    root = workspace.root_of(given)
    texts = {
        name: path.read_text(encoding="utf-8-sig", errors="replace") if path.is_file() else ""
        for name in (MANIFEST, draft.SCHEDULE)
        for path in (workspace.inside(f"{given}/{name}"),)
    }
    known = {name: draft.digest(root / name) for name in texts}
    return _edited(workspace, given, texts, known, "saved" if query.one("said") == "saved" else "")


def _edited(
    workspace: ServedWorkspace, given: str, texts: dict[str, str], known: dict[str, str], said: str
) -> PageAnswer:
    from nearlift.serve import draft

    manifest, schedule = texts[MANIFEST], texts[draft.SCHEDULE]
    return page(
        workspace,
        "edit",
        given,
        given=given,
        cmd=command_line(("run", given)),
        manifest=manifest,
        schedule=schedule,
        known=known[MANIFEST],
        known_schedule=known[draft.SCHEDULE],
        refusals=draft.check(workspace.root_of(given), manifest, schedule).refusals,
        said=said,
    )


def check(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """What a form says, after one of its values was set; nothing is written."""
    from nearlift.serve import draft
    from nearlift.serve.manifest_text import with_value

    root, text = workspace.root_of(query.one("campaign")), query.text("manifest")
    refusals: list[draft.DraftFault] = []
    if key := query.one("set"):
        try:
            text = with_value(text, key, query.one("value"))
        except NearliftError as refusal:
            refusals = [draft.DraftFault(key=key, text=f"{refusal.what}; {refusal.remedy}")]
    checked = draft.check(root, text, query.text("schedule"))
    checked = replace(checked, refusals=[*checked.refusals, *refusals])
    return as_json({**asdict(checked), "manifest": text})


def save(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """Manifest and schedule into their places."""
    from nearlift.serve import draft

    given = query.one("campaign")
    root = workspace.root_of(given)
    texts = {
        MANIFEST: query.text("manifest"),
        draft.SCHEDULE: query.text("schedule"),
    }
    known = {MANIFEST: query.one("known"), draft.SCHEDULE: query.one("known_schedule")}
    try:
        draft.save(root, texts, known)
    except NearliftError as refusal:
        # what was typed stays
        return _edited(workspace, given, texts, known, str(refusal))
    if then := query.one("then"):
        return begin(workspace, PageQuery({"do": [then], "campaign": [given]}))
    return see("/edit", campaign=given, said="saved")


def channels(workspace: ServedWorkspace, query: PageQuery) -> PageAnswer:
    """A record's channels, as they are drawn."""
    from nearlift.serve import draft

    root = workspace.root_of(query.one("campaign"))
    path = workspace.inside(f"{query.one('campaign')}/{query.one('file')}")
    if not (path.is_file() and path.is_relative_to(root)):
        raise NotThere(path.name, "is no record of this campaign", "mend [records] files")
    return as_json(draft.channels(path))


def file(workspace: ServedWorkspace, relative: str) -> PageAnswer:
    """A product as it stands; of scripts in it, a browser runs those of nearlift's reports."""
    from nearlift.report.page.render import policy, scripts

    path = workspace.product(relative)
    kind, _ = mimetypes.guess_type(path.name)
    if kind == "text/html":
        rules = policy(scripts()) + "; frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
    else:
        rules = POLICY.split(";")[0] + "; frame-ancestors 'self'"
    if kind is None or kind in ("text/markdown", "text/csv", "application/toml"):
        kind = "application/octet-stream" if path.suffix == ".parquet" else TEXT
    kind = f"{kind}; charset=utf-8" if kind == "text/html" else kind
    return PageAnswer(body=path.read_bytes(), kind=kind, headers={"content-security-policy": rules})


STATIC = {
    "page.css": "text/css",
    "bench.css": "text/css",
    "bench.js": "text/javascript",
    "grid.js": "text/javascript",
}


def static(name: str) -> PageAnswer:
    """A style sheet or a script."""
    if name not in STATIC:
        raise NotThere(name, "is no part of this page", "reload it")
    where = "nearlift.report.page" if name == "page.css" else "nearlift.serve"
    body = Path(str(resources.files(where) / "templates" / name)).read_bytes()
    return PageAnswer(body=body, kind=f"{STATIC[name]}; charset=utf-8")


#: By method and path.
PAGES: dict[tuple[str, str], Handler] = {
    ("GET", "/"): campaigns,
    ("GET", "/work"): work,
    ("GET", "/report"): report,
    ("GET", "/live"): live,
    ("GET", "/looked"): looked,
    ("GET", "/next"): upcoming,
    ("GET", "/new"): fresh,
    ("POST", "/new"): make,
    ("GET", "/edit"): edit,
    ("GET", "/channels"): channels,
    ("POST", "/check"): check,
    ("POST", "/save"): save,
    ("POST", "/begin"): begin,
    ("POST", "/cancel"): cancel,
}
