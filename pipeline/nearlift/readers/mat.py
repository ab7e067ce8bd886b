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

from nearlift.readers.base import (
    Channel,
    Contents,
    Names,
    Reader,
    RecordsDialect,
    library,
    wanted,
)
from nearlift.readers.files import head_of
from nearlift.readers.hdf5 import MAGIC, MOST_COLUMNS, datasets

V73 = b"MATLAB 7.3 MAT-file"
V5 = b"MATLAB 5.0 MAT-file"


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of a MATLAB file; any fault of the file is scipy's or h5py's to raise."""
    head = head_of(path, 1024)
    newest = MAGIC in (head[:8], head[512:520])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        channels, objects = _v73(path) if newest else _v5(path)
        for name in objects:
            channels += _table(path, name)
    chosen = tuple(c for c in channels if wanted(c.name, names))
    return Contents(channels=chosen, kind="MATLAB " + ("v7.3" if newest else "v7 or older"))


def _v5(path: Path) -> tuple[list[Channel], list[str]]:
    """Channels, and the names of variables that are objects (tables, timetables)."""
    import scipy.io
    from scipy.io.matlab import MatlabOpaque

    variables = scipy.io.loadmat(
        str(path), struct_as_record=False, squeeze_me=False, chars_as_strings=True
    )
    channels: list[Channel] = []
    objects: list[str] = []
    for name, value in variables.items():
        if isinstance(value, MatlabOpaque):
            # an object's own name is inside it
            objects.append(
                value["s0"][0].decode() if value.dtype.names and "s0" in value.dtype.names else name
            )
        elif not name.startswith("__"):
            channels += _flat(name, value)
    return channels, objects


def _flat(name: str, value: Any) -> Iterator[Channel]:
    """Numeric arrays below a variable."""
    fields = getattr(value, "_fieldnames", None)
    if fields is not None:
        for field in fields:
            yield from _flat(f"{name}.{field}", getattr(value, field))
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for i, item in enumerate(value.flat):
            yield from _flat(name if value.size == 1 else f"{name}({i + 1})", item)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.ndim == 2:
        yield from _columns(name, value)


def _columns(name: str, value: Any) -> Iterator[Channel]:
    values = np.array(value, dtype=np.float64, order="F")
    if min(value.shape) <= 1:
        yield Channel(name=name, values=values.reshape(-1))
    elif value.shape[1] <= MOST_COLUMNS:
        for i in range(value.shape[1]):
            yield Channel(name=f"{name}(:,{i + 1})", values=values[:, i])


def _v73(path: Path) -> tuple[list[Channel], list[str]]:
    channels: list[Channel] = []
    objects: list[str] = []
    with library("h5py", "mat").File(path, "r") as file:
        for name, item in datasets(file, []):
            kind = item.attrs.get("MATLAB_class", b"double")
            variable = name.strip("/").replace("/", ".")
            if name.startswith("/#"):
                continue
            if "MATLAB_object_decode" in item.attrs:
                objects.append(variable)
            # logicals and texts are integers with another class
            elif (
                item.dtype.kind in "iuf"
                and item.ndim == 2
                and "MATLAB_empty" not in item.attrs
                and kind not in (b"char", b"logical", b"cell")
            ):
                # MATLAB's first axis is HDF5's last
                channels += _columns(variable, np.asarray(item[()]).T)
    return channels, objects


def _table(path: Path, name: str) -> Iterator[Channel]:
    """The columns of a table or timetable, the time in s."""
    table = library("matio", "mat").load_from_mat(str(path), variable_names=[name]).get(name)
    if table is None or not hasattr(table, "columns"):
        return
    index = table.index
    if index.dtype.kind in "mM":
        # durations, or dates: since the first
        since = index - index[0] if index.dtype.kind == "M" and len(index) else index
        seconds = since.to_numpy().astype("timedelta64[ns]").astype(np.int64) * 1e-9
        yield Channel(name=f"{name}.{index.name or 'Time'}", unit="s", values=seconds)
    for column in table.columns:
        values = table[column].to_numpy()
        if values.dtype.kind in "iuf":
            yield Channel(name=f"{name}.{column}", values=values.astype(np.float64))


READER = Reader(
    name="mat",
    title="MATLAB v4 to v7.3, structs, tables and timetables (extra)",
    recognises=lambda head, name: head.startswith((V5, V73)) or name.endswith(".mat"),
    contents=contents,
    guarded=True,
)
