"""PIVlab's MATLAB files: version 5 by scipy, version 7.3 (HDF5) by h5py; one file holds many
fields.

Variables x, y, u_filtered (else u_original), v_..., typevector_... as cells, one per pair; or
numbered, x_0, u_0, ... With a text `units` the arrays are in those units; else they are in pixels,
`calxy` is m per pixel and `caluv` (m/s) per (px/frame).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.errors import InputRefused
from nearlift.readers.hdf5 import MAGIC, open_hdf5
from nearlift.readers.mat import V5, V73
from nearlift.readers.piv.vectors import Dialect, Raw

MEASURED = 1


def sniff(head: bytes) -> bool:
    """MATLAB's own first words, or HDF5 with what PIVlab names."""
    return head.startswith((V5, V73)) or (head.startswith(MAGIC) and b"typevector" in head)


def read(path: Path) -> Iterator[Raw]:
    """Every field of a file, in order."""
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


PIVLAB_MAT = Dialect(
    name="pivlab_mat",
    title="PIVlab MATLAB file, version 5 or 7.3",
    sniff=sniff,
    read=read,
    child=True,
)
