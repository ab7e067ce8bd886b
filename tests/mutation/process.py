"""Tests run on a tree by a process that has imported what takes long, and nothing of the package."""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest


@dataclass
class Recorder:
    """Which of some lines every test runs, in which files it calls a function, and its seconds of
    processor; into the file `record` of the tree, by test.
    """

    lines: Mapping[str, frozenset[int]]
    record: dict[str, tuple[float, list[str]]] = field(default_factory=dict)
    ran: set[str] = field(default_factory=set)
    watched: dict[CodeType, tuple[str, frozenset[int]] | None] = field(default_factory=dict)

    def watch(self, code: CodeType) -> tuple[str, frozenset[int]] | None:
        """File and lines of a function that are asked for; None of another's, or of an import."""
        package = f"{Path.cwd()}/"
        file = code.co_filename.removeprefix(package)
        if code.co_name == "<module>" or not code.co_filename.startswith(f"{package}pipeline/"):
            return None
        inside = {line for _, _, line in code.co_lines() if line is not None}
        return file, self.lines.get(file, frozenset()) & inside

    def called(self, frame: FrameType, event: str, value: Any) -> Any:
        code = frame.f_code
        if code not in self.watched:
            self.watched[code] = self.watch(code)
        if (there := self.watched[code]) is None:
            return None
        file, lines = there
        self.ran.add(file)

        def line_run(frame: FrameType, event: str, value: Any) -> Any:
            if frame.f_lineno in lines:
                self.ran.add(f"{file}:{frame.f_lineno}")
            return line_run

        return line_run if lines else None

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self.ran, began = set(), time.process_time()
        sys.settrace(self.called)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            self.record[item.nodeid] = (time.process_time() - began, sorted(self.ran))

    def pytest_sessionfinish(self) -> None:
        Path("record").write_text(json.dumps(self.record), encoding="utf-8")


@dataclass
class Order:
    """Tests in that order, and others of their modules after them."""

    tests: Sequence[str]

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        place = {test: i for i, test in enumerate(self.tests)}
        items.sort(key=lambda item: place.get(item.nodeid, len(place)))


def run_tests(tree: Path, options: list[str], plugin: Recorder | Order, limit_s: int) -> None:
    """Run quick tests of the core on a tree, results into its file `out`, and end; killed after
    `limit_s` of processor.
    """
    for name in [n for n in sys.modules if n.split(".")[0] == "tests"]:
        del sys.modules[name]
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
    os.chdir(tree)
    sys.path[:0] = [str(tree / "pipeline"), str(tree)]
    with (tree / "out").open("w") as out:
        os.dup2(out.fileno(), 1)
        os.dup2(out.fileno(), 2)
    quietly = ["-q", "-n0", "-p", "no:randomly", "-p", "no:cacheprovider", "--core"]
    code = pytest.main([*quietly, *options], [plugin])
    sys.stdout.flush()
    os._exit(code)
