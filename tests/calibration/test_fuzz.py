"""A minute of fuzzing for each own parser, the manifest and the schedule: nothing but our own exceptions, within 2 s and 512 MB per input."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests.calibration.targets import TARGETS, once

ROOT = Path(__file__).parents[2]
SECONDS = 60


@pytest.mark.parametrize("target", list(TARGETS))
def test_seeds_are_answered(target: str) -> None:
    """The fuzzer starts from inputs that its target reads, or refuses in our words."""
    for seed in TARGETS[target][1]:
        once(target, seed)


@pytest.mark.calibration
@pytest.mark.parametrize("target", list(TARGETS))
def test_a_minute_of_fuzzing(target: str, tmp_path: Path) -> None:
    pytest.importorskip("atheris")
    words = [sys.executable, "-m", "tests.calibration.fuzzing", target, str(SECONDS), str(tmp_path / "corpus")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "pipeline")])}
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
