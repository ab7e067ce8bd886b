"""provenance.json: what each stage read, what it made of it, and by what. Files go by SHA-256."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from nearlift.results.document import IfAny, Real


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """Options of the command line that decide numbers."""

    seed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class InputDigest:
    """A raw file, or all velocity grids of one case."""

    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StageMaterial:
    """Everything that decides a stage's output: digests of code, sections of the manifest, inputs
    and products, versions and seed.
    """

    code: str
    versions: Mapping[str, str]
    seed: int
    manifest: Mapping[str, str]
    inputs: Mapping[str, str]
    products: Mapping[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class StageRecord:
    """One stage that is done; `outputs` by ``processed/...`` or ``reports/...``, `rejected` trials
    with the reason, `overrides` options of the command line that override the manifest.
    """

    material: StageMaterial
    outputs: Mapping[str, str]
    rejected: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    wall_s: Real
    overrides: IfAny[Mapping[str, object]] = None


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
    options: RunOptions = RunOptions(seed=0)
    inputs: Mapping[str, InputDigest] = field(default_factory=dict)
    stages: Mapping[str, StageRecord] = field(default_factory=dict)
