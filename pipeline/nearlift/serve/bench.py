"""The workspace that the page shows: its campaigns, its files, and the commands that run in it.

Nothing is kept but the files that the command line uses, and in memory what commands say.
"""

from __future__ import annotations

import os
import re
import secrets
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from nearlift.errors import ManifestError, NearliftError, UsageError

if TYPE_CHECKING:
    from nearlift.run.transaction import Homes

MANIFEST = "campaign.toml"
#: Folders below the workspace down to which campaigns are looked for.
DEEPEST = 3
#: Lines of a command that are kept, commands that are kept, and those that may run at a time.
LINES, KEPT, AT_ONCE = 2000, 20, 4
_COMMAND = "import sys; sys.argv[0] = 'nearlift'; from nearlift.console import main; main()"


class NotThere(NearliftError):
    """Asked for what the workspace does not hold."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ServedCampaign:
    """One campaign: its folder, as the command line is given it, and where its products are."""

    root: Path
    given: str
    name: str
    homes: Homes


@dataclass(kw_only=True)
class Work:
    """A command that was begun; `lines` are its last ones, `said` how many there were."""

    key: str
    words: tuple[str, ...]
    title: str
    process: subprocess.Popen[str]
    result: str = ""
    campaign: str = ""
    begun: float = field(default_factory=time.monotonic)
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=LINES))
    said: int = 0
    ended: int | None = None

    @property
    def command(self) -> str:
        """As it is typed in the workspace."""
        return command_line(self.words)

    def follow(self, stream: Iterator[str]) -> None:
        """Keep what it says until it ends."""
        for line in stream:
            self.lines.append(line.rstrip("\n"))
            self.said += 1
        self.ended = self.process.wait()

    def since(self, count: int) -> tuple[list[str], int]:
        """Lines after so many, and how many there are by now."""
        said, kept = self.said, list(self.lines)
        return kept[max(len(kept) - (said - count), 0) :] if said > count else [], said

    def cancel(self) -> None:
        """As Ctrl-C does: finished products stand."""
        if self.ended is None:
            self.process.send_signal(signal.SIGINT)


def command_line(words: Sequence[str]) -> str:
    """A command as it is typed."""
    return shlex.join(("nearlift", *words))


class ServedWorkspace:
    """One workspace."""

    def __init__(self, root: Path) -> None:
        self.root = root.resolve()
        self.works: dict[str, Work] = {}
        self._lock = threading.Lock()

    def inside(self, relative: str) -> Path:
        """A path of the workspace, links followed.

        Raises
        ------
        NotThere
            It leads elsewhere, by ``..``, by a link, or because it is none.
        """
        try:
            path = (self.root / relative).resolve()
        except (OSError, ValueError, RuntimeError):
            path = self.root.parent
        if "\0" in relative or not path.is_relative_to(self.root):
            raise NotThere(relative, "is not in this workspace", "choose one of its campaigns")
        return path

    def root_of(self, given: str) -> Path:
        """A folder with a manifest, whatever that says.

        Raises
        ------
        NotThere
            It has none.
        """
        root = self.inside(given)
        if not self.inside(f"{given}/{MANIFEST}").is_file():
            raise NotThere(given, f"holds no {MANIFEST}", "choose one of the workspace's campaigns")
        return root

    def campaign(self, given: str) -> ServedCampaign:
        """The campaign in that folder.

        Raises
        ------
        NotThere
            There is none.
        """
        from nearlift.run.transaction import Homes

        root = self.root_of(given)
        relative = root.relative_to(self.root).as_posix()
        name = name_of(root / MANIFEST)
        if not name.strip("."):
            raise NotThere(given, f"cannot be called {name!r}", "mend `name` in its manifest")
        return ServedCampaign(
            root=root,
            given=relative if not relative.startswith("-") else f"./{relative}",
            name=name,
            homes=Homes.within(self.root, name),
        )

    def campaigns(self) -> Iterator[tuple[str, ServedCampaign | NearliftError]]:
        """Every folder with a manifest, and the campaign in it or why it is none."""
        for folder, folders, files in os.walk(self.root):
            here = Path(folder).relative_to(self.root)
            deep = len(here.parts)
            holds_manifest = MANIFEST in files
            folders[:] = sorted(
                name
                for name in folders
                if not holds_manifest
                and deep < DEEPEST
                and not name.startswith(".")
                and not (deep == 0 and name in ("processed", "reports"))
            )
            if holds_manifest:
                try:
                    yield here.as_posix(), self.campaign(here.as_posix())
                except NearliftError as refusal:
                    yield here.as_posix(), refusal

    def product(self, relative: str) -> Path:
        """A file of ``processed/`` or ``reports/``.

        Raises
        ------
        NotThere
            It is none.
        """
        path = self.inside(relative)
        homes = (self.root / "processed", self.root / "reports")
        if not (path.is_file() and any(path.is_relative_to(home) for home in homes)):
            raise NotThere(relative, "is no product of this workspace", "run the campaign first")
        return path

    def begin(self, words: Sequence[str], title: str, result: str = "", campaign: str = "") -> Work:
        """A command in a process of its own.

        Raises
        ------
        UsageError
            Too many are running.
        """
        with self._lock:
            running = [work for work in self.works.values() if work.ended is None]
            for work in running:
                if work.words == tuple(words):
                    return work
            if len(running) >= AT_ONCE:
                raise UsageError(
                    title, f"{AT_ONCE} commands are running", "wait for one, or cancel it"
                )
            process = self._start(words, subprocess.STDOUT)
            work = Work(
                key=secrets.token_urlsafe(8),
                words=tuple(words),
                title=title,
                process=process,
                result=result,
                campaign=campaign,
            )
            assert process.stdout is not None
            threading.Thread(target=work.follow, args=(process.stdout,), daemon=True).start()
            self.works[work.key] = work
            for key in [k for k, w in self.works.items() if w.ended is not None][:-KEPT]:
                del self.works[key]
            return work

    def ask(self, words: Sequence[str]) -> str:
        """What a short command answers on stdout.

        Raises
        ------
        NearliftError
            It was refused: its own words.
        """
        process = self._start(words, subprocess.PIPE)
        answer, said = process.communicate()
        if process.returncode not in (0, 3):
            reason = said.strip().removeprefix("error: ") or f"ended with {process.returncode}"
            raise NearliftError(command_line(words), reason)
        return answer

    def _start(self, words: Sequence[str], stderr: int) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-P", "-c", _COMMAND, *words],
            cwd=self.root,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
            errors="replace",
        )

    def work(self, key: str) -> Work:
        """The command of that key.

        Raises
        ------
        NotThere
            It is not known any more.
        """
        if key not in self.works:
            raise NotThere("command", "is not known any more", "look at the campaign itself")
        return self.works[key]

    def close(self) -> None:
        """End what is still running."""
        for work in self.works.values():
            work.cancel()


def name_of(path: Path) -> str:
    """The campaign's name in a manifest that may be broken elsewhere.

    Raises
    ------
    ManifestError
        There is no manifest, or no name above its first table.
    """
    if not path.is_file():
        raise ManifestError(str(path), "is missing", "name the campaign's folder")
    head = re.split(r"^\s*\[", path.read_text(errors="replace"), maxsplit=1, flags=re.MULTILINE)[0]
    match = re.search(r"""^\s*name\s*=\s*["'](\w[\w.-]*)["']""", head, re.MULTILINE)
    if match is None:
        raise ManifestError(str(path), "names no campaign", 'say `name = "..."` above its tables')
    return match[1]
