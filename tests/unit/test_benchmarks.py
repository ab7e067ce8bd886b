"""The benchmarks' arithmetic, and that contestants are measured as they are."""

from __future__ import annotations

import ast
import importlib
import math
import sys
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner

from nearlift.cli import main

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


def test_medians_and_ratios_of_one_round_each(harness):
    """The machine was half as fast in the second round: the ratio does not know."""
    summary = harness.summary([1.0, 2.0, 3.0, 4.0, 100.0])
    assert [summary[k] for k in ("median", "low", "high", "n")] == [3.0, 1.0, 100.0, 5]
    assert summary["spread"] == pytest.approx(1.4826)
    ours, peer = ([{"wall_s": t} for t in walls] for walls in ((1.0, 2.0), (4.0, 8.0, 1.0)))
    assert harness.ratios(ours, peer, "wall_s") == [0.25, 0.25]
    verdicts = [harness.verdict(x, 0.5, 0.1) for x in (0.1, 0.5, 0.51)]
    assert verdicts == ["aim met", "met", "missed"]


@pytest.mark.parametrize(
    ("spread", "after", "change"),
    [(0.01, 1.05, None), (0.01, 1.25, 1.25), (0.01, 0.5, 0.5), (0.3, 1.25, None)],
)
def test_a_change_within_noise_is_none(harness, spread, after, change):
    before = {"median": 1.0, "spread": spread}
    expected = None if change is None else pytest.approx(math.log(change))
    assert harness.change({**before, "median": after}, before) == expected


def test_contestants_take_turns_and_are_measured(harness, tmp_path: Path):
    def contestant(name: str, code: str, **more):
        command = [sys.executable, "-S", "-c", code]
        return harness.Contestant(name=name, title=name, command=lambda _: command, **more)

    bench = harness.Bench(
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
    said: list[str] = []
    runs = harness.contest("waiting", bench, tmp_path, 2, said.append)
    turn = ["waiting: peer", "waiting: nearlift"]
    assert [s.split(",")[0] for s in said] == [*turn, *turn, "waiting: slow", *turn]
    assert all(r["wall_s"] >= 0.3 > r["cpu_s"] for r in runs["peer"])
    assert runs["nearlift"][0]["wall_s"] == 0.15
    assert runs["slow"][0]["peak_MiB"] > 380
    result = harness.told(bench, "nothing", runs)
    ratio = harness.median([0.15 / r["wall_s"] for r in runs["peer"]])
    (target,) = result["targets"]
    assert (target["verdict"], target["median"]) == ("met", pytest.approx(ratio))
    benches = {"waiting": {**result, "load": [1.0, 2.0]}}
    page = harness.markdown({"machine": harness.machine(), "benches": benches})
    assert all(part in page for part in ("| waiting | 0.9 | 0.01 |", "| nearlift |", " ESS |"))
    with pytest.raises(SystemExit, match="failed with 3"):
        harness.measure([sys.executable, "-S", "-c", "raise SystemExit(3)"])


def test_every_benchmark_is_one(harness):
    main = importlib.import_module("benchmarks.__main__")
    for name in main.NAMES:
        bench = main.bench_of(name)
        names = [c.name for c in bench.contestants]
        assert bench.one in names
        assert all(t.ours in names and (not t.peer or t.peer in names) for t in bench.targets)


@pytest.mark.parametrize("path", sorted((ROOT / "benchmarks").glob("*.py")), ids=lambda p: p.stem)
def test_names_that_contestants_import_exist(path):
    """They are imported within functions that no other test runs."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] == "nearlift":
            module = importlib.import_module(str(node.module))
            for alias in node.names:
                if not hasattr(module, alias.name):
                    importlib.import_module(f"{node.module}.{alias.name}")


@pytest.mark.parametrize(("form", "sagging"), [("csv", False), ("csv_with_time", True)])
def test_the_campaign_that_is_benched_is_read_to_the_last_record(
    harness, tmp_path: Path, monkeypatch, form, sagging
):
    paper = importlib.import_module("benchmarks._paper")
    monkeypatch.setattr(paper, "TARE", 0.1)
    monkeypatch.setattr(paper, "RECORD", 0.3)
    folder = paper.campaign(tmp_path, 0.05, form, sagging)
    out = tmp_path / "out"
    done = CliRunner().invoke(main, ["ingest", str(folder), "--out", str(out), "-q"])
    assert done.exit_code == 0, done.output
    trials = pd.read_parquet(out / "processed" / "paper" / "trials.parquet")
    assert len(trials) == len(list((folder / "trials").iterdir())) > 100
    assert (trials["completeness"] == "complete").all()
    assert (trials["quality"] == "").all()
