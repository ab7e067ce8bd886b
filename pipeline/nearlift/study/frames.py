"""Tables as pandas holds them, which comes with the extra ``nearlift[pandas]``: the command line
needs none of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from nearlift.errors import UsageError

if TYPE_CHECKING:
    import pandas as pd


def frame(content: Any) -> pd.DataFrame:
    """Columns by name, or rows, as a table.

    Raises
    ------
    UsageError
        pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise UsageError(
            "tables", "need the package pandas", 'pip install "nearlift[pandas]"'
        ) from None
    return pd.DataFrame(content)
