"""``python -m measured``: fetch the public campaigns, diagnose them, and write docs/measured.md."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

from nearlift.datasets import registry
from nearlift.errors import NearliftError, NotConverged

from . import injections, loop, page
from .campaigns import CAMPAIGNS, campaign
from .injections import Case

ROOT = Path(__file__).resolve().parent.parent


def say(text: str) -> None:
    """Progress, on standard error."""
    print(text, file=sys.stderr, flush=True)


def options() -> argparse.ArgumentParser:
    """Options of the command."""
    parser = argparse.ArgumentParser(prog="python -m measured", description=__doc__)
    parser.add_argument("names", nargs="*", help="campaigns [all]; with names no page is written")
    parser.add_argument("--out", type=Path, default=ROOT / "processed" / "measured")
    parser.add_argument(
        "--data", type=Path, default=ROOT.parent / "shared" / "data", help="files at hand"
    )
    parser.add_argument("--registry", type=Path, default=registry.OWN)
    parser.add_argument("--cache", type=Path, help="where fetched files are kept")
    parser.add_argument("--page", type=Path, default=page.DOCS)
    parser.add_argument(
        "--case",
        nargs="+",
        metavar="CAMPAIGN KIND SIZE",
        help=f"one variant; kinds: published, none, withheld, {', '.join(injections.KINDS)}",
    )
    return parser


def main(words: list[str] | None = None) -> int:
    """Run the command; its exit code."""
    args = options().parse_args(words)
    try:
        if args.case:
            one(args, Case(args.case[0], *args.case[1:2], *map(float, args.case[2:3])))
        else:
            everything(args)
    except NearliftError as fault:
        say(str(fault))
        return fault.exit_code
    return 0


def made(args: argparse.Namespace, name: str) -> Path:
    """Folder of a campaign, fetched where it is not there."""
    folder: Path = args.out / "raw" / name
    return campaign(name, folder, args.data, say, listed=args.registry, cache=args.cache)


def finished(args: argparse.Namespace, name: str) -> Path:
    """Products of a campaign, made where they are not there."""
    place: Path = args.out / "processed" / name
    if not (place / "diagnosis.json").is_file():
        say(f"{name}: diagnosis")
        loop.stages(made(args, name), args.out, "ingest", "reduce", "fit", "diagnose")
    return place


def variant(args: argparse.Namespace, case: Case) -> loop.Finding:
    """Finding of one variant; made once, then kept."""
    kept = args.out / "cases" / f"{case.name}.json"
    if not kept.is_file():
        folder = made(args, case.campaign)
        plain = case.kind in ("published", "withheld")
        floor = 0.0 if plain else variant(args, replace(case, kind="published", size=0.0)).floor
        folder = injections.written(case, folder, args.out / "variants" / case.name, floor)
        loop.stages(folder, args.out / "variants", "ingest")
        loop.diagnosed(*loop.ingested(folder, args.out / "variants")).save(kept)
    return loop.Finding.load(kept)


def one(args: argparse.Namespace, case: Case) -> None:
    """Print one row, and the campaign without the injection."""
    found, without = variant(args, case), variant(args, compared(case))
    for finding in (found, without):
        number = f"{finding.coefficient} = {page.interval(finding.number)}"
        print(f"{'with' if finding is found else 'without'} {case.kind}: {page.said(finding)}")
        print(f"  error {page.percent(finding.before)} to {page.percent(finding.after)}; {number}")
    if case.kind in injections.KINDS:
        print(injections.outcome(case, found, without))


def compared(case: Case) -> Case:
    """Variant that a case is compared with."""
    kind = "none" if case.kind in injections.KINDS else "published"
    return Case(case.campaign, kind)


def everything(args: argparse.Namespace) -> None:
    """Diagnose all campaigns and their variants, then write page and figures."""
    chosen = [c for c in CAMPAIGNS if not args.names or c.name in args.names]
    rows, remarks, places = [], [], {}
    for item in chosen:
        places[item.name] = place = finished(args, item.name)
        kept = args.out / f"{item.name}.stability.json"
        if not kept.is_file():
            _, found, quoted = page.products(place)
            trial = next(iter(quoted["coefficients"].values()))["influence"]["trial"]
            held = loop.stability(
                made(args, item.name), args.out, found, (trial or {}).get("id", "")
            )
            kept.write_text(json.dumps(held))
        line, remark = page.row(item, place, json.loads(kept.read_text()))
        say(line)
        rows.append(line)
        remarks.append(remark)
    injected, withheld = [], []
    for name in [c.name for c in chosen if c.name in injections.WITHHELD]:
        for case in (*injections.cases(name), Case(name, "withheld")):
            try:
                found = variant(args, case)
            except NotConverged as fault:
                say(f"{case.name}: {fault}")
                continue
            say(f"{case.name}: {page.said(found)}")
            group = withheld if case.kind == "withheld" else injected
            group.append((case, found, variant(args, compared(case))))
    if args.names:
        return
    text = page.HEAD + "\n".join(rows) + "\n" + page.TAIL + "\n".join(remarks) + "\n\n"
    text += page.withheld(withheld) + "\n" + page.injections(injected)
    (args.page / "figures").mkdir(parents=True, exist_ok=True)
    (args.page / "measured.md").write_text(text, encoding="utf-8")
    page.write_rows(args.page / "measured-injections.csv", injected)
    page.save(page.draw_errors, places, args.page / "figures" / "measured-errors.png")
    page.save(page.draw_injections, injected, args.page / "figures" / "measured-injections.png")


if __name__ == "__main__":
    sys.exit(main())
