"""The benchmarks' arithmetic, and that contestants are measured as they are."""

from __future__ import annotations

import ast
import importlib
import math
import resource
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
if not (ROOT / "benchmarks" / "harness.py").exists():
    pytest.skip("the benchmarks are not here", allow_module_level=True)


@pytest.fixture(scope="module")
def harness():
    sys.path.insert(0, str(ROOT))
    try:
        yield importlib.import_module("benchmarks.harness")
    finally:
        sys.path.remove(str(ROOT))


@pytest.fixture
def bench(harness):
    def python(code: str):
        return lambda folder: [sys.executable, "-S", "-c", code]

    def contestant(name: str, code: str, **more):
        return harness.Contestant(name=name, title=name, command=python(code), **more)

    return harness.Bench(
        title="Waiting",
        prepare=lambda folder, quick: "nothing",
        one="peer",
        contestants=(
            contestant("peer", "import time; time.sleep(0.3)"),
            contestant("nearlift", 'print(\'{"wall_s": 0.15, "ESS": 7}\')'),
            contestant("slow", "x = b'x' * 400_000_000", rounds=1),
        ),
        targets=(harness.Target(work="waiting", ours="nearlift", peer="peer", must=0.9, aim=0.01),),
    )


def test_an_outlier_counts_for_one_however_far_it_is(harness):
    assert harness.median([4.0, 1.0, 2.0, 3.0]) == 2.5
    found = harness.summary([1.0, 2.0, 3.0, 4.0, 100.0])
    assert (found["median"], found["low"], found["high"], found["n"]) == (3.0, 1.0, 100.0, 5)
    assert found["spread"] == pytest.approx(1.4826)


def test_ratios_are_of_one_round_each(harness):
    """The machine was half as fast in the second round: the ratio does not know."""
    ours, peer = ([{"wall_s": t} for t in walls] for walls in ((1.0, 2.0), (4.0, 8.0, 1.0)))
    assert harness.ratios(ours, peer, "wall_s") == [0.25, 0.25]


@pytest.mark.parametrize(
    ("value", "word"),
    [(0.05, "aim met"), (0.1, "aim met"), (0.2, "met"), (0.5, "met"), (0.51, "missed")],
)
def test_verdict(harness, value: float, word: str):
    assert harness.verdict(value, 0.5, 0.1) == word
    assert harness.verdict(value, 0.5, None) == ("met" if word == "aim met" else word)


@pytest.mark.parametrize(
    ("spread", "after", "change"),
    [(0.01, 1.05, None), (0.01, 1.25, 1.25), (0.01, 0.5, 0.5), (0.3, 1.25, None)],
)
def test_a_change_within_noise_is_none(harness, spread, after, change):
    before = {"median": 1.0, "spread": spread}
    found = harness.change({**before, "median": after}, before)
    assert found == (None if change is None else pytest.approx(math.log(change)))


def test_regressions_compare_like_with_like(harness):
    def result(ratio: float, setting: str = "all") -> dict:
        runs = [
            {"name": name, "title": name, "ratio": {"wall_s": harness.summary([ratio] * 3)}}
            for name in ("nearlift", "peer")
        ]
        return {"benches": {"waiting": {"setting": setting, "one": "peer", "contestants": runs}}}

    worse = "waiting: nearlift: wall 0.8 x peer, was 0.5: 60 % worse"
    assert harness.regressions(result(0.8), result(0.5)) == [worse]
    for before in (result(0.8), result(0.5, "a part"), {}):
        assert harness.regressions(result(0.8), before) == []


def test_contestants_take_turns_and_are_measured(harness, bench, tmp_path: Path):
    said: list[str] = []
    runs = harness.contest("waiting", bench, tmp_path, 2, said.append)
    turn = ["waiting: peer", "waiting: nearlift"]
    assert [s.split(",")[0] for s in said] == [*turn, *turn, "waiting: slow", *turn]
    assert [len(own) for own in runs.values()] == [2, 2, 1]
    assert all(r["wall_s"] >= 0.3 > r["cpu_s"] for r in runs["peer"])
    assert runs["nearlift"][0]["wall_s"] == 0.15
    # a child's peak begins with its parent's, which is why the harness itself stays small; here it
    # is pytest's
    begun = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    assert runs["slow"][0]["peak_MiB"] > 380
    assert runs["peer"][0]["peak_MiB"] < max(380, 1.1 * begun)
    told = harness.told(bench, "nothing", runs)
    (target,) = told["targets"]
    ratio = harness.median([0.15 / r["wall_s"] for r in runs["peer"]])
    assert (target["verdict"], target["median"]) == ("met", pytest.approx(ratio))
    benches = {"waiting": {**told, "load": [1.0, 2.0]}}
    page = harness.markdown({"machine": harness.machine(), "benches": benches})
    assert all(part in page for part in ("| waiting | 0.9 | 0.01 |", "| nearlift |", " ESS |"))


def test_a_contestant_that_fails_stops_the_run(harness):
    with pytest.raises(SystemExit, match="failed with 3"):
        harness.measure([sys.executable, "-S", "-c", "raise SystemExit(3)"])


def test_every_benchmark_is_one(harness):
    main = importlib.import_module("benchmarks.__main__")
    assert len(main.NAMES) > 8
    for name in main.NAMES:
        found = main.bench_of(name)
        names = [c.name for c in found.contestants]
        assert found.one in names
        assert len(set(names)) == len(names)
        assert all(t.ours in names and (not t.peer or t.peer in names) for t in found.targets)


@pytest.mark.parametrize("path", sorted((ROOT / "benchmarks").glob("*.py")), ids=lambda p: p.stem)
def test_names_that_contestants_import_exist(path):
    """They are imported within functions that no other test runs."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] == "nearlift":
            module = importlib.import_module(str(node.module))
            for alias in node.names:
                if not hasattr(module, alias.name):
                    importlib.import_module(f"{node.module}.{alias.name}")
