"""One run at a time on one campaign's products, and whether the disk has room for them."""

from __future__ import annotations

import contextlib
import datetime
import json
import os
import shutil
import socket
import time
from collections.abc import Iterator
from pathlib import Path

from nearlift.errors import NearliftError
from nearlift.run import store
from nearlift.run.transaction import STAGED, Homes

LOCK = ".lock"


class Busy(NearliftError):
    """Another run works on the same products."""


class NoRoom(NearliftError):
    """The disk is too full to begin."""


@contextlib.contextmanager
def locked(homes: Homes) -> Iterator[str]:
    """Hold the lock of a campaign's products; yields what is to be told of a lock that was left
    behind, usually nothing.

    The lock is the system's own (flock), so it ends with the process that holds it, however that
    ends; the file names its owner. What a killed run had committed is put in its place; what it
    left unfinished is swept away.

    Raises
    ------
    Busy
        Another process holds it; it is named.
    """
    processed = homes.processed
    made = [folder for folder in (processed, *processed.parents) if not folder.exists()]
    processed.mkdir(parents=True, exist_ok=True)
    path = processed / LOCK
    descriptor, left = _acquired(path)
    try:
        homes.settle()
        for folder in (processed, homes.reports):
            if folder.is_dir():
                store.sweep(folder)
        yield left
    finally:
        # taken away while it is still held, so that nobody can hold a file without a name
        path.unlink(missing_ok=True)
        os.close(descriptor)
        for folder in made:
            with contextlib.suppress(OSError):
                folder.rmdir()


def swept(homes: Homes) -> None:
    """Take away what a run left that was killed after its last commit; a living run's is let be."""
    if any(
        path.exists()
        for path in (homes.processed / LOCK, homes.processed / STAGED, homes.reports / STAGED)
    ):
        with contextlib.suppress(Busy), locked(homes):
            pass


#: How long a reader waits for the renames of another run, s.
PATIENCE_S = 10.0


def settled(homes: Homes) -> None:
    """See to it that no commit is half carried out, before products are read: one that a killed run
    left is carried out now.

    Raises
    ------
    Busy
        A living run has been at it for too long.
    """
    until = time.monotonic() + PATIENCE_S
    while homes.journal.is_file():
        try:
            with locked(homes):
                return
        except Busy:
            if time.monotonic() > until:
                raise
            time.sleep(0.02)


def _acquired(path: Path) -> tuple[int, str]:
    """Descriptor of the lock file, held, and what its former owner left to say."""
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        if not _flock(descriptor):
            owner = _owner(descriptor)
            os.close(descriptor)
            raise Busy(
                str(path.parent),
                f"another run works on these products: {_named(owner)}",
                "wait until it is done, end it, or choose another --out",
            )
        try:
            same = os.fstat(descriptor).st_ino == path.stat().st_ino
        except FileNotFoundError:
            same = False
        if same:
            break
        # its owner took it away between the two calls
        os.close(descriptor)
    owner = _owner(descriptor)
    mine = {
        "pid": os.getpid(),
        "host": socket.gethostname(),
        "since": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    os.ftruncate(descriptor, 0)
    os.pwrite(descriptor, json.dumps(mine).encode(), 0)
    if not owner:
        return descriptor, ""
    killed = f"an earlier run was killed: {_named(owner)}; what it left unfinished is made again"
    return descriptor, killed


def _flock(descriptor: int) -> bool:
    """Take the lock; False where another process holds it. Where the system has no such locks,
    everybody may.
    """
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _owner(descriptor: int) -> dict[str, object]:
    try:
        owner = json.loads(os.pread(descriptor, 4096, 0) or b"{}")
    except ValueError:
        return {}
    return owner if isinstance(owner, dict) else {}


def _named(owner: dict[str, object]) -> str:
    return (
        f"process {owner.get('pid', '?')} on {owner.get('host', '?')}, since"
        f" {owner.get('since', '?')}"
        if owner
        else "its process is not known"
    )


def require_free_space(folder: Path, needed: int) -> None:
    """Raise `NoRoom` if the file system of `folder`, which need not exist, has fewer than `needed`
    bytes free.
    """
    there = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
    free = shutil.disk_usage(there).free
    if free < needed:
        raise NoRoom(
            str(folder),
            f"needs about {size(needed)}, and the disk has {size(free)} left",
            f"free {size(needed - free)}, or choose another --out",
        )


def size(count: int) -> str:
    """So many bytes, in words."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= factor:
            return f"{count / factor:.3g} {unit}"
    return f"{count} bytes"
