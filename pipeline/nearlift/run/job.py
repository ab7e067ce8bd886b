"""What a stage is given and what it answers."""

from __future__ import annotations

import concurrent.futures
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol, TypedDict

from nearlift.campaign.manifest import Campaign
from nearlift.run import store
from nearlift.run.schema import Product
from nearlift.run.transaction import Homes, Transaction

#: What the name of an input begins with that stands for all velocity grids of one case.
PIV_INPUT = "[piv] "


class Say(Protocol):
    """Hears what is being done, as ``"ingest 120 of 3600 trials"``, and which share of all that its
    first word stands for is done, where that is known.
    """

    def __call__(self, text: str, share: float | None = None, /) -> None:
        """Take the text."""


def silent(text: str, share: float | None = None, /) -> None:
    """Say nothing."""


def part(say: Say, i: int, count: int) -> Say:
    """What hears the `i`-th, from 0, of so many like parts of an activity."""

    def say_part(text: str, share: float | None = None, /) -> None:
        say(text, (i + (share or 0.0)) / count)

    return say_part


class FileStamp(TypedDict):
    """A raw file's size, modification time and inode, and its digest; whether that was `remembered`
    rather than made, and whether the file was so young (`racy`) that it must not be.
    """

    stamp: list[int]
    sha256: str
    remembered: bool
    racy: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One campaign being worked on.

    Attributes
    ----------
    root : Path
        The campaign's folder, never written.
    campaign : Campaign
    processed, reports : Path
        Where this campaign's products and figures go.
    inputs : mapping of str to str
        Every input file under `root`, relative path to SHA-256.
    stamps : mapping of str to FileStamp
        Size, time and inode with which each of them was seen, and whether its digest is remembered
        or fresh (`inputs.digests`).
    seed : int
    executor : Executor
    say : Say
        Takes how far the stage is.
    announce : callable
        Takes a line that is to be read, and not only while it is so.
    overrides : mapping of str to value
        What the command line put in place of the manifest, by option.
    change : Transaction or None
        What the present stage writes, which nobody else sees until the stage is committed; None
        outside stages, where each file is written for itself.
    """

    root: Path
    campaign: Campaign
    processed: Path
    reports: Path
    executor: concurrent.futures.Executor
    inputs: Mapping[str, str] = field(default_factory=dict)
    stamps: Mapping[str, FileStamp] = field(default_factory=dict)
    seed: int = 0
    say: Say = silent
    announce: Callable[[str], None] = silent
    overrides: Mapping[str, object] = field(default_factory=dict)
    change: Transaction | None = None

    @property
    def homes(self) -> Homes:
        """Where this campaign's files stand."""
        return Homes(processed=self.processed, reports=self.reports)

    def put(self, name: str, content: bytes) -> Path:
        """Write a file, called ``processed/...`` or ``reports/...``; returns its place, which
        within a stage it takes at the end.
        """
        place = self.homes.place(name)
        if self.change is None:
            store.write_bytes(place, content)
        else:
            self.change.write(name, content)
        return place

    def remove(self, name: str) -> None:
        """Let a file of an earlier run go, if there is one."""
        if self.change is None:
            store.disk.unlink(self.homes.place(name))
        else:
            self.change.remove(name)

    def _at(self, file: str) -> Path:
        name = f"processed/{file}"
        return self.homes.place(name) if self.change is None else self.change.at(name)

    def overriding(self, section: str, given: Mapping[str, object]) -> Job:
        """The same job with keys of one section of the manifest put in place; None leaves a key as
        it is.
        """
        known = {k: v for k, v in given.items() if v is not None}
        if not known:
            return self
        wanted = getattr(self.campaign, section).model_copy(update=known)
        return replace(
            self, campaign=self.campaign.model_copy(update={section: wanted}), overrides=known
        )

    def unfinished(self, stage: str) -> Path:
        """Where a stage may keep what an interrupted run can go on from; removed once the stage is
        committed.
        """
        return self.homes.unfinished / stage

    def read(self, product: Product) -> store.Table:
        """A table product of this campaign."""
        return store.read_table(self._at(product.file), product)

    def write(self, product: Product, table: store.Table) -> None:
        """Write a table product of this campaign."""
        self.put(f"processed/{product.file}", store.table_bytes(table, product))

    def publish(self, name: str, content: bytes) -> Path:
        """Write a file under `reports`."""
        return self.put(f"reports/{name}", content)

    def read_json(self, product: Product) -> dict[str, Any]:
        """A JSON product of this campaign."""
        return store.read_json(self._at(product.file))

    def write_json(self, product: Product, content: object) -> None:
        """Write a JSON product of this campaign."""
        self.put(f"processed/{product.file}", store.json_bytes(content))

    def load(self, kind: type[store.Loaded]) -> store.Loaded:
        """A JSON product of this campaign as its type."""
        return store.load(self._at(kind.file), kind)

    def save(self, result: store.Saved) -> None:
        """Write a JSON product of this campaign."""
        self.put(f"processed/{result.file}", store.json_bytes(result))


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What a stage has to say when it is done: trials it rejected with the reason, and notes for
    the user.
    """

    rejected: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
