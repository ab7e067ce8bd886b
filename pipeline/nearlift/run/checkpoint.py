"""Blocks of a chain kept until its stage is committed, so that a killed run goes on where
it was.
"""

from __future__ import annotations

import dataclasses
import io
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.fit.ensemble import Block
from nearlift.run import store

FIELDS = tuple(f.name for f in dataclasses.fields(Block))


@dataclass(kw_only=True)
class Checkpoint:
    """The kept blocks of one chain: files ``<name>-00000.npz``, ... in `folder`, each written whole
    or not at all.

    `key` identifies everything that decides the chain; blocks of another key, and what follows a
    damaged block, are no blocks.
    """

    folder: Path
    name: str
    key: str
    count: int = 0

    def read(self) -> list[Block]:
        """The blocks that an interrupted run has left, in order."""
        blocks: list[Block] = []
        while (block := self._read(len(blocks))) is not None:
            blocks.append(block)
        self.count = len(blocks)
        return blocks

    def _path(self, i: int) -> Path:
        return self.folder / f"{self.name}-{i:05d}.npz"

    def _read(self, i: int) -> Block | None:
        try:
            with np.load(io.BytesIO(self._path(i).read_bytes()), allow_pickle=False) as file:
                content: dict[str, Any] = {name: file[name] for name in (*FIELDS, "key")}
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None
        if str(content.pop("key")) != self.key:
            return None
        return Block(**{**content, "cached": float(content["cached"])})

    def keep(self, block: Block) -> None:
        """Write the next block."""
        sink = io.BytesIO()
        content: dict[str, Any] = {name: np.asarray(getattr(block, name)) for name in FIELDS}
        np.savez(sink, key=np.array(self.key), **content)
        store.write_bytes(self._path(self.count), sink.getvalue())
        self.count += 1
