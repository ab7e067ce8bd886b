"""``python -m measured``: fetch the public campaigns, diagnose them, and write docs/measured.md."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from pydantic import TypeAdapter

from nearlift.datasets import registry
from nearlift.errors import NearliftError, NotConverged

from . import page, variants
from .campaigns import REMARKS, campaign
from .page import Measured, Pair
from .variants import KINDS, STORED, Case, Finding, Stability

ROOT = Path(__file__).resolve().parent.parent
STABILITY = TypeAdapter(Stability)


def say(text: str) -> None:
    """Progress, on standard error."""
    print(text, file=sys.stderr, flush=True)


def options() -> argparse.ArgumentParser:
    """Options of the command."""
    parser = argparse.ArgumentParser(prog="python -m measured", description=__doc__)
    parser.add_argument("names", nargs="*", help="campaigns; with names no page is written [all]")
    parser.add_argument("--out", type=Path, default=ROOT / "processed" / "measured")
    parser.add_argument(
        "--data", type=Path, default=ROOT.parent / "shared" / "data", help="files at hand"
    )
    parser.add_argument("--registry", type=Path, default=registry.OWN)
    parser.add_argument("--page", type=Path, default=ROOT / "docs", help="folder of the page")
    parser.add_argument(
        "--case",
        nargs="+",
        metavar="CAMPAIGN KIND SIZE",
        help=f"one variant; kinds: published, none, withheld, {', '.join(KINDS)}",
    )
    return parser


def main(words: list[str] | None = None) -> int:
    """Run the command; its exit code."""
    args = options().parse_args(words)
    try:
        if args.case:
            name, *rest = args.case
            print_case(args, Case(name, *rest[:1], *map(float, rest[1:2])))
            return 0
        names = args.names or list(REMARKS)
        rows = [measured(args, name) for name in names]
        pairs = [p for name in names for p in compared(args, name)]
        say(page.campaigns(rows))
        if not args.names:
            page.write(args.page, rows, pairs)
    except NearliftError as fault:
        say(str(fault))
        return fault.exit_code
    return 0


def fetched(args: argparse.Namespace, name: str) -> Path:
    """Folder of a campaign, fetched where it is not there."""
    return campaign(name, args.out / "raw" / name, args.data, say, args.registry)


def measured(args: argparse.Namespace, name: str) -> Measured:
    """Products of a campaign and its stability, made where they are not there."""
    place, kept = args.out / "processed" / name, args.out / f"{name}.stability.json"
    folder = fetched(args, name)
    if not (place / "diagnosis.json").is_file():
        say(f"{name}: diagnosis")
        variants.stages(folder, args.out, "ingest", "reduce", "fit", "diagnose")
    boundary, trials, diagnosis, quoted = page.products(place)
    if not kept.is_file():
        say(f"{name}: without each visit and trial")
        heaviest = next(iter(quoted.coefficients.values())).influence.trial
        held = variants.stability(
            folder,
            args.out,
            diagnosis.verdict,
            [{e.name, *e.rivals} for e in diagnosis.effects],
            heaviest.id if heaviest else "",
        )
        kept.write_bytes(STABILITY.dump_json(held))
    held = STABILITY.validate_json(kept.read_bytes())
    return Measured(name, boundary, trials, diagnosis, quoted, held)


def compared(args: argparse.Namespace, name: str) -> list[Pair]:
    """Variants of a campaign that can be diagnosed."""
    pairs = []
    for case in variants.cases(name):
        try:
            pair = Pair(case, answer(args, case), answer(args, case.reference))
        except NotConverged as fault:
            say(f"{case.name}: {fault}")
            continue
        say(f"{case.name}: {page.said(pair.answer)}")
        pairs.append(pair)
    return pairs


def answer(args: argparse.Namespace, case: Case) -> Finding:
    """Answer of the loop to one variant; computed once, then kept."""
    kept = args.out / "cases" / f"{case.name}.json"
    if not kept.is_file():
        folder, out = fetched(args, case.campaign), args.out / "variants"
        plain = case.kind in ("published", "withheld")
        floor = 0.0 if plain else answer(args, Case(case.campaign, "published")).floor
        variants.write(case, folder, out / case.name, floor)
        variants.stages(out / case.name, out, "ingest")
        kept.parent.mkdir(parents=True, exist_ok=True)
        found = variants.diagnosed(*variants.ingested(out / case.name, out))
        kept.write_bytes(STORED.dump_json(found))
    return STORED.validate_json(kept.read_bytes())


def print_case(args: argparse.Namespace, case: Case) -> None:
    """Print one variant, and the campaign that it is compared with."""
    pair = Pair(case, answer(args, case), answer(args, case.reference))
    for word, found in (("with", pair.answer), ("without", pair.without)):
        number = f"{found.coefficient} = {page.interval(found.number)}"
        print(f"{word} {case.kind}: {page.said(found)}")
        print(f"  error {page.percent(found.before)} to {page.percent(found.after)}; {number}")
    if case.kind in KINDS:
        print(variants.outcome(*pair))


if __name__ == "__main__":
    sys.exit(main())
