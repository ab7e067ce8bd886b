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

from nearlift.errors import NearliftError, UsageError
from nearlift.serve.answers import TEXT, Answer, Asked, as_json, see
from nearlift.serve.bench import MANIFEST, Bench, NotThere, Place, command_line
from nearlift.serve.gate import POLICY
from nearlift.stages.asked import ROUNDS

Handler = Callable[[Bench, Asked], Answer]


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


def page(bench: Bench, name: str, title: str, **facts: Any) -> Answer:
    """A page of the template of that name."""
    given: dict[str, object] = {"title": title, "workspace": str(bench.root), **facts}
    template = _templates().get_template(f"{name}.html.j2")
    return Answer(body=template.render(given).encode())


def refused(bench: Bench, refusal: NearliftError) -> Answer:
    """The page that says why not."""
    found = page(bench, "refusal", "Refused", refusal=refusal)
    return Answer(body=found.body, status=404 if isinstance(refusal, NotThere) else 409)


def campaigns(bench: Bench, asked: Asked) -> Answer:
    """All campaigns, each with what it says."""
    from nearlift.products import RESULTS
    from nearlift.results.quotation import Results
    from nearlift.run import store

    rows = []
    for folder, place in bench.campaigns():
        if isinstance(place, NearliftError):
            rows.append({"folder": folder, "refusal": place})
            continue
        file = place.homes.processed / RESULTS.file
        found = store.load_if_whole(file, Results(boundaries={}))
        rows.append(
            {
                "folder": place.given,
                "name": place.name,
                "refusal": None,
                "boundaries": found.boundaries,
                "report": (place.homes.reports / "index.html").is_file(),
            }
        )
    works = list(reversed(bench.works.values()))
    return page(bench, "campaigns", "Campaigns", rows=rows, works=works)


def past(bench: Bench, asked: Asked) -> Answer:
    """The kept runs of a campaign."""
    from nearlift.run import history
    from nearlift.run.lock import settled

    place = bench.campaign(asked.one("campaign"))
    settled(place.homes)
    kept = [
        {"folder": f"processed/{place.name}/history/{folder.name}", "run": history.read(folder)}
        for folder in history.folders(place.homes)
    ]
    command = command_line(("history", place.given))
    return page(bench, "history", f"History of {place.name}", place=place, runs=kept, cmd=command)


def difference(bench: Bench, asked: Asked) -> Answer:
    """What changed between two runs."""
    both = asked.all("run")
    if len(both) != 2:
        raise UsageError("runs", f"{len(both)} were chosen", "choose two")
    for folder in both:
        bench.inside(folder)
    words = ("compare-runs", *both)
    text = bench.ask(words)
    return page(bench, "text", "Two runs", text=text, cmd=command_line(words))


def begin(bench: Bench, asked: Asked) -> Answer:
    """A command that takes its time."""
    what, title, result, campaign = asked.one("do"), "", "", ""
    if what == "compare":
        names = [bench.campaign(given).name for given in asked.all("campaign")]
        words, title, result = (
            ("compare", *names),
            "Comparison",
            "/file/reports/comparison/index.html",
        )
    elif what == "watch":
        place = bench.campaign(asked.one("campaign"))
        bench.begin(watch_words(place), f"watch {place.name}", campaign=place.given)
        return see("/live", campaign=place.given)
    elif what in ("run", "verify", "segments"):
        place = bench.campaign(asked.one("campaign"))
        words = (what, place.given, *(("-v",) if what == "run" else ()))
        title, campaign = f"{what} {place.name}", place.given
        result = {
            "run": f"/report?campaign={quote(place.given)}",
            "segments": f"/file/reports/{place.name}/segments.png",
        }.get(what, "")
    else:
        raise NotThere(what, "is not what this page can do", "type the command")
    return see("/work", key=bench.begin(words, title, result, campaign).key)


def work(bench: Bench, asked: Asked) -> Answer:
    """A command at work."""
    own = bench.work(asked.one("key"))
    stages = _stages(bench.campaign(own.campaign)) if own.words[0] == "run" else []
    return page(bench, "work", own.title, work=own, cmd=own.command, stages=stages)


def _stages(place: Place) -> list[dict[str, object]]:
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


def cancel(bench: Bench, asked: Asked) -> Answer:
    """End a command."""
    own = bench.work(asked.one("key"))
    own.cancel()
    return see("/work", key=own.key)


def watch_words(place: Place) -> tuple[str, ...]:
    """The command that looks at a campaign whenever it has grown."""
    return ("run", place.given, "--watch", "--every", "1", "--json")


def live(bench: Bench, asked: Asked) -> Answer:
    """A campaign while it is recorded."""
    from nearlift.serve.live import watching

    place = bench.campaign(asked.one("campaign"))
    work, cmd = watching(bench, place), command_line(watch_words(place))
    title = f"{place.name}, live"
    return page(bench, "live", title, place=place, work=work, cmd=cmd, rounds=ROUNDS)


def looked(bench: Bench, asked: Asked) -> Answer:
    """What the last look at a campaign found."""
    from nearlift.serve.live import looked

    return as_json(looked(bench.campaign(asked.one("campaign"))))


def upcoming(bench: Bench, asked: Asked) -> Answer:
    """The next visits, as JSON or as rows for the schedule."""
    place = bench.campaign(asked.one("campaign"))
    words = ["next", place.given, f"--for={asked.one('for')}"]
    if asked.one("until"):
        words.append(f"--until={asked.one('until')}")
    if asked.one("rounds") not in ("", str(ROUNDS)):
        words.append(f"--rounds={asked.one('rounds')}")
    if asked.one("as") == "csv":
        text = bench.ask([*words, "--csv"])
        named = {"content-disposition": f'attachment; filename="{place.name}-next.csv"'}
        return Answer(body=text.encode(), kind="text/csv; charset=utf-8", headers=named)
    try:
        found = json.loads(bench.ask([*words, "--json"]), parse_constant=lambda _: None)
    except NearliftError as refusal:
        found = {"refusal": refusal.what}
    return as_json({**found, "command": command_line(words)})


def report(bench: Bench, asked: Asked) -> Answer:
    """The finished page, within."""
    place = bench.campaign(asked.one("campaign"))
    bench.product(f"reports/{place.name}/index.html")
    return page(bench, "report", f"Report of {place.name}", place=place)


def fresh(bench: Bench, asked: Asked) -> Answer:
    """Where a new campaign begins."""
    folders = []
    for folder in sorted((bench.root / "raw").glob("*")):
        inside = folder.is_dir() and folder.resolve().is_relative_to(bench.root)
        if inside and not (folder / "campaign.toml").exists():
            folders.append(folder.relative_to(bench.root).as_posix())
    return page(bench, "new", "New campaign", folders=folders)


def make(bench: Bench, asked: Asked) -> Answer:
    """The campaign of what was dropped, or of what lies in a folder."""
    from nearlift.serve import draft

    name, chosen = asked.one("name"), asked.one("folder")
    root = bench.inside(chosen) if chosen else draft.folder_of(bench, name)
    given = root.relative_to(bench.root).as_posix()
    source = root / "trials" if (root / "trials").is_dir() else root
    if any(p.is_file() and not p.name.startswith(".") for p in source.glob("*")):
        bench.ask(["new", given, "--from", source.relative_to(bench.root).as_posix()])
    else:
        bench.ask(["new", given])
    return see("/edit", campaign=given)


def edit(bench: Bench, asked: Asked) -> Answer:
    """Manifest and schedule, as they stand."""
    from nearlift.serve import draft

    given = asked.one("campaign")
    root = bench.root_of(given)
    texts = {
        name: path.read_text(encoding="utf-8-sig", errors="replace") if path.is_file() else ""
        for name in (MANIFEST, draft.SCHEDULE)
        for path in (bench.inside(f"{given}/{name}"),)
    }
    known = {name: draft.digest(root / name) for name in texts}
    return _edited(bench, given, texts, known, "saved" if asked.one("said") == "saved" else "")


def _edited(
    bench: Bench, given: str, texts: dict[str, str], known: dict[str, str], said: str
) -> Answer:
    from nearlift.serve import draft

    manifest, schedule = texts[MANIFEST], texts[draft.SCHEDULE]
    return page(
        bench,
        "edit",
        given,
        given=given,
        cmd=command_line(("run", given)),
        manifest=manifest,
        schedule=schedule,
        known=known[MANIFEST],
        known_schedule=known[draft.SCHEDULE],
        refusals=draft.check(bench.root_of(given), manifest, schedule).refusals,
        said=said,
    )


def check(bench: Bench, asked: Asked) -> Answer:
    """What a form says, after one of its values was set; nothing is written."""
    from nearlift.serve import draft
    from nearlift.serve.manifest_text import with_value

    root, text = bench.root_of(asked.one("campaign")), asked.text("manifest")
    refusals: list[draft.Refused] = []
    if key := asked.one("set"):
        try:
            text = with_value(text, key, asked.one("value"))
        except NearliftError as refusal:
            refusals = [draft.Refused(key=key, text=f"{refusal.what}; {refusal.remedy}")]
    found = draft.check(root, text, asked.text("schedule"))
    found = replace(found, refusals=[*found.refusals, *refusals])
    return as_json({**asdict(found), "manifest": text})


def save(bench: Bench, asked: Asked) -> Answer:
    """Manifest and schedule into their places."""
    from nearlift.serve import draft

    given = asked.one("campaign")
    root = bench.root_of(given)
    texts = {
        MANIFEST: asked.text("manifest"),
        draft.SCHEDULE: asked.text("schedule"),
    }
    known = {MANIFEST: asked.one("known"), draft.SCHEDULE: asked.one("known_schedule")}
    try:
        draft.save(root, texts, known)
    except NearliftError as refusal:
        # what was typed stays
        return _edited(bench, given, texts, known, str(refusal))
    if then := asked.one("then"):
        return begin(bench, Asked({"do": [then], "campaign": [given]}))
    return see("/edit", campaign=given, said="saved")


def channels(bench: Bench, asked: Asked) -> Answer:
    """A record's channels, as they are drawn."""
    from nearlift.serve import draft

    root = bench.root_of(asked.one("campaign"))
    path = bench.inside(f"{asked.one('campaign')}/{asked.one('file')}")
    if not (path.is_file() and path.is_relative_to(root)):
        raise NotThere(path.name, "is no record of this campaign", "mend [records] files")
    return as_json(draft.channels(path))


def file(bench: Bench, relative: str) -> Answer:
    """A product as it stands; of scripts in it, a browser runs those of nearlift's reports."""
    from nearlift.report.page.render import policy, scripts

    path = bench.product(relative)
    kind, _ = mimetypes.guess_type(path.name)
    if kind == "text/html":
        rules = policy(scripts()) + "; frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
    else:
        rules = POLICY.split(";")[0] + "; frame-ancestors 'self'"
    if kind is None or kind in ("text/markdown", "text/csv", "application/toml"):
        kind = "application/octet-stream" if path.suffix == ".parquet" else TEXT
    kind = f"{kind}; charset=utf-8" if kind == "text/html" else kind
    return Answer(body=path.read_bytes(), kind=kind, headers={"content-security-policy": rules})


STATIC = {
    "page.css": "text/css",
    "bench.css": "text/css",
    "bench.js": "text/javascript",
    "grid.js": "text/javascript",
}


def static(name: str) -> Answer:
    """A style sheet or a script."""
    if name not in STATIC:
        raise NotThere(name, "is no part of this page", "reload it")
    where = "nearlift.report.page" if name == "page.css" else "nearlift.serve"
    body = Path(str(resources.files(where) / "templates" / name)).read_bytes()
    return Answer(body=body, kind=f"{STATIC[name]}; charset=utf-8")


#: By method and path.
PAGES: dict[tuple[str, str], Handler] = {
    ("GET", "/"): campaigns,
    ("GET", "/history"): past,
    ("GET", "/difference"): difference,
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
