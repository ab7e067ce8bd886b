"""Velocity grids in binary files: PIVlab's MATLAB files, and netCDF in pivpy's layout.

PIVlab: version 5 by scipy, version 7.3 (HDF5) by h5py; many fields to a file. Variables x, y,
u_filtered (else u_original), v_..., typevector_... as cells, one per pair; or numbered, x_0, u_0.
With a text `units` the arrays are in those units; else they are in pixels, `calxy` is m per pixel
and `caluv` (m/s) per (px/frame).

netCDF: dimensions x, y, t; variables u, v and the choice code chc (1 is measured); units as
attributes. A vector of zeros is none.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.readers.hdf5 import MAGIC
from nearlift.readers.mat import V5, V73
from nearlift.readers.piv.fields import Dialect, Raw

MEASURED = 1
#: Values in all arrays of a file together; a gigabyte of float64.
MAX_VALUES = 130_000_000


@contextmanager
def open_hdf5(path: Path) -> Iterator[Any]:
    """The file by h5py; `InputRefused` where that is not installed, or the file is damaged, too
    large once unpacked, or links to other files.
    """
    try:
        import h5py
    except ImportError:
        raise InputRefused(
            str(path), "is HDF5, which needs h5py", "pip install nearlift[netcdf]"
        ) from None
    try:
        file = h5py.File(path, "r")
    except OSError as fault:
        raise InputRefused(str(path), f"is damaged: {fault}", "export it again") from None
    with file:
        total = 0
        for name in file:
            if isinstance(file.get(name, getlink=True), h5py.ExternalLink):
                raise InputRefused(
                    str(path), f"{name} is a link to another file", "copy the data into one file"
                )
            item = file[name]
            if isinstance(item, h5py.Dataset):
                if item.is_virtual or item.external:
                    raise InputRefused(
                        str(path),
                        f"{name} keeps its data in another file",
                        "copy the data into one file",
                    )
                total += item.size or 0
        if total > MAX_VALUES:
            raise InputRefused(
                str(path),
                f"unpacks to {total} values",
                f"split it: at most {MAX_VALUES} in one file",
            )
        yield file


def _is_pivlab(head: bytes) -> bool:
    """MATLAB's own first words, or HDF5 with what PIVlab names."""
    return head.startswith((V5, V73)) or (head.startswith(MAGIC) and b"typevector" in head)


def _is_netcdf(head: bytes) -> bool:
    """HDF5 that netCDF-4 wrote, which PIVlab does not; classic netCDF begins with its own name."""
    return (head.startswith(MAGIC) and b"typevector" not in head) or head.startswith(b"CDF")


def read_pivlab(path: Path) -> Iterator[Raw]:
    """Every field of a PIVlab file, in order."""
    with path.open("rb") as file:
        old = file.read(len(V5)) == V5
    variables = _version_5(path) if old else _version_73(path)
    stem = next(
        (s for s in ("u_filtered", "u_original", "u") if s in variables and len(variables[s])), None
    )
    if stem is None or "x" not in variables or "y" not in variables:
        raise InputRefused(
            str(path),
            f"holds {', '.join(sorted(variables)) or 'nothing'}, not PIVlab's x, y and u_original",
            "save the PIVlab session",
        )
    v, flags = variables.get("v" + stem[1:], []), variables.get("typevector" + stem[1:], [])
    length, velocity, scale, frame = _units(variables, path)
    for i, u in enumerate(variables[stem]):
        if i >= len(v) or i >= len(flags) or flags[i].shape != u.shape:
            raise InputRefused(
                f"{path}, field {i + 1}", "lacks v or its vector types", "save the session again"
            )
        x, y = (variables[name][min(i, len(variables[name]) - 1)] for name in "xy")
        yield Raw(
            *(np.asarray(a, dtype=float).ravel() for a in (x, y, u, v[i])),
            good=np.asarray(flags[i]).ravel() == MEASURED,
            length_unit=length,
            velocity_unit=velocity,
            scale_m=scale,
            frame_time_s=frame,
        )


def _units(
    variables: Mapping[str, list[Any]], path: Path
) -> tuple[str, str, float | None, float | None]:
    if variables.get("units"):
        stated = re.findall(r"\[([^\[\]]+)\]", str(variables["units"][0]))
        if len(stated) == 2:
            return stated[0], stated[1], None, None
        raise InputRefused(
            str(path),
            f"has units {variables['units'][0]!r}",
            "PIVlab writes '[m] respectively [m/s]'",
        )
    xy, uv = (
        float(np.ravel(variables[name][0])[0]) if variables.get(name) else 1.0
        for name in ("calxy", "caluv")
    )
    calibrated = xy != 1 and uv != 1 and xy > 0 and uv > 0
    frame_time_s = xy / uv if calibrated and xy != uv else None
    return "px", "px/frame", xy if calibrated else None, frame_time_s


def _version_5(path: Path) -> dict[str, list[Any]]:
    from scipy.io import loadmat

    try:
        content = loadmat(path, squeeze_me=False, chars_as_strings=True)
    except Exception as fault:  # a damaged file makes scipy raise many kinds
        raise InputRefused(str(path), f"is damaged: {fault}", "save it again") from None
    variables: dict[str, list[Any]] = {}
    for name, value in content.items():
        if name.startswith("__"):
            continue
        array = np.asarray(value)
        if array.dtype.kind in "US":
            variables[name] = [str(array.ravel()[0])]
        else:
            variables[name] = list(array.ravel()) if array.dtype == object else [array]
    return variables


def _version_73(path: Path) -> dict[str, list[Any]]:
    variables: dict[str, list[Any]] = {}
    numbered: dict[str, dict[int, Any]] = {}
    with open_hdf5(path) as file:
        for name, item in file.items():
            if not hasattr(item, "shape"):
                continue
            number = re.fullmatch(r"(x|y|u|v|typevector)_(\d+)", name)
            if number:
                numbered.setdefault(number[1], {})[int(number[2])] = item[...]
            elif name == "units":
                variables[name] = ["".join(chr(c) for c in np.ravel(item[...]))]
            elif item.dtype == object:
                variables[name] = [file[reference][...] for reference in np.ravel(item[...])]
            else:
                variables[name] = [item[...]]
    return variables | {
        name: [fields[i] for i in sorted(fields)] for name, fields in numbered.items()
    }


def read_netcdf(path: Path) -> Iterator[Raw]:
    """Every time of a netCDF file, in order."""
    with path.open("rb") as file:
        if file.read(3) == b"CDF":
            raise InputRefused(
                str(path),
                "is classic netCDF",
                "write netCDF-4: dataset.to_netcdf(path, engine='h5netcdf')",
            )
    # opened once by h5py for its checks, then by h5netcdf, which knows dimensions
    with open_hdf5(path):
        pass
    try:
        import h5netcdf
    except ImportError:
        raise InputRefused(
            str(path), "is netCDF, which needs h5netcdf", "pip install nearlift[netcdf]"
        ) from None
    try:
        dataset = h5netcdf.File(path, "r")
    except (OSError, ValueError) as fault:
        raise InputRefused(str(path), f"is damaged: {fault}", "export it again") from None
    with dataset:
        lacking = [n for n in ("x", "y", "u", "v") if n not in dataset.variables]
        if lacking:
            raise InputRefused(
                str(path),
                f"has no {', '.join(lacking)}, but {', '.join(sorted(dataset.variables))}",
                "write a field in pivpy's layout: u, v on x, y, t",
            )
        x, y = (np.asarray(dataset.variables[n][...], dtype=float) for n in "xy")
        u, v = (_frames(dataset.variables[n], n, path) for n in "uv")
        chc, mask = (
            _frames(dataset.variables[n], n, path)
            if n in dataset.variables
            else np.full(u.shape, usual)
            for n, usual in (("chc", 1.0), ("mask", 0.0))
        )
        length, velocity = _unit(dataset.variables["x"]), _unit(dataset.variables["u"])
        frame = float(np.ravel(dataset.attrs["delta_t"])[0]) if "delta_t" in dataset.attrs else 0.0
    across, up = np.meshgrid(x, y)
    for i in range(len(u)):
        yield Raw(
            *(a.ravel() for a in (across, up, u[i], v[i])),
            good=((chc[i] == 1) & (mask[i] != 1)).ravel(),
            length_unit=length,
            velocity_unit=velocity,
            frame_time_s=frame or None,
        )


def _frames(variable: Any, name: str, path: Path) -> FloatArray:
    """A variable as (t, y, x)."""
    dims = tuple(variable.dimensions)
    values = np.asarray(variable[...], dtype=float)
    if sorted(dims) == ["x", "y"]:
        values, dims = values[None], ("t", *dims)
    if sorted(dims) != ["t", "x", "y"]:
        raise InputRefused(
            str(path), f"has {name} on {', '.join(dims)}", "pivpy's layout is u, v on x, y, t"
        )
    return np.transpose(values, [dims.index(d) for d in ("t", "y", "x")])


def _unit(variable: Any) -> str | None:
    stated = variable.attrs.get("units", "")
    return (stated.decode() if isinstance(stated, bytes) else str(stated)) or None


DIALECTS = (
    Dialect(
        name="pivlab_mat",
        title="PIVlab MATLAB file, version 5 or 7.3",
        recognises=_is_pivlab,
        read=read_pivlab,
        child=True,
    ),
    Dialect(
        name="netcdf",
        title="netCDF in pivpy's layout",
        recognises=_is_netcdf,
        read=read_netcdf,
        child=True,
    ),
)
