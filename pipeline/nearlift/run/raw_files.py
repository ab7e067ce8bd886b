"""Digests of raw files, kept from run to run by their size and time of last change."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent import futures
from dataclasses import dataclass, field
from pathlib import Path

from nearlift.run import tables

#: A file younger than this may change again within the resolution of its time stamp.
YOUNG_NS = 2_000_000_000
#: Raw files of a stage, by the name under which provenance.json lists them.
Inputs = Mapping[str, Sequence[str]]


@dataclass(kw_only=True)
class RawFiles:
    """Raw files of a campaign; one whose size and time are as in `cache` is not hashed again."""

    root: Path
    cache: Path
    stamps: dict[str, tuple[int, int]] = field(default_factory=dict)
    digests: dict[str, str] = field(default_factory=dict)
    looked_ns: int = 0

    def hashed(self, listed: Inputs) -> dict[str, str]:
        """Digests of the listed files by name."""
        self._look(dict.fromkeys(file for files in listed.values() for file in files))
        return {
            name: self.digests[name]
            if (*files,) == (name,)
            else list_digest({file: self.digests[file] for file in files})
            for name, files in listed.items()
        }

    def _look(self, files: Iterable[str]) -> None:
        folder, known, self.looked_ns = self.root.as_posix(), self._known(), time.time_ns()
        unknown = []
        for file in files:
            status = os.stat(f"{folder}/{file}")  # noqa: PTH116 - paths made one by one take longer
            stamp = self.stamps[file] = status.st_size, status.st_mtime_ns
            before = known.get(file)
            if before and before[:2] == stamp:
                self.digests[file] = before[2]
            else:
                unknown.append(file)
        paths = [f"{folder}/{file}" for file in unknown]
        self.digests |= zip(unknown, digests_of(paths), strict=True)

    def _known(self) -> dict[str, tuple[int, int, str]]:
        try:
            return {
                file: (int(size), int(changed_ns), str(sha))
                for file, (size, changed_ns, sha) in tables.read_json_if_whole(self.cache).items()
            }
        except (TypeError, ValueError):
            return {}

    def remember(self) -> None:
        """Keep the digests with the products, if there are any, unless the cache has them."""
        settled = {
            file: (*self.stamps[file], sha)
            for file, sha in self.digests.items()
            if self.looked_ns - self.stamps[file][1] >= YOUNG_NS
        }
        if self.cache.parent.is_dir() and settled != self._known():
            tables.write_whole(self.cache, json.dumps(settled).encode())


def digests_of(paths: Sequence[str | Path]) -> list[str]:
    """SHA-256 of each file, many of them by threads: hashing leaves the interpreter free."""
    if len(paths) < 8:
        return [tables.sha256(path) for path in paths]
    portions = [paths[i : i + 16] for i in range(0, len(paths), 16)]
    with futures.ThreadPoolExecutor(min(os.cpu_count() or 1, 4)) as pool:
        each = pool.map(lambda portion: [tables.sha256(path) for path in portion], portions)
        return [sha for digests in each for sha in digests]


def list_digest(digests: Mapping[str, str]) -> str:
    """SHA-256 of a list of files: their names, each with its own."""
    text = "".join(f"{name} {sha}\n" for name, sha in digests.items())
    return tables.digest_of(text.encode())
