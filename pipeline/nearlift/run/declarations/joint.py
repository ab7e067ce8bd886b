"""Stage joint: lift and downwash fitted together."""

from __future__ import annotations

from nearlift.run.declarations.flow import DOWNWASH
from nearlift.run.declarations.ingest import TRIALS
from nearlift.run.schema import Product
from nearlift.run.stage import Stage

JOINT = Product(file="joint.json", title="Lift and downwash fitted together", row="boundary")
STAGE = Stage(
    name="joint",
    summary="lift and downwash informing one coefficient",
    help="Only where the manifest has [fit.<boundary>] downwash = true.",
    reads=(TRIALS, DOWNWASH),
    writes=(JOINT,),
    sections=("vehicle", "rig", "load_cell", "trials", "levels", "uncertainty", "fit", "piv"),
    where="joint",
)
