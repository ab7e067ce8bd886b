"""Which dialect a file is of, told from its first bytes: exactly one must claim it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from nearlift.errors import InputRefused, ManifestError, did_you_mean
from nearlift.flow.field import VelocityField
from nearlift.readers.channel import Malformed
from nearlift.readers.child import Child
from nearlift.readers.piv.dantec import DANTEC
from nearlift.readers.piv.davis import DAVIS
from nearlift.readers.piv.insight import INSIGHT
from nearlift.readers.piv.netcdf import NETCDF
from nearlift.readers.piv.openpiv import OPENPIV
from nearlift.readers.piv.pivlab_mat import PIVLAB_MAT
from nearlift.readers.piv.pivlab_text import PIVLAB
from nearlift.readers.piv.vectors import Dialect, Raw, Setting, settle
from nearlift.readers.serve import ReadFields

DIALECTS: tuple[Dialect, ...] = (INSIGHT, DAVIS, OPENPIV, PIVLAB, PIVLAB_MAT, DANTEC, NETCDF)
HEAD = 1 << 16
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
    claimed = [d for d in DIALECTS if d.sniff(head)]
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
    child: Child | None = None,
) -> Iterator[VelocityField]:
    """The fields of one file in SI, in the file's own axes; `InputRefused` where it cannot be read,
    or holds no velocities in known units. `child` is the process that parses what a C library must,
    else one for this file.
    """
    dialect = claimed_by(path) if format_name is None else dialect_of(format_name)
    for i, raw in enumerate(raws(path, dialect, child)):
        yield settle(raw, setting, str(path) if i == 0 else f"{path}, field {i + 1}")


def raws(path: Path, dialect: Dialect, child: Child | None = None) -> Iterator[Raw]:
    """The fields of one file as they stand there, one in memory at a time, by the `child` of
    `read`; `InputRefused` as by the dialect's own reader, or where that crashed or came to a limit.
    """
    if not dialect.child:
        yield from dialect.read(path)
        return
    request = ReadFields(reader=dialect.name, path=str(path))
    try:
        with contextlib.nullcontext(child) if child else Child() as worker:
            for answer, (x, y, u, v, good) in worker.ask(request):
                yield Raw(x, y, u, v, good=good != 0, **answer["field"])
    except Malformed as fault:
        raise InputRefused(str(path), str(fault), "export it again") from None
