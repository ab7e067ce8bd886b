"""HDF5: every numeric dataset is a channel, called by its path; tables and compound datasets give
one for each column.

Unit and rate come from the attributes `unit` or `units`, and `sample_rate`, `rate`, `fs` or `dt`.
What refers to other files (external links, virtual and external storage) is not followed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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
    unit_word,
    wanted,
)

MAGIC = b"\x89HDF\r\n\x1a\n"
#: A two-dimensional dataset with more columns than this is an image.
MOST_COLUMNS = 64
#: Groups within groups.
MAX_DEPTH = 20


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of an HDF5 file; any fault of the file is h5py's to raise."""
    h5py = library("h5py", "hdf5")
    notes: list[str] = []
    channels: list[Channel] = []
    with h5py.File(path, "r") as file:
        for name, item in datasets(file, notes):
            channels += columns_of(name, item, names)
    return Contents(channels=tuple(channels), kind="HDF5", notes=tuple(notes))


def datasets(
    group: Any, notes: list[str], above: str = "", deep: int = 0, seen: set[int] | None = None
) -> Iterator[tuple[str, Any]]:
    """Path and dataset of all below a group that is in this file; others are noted."""
    from h5py import Dataset, Group, h5d, h5g, h5l, h5o

    # by the library's lower half: the upper takes longer to look at a record's few links than to
    # read its samples
    seen = {h5o.get_info(group.id).addr} if seen is None else seen
    for key in group.id:
        name = f"{above}/{key.decode(errors='surrogateescape')}"
        link = group.id.links.get_info(key)
        if link.type == h5l.TYPE_EXTERNAL:
            notes.append(f"{name} is a link to another file, and was not followed")
        # links may make circles; of a hard one `u` is the address that it leads to
        if link.type != h5l.TYPE_HARD or link.u in seen or deep > MAX_DEPTH:
            continue
        seen.add(link.u)
        item = h5o.open(group.id, key)
        if isinstance(item, h5g.GroupID):
            yield from datasets(Group(item), notes, name, deep + 1, seen)
        elif isinstance(item, h5d.DatasetID):
            # samples in one stretch of this file have a place in it; how others are stored takes
            # longer to ask
            stored = item.get_create_plist() if item.get_offset() is None else None
            if stored is not None and (
                stored.get_layout() == h5d.VIRTUAL or stored.get_external_count()
            ):
                notes.append(f"{name} has its samples in another file, and was not read")
                continue
            yield name, Dataset(item)


def columns_of(name: str, item: Any, names: Names) -> Iterator[Channel]:
    """The channels of one dataset."""
    dtype = item.dtype
    # without samples there is no shape
    shape: tuple[int, ...] = item.shape or ()
    chosen: list[tuple[str, Any, Any]] = []
    if dtype.names:
        chosen = [
            (f"{name}/{field}", item.fields(field), ())
            for field in dtype.names
            if dtype[field].kind in "iuf" and len(shape) == 1
        ]
    elif dtype.kind in "iuf" and len(shape) in (1, 2):
        if len(shape) == 1 or min(shape) == 1:
            chosen = [(name, item, ())]
        elif shape[1] <= MOST_COLUMNS:
            chosen = [(f"{name}[{i}]", item, np.s_[:, i]) for i in range(shape[1])]
    chosen = [(path, part, place) for path, part, place in chosen if wanted(path, names)]
    if not chosen:
        return
    # most have none, and to look for them takes as long as to open a dataset
    attributes = (
        {str(key).casefold(): value for key, value in item.attrs.items()} if len(item.attrs) else {}
    )
    stated = next((_text(attributes[k]) for k in ("unit", "units") if k in attributes), "")
    unit = unit_word(stated) or stated
    rate = rate_from(attributes)
    for path, part, place in chosen:
        values = np.asarray(part[place], dtype=np.float64).reshape(-1)
        yield Channel(name=path, unit=unit, rate_Hz=rate, values=values)


def _text(value: Any) -> str:
    """An attribute as text."""
    plain = value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
    return plain.decode("utf-8", "replace") if isinstance(plain, bytes) else str(plain)


def rate_from(attributes: Mapping[str, object]) -> float | None:
    """The rate that attributes state, Hz."""
    steps = ("dt", "wf_increment")
    for key in ("sample_rate", "sampling_rate", "rate", "fs", *steps):
        if key in attributes:
            try:
                number = float(_text(attributes[key]))
            except ValueError:
                continue
            if number > 0:
                return 1 / number if key in steps else number
    return None


READER = Reader(
    name="hdf5",
    title="HDF5: a file per trial, or one for all with datasets named by trial (extra)",
    recognises=lambda head, name: head.startswith(MAGIC) and not name.endswith(".mat"),
    contents=contents,
    guarded=True,
)
