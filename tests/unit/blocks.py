"""Code blocks of the documentation: found, distinguished, run.

``sh`` blocks are run line by line, ``python`` blocks in one namespace per page, ``toml`` blocks are
parsed, and where they are part of a manifest, checked as one. A ``text`` block is what the block
before it printed: its lines must come in this order, blanks apart, with ``...`` for what is left
out. Numbers that Python printed must agree to a unit of their last digit; those of a command may
be of another campaign. ``folders`` must be there. A comment before a block, ``<!-- not run: reason
-->``, exempts it.
"""

from __future__ import annotations

import contextlib
import csv
import glob
import io
import re
import shlex
import subprocess
import textwrap
import tomllib
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any

from click.testing import CliRunner

from nearlift.campaign import manifest as campaign
from nearlift.cli import main

from .manifests import raw_manifest

ROOT = Path(__file__).parents[2]
FENCE = re.compile(
    r"(?:<!-- not run: (?P<why>.+?) -->\n)?^(?P<indent>"
    r" *)```(?P<kind>\w*)[^\n]*\n(?P<body>.*?)^(?P=indent)```$",
    re.M | re.S,
)
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
#: Stand-ins in commands, and what they stand for here.
STANDS_FOR = {".venv/bin/": "", "CAMPAIGN": "demo-campaign"}


@dataclass(frozen=True, slots=True)
class Block:
    page: Path
    line: int
    kind: str
    body: str
    why_not: str

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def pages() -> list[Path]:
    """Pages that are written by hand; `make docs` generates those in docs/reference."""
    docs = (
        p
        for p in sorted((ROOT / "docs").rglob("*.md"))
        if "reference" not in p.relative_to(ROOT).parts
    )
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *docs]


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    return [
        Block(
            page,
            text[: found.start("body")].count("\n"),
            found["kind"],
            found["body"],
            found["why"] or "",
        )
        for found in FENCE.finditer(text)
    ]


@dataclass
class Runner:
    """Runs the blocks of one page, in the present folder."""

    names: dict[str, Any] = field(default_factory=dict)
    printed: str = ""
    by_python: bool = False

    def run(self, block: Block) -> None:
        """Run one block; an assertion fails with the block's place."""
        if block.why_not or "--8<--" in block.body:
            return
        match block.kind:
            case "sh":
                self.by_python = False
                self.printed = "".join(self._command(line, block) for line in _lines(block.body))
            case "python":
                told = io.StringIO()
                with contextlib.redirect_stdout(told):
                    exec(compile(textwrap.dedent(block.body), str(block), "exec"), self.names)
                self.printed, self.by_python = told.getvalue(), True
            case "toml":
                content = tomllib.loads(block.body)
                if "project" not in content:
                    campaign.parse(
                        content if "schema" in content else _merged(raw_manifest(), content),
                        str(block),
                    )
            case "csv":
                header, *rows = csv.reader(block.body.splitlines())
                assert all(len(row) == len(header) for row in rows if row != ["..."]), (
                    f"{block}: a row has another number of cells than the header"
                )
            case "text":
                _said(block, self.printed, numbers=self.by_python)
            case "c":
                # test_export_page compiles it
                pass
            case "folders":
                for line in block.body.splitlines():
                    base, *inner = re.findall(r"[\w./]+/(?= |$)", line)
                    assert (ROOT / base).is_dir(), f"{block}: {base} is no folder"
                    for name in inner:
                        assert (ROOT / base / name).is_dir() or (ROOT / name).is_dir(), (
                            f"{block}: {name} is no folder"
                        )
            case _:
                raise AssertionError(
                    f"{block}: {block.kind or 'no language'}: nobody knows how to run it"
                )

    def _command(self, line: str, block: Block) -> str:
        for stand_in, real in STANDS_FOR.items():
            line = line.replace(stand_in, real)
        words = [
            w
            for word in shlex.split(line, comments=True)
            for w in (sorted(glob.glob(word)) if "*" in word else [word])  # noqa: PTH207
        ]
        if words[0] == "make":
            done = subprocess.run(
                ["make", "--dry-run", *words[1:]],
                cwd=ROOT,
                capture_output=True,
                text=True,
                check=False,
            )
            assert done.returncode == 0, f"{block}: {line}: {done.stderr}"
            return ""
        assert words[0] == "nearlift", f"{block}: {line}: only nearlift and make are run here"
        answer = CliRunner().invoke(main, words[1:])
        assert answer.exit_code == 0, f"{block}: {line}: {answer.exit_code}\n{answer.output}"
        return answer.stdout


def _lines(body: str) -> list[str]:
    joined = body.replace("\\\n", " ")
    return [
        line.strip()
        for line in joined.splitlines()
        if line.strip() and not line.strip().startswith("#")
    ]


def _said(block: Block, printed: str, *, numbers: bool) -> None:
    """Whether the lines of the block were printed, in this order."""
    lines = printed.splitlines()
    rest, loose = [_plain(line) for line in lines], False
    for line in block.body.splitlines():
        if line.strip() == "...":
            loose = True
            continue
        wanted = _plain(line)
        assert wanted in rest, f"{block}: {line!r} was not printed:\n{printed}"
        at = rest.index(wanted)
        assert loose or at == 0, f"{block}: before {line!r} stands more:\n{printed}"
        if numbers:
            assert _same_numbers(line, lines[at]), f"{block}: {line!r}, but printed: {lines[at]!r}"
        rest, lines, loose = rest[at + 1 :], lines[at + 1 :], False
    assert loose or not rest, f"{block}: more was printed: {rest}"


def _plain(line: str) -> str:
    return " ".join(NUMBER.sub("#", line).split())


def _same_numbers(wanted: str, printed: str) -> bool:
    """Whether numbers agree to a unit of their last digit: rounding differs between processors."""
    pairs = zip(NUMBER.findall(wanted), NUMBER.findall(printed), strict=True)
    return all(
        abs(Decimal(a) - Decimal(b)) <= Decimal((0, (1,), int(Decimal(a).as_tuple().exponent)))
        for a, b in pairs
    )


def _merged(base: dict[str, Any], more: dict[str, Any]) -> dict[str, Any]:
    return base | {
        k: _merged(base[k], v) if isinstance(v, dict) and isinstance(base.get(k), dict) else v
        for k, v in more.items()
    }
