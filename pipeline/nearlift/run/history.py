"""The runs of a campaign that are kept: what each was asked, its manifest, and what it found,
results.json.

Each is a folder ``processed/<campaign>/history/<time>-<digest>``, made under another name and
renamed, so that it is there whole or not at all. The digest is that of both files: one that was
damaged since is known by it, and counts for nothing. What `undo` puts aside before it was run is a
manifest alone.
"""

from __future__ import annotations

import contextlib
import datetime
import hashlib
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from nearlift.errors import ManifestError, ProductError, UsageError
from nearlift.manifest import toml
from nearlift.manifest.campaign import leaves
from nearlift.results.quotation import Results
from nearlift.run import store
from nearlift.run.declarations.fit import RESULTS
from nearlift.run.job import Job
from nearlift.run.lock import Busy, locked, settled
from nearlift.run.transaction import Homes

FOLDER, MANIFEST = "history", "campaign.toml"
#: Runs that are kept; older ones go.
MOST = 20
#: Time in UTC, and the first letters of the digest.
_NAME = re.compile(r"(\d{8}T\d{6}\.\d{3})Z-([0-9a-f]{12})")
_TIME = "%Y%m%dT%H%M%S.%f"


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """One run; `results` are the bytes of results.json, none where the manifest was only put
    aside.
    """

    folder: Path
    time: datetime.datetime
    digest: str
    manifest: bytes
    results: bytes

    @property
    def headlines(self) -> tuple[str, ...]:
        """Each boundary's headline and verdict, as quoted then."""
        if not self.results:
            return ("put aside by undo, not run",)
        try:
            results = store.load(self.folder / RESULTS.file, Results)
        except ProductError as fault:
            return (f"{RESULTS.file} {fault.what}",)
        return tuple(
            f"{boundary} {', '.join(filter(None, (result.headline_text, result.claim)))}"
            for boundary, result in results.boundaries.items()
        )


def read(folder: Path) -> Kept | None:
    """The run in that folder; None where it is not what was kept."""
    match = _NAME.fullmatch(folder.name)
    if match is None:
        return None
    try:
        time = datetime.datetime.strptime(match[1], _TIME).replace(tzinfo=datetime.UTC)
        manifest = (folder / MANIFEST).read_bytes()
        file = folder / RESULTS.file
        results = file.read_bytes() if file.is_file() else b""
    except (OSError, ValueError):
        return None
    if _digest(manifest, results) != match[2]:
        return None
    return Kept(folder=folder, time=time, digest=match[2], manifest=manifest, results=results)


def folders(homes: Homes) -> list[Path]:
    """Those of the kept runs, damaged ones among them, the newest first."""
    named = (homes.processed / FOLDER).glob("*-*")
    return sorted((folder for folder in named if _NAME.fullmatch(folder.name)), reverse=True)


def runs(homes: Homes) -> Iterator[Kept]:
    """The whole ones, the newest first, each read when it is its turn."""
    return (run for run in map(read, folders(homes)) if run is not None)


def manifest_of(job: Job) -> bytes | None:
    """The manifest that the job was opened with; None where it has changed since."""
    try:
        content = (job.root / MANIFEST).read_bytes()
    except OSError:
        return None
    return content if hashlib.sha256(content).hexdigest() == job.inputs.get(MANIFEST) else None


def remember(job: Job, manifest: bytes | None, wrote: bool, alone: bool) -> None:
    """Keep what stands in results.json with the manifest that it was asked with, unless the run
    before found the same.

    `wrote` says that this run has written it, and not only found it up to date: then another
    manifest is a change, too. `alone` says that the lock is held. That it cannot be kept is told,
    and is no reason to fail.
    """
    file = job.processed / RESULTS.file
    if manifest is None or not file.is_file():
        return
    results = file.read_bytes()
    last = next((run for run in runs(job.homes) if run.results), None)
    if last and last.results == results and (last.manifest == manifest or not wrote):
        return
    try:
        with contextlib.nullcontext() if alone else locked(job.homes):
            now = keep(job.homes, manifest, results)
            kept = folders(job.homes)
            again = [f for f in kept if f.name.endswith(now.digest) and f != now.folder]
            for old in (*again, *kept[MOST + len(again) :]):
                shutil.rmtree(old, ignore_errors=True)
    except (OSError, Busy) as fault:
        if wrote:
            job.announce(f"  note: this run is not in the history: {fault}")


def keep(homes: Homes, manifest: bytes, results: bytes = b"") -> Kept:
    """Keep a run, or a manifest alone; for who holds the lock."""
    home = homes.processed / FOLDER
    for left in home.glob(".*"):
        shutil.rmtree(left, ignore_errors=True)
    time = datetime.datetime.now(datetime.UTC)
    if last := next(runs(homes), None):
        # a clock that was set back does not change the order
        time = max(time, last.time + datetime.timedelta(milliseconds=1))
    digest = _digest(manifest, results)
    folder = home / f"{time:%Y%m%dT%H%M%S}.{time.microsecond // 1000:03d}Z-{digest}"
    unfinished = home / f".{folder.name}"
    store.write_bytes(unfinished / MANIFEST, manifest)
    if results:
        store.write_bytes(unfinished / RESULTS.file, results)
    store.disk.rename(unfinished, folder)
    store.sync_folder(home)
    return Kept(folder=folder, time=time, digest=digest, manifest=manifest, results=results)


def _digest(manifest: bytes, results: bytes) -> str:
    both = b"".join(hashlib.sha256(part).digest() for part in (manifest, results))
    return hashlib.sha256(both).hexdigest()[:12]


#: A value of the manifest by its key, before and after; None where there is none.
Change = tuple[str, str | None, str | None]


def changes(old: bytes, new: bytes) -> tuple[Change, ...]:
    """What two manifests say differently, by key; comments and order do not count. Lines, where one
    of them is no TOML.
    """
    try:
        one, two = (
            {key: repr(value) for key, value in leaves(toml.loads(part, MANIFEST))}
            for part in (old, new)
        )
    except ManifestError:
        one, two = (
            {f"line {i}": line for i, line in enumerate(part.decode(errors="replace").splitlines())}
            for part in (old, new)
        )
    return tuple(
        (key, one.get(key), two.get(key))
        for key in dict.fromkeys([*one, *two])
        if one.get(key) != two.get(key)
    )


def lines(differing: tuple[Change, ...]) -> list[str]:
    """The same in words, a line each."""
    return [f"  {key}: {old or 'absent'} -> {new or 'absent'}" for key, old, new in differing]


@dataclass(frozen=True, slots=True, kw_only=True)
class Undone:
    """What `undo` did: the run whose manifest is back, the one that was kept of what stood there
    before (None: it was kept already), and what differs.
    """

    restored: Kept
    put_aside: Kept | None
    changes: tuple[Change, ...]


def undo(root: Path, out: Path, wanted: str = "") -> Undone:
    """Put back the manifest of the run whose digest begins with `wanted`: without one, of the last
    run that had another manifest than the present one. What stands there now is kept first.

    Raises
    ------
    UsageError
        There is no such run.
    Busy
        A run is at work.
    """
    path = root / MANIFEST
    homes = Homes.within(out, name_of(path))
    settled(homes)
    if not homes.processed.is_dir():
        raise _nothing(root)
    with locked(homes):
        present = path.read_bytes()
        kept = list(runs(homes))
        restored = _chosen(root, kept, present, wanted)
        aside = None if any(run.manifest == present for run in kept) else keep(homes, present)
        mode = path.stat().st_mode
        # a link goes on leading where it led
        store.write_bytes(path.resolve(), restored.manifest)
        path.chmod(mode)
    return Undone(restored=restored, put_aside=aside, changes=changes(present, restored.manifest))


def _nothing(root: Path) -> UsageError:
    return UsageError(
        str(root),
        "no run with another manifest is kept",
        "every run that finds something new is kept from now on; `nearlift history` lists them",
    )


def _chosen(root: Path, kept: list[Kept], present: bytes, wanted: str) -> Kept:
    if not wanted:
        other = next((run for run in kept if run.manifest != present), None)
        if other is None:
            raise _nothing(root)
        return other
    named = [run for run in kept if run.digest.startswith(wanted)]
    if not named or len({run.digest for run in named}) > 1:
        raise UsageError(
            "--to",
            f"{wanted!r} begins the digest of {len(named) or 'no whole'} run{'s' * bool(named)}",
            f"there are {', '.join(run.digest for run in kept) or 'none'}",
        )
    return named[0]


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
