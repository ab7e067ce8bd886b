"""Draw mutants, run the test modules that reach each in a copy of the tree, print what survived.

    python -m tests.mutation [--count 60] [--seed 1] [--jobs 2] [--only ROOM] [--save]

First the tests of `FOLDERS` run once, and coverage.py records which lines each test module runs.
A mutant's tests are the modules that run its line, those of its own package first. A constant, or a
line that numba compiles, counts as run by the modules that run any line of its file.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

import coverage
from tests.mutation.mutants import Mutant, drawn

ROOT = Path(__file__).resolve().parents[2]
ROOMS = [
    "likelihood",
    "fit",
    "loop",
    "reduction",
    "models",
    "effects",
    "flight",
    "flow",
    "readers",
    "run",
]
FOLDERS = [*(f"tests/{room}" for room in ROOMS), "tests/report/test_number.py"]
PAGE = ROOT / "docs" / "mutation.md"
EQUIVALENT: Mapping[str, str] = tomllib.loads(
    (ROOT / "tests" / "mutation" / "equivalent.toml").read_text(encoding="utf-8")
)
COPIED = ("pipeline", "tests", "docs", "examples", "benchmarks", "pyproject.toml", "README.md")
PYTEST = ["pytest", "-q", "-n0", "-p", "no:randomly", "-p", "no:cacheprovider"]
#: Seconds for the tests of one mutant; an endless loop is one that no test kills.
LIMIT_S = 900


def copy(scratch: str, name: str) -> Path:
    """A copy of the tree, to be changed."""
    tree = Path(scratch) / name
    tree.mkdir()
    for part in COPIED:
        source = ROOT / part
        if source.is_dir():
            shutil.copytree(source, tree / part, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(source, tree / part)
    return tree


def python(tree: Path, *words: str, limit_s: float | None = None) -> subprocess.CompletedProcess:
    """Run a module of Python in a tree, on the package of that tree."""
    paths = os.pathsep.join([str(tree / "pipeline"), str(tree)])
    return subprocess.run(
        [sys.executable, "-m", *words],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=limit_s,
    )


def recorded(tree: Path) -> coverage.CoverageData:
    """Lines that each test module runs in an unchanged tree."""
    plugin = ["-p", "tests.mutation.contexts"]
    done = python(tree, "coverage", "run", "--data-file=reached", "-m", *PYTEST, *plugin, *FOLDERS)
    if done.returncode:
        raise RuntimeError(done.stdout + done.stderr)
    data = coverage.CoverageData(str(tree / "reached"))
    data.read()
    return data


def reaching(mutant: Mutant, tree: Path, data: coverage.CoverageData) -> list[str]:
    """Test modules that run a mutant's line, those of its own package first."""
    by_line = data.contexts_by_lineno(str(tree / mutant.path))
    compiled = "nearlift.compiler" in (ROOT / mutant.path).read_text(encoding="utf-8")
    lines = by_line if mutant.is_constant or compiled else mutant.lines(ROOT)
    modules = {context for line in lines for context in by_line.get(line, ()) if context}
    room = f"tests/{mutant.path.relative_to('pipeline/nearlift').parts[0]}"
    return sorted(modules, key=lambda m: (not m.startswith(f"{room}/"), m)) or [room]


def first_failure(mutant: Mutant, tree: Path, modules: list[str]) -> str | None:
    """The first test that fails with a mutant; empty if all pass, None if they do not end."""
    file = tree / mutant.path
    original = file.read_text(encoding="utf-8")
    file.write_text(mutant.source(tree), encoding="utf-8")
    try:
        done = python(tree, *PYTEST, "-x", *modules, limit_s=LIMIT_S)
    except subprocess.TimeoutExpired:
        return None
    finally:
        file.write_text(original, encoding="utf-8")
    if not done.returncode:
        return ""
    failed = [x for x in done.stdout.splitlines() if x.startswith(("FAILED", "ERROR"))]
    return failed[0].split(" - ")[0].split(maxsplit=1)[1] if failed else "import of the package"


def run(mutants: list[Mutant], jobs: int) -> dict[str, str | None]:
    """By mutant, the first test that failed; empty if all passed, None if they did not end."""
    # what changes nothing would run all its tests
    results: dict[str, str | None] = {m.key: "" for m in mutants if m.key in EQUIVALENT}
    with tempfile.TemporaryDirectory(prefix="mutation-") as scratch:
        trees: SimpleQueue[Path] = SimpleQueue()
        first = copy(scratch, "0")
        data = recorded(first)
        for tree in (first, *(copy(scratch, str(i)) for i in range(1, jobs))):
            trees.put(tree)

        def one(mutant: Mutant) -> None:
            tree, modules = trees.get(), reaching(mutant, first, data)
            results[mutant.key] = failed = first_failure(mutant, tree, modules)
            trees.put(tree)
            fate = {"": "SURVIVED", None: "no end"}.get(failed, "killed")
            print(fate, mutant.key, mutant.line, len(modules), failed or "", flush=True)

        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(one, [m for m in mutants if m.key not in results]))
    return results


def page(mutants: list[Mutant], results: Mapping[str, str | None], seed: int) -> str:
    """Text of docs/mutation.md: mutants killed per package, and those that survive."""
    killed = sum(bool(results[m.key]) for m in mutants)
    alike = sum(m.key in EQUIVALENT for m in mutants)
    lines = [
        "# Seeded mutants",
        "",
        "`make mutate` changes one place of the core at a time, in a copy: a comparison, an operator, a sign, a constant, a dropped term,",
        "a number off by one. It runs the test modules that reach the changed line.",
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
        if not (fate := results[m.key]):
            why = "does not end" if fate is None else EQUIVALENT.get(m.key, "no test")
            change = f"`{m.before}` to `{m.after}`".replace("|", "\\|")
            place = m.path.relative_to("pipeline/nearlift").as_posix()
            lines.append(f"| {place} `{m.within}` | {change} | {why} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run them, print how many were killed, and with --save write the page."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation")
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", help="mutants of this package alone")
    parser.add_argument("--save", action="store_true", help=f"write {PAGE.relative_to(ROOT)}")
    given = parser.parse_args()
    places = [Path("pipeline/nearlift") / room for room in (*ROOMS, "report/number.py")]
    mutants = drawn(ROOT, places, given.count, given.seed)
    mutants = [m for m in mutants if not given.only or given.only in m.path.parts]
    results = run(mutants, given.jobs)
    print(f"{sum(map(bool, results.values()))} of {len(mutants)} killed")
    if given.save:
        PAGE.write_text(page(mutants, results, given.seed), encoding="utf-8")


if __name__ == "__main__":
    main()
