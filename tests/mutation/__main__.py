"""Draw mutants, run the tests that reach each of them in a copy of the tree, print what survived.

    python -m tests.mutation [--count 60] [--seed 1] [--jobs 2] [--limit 300] [--again] [--save]

First all tests of `make check`, and of the packages in `BEYOND`, run once, and what they reach is
recorded. A mutant's tests are those that run its line, module by module and the
quick ones first, then the rest of these modules. A constant, or a line that is compiled, counts as
run by the tests that call a function of its module or of one that imports it. `--again` takes over what an
earlier run recorded and killed: modules of tests that are new since then are not run.
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
from collections import defaultdict
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue

import pytest
from tests.imports import ROOT, imported, module_name, modules
from tests.mutation.mutants import Mutant, drawn
from tests.mutation.process import Order, Recorder, run_tests

CORE = ("likelihood", "fit", "loop", "reduction", "models", "effects")
#: Packages whose tests run stages, and these tests.
BEYOND = {
    "flight": "flight",
    "flow": "flow",
    "readers": "readers",
    "run": "run",
    "report/number.py": "report/test_number.py",
}
ROOMS = [Path("pipeline/nearlift") / room for room in (*CORE, *BEYOND)]
ALL = [f"--beyond={tests}" for tests in BEYOND.values()]
PAGE = ROOT / "docs" / "mutation.md"
#: Of the last run, which --again goes on from: by mutant, the tests that reach it; and what came out.
REACHED, KEPT = (ROOT / ".pytest_cache" / f"mutation-{n}.json" for n in ("reached", "kept"))
EQUIVALENT: Mapping[str, str] = tomllib.loads(
    (ROOT / "tests" / "mutation" / "equivalent.toml").read_text(encoding="utf-8")
)
COPIED = ("pipeline", "tests", "docs", "examples", "benchmarks", "pyproject.toml", "README.md")
#: Its processes have imported what takes long, and nothing of the package.
FORKED = multiprocessing.get_context("forkserver")
PRELOADED = ("scipy.optimize", "scipy.stats", "tests.mutation.process")
#: By test, its seconds of processor, and what it runs: files, and lines as `file:line`.
Record = Mapping[str, tuple[float, list[str]]]


@contextmanager
def copies(count: int) -> Iterator[list[Path]]:
    """Copies of the tree, to be changed."""
    with tempfile.TemporaryDirectory(prefix="mutation-") as scratch:
        trees = [Path(scratch) / str(i) for i in range(count)]
        for tree in trees:
            tree.mkdir()
            for name in COPIED:
                source = ROOT / name
                (shutil.copytree if source.is_dir() else shutil.copy2)(source, tree / name)
        yield trees


def recorded(tree: Path, mutants: list[Mutant], limit_s: int) -> Record:
    """What the tests of an unchanged tree reach."""
    lines: dict[str, set[int]] = defaultdict(set)
    for mutant in mutants:
        lines[mutant.path.as_posix()] |= {*mutant.lines(ROOT)}
    recorder = Recorder({file: frozenset(there) for file, there in lines.items()})
    process = FORKED.Process(target=run_tests, args=(tree, ALL, recorder, limit_s))
    process.start()
    process.join()
    if process.exitcode != pytest.ExitCode.OK:
        raise RuntimeError((tree / "out").read_text(encoding="utf-8", errors="replace"))
    record: Record = json.loads((tree / "record").read_text(encoding="utf-8"))
    return record


def reaching(mutant: Mutant, record: Record) -> list[str]:
    """The tests that run a mutant's line, modules of few seconds first.

    Where none does, those of its module: a process that a test starts is not traced.
    """
    name = module_name(ROOT / mutant.path)
    if mutant.is_constant or "nearlift.compiler" in imported(name):
        users = [path for user, path in modules().items() if user == name or name in imported(user)]
        reached = {path.relative_to(ROOT).as_posix() for path in users}
    else:
        reached = {f"{mutant.path.as_posix()}:{line}" for line in mutant.lines(ROOT)}
    own = f"tests/{mutant.path.parent.name}/test_{mutant.path.name}::"
    tests = [t for t, (_, ran) in record.items() if reached & {*ran}]
    tests = tests or [t for t in record if t.startswith(own)]
    total_s: dict[str, float] = defaultdict(float)
    for test in tests:
        total_s[test.split("::")[0]] += record[test][0]
    return sorted(tests, key=lambda t: (total_s[t.split("::")[0]], t.split("::")[0], record[t][0]))


def first_failure(tree: Path, tests: list[str], limit_s: int) -> str | None:
    """The first test that fails in a tree; empty if all pass, None if they do not end."""
    if not tests:
        return ""
    options = ["-x", *ALL, *dict.fromkeys(test.split("::")[0] for test in tests)]
    process = FORKED.Process(target=run_tests, args=(tree, options, Order(tests), limit_s))
    process.start()
    process.join()
    text = (tree / "out").read_text(encoding="utf-8", errors="replace")
    failed = [line for line in text.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if failed:
        return failed[0].split(" - ")[0].split(maxsplit=1)[1]
    if process.exitcode in (-signal.SIGXCPU, -signal.SIGKILL):
        return None
    if "while loading conftest" in text:
        return "import of the package"
    if process.exitcode != pytest.ExitCode.OK:
        raise RuntimeError(text)
    return ""


def run(
    mutants: list[Mutant],
    reached: dict[str, list[str]],
    results: dict[str, str | None],
    *,
    jobs: int,
    limit_s: int,
) -> None:
    """Add to `results`, by mutant, the first test that failed; empty if all passed, None if they
    did not end. And to `reached` the tests that reach it, where it says none.
    """
    began = time.monotonic()
    with copies(jobs) as copied:
        if new := [m for m in mutants if m.key not in reached]:
            record = recorded(copied[0], new, 10 * limit_s)
            reached |= {m.key: reaching(m, record) for m in new}
            save(REACHED, reached)
            print(f"what {len(record)} tests reach: {time.monotonic() - began:.0f} s", flush=True)
        trees: SimpleQueue[Path] = SimpleQueue()
        for tree in copied:
            trees.put(tree)

        def one(numbered: tuple[int, Mutant]) -> None:
            number, mutant = numbered
            tests, tree = reached[mutant.key], trees.get()
            file, started = tree / mutant.path, time.monotonic()
            original = file.read_bytes()
            try:
                file.write_text(mutant.source(tree), encoding="utf-8")
                # Python compiles a file again when its time, in whole seconds, is another
                os.utime(file, (number, number))
                failed = first_failure(tree, tests, limit_s)
            finally:
                file.write_bytes(original)
                trees.put(tree)
            results[mutant.key] = failed
            save(KEPT, results)
            fate = {"": "SURVIVED", None: "no end"}.get(failed, "killed")
            took = f"{number}/{len(mutants)} {time.monotonic() - started:.0f} s, {len(tests)} tests"
            print(took, fate, mutant.key, mutant.line, failed or "", flush=True)

        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(one, enumerate(mutants, 1)))
    print(f"{(time.monotonic() - began) / 60:.0f} min")


def save(file: Path, kept: Mapping[str, object]) -> None:
    """Keep what came out, also of a run that does not get to its end."""
    file.parent.mkdir(exist_ok=True)
    file.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def page(mutants: list[Mutant], results: Mapping[str, str | None], seed: int) -> str:
    """Text of docs/mutation.md: mutants killed per package, and those that survive."""
    killed = sum(bool(results[m.key]) for m in mutants)
    alike = sum(m.key in EQUIVALENT for m in mutants)
    lines = [
        "# Seeded mutants",
        "",
        "`make mutate` changes one place of the core at a time, in a copy: a comparison, an operator, a sign, a constant, a dropped term,",
        "a number off by one. It runs the tests of `make check` that reach the changed line; for packages whose tests run stages, those of that package.",
        "",
        f"**{killed} of {len(mutants)} killed** (seed {seed}); {alike} more change nothing.",
        "",
        "| package | mutants | killed |",
        "| --- | --: | --: |",
    ]
    packages = {m.key: m.path.relative_to("pipeline/nearlift").parts[0] for m in mutants}
    for package in sorted(set(packages.values())):
        fates = [bool(results[key]) for key, where in packages.items() if where == package]
        lines.append(f"| {package} | {len(fates)} | {sum(fates)} |")
    lines += ["", "| place | change | why it survives |", "| --- | --- | --- |"]
    for m in mutants:
        if not results[m.key]:
            survives = (
                "does not end" if results[m.key] is None else EQUIVALENT.get(m.key, "no test")
            )
            change = f"`{m.before}` to `{m.after}`".replace("|", "\\|")
            place = m.path.relative_to("pipeline/nearlift").as_posix()
            lines.append(f"| {place} `{m.within}` | {change} | {survives} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutation")
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--limit", type=int, default=300, help="seconds of processor for each")
    parser.add_argument("--again", action="store_true", help="run only what was not killed before")
    parser.add_argument("--save", action="store_true", help=f"write {PAGE.relative_to(ROOT)}")
    given = parser.parse_args()
    FORKED.set_forkserver_preload(list(PRELOADED))
    mutants = drawn(ROOT, ROOMS, given.count, given.seed)
    reached, before = (
        json.loads(f.read_text(encoding="utf-8")) if given.again and f.exists() else {}
        for f in (REACHED, KEPT)
    )
    results: dict[str, str | None] = {m.key: before[m.key] for m in mutants if before.get(m.key)}
    # what changes nothing would run all its tests
    results |= {m.key: "" for m in mutants if m.key in EQUIVALENT}
    todo = [m for m in mutants if m.key not in results]
    run(todo, reached, results, jobs=given.jobs, limit_s=given.limit)
    print(f"{sum(map(bool, results.values()))} of {len(mutants)} killed")
    if given.save:
        PAGE.write_text(page(mutants, results, given.seed), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
