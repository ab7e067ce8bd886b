"""A run: which stages are stale, and how what they write gets to the disk.

A stage is a function of a `Job`. It is stale when a digest of its inputs is not the one in
provenance.json, or a product is not what it wrote. Inputs are sections of the manifest, raw files,
earlier products, seed and code.

A stage's files are kept in memory until it is done. Then its record leaves provenance.json, its
files take their places, and its record is written last. A killed run leaves a stage that is stale.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import platform
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent import futures
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from nearlift import blas
from nearlift.errors import DeclarationError, InputRefused, NearliftError, ProductError, UsageError
from nearlift.run import tables
from nearlift.run.raw_files import Inputs, RawFiles, list_digest
from nearlift.run.tables import LEDGER, Product
from nearlift.version import __version__

# the command line is made of stages, so what a manifest needs is imported where a job is opened
if TYPE_CHECKING:
    from nearlift.campaign.manifest import Campaign
    from nearlift.results.provenance import ProvenanceLedger, StageMaterial

MANIFEST = "campaign.toml"
LOCK = ".lock"
#: Digests of raw files by size and time of last change, so that they are not hashed at each run.
CACHE = "inputs-cache.json"
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


def is_unfinished(name: str) -> bool:
    """Whether this names an unfinished file: a dot, the file's name, its process, ``tmp``."""
    head, _, process = name.removesuffix(".tmp").rpartition(".")
    return name.endswith(".tmp") and head.startswith(".") and len(head) > 1 and process.isdigit()


class Busy(NearliftError):
    """Another run works on the same products."""


# ---- stages


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """An option of a stage's command: text unless it is one of `choices`, a whole number within
    `limits`, or `real`.
    """

    flag: str
    help: str
    choices: tuple[str, ...] = ()
    limits: tuple[int, int] | None = None
    real: bool = False
    metavar: str | None = None

    @property
    def name(self) -> str:
        """The flag as a Python name."""
        return self.flag.removeprefix("--").replace("-", "_")


@dataclass(frozen=True, slots=True, kw_only=True)
class StageQuestion:
    """A question that a stage's command answers instead of running the stage, where one of its
    options is given.
    """

    options: tuple[Option, ...]
    example: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageChapter:
    """The chapter of the report in which a stage's products are shown.

    Attributes
    ----------
    figures : tuple of str
        Names of modules under `report.figures`, each with its `FIGURE`.
    facts : str
        Function, as ``module:name``, from evidence to what the template of the stage's name prints;
        empty where the chapter is its figures.
    """

    title: str
    figures: tuple[str, ...] = ()
    facts: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """One step of a run, which is also a command.

    Attributes
    ----------
    summary, help : str
        Its line in the list of commands, at most 60 letters; further text of its help.
    run : callable
        Does it; imports what it needs when it is called.
    reads, writes : tuple of Product
        A `report` reads every product.
    sections : tuple of str
        Sections of the manifest that enter what it writes: a change in one makes it stale.
    inputs : callable or None
        Raw files that it reads, of the campaign's folder and manifest; a `report` prints the
        digests of all.
    where : str
        It belongs to a run only where the campaign has this section.
    options : tuple of Option
        Of its command; each takes the place of a key of the manifest's section of the stage's name.
    chapter : StageChapter or None
        Its chapter of the report, unless the report gives it a place of its own.
    """

    name: str
    summary: str
    run: Callable[[Job], Outcome]
    help: str = ""
    reads: tuple[Product, ...] = ()
    writes: tuple[Product, ...] = ()
    sections: tuple[str, ...] = ()
    inputs: Callable[[Path, Campaign], Inputs] | None = None
    report: bool = False
    where: str = ""
    options: tuple[Option, ...] = ()
    question: StageQuestion | None = None
    chapter: StageChapter | None = None

    def configured(self, campaign: Campaign) -> bool:
        """Whether this campaign asks for the stage."""
        return not self.where or getattr(campaign, self.where) is not None


def ordered_stages(declared: Iterable[Stage]) -> tuple[Stage, ...]:
    """The stages, each reading only what an earlier one writes; a report reads every product.

    Raises
    ------
    DeclarationError
        Two stages have one name, or one reads what none before it has written.
    """
    stages: dict[str, Stage] = {}
    for stage in declared:
        written = products_of(stages.values())
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


def products_of(stages: Iterable[Stage]) -> tuple[Product, ...]:
    """The products of stages, each where it is written last."""
    written = [product for stage in stages for product in stage.writes]
    return tuple(p for i, p in enumerate(written) if p not in written[i + 1 :])


# ---- jobs


class Say(Protocol):
    """Hears what is being done, as ``"ingest 120 of 3600 trials"``, and the share of the activity
    that is done, where it is known.
    """

    def __call__(self, text: str, share: float | None = None, /) -> None:
        """Take the text."""


def silent(text: str, share: float | None = None, /) -> None:
    """Say nothing."""


def subprogress(say: Say, i: int, count: int) -> Say:
    """Progress of step `i`, from 0, of `count`."""

    def say_part(text: str, share: float | None = None, /) -> None:
        say(text, (i + (share or 0.0)) / count)

    return say_part


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Result of a stage in words: rejected trials with the reason, and notes for the user."""

    rejected: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One campaign that is worked on.

    Attributes
    ----------
    root : Path
        The campaign's folder, never written.
    processed, reports : Path
        Folders of this campaign's products and figures.
    stages : tuple of Stage
        All stages, in order.
    inputs : mapping of str to str
        SHA-256 of every raw file by its path under `root`, and of every list of velocity grids.
    sources : mapping of str to tuple of str
        Names among `inputs` that each stage reads.
    stamps : mapping of str to (int, int)
        Size and time of last change of each raw file.
    overrides : mapping of str to object
        Values that the command line put in place of the manifest's, by option.
    pending : dict of str to (bytes or None), or None
        Files of the stage that runs, None for one to be removed. Outside stages it is None, and
        each file is written at once.
    """

    root: Path
    campaign: Campaign
    processed: Path
    reports: Path
    executor: futures.Executor
    stages: tuple[Stage, ...] = ()
    inputs: Mapping[str, str] = field(default_factory=dict)
    sources: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    stamps: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    seed: int = 0
    say: Say = silent
    overrides: Mapping[str, object] = field(default_factory=dict)
    pending: dict[str, bytes | None] | None = None

    def place(self, name: str) -> Path:
        """Path of a file called ``processed/...`` or ``reports/...``."""
        kind, _, rest = name.partition("/")
        return (self.processed if kind == "processed" else self.reports) / rest

    def put(self, name: str, content: bytes) -> Path:
        """Write a file, called ``processed/...`` or ``reports/...``; returns its path, which the
        file of a stage takes when the stage is done.
        """
        if self.pending is None:
            tables.write_whole(self.place(name), content)
        else:
            self.pending[name] = content
        return self.place(name)

    def remove(self, name: str) -> None:
        """Remove a file of an earlier run, if there is one."""
        if self.pending is None:
            self.place(name).unlink(missing_ok=True)
        elif self.place(name).is_file():
            self.pending[name] = None

    def _content(self, file: str) -> bytes:
        written = (self.pending or {}).get(f"processed/{file}")
        return tables.product_bytes(self.processed / file) if written is None else written

    def overriding(self, section: str, given: Mapping[str, object]) -> Job:
        """The job with keys of one section of the manifest replaced; None leaves a key."""
        known = {k: v for k, v in given.items() if v is not None}
        if not known:
            return self
        wanted = getattr(self.campaign, section).model_copy(update=known)
        return replace(
            self, campaign=self.campaign.model_copy(update={section: wanted}), overrides=known
        )

    def read(self, product: Product) -> tables.Table:
        """A table product of this campaign."""
        where = str(self.processed / product.file)
        return tables.table_of(self._content(product.file), product, where)

    def write(self, product: Product, table: tables.Table) -> None:
        """Write a table product of this campaign."""
        self.put(f"processed/{product.file}", tables.table_bytes(table, product))

    def publish(self, name: str, content: bytes) -> Path:
        """Write a file under `reports`."""
        return self.put(f"reports/{name}", content)

    def read_json(self, product: Product) -> dict[str, Any]:
        """A JSON product of this campaign."""
        return tables.json_of(self._content(product.file), str(self.processed / product.file))

    def write_json(self, product: Product, content: object) -> None:
        """Write a JSON product of this campaign."""
        self.put(f"processed/{product.file}", tables.json_bytes(content))

    def load(self, kind: type[tables.Loaded]) -> tables.Loaded:
        """A JSON product of this campaign as its type."""
        return tables.loaded(self._content(kind.file), kind, str(self.processed / kind.file))

    def save(self, result: tables.Saved) -> None:
        """Write a JSON product of this campaign."""
        self.put(f"processed/{result.file}", tables.json_bytes(result))


def stage_of(stages: Iterable[Stage], name: str) -> Stage:
    """The stage of that name; raises `UsageError` where there is none."""
    named = {stage.name: stage for stage in stages}
    if name not in named:
        raise UsageError("stage", f"{name!r} is not a stage", f"stages are {', '.join(named)}")
    return named[name]


def inputs_of(stages: Iterable[Stage], root: Path, campaign: Campaign) -> dict[str, Inputs]:
    """Raw files of each stage that the campaign asks for."""
    return {
        stage.name: stage.inputs(root, campaign)
        for stage in stages
        if stage.inputs is not None and stage.configured(campaign)
    }


@contextlib.contextmanager
def open_job(
    root: Path,
    out: Path,
    stages: Sequence[Stage],
    executor: futures.Executor,
    seed: int,
    *,
    say: Say = silent,
    keep: bool = True,
    planned: bool = False,
) -> Iterator[Job]:
    """A campaign as a job: manifest checked, raw files hashed. `keep` the digests for the next run;
    a campaign that is only `planned` has no records yet.

    Raises
    ------
    UsageError
        `out` is the campaign's folder, or lies in it.
    """
    from nearlift.campaign import manifest as manifests

    campaign = manifests.load(root)
    if root.is_dir() and out.resolve().is_relative_to(root.resolve()):
        raise UsageError(
            "--out",
            f"{str(out.resolve())!r} lies in the campaign's folder, where nothing is written",
            "name a folder outside it",
        )
    processed = out / "processed" / campaign.name
    raw = RawFiles(root=root, cache=processed / CACHE)
    of_stages = {} if planned else inputs_of(stages, root, campaign)
    listed: dict[str, Sequence[str]] = {} if planned else {MANIFEST: (MANIFEST,)}
    for inputs in of_stages.values():
        listed |= inputs
    yield Job(
        root=root,
        campaign=campaign,
        processed=processed,
        reports=out / "reports" / campaign.name,
        executor=executor,
        stages=tuple(stages),
        inputs=raw.hashed(listed),
        sources={name: tuple(inputs) for name, inputs in of_stages.items()},
        stamps=raw.stamps,
        seed=seed,
        say=say,
    )
    if keep and not planned:
        raw.remember()


# ---- staleness


@functools.cache
def code_digest() -> str:
    """Digest of nearlift's own source, so that products of older code are stale."""
    package = str(Path(__file__).parent.parent)
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
    text = metadata.distribution(package).read_text("METADATA") or ""
    stated = re.search(r"^Version: *(.+?) *$", text, re.MULTILINE)
    return stated.group(1) if stated else metadata.version(package)


def open_ledger(job: Job) -> ProvenanceLedger:
    """The campaign's provenance.json; an empty one where it is missing or damaged."""
    from nearlift.results.provenance import ProvenanceLedger

    path = job.processed / LEDGER
    try:
        return tables.loaded(path.read_bytes(), ProvenanceLedger, str(path))
    except (OSError, ProductError):
        return ProvenanceLedger()


def material(job: Job, stage: Stage) -> StageMaterial:
    """Everything that decides the stage's output, by content."""
    from nearlift.results.provenance import StageMaterial

    manifest = job.campaign.model_dump(mode="json", by_alias=True)
    names = job.inputs if stage.report else job.sources.get(stage.name, ())
    paths = {p.file: job.processed / p.file for p in stage.reads}
    return StageMaterial(
        code=code_digest(),
        versions=versions(),
        seed=job.seed,
        manifest={
            s: tables.digest_of(json.dumps(manifest[s], sort_keys=True, default=str).encode())
            for s in stage.sections
        },
        inputs={name: job.inputs[name] for name in names},
        products={file: tables.sha256(path) for file, path in paths.items() if path.is_file()},
    )


def why_stale(job: Job, stage: Stage, ledger: ProvenanceLedger) -> str:
    """Reason for which the stage must run, in words; empty if it need not."""
    record = ledger.stages.get(stage.name)
    if record is None:
        return "has not run yet"
    names = [s.name for s in job.stages]
    later = [ledger.stages[n] for n in names[names.index(stage.name) + 1 :] if n in ledger.stages]
    for file in (f"processed/{p.file}" for p in stage.writes):
        if file not in record.outputs and not any(file in r.outputs for r in later):
            return f"{file} is as an earlier stage left it"
    for file, sha in record.outputs.items():
        if not job.place(file).is_file():
            return f"{file} is missing"
        if tables.sha256(job.place(file)) != sha:
            return f"{file} was changed after it was written"
    waiting = sum(reason.startswith("PENDING") for _, reason in record.rejected)
    if waiting:
        return f"{waiting} record{'s were' if waiting > 1 else ' was'} still being written"
    before, now, overrides = record.material, material(job, stage), record.overrides or {}
    if before.code != now.code:
        return "nearlift itself has changed"
    if before.manifest != now.manifest and overrides != job.overrides:
        return (
            f"was last run with {_flags(overrides)}"
            if overrides
            else f"{_flags(job.overrides)} is asked for"
        )
    for old, new, meaning in (
        (before.versions, now.versions, "version of {}"),
        (before.manifest, now.manifest, "[{}] of the manifest"),
        (before.inputs, now.inputs, "{}"),
        (before.products, now.products, "{}"),
    ):
        if changed := sorted(k for k in old.keys() | new.keys() if old.get(k) != new.get(k)):
            more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
            return f"{meaning.format(changed[0])} has changed{more}"
    return "the seed has changed" if before.seed != now.seed else ""


def _flags(overrides: Mapping[str, object]) -> str:
    return " ".join(f"--{name} {value}" for name, value in overrides.items())


# ---- runs


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One stage of a run: `why` it was stale (empty: it was not), and its outcome."""

    stage: Stage
    why: str
    outcome: Outcome
    wall_s: float = 0.0


def plan(job: Job) -> Iterator[tuple[Stage, str]]:
    """Each stage with the reason for which it is stale, empty if it is up to date; runs nothing."""
    ledger = open_ledger(job)
    upstream: dict[str, str] = {}
    for stage in job.stages:
        if not stage.configured(job.campaign):
            continue
        why = why_stale(job, stage, ledger)
        late = next((upstream[p.file] for p in stage.reads if p.file in upstream), "")
        why = why or (f"{late} will run" if late else "")
        if why:
            upstream |= {p.file: stage.name for p in stage.writes}
        yield stage, why


def run(
    job: Job,
    wanted: Sequence[Stage] | None = None,
    begin: Callable[[Stage, str], None] = lambda stage, why: None,
    force: bool = False,
) -> Iterator[Step]:
    """Bring stages up to date, in order, all unless some are `wanted`; yields each step.

    Raises
    ------
    Busy
        Another run works on the same products.
    """
    with contextlib.ExitStack() as held:
        ledger, alone = open_ledger(job), False
        for stage in job.stages if wanted is None else wanted:
            if not (force or stage.configured(job.campaign)):
                continue
            why = why_stale(job, stage, ledger)
            if (why or force) and not alone:
                held.enter_context(locked(job))
                # another run may have ended since
                ledger, alone = open_ledger(job), True
                why = why_stale(job, stage, ledger)
            why = why or ("asked for" if force else "")
            if not why:
                record = ledger.stages[stage.name]
                outcome = Outcome(rejected=record.rejected, notes=record.notes)
                yield Step(stage=stage, why="", outcome=outcome)
                continue
            begin(stage, why)
            made_of, start = material(job, stage), time.perf_counter()
            working = replace(job, pending={})
            outcome = _done(working, stage)
            wall_s = time.perf_counter() - start
            ledger = _committed(working, stage, ledger, made_of, outcome, wall_s)
            yield Step(stage=stage, why=why, outcome=outcome, wall_s=time.perf_counter() - start)


def _done(job: Job, stage: Stage) -> Outcome:
    """Run a stage on one BLAS thread."""
    try:
        with blas.one_thread():
            return stage.run(job)
    except futures.BrokenExecutor:
        raise InputRefused(
            "--executor", "a worker process died", "use fewer workers (memory?), or serial"
        ) from None


def _committed(
    job: Job,
    stage: Stage,
    ledger: ProvenanceLedger,
    made_of: StageMaterial,
    outcome: Outcome,
    wall_s: float,
) -> ProvenanceLedger:
    """The ledger with the stage's record, written after the stage's files.

    Raises
    ------
    ProductError
        The stage did not write what it declares.
    """
    from nearlift.results.provenance import InputDigest, RunOptions, StageRecord

    files = job.pending or {}
    for product in stage.writes:
        if files.get(f"processed/{product.file}") is None:
            raise ProductError(
                product.file, f"was not written by {stage.name}", "this is a defect of the stage"
            )
    # a file belongs to the stage that wrote it last
    others = {
        name: replace(record, outputs={f: s for f, s in record.outputs.items() if f not in files})
        for name, record in ledger.stages.items()
        if name != stage.name
    }
    ledger = replace(
        ledger,
        campaign=job.campaign.name,
        vehicle=job.campaign.vehicle.name,
        nearlift=__version__,
        platform=platform.platform(),
        versions=versions(),
        options=RunOptions(seed=job.seed),
        inputs={name: InputDigest(sha256=sha) for name, sha in job.inputs.items()},
        stages=others,
    )
    # from here until its record is written the stage is stale, whatever happens
    tables.write_whole(job.processed / LEDGER, tables.json_bytes(ledger))
    for name, content in files.items():
        if content is None:
            job.place(name).unlink(missing_ok=True)
        else:
            tables.write_whole(job.place(name), content)
    record = StageRecord(
        material=made_of,
        outputs={n: tables.digest_of(c) for n, c in sorted(files.items()) if c is not None},
        rejected=tuple(outcome.rejected),
        notes=tuple(outcome.notes),
        wall_s=wall_s,
        overrides=dict(job.overrides) or None,
    )
    done = {**others, stage.name: record}
    ledger = replace(ledger, stages={s.name: done[s.name] for s in job.stages if s.name in done})
    tables.write_whole(job.processed / LEDGER, tables.json_bytes(ledger))
    return ledger


@contextlib.contextmanager
def locked(job: Job) -> Iterator[None]:
    """Hold the lock of a campaign's products, which ends with the process that holds it; remove
    what a killed run left unfinished.

    Raises
    ------
    Busy
        Another process holds it.
    """
    folders = (job.processed, job.reports)
    made = [f for folder in folders for f in (folder, *folder.parents) if not f.exists()]
    job.processed.mkdir(parents=True, exist_ok=True)
    path = job.processed / LOCK
    descriptor = _flocked(path)
    try:
        for folder in folders:
            for file in folder.rglob(".*.tmp"):
                if is_unfinished(file.name) and not file.is_symlink():
                    file.unlink(missing_ok=True)
        yield
    finally:
        # removed while it is held, so that nobody can hold a file without a name
        path.unlink(missing_ok=True)
        os.close(descriptor)
        for folder in made:
            with contextlib.suppress(OSError):
                folder.rmdir()


def _flocked(path: Path) -> int:
    """Descriptor of a lock file that this process holds alone."""
    import fcntl

    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.pread(descriptor, 20, 0).decode(errors="replace")
            os.close(descriptor)
            raise Busy(
                str(path.parent),
                f"another run works on these products: process {owner or '?'}",
                "wait until it is done, end it, or choose another --out",
            ) from None
        with contextlib.suppress(FileNotFoundError):
            if os.fstat(descriptor).st_ino == path.stat().st_ino:
                os.ftruncate(descriptor, 0)
                os.pwrite(descriptor, str(os.getpid()).encode(), 0)
                return descriptor
        # its owner removed it between the two calls
        os.close(descriptor)


# ---- checks


def differences(
    root: Path, out: Path, campaign: Campaign, stages: Iterable[Stage]
) -> tuple[int, list[str]]:
    """Number of entries in provenance.json, and a line for each whose digest differs.

    Raises
    ------
    ProductError
        There is no provenance.json, or it is damaged.
    """
    path = out / "processed" / campaign.name / LEDGER
    content = tables.read_json(path)
    try:
        inputs = {str(name): str(entry["sha256"]) for name, entry in content["inputs"].items()}
        outputs = {
            str(name): str(sha)
            for stage in content["stages"].values()
            for name, sha in stage["outputs"].items()
        }
    except (KeyError, TypeError, AttributeError):
        raise ProductError(
            str(path),
            "is not what nearlift writes",
            "restore it from a copy, or delete it and run again",
        ) from None
    lists: dict[str, Sequence[str]] = {}
    for stage in stages:
        if stage.inputs is not None and stage.configured(campaign):
            # a file that cannot be read is found to be another below
            with contextlib.suppress(NearliftError):
                lists |= stage.inputs(root, campaign)
    lines = []
    for name, sha in inputs.items():
        files = lists.get(name, (name,))
        if name not in lists and name.startswith("["):
            lines.append(f"{name}: are other files by now")
        elif (*files,) == (name,):
            lines += _difference(root / name, sha)
        elif list_digest({file: tables.sha256(root / file) for file in files}) != sha:
            lines.append(f"{name}: are not what they were")
    for name, sha in outputs.items():
        kind, _, rest = name.partition("/")
        lines += _difference(out / kind / campaign.name / rest, sha)
    return len(inputs) + len(outputs), lines


def _difference(path: Path, sha: str) -> list[str]:
    if not path.is_file():
        return [f"{path}: is missing"]
    return [] if tables.sha256(path) == sha else [f"{path}: is not what it was"]
