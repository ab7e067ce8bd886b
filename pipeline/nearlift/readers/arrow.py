"""Arrow arrays as numpy ones. Arrow's own `to_numpy` imports pandas (0.3 s) to see whether there is
something to do for it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pyarrow as pa


def floats(column: pa.Array) -> NDArray[np.float64]:
    """A numeric array as float64, null as NaN; whole numbers beyond 2^53 (no converter has so many
    counts) are rounded.
    """
    import pyarrow.compute as pc

    if not len(column):
        return np.empty(0)
    values: Any = pc.cast(column, "float64", safe=False)
    result = np.frombuffer(
        values.buffers()[1], dtype=np.float64, count=len(values), offset=8 * values.offset
    )
    if not values.null_count:
        return result
    # `fill_null` would import pandas as well
    null = pc.cast(pc.is_null(values), "uint8")
    return np.where(
        np.frombuffer(null.buffers()[1], dtype=np.uint8, count=len(null), offset=null.offset),
        np.nan,
        result,
    )


def indices(column: pa.DictionaryArray) -> NDArray[np.int64]:
    """Indices of a dictionary array without nulls."""
    import pyarrow.compute as pc

    values: Any = pc.cast(column.indices, "int64")
    return (
        np.frombuffer(
            values.buffers()[1], dtype=np.int64, count=len(values), offset=8 * values.offset
        )
        if len(values)
        else np.empty(0, dtype=np.int64)
    )
