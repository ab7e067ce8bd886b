"""Lets the calibration's modules import each other as `tests.calibration.*`, from pytest, from its
workers and from the command line.
"""

import sys
from collections.abc import Iterator
from concurrent.futures import Executor
from pathlib import Path

import pytest

from nearlift.run.workers import open_executor

ROOT = str(Path(__file__).resolve().parents[2])
if ROOT not in sys.path:
    sys.path.insert(0, ROOT)


@pytest.fixture(scope="session")
def executor(request: pytest.FixtureRequest) -> Iterator[Executor]:
    """Where simulated campaigns run; results do not depend on it."""
    with open_executor(request.config.getoption("--executor")) as found:
        yield found
