"""MATLAB: v4, v5 and v7 by scipy, v7.3 by h5py, tables and timetables by mat-io.

A channel is called by its variable, with the path through structs: ``run.force``. Of a matrix with
several columns, ``data(:,2)`` is the second. A timetable gives its columns and its time, in s:
``tt.force``, ``tt.Time``.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.readers import base
from nearlift.readers.files import head_of
from nearlift.readers.hdf5 import MAGIC, MOST_COLUMNS, datasets

V73, V5 = b"MATLAB 7.3 MAT-file", b"MATLAB 5.0 MAT-file"

#: Name and matrix of a variable; None for an object, such as a table.
Variable = tuple[str, Any]


def contents(path: Path, dialect: base.RecordsDialect, names: base.Names) -> base.Contents:
    """The channels of a MATLAB file; any fault of the file is scipy's or h5py's to raise."""
    head = head_of(path, 1024)
    newest = MAGIC in (head[:8], head[512:520])
    channels: list[base.Channel] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        variables = [*(_v73(path) if newest else _v5(path))]
        for name, matrix in sorted(variables, key=lambda variable: variable[1] is None):
            channels += _table(path, name) if matrix is None else _columns(name, matrix)
    chosen = tuple(c for c in channels if base.wanted(c.name, names))
    return base.Contents(channels=chosen, kind="MATLAB " + ("v7.3" if newest else "v7 or older"))


def _v5(path: Path) -> Iterator[Variable]:
    import scipy.io
    from scipy.io.matlab import MatlabOpaque

    held = scipy.io.loadmat(str(path), struct_as_record=False, chars_as_strings=True)
    for name, value in held.items():
        if isinstance(value, MatlabOpaque):
            # an object's own name is inside it
            inside = value.dtype.names and "s0" in value.dtype.names
            yield value["s0"][0].decode() if inside else name, None
        elif not name.startswith("__"):
            yield from _flat(name, value)


def _flat(name: str, value: Any) -> Iterator[Variable]:
    """Numeric matrices in a variable, its structs and cells."""
    if (fields := getattr(value, "_fieldnames", None)) is not None:
        for field in fields:
            yield from _flat(f"{name}.{field}", getattr(value, field))
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for i, item in enumerate(value.flat, start=1):
            yield from _flat(name if value.size == 1 else f"{name}({i})", item)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.ndim == 2:
        yield name, value


def _v73(path: Path) -> Iterator[Variable]:
    with base.library("h5py", "mat").File(path, "r") as file:
        for place, item in datasets(file)[0]:
            name, attributes = place.strip("/").replace("/", "."), item.attrs
            # MATLAB keeps under this name what references point to
            if place.startswith("/#"):
                continue
            if "MATLAB_object_decode" in attributes:
                yield name, None
            # logicals and texts are integers with another class
            elif (
                item.dtype.kind in "iuf"
                and item.ndim == 2
                and "MATLAB_empty" not in attributes
                and attributes.get("MATLAB_class") not in (b"char", b"logical", b"cell")
            ):
                # MATLAB's first axis is HDF5's last
                yield name, np.asarray(item[()]).T


def _columns(name: str, matrix: Any) -> Iterator[base.Channel]:
    values = np.array(matrix, dtype=np.float64, order="F")
    if min(values.shape) <= 1:
        yield base.Channel(name=name, values=values.reshape(-1))
    elif values.shape[1] <= MOST_COLUMNS:
        for i, column in enumerate(values.T, start=1):
            yield base.Channel(name=f"{name}(:,{i})", values=column)


def _table(path: Path, name: str) -> Iterator[base.Channel]:
    """The columns of a table or timetable, the time in s."""
    table = base.library("matio", "mat").load_from_mat(str(path), variable_names=[name]).get(name)
    if table is None or not hasattr(table, "columns"):
        return
    index = table.index
    if index.dtype.kind in "mM":
        # durations, or dates: since the first
        since = index - index[0] if index.dtype.kind == "M" and len(index) else index
        seconds = since.to_numpy().astype("timedelta64[ns]").astype(np.int64) * 1e-9
        yield base.Channel(name=f"{name}.{index.name or 'Time'}", unit="s", values=seconds)
    for column in table.columns:
        if (values := table[column].to_numpy()).dtype.kind in "iuf":
            yield base.Channel(name=f"{name}.{column}", values=values.astype(np.float64))


READER = base.Reader(
    name="mat",
    title="MATLAB v4 to v7.3, structs, tables and timetables (extra)",
    recognises=lambda head, name: head.startswith((V5, V73)) or name.endswith(".mat"),
    contents=contents,
    guarded=True,
)
