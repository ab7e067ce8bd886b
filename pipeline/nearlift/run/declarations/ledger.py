"""Stage ledger: every trial from raw byte to figure."""

from __future__ import annotations

from nearlift.run.declarations.fit import FIT
from nearlift.run.declarations.ingest import TRIALS
from nearlift.run.schema import Product
from nearlift.run.stage import Stage

#: A column of trials.parquet has the name of the file already.
QUALITY = Product(
    file="quality.json",
    called="ledger",
    title="Every trial from raw byte to figure, and what each exclusion is worth",
    row="trial",
)
STAGE = Stage(
    name="ledger",
    summary="every trial's path, and what leaving it out is worth",
    reads=(TRIALS, FIT),
    writes=(QUALITY,),
    sections=("vehicle", "rig", "load_cell", "trials", "levels", "uncertainty", "fit"),
)
