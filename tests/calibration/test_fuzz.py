"""A minute of fuzzing for each own parser, the manifest and the schedule: nothing but our own
exceptions, within 2 s and 512 MB per input.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from tests.calibration.fuzzing import MEMORY_MB, TIME_S
from tests.calibration.targets import TARGETS, once

ROOT = Path(__file__).parents[2]
SECONDS = 60


@pytest.mark.parametrize("target", list(TARGETS))
def test_seeds_are_answered(target: str) -> None:
    """The fuzzer starts from inputs that its target reads, or refuses in our words."""
    for seed in TARGETS[target][1]:
        once(target, seed)


def fuzzed(target: str, seconds: int, folder: Path) -> tuple[int, float, int]:
    """Fuzz a target for so long: number of inputs, the longest that one took in s of processor
    time, and the process's peak memory in MB.
    """
    words = [
        sys.executable,
        "-m",
        "tests.calibration.fuzzing",
        target,
        str(seconds),
        str(folder / target),
    ]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "pipeline")])}
    done = subprocess.run(
        words,
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    found = {name: int(value) for name, value in re.findall(r"stat::(\w+):\s+(\d+)", done.stderr)}
    return (
        found["number_of_executed_units"],
        float((folder / f"{target}-slowest.txt").read_text()),
        found["peak_rss_mb"],
    )


@pytest.mark.calibration
@pytest.mark.parametrize("target", list(TARGETS))
def test_a_minute_of_fuzzing(target: str, tmp_path: Path) -> None:
    pytest.importorskip("atheris")
    number, slowest, memory = fuzzed(target, SECONDS, tmp_path)
    print(f"| {target} | {number} | {1e3 * slowest:.0f} ms | {memory} MB |")
    assert slowest < TIME_S
    assert memory < MEMORY_MB
