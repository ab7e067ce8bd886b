"""The stages of a run, a file each: the columns that it writes, then `run`, which reads products,
calls a core and writes.

A stage file imports what its core needs when it runs, because the command line is made of all of
them.
"""

from __future__ import annotations

import importlib

from nearlift.run.engine import ordered_stages, products_of
from nearlift.run.tables import PROVENANCE

#: A new stage is one more name, and a file of that name with its `STAGE`.
ORDER = ("ingest", "reduce", "fit", "flow", "diagnose", "simulate", "detect", "report")
STAGES = ordered_stages(importlib.import_module(f"nearlift.stages.{name}").STAGE for name in ORDER)
PRODUCTS = (*products_of(STAGES), PROVENANCE)
