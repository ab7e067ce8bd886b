"""Arrow arrays as numpy ones, by DLPack: Arrow's own `to_numpy` imports pandas (0.3 s)."""

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
    import pyarrow as pa
    import pyarrow.compute as pc

    values: Any = pc.cast(column, "float64", safe=False)
    if values.null_count:
        # from bytes: `pa.scalar` and `pa.array` would import pandas as well
        nan = pa.Array.from_buffers(pa.float64(), 1, [None, pa.py_buffer(np.array([np.nan]))])
        values = pc.fill_null(values, nan[0])
    return np.asarray(np.from_dlpack(values), dtype=np.float64)
