"""Tables of products as Arrow has them: columns in the order of their schema, with units and
meanings, and a digest of what no checksum of a page covers.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nearlift.errors import ProductError
from nearlift.run.schema import Product

if TYPE_CHECKING:
    import pyarrow as pa


def to_arrow(table: Mapping[str, NDArray[Any]], product: Product) -> pa.Table:
    """An Arrow table with the product's columns first, their units and meanings in the fields'
    metadata.

    Raises
    ------
    ProductError
        A declared column is missing, lengths differ, or an undeclared column stands in a closed
        product.
    """
    import pyarrow as pa

    declared = {c.name: c for c in product.columns}
    missing = {c.name for c in product.columns if not c.optional} - table.keys()
    extra = table.keys() - declared.keys()
    if missing or (extra and not product.open_ended):
        raise ProductError(
            product.file,
            f"lacks {sorted(missing)}, has undeclared {sorted(extra)}",
            "this is a defect of the stage that writes it",
        )
    if len({len(v) for v in table.values()}) > 1:
        raise ProductError(
            product.file,
            "has columns of different lengths",
            "this is a defect of the stage that writes it",
        )
    kinds = {"text": pa.string(), "real": pa.float64(), "integer": pa.int64()}
    fields, arrays = [], []
    for name in (*(n for n in declared if n in table), *(n for n in table if n not in declared)):
        values = np.asarray(table[name])
        column = declared.get(name)
        kind = kinds[column.kind] if column else _arrow_type(values)
        meta = {"unit": column.unit, "meaning": column.meaning} if column else {}
        fields.append(pa.field(name, kind, metadata=meta or None))
        arrays.append(_arrow(values, kind))
    schema = pa.schema(fields)
    rows = len(arrays[0]) if arrays else 0
    about = {"schema": product.schema, "layout": layout(schema, rows)}
    return pa.Table.from_arrays(arrays, schema=schema.with_metadata(about))


def layout(schema: pa.Schema, rows: int) -> str:
    """Digest of what stands in the footer of a Parquet file, out of reach of the pages'
    checksums.
    """
    columns = [(name, str(kind)) for name, kind in zip(schema.names, schema.types, strict=True)]
    return hashlib.sha256(json.dumps([rows, columns]).encode()).hexdigest()


def _arrow(values: NDArray[Any], kind: pa.DataType) -> pa.Array:
    """A column from its bytes; `pyarrow.array` would import pandas to see whether it was given a
    Series, which takes 0.3 s.
    """
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


def _arrow_type(values: NDArray[Any]) -> Any:
    import pyarrow as pa

    if values.dtype.kind in "OUS":
        return pa.string()
    return pa.int64() if values.dtype.kind in "iu" else pa.float64()


def to_numpy(column: pa.ChunkedArray) -> NDArray[Any]:
    """A column's values; texts as objects. Numbers without pandas, which Arrow's own `to_numpy`
    imports.
    """
    import pyarrow as pa

    if pa.types.is_string(column.type):
        return np.asarray(column.to_pylist(), dtype=object)
    return np.array(np.from_dlpack(column.combine_chunks()))
