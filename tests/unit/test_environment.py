"""The two locks: what nearlift runs on, and what its tests need besides."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
RUN, DEV = "requirements.lock", "requirements-dev.lock"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def locked(file: str) -> set[str]:
    """Names in a lock that apply to this Python."""
    lines = (ROOT / file).read_text(encoding="utf-8").splitlines()
    each = [Requirement(line.removesuffix("\\")) for line in lines if not line.startswith(" ")]
    return {canonicalize_name(r.name) for r in each if r.marker is None or r.marker.evaluate()}


def closure(wanted: Iterable[str]) -> set[str]:
    """What is installed for these requirements here, by the packages' own metadata."""
    extras: dict[str, set[str]] = {}
    todo = [(Requirement(text), {""}) for text in wanted]
    while todo:
        one, of = todo.pop()
        name = canonicalize_name(one.name)
        if one.marker and not any(one.marker.evaluate({"extra": e}) for e in of):
            continue
        if name in extras and one.extras <= extras[name]:
            continue
        extras[name] = extras.get(name, {""}) | one.extras
        todo += [(Requirement(text), extras[name]) for text in metadata.requires(name) or ()]
    return extras.keys() - {"nearlift"}


def test_every_line_of_a_lock_is_a_pin_with_its_digests():
    for file in (RUN, DEV):
        for block in re.split(r"\n(?! )", (ROOT / file).read_text(encoding="utf-8").strip()):
            head, *digests = block.split(" \\\n")
            assert re.fullmatch(r"[a-z0-9-]+==[\w.]+( ; [\w .<>=!']+)?", head), head
            assert digests, head
            assert all(re.fullmatch(r"    --hash=sha256:[0-9a-f]{64}", d) for d in digests), head


def test_the_demo_installs_what_nearlift_runs_on_and_nothing_else():
    run = locked(RUN)
    group = [x for x in PROJECT["dependency-groups"]["build"] if isinstance(x, str)]
    assert run == closure([*PROJECT["project"]["dependencies"], *group])
    assert run.isdisjoint(locked(DEV))
    assert f":= {len(run)} packages" in (ROOT / "Makefile").read_text()


def test_no_module_needs_more_than_the_demo_installs():
    """What an extra is for is imported where it is used."""
    homes, lock = metadata.packages_distributions(), locked(RUN)
    for path in (ROOT / "pipeline" / "nearlift").rglob("*.py"):
        named: set[str] = set()
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Import):
                named |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                named.add((node.module or "").split(".")[0])
        for package in named - {"nearlift"} - sys.stdlib_module_names:
            assert {canonicalize_name(d) for d in homes[package]} & lock, (path, package)
