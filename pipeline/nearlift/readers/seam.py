"""Where outside formats meet nearlift: a reader is a frozen value that turns files into records.

A reader first *plans* (which trials stand in which files, and in which rows of them) without
reading samples, then reads one `Piece` of the plan at a time. Pieces are small values that can be
sent to another process, and no two of them share state: `stages.ingest` maps them over an executor.
A new format is one file with one `Reader` in it.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import glob
import os
import re
import stat
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nearlift.errors import InputRefused, ManifestError

if TYPE_CHECKING:
    from nearlift.manifest.campaign import Campaign, ForceChannel
    from nearlift.readers.per_file import Format
    from nearlift.readers.row import Conditions, Row

FloatArray = NDArray[np.float64]
#: What stands for a trial's id in ``[records] files``.
MARK = "{trial}"
_NOT_IN_NAMES = re.compile(r"[/\\\0]")


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """The load-cell series of one trial.

    Attributes
    ----------
    trial : str
        Id, as in the schedule.
    force_N : (n,) float array
        Lift in N, up positive: sign and calibration applied, tare *not* removed. NaN where the file
        holds no number.
    time_s : (n,) float array or None
        The clock column, where the manifest names one.
    source : str
        File, relative to the campaign's folder.
    codes : tuple of str
        What the reader noticed (names in `reduction.quality.CODES`).
    notes : tuple of str
        Remarks for the user, without the file's name: alike ones of many records are told once.
    fault : str
        What is wrong with a MALFORMED record, in words.
    sha256 : callable or None
        Digest of the whole file, from bytes that the reader still holds; None where it holds none.
    """

    trial: str
    force_N: FloatArray
    source: str
    time_s: FloatArray | None = None
    codes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    fault: str = ""
    sha256: Callable[[], str] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """What one task reads: some trials, their files, and (where a file holds many trials) their
    rows.

    `paths` has one entry per trial, or a single one for all; `rows` one (first, end) pair per
    trial, or none. `bytes` is what the task will read, so that a reader may choose its means.
    """

    trials: tuple[str, ...]
    paths: tuple[Path, ...]
    rows: tuple[tuple[int, int], ...] = ()
    bytes: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The pieces of a campaign, and what the user should know about the files. Trials in no piece
    have no record.
    """

    pieces: tuple[Piece, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Reader:
    """One outside format.

    Attributes
    ----------
    name, title : str
        What ``[records] reader`` says, and one line for the catalogue.
    files : callable
        ``files(campaign, root, trials)``: every record file there is, checked to be a regular file
        under `root`. Staleness is judged by these.
    plan : callable
        ``plan(campaign, root, trials)``: the `Plan`; reads no samples.
    read_piece : callable
        ``read_piece(campaign, root, piece)``: the piece's records in the plan's order, one in
        memory at a time.
    reduce_piece : callable or None
        ``reduce_piece(campaign, root, piece, conditions, tare_after_N)``: the same records' rows,
        where another process reads the samples and reduces them as well. Zero readings after a
        trial, N, by trial.
    series : bool
        False for a format without samples (`means`), which takes its lift from the schedule.
    format : Format or None
        Of a reader that was made by `per_file.reader_of`: how one file becomes channels, which
        `inspect` shows.
    """

    name: str
    title: str
    files: Callable[[Campaign, Path, Sequence[str]], list[Path]]
    plan: Callable[[Campaign, Path, Sequence[str]], Plan]
    read_piece: Callable[[Campaign, Path, Piece], Iterator[Record]]
    reduce_piece: (
        Callable[[Campaign, Path, Piece, Conditions, Mapping[str, float]], Iterator[Row]] | None
    ) = None
    series: bool = True
    format: Format | None = None

    def read(self, campaign: Campaign, root: Path, trials: Sequence[str]) -> Iterator[Record]:
        """Every record of these trials, streamed, in the plan's order."""
        for piece in self.plan(campaign, root, trials).pieces:
            yield from self.read_piece(campaign, root, piece)


def inside(root: Path, relative: str, key: str) -> Path:
    """The path of a file that a manifest names, checked to stay in the campaign's folder.

    Raises
    ------
    InputRefused
        It leads outside `root` (by ``..`` or by a symbolic link), or is there but is no regular
        file.
    """
    return _checked(root, relative, key)[0]


def _checked(root: Path, relative: str, key: str) -> tuple[Path, int | None]:
    """The path that `inside` gives, and the file's size: None where there is no file."""
    path = root / relative
    try:
        # the folder's own links are followed once for all its files; a file is followed only if it
        # is a link itself
        status = path.lstat()
        if stat.S_ISREG(status.st_mode) and _holds(root.absolute(), path.parent.absolute()):
            return path, status.st_size
        resolved = path.resolve()
        status = resolved.stat()
    except (FileNotFoundError, NotADirectoryError):
        resolved, status = path.resolve(), None
    except (
        OSError,
        RuntimeError,
    ) as fault:  # Python before 3.13 raises RuntimeError on a loop of links
        what = (
            "is a loop of symbolic links"
            if isinstance(fault, RuntimeError) or fault.errno == errno.ELOOP
            else f"cannot be read: {fault.strerror}"
        )
        raise InputRefused(
            f"{key} = {relative!r}", what, "put a readable file into the campaign's folder"
        ) from None
    if (
        not resolved.is_relative_to(_resolved(root.absolute()))
        or ".." in path.parts[len(root.parts) :]
    ):
        raise InputRefused(
            f"{key} = {relative!r}",
            f"leads outside the campaign's folder, to {resolved}",
            "put the file itself into the folder",
        )
    if status is not None and not stat.S_ISREG(status.st_mode):
        raise InputRefused(
            str(path),
            "is not a regular file",
            "a record is a plain file, no folder, pipe or device",
        )
    return path, None if status is None else status.st_size


@functools.lru_cache(maxsize=256)
def _resolved(folder: Path) -> Path:
    return folder.resolve()


@functools.lru_cache(maxsize=256)
def _holds(root: Path, folder: Path) -> bool:
    """Whether a folder is in `root`, links followed, and gets there straight."""
    return (
        _resolved(folder).is_relative_to(_resolved(root))
        and ".." not in folder.parts[len(root.parts) :]
    )


def files_pattern(campaign: Campaign) -> str:
    """``[records] files``; the manifest's own check has made sure that it is there."""
    if campaign.records.files is None:
        raise ManifestError(
            "records.files",
            "is missing",
            'name the file, or a pattern such as "trials/{trial}.csv"',
        )
    return campaign.records.files


def force_channel(campaign: Campaign) -> ForceChannel:
    """``[records] force``; the manifest's own check has made sure that it is there."""
    if campaign.records.force is None:
        raise ManifestError(
            "records.force", "is missing", 'such as { column = "force", unit = "mN", sign = 1 }'
        )
    return campaign.records.force


def per_trial(campaign: Campaign, root: Path, trials: Sequence[str]) -> dict[str, tuple[Path, int]]:
    """File and size in bytes of each trial that has one, where the manifest's pattern gives one
    file to every trial.

    Raises
    ------
    ManifestError
        The pattern has no ``{trial}``, or a trial's id cannot stand in a file name.
    InputRefused
        A file leads outside the folder or is not a regular file.
    """
    pattern = files_pattern(campaign)
    if MARK not in pattern:
        raise ManifestError(
            "records.files",
            f"{pattern!r} does not say where the trial's id stands",
            'write {trial} in it, as in "trials/{trial}.csv"',
        )
    found: dict[str, tuple[Path, int]] = {}
    folder = root.as_posix()
    # one folder for all records is looked at once
    common = (root / pattern).parent
    plain = MARK not in str(common) and os.path.isdir(common) and _holds(root, common)  # noqa: PTH112 - False whatever is wrong with it
    for trial in trials:
        if _NOT_IN_NAMES.search(trial) or trial in (".", ".."):
            raise ManifestError(
                f"trial {trial!r}",
                "has an id that cannot stand in a file name",
                "use letters, digits, '-', '_' and '.'",
            )
        name = pattern.replace(MARK, trial)
        if plain:
            with contextlib.suppress(OSError):
                # by text: paths made one by one take longer than the system
                status = os.lstat(f"{folder}/{name}")
                if stat.S_ISREG(status.st_mode):
                    found[trial] = root / name, status.st_size
                    continue
        path, size = _checked(root, name, "records.files")
        if size is not None:
            found[trial] = path, size
    return found


def unlisted(campaign: Campaign, root: Path, trials: Collection[str]) -> tuple[str, ...]:
    """A note where files stand among the records that no trial of the schedule names: its row may
    be lost, or its id mistyped.
    """
    pattern = files_pattern(campaign)
    head, tail, times = pattern.partition(MARK)[0], pattern.rpartition(MARK)[2], pattern.count(MARK)
    listed, names = set(trials), []
    folder, slash, _ = pattern.rpartition("/")
    if MARK in folder:
        there = [
            source_of(root, path) for path in root.glob(glob.escape(pattern).replace(MARK, "*"))
        ]
    else:
        # one folder is listed in a tenth of the time that a search takes
        there = (
            [f"{folder}{slash}{name}" for name in os.listdir(root / folder)]  # noqa: PTH208
            if (root / folder).is_dir()
            else []
        )
    for name in there:
        length = (len(name) - len(pattern) + times * len(MARK)) // times
        trial = name[len(head) : len(head) + length]
        if (
            name.endswith(tail)
            and pattern.replace(MARK, trial) == name
            and trial not in listed
            and (root / name).is_file()
        ):
            names.append(name)
    if not names:
        return ()
    more = f" and {len(names) - 1} more are" if len(names) > 1 else " is"
    return (
        (
            f"{min(names)}{more} no trial's record: the schedule has no such row, so left out; a"
            " row lost, or an id mistyped?"
        ),
    )


def source_of(root: Path, path: Path) -> str:
    """A file's name relative to the campaign's folder, with forward slashes."""
    # pathlib's own ways take several times as long
    folder, name = f"{root}{os.sep}", str(path)
    inside = name[len(folder) :] if name.startswith(folder) else str(path.relative_to(root))
    return inside if os.sep == "/" else inside.replace(os.sep, "/")
