"""Products on disk: tables as Parquet with units and meanings, results as JSON.

Each file is written whole or not at all, and read back only if it is what was written.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, TypeVar

from nearlift.errors import ProductError

# the command line is made of these declarations, so numpy and pyarrow are imported where needed
if TYPE_CHECKING:
    import pyarrow as pa
    from numpy.typing import NDArray

Kind = Literal["text", "real", "integer"]
#: Column name to values, all of one length; text columns are object arrays of str.
Table = dict[str, "NDArray[Any]"]
#: File of digests in the folder of a campaign's products.
LEDGER = "provenance.json"
#: Bytes that are hashed at once.
CHUNK = 1 << 20


class Saved(Protocol):
    """The type of a JSON product."""

    file: ClassVar[str]


Loaded = TypeVar("Loaded", bound=Saved)


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """One column: its name (with the unit in it), kind, unit and meaning; an `optional` one may be
    absent.
    """

    name: str
    kind: Kind = "real"
    unit: str = ""
    meaning: str
    optional: bool = False


def text(name: str, meaning: str, *, optional: bool = False) -> Column:
    """A column of words."""
    return Column(name=name, kind="text", meaning=meaning, optional=optional)


def integer(name: str, meaning: str, *, unit: str = "", optional: bool = False) -> Column:
    """A column of whole numbers."""
    return Column(name=name, kind="integer", unit=unit, meaning=meaning, optional=optional)


def real(name: str, unit: str, meaning: str, *, optional: bool = False) -> Column:
    """A column of measured or computed numbers."""
    return Column(name=name, unit=unit, meaning=meaning, optional=optional)


@dataclass(frozen=True, slots=True, kw_only=True)
class Product:
    """One file that a stage writes. Tables may have further columns where `open_ended`."""

    file: str
    title: str
    row: str
    columns: tuple[Column, ...] = ()
    open_ended: bool = False
    called: str = ""
    version: int = 1

    @property
    def name(self) -> str:
        """Name of the product: `called`, or the file's name without its suffix."""
        return self.called or self.file.split(".")[0]

    @property
    def schema(self) -> str:
        """Identifier written into the file."""
        return f"nearlift.{self.file.split('.')[0]}/{self.version}"

    def columns_of(self, rows: Sequence[Mapping[str, object]]) -> Table:
        """Rows as this table's columns."""
        import numpy as np

        kinds: dict[Kind, Any] = {"text": object, "integer": np.int64, "real": float}
        return {
            c.name: np.array([row[c.name] for row in rows], dtype=kinds[c.kind])
            for c in self.columns
        }


PROVENANCE = Product(file=LEDGER, title="What made these products", row="stage")


def stacked(product: Product, tables: Sequence[Table]) -> Table:
    """Tables one below the other; with the product's columns and no rows where there are none."""
    import numpy as np

    return {
        c.name: np.concatenate(
            [np.zeros(0, dtype=object if c.kind == "text" else float), *(t[c.name] for t in tables)]
        )
        for c in product.columns
    }


# ---- files


def write_whole(path: Path, content: bytes) -> None:
    """Replace a file in one step that survives a crash: a reader sees the old bytes or the new."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with unfinished.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(path)
    except BaseException as fault:
        with contextlib.suppress(OSError):
            unfinished.unlink()
        if isinstance(fault, OSError) and fault.filename is None:
            fault.filename = str(path)
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sha256(path: str | Path) -> str:
    """SHA-256 of a file, streamed."""
    digest = hashlib.sha256()
    with open(path, "rb", buffering=0) as file:  # noqa: PTH123 - a path made of text takes longer
        while chunk := file.read(CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def digest_of(content: bytes) -> str:
    """SHA-256 of bytes."""
    return hashlib.sha256(content).hexdigest()


def product_bytes(path: Path) -> bytes:
    """A product's bytes, if they are those that its stage wrote.

    Raises
    ------
    ProductError
        The file is missing, or its digest is not that in provenance.json.
    """
    try:
        content = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise ProductError(
            str(path),
            "is missing",
            "run the stage that writes it (`nearlift run --dry-run CAMPAIGN` says which)",
        ) from None
    stated = stated_digests(path.parent).get(f"processed/{path.name}")
    if stated is not None and digest_of(content) != stated:
        raise ProductError(
            str(path),
            "is damaged: it was changed after it was written",
            "delete it and run again",
        )
    return content


def stated_digests(folder: Path) -> Mapping[str, str]:
    """Digests of products by name, as provenance.json in their folder has them."""
    ledger = folder / LEDGER
    try:
        status = ledger.stat()
    except OSError:
        return {}
    return _stated(str(ledger), status.st_mtime_ns, status.st_size, status.st_ino)


@functools.lru_cache(maxsize=16)
def _stated(ledger: str, *_: int) -> Mapping[str, str]:
    content = read_json_if_whole(Path(ledger))
    try:
        return {
            str(name): str(sha)
            for stage in content.get("stages", {}).values()
            for name, sha in stage["outputs"].items()
        }
    except (KeyError, TypeError, AttributeError):
        return {}


# ---- tables


def table_bytes(table: Mapping[str, NDArray[Any]], product: Product) -> bytes:
    """A table product as Parquet: schema checked, pages with checksums."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = pa.BufferOutputStream()
    # measured numbers rarely repeat: dictionaries would make files larger and slower to write
    pq.write_table(
        to_arrow(table, product),
        sink,
        compression="zstd",
        use_dictionary=False,
        write_page_checksum=True,
    )
    content: bytes = sink.getvalue().to_pybytes()
    return content


def to_arrow(table: Mapping[str, NDArray[Any]], product: Product) -> pa.Table:
    """An Arrow table with the product's columns first, their units and meanings in the fields'
    metadata.

    Raises
    ------
    ProductError
        A declared column is missing, lengths differ, or a closed product has an undeclared column.
    """
    import numpy as np
    import pyarrow as pa

    declared = {c.name: c for c in product.columns}
    missing = {c.name for c in product.columns if not c.optional} - table.keys()
    extra = table.keys() - declared.keys()
    fault = ""
    if missing or (extra and not product.open_ended):
        fault = f"lacks {sorted(missing)}, has undeclared {sorted(extra)}"
    elif len({len(v) for v in table.values()}) > 1:
        fault = "has columns of different lengths"
    if fault:
        raise ProductError(product.file, fault, "this is a defect of the stage that writes it")
    kinds = {"text": pa.string(), "real": pa.float64(), "integer": pa.int64()}
    fields, arrays = [], []
    for name in (*(n for n in declared if n in table), *(n for n in table if n not in declared)):
        values, column = np.asarray(table[name]), declared.get(name)
        kind = kinds[column.kind if column else _kind(values)]
        about = {"unit": column.unit, "meaning": column.meaning} if column else None
        fields.append(pa.field(name, kind, metadata=about))
        arrays.append(_arrow(values, kind))
    schema = pa.schema(fields)
    about = {"schema": product.schema, "layout": layout(schema, len(arrays[0]) if arrays else 0)}
    return pa.Table.from_arrays(arrays, schema=schema.with_metadata(about))


def layout(schema: pa.Schema, rows: int) -> str:
    """Digest of names, types and length, which no page's checksum covers."""
    columns = [(name, str(kind)) for name, kind in zip(schema.names, schema.types, strict=True)]
    return digest_of(json.dumps([rows, columns]).encode())


def _kind(values: NDArray[Any]) -> Kind:
    """The kind of an undeclared column."""
    return {"O": "text", "U": "text", "S": "text", "i": "integer", "u": "integer"}.get(  # type: ignore[return-value]
        values.dtype.kind, "real"
    )


def _arrow(values: NDArray[Any], kind: pa.DataType) -> pa.Array:
    """A column from its bytes; `pyarrow.array` would import pandas, which takes 0.3 s."""
    import numpy as np
    import pyarrow as pa

    if kind != pa.string():
        plain_values = np.ascontiguousarray(values, dtype=kind.to_pandas_dtype())
        return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(plain_values)])
    texts = [str(text).encode() for text in values.tolist()]
    ends = np.cumsum([0, *map(len, texts)], dtype=np.int64)
    if ends[-1] >= 2**31:
        raise ProductError(
            "text column", f"holds {ends[-1]} bytes", "shorten the texts: a column takes 2 GiB"
        )
    return pa.StringArray.from_buffers(
        len(texts), pa.py_buffer(ends.astype(np.int32)), pa.py_buffer(b"".join(texts))
    )


def to_numpy(column: pa.ChunkedArray) -> NDArray[Any]:
    """A column's values; texts as objects. Arrow's own `to_numpy` would import pandas."""
    import numpy as np
    import pyarrow as pa

    if pa.types.is_string(column.type):
        return np.asarray(column.to_pylist(), dtype=object)
    return np.array(np.from_dlpack(column.combine_chunks()))


def read_table(path: Path, product: Product) -> Table:
    """Read a table product back, digest and pages verified.

    Raises
    ------
    ProductError
        The file is missing, damaged, or of another schema.
    """
    return table_of(product_bytes(path), product, str(path))


def table_of(content: bytes, product: Product, where: str) -> Table:
    """A table from its bytes."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        # pq.read_table would import pyarrow.dataset, and with it pandas
        with pq.ParquetFile(pa.BufferReader(content), page_checksum_verification=True) as file:
            table = file.read()
        about = {k.decode(): v.decode() for k, v in (table.schema.metadata or {}).items()}
        columns = {name: to_numpy(table[name]) for name in table.column_names}
    except (pa.ArrowException, OSError, ValueError) as fault:
        raise ProductError(
            where, f"is damaged: {str(fault).splitlines()[0]}", "delete it and run again"
        ) from None
    _require_schema(where, about, product.schema)
    if about.get("layout") != layout(table.schema, table.num_rows):
        raise ProductError(
            where,
            "is damaged: its columns or its length are not what was written",
            "delete it and run again",
        )
    return columns


def _require_schema(where: str, content: Mapping[str, object], schema: str) -> None:
    if content.get("schema") != schema:
        raise ProductError(
            where,
            f"has schema {content.get('schema', 'none')}, not {schema}",
            "it was written by another version: run again",
        )


# ---- JSON


def json_bytes(content: object) -> bytes:
    """A JSON product; numbers keep all their digits."""
    from nearlift.results import document

    return document.json_bytes(content) + b"\n"


def json_of(content: bytes, where: str) -> dict[str, Any]:
    """A JSON product from its bytes; raises `ProductError` where they are damaged."""
    try:
        read = json.loads(content.decode())
    except ValueError as fault:
        raise ProductError(where, f"is damaged: {fault}", "delete it and run again") from None
    if not isinstance(read, dict):
        raise ProductError(where, "is not a JSON object", "delete it and run again")
    return read


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON product; raises `ProductError` where it is missing or damaged."""
    return json_of(product_bytes(path), str(path))


def load(path: Path, kind: type[Loaded]) -> Loaded:
    """A JSON product as its type; raises `ProductError` where it is missing, damaged or of another
    schema.
    """
    return loaded(product_bytes(path), kind, str(path))


def loaded(content: bytes, kind: type[Loaded], where: str) -> Loaded:
    """A JSON product as its type, from its bytes."""
    from nearlift.results.document import typed

    read = json_of(content, where)
    _require_schema(where, read, f"nearlift.{kind.file.removesuffix('.json')}/1")
    return typed(kind, read, where)


def load_if_whole(path: Path, otherwise: Loaded) -> Loaded:
    """A JSON product as its type; `otherwise` where it is missing, damaged or of another schema."""
    try:
        return load(path, type(otherwise))
    except ProductError:
        return otherwise


def read_json_if_whole(path: Path) -> dict[str, Any]:
    """A JSON file that can be made again; empty where it is missing or damaged."""
    try:
        return json_of(path.read_bytes(), str(path))
    except (ProductError, OSError):
        return {}
