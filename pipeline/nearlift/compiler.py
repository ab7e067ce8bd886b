"""numba without the settings of the current folder, and with its cache where only this user can
write.
"""

from __future__ import annotations

import os
from typing import Any

from nearlift import isolation

numba = isolation.library("numba")
config = numba.core.config
# it is looked for again at every compilation
config._config_fname = os.devnull


def compiled(function: Any, **how: Any) -> Any:
    """The function compiled, and kept for the next run where there is a folder for it."""
    how = {"nogil": True, "error_model": "numpy", **how}
    folder = isolation.code_folder()
    if folder is None:
        return numba.njit(**how)(function)
    # numba reads what it kept by pickle: from this folder and no other
    bound = {"CACHE_DIR": str(folder), "CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator"}
    before = {name: getattr(config, name, "") for name in bound}
    try:
        vars(config).update(bound)
        return numba.njit(cache=True, **how)(function)
    except RuntimeError:
        # the folder has no room, or is read-only
        return numba.njit(**how)(function)
    finally:
        vars(config).update(before)
