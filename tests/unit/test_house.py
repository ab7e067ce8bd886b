"""The codebase: class names are unique, no name is a word that says nothing, no module is long."""

import ast
import re
from collections import Counter
from pathlib import Path

import nearlift

ROOT = Path(nearlift.__file__).parent
NODES = {
    str(path.relative_to(ROOT)): list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    for path in sorted(ROOT.rglob("*.py"))
}
#: They say that there is a value, and not which.
EMPTY = {"found", "own", "told"}


def test_a_class_has_a_name_of_its_own():
    count = Counter(
        n.name for nodes in NODES.values() for n in nodes if isinstance(n, ast.ClassDef)
    )
    assert len(count) > 100
    assert [name for name, times in count.items() if times > 1] == []


def test_variables_and_functions_say_what_they_hold():
    functions = [
        (path, n) for path, nodes in NODES.items() for n in nodes if isinstance(n, ast.FunctionDef)
    ]
    assert len(functions) > 1000
    empty = {*EMPTY, "of", "heard"}
    assert [path for path, function in functions if function.name in empty] == []
    assert [
        (path, function.name)
        for path, function in functions
        for n in ast.walk(function)
        if (isinstance(n, ast.arg) and n.arg in EMPTY)
        or (isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store) and n.id in EMPTY)
    ] == []


def test_dictionaries_of_anything_are_few():
    """What is computed has a type: fewer than fifty places hold a dictionary of anything."""
    texts = ((ROOT / path).read_text(encoding="utf-8") for path in NODES)
    assert sum(len(re.findall(r"(?:dict|Mapping)\[str, Any\]", text)) for text in texts) < 50


def test_no_module_is_longer_than_800_lines():
    lines = {path: len((ROOT / path).read_text(encoding="utf-8").splitlines()) for path in NODES}
    assert len(lines) > 100
    assert {path: n for path, n in lines.items() if n > 800} == {}
