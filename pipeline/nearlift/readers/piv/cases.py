"""The files of a PIV run: which dialect each is of, and the fields of a case in vehicle axes."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from nearlift.campaign.piv import Piv, PivCase
from nearlift.errors import InputRefused, ManifestError, did_you_mean
from nearlift.flow.field import VelocityField, masked, orient
from nearlift.readers import guarded
from nearlift.readers.files import inside, source_of
from nearlift.readers.guarded import Malformed
from nearlift.readers.piv import binary, text
from nearlift.readers.piv.fields import Dialect, Raw, Setting, settle

DIALECTS: tuple[Dialect, ...] = (*text.DIALECTS, *binary.DIALECTS)
HEAD = 1 << 16
#: Bytes of the fields after which an answer ends.
ANSWER = 32 << 20
UNSAID = Setting()


def dialect_of(name: str) -> Dialect:
    """The dialect of that name; `ManifestError` with the nearest if there is none."""
    known = {d.name: d for d in DIALECTS}
    if name not in known:
        raise ManifestError(
            "piv.format",
            f"there is no format {name!r}",
            did_you_mean(name, known) or f"formats are {', '.join(known)}",
        )
    return known[name]


def claimed_by(path: Path) -> Dialect:
    """The one dialect that claims a file; `InputRefused` where none does, or more than one."""
    with path.open("rb") as file:
        head = file.read(HEAD)
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        head = head[: len(head) // 2 * 2].decode("utf-16", errors="replace").encode()
    head = head.removeprefix(b"\xef\xbb\xbf")
    if b"\0" not in head:
        head = head.replace(b"\r\n", b"\n")
    if not head:
        raise InputRefused(str(path), "is empty", "export it again")
    claimed = [d for d in DIALECTS if d.recognises(head)]
    if len(claimed) == 1:
        return claimed[0]
    names = ", ".join(d.name for d in claimed or DIALECTS)
    what = f"could be any of {names}" if claimed else "is of no known format"
    raise InputRefused(
        str(path),
        what,
        f'say format = "..." under [piv]; formats are {", ".join(d.name for d in DIALECTS)}',
    )


def read(
    path: Path,
    setting: Setting = UNSAID,
    format_name: str | None = None,
) -> Iterator[VelocityField]:
    """The fields of one file in SI, in the file's own axes; `InputRefused` where it cannot be read,
    or holds no velocities in known units.
    """
    dialect = claimed_by(path) if format_name is None else dialect_of(format_name)
    for i, raw in enumerate(raws(path, dialect)):
        yield settle(raw, setting, str(path) if i == 0 else f"{path}, field {i + 1}")


def raws(path: Path, dialect: Dialect) -> Iterator[Raw]:
    """The fields of one file as they are in it; `InputRefused` as by the dialect's own reader, or
    where that crashed or came to a limit.
    """
    if not dialect.child:
        yield from dialect.read(path)
        return
    done, more = 0, True
    while more:
        try:
            fields, more = guarded.run(fields_of, dialect.read, path, done)
        except Malformed as fault:
            raise InputRefused(str(path), str(fault), "export it again") from None
        yield from fields
        done += len(fields)


def fields_of(
    read: Callable[[Path], Iterator[Raw]], path: Path, first: int
) -> tuple[list[Raw], bool]:
    """The fields of a file from number `first` on, as many as one answer may hold, and whether
    there are more.
    """
    fields: list[Raw] = []
    size = 0
    for raw in itertools.islice(read(path), first, None):
        if size > ANSWER:
            return fields, True
        fields.append(raw)
        size += sum(np.asarray(a).nbytes for a in (raw.x, raw.y, raw.u, raw.v, raw.good))
    return fields, False


def files_of(root: Path, case: PivCase) -> list[Path]:
    """Every file of a case, in the order of the numbers in their names; `ManifestError` where the
    pattern leads outside the campaign's folder, or matches nothing, `InputRefused` where a file
    leads outside by a link, or is no regular file.
    """
    where = f"piv case {case.name!r}: files"
    if Path(case.files).is_absolute() or ".." in Path(case.files).parts:
        raise ManifestError(
            where,
            f"{case.files!r} leads outside the campaign's folder",
            "put the files themselves into the folder",
        )
    files = sorted(
        (p for p in root.glob(case.files) if p.is_file()),
        key=lambda p: _natural(source_of(root, p)),
    )
    if not files:
        raise ManifestError(
            where,
            f"no file matches {case.files!r} in {root}",
            'write a pattern such as "piv/ground-3.4/*.txt"',
        )
    return [inside(root, source_of(root, p), where) for p in files]


def _natural(name: str) -> list[str | int]:
    # every second part is a number
    return [int(part) if i % 2 else part for i, part in enumerate(re.split(r"(\d+)", name))]


@dataclass
class Stream:
    """The fields of one case, one in memory at a time; `refused` lists what was (file, reason)."""

    root: Path
    piv: Piv
    case: PivCase
    files: list[Path]
    refused: list[tuple[str, InputRefused]] = field(default_factory=list)

    def __iter__(self) -> Iterator[VelocityField]:
        said = partial(self.piv.setting, self.case)
        setting = Setting(
            length_unit=said("length_unit"),
            velocity_unit=said("velocity_unit"),
            scale_m=said("scale"),
            frame_time_s=said("frame_time"),
        )
        lie = {name: said(name) for name in ("thrust", "across")}
        lie |= {"origin_m": said("origin"), "v_sign": said("v_sign", 1)}
        hidden = said("mask", [])
        for path in self.files:
            try:
                for field in read(path, setting, said("format")):
                    yield masked(orient(field, **lie), hidden)
            except InputRefused as refusal:
                self.refused.append((source_of(self.root, path), refusal))
