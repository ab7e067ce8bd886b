"""HDF5: every numeric dataset is a channel, called by its path; tables and compound datasets give
one for each column.

Unit and rate come from the attributes `unit` or `units`, and `sample_rate`, `rate`, `fs` or `dt`.
What refers to other files (external links, virtual and external storage) is not followed.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.readers import base

MAGIC = b"\x89HDF\r\n\x1a\n"
#: A two-dimensional dataset with more columns than this is an image.
MOST_COLUMNS = 64
#: Attributes that state the rate, and the step between samples; the last one is believed.
RATES, STEPS = ("fs", "rate", "sampling_rate", "sample_rate"), ("wf_increment", "dt")


def contents(path: Path, dialect: base.RecordsDialect, names: base.Names) -> base.Contents:
    """The channels of an HDF5 file; any fault of the file is h5py's to raise."""
    channels: list[base.Channel] = []
    with base.library("h5py", "hdf5").File(path, "r") as file:
        held, notes = datasets(file)
        for name, item in held:
            chosen = [column for column in _columns(name, item) if base.wanted(column[0], names)]
            unit, rate = _stated(item) if chosen else ("", None)
            for column, part, place in chosen:
                values = np.asarray(part[place], dtype=np.float64).reshape(-1)
                channels.append(base.Channel(name=column, unit=unit, rate_Hz=rate, values=values))
    return base.Contents(channels=tuple(channels), kind="HDF5", notes=tuple(notes))


def datasets(file: Any) -> tuple[list[tuple[str, Any]], list[str]]:
    """Path and dataset of all that this file holds, each once; notes on what leads out of it."""
    from h5py import Dataset, ExternalLink

    held: list[tuple[str, Any]] = []
    notes: list[str] = []

    def note(name: str, link: Any) -> None:
        if isinstance(link, ExternalLink):
            notes.append(f"/{name} is a link to another file, and was not followed")

    def look(name: str, item: Any) -> None:
        if isinstance(item, Dataset) and (item.is_virtual or item.external):
            notes.append(f"/{name} has its samples in another file, and was not read")
        elif isinstance(item, Dataset):
            held.append((f"/{name}", item))

    # neither follows a link by name
    file.visititems_links(note)
    file.visititems(look)
    return held, notes


def _columns(name: str, item: Any) -> list[tuple[str, Any, Any]]:
    """Name, dataset (or its field) and index of each channel of a dataset."""
    # without samples there is no shape
    kind = item.dtype
    shape: tuple[int, ...] = item.shape or ()
    if kind.names and len(shape) == 1:
        fields = [field for field in kind.names if kind[field].kind in "iuf"]
        return [(f"{name}/{field}", item.fields(field), ()) for field in fields]
    if kind.kind not in "iuf" or len(shape) not in (1, 2):
        return []
    if len(shape) == 1 or min(shape) == 1:
        return [(name, item, ())]
    count = shape[1] if shape[1] <= MOST_COLUMNS else 0
    return [(f"{name}[{i}]", item, np.s_[:, i]) for i in range(count)]


def _stated(item: Any) -> tuple[str, float | None]:
    """Unit and rate, Hz, that the attributes of a dataset state."""
    # most have none, and to look for them takes as long as to open a dataset
    attributes = item.attrs.items() if len(item.attrs) else ()
    texts = {str(key).casefold(): _text(value) for key, value in attributes}
    unit, rate = texts.get("unit", texts.get("units", "")), None
    for key in (*STEPS, *RATES):
        with contextlib.suppress(KeyError, ValueError):
            if (number := float(texts[key])) > 0:
                rate = 1 / number if key in STEPS else number
    return base.unit_word(unit) or unit, rate


def _text(value: Any) -> str:
    """An attribute as text."""
    plain = value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
    return plain.decode("utf-8", "replace") if isinstance(plain, bytes) else str(plain)


READER = base.Reader(
    name="hdf5",
    title="HDF5: a file per trial, or one for all with datasets named by trial (extra)",
    recognises=lambda head, name: head.startswith(MAGIC) and not name.endswith(".mat"),
    contents=contents,
    guarded=True,
)
