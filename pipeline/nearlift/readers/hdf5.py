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


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of an HDF5 file; any fault of the file is h5py's to raise."""
    h5py = library("h5py", "hdf5")
    notes: list[str] = []
    channels: list[Channel] = []
    with h5py.File(path, "r") as file:
        for name, item in datasets(file, notes):
            channels += columns_of(name, item, names)
    return Contents(channels=tuple(channels), kind="HDF5", notes=tuple(notes))


def datasets(file: Any, notes: list[str]) -> list[tuple[str, Any]]:
    """Path and dataset of all that is in this file, each once; what leads out of it is noted."""
    from h5py import Dataset, ExternalLink

    held: list[tuple[str, Any]] = []

    def look(name: str, item: Any) -> None:
        if not isinstance(item, Dataset):
            return
        if item.is_virtual or item.external:
            notes.append(f"/{name} has its samples in another file, and was not read")
        else:
            held.append((f"/{name}", item))

    def note(name: str, link: Any) -> None:
        if isinstance(link, ExternalLink):
            notes.append(f"/{name} is a link to another file, and was not followed")

    # neither follows a link by name
    file.visititems_links(note)
    file.visititems(look)
    return held


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
