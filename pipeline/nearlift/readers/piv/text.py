"""Exported velocity grids as text: one table of dialects, and one reader of all of them.

A dialect says what its header holds (`Header`); rows, column counts and promised sizes are checked
for all alike. A number that a header states wins over the manifest only by agreeing with it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nearlift import units
from nearlift.declare import BoolArray, FloatArray
from nearlift.errors import InputRefused
from nearlift.readers.piv.fields import PIXEL, Dialect, Raw

#: A text file larger than this holds no velocity grid.
MAX_BYTES = 200_000_000
OPENPIV_NAMES = ("x", "y", "u", "v", "flags", "mask")
DANTEC_HEADER, DANTEC_DATA = ">>*HEADER*<<", ">>*DATA*<<"
#: A name begins only where one may, lest every letter of a long one be a start.
PIVLAB_NAME = re.compile(r"(?<![^\[\],;\t])([^\[\],;\t]++)\[([^\[\]]*+)\]")


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """The content of a header.

    Attributes
    ----------
    first : int
        Index of the first data line.
    separator : str or None
        Between cells; None for blanks and tabs.
    comma : bool
        Decimals are written with a comma.
    columns : int
        Number of named columns; 0 where the header names none.
    places : tuple of int
        Columns of x, y, u, v.
    promised : tuple of int
        Nodes across and up; empty where the header does not say.
    good : callable or None
        Table (n, columns) to the measured vectors (n,); None where every row is one.
    """

    first: int
    separator: str | None = None
    comma: bool = False
    columns: int = 0
    places: tuple[int, int, int, int] = (0, 1, 2, 3)
    promised: tuple[int, ...] = ()
    good: Callable[[FloatArray], BoolArray] | None = None
    length_unit: str | None = None
    velocity_unit: str | None = None
    scale_m: float | None = None
    frame_time_s: float | None = None
    noise_column: int | None = None


def openpiv(lines: list[str], path: Path) -> Header:
    """OpenPIV: ``# x y u v flags mask``, or five columns without a header.

    flags 0 is a measured vector, mask 1 a masked one; the fifth column of the old form is the
    signal-to-noise ratio. The files state no unit.
    """
    if lines[0].startswith("#"):
        names = lines[0].lstrip("# ").split()
        if tuple(names[:4]) != OPENPIV_NAMES[:4]:
            raise InputRefused(
                f"{path}, line 1",
                f"names {names}, not {' '.join(OPENPIV_NAMES)}",
                "export it with OpenPIV's own save",
            )
        flags = [names.index(name) for name in ("flags", "mask") if name in names]
        return Header(
            first=1, columns=len(names), good=lambda table: (table[:, flags] == 0).all(axis=1)
        )

    def has_ratio(table: FloatArray) -> BoolArray:
        if table.shape[1] != 5:
            raise InputRefused(
                f"{path}, line 1",
                f"has {table.shape[1]} columns and no header",
                "the old form has 5: x y u v s2n",
            )
        if np.isin(table[:, 4], (0, 1, 2)).all():
            raise InputRefused(
                str(path),
                "has a fifth column of flags, and no header says whether 0 or 1 is a good vector",
                'save it with a header, or say format = "pivlab" if PIVlab wrote it (there 1 is'
                " good)",
            )
        return np.isfinite(table[:, 4])

    return Header(first=0, good=has_ratio)


def insight(lines: list[str], path: Path) -> Header:
    """TSI Insight: one Tecplot line, then comma rows x, y, u, v, CHC.

    CHC 1 is a measured vector, 2 an interpolated one, all else void. The header states um per pixel
    and us between images.
    """
    listed = re.search(r"VARIABLES=((?:\s*\"[^\"]*\",?)+)", lines[0])
    names = re.findall(r'"([^"]*)"', listed[1]) if listed else []
    columns = [name.split()[0].upper() for name in names if name.split()]
    if columns[:4] != ["X", "Y", "U", "V"] or "CHC" not in columns:
        raise InputRefused(
            f"{path}, line 1",
            f"lists the variables {names}, not X, Y, U, V, CHC",
            "export a two-component field",
        )
    code = columns.index("CHC")
    um, us = (
        _insight_number(lines[0], key, path)
        for key in ("MicrometersPerPixelX", "MicrosecondsPerDeltaT")
    )
    return Header(
        first=1,
        separator=",",
        columns=len(columns),
        good=lambda table: table[:, code] == 1,
        length_unit=names[0].partition(" ")[2] or None,
        velocity_unit=names[2].partition(" ")[2] or None,
        scale_m=None if um is None else 1e-6 * um,
        frame_time_s=None if us is None else 1e-6 * us,
    )


def _insight_number(header: str, key: str, path: Path) -> float | None:
    text, end, _ = header.partition(f'{key}="')[2].partition('"')
    if not end:
        return None
    if not units.NUMBER.fullmatch(text):
        raise InputRefused(
            f"{path}, line 1", f"has {key} {text!r}, which is no number", "export it again"
        )
    return float(text) if float(text) > 0 else None


def davis(lines: list[str], path: Path) -> Header:
    """LaVision DaVis: ``#DaVis 8.1.6 2D-vector 32 64 64 "position" "mm" ...``, then tab rows x, y,
    u, v. Decimals may be commas. A missing vector is written ``0 -0``.
    """
    quantities = re.findall(r'"([^"]*)"\s+"([^"]*)"', lines[0])
    size = re.search(r"2D-vector\s+\d+\s+(\d{1,9})\s+(\d{1,9})\b", lines[0])
    if size is None or len(quantities) < 3:
        raise InputRefused(
            f"{path}, line 1",
            "is not the header of a two-component vector field",
            "export 2D vectors as text",
        )
    comma = any("," in line for line in lines[1:])
    if comma and any("." in line for line in lines[1:]):
        raise InputRefused(
            str(path), "mixes decimal commas and points", "export it with one of the two"
        )
    quantity, unit = quantities[2]
    return Header(
        first=1,
        separator="\t",
        comma=comma,
        promised=(int(size[1]), int(size[2])),
        length_unit=quantities[0][1],
        velocity_unit=f"{unit}/frame" if quantity.lower() == "displacement" else unit,
    )


def pivlab(lines: list[str], path: Path) -> Header:
    """PIVlab's ASCII chart: up to three header lines, then x, y, u, v, vector type and more.

    Vector type 1 is measured, 0 masked, 2 interpolated. Conversion factors win over the units of
    the third line: PIVlab writes m/s above displacements in metres, and then both factors are
    equal.
    """
    header = [line for line in lines[:3] if re.match(r"\s*(PIVlab|FRAME:|x\s*\[)", line)]
    scale = next((i for i, line in enumerate(header) if "conversion factor" in line), None)
    factors = None if scale is None else _pivlab_factors(header[scale])
    if scale is not None and factors is None:
        raise InputRefused(
            f"{path}, line {scale + 1}",
            "has conversion factors that are no numbers",
            "export it again",
        )
    named = next((line for line in header if re.match(r"\s*x\s*\[", line)), "")
    names = [(name.strip().lower(), unit) for name, unit in PIVLAB_NAME.findall(named)]
    data = next((line for line in lines[len(header) :] if line.strip()), "")
    length, velocity = (names[0][1], names[2][1]) if len(names) >= 4 else (None, None)
    if factors is not None and factors == (1, 1):
        length, velocity = "px", "px/frame"
    elif factors is not None:
        length = length or "m"
        velocity = "m/frame" if factors[0] == factors[1] else velocity or "m/s"

    def measured(table: FloatArray) -> BoolArray:
        if table.shape[1] < 5 or (names and len(names) != table.shape[1]):
            raise InputRefused(
                f"{path}, line {len(header) + 1}",
                f"has {table.shape[1]} columns, not x, y, u, v, vector type and what follows",
                "export it again",
            )
        return np.asarray(table[:, 4] == 1)

    uncertainties = [
        i for i, (name, unit) in enumerate(names) if name.startswith("uncertainty") and "/" in unit
    ]
    return Header(
        first=len(header),
        separator="," if "," in data else "\t" if "\t" in data else None,
        good=measured,
        length_unit=length,
        velocity_unit=velocity,
        noise_column=uncertainties[0] if uncertainties else None,
    )


def _pivlab_factors(line: str) -> tuple[float, float] | None:
    """M in a pixel, and m/s in a pixel per frame; None where either is no number."""
    _, _, length = line.partition("conversion factor xy (px -> m):")
    length, _, velocity = length.partition("conversion factor uv (px/frame -> m/s):")
    xy, (uv, rest) = units.measure(length)[0], units.measure(velocity)
    return None if xy is None or uv is None or rest.startswith(".") else (xy, uv)


def dantec(lines: list[str], path: Path) -> Header:
    """Dantec DynamicStudio, CSV or TAB: ``>>*HEADER*<<``, ``>>*DATA*<<``, a line of names, rows.

    Columns are found by name and unit: their order differs between two and three components. Status
    0 is a measured vector. Written after descriptions of the format, without an export of the
    software.
    """
    marks = [i for i, line in enumerate(lines) if line.strip().strip(";,").startswith(DANTEC_DATA)]
    if len(marks) != 1 or marks[0] + 2 >= len(lines):
        raise InputRefused(
            str(path),
            f"has {len(marks)} lines {DANTEC_DATA} with rows after them",
            "export one field per file",
        )
    at = marks[0] + 1
    header = "\n".join(lines[: at - 1])
    tabs = "DSExport.TAB" in header or "\t" in lines[at]
    separator = "\t" if tabs else ";" if ";" in lines[at] else ","
    names = [
        name.strip().strip('"') for name in lines[at].strip().strip(separator).split(separator)
    ]
    size = re.search(
        r"GridSize\s*+[:;]\s*+\{?\s*+Width\s*+=\s*+(\d{1,9})\s*+,\s*+Height\s*+=\s*+(\d{1,9})\b",
        header,
    )
    (x, length), (y, _), (u, velocity), (v, _) = (_dantec_column(names, c, path) for c in "xyuv")
    status = next((i for i, name in enumerate(names) if name.lower().startswith("status")), None)
    return Header(
        first=at + 1,
        separator=separator,
        comma=separator != "," and bool(re.search(r"\d,\d", lines[at + 1])),
        columns=len(names),
        places=(x, y, u, v),
        promised=(int(size[1]), int(size[2])) if size else (),
        good=None if status is None else lambda table: table[:, status] == 0,
        length_unit=length,
        velocity_unit=velocity if "/" in velocity else f"{velocity}/frame",
    )


def _dantec_column(names: list[str], letter: str, path: Path) -> tuple[int, str]:
    """Position and unit of ``X (mm)[mm]`` and the like: in metres rather than in pixels."""
    fitting = []
    for i, name in enumerate(names):
        match = re.fullmatch(
            r"\s*+([A-Za-z])\s*+(?:\([^)]*+\)\s*+|(?<=\s)\w++\s*+)?\[([^\]]++)\]\s*+", name
        )
        if match and match[1].lower() == letter:
            fitting.append((match[2].lower().split("/")[0] in PIXEL, i, match[2]))
    if not fitting:
        raise InputRefused(
            str(path),
            f"names no column {letter.upper()} with a unit among {', '.join(names)}",
            "export positions and components with units",
        )
    _, i, unit = min(fitting)
    return i, unit


def _is_openpiv(head: bytes) -> bool:
    first = head.split(b"\n")[0].decode("latin-1")
    if first.startswith("#"):
        return tuple(first.lstrip("# ").split()[:4]) == OPENPIV_NAMES[:4]
    try:
        return len([float(cell) for cell in first.split()]) == 5
    except ValueError:
        return False


def _is_insight(head: bytes) -> bool:
    return head.lstrip().startswith(b"TITLE=") and b"VARIABLES=" in head and b'"CHC"' in head


def _is_pivlab(head: bytes) -> bool:
    first = head.split(b"\n")[0]
    return first.startswith((b"PIVlab", b"FRAME:")) or (b"[" in first and b"Vector type" in first)


def read(path: Path, header_of: Callable[[list[str], Path], Header]) -> Iterator[Raw]:
    """The one field of a text file, whose dialect tells the header."""
    lines = text_of(path).split("\n")
    header = header_of(lines, path)
    table = rows(lines[header.first :], path, header.first + 1, header.separator, header.comma)
    if header.columns and table.shape[1] != header.columns:
        raise InputRefused(
            f"{path}, line {header.first + 1}",
            f"has {table.shape[1]} columns where the header names {header.columns}",
            "export it again",
        )
    wide, high = header.promised or (len(table), 1)
    if table.shape[1] < 4 or len(table) != wide * high:
        raise InputRefused(
            str(path),
            f"has {len(table)} rows of {table.shape[1]}, its header promises {wide} x {high}"
            " vectors",
            "it was cut off: export it again",
        )
    good = np.ones(len(table), dtype=bool) if header.good is None else header.good(table)
    noise = header.noise_column
    yield Raw(
        *table[:, header.places].T,
        good=good,
        length_unit=header.length_unit,
        velocity_unit=header.velocity_unit,
        scale_m=header.scale_m,
        frame_time_s=header.frame_time_s,
        noise=None if noise is None else np.abs(table[:, noise]),
    )


def text_of(path: Path) -> str:
    """A text file, UTF-8 or UTF-16 with its mark, else Latin-1; carriage returns removed.
    `InputRefused` of an empty, too large or binary one.
    """
    size = path.stat().st_size
    if size == 0:
        raise InputRefused(str(path), "is empty", "export it again")
    if size > MAX_BYTES:
        raise InputRefused(
            str(path), f"has {size} bytes", f"one field per file: at most {MAX_BYTES} bytes"
        )
    content = path.read_bytes()
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = content.decode("utf-16", errors="replace")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = content.decode("latin-1")
    if "\0" in text:
        raise InputRefused(
            str(path),
            "holds zero bytes: it is binary, or was cut off by a loss of power",
            "export it again as text",
        )
    return text.replace("\r\n", "\n").replace("\r", "\n")


def rows(
    lines: list[str], path: Path, first: int, separator: str | None, comma: bool
) -> FloatArray:
    """Numbers of data lines as (n, columns); `InputRefused` names the first bad line, counted from
    `first`.
    """
    lines = [line.strip().strip(separator or " ") for line in lines if line.strip()]
    if not lines:
        raise InputRefused(str(path), "holds a header and no vectors", "export it again")
    body = [line.replace(",", ".") for line in lines] if comma else lines
    try:
        return np.loadtxt(body, delimiter=separator, comments=None, ndmin=2)
    except ValueError:
        raise _bad_line(lines, path, first, separator, comma) from None


def _bad_line(
    lines: list[str], path: Path, first: int, separator: str | None, comma: bool
) -> InputRefused:
    width = len(lines[0].split(separator))
    for i, line in enumerate(lines):
        where, cells = f"{path}, line {first + i}", line.split(separator)
        if len(cells) != width:
            more = "the file was cut off there" if i == len(lines) - 1 else "correct that line"
            return InputRefused(where, f"has {len(cells)} cells where the first has {width}", more)
        for cell in map(str.strip, cells):
            try:
                float(cell.replace(",", ".") if comma else cell)
            except ValueError:
                is_comma = re.fullmatch(r"-?\d+,\d+", cell)
                hint = "decimal commas? this dialect writes points" if is_comma else "correct it"
                return InputRefused(where, f"{cell!r} is no number", hint)
    return InputRefused(str(path), "cannot be read as a table of numbers", "export it again")


def _dialect(
    name: str,
    title: str,
    recognises: Callable[[bytes], bool],
    header_of: Callable[[list[str], Path], Header],
) -> Dialect:
    return Dialect(
        name=name, title=title, recognises=recognises, read=lambda path: read(path, header_of)
    )


DIALECTS = (
    _dialect("insight", "TSI Insight .vec", _is_insight, insight),
    _dialect("davis", "LaVision DaVis text", lambda head: head.startswith(b"#DaVis"), davis),
    _dialect("openpiv", "OpenPIV text, with or without header", _is_openpiv, openpiv),
    _dialect("pivlab", "PIVlab ASCII chart", _is_pivlab, pivlab),
    _dialect(
        "dantec",
        "Dantec DynamicStudio export, CSV or TAB",
        lambda head: head.lstrip().startswith(DANTEC_HEADER.encode()),
        dantec,
    ),
)
