"""Draw mutants, run the nearest tests on each in a copy of the tree, print what survived.

    python -m tests.mutation [--count 60] [--seed 1] [--jobs 2] [--limit 120] [--again] [--save]

`--again` takes over what an earlier run killed. A mutant's tests are those
modules of `make check` that import the changed one.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import time
import tomllib
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

import pytest
from tests.imports import ROOT, imported, is_core, module_name, modules, test_modules, used
from tests.mutation.mutants import Mutant, drawn
from tests.mutation.process import run_tests

ROOMS = [
    Path("pipeline/nearlift") / r for r in ("likelihood", "fit", "loop", "reduction", "models")
]
PAGE = ROOT / "docs" / "mutation.md"
#: Of the last run, which --again goes on from.
KEPT = ROOT / ".pytest_cache" / "mutation.json"
EQUIVALENT: Mapping[str, str] = tomllib.loads(
    (ROOT / "tests" / "mutation" / "equivalent.toml").read_text(encoding="utf-8")
)
COPIED = ("pipeline", "tests", "docs", "examples", "benchmarks", "pyproject.toml", "README.md")
#: Its processes have imported what takes long, and nothing of the package.
FORKED = multiprocessing.get_context("forkserver")
PRELOADED = ("scipy.optimize", "scipy.stats", "tests.mutation.process")


def nearest_tests(path: Path) -> list[str]:
    """Files of the tests that import a module, small ones first: the core's if there are any. If no
    core test imports it, those of what imports it, its own before them.
    """
    near = {module_name(ROOT / path)}
    steps: dict[str, int] = {}
    while True:
        direct = [t for t in test_modules() if near & used(t)]
        for test in direct:
            steps.setdefault(test, len(near))
        users = {n for n in modules() if n.startswith("nearlift.") and near & imported(n)}
        if any(map(is_core, direct)) or users <= near:
            break
        near |= users
    direct = [t for t in direct if is_core(t)] or direct
    direct.sort(key=lambda t: (steps[t], modules()[t].stat().st_size))
    return [modules()[t].relative_to(ROOT).as_posix() for t in direct]


def first_failure(tree: Path, tests: list[str], limit_s: int) -> str | None:
    """The first test that fails in a tree; empty if all pass, None if not all ran in time."""
    process = FORKED.Process(
        target=run_tests, args=(tree, tests, is_core(module_name(ROOT / tests[0])), limit_s)
    )
    process.start()
    process.join()
    text = (tree / "out").read_text(encoding="utf-8", errors="replace")
    failed = [line for line in text.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if failed:
        return failed[0].split(" - ")[0].split()[1]
    if process.exitcode == -signal.SIGXCPU or process.exitcode == -signal.SIGKILL:
        return None
    if process.exitcode != pytest.ExitCode.OK:
        raise RuntimeError(text)
    return ""


def run(mutants: list[Mutant], jobs: int, limit_s: int, results: dict[str, str | None]) -> None:
    """Add to `results`, by mutant, the first test that failed; empty if all passed, None if not all
    ran in time.
    """
    trees: SimpleQueue[Path] = SimpleQueue()
    with tempfile.TemporaryDirectory(prefix="mutation-") as scratch:
        for i in range(jobs):
            tree = Path(scratch) / str(i)
            tree.mkdir()
            for name in COPIED:
                source = ROOT / name
                if source.is_dir():
                    shutil.copytree(source, tree / name)
                else:
                    shutil.copy2(source, tree / name)
            trees.put(tree)

        def one(numbered: tuple[int, Mutant]) -> None:
            number, mutant = numbered
            tree = trees.get()
            file, began = tree / mutant.path, time.monotonic()
            original = file.read_bytes()
            try:
                file.write_text(mutant.source(ROOT), encoding="utf-8")
                # Python compiles a file again when its time, in whole seconds, is another
                os.utime(file, (began + number, began + number))
                failed = first_failure(tree, nearest_tests(mutant.path), limit_s)
            finally:
                file.write_bytes(original)
                trees.put(tree)
            results[mutant.key] = failed
            save(results)
            fate = {"": "SURVIVED", None: "out of time"}.get(failed, "killed")
            took = f"{time.monotonic() - began:.0f} s"
            print(fate, took, mutant.key, mutant.line, mutant.kind, failed or "", flush=True)

        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(one, enumerate(mutants, 1)))


def save(results: Mapping[str, str | None]) -> None:
    """Keep what came out, also of a run that does not get to its end."""
    KEPT.parent.mkdir(exist_ok=True)
    KEPT.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def page(mutants: list[Mutant], results: Mapping[str, str | None], seed: int) -> str:
    """docs/mutation.md."""
    ran = [m for m in mutants if m.key in results]
    killed = sum(bool(results[m.key]) for m in ran)
    late = sum(results[m.key] is None for m in ran)
    alike = sum(m.key in EQUIVALENT for m in ran)
    lines = [
        "# Seeded mutants",
        "",
        (
            "`make mutate` changes one place of the core at a time, in a copy: a comparison, an operator,"
            " a sign, a constant, a term dropped, a number off by one."
        ),
        "It runs the tests of `make check` that import the changed module. Written by it.",
        "",
        (
            f"**{killed} of {len(ran)} killed**, {alike} change nothing, {late} not settled in their"
            f" processor time; {len(mutants) - len(ran)} of the {len(mutants)} drawn (seed {seed}) were"
            " not run."
        ),
        "",
        "| place | change | first test that fails |",
        "| --- | --- | --- |",
    ]
    for m in ran:
        failed = results[m.key]
        survives = EQUIVALENT.get(m.key, "none")
        fate = f"`{failed}`" if failed else "not settled" if failed is None else survives
        change = f"`{m.before}` to `{m.after}`".replace("|", "\\|")
        place = m.path.relative_to("pipeline/nearlift").as_posix()
        lines.append(f"| {place} | {change} | {fate} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutation")
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--limit", type=int, default=120, help="seconds of processor for each")
    parser.add_argument("--again", action="store_true", help="run only what was not killed before")
    parser.add_argument("--save", action="store_true", help=f"write {PAGE.relative_to(ROOT)}")
    given = parser.parse_args()
    FORKED.set_forkserver_preload(list(PRELOADED))
    mutants = drawn(ROOT, ROOMS, given.count, given.seed)
    before = json.loads(KEPT.read_text()) if given.again and KEPT.exists() else {}
    results: dict[str, str | None] = {m.key: before[m.key] for m in mutants if before.get(m.key)}
    run([m for m in mutants if m.key not in results], given.jobs, given.limit, results)
    print(f"{sum(map(bool, results.values()))} of {len(mutants)} killed")
    if given.save:
        PAGE.write_text(page(mutants, results, given.seed), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
