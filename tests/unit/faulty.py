"""A disk that fails, or a process that dies, at the n-th call that reaches it; and what must stand
afterwards.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, Literal

from nearlift.run import graph, store
from nearlift.run.lock import settled
from nearlift.run.transaction import JOURNAL, STAGED, UNFINISHED, Homes

from . import small_run

#: Once: as of a passing fault. Lasting: as on a full disk. Kill: as by a power cut.
Fault = Literal["once", "lasting", "kill"]
#: Stage -> its files and their digests.
Outputs = dict[str, dict[str, str]]


class Faulty(store.Disk):
    """Fails at the `at`-th call, at all from then on, or ends the process there; a write is torn in
    half first.
    """

    def __init__(self, at: int, fault: Fault = "once") -> None:
        self.at, self.fault, self.calls = at, fault, 0
        self.kinds: list[str] = []

    def _due(self, kind: str) -> bool:
        self.kinds.append(kind)
        self.calls += 1
        return self.calls == self.at or (self.fault == "lasting" and self.calls > self.at > 0)

    def _end(self) -> None:
        if self.fault == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        raise OSError(28, "No space left on device")

    def write(self, file: IO[bytes], content: bytes) -> None:
        if self._due("write"):
            file.write(content[: len(content) // 2])
            file.flush()
            self._end()
        super().write(file, content)

    def sync(self, descriptor: int) -> None:
        if self._due("sync"):
            self._end()
        super().sync(descriptor)

    def rename(self, old: Path, new: Path) -> None:
        if self._due("rename"):
            self._end()
        super().rename(old, new)

    def unlink(self, path: Path) -> None:
        if self._due("unlink"):
            self._end()
        super().unlink(path)


def calls(action: Callable[[], object]) -> list[str]:
    """What reaches the disk, call by call: ``write``, ``sync``, ``rename`` or ``unlink``."""
    counting, real = Faulty(0), store.disk
    store.disk = counting
    try:
        action()
    finally:
        store.disk = real
    return counting.kinds


def failing(action: Callable[[], object], at: int, fault: Fault) -> None:
    """Do something with a fault at the `at`-th call; a kill happens to a copy of this process."""
    if fault != "kill":
        real, store.disk = store.disk, Faulty(at, fault)
        try:
            action()
        except OSError as found:
            assert "No space left" in str(found)  # noqa: PT017
        else:
            raise AssertionError(f"call {at} did not fail")
        finally:
            store.disk = real
        return
    child = os.fork()
    if child == 0:
        store.disk = Faulty(at, "kill")
        try:
            action()
        finally:
            os._exit(1)
    assert os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGKILL, f"call {at} did not happen"


def products(place: Path) -> dict[str, str]:
    """Digest of every finished file of a run; provenance and lock aside, which hold times and
    names.
    """
    found = {}
    for folder in ("processed", "reports"):
        for path in sorted((place / folder).rglob("*")):
            hidden = (
                path.name in ("provenance.json", ".lock", JOURNAL)
                or path.name.endswith(".tmp")
                or STAGED in path.parts
            )
            if path.is_file() and not hidden:
                found[path.relative_to(place).as_posix()] = hashlib.sha256(
                    path.read_bytes()
                ).hexdigest()
    return found


def litter(place: Path) -> list[Path]:
    """What a run that has ended should have taken away."""
    return [
        p
        for p in place.rglob("*")
        if p.name in (".lock", JOURNAL, STAGED, UNFINISHED) or p.name.endswith(".tmp")
    ]


def homes(place: Path) -> Homes:
    """Those of the campaign of means."""
    return Homes.within(place, "means")


def outputs(place: Path) -> Outputs:
    """What provenance.json says that each stage has written, and no other stage writes too:
    `shared` files are their last writer's.
    """
    content = json.loads((homes(place).processed / "provenance.json").read_text())
    told = {name: entry["outputs"] for name, entry in content["stages"].items()}
    for name in shared():
        owners = [files[name] for files in told.values() if name in files]
        assert len(owners) <= 1, f"{name} belongs to its last writer"
        assert not owners or owners[0] == _digest(homes(place).place(name))
    return own(told)


def shared() -> set[str]:
    """Files that more than one stage writes."""
    written = [f"processed/{product.file}" for stage in graph.STAGES for product in stage.writes]
    return {name for name in written if written.count(name) > 1}


def own(told: Outputs) -> Outputs:
    """Each stage's files without those."""
    return {
        stage: {name: digest for name, digest in files.items() if name not in shared()}
        for stage, files in told.items()
    }


def _digest(path: Path) -> str | None:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None


def stands(place: Path, old: Outputs, new: Outputs) -> dict[str, bool]:
    """Whether each stage stands as the new run left it, or else as the old did; every one must be
    all of one, and provenance.json must agree.
    """
    told, found = outputs(place), {}
    for stage in old.keys() | new.keys():
        before, after = old.get(stage, {}), new.get(stage, {})
        names = before.keys() | after.keys()
        on_disk = {name: _digest(homes(place).place(name)) for name in names}
        versions = [{name: version.get(name) for name in names} for version in (before, after)]
        assert on_disk in versions, (
            f"{stage} is a mixture:"
            f" {[n for n in names if on_disk[n] == versions[0][n] != versions[1][n]]} are old"
        )
        assert told.get(stage, {}) in [
            version
            for version, files in zip((before, after), versions, strict=True)
            if files == on_disk
        ]
        found[stage] = on_disk == versions[1]
    return found


def run(raw: Path, place: Path, stages: Sequence[str]) -> list[str]:
    """Bring the stages up to date; the names of those that ran."""
    return [
        s.stage.name
        for s in graph.run(small_run.job(raw, place), [graph.stage(name) for name in stages])
        if s.why
    ]


def copied(folder: Path) -> Path:
    """What stands in `folder`/old, in a place of its own."""
    place = folder / "place"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(folder / "old", place)
    return place


class Scene:
    """Old products, new input, and what the new products must be."""

    def __init__(self, folder: Path, stages: Sequence[str], manifest: str = "") -> None:
        self.folder, self.stages = folder, stages
        self.raw = small_run.write_means(folder / "raw", 24)
        with (self.raw / "campaign.toml").open("a") as file:
            file.write(manifest)
        run(self.raw, folder / "old", stages)
        self.old = outputs(folder / "old")
        text = (self.raw / "trials.csv").read_text()
        (self.raw / "trials.csv").write_text(text.replace("m3,ground,30,92,", "m3,ground,30,92,1"))
        self.kinds = calls(lambda: run(self.raw, self.fresh(), stages))
        self.calls = len(self.kinds)
        self.whole, self.new = products(folder / "place"), outputs(folder / "place")
        assert self.old != self.new

    def fresh(self) -> Path:
        """The old products in a place of their own."""
        return copied(self.folder)

    def check(self, place: Path) -> None:
        """Every stage is old or new; a rerun ends in the bytes of an undisturbed run and leaves no
        litter.
        """
        settled(homes(place))
        stood = stands(place, self.old, self.new)
        # one stage after the other, where the bytes tell
        done = [stood[name] for name in self.stages if self.old[name] != self.new[name]]
        assert done == sorted(done, reverse=True)
        run(self.raw, place, self.stages)
        assert products(place) == self.whole
        assert litter(place) == []
        assert run(self.raw, place, self.stages) == []


Book = Mapping[str, Mapping[str, bytes]]


def book(version: str) -> dict[str, dict[str, bytes]]:
    """Every stage with every file that it writes, by its name, and a few bytes in it.

    The new version lacks a posterior.nc and a figure: what an earlier run left of them must go.
    """
    from nearlift.report.registry import FIGURES

    figures = [f"{spec.name}.{kind}" for spec in FIGURES for kind in ("pdf", "png", "csv")]
    tables = [
        f"tables/{name}.{kind}"
        for name in ("coefficients", "budget", "comparison")
        for kind in ("tex", "csv")
    ]
    names = {stage.name: [f"processed/{p.file}" for p in stage.writes] for stage in graph.STAGES}
    paper = ("methods.md", "methods.tex", "references.bib")
    names["report"] = [f"reports/{name}" for name in (*figures, *tables, *paper, "index.html")]
    if version == "old":
        names["fit"].append("processed/posterior.nc")
    else:
        names["report"] = [
            name for name in names["report"] if not name.startswith(f"reports/{FIGURES[-1].name}.")
        ]
    return {
        stage: {name: f"{version} {name}".encode() for name in listed}
        for stage, listed in names.items()
    }


def written(of: Book, before: Book) -> Callable[[graph.Stage, graph.Job], graph.Outcome]:
    """In the place of `Stage.run`: write what the book says, and let go what only the book `before`
    has.
    """

    def stage(self: graph.Stage, job: graph.Job) -> graph.Outcome:
        for name, content in of[self.name].items():
            job.put(name, content)
        for name in before[self.name].keys() - of[self.name].keys():
            job.remove(name)
        return graph.Outcome()

    return stage


if __name__ == "__main__":
    store.disk = Faulty(int(sys.argv[3]), "kill")
    run(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[4].split(","))
