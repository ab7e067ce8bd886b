"""Files that take their places together or not at all: what a stage writes becomes visible in one
step, whatever it is killed in.

Each file is written beside the products, under ``.staged`` in the folder where it belongs, and
flushed. One journal, ``processed/<campaign>/.commit.json``, then lists what is to be renamed and
what removed: writing it, by a rename, is the commit. Before it the old products stand and what is
staged is thrown away; from it on the new ones stand, and whoever opens the campaign next carries
out what is left of the list, which may be done any number of times.
"""

from __future__ import annotations

import contextlib
import hashlib
import shutil
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Self

from nearlift.errors import ProductError
from nearlift.run import store

JOURNAL = ".commit.json"
STAGED = ".staged"
SCHEMA = "nearlift.commit/1"
#: Folder of what an interrupted stage can go on from.
UNFINISHED = "unfinished"


@dataclass(frozen=True, slots=True, kw_only=True)
class Homes:
    """The two folders of one campaign's files, which may lie on different disks; a file is called
    ``processed/...`` or ``reports/...``.
    """

    processed: Path
    reports: Path

    @classmethod
    def within(cls, out: Path, campaign: str) -> Self:
        """Those of a campaign, by its name, under `out`."""
        return cls(processed=out / "processed" / campaign, reports=out / "reports" / campaign)

    @property
    def journal(self) -> Path:
        """Where the journal of a commit stands."""
        return self.processed / JOURNAL

    @property
    def unfinished(self) -> Path:
        """Where stages keep what an interrupted run can go on from; the next commit takes
        it away.
        """
        return self.processed / UNFINISHED

    def home(self, name: str) -> tuple[Path, PurePosixPath]:
        """The folder to which a name belongs, and its path there.

        Raises
        ------
        ProductError
            The name leads elsewhere: a journal is a file like others, and may be damaged.
        """
        kind, *rest = PurePosixPath(name).parts or ("",)
        folder = {"processed": self.processed, "reports": self.reports}.get(kind)
        if folder is None or not rest or ".." in rest or "\0" in name:
            raise ProductError(
                str(self.journal), f"names {name!r}, which is no product", "delete it and run again"
            )
        return folder, PurePosixPath(*rest)

    def place(self, name: str) -> Path:
        """Where a file stands when it is committed."""
        folder, rest = self.home(name)
        return folder / rest

    def staged(self, name: str) -> Path:
        """Where it stands before."""
        folder, rest = self.home(name)
        return folder / STAGED / rest

    def settle(self) -> None:
        """Carry out the commit whose journal is found; without one, throw away what is staged. Only
        for who holds the lock.
        """
        if self.journal.is_file():
            self._carry_out()
        for home in (self.processed, self.reports):
            shutil.rmtree(home / STAGED, ignore_errors=True)
        # folders made for what did not come, if nothing else is in them
        for folder in (*self.unfinished.glob("*"), self.unfinished, self.processed, self.reports):
            with contextlib.suppress(OSError):
                folder.rmdir()

    def _carry_out(self) -> None:
        journal = store.read_json(self.journal)
        if journal.get("schema") != SCHEMA:
            raise ProductError(
                str(self.journal),
                f"has schema {journal.get('schema', 'none')}, not {SCHEMA}",
                "delete it and run again",
            )
        lists: list[Any] = [journal.get("put"), journal.get("remove")]
        if not all(
            isinstance(names, list) and all(isinstance(name, str) for name in names)
            for names in lists
        ):
            raise ProductError(
                str(self.journal),
                "does not list what is to be put and removed",
                "delete it and run again",
            )
        put, remove = ([(self.staged(name), self.place(name)) for name in names] for names in lists)
        for staged, place in put:
            # what is no longer staged has its place already
            if staged.is_file():
                place.parent.mkdir(parents=True, exist_ok=True)
                store.disk.rename(staged, place)
        for _, place in remove:
            store.disk.unlink(place)
        self.sync(place for _, place in put + remove)
        # while the journal stands, so that whoever completes a commit does this too
        shutil.rmtree(self.unfinished, ignore_errors=True)
        store.disk.unlink(self.journal)
        # a journal that came back after a power cut would be carried out on what the next stage has
        # staged
        store.sync_folder(self.processed)

    def sync(self, files: Iterable[Path]) -> None:
        """Flush the entries of these files in their folders, and of those folders, as far up as
        this campaign's own may have been made.
        """
        roots = {self.processed.parent.parent, self.reports.parent.parent}
        folders: set[Path] = set()
        for file in files:
            for folder in file.parents:
                folders.add(folder)
                if folder in roots:
                    break
        for folder in sorted(folders, key=lambda f: (-len(f.parts), f)):
            if folder.is_dir():
                store.sync_folder(folder)


@dataclass(kw_only=True)
class Transaction:
    """What one stage writes and removes. Leaving its ``with`` block without `commit` leaves
    everything as it was.

    Attributes
    ----------
    homes : Homes
    written : dict of str to str
        SHA-256 of every file written, by name such as ``reports/fig2.pdf``.
    removed : set of str
        Files that are to go.
    """

    homes: Homes
    written: dict[str, str] = field(default_factory=dict)
    removed: set[str] = field(default_factory=set)

    def write(self, name: str, content: bytes) -> None:
        """Stage a file."""
        path = self.homes.staged(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with store.naming(self.homes.place(name)), path.open("wb") as file:
            store.disk.write(file, content)
            store.disk.sync(file.fileno())
        self.written[name] = hashlib.sha256(content).hexdigest()
        self.removed.discard(name)

    def remove(self, name: str) -> None:
        """Let a file of an earlier run go, if there is one."""
        if self.homes.place(name).is_file():
            self.removed.add(name)

    def at(self, name: str) -> Path:
        """Where a file is read from: staged by this transaction, or in its place."""
        return self.homes.staged(name) if name in self.written else self.homes.place(name)

    def commit(self) -> None:
        """Put everything in its place."""
        self.homes.sync(self.homes.staged(name) for name in self.written)
        store.write_json(
            self.homes.journal,
            {"schema": SCHEMA, "put": sorted(self.written), "remove": sorted(self.removed)},
        )
        self.homes.settle()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            # an interrupt amid the renames, or one that failed: what is committed is tried once
            # more, and else is left to the next command
            with contextlib.suppress(OSError):
                self.homes.settle()
