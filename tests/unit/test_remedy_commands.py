"""Every remedy that is a command of nearlift is one that the command line takes."""

from __future__ import annotations

import ast
import contextlib
import json
import re
import shlex
from pathlib import Path

import click
import pytest

import nearlift as package
from nearlift.cli import main
from nearlift.fit.estimator import NOT_LOOKED_AT

from . import small_run
from .small_run import nearlift

#: What a remedy leaves to be filled in.
GIVEN = {"DIR": "new", "FILES": ".", "FOLDER": ".", "FILE": ".", "CAMPAIGN": "."}


def proposed() -> set[str]:
    """Every command between back quotes in a text of the source; what a text fills in is a FILE."""
    found: set[str] = set()
    for path in Path(package.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.JoinedStr):
                parts = (v.value if isinstance(v, ast.Constant) else "FILE" for v in node.values)
                text = "".join(map(str, parts))
            elif isinstance(node, ast.Constant):
                text = str(node.value)
            else:
                continue
            found |= set(re.findall(r"`(nearlift [a-z][^`]+)`", text))
    return found


@pytest.mark.parametrize("command", sorted(proposed()))
def test_a_proposed_command_is_one_of_the_command_line(command):
    words = [GIVEN.get(word, word) for word in shlex.split(command)[1:]]
    if words[-1] == "--for":
        words.append("K_b")
    context = click.Context(main, **main.context_settings)
    name, made, rest = main.resolve_command(context, words)
    # where a text only names it, the campaign is left out
    with contextlib.suppress(click.MissingParameter):
        made.make_context(name, rest, parent=context)


def test_what_a_fit_alone_proposes_is_done_by_diagnose(tmp_path):
    folder = small_run.write_means(tmp_path / "raw", 24, quick=True)
    results = tmp_path / "processed" / "means" / "results.json"
    reasons = []
    for stage in ("ingest", "reduce", "fit", "diagnose"):
        assert nearlift(stage, folder, "--out", tmp_path, "-q").exit_code == 0
        if results.exists():
            reasons.append(json.loads(results.read_text())["boundaries"]["ground"]["reason"])
    assert reasons[0] == NOT_LOOKED_AT != reasons[1]


def test_what_a_reading_lacks_can_be_added_as_it_is_said(tmp_path):
    """One option at a time, until the only thing that is missing is the campaign."""
    words: list[str] = ["detect", str(tmp_path / "nowhere"), "--ratio", "1.1"]
    for _ in range(2):
        refused = nearlift(*words)
        assert refused.exit_code == 2
        added = re.search(r"\n  add (--.*)\n", refused.stderr)
        assert added, refused.stderr
        words += shlex.split(added[1])
    assert "holds no campaign.toml" in nearlift(*words).stderr
