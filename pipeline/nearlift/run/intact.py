"""Whether raw files are still what was digested: bits that flipped since, and files that somebody
is writing.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass

from nearlift.errors import InputRefused
from nearlift.run import store
from nearlift.run.job import Job

#: A cut file younger than this may be one that an instrument is still writing, ns.
WRITING_NS = 10_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Moving:
    """Files that changed since they were digested, and those so young that they may."""

    changed: tuple[str, ...] = ()
    young: tuple[str, ...] = ()


def not_rotten(job: Job) -> None:
    """Hash anew what is to be read and whose digest was only remembered.

    Raises
    ------
    InputRefused
        A file is another than was ingested, though its size and times are as before.
    """
    remembered = [name for name, known in job.stamps.items() if known["remembered"]]
    for name, sha in zip(
        remembered, store.sha256_of([job.root / name for name in remembered]), strict=True
    ):
        if sha != job.stamps[name]["sha256"]:
            raise InputRefused(
                str(job.root / name),
                "is not what was ingested before, though its size and its time stamp are as they"
                " were: bits have flipped on the disk",
                "restore it from a copy; if it was changed on purpose, `touch` it",
            )


def moving(job: Job) -> Moving:
    """What changed while it was read, and what was written a moment ago."""
    changed, young = [], []
    now, folder = time.time_ns(), job.root.as_posix()
    for name, known in job.stamps.items():
        try:
            status = os.stat(f"{folder}/{name}")  # noqa: PTH116 - as in `inputs`
        except OSError:
            changed.append(name)
            continue
        if [status.st_size, status.st_mtime_ns, status.st_ino] != known["stamp"]:
            changed.append(name)
        elif abs(now - status.st_mtime_ns) < WRITING_NS:
            young.append(name)
    return Moving(changed=tuple(changed), young=tuple(young))
