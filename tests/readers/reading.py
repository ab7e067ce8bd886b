"""Channels of a file, and records of two trials, by a reader; texts as files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.unit.manifests import manifest

from nearlift import readers
from nearlift.readers import text
from nearlift.readers.base import Contents


def contents(name: str, path: Path, dialect: Any = None, names: Any = None) -> Any:
    """Channels of one file, by the reader of that name."""
    return readers.reader(name).open(path, dialect or {}, names)


def records(
    root: Path,
    reader: str,
    column: str,
    unit: str,
    files: str,
    rate: str = "1000 Hz",
    **changes: Any,
) -> list[Any]:
    """Records of trials a, b by their reader."""
    given_manifest = manifest(
        load_cell={"sample_rate": rate},
        records={
            "reader": reader,
            "files": files,
            "force": {"column": column, "unit": unit, "sign": 1},
            **changes,
        },
    )
    return of_trials(reader, given_manifest, root, ["a", "b"])


def of_trials(name: str, given: Any, root: Path, trials: list[str]) -> list[Any]:
    """Every record of these trials in the plan's order; raises what refuses one."""
    reader = readers.reader(name)
    pieces, _ = reader.plan(given, root, trials)
    read = [record for piece in pieces for record in reader.read_piece(given, root, piece)]
    for record in read:
        if record.refusal is not None:
            raise record.refusal
    return read


def put(folder: Path, content: str | bytes, name: str = "f.txt") -> Path:
    """A file of this content."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def read(folder: Path, content: str | bytes, said: Any = None, names: Any = None) -> Contents:
    """The columns of a text, in a dialect known in part."""
    return text.contents(put(folder, content), text.TEXT.checked_dialect(said or {}), names)


def plain(folder: Path, content: str | bytes, *names: str) -> Contents:
    """The columns (`force` if none is named) by the reader of plain CSV."""
    return text.csv_contents(put(folder, content, "t.csv"), {}, names or ("force",))


def values(found: Contents, column: int = 0) -> list[float]:
    """The numbers of a column."""
    return list(found.channels[column].values.tolist())
