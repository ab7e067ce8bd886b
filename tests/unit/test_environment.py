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


def locked(file: str) -> list[Requirement]:
    """What a lock names, one requirement for each marker."""
    lines = (ROOT / file).read_text(encoding="utf-8").splitlines()
    return [Requirement(line.removesuffix("\\")) for line in lines if not line.startswith(" ")]


def names(requirements: Iterable[Requirement]) -> set[str]:
    """Those that apply to this Python, by name."""
    return {
        canonicalize_name(r.name) for r in requirements if r.marker is None or r.marker.evaluate()
    }


def closure(wanted: Iterable[str]) -> set[str]:
    """What is installed for these requirements here, by the packages' own metadata."""
    found: dict[str, set[str]] = {}
    todo = [Requirement(text) for text in wanted]
    while todo:
        one = todo.pop()
        name = canonicalize_name(one.name)
        if one.marker is not None and not one.marker.evaluate({"extra": ""}):
            continue
        if name in found and one.extras <= found[name]:
            continue
        extras = found[name] = found.get(name, set()) | one.extras
        for text in metadata.requires(name) or ():
            inner = Requirement(text)
            marker = inner.marker
            if marker is None or any(marker.evaluate({"extra": e}) for e in extras | {""}):
                inner.marker = None
                todo.append(inner)
    return found.keys() - {"nearlift"}


def group(name: str) -> list[str]:
    """A dependency group, those that it includes among it."""
    found = []
    for item in PROJECT["dependency-groups"][name]:
        found += [item] if isinstance(item, str) else group(item["include-group"])
    return found


def test_every_line_of_a_lock_is_a_pin_with_its_digests():
    for file in (RUN, DEV):
        blocks = re.split(r"\n(?! )", (ROOT / file).read_text(encoding="utf-8").strip())
        for block in blocks:
            head, *digests = block.split(" \\\n")
            assert re.fullmatch(r"[a-z0-9-]+==[\w.]+( ; [\w .<>=!']+)?", head), head
            assert digests, head
            assert all(re.fullmatch(r"    --hash=sha256:[0-9a-f]{64}", d) for d in digests), head


def test_no_package_stands_in_both_locks():
    assert {r.name for r in locked(RUN)}.isdisjoint(r.name for r in locked(DEV))


def test_the_demo_installs_what_nearlift_runs_on_and_nothing_else():
    assert names(locked(RUN)) == closure([*PROJECT["project"]["dependencies"], *group("build")])


def test_tests_find_every_extra_and_every_tool():
    extras = [r for own in PROJECT["project"]["optional-dependencies"].values() for r in own]
    assert names([*locked(RUN), *locked(DEV)]) == closure(
        [*PROJECT["project"]["dependencies"], *extras, *group("dev")]
    )


def outside(tree: ast.Module) -> set[str]:
    """Packages that a module imports when it is imported itself."""
    found: set[str] = set()
    for node in tree.body:
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add((node.module or "").split(".")[0])
    return found - {"nearlift"} - sys.stdlib_module_names


def test_no_module_needs_more_than_the_demo_installs():
    """What an extra is for is imported where it is used."""
    homes = metadata.packages_distributions()
    lock = names(locked(RUN))
    for path in (ROOT / "pipeline" / "nearlift").rglob("*.py"):
        for package in outside(ast.parse(path.read_text(encoding="utf-8"))):
            assert {canonicalize_name(d) for d in homes[package]} & lock, (path, package)


def test_make_tells_how_many_packages_it_installs():
    assert f":= {len(names(locked(RUN)))} packages" in (ROOT / "Makefile").read_text()
