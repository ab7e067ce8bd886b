"""Stages run on one BLAS thread in a program that has several, and leave it as many as it had."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from nearlift import blas

from . import small_run

#: The caller has 3 threads, whatever the number of processors; scipy's library is loaded only
#: when the stage needs it.
PROGRAM = """
import sys
import numpy
from threadpoolctl import threadpool_info, threadpool_limits
import nearlift
from nearlift.reduction import lift_change

def threads():
    return {p["filepath"]: p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"}

def watched(*inputs, made=lift_change.lift_change, **named):
    import scipy.linalg
    print(max(threads().values()))
    return made(*inputs, **named)

before = set(threads())
threadpool_limits(3, "blas")
lift_change.lift_change = watched
nearlift.load(*sys.argv[1:], executor="serial").reduce()
print(*{threads()[path] for path in before})
"""


def program(code: str, *arguments: object, **environment: str) -> str:
    """What a program prints whose environment has no number of threads but this."""
    kept = {name: value for name, value in os.environ.items() if name not in blas.VARIABLES}
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        env=kept | environment,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.strip()


@pytest.mark.parametrize(
    ("environment", "threads"), [({}, "1\n3"), ({"OMP_NUM_THREADS": "1"}, "3\n3")]
)
@pytest.mark.nightly
def test_a_stage_has_one_thread_unless_the_environment_says_otherwise(
    tmp_path, environment, threads
):
    campaign = small_run.write_means(tmp_path / "raw", 24, quick=True)
    assert program(PROGRAM, campaign, tmp_path, **environment) == threads


def test_of_stages_at_once_the_last_to_end_gives_the_threads_back():
    code = """
import scipy.linalg
from threadpoolctl import threadpool_info, threadpool_limits
from nearlift.blas import one_thread

def threads():
    return {p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"}

threadpool_limits(3, "blas")
first, second = one_thread(), one_thread()
first.__enter__()
second.__enter__()
first.__exit__(None, None, None)
print(*threads())
second.__exit__(None, None, None)
print(*threads())
"""
    assert program(code) == "1\n3"
