"""Exported velocity grids: a table of dialects, their fields in SI, and the files of a case.

A text dialect is a function from a header to the names and units of columns; one reader of text
takes them all. A number that a header states must agree with the manifest. A vector that is exactly
(0, 0) is missing: correlating software writes it where it found nothing.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from nearlift import units
from nearlift.campaign.piv import Piv, PivCase
from nearlift.declare import BoolArray, FloatArray
from nearlift.errors import InputRefused, ManifestError, did_you_mean
from nearlift.flow.field import VelocityField, masked, on_grid, orient
from nearlift.readers import guarded
from nearlift.readers.base import library
from nearlift.readers.files import content_of, head_of, inside, source_of
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Raw:
    """One field as a file holds it, rows (n,) in any order, and what the file states of units.

    v is positive along the file's y unless the manifest says otherwise. `good` marks measured
    vectors.
    """

    x: FloatArray
    y: FloatArray
    u: FloatArray
    v: FloatArray
    good: BoolArray
    stated: Setting


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """The content of a text's header: the index of the first data line, and name and unit of each
    column.

    `promised` are the nodes across and up, empty where not stated. `stated` are the units that it
    gives besides those of columns.
    """

    first: int
    columns: Sequence[tuple[str, str | None]]
    promised: tuple[int, ...] = ()
    stated: Setting = field(default_factory=Setting)


@dataclass(frozen=True, slots=True, kw_only=True)
class GridDialect:
    """One outside format: a title, whether first bytes are of it, and the fields of a file.

    A binary file is read in the `guarded` process. No two dialects claim one file.
    """

    title: str
    recognises: Callable[[bytes], object]
    fields: Callable[[Path], Iterator[Raw]]
    guarded: bool = False


def _refusal(where: object, what: str, remedy: str = "export it again") -> InputRefused:
    return InputRefused(str(where), what, remedy)


# ---- text


def _of_text(header_of: Callable[[list[str], str], Header], path: Path) -> Iterator[Raw]:
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
    table = _table(path, lines[header.first :], header)
    names = [name.strip().lower() for name, _ in header.columns]
    good = np.ones(len(table), bool)
    if "s2n" in names:
        good = np.isfinite(table[:, names.index("s2n")])
    for name in MEASURED.keys() & {*names}:
        good &= table[:, names.index(name)] == MEASURED[name]
    places = {letter: _place(header, letter, path) for letter in "xyuv"}
    stated = replace(
        header.stated,
        length_unit=header.stated.length_unit or header.columns[places["x"]][1],
        velocity_unit=header.stated.velocity_unit or header.columns[places["u"]][1],
    )
    columns = {letter: table[:, place] for letter, place in places.items()}
    yield Raw(**columns, good=good, stated=stated)


def _table(path: Path, lines: Sequence[str], header: Header) -> FloatArray:
    """The numbers below a header, a row for each vector; refuses other rows than promised."""
    rows = [line.strip() for line in lines]
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
    except InputRefused as bad:
        raise _refusal(bad.where, bad.what, "export it again, with decimal points") from None
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
        (unit is None, _plain(unit or "").startswith("px"), i)
        for i, (name, unit) in enumerate(header.columns)
        # Dantec's U pix[pix] names the unit twice
        if name.lower().split()[:1] == [letter]
    ]
    if not fitting:
        named = ", ".join(name for name, _ in header.columns)
        what = f"names no column {letter.upper()} among {named}"
        raise _refusal(where, what, "export positions and components with units")
    return min(fitting)[-1]


def _named(cells: Sequence[str]) -> list[tuple[str, str | None]]:
    """Name and unit of headings such as ``u [m/s]`` and ``X (mm)[mm]``."""
    named: list[tuple[str, str | None]] = []
    for plain in (cell.strip().strip('"') for cell in cells):
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
        what = "has a fifth column of flags, and no header says whether 0 or 1 is a good vector"
        remedy = 'save it with a header, or say format = "pivlab" if PIVlab wrote it'
        raise _refusal(where, what, f"{remedy} (there 1 is good)")
    return Header(first=0, columns=[(name, None) for name in ("x", "y", "u", "v", "s2n")])


def _is_openpiv(head: bytes) -> bool:
    first = head.split(b"\n")[0].decode("latin-1")
    if first.startswith("#"):
        return first.lstrip("# ").split()[:4] == ["x", "y", "u", "v"]
    cells = first.split()
    return len(cells) == 5 and all(map(units.NUMBER.fullmatch, cells))


def insight(lines: list[str], where: str) -> Header:
    """TSI Insight: one Tecplot line, with um per pixel and us between images, then comma rows x, y,
    u, v, CHC.
    """
    listed = re.search(r"VARIABLES=((?:\s*\"[^\"]*\",?)+)", lines[0])
    names = re.findall(r'"([^" ]*) ?([^"]*)"', listed[1]) if listed else []
    keys = {"scale_m": "MicrometersPerPixelX", "frame_time_s": "MicrosecondsPerDeltaT"}
    stated: dict[str, Any] = {}
    for name, key in keys.items():
        text, end, _ = lines[0].partition(f'{key}="')[2].partition('"')
        if end and not units.NUMBER.fullmatch(text):
            raise _refusal(f"{where}, line 1", f"has {key} {text!r}, which is no number")
        stated[name] = 1e-6 * float(text) if end and float(text) > 0 else None
    columns = [(name, unit or None) for name, unit in names]
    return Header(first=1, columns=columns, stated=Setting(**stated))


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
    listed = [line for line in header if re.match(r"\s*x\s*\[", line)]
    if listed:
        columns = _named(re.split(r"[,;\t]", listed[0]))
    else:
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
        displaced = "m/frame" if length == velocity else columns[2][1] or "m/s"
        stated = Setting(length_unit=columns[0][1] or "m", velocity_unit=displaced)
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
        what = (
            f"holds {', '.join(sorted(variables)) or 'nothing'}, not PIVlab's x, y and u_original"
        )
        raise _refusal(path, what, "save the PIVlab session")
    v, flags = variables.get("v" + stem[1:], []), variables.get("typevector" + stem[1:], [])
    stated = _pivlab_units(variables, path)
    for i, u in enumerate(variables[stem]):
        if i >= len(v) or i >= len(flags) or flags[i].shape != u.shape:
            what = "lacks v or its vector types"
            raise _refusal(f"{path}, field {i + 1}", what, "save the session again")
        x, y = (variables[name][min(i, len(variables[name]) - 1)] for name in "xy")
        columns = {
            k: np.ravel(np.asarray(a, float)) for k, a in zip("xyuv", (x, y, u, v[i]), strict=True)
        }
        yield Raw(**columns, good=np.ravel(flags[i]) == MEASURED["vector type"], stated=stated)


def _pivlab_units(variables: Mapping[str, Sequence[Any]], path: Path) -> Setting:
    if variables.get("units"):
        said = str(variables["units"][0])
        stated = re.findall(r"\[([^\[\]]+)\]", said)
        if len(stated) != 2:
            raise _refusal(path, f"has units {said!r}", "PIVlab writes '[m] respectively [m/s]'")
        return Setting(length_unit=stated[0], velocity_unit=stated[1])
    xy, uv = (float(np.ravel(variables.get(name) or 1.0)[0]) for name in ("calxy", "caluv"))
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
            values, number = arrays[name][...], re.fullmatch(r"(x|y|u|v|typevector)_\d+", name)
            if number:
                variables.setdefault(number[1], []).append(values)
            elif name == "units":
                variables[name] = ["".join(map(chr, np.ravel(values)))]
            elif values.dtype == object:
                variables[name] = [file[reference][...] for reference in np.ravel(values)]
            else:
                variables[name] = [values]
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
        if lacking := [n for n in "xyuv" if n not in variables]:
            what = f"has no {', '.join(lacking)}, but {', '.join(sorted(variables))}"
            raise _refusal(path, what, "write a field in pivpy's layout: u, v on x, y, t")
        across, up = np.meshgrid(*(np.asarray(variables[n][...], float) for n in "xy"))
        u, v = (_frames(variables[n], n, path) for n in "uv")
        chc, mask = (
            _frames(variables[n], n, path) if n in variables else np.full(u.shape, usual)
            for n, usual in (("chc", 1.0), ("mask", 0.0))
        )
        stated = Setting(
            length_unit=_unit_of(variables["x"]),
            velocity_unit=_unit_of(variables["u"]),
            frame_time_s=float(np.ravel(dataset.attrs.get("delta_t", 0.0))[0]) or None,
        )
    for i in range(len(u)):
        columns = {k: a.ravel() for k, a in zip("xyuv", (across, up, u[i], v[i]), strict=True)}
        yield Raw(**columns, good=((chc[i] == 1) & (mask[i] != 1)).ravel(), stated=stated)


def _frames(variable: Any, name: str, path: Path) -> FloatArray:
    """A variable as (t, y, x)."""
    dims, values = tuple(variable.dimensions), np.asarray(variable[...], dtype=float)
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

DIALECTS = {
    "insight": GridDialect(
        title="TSI Insight .vec",
        recognises=re.compile(rb'\s*TITLE=(?=[^\n]*VARIABLES=)(?=[^\n]*"CHC")').match,
        fields=partial(_of_text, insight),
    ),
    "davis": GridDialect(
        title="LaVision DaVis text",
        recognises=re.compile(rb"#DaVis").match,
        fields=partial(_of_text, davis),
    ),
    "openpiv": GridDialect(
        title="OpenPIV text, with or without header",
        recognises=_is_openpiv,
        fields=partial(_of_text, openpiv),
    ),
    "pivlab": GridDialect(
        title="PIVlab ASCII chart", recognises=_is_pivlab, fields=partial(_of_text, pivlab)
    ),
    "dantec": GridDialect(
        title="Dantec DynamicStudio export, CSV or TAB",
        recognises=re.compile(rb"\s*>>\*HEADER\*<<").match,
        fields=partial(_of_text, dantec),
    ),
    "pivlab_mat": GridDialect(
        title="PIVlab MATLAB file, version 5 or 7.3",
        recognises=lambda head: (
            head.startswith((V5, V73)) or (head.startswith(MAGIC) and b"typevector" in head)
        ),
        fields=pivlab_fields,
        guarded=True,
    ),
    "netcdf": GridDialect(
        title="netCDF in pivpy's layout",
        recognises=lambda head: (
            head.startswith(b"CDF") or (head.startswith(MAGIC) and b"typevector" not in head)
        ),
        fields=netcdf_fields,
        guarded=True,
    ),
}


def claimed_by(path: Path) -> str:
    """Name of the one dialect that claims a file; `InputRefused` where none does, or several."""
    head = head_of(path, HEAD)
    if head.startswith(UTF16):
        head = head[: len(head) // 2 * 2].decode("utf-16", errors="replace").encode()
    head = head.removeprefix(b"\xef\xbb\xbf")
    if b"\0" not in head:
        head = head.replace(b"\r\n", b"\n")
    if not head:
        raise _refusal(path, "is empty")
    claimed = [name for name, dialect in DIALECTS.items() if dialect.recognises(head)]
    if len(claimed) != 1:
        what = f"could be {' or '.join(claimed)}" if claimed else "is of no known format"
        remedy = f'say format = "..." under [piv]; formats are {", ".join(DIALECTS)}'
        raise _refusal(path, what, remedy)
    return claimed[0]


def raws(path: Path, name: str) -> Iterator[Raw]:
    """The fields of one file as they are in it, by the dialect of that name.

    `ManifestError` with the nearest name where there is no such dialect. `InputRefused` as by the
    dialect, or where its library crashed or came to a limit.
    """
    if name not in DIALECTS:
        near = did_you_mean(name, DIALECTS) or f"formats are {', '.join(DIALECTS)}"
        raise ManifestError("piv.format", f"there is no format {name!r}", near)
    if not DIALECTS[name].guarded:
        yield from DIALECTS[name].fields(path)
        return
    done, more = 0, True
    while more:
        try:
            fields, more = guarded.run(some_fields, name, path, done)
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
    for raw in itertools.islice(DIALECTS[name].fields(path), first, None):
        if size > ANSWER:
            return fields, True
        fields.append(raw)
        size += sum(a.nbytes for a in (raw.x, raw.y, raw.u, raw.v, raw.good))
    return fields, False


# ---- fields in SI


def read(
    path: Path, setting: Setting | None = None, format_name: str | None = None
) -> Iterator[VelocityField]:
    """The fields of one file in SI, in the file's own axes; `InputRefused` where it cannot be read,
    or holds no velocities in known units.
    """
    for i, raw in enumerate(raws(path, format_name or claimed_by(path))):
        yield to_si(raw, setting or Setting(), f"{path}, field {i + 1}" if i else str(path))


def to_si(raw: Raw, setting: Setting, where: str) -> VelocityField:
    """A field in SI on its grid, in the file's own axes; NaN where there is no vector.

    Raises
    ------
    InputRefused
        A unit is unknown or contradicts the manifest. Pixels have no scale, or displacements no
        frame time. Every vector is zero or missing. The grid is not rectangular and even.
    """
    known = Setting(
        length_unit=_agreed(raw, setting, "length_unit", where),
        velocity_unit=_agreed(raw, setting, "velocity_unit", where),
        scale_m=raw.stated.scale_m or setting.scale_m,
        frame_time_s=raw.stated.frame_time_s or setting.frame_time_s,
    )
    per_length = _factor(known.length_unit, "length", known, where)
    per_velocity = _factor(known.velocity_unit, "velocity", known, where)
    nothing = (raw.u == 0) & (raw.v == 0)
    good = raw.good & np.isfinite(raw.u) & np.isfinite(raw.v) & ~nothing
    if not good.any():
        zero = len(nothing) and nothing.all()
        what = "every vector is zero" if zero else f"none of its {len(good)} vectors is valid"
        raise _refusal(where, what, "check the mask and the flags of the export")
    columns = (
        np.where(good, per_velocity * raw.u, np.nan),
        np.where(good, per_velocity * raw.v, np.nan),
    )
    x, y, (vx, vy) = on_grid(per_length * raw.x, per_length * raw.y, columns, where)
    return VelocityField(x_m=x, y_m=y, vx_m_s=vx, vy_m_s=vy)


def _agreed(raw: Raw, setting: Setting, key: str, where: str) -> str:
    """The unit of a file or of the manifest; both must agree."""
    stated, manifest = getattr(raw.stated, key), getattr(setting, key)
    if stated is None and manifest is None:
        example = '"mm"' if key == "length_unit" else '"m/s" (or "px/frame")'
        what = f"does not say its {key.replace('_', ' ')}"
        raise _refusal(where, what, f"add {key} = {example} under [piv]")
    if None not in (stated, manifest) and _plain(stated) != _plain(manifest):
        what = f"says {stated!r} where the manifest's {key} is {manifest!r}"
        raise _refusal(where, what, f"leave {key} out, or export in {manifest!r}")
    return _plain(manifest if stated is None else stated)


def _plain(unit: str) -> str:
    text = unit.strip().strip("[]()").replace(" ", "").replace("µ", "u")
    head, _, tail = text.partition("/")
    head = "px" if head.lower() in PIXEL else head
    tail = "frame" if tail.lower() in FRAME else tail
    return f"{head}/{tail}" if tail else head


def _factor(unit: str | None, dimension: str, known: Setting, where: str) -> float:
    """SI value of a unit of length, velocity or displacement, which may be in pixels."""
    assert unit is not None
    head, _, tail = unit.partition("/")
    if dimension == "velocity" and tail in ("frame", ""):
        length = _factor(head, "length", known, where)
        if known.frame_time_s is None:
            what = f"holds displacements ({unit}), not velocities"
            remedy = 'add frame_time = "100 us", the time between a pair\'s images'
            raise _refusal(where, what, remedy)
        return length / known.frame_time_s
    if unit == "px" or (head == "px" and dimension == "velocity"):
        if known.scale_m is None:
            what = "is in pixels, and the size of a pixel is not stated"
            raise _refusal(where, what, 'add scale = "20 um/px" under [piv]')
        return known.scale_m / (_factor(tail, "time", known, where) if tail else 1.0)
    try:
        return units.to_si(unit, dimension, where)[0]
    except ManifestError as refusal:
        raise InputRefused(where, refusal.what, refusal.remedy) from None


# ---- the files of a case


def files_of(root: Path, case: PivCase) -> list[Path]:
    """Every file of a case, in the order of the numbers in their names.

    `ManifestError` where the pattern leads outside the campaign's folder, or matches nothing.
    `InputRefused` where a file leads outside by a link, or is no regular file.
    """
    where = f"piv case {case.name!r}: files"
    if Path(case.files).is_absolute() or ".." in Path(case.files).parts:
        what = f"{case.files!r} leads outside the campaign's folder"
        raise ManifestError(where, what, "put the files themselves into the folder")
    names = [source_of(root, path) for path in root.glob(case.files) if path.is_file()]
    if not names:
        what = f"no file matches {case.files!r} in {root}"
        raise ManifestError(where, what, 'write a pattern such as "piv/ground-3.4/*.txt"')
    return [inside(root, name, where)[0] for name in sorted(names, key=_natural)]


def _natural(name: str) -> list[str | int]:
    # every second part is a number
    return [int(part) if i % 2 else part for i, part in enumerate(re.split(r"(\d+)", name))]


@dataclass
class Stream:
    """The fields of one case, one in memory at a time; `refused` lists files and their reasons."""

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
        for path in self.files:
            try:
                for one in read(path, setting, said("format")):
                    yield masked(orient(one, **lie), said("mask", []))
            except InputRefused as refusal:
                self.refused.append((source_of(self.root, path), refusal))
