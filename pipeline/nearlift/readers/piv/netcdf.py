"""netCDF in pivpy's layout: dimensions x, y, t; variables u, v and the choice code chc (1 is
measured); units as attributes.

pivpy writes what it could not read as zeros with chc 0; such a vector is none here either.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.readers.hdf5 import MAGIC, open_hdf5
from nearlift.readers.piv.vectors import Dialect, Raw


def sniff(head: bytes) -> bool:
    """HDF5 that netCDF-4 wrote, which PIVlab does not; classic netCDF begins with its own name."""
    return (head.startswith(MAGIC) and b"typevector" not in head) or head.startswith(b"CDF")


def read(path: Path) -> Iterator[Raw]:
    """Every time of a file, in order."""
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


NETCDF = Dialect(
    name="netcdf", title="netCDF in pivpy's layout", sniff=sniff, read=read, child=True
)
