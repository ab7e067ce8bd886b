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

from nearlift.campaign import manifest as campaign

from .manifests import raw_manifest
from .small_run import nearlift

ROOT = Path(__file__).parents[2]
FENCE = re.compile(
    r"(?:<!-- not run: (?P<why>.+?) -->\n)?^(?P<indent>"
    r" *)```(?P<kind>\w*)[^\n]*\n(?P<body>.*?)^(?P=indent)```$",
    re.M | re.S,
)
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
#: Stand-ins in commands, and what they mean here.
MEANING = {".venv/bin/": "", "CAMPAIGN": "demo-campaign"}


@dataclass(frozen=True, slots=True)
class Block:
    page: Path
    line: int
    kind: str
    body: str
    why_not: str = ""

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def pages() -> list[Path]:
    """Pages that are written by hand; `make docs` generates those in docs/reference."""
    docs = sorted((ROOT / "docs").rglob("*.md"))
    written = (p for p in docs if "reference" not in p.relative_to(ROOT).parts)
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *written]


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    return [
        Block(page, text[: m.start("body")].count("\n"), m["kind"], m["body"], m["why"] or "")
        for m in FENCE.finditer(text)
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
                lines = [line.strip() for line in block.body.replace("\\\n", " ").splitlines()]
                commands = [line for line in lines if line and not line.startswith("#")]
                self.by_python = False
                self.printed = "".join(_command(line, block) for line in commands)
            case "python":
                with contextlib.redirect_stdout(io.StringIO()) as printed:
                    exec(compile(textwrap.dedent(block.body), str(block), "exec"), self.names)
                self.printed, self.by_python = printed.getvalue(), True
            case "toml":
                content = tomllib.loads(block.body)
                if "project" not in content:
                    whole = content if "schema" in content else _merged(raw_manifest(), content)
                    campaign.parse(whole, str(block))
            case "csv":
                header, *rows = csv.reader(block.body.splitlines())
                lengths = {len(row) for row in rows if row != ["..."]}
                assert lengths <= {len(header)}, f"{block}: a row is not as long as the header"
            case "text":
                _was_printed(block, self.printed, numbers=self.by_python)
            case "c":
                # test_export_page compiles it
                pass
            case "folders":
                for line in block.body.splitlines():
                    base, *inner = re.findall(r"[\w./]+/(?= |$)", line)
                    assert (ROOT / base).is_dir(), f"{block}: {base} is no folder"
                    for name in inner:
                        there = (ROOT / base / name).is_dir() or (ROOT / name).is_dir()
                        assert there, f"{block}: {name} is no folder"
            case kind:
                raise AssertionError(f"{block}: {kind or 'no language'}: is not known here")


def _command(line: str, block: Block) -> str:
    """What a command prints; it must succeed."""
    for stand_in, real in MEANING.items():
        line = line.replace(stand_in, real)
    program, *words = [
        w
        for word in shlex.split(line, comments=True)
        for w in (sorted(glob.glob(word)) if "*" in word else [word])  # noqa: PTH207
    ]
    if program == "make":
        command = ["make", "--dry-run", *words]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{block}: {line}: {done.stderr}"
        return ""
    assert program == "nearlift", f"{block}: {line}: only nearlift and make are run here"
    answer = nearlift(*words)
    assert answer.exit_code == 0, f"{block}: {line}: {answer.exit_code}\n{answer.output}"
    return answer.stdout


def _was_printed(block: Block, printed: str, *, numbers: bool) -> None:
    """Whether the lines of the block were printed, in this order."""
    lines, loose = printed.splitlines(), False
    for line in block.body.splitlines():
        if line.strip() == "...":
            loose = True
            continue
        plain = [_plain(other) for other in lines]
        assert _plain(line) in plain, f"{block}: {line!r} was not printed:\n{printed}"
        at = plain.index(_plain(line))
        assert loose or at == 0, f"{block}: more was printed before {line!r}:\n{printed}"
        same = not numbers or _same_numbers(line, lines[at])
        assert same, f"{block}: {line!r}, but printed: {lines[at]!r}"
        lines, loose = lines[at + 1 :], False
    assert loose or not lines, f"{block}: more was printed: {lines}"


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
