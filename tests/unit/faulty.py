"""A disk that fails, or a process that dies, at the n-th call that reaches it."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from nearlift import store
from nearlift.stages import graph

from . import small_run

#: Everything but figures, whose drawing takes long and whose writing is the same.
QUICK = ("ingest", "reduce", "fit", "ledger")


class Faulty(store.Disk):
    """Raises at the `at`-th call; with `kill`, ends the process there as a power cut would. `torn` writes half before it fails."""

    def __init__(self, at: int, *, kill: bool = False, torn: bool = True) -> None:
        self.at, self.kill, self.torn, self.calls = at, kill, torn, 0

    def _due(self) -> bool:
        self.calls += 1
        return self.calls == self.at

    def _end(self) -> None:
        if self.kill:
            os.kill(os.getpid(), signal.SIGKILL)
        raise OSError(28, "No space left on device")

    def write(self, file: IO[bytes], content: bytes) -> None:
        if self._due():
            if self.torn:
                file.write(content[: len(content) // 2])
                file.flush()
            self._end()
        super().write(file, content)

    def sync(self, descriptor: int) -> None:
        if self._due():
            self._end()
        super().sync(descriptor)

    def rename(self, old: Path, new: Path) -> None:
        if self._due():
            self._end()
        super().rename(old, new)


def products(place: Path) -> dict[str, str]:
    """Digest of every finished file of a run, provenance and lock aside: those hold times and names."""
    found = {}
    for folder in ("processed", "reports"):
        for path in sorted((place / folder).rglob("*")):
            if path.is_file() and path.name not in ("provenance.json", ".lock") and not path.name.endswith(".tmp"):
                found[path.relative_to(place).as_posix()] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def run(raw: Path, place: Path, stages: Sequence[str] = QUICK) -> list[str]:
    """Bring the stages up to date; the names of those that ran."""
    return [s.stage.name for s in graph.run(small_run.job(raw, place), [graph.stage(name) for name in stages]) if s.why]


class Scene:
    """Old products, new input, and what the new products must be."""

    def __init__(self, folder: Path, stages: Sequence[str] = QUICK) -> None:
        self.folder, self.stages = folder, stages
        self.raw = small_run.write_means(folder / "raw", 24)
        run(self.raw, folder / "old", stages)
        self.old = products(folder / "old")
        text = (self.raw / "trials.csv").read_text()
        (self.raw / "trials.csv").write_text(text.replace("m3,ground,30,92,", "m3,ground,30,92,1"))
        counting = Faulty(0)
        store.disk, real = counting, store.disk
        try:
            run(self.raw, folder / "new", stages)
        finally:
            store.disk = real
        self.calls = counting.calls
        self.new = products(folder / "new")
        assert self.old != self.new

    def fresh(self) -> Path:
        """The old products in a place of their own."""
        place = self.folder / "place"
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(self.folder / "old", place)
        return place

    def check(self, place: Path) -> None:
        """Every file is whole, old or new; a rerun ends in the bytes of an undisturbed run and leaves no litter."""
        for name, digest in products(place).items():
            assert digest in (self.old.get(name), self.new.get(name)), f"{name} is neither old nor new"
        run(self.raw, place, self.stages)
        assert products(place) == self.new
        assert not [p for p in place.rglob("*") if p.name.endswith((".tmp", ".lock"))]
        assert run(self.raw, place, self.stages) == []


if __name__ == "__main__":
    store.disk = Faulty(int(sys.argv[3]), kill=True)
    run(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[4].split(","))
