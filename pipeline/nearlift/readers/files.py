"""The files that a manifest names: inside the campaign's folder, regular, one for each trial."""

from __future__ import annotations

import contextlib
import errno
import functools
import glob
import os
import re
import stat
import unicodedata
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from nearlift.errors import InputRefused, ManifestError
from nearlift.readers.seam import MARK, Piece, ReadingPlan

if TYPE_CHECKING:
    from nearlift.campaign.manifest import Campaign

_NOT_IN_NAMES = re.compile(r"[/\\\0]")
#: Files of one task, so that it costs more than sending it; and bytes: whatever is reached first.
PER_PIECE, BYTES_PER_PIECE = 32, 64 << 20


def inside(root: Path, relative: str, key: str) -> Path:
    """The path of a file that a manifest names; `InputRefused` where it leads outside the
    campaign's folder (by ``..`` or by a symbolic link), or is there but is no regular file.
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
    # Python before 3.13 raises RuntimeError on a loop of links
    except (OSError, RuntimeError) as fault:
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


def per_trial(campaign: Campaign, root: Path, trials: Sequence[str]) -> dict[str, tuple[Path, int]]:
    """File and size in bytes of each trial that has one, where the manifest's pattern gives one
    file to every trial; `ManifestError` where it has no ``{trial}``, or a trial's id cannot stand
    in a file name, `InputRefused` as by `inside`.
    """
    pattern = campaign.records.pattern
    if MARK not in pattern:
        raise ManifestError(
            "records.files",
            f"{pattern!r} does not say where the trial's id stands",
            'write {trial} in it, as in "trials/{trial}.csv"',
        )
    files: dict[str, tuple[Path, int]] = {}
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
                    files[trial] = root / name, status.st_size
                    continue
        path, size = _checked(root, name, "records.files")
        if size is not None:
            files[trial] = path, size
    return files


def unlisted(campaign: Campaign, root: Path, trials: Collection[str]) -> tuple[str, ...]:
    """A note where files stand among the records that no trial of the schedule names: its row may
    be lost, or its id mistyped.
    """
    pattern = campaign.records.pattern
    head, tail, times = pattern.partition(MARK)[0], pattern.rpartition(MARK)[2], pattern.count(MARK)
    listed, names = set(trials), []
    folder, slash, _ = pattern.rpartition("/")
    if MARK in folder:
        there = [
            source_of(root, path) for path in root.glob(glob.escape(pattern).replace(MARK, "*"))
        ]
    else:
        # one folder is listed in a tenth of the time that a search takes
        listing = os.listdir(root / folder) if (root / folder).is_dir() else []  # noqa: PTH208
        there = [f"{folder}{slash}{name}" for name in listing]
    for name in there:
        length = (len(name) - len(pattern) + times * len(MARK)) // times
        trial = name[len(head) : len(head) + length]
        if (
            name.endswith(tail)
            and pattern.replace(MARK, trial) == name
            and trial not in listed
            and name != campaign.trials.file
            and (root / name).is_file()
        ):
            names.append(name)
    alike, names = _misspelt(pattern, trials, names, there)
    if not names:
        return alike
    more = f" and {len(names) - 1} more are" if len(names) > 1 else " is"
    note = (
        f"{min(names)}{more} no trial's record: the schedule has no such row, so left out; a row"
        " lost, or an id mistyped?"
    )
    return (*alike, note)


def _misspelt(
    pattern: str, trials: Collection[str], names: list[str], there: Collection[str]
) -> tuple[tuple[str, ...], list[str]]:
    """Notes on files that differ from a trial's file only in case, or in the form of
    their accents, and the other names.
    """
    present = set(there)
    wanted = {
        _folded(name): name
        for trial in trials
        if (name := pattern.replace(MARK, trial)) not in present
    }
    notes, others = [], []
    for name in names:
        meant = wanted.get(_folded(name))
        if meant is None:
            others.append(name)
            continue
        same = unicodedata.normalize("NFC", name) == unicodedata.normalize("NFC", meant)
        how = "in the Unicode form of its accents (NFC, NFD)" if same else "in case"
        notes.append(
            f"{meant} is missing, but {name} is there, which differs only {how}: rename the file,"
            " or the id in the schedule"
        )
    few = 5
    more = [f"... and {len(notes) - few} more such files"] if len(notes) > few else []
    return (*notes[:few], *more), others


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def source_of(root: Path, path: Path) -> str:
    """A file's name relative to the campaign's folder, with forward slashes."""
    # pathlib's own ways take several times as long
    folder, name = f"{root}{os.sep}", str(path)
    inside = name[len(folder) :] if name.startswith(folder) else str(path.relative_to(root))
    return inside if os.sep == "/" else inside.replace(os.sep, "/")


def files_per_trial(campaign: Campaign, root: Path, trials: Sequence[str]) -> list[Path]:
    """`Reader.files` where every trial has a file of its own."""
    return [path for path, _ in per_trial(campaign, root, trials).values()]


def plan_per_trial(campaign: Campaign, root: Path, trials: Sequence[str]) -> ReadingPlan:
    """`Reader.plan` where every trial has a file of its own."""
    there = per_trial(campaign, root, trials)
    return ReadingPlan(pieces=tuple(pieces(there)), notes=unlisted(campaign, root, trials))


def pieces(there: Mapping[str, tuple[Path, int]]) -> Iterator[Piece]:
    """Tasks of some files each, from path and size in bytes of every trial's."""
    trials: list[str] = []
    size = 0
    for i, (trial, (_, length)) in enumerate(there.items(), start=1):
        trials.append(trial)
        size += length
        if len(trials) == PER_PIECE or size > BYTES_PER_PIECE or i == len(there):
            yield Piece(trials=tuple(trials), paths=tuple(there[t][0] for t in trials), bytes=size)
            trials, size = [], 0
