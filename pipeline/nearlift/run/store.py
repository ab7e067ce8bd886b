"""Products on disk: written whole or not at all, read back only if intact.

Every write goes to a temporary file in the same folder, is flushed to the disk, renamed, and the
folder is flushed too: a reader sees the old bytes or the new ones. Tables are Parquet with page
checksums, and with a digest of names, types and length, which no checksum covers: a flipped bit
cannot pass.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import IO, Any, ClassVar, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from nearlift.errors import ProductError
from nearlift.results.serial import decode, encode
from nearlift.run import copies
from nearlift.run.arrow_tables import layout, to_arrow, to_numpy
from nearlift.run.schema import Product

#: Column name -> values, all of one length; text columns are object arrays of str.
Table = dict[str, NDArray[Any]]


class Saved(Protocol):
    """The type of a JSON product."""

    file: ClassVar[str]


Loaded = TypeVar("Loaded", bound=Saved)


class Disk:
    """The calls by which anything reaches the disk; tests put one that fails, or dies, at the n-th
    call in its place.
    """

    def write(self, file: IO[bytes], content: bytes) -> None:
        """Write all of it."""
        file.write(content)
        file.flush()

    def sync(self, descriptor: int) -> None:
        """Wait until a file, or a folder, is on the disk."""
        os.fsync(descriptor)

    def rename(self, old: Path, new: Path) -> None:
        """Put `old` in the place of `new`, in one step."""
        old.replace(new)

    def unlink(self, path: Path) -> None:
        """Take a file away."""
        path.unlink(missing_ok=True)


disk = Disk()
#: How the name of a file ends that is not finished: with the process that writes it; a dot and what
#: it will be stand before.
_UNFINISHED = re.compile(r"\.\d+\.tmp\Z")
#: Bytes of a file that are hashed at once, and files that a thread hashes before it takes more (at
#: most).
PART, PORTION = 1 << 20, 16
#: Characters of a digest, and files that are hashed at a time.
HEX = 64
WORKERS = min(os.cpu_count() or 1, 4)


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """A fault of the disk that names no file names this one."""
    try:
        yield
    except OSError as fault:
        if fault.filename is None:
            fault.filename = str(path)
        raise


def write_bytes(path: Path, content: bytes) -> None:
    """Replace `path` by `content` in one step that survives a crash."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with naming(path), temporary.open("wb") as file:
            disk.write(file, content)
            disk.sync(file.fileno())
        disk.rename(temporary, path)
    except BaseException:
        # should that fail too, the next run sweeps it away
        with contextlib.suppress(OSError):
            disk.unlink(temporary)
        raise
    sync_folder(path.parent)


def sweep(folder: Path) -> None:
    """Take away what a killed run left unfinished in a folder and its subfolders; links are not
    followed.
    """
    for path in folder.rglob(".*.tmp"):
        if (
            path.name.startswith(".")
            and _UNFINISHED.search(path.name, 2)
            and path.is_file()
            and not path.is_symlink()
        ):
            path.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with naming(folder):
            disk.sync(descriptor)
    finally:
        os.close(descriptor)


def sha256(path: str | Path) -> str:
    """SHA-256 of a file, streamed."""
    digest = hashlib.sha256()
    with open(path, "rb", buffering=0) as file:  # noqa: PTH123 - a path made of text takes longer
        while part := file.read(PART):
            digest.update(part)
    return digest.hexdigest()


def sha256_of(
    paths: Sequence[str | Path], meanwhile: Callable[[], None] = lambda: None
) -> list[str]:
    """SHA-256 of each file; `meanwhile` is done at the same time, unless there is one file only, or
    none.
    """
    if len(paths) < 2:
        return [sha256(path) for path in paths]
    digests = [""] * len(paths)
    with contextlib.ExitStack() as held:
        shares = [range(i, len(paths), WORKERS) for i in range(WORKERS if copies.alone() else 0)]
        answers = [
            held.enter_context(copies.copied(partial(_write_digests, [paths[i] for i in share])))
            for share in shares
        ]
        meanwhile()
        for share, answer in zip(shares, answers, strict=True):
            content = answer.read().decode() if answer else ""
            for k, i in enumerate(share):
                digests[i] = content[HEX * k : HEX * (k + 1)]
    # what could not be read says why when it is read here
    return digests if all(len(digest) == HEX for digest in digests) else _sha256_here(paths)


def _write_digests(paths: Sequence[str | Path], file: IO[bytes]) -> None:
    for path in paths:
        file.write(sha256(path).encode())


def _sha256_here(paths: Sequence[str | Path]) -> list[str]:
    """SHA-256 of each file by threads: hashing and reading leave the interpreter alone."""
    if WORKERS < 2:
        return [sha256(path) for path in paths]
    # few files may be large ones; of many, handing over each would take as long as to hash it
    many = min(max(len(paths) // (8 * WORKERS), 1), PORTION)
    portions = [paths[i : i + many] for i in range(0, len(paths), many)]
    with ThreadPoolExecutor(WORKERS) as pool:
        return [
            digest
            for digests in pool.map(lambda portion: [sha256(path) for path in portion], portions)
            for digest in digests
        ]


def listing_sha256(digests: Mapping[str, str]) -> str:
    """SHA-256 of a list of files: their names, each with its own."""
    return hashlib.sha256(
        "".join(f"{name} {sha}\n" for name, sha in digests.items()).encode()
    ).hexdigest()


def ready() -> None:
    """Import what tables are written with, where the time for it is there anyway."""
    import pyarrow.parquet  # noqa: F401


def stacked(product: Product, tables: Sequence[Table]) -> Table:
    """Tables one below the other; with the product's columns and no rows where there are none."""
    return {
        c.name: np.concatenate(
            [np.zeros(0, dtype=object if c.kind == "text" else float), *(t[c.name] for t in tables)]
        )
        for c in product.columns
    }


def table_bytes(table: Mapping[str, NDArray[Any]], product: Product) -> bytes:
    """A table product as Parquet: schema checked, pages checksummed."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = pa.BufferOutputStream()
    # measured numbers rarely repeat, and what does zstd finds as well: dictionaries would make
    # files larger, and take a kilobyte a row to write
    pq.write_table(
        to_arrow(table, product),
        sink,
        compression="zstd",
        use_dictionary=False,
        write_page_checksum=True,
    )
    content: bytes = sink.getvalue().to_pybytes()
    return content


def _require(path: Path) -> None:
    if not path.is_file():
        raise ProductError(
            str(path),
            "is missing",
            "run the stage that writes it (`nearlift run --dry-run CAMPAIGN` says which)",
        )


def _require_schema(path: Path, content: Mapping[str, object], schema: str) -> None:
    if content.get("schema") != schema:
        raise ProductError(
            str(path),
            f"has schema {content.get('schema', 'none')}, not {schema}",
            "it was written by another version: run again",
        )


def read_table(path: Path, product: Product) -> Table:
    """Read a table product back, its pages verified.

    Raises
    ------
    ProductError
        The file is missing, damaged, or of another schema.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    _require(path)
    try:
        # pq.read_table would import pyarrow.dataset, and with it pandas, which takes 0.3 s
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            table = file.read()
        about = {
            key.decode(): value.decode() for key, value in (table.schema.metadata or {}).items()
        }
        content = {name: to_numpy(table[name]) for name in table.column_names}
    except (pa.ArrowException, OSError, ValueError) as fault:
        raise ProductError(
            str(path), f"is damaged: {str(fault).splitlines()[0]}", "delete it and run again"
        ) from None
    _require_schema(path, about, product.schema)
    if about.get("layout") != layout(table.schema, table.num_rows):
        raise ProductError(
            str(path),
            "is damaged: its columns or its length are not what was written",
            "delete it and run again",
        )
    return content


def json_bytes(content: object) -> bytes:
    """A JSON product; numbers keep all their digits."""
    return (
        json.dumps(encode(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    ).encode()


def write_json(path: Path, content: object) -> None:
    """Write a JSON product in one atomic step."""
    write_bytes(path, json_bytes(content))


def read_json(path: Path) -> dict[str, object]:
    """Read a JSON product; raises `ProductError` where it is missing or damaged."""
    _require(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as fault:
        raise ProductError(str(path), f"is damaged: {fault}", "delete it and run again") from None
    if not isinstance(content, dict):
        raise ProductError(str(path), "is not a JSON object", "delete it and run again")
    return content


def load(path: Path, kind: type[Loaded]) -> Loaded:
    """A JSON product as its type; raises `ProductError` where it is missing, damaged or of another
    schema.
    """
    content = read_json(path)
    _require_schema(path, content, f"nearlift.{kind.file.removesuffix('.json')}/1")
    return decode(kind, content, str(path))


def load_if_whole(path: Path, otherwise: Loaded) -> Loaded:
    """The same, `otherwise` where it is missing, damaged or of another schema."""
    try:
        return load(path, type(otherwise))
    except ProductError:
        return otherwise


def read_json_if_whole(path: Path) -> dict[str, Any]:
    """A JSON file that can be made again from everything else: empty where it is missing or
    damaged.
    """
    try:
        return read_json(path)
    except ProductError:
        return {}
