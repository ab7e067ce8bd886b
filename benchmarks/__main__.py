"""Every benchmark with its peers: ``make bench``.

    python -m benchmarks [NAME ...] [--quick | --full] [--rounds N] [--data DIR] [--without WHO ...]
    [--save] [--fail] [--json FILE]

Prints Markdown; `--save` keeps it in docs/benchmarks.md and benchmarks/last.json, against which
later results are compared. A regression beyond noise is printed on stderr; with `--fail` it also
sets the exit code.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.harness import ROOT, Bench, act, contest, here, machine, markdown, regressions, told

HERE = Path(__file__).parent
LAST = HERE / "last.json"
PAGE = ROOT / "docs" / "benchmarks.md"
BEGIN, END = "<!-- measured -->\n", "<!-- end of measured -->\n"
NAMES = sorted(
    p.stem for p in HERE.glob("*.py") if p.stem != "harness" and not p.stem.startswith("_")
)


def bench_of(name: str) -> Bench:
    found: Bench = importlib.import_module(f"benchmarks.{name}").BENCH
    return found


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def prepared(name: str, folder: Path, quick: bool) -> str:
    """Make the data in another process, so that this one stays small: a child's peak memory begins
    with its parent's.
    """
    done = subprocess.run(
        [*here("--prepare", name, str(folder)), *(["--quick"] if quick else [])],
        check=True,
        stdout=subprocess.PIPE,
        cwd=ROOT,
    )
    return done.stdout.decode().strip().splitlines()[-1]


def run(
    names: list[str], quick: bool, full: bool, rounds: int | None, data: Path | None, out: set[str]
) -> dict[str, Any]:
    benches = {}
    with tempfile.TemporaryDirectory() as temporary:
        for name in names:
            bench = bench_of(name)
            inside = (
                c
                for c in bench.contestants
                if (full or not c.full) and (c.name not in out or c.name == bench.one)
            )
            bench = replace(bench, contestants=tuple(inside))
            folder = data or Path(temporary) / name
            folder.mkdir(parents=True, exist_ok=True)
            setting = prepared(name, folder, quick)
            say(f"== {bench.title}: {setting}")
            turns = rounds or (2 if quick else bench.rounds)
            begun = os.getloadavg()[0]
            benches[name] = {
                **told(bench, setting, contest(name, bench, folder, turns, say)),
                "load": [begun, os.getloadavg()[0]],
            }
    return {"schema": "nearlift.benchmarks/1", "machine": machine(), "benches": benches}


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(NAMES))
    parser.add_argument(
        "--quick", action="store_true", help="small data, two rounds: a look, no result"
    )
    parser.add_argument(
        "--full",
        action="store_true",
        help="those too that take very long, each once: see docs/benchmarks.md",
    )
    parser.add_argument("--rounds", type=int)
    parser.add_argument(
        "--data", type=Path, help="keep the data here, and use what is there already"
    )
    parser.add_argument(
        "--without", nargs="+", default=[], metavar="WHO", help="contestants that stay out"
    )
    parser.add_argument(
        "--save",
        action="store_true",
        help="keep the result in docs/benchmarks.md and benchmarks/last.json",
    )
    parser.add_argument(
        "--fail", action="store_true", help="exit with 1 after a regression or a missed target"
    )
    parser.add_argument("--json", type=Path)
    parser.add_argument(
        "--contestant", nargs=3, metavar=("NAME", "WHO", "DIR"), help=argparse.SUPPRESS
    )
    parser.add_argument("--prepare", nargs=2, metavar=("NAME", "DIR"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.contestant:
        name, who, folder = given.contestant
        act(bench_of(name), who, Path(folder))
        return 0
    if given.prepare:
        name, folder = given.prepare
        print(bench_of(name).prepare(Path(folder), given.quick))
        return 0
    if unknown := sorted(set(given.names) - set(NAMES)):
        parser.error(f"no benchmark {', '.join(unknown)}; there are {', '.join(NAMES)}")
    result = run(
        given.names or NAMES,
        given.quick,
        given.full,
        given.rounds,
        given.data.resolve() if given.data else None,
        set(given.without),
    )
    last = json.loads(LAST.read_text()) if LAST.exists() else {}
    worse = regressions(result, last)
    missed = [
        f"{t['work']}: {t['median']:.3g}, must {t['must']:g}"
        for b in result["benches"].values()
        for t in b["targets"]
        if t["verdict"] == "missed"
    ]
    print(markdown(result))
    for line in worse:
        say(f"worse than the last result: {line}")
    for line in missed:
        say(f"missed: {line}")
    if given.json:
        given.json.write_text(json.dumps(result, indent=1) + "\n")
    if given.save:
        save(result, last)
    return 1 if given.fail and (worse or missed) else 0


def save(result: dict[str, Any], last: dict[str, Any]) -> None:
    """Put the result in the place of the last one; benchmarks that did not run keep theirs."""
    whole = {
        **result,
        "benches": dict(sorted({**last.get("benches", {}), **result["benches"]}.items())),
    }
    LAST.write_text(json.dumps(whole, indent=1) + "\n")
    page = PAGE.read_text()
    head, _, rest = page.partition(BEGIN)
    _, _, tail = rest.partition(END)
    PAGE.write_text(head + BEGIN + markdown(whole) + END + tail)


if __name__ == "__main__":
    sys.exit(main())
