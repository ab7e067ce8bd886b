"""Products on disk: tables as Parquet with units and meanings, results as JSON.

Each file is written whole or not at all, and read back only if it is what was written.
"""

from __future__ import annotations

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
    from numpy.typing import NDArray

Kind = Literal["text", "real", "integer"]
#: Column name to values, all of one length; text columns are object arrays of str.
Table = dict[str, "NDArray[Any]"]
#: File of digests in the folder of a campaign's products.
LEDGER = "provenance.json"
#: Bytes that are hashed at once.
BLOCK = 1 << 20
#: End of the name of a file that is being written.
UNFINISHED = ".unfinished"
#: Arrow type of each kind of column, and of undeclared columns by numpy's letter, if not real.
KINDS: dict[Kind, str] = {"text": "string", "real": "float64", "integer": "int64"}
OTHERS = {"O": "string", "U": "string", "i": "int64", "u": "int64"}
RUN_AGAIN = "delete it and run again"
DEFECT = "this is a defect of the stage that writes it"


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

        types = {c.name: object if c.kind == "text" else KINDS[c.kind] for c in self.columns}
        return {c: np.array([row[c] for row in rows], dtype=t) for c, t in types.items()}


PROVENANCE = Product(file=LEDGER, title="What made these products", row="stage")


def stacked(product: Product, tables: Sequence[Table]) -> Table:
    """Tables one below the other; with the product's columns and no rows where there are none."""
    import numpy as np

    empty = product.columns_of(())
    return {c: np.concatenate([none, *(t[c] for t in tables)]) for c, none in empty.items()}


# ---- files


def write_whole(path: Path, content: bytes) -> None:
    """Replace a file in one step that survives a crash: a reader sees the old bytes or the new."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}{UNFINISHED}")
    try:
        with unfinished.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(path)
    except BaseException as fault:
        unfinished.unlink(missing_ok=True)
        if isinstance(fault, OSError) and fault.filename is None:
            fault.filename = str(path)
        raise
    # wait until the name is on the disk too
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def sha256(path: str | Path) -> str:
    """SHA-256 of a file."""
    digest = hashlib.sha256()
    with open(path, "rb", buffering=0) as file:  # noqa: PTH123 - a path made of text takes longer
        while block := file.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()


def sha256_if_any(path: Path) -> str:
    """SHA-256 of a file; empty where there is none."""
    return sha256(path) if path.is_file() else ""


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
    digest, ledger = digest_of(content), path.with_name(LEDGER)
    if path != ledger and ledger.is_file():
        status = ledger.stat()
        stated = _stated_digests(ledger, status.st_mtime_ns, status.st_ino)
        if digest != stated.get(f"processed/{path.name}", digest):
            raise ProductError(
                str(path), "is damaged: it was changed after it was written", RUN_AGAIN
            )
    return content


@functools.lru_cache(maxsize=16)
def _stated_digests(ledger: Path, *_: int) -> Mapping[str, str]:
    """Digests of products by name, as provenance.json has them; none where it is damaged."""
    from nearlift.results.provenance import ProvenanceLedger

    return load_if_whole(ledger, ProvenanceLedger()).outputs


# ---- tables


def table_bytes(table: Mapping[str, NDArray[Any]], product: Product) -> bytes:
    """A table product as Parquet, declared columns first, with units and meanings in the fields'
    metadata and checksums of pages.

    Raises
    ------
    ProductError
        A declared column is missing, lengths differ, or a closed product has an undeclared column.
    """
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    declared = {c.name: c for c in product.columns}
    missing = {c.name for c in product.columns if not c.optional} - table.keys()
    extra = table.keys() - declared.keys()
    if missing or (extra and not product.open_ended):
        fault = f"lacks {sorted(missing)}, has undeclared {sorted(extra)}"
        raise ProductError(product.file, fault, DEFECT)
    if len({len(values) for values in table.values()}) > 1:
        raise ProductError(product.file, "has columns of different lengths", DEFECT)
    fields, arrays = [], []
    for name in (*(n for n in declared if n in table), *(n for n in table if n not in declared)):
        values, column = np.asarray(table[name]), declared.get(name)
        kind = KINDS[column.kind] if column else OTHERS.get(values.dtype.kind, "float64")
        texts = kind == "string"
        arrays.append(pa.array([*map(str, values.tolist())] if texts else values, kind))
        about = {"unit": column.unit, "meaning": column.meaning} if column else None
        fields.append(pa.field(name, kind, metadata=about))
    schema = pa.schema(fields, metadata={"schema": product.schema})
    sink = pa.BufferOutputStream()
    # measured numbers rarely repeat: dictionaries would make files larger and slower to write
    pq.write_table(
        pa.Table.from_arrays(arrays, schema=schema),
        sink,
        compression="zstd",
        use_dictionary=False,
        write_page_checksum=True,
    )
    content: bytes = sink.getvalue().to_pybytes()
    return content


def read_table(path: Path, product: Product) -> Table:
    """Read a table product back, digest and pages verified.

    Raises
    ------
    ProductError
        The file is missing, damaged, or of another schema.
    """
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        # on this thread: those of the library can abort an interpreter that ends soon after
        file = pa.BufferReader(product_bytes(path))
        table = pq.ParquetFile(file, page_checksum_verification=True).read(use_threads=False)
        stated = (table.schema.metadata or {}).get(b"schema", b"none").decode()
        columns = {name: np.array(table[name]) for name in table.column_names}
    except (pa.ArrowException, OSError, ValueError) as fault:
        raise ProductError(
            str(path), f"is damaged: {str(fault).splitlines()[0]}", RUN_AGAIN
        ) from None
    _require_schema(path, stated, product.schema)
    return columns


def _require_schema(path: Path, stated: object, schema: str) -> None:
    if stated != schema:
        raise ProductError(
            str(path),
            f"has schema {stated}, not {schema}",
            "it was written by another version: run again",
        )


# ---- JSON


def json_bytes(content: object) -> bytes:
    """A JSON product; numbers keep all their digits."""
    from nearlift.results import document

    return document.json_bytes(content) + b"\n"


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON product; raises `ProductError` where it is missing or damaged."""
    try:
        read = json.loads(product_bytes(path))
    except ValueError as fault:
        raise ProductError(str(path), f"is damaged: {fault}", RUN_AGAIN) from None
    if not isinstance(read, dict):
        raise ProductError(str(path), "is not a JSON object", RUN_AGAIN)
    return read


def load(path: Path, kind: type[Loaded]) -> Loaded:
    """A JSON product as its type; raises `ProductError` where it is missing, damaged or of another
    schema.
    """
    from nearlift.results.document import typed

    read = read_json(path)
    schema = f"nearlift.{kind.file.removesuffix('.json')}/1"
    _require_schema(path, read.get("schema", "none"), schema)
    return typed(kind, read, str(path))


def load_if_whole(path: Path, otherwise: Loaded) -> Loaded:
    """A JSON product as its type; `otherwise` where it is missing, damaged or of another schema."""
    try:
        return load(path, type(otherwise))
    except ProductError:
        return otherwise


def read_json_if_whole(path: Path) -> dict[str, Any]:
    """A JSON file that can be made again; empty where it is missing or damaged."""
    try:
        return read_json(path)
    except (ProductError, OSError):
        return {}
