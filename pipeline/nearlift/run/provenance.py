"""provenance.json: what each stage read, what it made of it and by what, from which follows what
is stale.

A stage is stale when what it read has changed in content: the manifest's sections that concern it,
the raw files, the products of earlier stages, the seed, or the code. Times do not count. What a
stage wrote is checked by digest too, so a damaged or deleted product is made again. The file,
written last after each stage, is what commits it.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import platform
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any

import nearlift
from nearlift.errors import ProductError
from nearlift.results.provenance import (
    InputDigest,
    ProvenanceLedger,
    RunOptions,
    StageMaterial,
    StageRecord,
)
from nearlift.run import store
from nearlift.run.job import PIV_INPUT, Job, Outcome
from nearlift.run.registry import PROVENANCE, STAGES
from nearlift.run.stage import Stage
from nearlift.run.transaction import Transaction

#: Packages whose version can change a number.
NUMERICAL = (
    "numpy",
    "scipy",
    "lmfit",
    "emcee",
    "numba",
    "pyarrow",
    "matplotlib",
    "pint",
    "pydantic",
)


@functools.cache
def code_digest() -> str:
    """Digest of nearlift's own source, so that products of older code are stale."""
    package = str(Path(nearlift.__file__).parent)
    files = []
    for folder, folders, names in os.walk(package):
        folders[:] = [name for name in folders if name != "__pycache__"]
        files += [os.path.join(folder, name) for name in names]  # noqa: PTH118 - four hundred paths take long
    digest = hashlib.sha256()
    for file in sorted(files):
        with open(file, "rb", buffering=0) as source:  # noqa: PTH123
            digest.update(file.removeprefix(package).encode() + b"\0" + source.read())
    return digest.hexdigest()


@functools.cache
def versions() -> dict[str, str]:
    """Versions of Python and of the packages whose version can change a number."""
    return {"python": platform.python_version(), **{name: _version(name) for name in NUMERICAL}}


def _version(package: str) -> str:
    # among the first lines; the library parses all, with the page's description, as an e-mail
    stated = re.search(
        r"^Version: *(.+?) *$",
        metadata.distribution(package).read_text("METADATA") or "",
        re.MULTILINE,
    )
    return stated.group(1) if stated else metadata.version(package)


@dataclass(kw_only=True)
class Provenance:
    """What stands in provenance.json of one campaign."""

    job: Job
    ledger: ProvenanceLedger

    @classmethod
    def open(cls, job: Job) -> Provenance:
        """That on disk, or an empty one."""
        path = job.processed / PROVENANCE.file
        return cls(job=job, ledger=store.load_if_whole(path, ProvenanceLedger()))

    def material(self, stage: Stage) -> StageMaterial:
        """Everything that decides the stage's output, by content."""
        sections = {
            s: _digest(self.job.campaign.model_dump(mode="json", by_alias=True)[s])
            for s in stage.sections
        }
        products = {p.file: self.job.processed / p.file for p in stage.reads}
        return StageMaterial(
            code=code_digest(),
            versions=versions(),
            seed=self.job.seed,
            manifest=sections,
            inputs=self._inputs(stage),
            products={
                file: store.sha256(path) for file, path in products.items() if path.is_file()
            },
        )

    def _inputs(self, stage: Stage) -> dict[str, str]:
        """Digests of the raw files that the stage reads; the manifest counts by its sections, but a
        report quotes its digest.
        """
        apart = (
            set()
            if stage.report
            else {"campaign.toml", *(overlay.file for overlay in self.job.campaign.report.overlay)}
        )
        return {
            name: sha
            for name, sha in self.job.inputs.items()
            if name not in apart and (stage.piv if name.startswith(PIV_INPUT) else stage.raw)
        }

    def why_stale(self, stage: Stage) -> str:
        """Why the stage must run, in words; empty if it need not."""
        record = self.ledger.stages.get(stage.name)
        if record is None:
            return "has not run yet"
        names, done = [s.name for s in STAGES], self.ledger.stages
        later = [done[name] for name in names[names.index(stage.name) + 1 :] if name in done]
        for file in (f"processed/{p.file}" for p in stage.writes):
            if file not in record.outputs and not any(file in r.outputs for r in later):
                return f"{file} is as an earlier stage left it"
        for file, sha in record.outputs.items():
            path = self.job.homes.place(file)
            if not path.is_file():
                return f"{file} is missing"
            if store.sha256(path) != sha:
                return f"{file} was changed after it was written"
        waiting = sum(reason.startswith("PENDING") for _, reason in record.rejected)
        if waiting:
            return f"{waiting} record{'s were' if waiting > 1 else ' was'} still being written"
        before, now = record.material, self.material(stage)
        if before.code != now.code:
            return "nearlift itself has changed"
        overrides = record.overrides or {}
        for old, new, meaning in (
            (before.versions, now.versions, "version of {}"),
            (before.manifest, now.manifest, "[{}] of the manifest"),
            (before.inputs, now.inputs, "{}"),
            (before.products, now.products, "{}"),
        ):
            changed = sorted(k for k in old.keys() | new.keys() if old.get(k) != new.get(k))
            if changed and old is before.manifest and overrides != self.job.overrides:
                return (
                    f"was last run with {_options(overrides)}"
                    if overrides
                    else f"{_options(self.job.overrides)} is asked for"
                )
            if changed:
                more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
                return f"{meaning.format(changed[0])} has changed{more}"
        return "the seed has changed" if before.seed != now.seed else ""

    def commit(
        self,
        stage: Stage,
        outcome: Outcome,
        material: StageMaterial,
        wall_s: float,
        change: Transaction,
    ) -> None:
        """Record that the stage is done, and put the record and all that the stage wrote in their
        places, in one step.

        Raises
        ------
        ProductError
            The stage did not write what it declares.
        """
        lacking = [p.file for p in stage.writes if f"processed/{p.file}" not in change.written]
        if lacking:
            raise ProductError(
                lacking[0], f"was not written by {stage.name}", "this is a defect of the stage"
            )
        # only what the stage itself made: whatever else lies in the folder is somebody's own
        outputs = dict(sorted(change.written.items()))
        # a file is that of the stage that wrote it last
        stages = {
            name: replace(
                record, outputs={f: sha for f, sha in record.outputs.items() if f not in outputs}
            )
            for name, record in self.ledger.stages.items()
        }
        stages[stage.name] = StageRecord(
            material=material,
            outputs=outputs,
            rejected=tuple(outcome.rejected),
            notes=tuple(outcome.notes),
            wall_s=wall_s,
            overrides=dict(self.job.overrides) or None,
        )
        self.ledger = ProvenanceLedger(
            campaign=self.job.campaign.name,
            vehicle=self.job.campaign.vehicle.name,
            nearlift=nearlift.__version__,
            platform=platform.platform(),
            versions=versions(),
            options=RunOptions(seed=self.job.seed),
            inputs={name: InputDigest(sha256=sha) for name, sha in self.job.inputs.items()},
            stages={s.name: stages[s.name] for s in STAGES if s.name in stages},
        )
        change.write(f"processed/{PROVENANCE.file}", store.json_bytes(self.ledger))
        change.commit()


def _options(overrides: Mapping[str, object]) -> str:
    return " ".join(f"--{name} {value}" for name, value in overrides.items())


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()
