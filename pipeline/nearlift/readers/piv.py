"""Exported velocity grids: a table of dialects, their fields in SI, and the files of a case.

A text dialect is a function from a file's lines to its `Header`; one reader of text takes them all.
A number that a header states must agree with the manifest. A vector that is exactly (0, 0) is
missing: correlating software writes it where it found nothing.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

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
PIXEL, FRAME = ("px", "pix", "pixel", "pixels"), ("frame", "frames", "dt", "pair")
#: Columns that mark measured vectors, with the value that means measured. Insight, OpenPIV's two,
#: PIVlab, Dantec.
MEASURED = {"chc": 1, "flags": 0, "mask": 0, "vector type": 1, "status": 0}
UTF16 = (b"\xff\xfe", b"\xfe\xff")

#: Name and unit of a column; None where the file states no unit.
Column = tuple[str, str | None]


class Setting(NamedTuple):
    """Units, m per pixel, s between two images, as a file or the manifest states them; None: not
    stated.
    """

    length_unit: str | None = None
    velocity_unit: str | None = None
    scale_m: float | None = None
    frame_time_s: float | None = None


class Raw(NamedTuple):
    """One field as a file holds it, rows (n,) in any order, measured vectors, and stated units.

    v is positive along the file's y unless the manifest says otherwise.
    """

    x: FloatArray
    y: FloatArray
    u: FloatArray
    v: FloatArray
    good: BoolArray
    stated: Setting


class Header(NamedTuple):
    """The content of a text's header: index of the first data line, and columns.

    `stated` are units besides those of columns, `promised` the nodes across and up.
    """

    first: int
    columns: Sequence[Column]
    stated: Setting = Setting()
    promised: tuple[int, ...] = ()


def _refusal(where: object, what: str, remedy: str = "export it again") -> InputRefused:
    return InputRefused(str(where), what, remedy)


# ---- headers of text dialects


def _columns(cells: Sequence[str]) -> list[Column]:
    """Name and unit of headings such as ``u [m/s]`` and ``X (mm)[mm]``."""
    columns: list[Column] = []
    for plain in (cell.strip().strip('"') for cell in cells):
        name, bracket, unit = plain.rpartition("[")
        stated = bracket and unit.endswith("]")
        columns.append((name.partition("(")[0].strip(), unit[:-1]) if stated else (plain, None))
    return columns


def openpiv(lines: list[str], where: str) -> Header:
    """OpenPIV: ``# x y u v flags mask``, or five columns without a header, of which the last is the
    signal-to-noise ratio. The files state no unit.
    """
    if lines[0].startswith("#"):
        return Header(1, [(name, None) for name in lines[0].lstrip("# ").split()])
    if {row.split()[-1] for row in lines if row.strip()} <= {"0", "1", "2"}:
        what = "has a fifth column of flags, and no header says whether 0 or 1 is a good vector"
        remedy = 'save it with a header, or say format = "pivlab" if PIVlab wrote it'
        raise _refusal(where, what, f"{remedy} (there 1 is good)")
    return Header(0, [(name, None) for name in ("x", "y", "u", "v", "s2n")])


def insight(lines: list[str], where: str) -> Header:
    """TSI Insight: one Tecplot line, with um per pixel and us between images, then comma rows x, y,
    u, v, CHC.
    """
    listed = re.search(r"VARIABLES=((?:\s*\"[^\"]*\",?)+)", lines[0])
    names = re.findall(r'"([^" ]*) ?([^"]*)"', listed[1]) if listed else []
    stated: list[float | None] = []
    for key in ("MicrometersPerPixelX", "MicrosecondsPerDeltaT"):
        text, end, _ = lines[0].partition(f'{key}="')[2].partition('"')
        if end and not units.NUMBER.fullmatch(text):
            raise _refusal(f"{where}, line 1", f"has {key} {text!r}, which is no number")
        stated.append(1e-6 * float(text) if end and float(text) > 0 else None)
    return Header(1, [(name, unit or None) for name, unit in names], Setting(None, None, *stated))


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
    return Header(1, columns, promised=(int(size[1]), int(size[2])))


def pivlab(lines: list[str], where: str) -> Header:
    """PIVlab's ASCII chart: up to three header lines, then x, y, u, v, vector type and more.

    Conversion factors win over the units of the third line: PIVlab writes m/s above displacements
    in metres, and then both factors are equal.
    """
    header = [line for line in lines[:3] if re.match(r"\s*(PIVlab|FRAME:|x\s*\[)", line)]
    listed = [line for line in header if re.match(r"\s*x\s*\[", line)]
    if listed:
        columns = _columns(re.split(r"[,;\t]", listed[0]))
    else:
        data = next((line for line in lines[len(header) :] if line.strip()), "")
        more = len(re.split(r"[,\t]| +", data.strip())) - 5
        columns = [(name, None) for name in ("x", "y", "u", "v", "vector type", *[""] * more)]
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
        stated = Setting(columns[0][1] or "m", displaced)
        if length == velocity == 1:
            stated = Setting("px", "px/frame")
    return Header(len(header), columns, stated)


def dantec(lines: list[str], where: str) -> Header:
    """Dantec DynamicStudio, CSV or TAB: ``>>*HEADER*<<``, ``>>*DATA*<<``, a line of names, rows.

    Written after descriptions of the format, without an export of the software.
    """
    mark = ">>*DATA*<<"
    marks = [i for i, line in enumerate(lines) if line.strip().strip(";,").startswith(mark)]
    if len(marks) != 1 or marks[0] + 2 >= len(lines):
        what = f"has {len(marks)} lines {mark} with rows after them"
        raise _refusal(where, what, "export one field per file")
    above, names = "\n".join(lines[: marks[0]]), lines[marks[0] + 1]
    separator = next((sign for sign in "\t;," if sign in names), ",")
    # a displacement in pixels or metres is one between the images of a pair
    columns = [
        (name, unit if unit is None or "/" in unit or name[:1] not in "UVuv" else f"{unit}/frame")
        for name, unit in _columns(names.strip().strip(separator).split(separator))
    ]
    size = re.search(
        r"GridSize\s*+[:;]\s*+\{?\s*+Width\s*+=\s*+(\d{1,9})\s*+,\s*+Height\s*+=\s*+(\d{1,9})\b",
        above,
    )
    promised = (int(size[1]), int(size[2])) if size else ()
    return Header(marks[0] + 2, columns, promised=promised)


# ---- the one reader of text


def text_field(path: Path, header_of: Callable[[list[str], str], Header]) -> Raw:
    """The one field of a text file, its columns found by the header's names and units."""
    if not (content := content_of(path)):
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
    columns = _numbers(path, lines[header.first :], header)
    names = [name.strip().lower() for name, _ in header.columns]
    good = np.ones(len(columns[0]), bool)
    for name, values in zip(names, columns, strict=True):
        if name in MEASURED:
            good &= values == MEASURED[name]
        elif name == "s2n":
            good &= np.isfinite(values)
    places = [_place(header.columns, letter, path) for letter in "xyuv"]
    stated = header.stated._replace(
        length_unit=header.stated.length_unit or header.columns[places[0]][1],
        velocity_unit=header.stated.velocity_unit or header.columns[places[2]][1],
    )
    x, y, u, v = (columns[i] for i in places)
    return Raw(x, y, u, v, good, stated)


def _numbers(path: Path, lines: Sequence[str], header: Header) -> list[FloatArray]:
    """The columns below a header (n,); refuses other rows than promised."""
    rows = [line.strip() for line in lines]
    if not (data := next(filter(None, rows), "")):
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
        columns, _ = parse(whole, layout, range(count))
    except InputRefused as bad:
        raise _refusal(bad.where, bad.what, "export it again, with decimal points") from None
    if count != len(header.columns):
        what = f"has {count} columns where the header names {len(header.columns)}"
        raise _refusal(f"{path}, line {header.first + 1}", what)
    wide, high = header.promised or (len(columns[0]), 1)
    if len(columns[0]) != wide * high:
        promised = f"its header promises {wide} x {high} vectors"
        what = f"has {len(columns[0])} rows of {count}, {promised}"
        raise _refusal(path, what, "it was cut off: export it again")
    return columns


def _place(columns: Sequence[Column], letter: str, where: Path) -> int:
    """Place of a coordinate or component: in metres rather than in pixels, with a unit first."""
    fitting = [
        (unit is None, _plain(unit or "").startswith("px"), i)
        for i, (name, unit) in enumerate(columns)
        # Dantec's U pix[pix] names the unit twice
        if name.lower().split()[:1] == [letter]
    ]
    if not fitting:
        what = f"names no column {letter.upper()} among {', '.join(name for name, _ in columns)}"
        raise _refusal(where, what, "export positions and components with units")
    return min(fitting)[-1]


# ---- binary files, in the guarded process


def _open_hdf5(path: Path) -> Any:
    """An HDF5 file that keeps all its data in itself, by h5py."""
    file = library("h5py", "netcdf").File(path, "r")
    for note in datasets(file)[1]:
        raise _refusal(path, note.split(", and was not")[0], "copy the data into one file")
    return file


def pivlab_fields(path: Path) -> Iterator[Raw]:
    """Every field of a PIVlab file: version 5 by scipy, version 7.3 (HDF5) by h5py.

    Variables x, y, u_filtered (else u_original), v_..., typevector_... as cells, one per pair; or
    numbered, x_0, u_0. With a text `units` the arrays are in those units; else they are in pixels,
    `calxy` is m per pixel and `caluv` (m/s) per (px/frame).
    """
    held = _version_5(path) if head_of(path, len(V5)) == V5 else _version_73(path)
    stem = next((s for s in ("u_filtered", "u_original", "u") if held.get(s)), None)
    if stem is None or "x" not in held or "y" not in held:
        what = f"holds {', '.join(sorted(held)) or 'nothing'}, not PIVlab's x, y and u_original"
        raise _refusal(path, what, "save the PIVlab session")
    stated = _pivlab_units(held, path)
    fields = itertools.zip_longest(
        held[stem], held.get("v" + stem[1:], []), held.get("typevector" + stem[1:], [])
    )
    for i, (u, v, flags) in enumerate(itertools.islice(fields, len(held[stem]))):
        if v is None or flags is None or flags.shape != u.shape:
            what = "lacks v or its vector types"
            raise _refusal(f"{path}, field {i + 1}", what, "save the session again")
        x, y = (held[name][min(i, len(held[name]) - 1)] for name in "xy")
        x, y, u, v = (np.ravel(np.asarray(a, float)) for a in (x, y, u, v))
        yield Raw(x, y, u, v, np.ravel(flags) == MEASURED["vector type"], stated)


def _pivlab_units(held: Mapping[str, Sequence[Any]], path: Path) -> Setting:
    if held.get("units"):
        said = str(held["units"][0])
        if len(stated := re.findall(r"\[([^\[\]]+)\]", said)) != 2:
            raise _refusal(path, f"has units {said!r}", "PIVlab writes '[m] respectively [m/s]'")
        return Setting(*stated)
    xy, uv = (float(np.ravel(held.get(name) or 1.0)[0]) for name in ("calxy", "caluv"))
    if not (xy != 1 and uv != 1 and xy > 0 and uv > 0):
        return Setting("px", "px/frame")
    return Setting("px", "px/frame", xy, xy / uv if xy != uv else None)


def _version_5(path: Path) -> dict[str, list[Any]]:
    from scipy.io import loadmat

    arrays = {name: np.asarray(a) for name, a in loadmat(path).items() if name[:2] != "__"}
    return {name: list(a.ravel()) if a.dtype.kind in "USO" else [a] for name, a in arrays.items()}


def _version_73(path: Path) -> dict[str, list[Any]]:
    held: dict[str, list[Any]] = {}
    with _open_hdf5(path) as file:
        arrays = {name: item for name, item in file.items() if hasattr(item, "shape")}
        # numbered ones in their order: x_0, x_1, ..., x_10
        for name in sorted(arrays, key=lambda name: (len(name), name)):
            values, number = arrays[name][...], re.fullmatch(r"(x|y|u|v|typevector)_\d+", name)
            if number:
                held.setdefault(number[1], []).append(values)
            elif name == "units":
                held[name] = ["".join(map(chr, np.ravel(values)))]
            elif values.dtype == object:
                held[name] = [file[reference][...] for reference in np.ravel(values)]
            else:
                held[name] = [values]
    return held


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
        held = dataset.variables
        if lacking := [n for n in "xyuv" if n not in held]:
            what = f"has no {', '.join(lacking)}, but {', '.join(sorted(held))}"
            raise _refusal(path, what, "write a field in pivpy's layout: u, v on x, y, t")
        across, up = np.meshgrid(*(np.asarray(held[n][...], float) for n in "xy"))
        u, v = (_frames(held[n], n, path) for n in "uv")
        good = np.ones(u.shape, bool)
        if "chc" in held:
            good &= _frames(held["chc"], "chc", path) == 1
        if "mask" in held:
            good &= _frames(held["mask"], "mask", path) != 1
        frame_time_s = float(np.ravel(dataset.attrs.get("delta_t", 0.0))[0]) or None
        stated = Setting(_unit_of(held["x"]), _unit_of(held["u"]), None, frame_time_s)
    for i in range(len(u)):
        x, y = across.ravel(), up.ravel()
        yield Raw(x, y, u[i].ravel(), v[i].ravel(), good[i].ravel(), stated)


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


class GridDialect(NamedTuple):
    """One outside format: a title, whether first bytes are of it, and how it is read.

    A text has a function of its header. A binary file has one of its fields, which the guarded
    process runs. No two dialects claim one file.
    """

    title: str
    recognises: Callable[[bytes], object]
    header: Callable[[list[str], str], Header] | None = None
    fields: Callable[[Path], Iterator[Raw]] | None = None


def _is_openpiv(head: bytes) -> bool:
    first = head.split(b"\n")[0].decode("latin-1")
    if first.startswith("#"):
        return first.lstrip("# ").split()[:4] == ["x", "y", "u", "v"]
    cells = first.split()
    return len(cells) == 5 and all(map(units.NUMBER.fullmatch, cells))


def _is_pivlab(head: bytes) -> bool:
    first = head.split(b"\n")[0]
    return first.startswith((b"PIVlab", b"FRAME:")) or (b"[" in first and b"Vector type" in first)


def _is_pivlab_mat(head: bytes) -> bool:
    return head.startswith((V5, V73)) or (head.startswith(MAGIC) and b"typevector" in head)


def _is_netcdf(head: bytes) -> bool:
    return head.startswith(b"CDF") or (head.startswith(MAGIC) and b"typevector" not in head)


_IS_INSIGHT = re.compile(rb'\s*TITLE=(?=[^\n]*VARIABLES=)(?=[^\n]*"CHC")')
_IS_DANTEC = re.compile(rb"\s*>>\*HEADER\*<<")
DIALECTS = {
    "insight": GridDialect("TSI Insight .vec", _IS_INSIGHT.match, insight),
    "davis": GridDialect("LaVision DaVis text", re.compile(rb"#DaVis").match, davis),
    "openpiv": GridDialect("OpenPIV text, with or without header", _is_openpiv, openpiv),
    "pivlab": GridDialect("PIVlab ASCII chart", _is_pivlab, pivlab),
    "dantec": GridDialect("Dantec DynamicStudio export, CSV or TAB", _IS_DANTEC.match, dantec),
    "pivlab_mat": GridDialect(
        "PIVlab MATLAB file, version 5 or 7.3", _is_pivlab_mat, fields=pivlab_fields
    ),
    "netcdf": GridDialect("netCDF in pivpy's layout", _is_netcdf, fields=netcdf_fields),
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
    if (header := DIALECTS[name].header) is not None:
        yield text_field(path, header)
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
    """The fields of a binary file from number `first` on, as many as one answer may hold, and
    whether there are more.
    """
    read = DIALECTS[name].fields
    assert read is not None
    fields: list[Raw] = []
    size = 0
    for raw in itertools.islice(read(path), first, None):
        if size > ANSWER:
            return fields, True
        fields.append(raw)
        size += 4 * raw.u.nbytes + raw.good.nbytes
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
        length_unit=_agreed(raw.stated, setting, "length_unit", where),
        velocity_unit=_agreed(raw.stated, setting, "velocity_unit", where),
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
    velocities = tuple(np.where(good, per_velocity * values, np.nan) for values in (raw.u, raw.v))
    x, y, (vx, vy) = on_grid(per_length * raw.x, per_length * raw.y, velocities, where)
    return VelocityField(x_m=x, y_m=y, vx_m_s=vx, vy_m_s=vy)


def _agreed(file: Setting, manifest: Setting, key: str, where: str) -> str:
    """The unit that the file or the manifest states; both must agree."""
    stated, given = getattr(file, key), getattr(manifest, key)
    if stated is None and given is None:
        what = f"does not say its {key.replace('_', ' ')}"
        example = '"mm"' if key == "length_unit" else '"m/s" (or "px/frame")'
        raise _refusal(where, what, f"add {key} = {example} under [piv]")
    if None not in (stated, given) and _plain(stated) != _plain(given):
        what = f"says {stated!r} where the manifest's {key} is {given!r}"
        raise _refusal(where, what, f"leave {key} out, or export in {given!r}")
    return _plain(given if stated is None else stated)


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
        setting = Setting(*map(said, ("length_unit", "velocity_unit", "scale", "frame_time")))
        lie = {name: said(name) for name in ("thrust", "across")}
        lie |= {"origin_m": said("origin"), "v_sign": said("v_sign", 1)}
        for path in self.files:
            try:
                for one in read(path, setting, said("format")):
                    yield masked(orient(one, **lie), said("mask", []))
            except InputRefused as refusal:
                self.refused.append((source_of(self.root, path), refusal))
