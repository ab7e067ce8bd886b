"""nearlift: near-boundary lift of tethered rotorcraft, from load-cell records to models with honest
uncertainty.

>>> import nearlift
>>> study = nearlift.load("raw/my-rig")    # doctest: +SKIP
>>> print(study.diagnose())    # doctest: +SKIP
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from nearlift.version import __version__

if TYPE_CHECKING:
    from nearlift.study import Study, load, trials

__all__ = ["Study", "__version__", "load", "trials"]


def __getattr__(name: str) -> Any:
    # imported when it is first asked for
    if name in ("Study", "load", "trials"):
        return getattr(importlib.import_module("nearlift.study"), name)
    raise AttributeError(f"module 'nearlift' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
