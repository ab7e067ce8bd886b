"""Exported velocity grids as they are in a file: a table of dialects over one reader of text.

The dialects are OpenPIV, PIVlab, Insight, DaVis, Dantec and pivpy's netCDF.

A text dialect is a function from a header to the names and units of columns. One reader reads all
of them, finds columns by name, and checks rows, column counts and promised sizes. A number that a
header states must agree with the manifest. A vector that is exactly (0, 0) is missing: correlating
software writes it where it found nothing.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from nearlift import units
from nearlift.declare import BoolArray, FloatArray
from nearlift.errors import InputRefused, ManifestError, did_you_mean
from nearlift.readers import guarded
from nearlift.readers.base import library
from nearlift.readers.files import content_of, head_of
from nearlift.readers.guarded import Malformed
from nearlift.readers.hdf5 import MAGIC, datasets
from nearlift.readers.mat import V5, V73
from nearlift.readers.table import BLANKS, Layout, Lines, parse

#: First bytes by which a file is recognised, and bytes of fields after which an answer ends.
HEAD, ANSWER = 1 << 16, 32 << 20
PIXEL = ("px", "pix", "pixel", "pixels")
FRAME = ("frame", "frames", "dt", "pair")
DANTEC_DATA = ">>*DATA*<<"
#: Columns that mark measured vectors, with the value that means measured. Insight, OpenPIV's two,
#: PIVlab, Dantec.
MEASURED = {"chc": 1, "flags": 0, "mask": 0, "vector type": 1, "status": 0}
UTF16 = (b"\xff\xfe", b"\xfe\xff")


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Units, m per pixel, s between two images, as a file or the manifest states them; None: not
    stated.
    """

    length_unit: str | None = None
    velocity_unit: str | None = None
    scale_m: float | None = None
    frame_time_s: float | None = None


@dataclass(frozen=True, slots=True)
class Raw:
    """One field as a file holds it, rows (n,) in any order, and what the file states of units.

    v is positive along the file's y unless the manifest says otherwise. `good` marks measured
    vectors. `noise` is the standard uncertainty of a component, in the velocity's unit.
    """

    x: FloatArray
    y: FloatArray
    u: FloatArray
    v: FloatArray
    _: KW_ONLY
    good: BoolArray
    stated: Setting
    noise: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """The content of a text's header: name and unit of each column, the index of the first data
    line, the nodes across and up (empty where not stated), and what else it states of units.
    """

    first: int
    columns: Sequence[tuple[str, str | None]]
    promised: tuple[int, ...] = ()
    stated: Setting = field(default_factory=Setting)


@dataclass(frozen=True, slots=True, kw_only=True)
class GridDialect:
    """One outside format: its name in ``[piv] format``, and a title for the catalogue.

    `recognises` judges a file by its first bytes; no two dialects claim one file. `header` is that
    of a text; `fields` reads a binary file, in the guarded process.
    """

    name: str
    title: str
    recognises: Callable[[bytes], object]
    header: Callable[[list[str], str], Header] | None = None
    fields: Callable[[Path], Iterator[Raw]] | None = None

    def read(self, path: Path) -> Iterator[Raw]:
        """The fields of a file, one in memory at a time."""
        if self.header is not None:
            yield _of_text(path, self.header)
        if self.fields is not None:
            yield from self.fields(path)


def _refusal(where: object, what: str, remedy: str = "export it again") -> InputRefused:
    return InputRefused(str(where), what, remedy)


# ---- text


def _of_text(path: Path, header_of: Callable[[list[str], str], Header]) -> Raw:
    """The one field of a text file, its columns found by the header's names and units."""
    content = content_of(path)
    if not content:
        raise _refusal(path, "is empty")
    try:
        text = content.decode("utf-16" if content.startswith(UTF16) else "utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    if "\0" in text:
        what = "holds zero bytes: it is binary, or was cut off by a loss of power"
        raise _refusal(path, what, "export it again as text")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    header = header_of(lines, str(path))
    table = _table(path, lines, header)
    column: dict[str, int] = {}
    for i, (name, _) in enumerate(header.columns):
        column.setdefault(name.strip().lower(), i)
    good = np.isfinite(table[:, column["s2n"]]) if "s2n" in column else np.ones(len(table), bool)
    for name, measured in MEASURED.items():
        if name in column:
            good &= table[:, column[name]] == measured
    noise = [
        np.abs(table[:, i])
        for i, (name, unit) in enumerate(header.columns)
        if name.startswith("uncertainty") and "/" in (unit or "")
    ]
    places = [_place(header, letter, path) for letter in "xyuv"]
    length, velocity = (header.columns[places[k]][1] for k in (0, 2))
    stated = replace(
        header.stated,
        length_unit=header.stated.length_unit or length,
        velocity_unit=header.stated.velocity_unit or velocity,
    )
    return Raw(*table.T[places], good=good, stated=stated, noise=noise[0] if noise else None)


def _table(path: Path, lines: Sequence[str], header: Header) -> FloatArray:
    """The numbers below a header, a row for each vector; refuses other rows than promised."""
    rows = [line.strip() for line in lines[header.first :]]
    data = next(filter(None, rows), "")
    if not data:
        raise _refusal(path, "holds a header and no vectors")
    # a comma is the decimal sign where another one separates
    separator = next((sign for sign in "\t;," if sign in data), BLANKS)
    body = "\n".join([*rows, ""])
    comma = separator in "\t;" and "," in body and "." not in body
    cells = data.split(None if separator == BLANKS else separator)
    trailing = len(cells) > 1 and not cells[-1].strip()
    count = len(cells) - trailing
    layout = Layout(
        separator=separator,
        decimal="," if comma else ".",
        names=tuple(f"column {i + 1}" for i in range(count)),
        trailing=trailing,
    )
    whole = Lines(body=body.encode(), where=str(path), line=header.first + 1)
    try:
        table = np.stack(parse(whole, layout, range(count))[0], axis=1)
    except InputRefused as refusal:
        raise _refusal(
            refusal.where, refusal.what, "export it again, with decimal points"
        ) from None
    if count != len(header.columns):
        what = f"has {count} columns where the header names {len(header.columns)}"
        raise _refusal(f"{path}, line {header.first + 1}", what)
    wide, high = header.promised or (len(table), 1)
    if len(table) != wide * high:
        what = f"has {len(table)} rows of {count}, its header promises {wide} x {high} vectors"
        raise _refusal(path, what, "it was cut off: export it again")
    return table


def _place(header: Header, letter: str, where: Path) -> int:
    """Place of a coordinate or component: in metres rather than in pixels, with a unit first."""
    fitting = [
        (unit is None, (unit or "").lower().split("/")[0] in PIXEL, i)
        for i, (name, unit) in enumerate(header.columns)
        # Dantec's U pix[pix] names the unit twice
        if (name.strip().lower().split() or [""])[0] == letter
    ]
    if not fitting:
        named = ", ".join(name for name, _ in header.columns)
        what = f"names no column {letter.upper()} among {named}"
        raise _refusal(where, what, "export positions and components with units")
    return min(fitting)[-1]


def _named(cells: Sequence[str]) -> list[tuple[str, str | None]]:
    """Name and unit of headings such as ``u [m/s]`` and ``X (mm)[mm]``."""
    named: list[tuple[str, str | None]] = []
    for cell in cells:
        plain = cell.strip().strip('"')
        name, bracket, unit = plain.rpartition("[")
        stated = bracket and unit.endswith("]")
        named.append((name.partition("(")[0].strip(), unit[:-1]) if stated else (plain, None))
    return named


def openpiv(lines: list[str], where: str) -> Header:
    """OpenPIV: ``# x y u v flags mask``, or five columns without a header, of which the last is the
    signal-to-noise ratio. The files state no unit.
    """
    if lines[0].startswith("#"):
        return Header(first=1, columns=[(n, None) for n in lines[0].lstrip("# ").split()])
    if {row.split()[-1] for row in lines if row.strip()} <= {"0", "1", "2"}:
        raise _refusal(
            where,
            "has a fifth column of flags, and no header says whether 0 or 1 is a good vector",
            'save it with a header, or say format = "pivlab" if PIVlab wrote it (there 1 is good)',
        )
    return Header(first=0, columns=[(name, None) for name in ("x", "y", "u", "v", "s2n")])


def _is_openpiv(head: bytes) -> bool:
    first = head.split(b"\n")[0].decode("latin-1")
    if first.startswith("#"):
        return first.lstrip("# ").split()[:4] == ["x", "y", "u", "v"]
    cells = first.split()
    return len(cells) == 5 and all(map(units.NUMBER.fullmatch, cells))


def insight(lines: list[str], where: str) -> Header:
    """TSI Insight: one Tecplot line, then comma rows x, y, u, v, CHC.

    The header states um per pixel and us between images.
    """
    listed = re.search(r"VARIABLES=((?:\s*\"[^\"]*\",?)+)", lines[0])
    names = [n.partition(" ") for n in re.findall(r'"([^"]*)"', listed[1])] if listed else []

    def stated(key: str) -> float | None:
        """A positive number of the header, in 1e-6 of its unit."""
        text, end, _ = lines[0].partition(f'{key}="')[2].partition('"')
        if end and not units.NUMBER.fullmatch(text):
            raise _refusal(f"{where}, line 1", f"has {key} {text!r}, which is no number")
        return 1e-6 * float(text) if end and float(text) > 0 else None

    return Header(
        first=1,
        columns=[(name, unit or None) for name, _, unit in names],
        stated=Setting(
            scale_m=stated("MicrometersPerPixelX"), frame_time_s=stated("MicrosecondsPerDeltaT")
        ),
    )


def davis(lines: list[str], where: str) -> Header:
    """LaVision DaVis: ``#DaVis 8.1.6 2D-vector 32 64 64 "position" "mm" ...``, then tab rows x, y,
    u, v. A missing vector is written ``0 -0``.
    """
    quantities = re.findall(r'"([^"]*)"\s+"([^"]*)"', lines[0])
    size = re.search(r"2D-vector\s+\d+\s+(\d{1,9})\s+(\d{1,9})\b", lines[0])
    if size is None or len(quantities) < 3:
        what = "is not the header of a two-component vector field"
        raise _refusal(f"{where}, line 1", what, "export 2D vectors as text")
    (_, length), _, (quantity, unit) = quantities[:3]
    velocity = f"{unit}/frame" if quantity.lower() == "displacement" else unit
    columns = [("x", length), ("y", length), ("u", velocity), ("v", velocity)]
    return Header(first=1, columns=columns, promised=(int(size[1]), int(size[2])))


def pivlab(lines: list[str], where: str) -> Header:
    """PIVlab's ASCII chart: up to three header lines, then x, y, u, v, vector type and more.

    Conversion factors win over the units of the third line: PIVlab writes m/s above displacements
    in metres, and then both factors are equal.
    """
    header = [line for line in lines[:3] if re.match(r"\s*(PIVlab|FRAME:|x\s*\[)", line)]
    columns = next(
        (_named(re.split(r"[,;\t]", line)) for line in header if re.match(r"\s*x\s*\[", line)), []
    )
    if not columns:
        data = next((line for line in lines[len(header) :] if line.strip()), "")
        more = len(re.split(r"[,\t]| +", data.strip())) - 5
        columns = [(n, None) for n in ("x", "y", "u", "v", "vector type", *[""] * more)]
    stated = Setting()
    for i, line in enumerate(header):
        _, _, xy = line.partition("conversion factor xy (px -> m):")
        xy, marked, uv = xy.partition("conversion factor uv (px/frame -> m/s):")
        if not marked:
            continue
        # m in a pixel, and m/s in a pixel per frame
        length, (velocity, rest) = units.measure(xy)[0], units.measure(uv)
        if length is None or velocity is None or rest.startswith("."):
            raise _refusal(f"{where}, line {i + 1}", "has conversion factors that are no numbers")
        stated = Setting(
            length_unit=columns[0][1] or "m",
            velocity_unit="m/frame" if length == velocity else columns[2][1] or "m/s",
        )
        if length == velocity == 1:
            stated = Setting(length_unit="px", velocity_unit="px/frame")
    return Header(first=len(header), columns=columns, stated=stated)


def _is_pivlab(head: bytes) -> bool:
    first = head.split(b"\n")[0]
    return first.startswith((b"PIVlab", b"FRAME:")) or (b"[" in first and b"Vector type" in first)


def dantec(lines: list[str], where: str) -> Header:
    """Dantec DynamicStudio, CSV or TAB: ``>>*HEADER*<<``, ``>>*DATA*<<``, a line of names, rows.

    Written after descriptions of the format, without an export of the software.
    """
    marks = [i for i, line in enumerate(lines) if line.strip().strip(";,").startswith(DANTEC_DATA)]
    if len(marks) != 1 or marks[0] + 2 >= len(lines):
        what = f"has {len(marks)} lines {DANTEC_DATA} with rows after them"
        raise _refusal(where, what, "export one field per file")
    at = marks[0] + 1
    separator = next((sign for sign in "\t;," if sign in lines[at]), ",")
    # a displacement in pixels or metres is one between the images of a pair
    columns = [
        (name, unit if unit is None or "/" in unit or name[:1] not in "UVuv" else f"{unit}/frame")
        for name, unit in _named(lines[at].strip().strip(separator).split(separator))
    ]
    size = re.search(
        r"GridSize\s*+[:;]\s*+\{?\s*+Width\s*+=\s*+(\d{1,9})\s*+,\s*+Height\s*+=\s*+(\d{1,9})\b",
        "\n".join(lines[: at - 1]),
    )
    promised = (int(size[1]), int(size[2])) if size else ()
    return Header(first=at + 1, columns=columns, promised=promised)


# ---- binary files, in the guarded process


def _open_hdf5(path: Path) -> Any:
    """An HDF5 file that keeps all its data in itself, by h5py."""
    file = library("h5py", "netcdf").File(path, "r")
    notes: list[str] = []
    datasets(file, notes)
    if notes:
        raise _refusal(path, notes[0].split(", and was not")[0], "copy the data into one file")
    return file


def pivlab_fields(path: Path) -> Iterator[Raw]:
    """Every field of a PIVlab file: version 5 by scipy, version 7.3 (HDF5) by h5py.

    Variables x, y, u_filtered (else u_original), v_..., typevector_... as cells, one per pair; or
    numbered, x_0, u_0. With a text `units` the arrays are in those units; else they are in pixels,
    `calxy` is m per pixel and `caluv` (m/s) per (px/frame).
    """
    variables = _version_5(path) if head_of(path, len(V5)) == V5 else _version_73(path)
    stem = next((s for s in ("u_filtered", "u_original", "u") if variables.get(s)), None)
    if stem is None or "x" not in variables or "y" not in variables:
        held = ", ".join(sorted(variables)) or "nothing"
        what = f"holds {held}, not PIVlab's x, y and u_original"
        raise _refusal(path, what, "save the PIVlab session")
    v, flags = variables.get("v" + stem[1:], []), variables.get("typevector" + stem[1:], [])
    stated = _pivlab_units(variables, path)
    for i, u in enumerate(variables[stem]):
        if i >= len(v) or i >= len(flags) or flags[i].shape != u.shape:
            what = "lacks v or its vector types"
            raise _refusal(f"{path}, field {i + 1}", what, "save the session again")
        x, y = (variables[name][min(i, len(variables[name]) - 1)] for name in "xy")
        yield Raw(
            *(np.asarray(a, dtype=float).ravel() for a in (x, y, u, v[i])),
            good=np.asarray(flags[i]).ravel() == MEASURED["vector type"],
            stated=stated,
        )


def _pivlab_units(variables: Mapping[str, Sequence[Any]], path: Path) -> Setting:
    if variables.get("units"):
        said = str(variables["units"][0])
        stated = re.findall(r"\[([^\[\]]+)\]", said)
        if len(stated) != 2:
            raise _refusal(path, f"has units {said!r}", "PIVlab writes '[m] respectively [m/s]'")
        return Setting(length_unit=stated[0], velocity_unit=stated[1])
    xy, uv = (
        float(np.ravel(variables[name][0])[0]) if variables.get(name) else 1.0
        for name in ("calxy", "caluv")
    )
    calibrated = xy != 1 and uv != 1 and xy > 0 and uv > 0
    return Setting(
        length_unit="px",
        velocity_unit="px/frame",
        scale_m=xy if calibrated else None,
        frame_time_s=xy / uv if calibrated and xy != uv else None,
    )


def _version_5(path: Path) -> dict[str, list[Any]]:
    from scipy.io import loadmat

    content = loadmat(path, squeeze_me=False, chars_as_strings=True)
    arrays = {name: np.asarray(a) for name, a in content.items() if not name.startswith("__")}
    return {name: list(a.ravel()) if a.dtype.kind in "USO" else [a] for name, a in arrays.items()}


def _version_73(path: Path) -> dict[str, list[Any]]:
    variables: dict[str, list[Any]] = {}
    with _open_hdf5(path) as file:
        arrays = {name: item for name, item in file.items() if hasattr(item, "shape")}
        # numbered ones in their order: x_0, x_1, ..., x_10
        for name in sorted(arrays, key=lambda name: (len(name), name)):
            item, number = arrays[name], re.fullmatch(r"(x|y|u|v|typevector)_\d+", name)
            if number:
                variables.setdefault(number[1], []).append(item[...])
            elif name == "units":
                variables[name] = ["".join(chr(c) for c in np.ravel(item[...]))]
            elif item.dtype == object:
                variables[name] = [file[reference][...] for reference in np.ravel(item[...])]
            else:
                variables[name] = [item[...]]
    return variables


def netcdf_fields(path: Path) -> Iterator[Raw]:
    """Every time of a netCDF file in pivpy's layout, in order.

    The layout has dimensions x, y, t, variables u, v and the choice code chc (1 is measured). Units
    are attributes.
    """
    if head_of(path, 3) == b"CDF":
        remedy = "write netCDF-4: dataset.to_netcdf(path, engine='h5netcdf')"
        raise _refusal(path, "is classic netCDF", remedy)
    _open_hdf5(path).close()
    # h5netcdf knows dimensions
    with library("h5netcdf", "netcdf").File(path, "r") as dataset:
        variables = dataset.variables
        if lacking := [n for n in ("x", "y", "u", "v") if n not in variables]:
            raise _refusal(
                path,
                f"has no {', '.join(lacking)}, but {', '.join(sorted(variables))}",
                "write a field in pivpy's layout: u, v on x, y, t",
            )
        x, y = (np.asarray(variables[n][...], dtype=float) for n in "xy")
        u, v = (_frames(variables[n], n, path) for n in "uv")
        chc, mask = (
            _frames(variables[n], n, path) if n in variables else np.full(u.shape, usual)
            for n, usual in (("chc", 1.0), ("mask", 0.0))
        )
        frame = float(np.ravel(dataset.attrs.get("delta_t", 0.0))[0])
        stated = Setting(
            length_unit=_unit_of(variables["x"]),
            velocity_unit=_unit_of(variables["u"]),
            frame_time_s=frame or None,
        )
    across, up = np.meshgrid(x, y)
    for i in range(len(u)):
        good = ((chc[i] == 1) & (mask[i] != 1)).ravel()
        yield Raw(*(a.ravel() for a in (across, up, u[i], v[i])), good=good, stated=stated)


def _frames(variable: Any, name: str, path: Path) -> FloatArray:
    """A variable as (t, y, x)."""
    dims = tuple(variable.dimensions)
    values = np.asarray(variable[...], dtype=float)
    if sorted(dims) == ["x", "y"]:
        values, dims = values[None], ("t", *dims)
    if sorted(dims) != ["t", "x", "y"]:
        what = f"has {name} on {', '.join(dims)}"
        raise _refusal(path, what, "pivpy's layout is u, v on x, y, t")
    return np.transpose(values, [dims.index(d) for d in ("t", "y", "x")])


def _unit_of(variable: Any) -> str | None:
    stated = variable.attrs.get("units", "")
    return (stated.decode() if isinstance(stated, bytes) else str(stated)) or None


# ---- the table of dialects


def _is_insight(head: bytes) -> bool:
    return head.lstrip().startswith(b"TITLE=") and b"VARIABLES=" in head and b'"CHC"' in head


def _is_pivlab_mat(head: bytes) -> bool:
    return head.startswith((V5, V73)) or (head.startswith(MAGIC) and b"typevector" in head)


def _is_netcdf(head: bytes) -> bool:
    return (head.startswith(MAGIC) and b"typevector" not in head) or head.startswith(b"CDF")


_TABLE: tuple[tuple[str, str, Callable[[bytes], object], dict[str, Any]], ...] = (
    ("insight", "TSI Insight .vec", _is_insight, {"header": insight}),
    ("davis", "LaVision DaVis text", re.compile(rb"#DaVis").match, {"header": davis}),
    ("openpiv", "OpenPIV text, with or without header", _is_openpiv, {"header": openpiv}),
    ("pivlab", "PIVlab ASCII chart", _is_pivlab, {"header": pivlab}),
    (
        "dantec",
        "Dantec DynamicStudio export, CSV or TAB",
        re.compile(rb"\s*>>\*HEADER\*<<").match,
        {"header": dantec},
    ),
    (
        "pivlab_mat",
        "PIVlab MATLAB file, version 5 or 7.3",
        _is_pivlab_mat,
        {"fields": pivlab_fields},
    ),
    ("netcdf", "netCDF in pivpy's layout", _is_netcdf, {"fields": netcdf_fields}),
)
DIALECTS = {
    name: GridDialect(name=name, title=title, recognises=recognises, **reading)
    for name, title, recognises, reading in _TABLE
}


def dialect_of(name: str) -> GridDialect:
    """The dialect of that name; `ManifestError` with the nearest if there is none."""
    if name not in DIALECTS:
        near = did_you_mean(name, DIALECTS) or f"formats are {', '.join(DIALECTS)}"
        raise ManifestError("piv.format", f"there is no format {name!r}", near)
    return DIALECTS[name]


def claimed_by(path: Path) -> GridDialect:
    """The one dialect that claims a file; `InputRefused` where none does, or more than one."""
    head = head_of(path, HEAD)
    if head.startswith(UTF16):
        head = head[: len(head) // 2 * 2].decode("utf-16", errors="replace").encode()
    head = head.removeprefix(b"\xef\xbb\xbf")
    if b"\0" not in head:
        head = head.replace(b"\r\n", b"\n")
    if not head:
        raise _refusal(path, "is empty")
    claimed = [d for d in DIALECTS.values() if d.recognises(head)]
    if len(claimed) != 1:
        what = f"could be {' or '.join(d.name for d in claimed)}"
        raise _refusal(
            path,
            what if claimed else "is of no known format",
            f'say format = "..." under [piv]; formats are {", ".join(DIALECTS)}',
        )
    return claimed[0]


# ---- fields as they are in a file


def raws(path: Path, dialect: GridDialect) -> Iterator[Raw]:
    """The fields of one file as they are in it.

    `InputRefused` as by the dialect's own reader, or where that crashed or came to a limit.
    """
    if dialect.fields is None:
        yield from dialect.read(path)
        return
    done, more = 0, True
    while more:
        try:
            fields, more = guarded.run(some_fields, dialect.name, path, done)
        except Malformed as fault:
            raise _refusal(path, str(fault)) from None
        yield from fields
        done += len(fields)


def some_fields(name: str, path: Path, first: int) -> tuple[list[Raw], bool]:
    """The fields of a file from number `first` on, as many as one answer may hold, and whether
    there are more.
    """
    fields: list[Raw] = []
    size = 0
    for raw in itertools.islice(dialect_of(name).read(path), first, None):
        if size > ANSWER:
            return fields, True
        fields.append(raw)
        size += sum(np.asarray(a).nbytes for a in (raw.x, raw.y, raw.u, raw.v, raw.good))
    return fields, False
