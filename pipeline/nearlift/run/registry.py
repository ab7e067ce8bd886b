"""The stages in the order in which they run, and every product that they write.

A new stage is one more name here, and a file of that name in `declarations`.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from dataclasses import replace

from nearlift.errors import DeclarationError, UsageError
from nearlift.run.schema import Product
from nearlift.run.stage import Stage

ORDER = (
    "ingest",
    "reduce",
    "fit",
    "diagnose",
    "flow",
    "simulate",
    "detect",
    "report",
)
PROVENANCE = Product(file="provenance.json", title="What made these products", row="stage")


def ordered(declared: Iterable[Stage]) -> tuple[Stage, ...]:
    """The stages, each reading only what an earlier one writes; a report reads every product.

    Raises
    ------
    DeclarationError
        Two stages have one name, or one reads what none before it has written.
    """
    stages: dict[str, Stage] = {}
    for stage in declared:
        written = products(stages.values())
        if stage.name in stages:
            raise DeclarationError(f"stage {stage.name}", "is declared twice", "rename one of them")
        if early := [p.file for p in stage.reads if p not in written]:
            raise DeclarationError(
                f"stage {stage.name}",
                f"reads {early[0]}, which no stage before it writes",
                "put it behind the one that does",
            )
        stages[stage.name] = replace(stage, reads=written) if stage.report else stage
    return tuple(stages.values())


def products(stages: Iterable[Stage]) -> tuple[Product, ...]:
    """What they write, each where it is written last."""
    written = [product for stage in stages for product in stage.writes]
    return tuple(p for i, p in enumerate(written) if p not in written[i + 1 :])


STAGES = ordered(
    importlib.import_module(f"nearlift.run.declarations.{name}").STAGE for name in ORDER
)
PRODUCTS = (*products(STAGES), PROVENANCE)


def stage(name: str) -> Stage:
    """The stage of that name."""
    for item in STAGES:
        if item.name == name:
            return item
    raise UsageError("stage", f"{name!r} is not a stage", f"stages are {', '.join(ORDER)}")
