"""provenance.json: inputs, products and software of each stage. Files are identified by SHA-256."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from nearlift.results.document import Real


@dataclass(frozen=True, slots=True, kw_only=True)
class StageRecord:
    """Record of one stage that is done.

    `material` has the digests of everything that decides its output. `outputs` has those of its
    files, by ``processed/...`` or ``reports/...``. `rejected` are trials with the reason.
    """

    material: Mapping[str, str]
    outputs: Mapping[str, str]
    rejected: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    wall_s: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class ProvenanceLedger:
    """The whole file; empty before the first stage."""

    file: ClassVar[str] = "provenance.json"

    schema: str = "nearlift.provenance/1"
    campaign: str = ""
    vehicle: str = ""
    nearlift: str = ""
    platform: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, int] = field(default_factory=dict)
    inputs: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    stages: Mapping[str, StageRecord] = field(default_factory=dict)

    @property
    def outputs(self) -> dict[str, str]:
        """Digests of all products, by name."""
        return {name: sha for stage in self.stages.values() for name, sha in stage.outputs.items()}
