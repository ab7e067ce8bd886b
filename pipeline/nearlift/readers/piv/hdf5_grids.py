"""HDF5 from outside: opened for reading, with nothing in it that leads to another file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nearlift.errors import InputRefused

#: Values in all arrays together; a gigabyte of float64.
MAX_VALUES = 130_000_000


@contextmanager
def open_hdf5(path: Path) -> Iterator[Any]:
    """The file by h5py.

    Raises
    ------
    InputRefused
        h5py is not installed; the file is damaged, too large once unpacked, or links to other
        files.
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
