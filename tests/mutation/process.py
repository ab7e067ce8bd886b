"""Tests run on a tree by a process that has imported what takes long, and nothing of the package."""

from __future__ import annotations

import os
import resource
import sys
from pathlib import Path

import pytest


def run_tests(tree: Path, tests: list[str], core: bool, limit_s: int) -> None:
    """Run tests on a tree, results into its file `out`, and end; killed after `limit_s` of
    processor. With `core`, the quick ones alone.
    """
    for name in [n for n in sys.modules if n.split(".")[0] == "tests"]:
        del sys.modules[name]
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
    os.chdir(tree)
    sys.path[:0] = [str(tree / "pipeline"), str(tree)]
    with (tree / "out").open("w") as out:
        os.dup2(out.fileno(), 1)
        os.dup2(out.fileno(), 2)
    options = ["-x", "-q", "-n0", "-p", "no:randomly", "-p", "no:cacheprovider"]
    code = pytest.main([*options, *(["--core"] if core else []), *tests])
    sys.stdout.flush()
    os._exit(code)
