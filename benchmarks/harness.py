"""Tools of all benchmarks: contestants in processes of their own, in turn; paired ratios; tables.

A benchmark is a `BENCH` in a file of its own: how its data are made, who runs over them, and which
ratios are promised. Contestants take turns, so that whatever else the machine does hits all alike,
and every ratio is of two runs of one round. Only the standard library is imported here: a
contestant's process starts with this module, and its time counts.
"""

from __future__ import annotations

import json
import math
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
#: One thread for linear algebra, as for all small fits; two for polars.
ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "POLARS_MAX_THREADS": "2"}
QUANTITIES = {"wall_s": "wall", "cpu_s": "processor", "peak_MiB": "peak memory"}
#: A ratio is another than before if it moved by more than this, and by more than `SIGMAS` of both
#: spreads.
LEAST_CHANGE, SIGMAS = 0.10, 3.0
#: What makes a median's deviation a normal's standard deviation.
NORMAL = 1.4826


@dataclass(frozen=True, slots=True, kw_only=True)
class Contestant:
    """Somebody who does the work: `run(folder)` in a fresh Python, or the program
    `command(folder)`.

    `run` may return what it has to say (a mapping; `wall_s` and `cpu_s` in it replace the whole
    process's), or a function that finds that out once the clock has stopped. `rounds` limits the
    turns of one that takes long, `full` keeps it for `--full`.
    """

    name: str
    title: str
    run: Callable[[Path], Any] | None = None
    command: Callable[[Path], list[str]] | None = None
    rounds: int | None = None
    full: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A promise: `ours` over `peer` in `quantity` is at most `must`, better `aim`; without a peer
    the quantity itself.
    """

    work: str
    ours: str
    peer: str = ""
    quantity: str = "wall_s"
    must: float
    aim: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """One benchmark. `prepare(folder, quick)` makes the data and says in a line what they are;
    `one` is the contestant that counts as 1.
    """

    title: str
    prepare: Callable[[Path, bool], str]
    contestants: tuple[Contestant, ...]
    one: str
    targets: tuple[Target, ...] = ()
    rounds: int = 5
    note: str = ""

    def contestant(self, name: str) -> Contestant:
        return next(c for c in self.contestants if c.name == name)


# --- running


def act(bench: Bench, name: str, folder: Path) -> None:
    """A contestant's own process: work, stop the clock, tell."""
    import resource

    run = bench.contestant(name).run
    assert run is not None
    found = run(folder)
    done = time.clock_gettime(time.CLOCK_MONOTONIC)
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    told: dict[str, Any] = {
        "done": done,
        "cpu_s": sum(u.ru_utime + u.ru_stime for u in used),
        "peak_MiB": max(u.ru_maxrss for u in used) / 1024,
    }
    print(json.dumps({**told, **((found() if callable(found) else found) or {})}))


def measure(command: Sequence[str]) -> dict[str, Any]:
    """Run a program and measure it: wall and processor time in s, peak resident memory in MiB, and
    what its last line tells as JSON.
    """
    environment = {**os.environ, **ENVIRONMENT}
    # a source without its compiled form would be compiled in every turn, and not in the first alone
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    begin = time.clock_gettime(time.CLOCK_MONOTONIC)
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=environment, cwd=ROOT
    ) as process:
        assert process.stdout is not None
        said = process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    end = time.clock_gettime(time.CLOCK_MONOTONIC)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} failed with {process.returncode}")
    lines = said.splitlines()
    told = json.loads(lines[-1]) if lines and lines[-1].startswith("{") else {}
    found = {
        "wall_s": told.pop("done", end) - begin,
        "cpu_s": used.ru_utime + used.ru_stime,
        "peak_MiB": used.ru_maxrss / 1024,
    }
    return {**found, **told}


def command_line(*words: str) -> list[str]:
    """A command of nearlift, started as the installed script starts it."""
    return [sys.executable, "-c", "from nearlift.__main__ import main; main()", *words]


def here(*arguments: str) -> list[str]:
    """The command of this very module tree with these arguments."""
    return [sys.executable, "-m", "benchmarks", *arguments]


def contest(
    key: str, bench: Bench, folder: Path, rounds: int, say: Callable[[str], None]
) -> dict[str, list[dict[str, Any]]]:
    """Runs of each contestant, in the order of rounds. The first turn of all, which compiles and
    warms caches, does not count.
    """
    runs: dict[str, list[dict[str, Any]]] = {c.name: [] for c in bench.contestants}
    for turn in range(-1, rounds):
        for c in bench.contestants:
            most = rounds if c.rounds is None else c.rounds
            if turn >= most or (turn < 0 and c.rounds is not None):
                continue
            found = measure(
                c.command(folder) if c.command else here("--contestant", key, c.name, str(folder))
            )
            if turn >= 0:
                runs[c.name].append(found)
            say(f"{key}: {c.name}, turn {turn + 1} of {rounds}: {found['wall_s']:.2f} s")
    return runs


# --- arithmetic


def median(values: Sequence[float]) -> float:
    """The middle value, or the mean of the two middle ones."""
    ranked = sorted(values)
    half = len(ranked) // 2
    return ranked[half] if len(ranked) % 2 else (ranked[half - 1] + ranked[half]) / 2


def summary(values: Sequence[float]) -> dict[str, float]:
    """Median, lowest, highest, and the spread of single values about the median (1.4826 times the
    median deviation).
    """
    middle = median(values)
    return {
        "median": middle,
        "low": min(values),
        "high": max(values),
        "spread": NORMAL * median([abs(v - middle) for v in values]),
        "n": len(values),
    }


def ratios(
    ours: Sequence[Mapping[str, float]], peer: Sequence[Mapping[str, float]], quantity: str
) -> list[float]:
    """The ratio of each round in which both ran."""
    return [a[quantity] / b[quantity] for a, b in zip(ours, peer, strict=False)]


def verdict(value: float, must: float, aim: float | None) -> str:
    """What a ratio is worth."""
    if value > must:
        return "missed"
    return "aim met" if aim is not None and value <= aim else "met"


def judged(bench: Bench, runs: Mapping[str, Sequence[Mapping[str, float]]]) -> list[dict[str, Any]]:
    """Each target with what was found."""
    rows = []
    for t in bench.targets:
        if not runs.get(t.ours) or (t.peer and not runs.get(t.peer)):
            continue
        found = summary(
            ratios(runs[t.ours], runs[t.peer], t.quantity)
            if t.peer
            else [r[t.quantity] for r in runs[t.ours]]
        )
        row = {
            "work": t.work,
            "ours": t.ours,
            "peer": t.peer,
            "quantity": t.quantity,
            "must": t.must,
            "aim": t.aim,
            **found,
        }
        rows.append({**row, "verdict": verdict(found["median"], t.must, t.aim)})
    return rows


def change(now: Mapping[str, float], before: Mapping[str, float]) -> float | None:
    """Logarithm of what a median has grown by, None where that is within noise."""
    moved = math.log(now["median"] / before["median"])
    noise = math.hypot(*(s["spread"] / s["median"] for s in (now, before)))
    return moved if abs(moved) > max(math.log1p(LEAST_CHANGE), SIGMAS * noise) else None


def regressions(now: Mapping[str, Any], before: Mapping[str, Any]) -> list[str]:
    """Ratios that are worse than in the result before, beyond noise; only where the same work was
    measured.
    """
    found = []
    for key, bench in now["benches"].items():
        old = before.get("benches", {}).get(key)
        if old is None or old["setting"] != bench["setting"]:
            continue
        were = {
            (c["name"], q): c["ratio"][q] for c in old["contestants"] for q in c.get("ratio", {})
        }
        for c in bench["contestants"]:
            if not c["name"].startswith("nearlift"):
                continue
            for quantity, ratio in c["ratio"].items():
                then = were.get((c["name"], quantity))
                grown = change(ratio, then) if then else None
                if then and grown is not None and grown > 0:
                    found.append(
                        f"{key}: {c['title']}: {QUANTITIES[quantity]} {ratio['median']:.3g} x"
                        f" {bench['one']}, was {then['median']:.3g}: {100 * math.expm1(grown):.0f}"
                        " % worse"
                    )
    return found


# --- telling


def told(bench: Bench, setting: str, runs: Mapping[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """One benchmark's result as JSON."""
    contestants = []
    for c in bench.contestants:
        own = runs[c.name]
        if own:
            contestants.append(
                {
                    "name": c.name,
                    "title": c.title,
                    **{q: summary([r[q] for r in own]) for q in QUANTITIES},
                    "ratio": (
                        {q: summary(ratios(own, runs[bench.one], q)) for q in QUANTITIES}
                        if runs[bench.one]
                        else {}
                    ),
                    "runs": own,
                }
            )
    return {
        "title": bench.title,
        "setting": setting,
        "note": bench.note,
        "one": bench.one,
        "contestants": contestants,
        "targets": judged(bench, runs),
    }


def machine() -> dict[str, Any]:
    """What the numbers were measured on."""
    from importlib import metadata

    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        cpu = next(
            (
                line.split(":", 1)[1].strip()
                for line in info.read_text().splitlines()
                if line.startswith("model name")
            ),
            cpu,
        )
    packages = (
        "numpy",
        "scipy",
        "numba",
        "pyarrow",
        "pandas",
        "polars",
        "duckdb",
        "lmfit",
        "emcee",
    )
    installed = {d.metadata["Name"].lower() for d in metadata.distributions() if d.metadata["Name"]}
    return {
        "processor": cpu,
        "cores": os.cpu_count(),
        "memory_GiB": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30),
        "system": platform.system(),
        "python": platform.python_version(),
        "packages": {name: metadata.version(name) for name in packages if name in installed},
    }


def number(value: float) -> str:
    """Three digits, plainly written."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _range(s: Mapping[str, float]) -> str:
    return (
        number(s["median"])
        if s["n"] < 2
        else f"{number(s['median'])} ({number(s['low'])} to {number(s['high'])})"
    )


def markdown(result: Mapping[str, Any]) -> str:
    """The whole result as Markdown: targets first, then a table for each benchmark."""
    m = result["machine"]
    lines = [
        f"{m['processor']}, {m['cores']} cores, {m['memory_GiB']} GiB, {m['system']}, Python"
        f" {m['python']}, "
        + ", ".join(f"{k} {v}" for k, v in m["packages"].items())
        + ". Medians of paired runs, lowest to highest in brackets.",
        "",
        "| Work | must | aim | found | |",
        "|---|---|---|---|---|",
    ]
    for bench in result["benches"].values():
        for t in bench["targets"]:
            unit = "" if t["peer"] else (" MiB" if t["quantity"] == "peak_MiB" else " s")
            against = f", {QUANTITIES[t['quantity']]}" if t["quantity"] != "wall_s" else ""
            aim = "" if t["aim"] is None else f"{number(t['aim'])}{unit}"
            lines.append(
                f"| {t['work']}{against} | {number(t['must'])}{unit} | {aim} | {_range(t)}{unit} |"
                f" {t['verdict']} |"
            )
    for bench in result["benches"].values():
        low, high = bench["load"]
        said = " ".join(
            filter(
                None,
                [
                    bench["setting"],
                    bench["note"],
                    f"Load {low:.1f} at the start, {high:.1f} at the end.",
                ],
            )
        )
        lines += ["", f"### {bench['title']}", "", said, ""]
        extras = list(
            dict.fromkeys(
                k for c in bench["contestants"] for r in c["runs"] for k in r if k not in QUANTITIES
            )
        )
        lines.append(
            "| | wall over 1 | processor over 1 | wall, s | processor, s | peak, MiB |"
            + "".join(f" {e} |" for e in extras)
        )
        lines.append("|---|---|---|---|---|---|" + "---|" * len(extras))
        for c in bench["contestants"]:
            both = [_range(c["ratio"][q]) if c["ratio"] else "" for q in ("wall_s", "cpu_s")]
            own = [number(c[q]["median"]) for q in QUANTITIES]
            further = [
                r[e] if isinstance(r := c["runs"][-1], dict) and e in r else "" for e in extras
            ]
            cells = [
                c["title"],
                *both,
                *own,
                *(number(s) if isinstance(s, float) else str(s) for s in further),
            ]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
