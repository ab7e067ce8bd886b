"""The stages in order, what makes one stale, and the run that brings them up to date.

A stage is stale when what it read has changed in content: the manifest's sections that concern it,
the raw files, the products of earlier stages, the seed, or the code. Times do not count. What a
stage wrote is checked by digest too, so a damaged or deleted product is made again.
`provenance.json`, written last after each stage, is what commits it.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import json
import os
import platform
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import Any

import nearlift
from nearlift.errors import ProductError, UsageError
from nearlift.products import (
    DIAGNOSIS,
    DOWNWASH,
    FIT,
    FLOW_PRODUCTS,
    JOINT,
    LIFT,
    LIFT_COVARIANCE,
    LOOP_RESIDUALS,
    POSTERIOR,
    PRODUCTS,
    PROFILES,
    PROVENANCE,
    PROXIMITY_PRODUCTS,
    QUALITY,
    RESULTS,
    SIMULATION_PRODUCTS,
    TRIALS,
    Product,
)
from nearlift.run import store
from nearlift.run.job import PIV_INPUT, Job, Outcome
from nearlift.run.lock import locked, room, swept
from nearlift.run.transaction import Transaction


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """One verb: what it reads and writes, and the module whose `run(job)` does it (imported only
    when it runs).

    `raw`: it reads the records; `piv`: it reads the velocity grids. `where`: it belongs to a run
    only where the campaign has that.
    """

    name: str
    summary: str
    reads: tuple[Product, ...] = ()
    writes: tuple[Product, ...] = ()
    sections: tuple[str, ...] = ()
    raw: bool = False
    piv: bool = False
    report: bool = False
    where: str = ""

    def configured(self, job: Job) -> bool:
        """Whether this campaign asks for the stage."""
        return not self.where or getattr(job.campaign, self.where) is not None

    def run(self, job: Job) -> Outcome:
        """Do it."""
        module = importlib.import_module(f"nearlift.stages.{self.name}")
        outcome: Outcome = module.run(job)
        return outcome


STAGES = (
    Stage(
        name="ingest",
        summary="raw records to one row per trial",
        writes=(TRIALS,),
        sections=(
            "name",
            "simulated",
            "vehicle",
            "rig",
            "load_cell",
            "records",
            "trials",
            "quality",
        ),
        raw=True,
    ),
    Stage(
        name="reduce",
        summary="trials to Delta L per cell, with its covariance",
        reads=(TRIALS,),
        writes=(LIFT, LIFT_COVARIANCE),
        sections=("vehicle", "quality"),
    ),
    Stage(
        name="fit",
        summary="lift models by least squares, and their posteriors",
        reads=(TRIALS,),
        writes=(FIT, PROFILES, POSTERIOR, RESULTS),
        sections=("vehicle", "rig", "load_cell", "uncertainty", "fit"),
    ),
    Stage(
        name="diagnose",
        summary="the residual, traced to what the model lacks",
        reads=(TRIALS, FIT),
        writes=(DIAGNOSIS, LOOP_RESIDUALS, RESULTS),
        sections=("vehicle", "rig", "load_cell", "uncertainty", "fit", "diagnose"),
    ),
    Stage(
        name="flow",
        summary="velocity grids to downwash and topology",
        writes=FLOW_PRODUCTS,
        sections=("name", "vehicle", "rig", "piv"),
        piv=True,
        where="piv",
    ),
    Stage(
        name="joint",
        summary="lift and downwash informing one coefficient",
        reads=(TRIALS, DOWNWASH),
        writes=(JOINT,),
        sections=("vehicle", "rig", "load_cell", "uncertainty", "fit", "piv"),
        where="joint",
    ),
    Stage(
        name="simulate",
        summary="crash rates and energy near ground and ceiling",
        reads=(TRIALS, FIT, DIAGNOSIS, RESULTS),
        writes=SIMULATION_PRODUCTS,
        sections=("vehicle", "rig", "simulate"),
        where="simulate",
    ),
    Stage(
        name="detect",
        summary="how far away a boundary shows in lift",
        reads=(TRIALS, FIT, DIAGNOSIS, RESULTS),
        writes=PROXIMITY_PRODUCTS,
        sections=("vehicle", "rig", "detect"),
        where="detect",
    ),
    Stage(
        name="ledger",
        summary="every trial from raw byte to figure, and what its exclusion is worth",
        reads=(TRIALS, FIT),
        writes=(QUALITY,),
        sections=("vehicle", "rig", "load_cell", "uncertainty", "fit"),
    ),
    Stage(
        name="report",
        summary="figures, tables and index.html",
        reads=tuple(product for product in PRODUCTS if product is not PROVENANCE),
        sections=(
            "name",
            "simulated",
            "note",
            "vehicle",
            "rig",
            "load_cell",
            "fit",
            "report",
            "uncertainty",
            "piv",
        ),
        raw=True,
        piv=True,
        report=True,
    ),
)
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


def stage(name: str) -> Stage:
    """The stage of that name."""
    for item in STAGES:
        if item.name == name:
            return item
    raise UsageError(
        "stage", f"{name!r} is not a stage", f"stages are {', '.join(s.name for s in STAGES)}"
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
class Ledger:
    """provenance.json of one campaign: what was read, what was made of it, by what."""

    job: Job
    content: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def open(cls, job: Job) -> Ledger:
        """The ledger on disk, or an empty one."""
        path = job.processed / PROVENANCE.file
        content = store.read_json_if_whole(path)
        return cls(job=job, content=content if content.get("schema") == PROVENANCE.schema else {})

    def material(self, stage: Stage) -> dict[str, Any]:
        """Everything that decides the stage's output, by content."""
        sections = {
            s: _digest(self.job.campaign.model_dump(mode="json", by_alias=True)[s])
            for s in stage.sections
        }
        products = {p.file: self.job.processed / p.file for p in stage.reads}
        return {
            "code": code_digest(),
            "versions": versions(),
            "seed": self.job.seed,
            "manifest": sections,
            "inputs": self._inputs(stage),
            "products": {
                file: store.sha256(path) for file, path in products.items() if path.is_file()
            },
        }

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
        record = self.content.get("stages", {}).get(stage.name)
        if record is None:
            return "has not run yet"
        for file in (f"processed/{p.file}" for p in stage.writes):
            if file not in record["outputs"] and not any(
                file in r["outputs"] for r in self._later(stage)
            ):
                return f"{file} is as an earlier stage left it"
        for file, sha in record["outputs"].items():
            path = self.job.homes.place(file)
            if not path.is_file():
                return f"{file} is missing"
            if store.sha256(path) != sha:
                return f"{file} was changed after it was written"
        waiting = sum(reason.startswith("PENDING") for _, reason in record["rejected"])
        if waiting:
            return f"{waiting} record{'s were' if waiting > 1 else ' was'} still being written"
        before, now = record["material"], self.material(stage)
        if before["code"] != now["code"]:
            return "nearlift itself has changed"
        for name, meaning in (
            ("versions", "version of {}"),
            ("manifest", "[{}] of the manifest"),
            ("inputs", "{}"),
            ("products", "{}"),
        ):
            changed = sorted(
                k
                for k in before[name].keys() | now[name].keys()
                if before[name].get(k) != now[name].get(k)
            )
            if changed and name == "manifest" and record.get("overrides", {}) != self.job.overrides:
                return (
                    f"was last run with {_options(record['overrides'])}"
                    if record.get("overrides")
                    else f"{_options(self.job.overrides)} is asked for"
                )
            if changed:
                more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
                return f"{meaning.format(changed[0])} has changed{more}"
        return "the seed has changed" if before["seed"] != now["seed"] else ""

    def _later(self, stage: Stage) -> list[dict[str, Any]]:
        """What is on record of the stages after this one."""
        names = [s.name for s in STAGES]
        done = self.content.get("stages", {})
        return [done[name] for name in names[names.index(stage.name) + 1 :] if name in done]

    def commit(
        self,
        stage: Stage,
        outcome: Outcome,
        material: dict[str, Any],
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
            name: {
                **record,
                "outputs": {f: sha for f, sha in record["outputs"].items() if f not in outputs},
            }
            for name, record in self.content.get("stages", {}).items()
        }
        stages[stage.name] = {
            "material": material,
            "outputs": outputs,
            "rejected": [list(r) for r in outcome.rejected],
            "notes": list(outcome.notes),
            "wall_s": wall_s,
            **({"overrides": dict(self.job.overrides)} if self.job.overrides else {}),
        }
        self.content = {
            "schema": PROVENANCE.schema,
            "campaign": self.job.campaign.name,
            "vehicle": self.job.campaign.vehicle.name,
            "nearlift": nearlift.__version__,
            "platform": platform.platform(),
            "versions": versions(),
            "options": {"seed": self.job.seed},
            "inputs": {name: {"sha256": sha} for name, sha in self.job.inputs.items()},
            "stages": {s.name: stages[s.name] for s in STAGES if s.name in stages},
        }
        change.write(f"processed/{PROVENANCE.file}", store.json_bytes(self.content))
        change.commit()


def _options(overrides: Mapping[str, Any]) -> str:
    return " ".join(f"--{name} {value}" for name, value in overrides.items())


#: Bytes that figures and page take, and a trial in tables and page, both measured and rounded up.
PAGE_BYTES, TRIAL_BYTES = 12_000_000, 2_000


def _needed(job: Job, wanted: Sequence[Stage]) -> int:
    """Bytes that the stages may write: from the length of the schedule, and twice, since old
    products stand until new ones are whole.
    """
    schedule = job.root / job.campaign.trials.file
    rows = schedule.stat().st_size // 8 if schedule.is_file() else 0
    return 2 * (TRIAL_BYTES * rows + (PAGE_BYTES if any(item.report for item in wanted) else 0))


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """What happened to one stage: `why` it was stale (empty: it was not), and its outcome."""

    stage: Stage
    why: str
    outcome: Outcome
    wall_s: float = 0.0


def plan(job: Job, wanted: Sequence[Stage] = STAGES) -> Iterator[tuple[Stage, str]]:
    """Each stage with the reason for which it is stale, empty if it is up to date; runs nothing."""
    ledger = Ledger.open(job)
    upstream: dict[str, str] = {}
    for item in wanted:
        if not item.configured(job):
            continue
        why = ledger.why_stale(item)
        late = next((upstream[p.file] for p in item.reads if p.file in upstream), "")
        why = why or (f"{late} will run" if late else "")
        if why:
            upstream |= {p.file: item.name for p in item.writes}
        yield item, why


def run(
    job: Job,
    wanted: Sequence[Stage] = STAGES,
    begin: Callable[[Stage, str], None] = lambda s, w: None,
    force: bool = False,
) -> Iterator[Step]:
    """Bring the wanted stages up to date, in order; yields what happened to each."""
    with contextlib.ExitStack() as held:
        yield from _run(job, wanted, begin, force, held)


def _run(
    job: Job,
    wanted: Sequence[Stage],
    begin: Callable[[Stage, str], None],
    force: bool,
    held: contextlib.ExitStack,
) -> Iterator[Step]:
    ledger = Ledger.open(job)
    alone = False
    for item in wanted:
        if not (force or item.configured(job)):
            continue
        why = ledger.why_stale(item) or ("asked for" if force else "")
        if why and not alone:
            room(job.processed, _needed(job, wanted))
            left = held.enter_context(locked(job.homes))
            alone = True
            # another run may have ended since
            ledger = Ledger.open(job)
            why = ledger.why_stale(item) or ("asked for" if force else "")
            why = f"{why}; {left}" if why and left else why
        if not why:
            record = ledger.content["stages"][item.name]
            yield Step(
                stage=item,
                why="",
                outcome=Outcome(
                    rejected=tuple((t, r) for t, r in record["rejected"]),
                    notes=tuple(record["notes"]),
                ),
            )
            continue
        begin(item, why)
        material = ledger.material(item)
        start = time.perf_counter()
        with Transaction(homes=job.homes) as change:
            outcome = item.run(replace(job, change=change))
            ledger.commit(item, outcome, material, time.perf_counter() - start, change)
        wall_s = time.perf_counter() - start
        yield Step(stage=item, why=why, outcome=outcome, wall_s=wall_s)
    if not alone:
        swept(job.homes)
