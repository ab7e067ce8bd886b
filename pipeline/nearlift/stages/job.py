"""What a stage is given and what it answers."""

from __future__ import annotations

import concurrent.futures
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nearlift import store
from nearlift.campaign import Campaign
from nearlift.products import Product

#: What the name of an input begins with that stands for all velocity grids of one case.
PIV_INPUT = "[piv] "


def silent(_: str) -> None:
    """Say nothing."""


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
    stamps : mapping of str to dict
        Size, time and inode with which each of them was seen, and whether its digest is remembered or fresh (`inputs.digests`).
    seed : int
    executor : Executor
    say : callable
        Takes a short progress text, such as ``"ingest 120 of 3600 trials"``.
    published : dict of str to Path
        What the present stage has put under `reports`, by name there.
    """

    root: Path
    campaign: Campaign
    processed: Path
    reports: Path
    executor: concurrent.futures.Executor
    inputs: Mapping[str, str] = field(default_factory=dict)
    stamps: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    say: Callable[[str], None] = silent
    published: dict[str, Path] = field(default_factory=dict)

    def unfinished(self, stage: str) -> Path:
        """Where a stage may keep what an interrupted run can go on from; removed once the stage is committed."""
        return self.processed / "unfinished" / stage

    def read(self, product: Product) -> store.Table:
        """A table product of this campaign."""
        return store.read_table(self.processed / product.file, product)

    def write(self, product: Product, table: Mapping[str, Any]) -> None:
        """Write a table product of this campaign."""
        store.write_table(self.processed / product.file, table, product)

    def publish(self, name: str, content: bytes) -> Path:
        """Write a file under `reports`, and note that this stage made it."""
        path = self.reports / name
        store.write_bytes(path, content)
        self.published[name] = path
        return path

    def read_json(self, product: Product) -> dict[str, Any]:
        """A JSON product of this campaign."""
        return store.read_json(self.processed / product.file)

    def write_json(self, product: Product, content: Mapping[str, Any]) -> None:
        """Write a JSON product of this campaign."""
        store.write_json(self.processed / product.file, content)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What a stage has to say when it is done: trials it rejected with the reason, and notes for the user."""

    rejected: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
