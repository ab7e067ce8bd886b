"""CSV: one file per trial, columns by header name, commas between cells, points in decimals, UTF-8.

Strict: every cell of the force (and clock) column is a number or a word that loggers write for "no number", else the first bad
line is named. A file that does not end in a newline may be cut within a number, which no reader could see: its last
line is left out and the trial says so. Three roads lead to the same bits: a compiled scanner where there is much to read,
pyarrow where there is little or where numbers have more digits than the scanner takes, and a slow one that explains.
"""

from __future__ import annotations

import csv
import difflib
import io
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from nearlift import units
from nearlift.campaign import Campaign
from nearlift.errors import InputRefused
from nearlift.readers.arrow import floats
from nearlift.readers.seam import FloatArray, Piece, Plan, Reader, Record, force_channel, per_trial, source_of

#: Files of one task; large enough that a task costs more than sending it.
PER_PIECE = 32
#: Below this many bytes in all, importing the compiled scanner costs more than it saves.
WORTH_COMPILING = 16 << 20
#: What loggers write where there is no number, in lower case.
NO_NUMBER = (
    "",
    "nan",
    "-nan",
    "+nan",
    "inf",
    "+inf",
    "-inf",
    "over",
    "ovl",
    "ovfl",
    "ol",
    "o.l",
    "#nv",
    "#n/a",
    "n/a",
    "na",
    "null",
    "1.#inf",
    "-1.#inf",
    "1.#qnan",
    "-1.#qnan",
    "1.#ind",
    "-1.#ind",
)
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def _files(campaign: Campaign, root: Path, trials: Sequence[str]) -> list[Path]:
    return [path for path, _ in per_trial(campaign, root, trials).values()]


def _plan(campaign: Campaign, root: Path, trials: Sequence[str]) -> Plan:
    there = per_trial(campaign, root, trials)
    names = list(there)
    total = sum(size for _, size in there.values())
    chunks = [names[i : i + PER_PIECE] for i in range(0, len(names), PER_PIECE)]
    # every piece carries the whole campaign's size, by which it chooses its road
    return Plan(pieces=tuple(Piece(trials=tuple(chunk), paths=tuple(there[t][0] for t in chunk), bytes=total) for chunk in chunks))


def _read_piece(campaign: Campaign, root: Path, piece: Piece) -> Iterator[Record]:
    factor, zero = force_channel(campaign).linear()
    clock = campaign.records.time
    tick = units.to_si(clock.unit, "time", "records.time.unit")[0] if clock else 1.0
    for trial, path in zip(piece.trials, piece.paths, strict=True):
        content = path.read_bytes()
        force, time, codes = parse(
            content, str(path), force_channel(campaign).column, clock.column if clock else None, compiled=piece.bytes > WORTH_COMPILING
        )
        yield Record(
            trial=trial, force_N=factor * (force - zero), time_s=None if time is None else tick * time, source=source_of(root, path), codes=codes
        )


def parse(
    content: bytes, where: str, force: str, time: str | None = None, *, compiled: bool = False
) -> tuple[FloatArray, FloatArray | None, tuple[str, ...]]:
    """Force and clock columns of one file's bytes, and quality codes.

    Raises
    ------
    InputRefused
        The file is not UTF-8, a column is missing or stands twice, or a line is not what the header promises.
    """
    nothing = np.empty(0)
    blank = None if time is None else nothing
    codes: tuple[str, ...] = ()
    if not content.strip(b"\0"):
        return nothing, blank, ("EMPTY",)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputRefused(where, "is UTF-16 text", "save it as UTF-8")
    if not content.endswith(b"\n"):
        # a NUL tail is what a power cut leaves behind
        content = content.rstrip(b"\0")
        content = content[: content.rfind(b"\n") + 1]
        codes = ("truncated",)
        if not content:
            return nothing, blank, ("NO_DATA", "truncated")
    body = content.find(b"\n") + 1
    header = _header(content[:body], where)
    wanted = [_place(header, name, key, where) for name, key in ((force, "records.force.column"), (time, "records.time.column")) if name is not None]
    if not content[body : body + 80].strip() and not content[body:].strip():
        return nothing, blank, (*codes, "NO_DATA")
    found = _scanned(content, body, len(header), wanted) if compiled else None
    if found is None:
        found = _by_arrow(content, body, len(header), wanted)
    if found is None:
        found = _explained(content[body:], where, header, wanted)
    return found[0], found[1] if time is not None else None, codes


def _header(line: bytes, where: str) -> list[str]:
    try:
        text = line.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputRefused(f"{where}, line 1", "is not UTF-8 text", "save it as UTF-8") from None
    header = [name.strip() for name in next(csv.reader([text.rstrip("\r\n")]), [])]
    if len(header) == 1 and any(d in header[0] for d in ";\t"):
        raise InputRefused(f"{where}, line 1", "is not separated by commas", "save it with commas between cells and points in decimals")
    if header and all(_NUMBER.fullmatch(name) for name in header):
        raise InputRefused(f"{where}, line 1", "holds numbers where the columns' names should stand", "put a header line above the samples")
    return header


def _place(header: list[str], name: str, key: str, where: str) -> int:
    if header.count(name) != 1:
        close = difflib.get_close_matches(name, header, n=1, cutoff=0.5)
        hint = f'{key} = "{close[0]}"?' if close and name not in header else f"it has {', '.join(repr(h) for h in header)}; {key} names it"
        raise InputRefused(f"{where}, line 1", f"{'more than one' if name in header else 'no'} column {name!r}", hint)
    return header.index(name)


def _scanned(content: bytes, body: int, columns: int, wanted: list[int]) -> list[FloatArray] | None:
    """The compiled road; None where the file is not plain enough."""
    from nearlift.readers import kernel

    # a row has at least a digit and a separator per column
    rows = (len(content) - body) // (2 * columns) + 1
    out = [np.empty(rows) for _ in wanted]
    clock = out[1] if len(wanted) > 1 else np.empty(0)
    found = kernel.scan(np.frombuffer(content, dtype=np.uint8), body, columns, wanted[0], wanted[1] if len(wanted) > 1 else None, out[0], clock)
    return None if found is None else [values[:found] for values in out]


def _by_arrow(content: bytes, body: int, columns: int, wanted: list[int]) -> list[FloatArray] | None:
    """Pyarrow's road; None where it finds a line that it cannot read."""
    import pyarrow as pa
    import pyarrow.csv as pc

    names = [f"c{i}" for i in range(columns)]
    chosen = [names[i] for i in wanted]
    try:
        table = pc.read_csv(
            io.BytesIO(content[body:]),
            read_options=pc.ReadOptions(column_names=names, use_threads=False, block_size=max(1 << 20, len(content) + 1)),
            convert_options=pc.ConvertOptions(
                include_columns=chosen, column_types=dict.fromkeys(chosen, pa.float64()), null_values=[""], check_utf8=False
            ),
        )
    except pa.ArrowInvalid:
        return None
    found = [floats(table[name].combine_chunks()) for name in chosen]
    return [np.where(np.isfinite(values), values, np.nan) for values in found]


def _explained(body: bytes, where: str, header: list[str], wanted: list[int]) -> list[FloatArray]:
    """The slow road, which reads the words for "no number" and names the first line that cannot be read."""
    try:
        lines = body.decode("utf-8").split("\n")
    except UnicodeDecodeError as fault:
        bad = body.count(b"\n", 0, fault.start) + 2
        raise InputRefused(f"{where}, line {bad}", "is not UTF-8 text", "the file is damaged or in another encoding; save it as UTF-8") from None
    out: list[list[float]] = [[] for _ in wanted]
    for number, line in enumerate(lines, start=2):
        if not line.strip():
            continue
        at = f"{where}, line {number}"
        if "\0" in line:
            raise InputRefused(at, "holds NUL bytes", "the file is damaged; copy it anew from the rig, or take the trial out of the schedule")
        row = next(csv.reader([line.rstrip("\r")]))
        if [cell.strip() for cell in row] == header:
            raise InputRefused(at, "repeats the header: two records stand in one file", "give each trial a file of its own")
        if len(row) != len(header):
            raise InputRefused(
                at,
                f"has {len(row)} cells under {len(header)} column names",
                "decimals want a point and no cell may be left out; mend the line, or take the trial out of the schedule",
            )
        for values, column in zip(out, wanted, strict=True):
            values.append(_number(row[column].strip(), at, header[column]))
    return [np.array(values) for values in out]


def _number(text: str, at: str, column: str) -> float:
    if _NUMBER.fullmatch(text):
        value = float(text)
        return value if math.isfinite(value) else math.nan
    if text.lower() in NO_NUMBER:
        return math.nan
    remedy = (
        "write decimals with a point"
        if re.fullmatch(r"[-+]?\d+,\d+", text)
        else "every cell must be a number; mend the line, or take the trial out of the schedule"
    )
    raise InputRefused(at, f"{text!r} in column {column!r} is not a number", remedy)


CSV = Reader(name="csv", title="one CSV file per trial, columns by header name", files=_files, plan=_plan, read_piece=_read_piece)
