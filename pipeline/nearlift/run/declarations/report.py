"""Stage report, which reads every product."""

from __future__ import annotations

from nearlift.run.stage import Stage

STAGE = Stage(
    name="report",
    summary="figures, tables and index.html",
    sections=(
        "name",
        "simulated",
        "note",
        "vehicle",
        "rig",
        "load_cell",
        "trials",
        "levels",
        "fit",
        "report",
        "uncertainty",
        "piv",
    ),
    raw=True,
    piv=True,
    report=True,
)
