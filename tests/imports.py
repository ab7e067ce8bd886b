"""Which modules of the package a test module rests on, read from the import statements: how `make
check` chooses its tests.
"""

from __future__ import annotations

import ast
import functools
import tomllib
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCES = {"nearlift": ROOT / "pipeline" / "nearlift", "tests": ROOT / "tests"}


def module_name(path: Path) -> str:
    """Dotted name of a file of the package or of the tests."""
    for top, folder in SOURCES.items():
        if path.is_relative_to(folder):
            parts = (top, *path.relative_to(folder).with_suffix("").parts)
            return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
    raise ValueError(path)


@functools.cache
def modules() -> Mapping[str, Path]:
    """Every module of the package and of the tests."""
    files = (path for folder in SOURCES.values() for path in folder.rglob("*.py"))
    return {module_name(path): path for path in files}


@functools.cache
def imported(name: str) -> frozenset[str]:
    """Modules of the package and of the tests that a module imports or has in quotes, as what is
    compiled when it is first called.
    """
    path = modules()[name]
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    named: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            named |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) + 1 - node.level] if node.level else []
            base = ".".join([*start, *([node.module] if node.module else [])])
            inner = {f"{base}.{alias.name}" for alias in node.names}
            named |= {n if n in modules() else base for n in inner}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            named.add(node.value)
    return frozenset(n for n in named if n in modules())


@functools.cache
def used(test: str) -> frozenset[str]:
    """Modules of the package that a test module imports, itself or through helpers in tests."""
    seen, todo = {test}, [test]
    while todo:
        fresh = {n for n in imported(todo.pop()) if n.startswith("tests.")} - seen
        seen |= fresh
        todo += fresh
    return frozenset(n for s in seen for n in imported(s) if n.split(".")[0] == "nearlift")


@functools.cache
def core_rooms() -> frozenset[str]:
    """The loop and every package below it in the layers of pyproject.toml."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    layers = next(
        c["layers"] for c in settings["tool"]["importlinter"]["contracts"] if "layers" in c
    )
    rooms = [[room.strip() for room in layer.replace(":", "|").split("|")] for layer in layers]
    loop = next(i for i, layer in enumerate(rooms) if "loop" in layer)
    return frozenset(room for layer in rooms[loop:] for room in layer)


def is_core(test: str) -> bool:
    """Whether a test module rests on the core, and on nothing above it."""
    rooms = {[*n.split("."), ""][1] for n in used(test)}
    return bool(rooms) and rooms <= core_rooms()
