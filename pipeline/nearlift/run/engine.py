"""A run: which stages are stale, and how what they write gets to the disk.

A stage is a function of a `Job`. It is stale when a digest in provenance.json differs from that of
something that decides its output, or of a product that it wrote.

A stage's files are kept in memory until it is done. Then its record leaves provenance.json, its
files take their places, and its record is written last. A killed run leaves a stage that is stale.
"""

from __future__ import annotations

import contextlib
import functools
import json
import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent import futures
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from nearlift import blas, plugins
from nearlift.errors import InputRefused, NearliftError, ProductError, UsageError
from nearlift.run import tables
from nearlift.run.tables import LEDGER, Product
from nearlift.run.workers import Processes, open_executor
from nearlift.version import __version__

# the command line is made of stages, so what a manifest needs is imported where a job is opened
if TYPE_CHECKING:
    from nearlift.campaign.manifest import Campaign
    from nearlift.results.provenance import ProvenanceLedger

MANIFEST = "campaign.toml"
LOCK = ".lock"
#: Digests of raw files by size and time of last change, so that they are not hashed at each run.
CACHE = "inputs-cache.json"
#: A file younger than this may change again within the resolution of its time stamp.
YOUNG_NS = 2_000_000_000
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
#: Raw files of a stage, by the name under which provenance.json lists them.
Inputs = Mapping[str, Sequence[str]]
#: Size of a file in bytes, and time of its last change, ns.
Stamp = tuple[int, int]
#: Takes what is being done, as ``"ingest 120 of 3600 trials"``, and the share of it that is done,
#: where that is known.
Say = Callable[..., None]


class Busy(NearliftError):
    """Another run works on the same products."""


# ---- stages


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
    imports : tuple of str
        Modules that it needs and that take long to load; see `Job.ahead`.
    workers : tuple of str
        Modules that other processes need for its tasks.
    question : tuple of click.Option
        Options with which the command answers a question instead of running the stage.
    example : str
        The question as an example of the help.
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
    imports: tuple[str, ...] = ()
    workers: tuple[str, ...] = ()
    question: tuple[click.Option, ...] = ()
    example: str = ""

    def configured(self, campaign: Campaign) -> bool:
        """Whether this campaign asks for the stage."""
        return not self.where or getattr(campaign, self.where) is not None


def ordered_stages(declared: Iterable[Stage]) -> tuple[Stage, ...]:
    """The stages in order; a report reads every product of those before it."""
    stages: list[Stage] = []
    for stage in declared:
        stages.append(replace(stage, reads=products_of(stages)) if stage.report else stage)
    return tuple(stages)


def products_of(stages: Iterable[Stage]) -> tuple[Product, ...]:
    """The products of stages, each where it is written last."""
    written = [product for stage in stages for product in stage.writes]
    return tuple(p for i, p in enumerate(written) if p not in written[i + 1 :])


def stage_of(stages: Iterable[Stage], name: str) -> Stage:
    """The stage of that name."""
    return next(stage for stage in stages if stage.name == name)


# ---- jobs


def silent(text: str, share: float | None = None, /) -> None:
    """Say nothing."""


def subprogress(say: Say, i: int, count: int) -> Say:
    """Progress of step `i`, from 0, of `count`."""
    return lambda text, share=None, /: say(text, (i + (share or 0.0)) / count)


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
    stamps : mapping of str to Stamp
        Size and time of last change of each raw file.
    ahead : tuple of str
        Modules of the stage that runs and of those after it. They take long to load, which a stage
        does while it waits.
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
    stamps: Mapping[str, Stamp] = field(default_factory=dict)
    ahead: tuple[str, ...] = ()
    seed: int = 0
    say: Say = silent
    pending: dict[str, bytes | None] | None = None

    def place(self, name: str) -> Path:
        """Path of a file called ``processed/...`` or ``reports/...``."""
        kind, _, rest = name.partition("/")
        return (self.processed if kind == "processed" else self.reports) / rest

    def put(self, name: str, content: bytes | None) -> Path:
        """Write a file called ``processed/...`` or ``reports/...``, or remove it (None); returns
        its path. The files of a stage change when the stage is done.
        """
        path = self.place(name)
        if self.pending is not None:
            self.pending[name] = content
        elif content is None:
            path.unlink(missing_ok=True)
        else:
            tables.write_whole(path, content)
        return path

    def read(self, product: Product) -> tables.Table:
        """A table product of this campaign, as an earlier stage left it."""
        return tables.read_table(self.processed / product.file, product)

    def load(self, kind: type[tables.Loaded]) -> tables.Loaded:
        """A JSON product of this campaign as its type."""
        return tables.load(self.processed / kind.file, kind)

    def read_json(self, product: Product) -> dict[str, Any]:
        """A JSON product of this campaign."""
        return tables.read_json(self.processed / product.file)

    def write(self, product: Product, content: Any) -> None:
        """Write a product of this campaign: a table, or a JSON file."""
        is_json = product.file.endswith(".json")
        made = tables.json_bytes(content) if is_json else tables.table_bytes(content, product)
        self.put(f"processed/{product.file}", made)


@contextlib.contextmanager
def open_job(
    root: Path,
    out: Path,
    stages: Sequence[Stage],
    executor: str,
    seed: int,
    *,
    say: Say = silent,
    fresh: bool = False,
    planned: bool = False,
) -> Iterator[Job]:
    """A campaign as a job: manifest checked, raw files hashed, executor open. `fresh`: each raw
    file is read, whatever its time of change; a campaign that is only `planned` has no records yet.

    Raises
    ------
    UsageError
        `out` is the campaign's folder, or lies in it, or `executor` is none.
    """
    from nearlift.campaign import manifest as manifests

    campaign = manifests.load(root)
    if out.resolve().is_relative_to(root.resolve()):
        raise UsageError(
            "--out",
            f"{str(out.resolve())!r} lies in the campaign's folder, where nothing is written",
            "name a folder outside it",
        )
    processed, reading = out / "processed" / campaign.name, () if planned else stages
    sources = {
        stage.name: stage.inputs(root, campaign)
        for stage in reading
        if stage.inputs is not None and stage.configured(campaign)
    }
    listed: dict[str, Sequence[str]] = {} if planned else {MANIFEST: (MANIFEST,)}
    for inputs in sources.values():
        listed |= inputs
    cache = processed / CACHE
    known = {} if fresh else tables.read_json_if_whole(cache)
    stamps = stamped(root, {f for files in listed.values() for f in files})
    with open_executor(executor, sum(size for size, _ in stamps.values())) as pool:
        if isinstance(pool, Processes) and stamps.keys() - known.keys():
            # new files will be read, so the processes start while this one hashes
            pool.load(name for stage in reading for name in stage.workers)
        digests, settled = hashed(root, stamps, known)
        # a list of files has the digest of its names, each with its file's
        digests |= {
            name: tables.digest_of("".join(f"{n} {digests[n]}\n" for n in files).encode())
            for name, files in listed.items()
            if files != (name,)
        }
        try:
            yield Job(
                root=root,
                campaign=campaign,
                processed=processed,
                reports=out / "reports" / campaign.name,
                executor=pool,
                stages=tuple(stages),
                inputs={name: digests[name] for name in listed},
                sources={name: tuple(inputs) for name, inputs in sources.items()},
                stamps=stamps,
                seed=seed,
                say=say,
            )
        finally:
            # the folder exists once something has run; another user's products may be looked at
            if not fresh and settled != known and processed.is_dir():
                with contextlib.suppress(OSError):
                    tables.write_whole(cache, json.dumps(settled).encode())


def stamped(root: Path, files: Iterable[str]) -> dict[str, Stamp]:
    """The stamp of each raw file."""
    folder, stamps = root.as_posix(), dict[str, Stamp]()
    for file in files:
        status = os.stat(f"{folder}/{file}")  # noqa: PTH116 - paths made one by one take longer
        stamps[file] = status.st_size, status.st_mtime_ns
    return stamps


def hashed(
    root: Path, stamps: Mapping[str, Stamp], known: Mapping[str, Any]
) -> tuple[dict[str, str], dict[str, list[Any]]]:
    """SHA-256 of each raw file, and those that may be `known` next time; a file whose stamp is
    known is not read again.
    """
    folder, now_ns, digests = root.as_posix(), time.time_ns(), dict[str, str]()
    for file, stamp in stamps.items():
        match known.get(file):
            case [*before, str(sha)] if (*before,) == stamp:
                digests[file] = sha
    # threads would take as long over small files
    unknown = stamps.keys() - digests.keys()
    digests |= {file: tables.sha256(f"{folder}/{file}") for file in unknown}
    settled = {f: [*s, digests[f]] for f, s in stamps.items() if now_ns - s[1] >= YOUNG_NS}
    return digests, settled


# ---- staleness


@functools.cache
def code_digest() -> str:
    """Digest of nearlift's own source, so that products of older code are stale."""
    return plugins.digest_of_code(Path(__file__).parents[1])


@functools.cache
def versions() -> dict[str, str]:
    """Versions of Python and of the packages whose version can change a number."""
    from importlib import metadata

    names = (*NUMERICAL, *plugins.digests())
    return {"python": platform.python_version(), **{n: metadata.version(n) for n in names}}


def material(job: Job, stage: Stage) -> dict[str, str]:
    """Digests of everything that decides the stage's output, by their names in `why_stale`."""
    manifest = job.campaign.model_dump(mode="json", by_alias=True, include=set(stage.sections))
    sections = {name: json.dumps(manifest[name], sort_keys=True) for name in stage.sections}
    raw = job.inputs if stage.report else job.sources.get(stage.name, ())
    added = plugins.digests()
    return {
        "nearlift itself": code_digest(),
        **{f"package {package}": digest for package, digest in added.items()},
        **{f"version of {name}": v for name, v in versions().items() if name not in added},
        **{f"[{n}] of the manifest": tables.digest_of(s.encode()) for n, s in sections.items()},
        **{name: job.inputs[name] for name in raw},
        **{p.file: tables.sha256_if_any(job.processed / p.file) for p in stage.reads},
        "the seed": str(job.seed),
    }


def why_stale(job: Job, stage: Stage, ledger: ProvenanceLedger) -> str:
    """Reason for which the stage must run, in words; empty if it need not."""
    record = ledger.stages.get(stage.name)
    if record is None:
        return "has not run yet"
    names = [s.name for s in job.stages]
    later = [ledger.stages[n] for n in names[names.index(stage.name) + 1 :] if n in ledger.stages]
    for file, sha in record.outputs.items():
        if any(file in r.outputs for r in later):
            continue  # a later stage has written it again
        now = tables.sha256_if_any(job.place(file))
        if now != sha:
            return f"{file} {'was changed after it was written' if now else 'is missing'}"
    waiting = sum(reason.startswith("PENDING") for _, reason in record.rejected)
    if waiting:
        return f"{waiting} record{'s were' if waiting > 1 else ' was'} still being written"
    made_of = material(job, stage)
    before = dict(record.material)
    changed = [k for k in made_of | before if before.get(k) != made_of.get(k)]
    more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
    return f"{changed[0]} has changed{more}" if changed else ""


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
    ledger = _ledger(job)
    upstream: dict[str, str] = {}
    for stage in job.stages:
        if not stage.configured(job.campaign):
            continue
        late = next((upstream[p.file] for p in stage.reads if p.file in upstream), "")
        why = why_stale(job, stage, ledger) or (f"{late} will run" if late else "")
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
    InputRefused
        A worker process died.
    ProductError
        A stage did not write what it declares.
    """
    stages = job.stages if wanted is None else wanted
    stages = [stage for stage in stages if force or stage.configured(job.campaign)]
    ledger = _ledger(job)
    is_stale = force or any(why_stale(job, stage, ledger) for stage in stages)
    with locked(job) if is_stale else contextlib.nullcontext():
        if is_stale:
            # another run may have ended since
            ledger = _ledger(job)
        for i, stage in enumerate(stages):
            why = why_stale(job, stage, ledger) if is_stale else ""
            if not (why or force):
                record = ledger.stages[stage.name]
                outcome = Outcome(rejected=record.rejected, notes=record.notes)
                yield Step(stage=stage, why="", outcome=outcome)
                continue
            begin(stage, why or "asked for")
            job = replace(job, ahead=tuple(name for s in stages[i:] for name in s.imports))
            made_of, start = material(job, stage), time.perf_counter()
            files, outcome = _computed(job, stage)
            wall_s = time.perf_counter() - start
            ledger = _commit(job, stage, ledger, made_of, files, outcome, wall_s)
            if stage.inputs is not None and isinstance(job.executor, Processes):
                # its workers have nothing to do until figures are drawn
                job.executor.load(n for s in stages[i + 1 :] if s.report for n in s.imports)
            yield Step(stage=stage, why=why or "asked for", outcome=outcome, wall_s=wall_s)


def _ledger(job: Job) -> ProvenanceLedger:
    """The campaign's provenance.json; an empty one where it is missing or damaged."""
    from nearlift.results.provenance import ProvenanceLedger

    return tables.load_if_whole(job.processed / LEDGER, ProvenanceLedger())


def _computed(job: Job, stage: Stage) -> tuple[dict[str, bytes | None], Outcome]:
    """The files of a stage, run on one BLAS thread, and its outcome."""
    files: dict[str, bytes | None] = {}
    try:
        with blas.one_thread():
            outcome = stage.run(replace(job, pending=files))
    except futures.BrokenExecutor:
        what, remedy = "a worker process died", "use fewer workers (memory?), or serial"
        raise InputRefused("--executor", what, remedy) from None
    for product in stage.writes:
        if files.get(f"processed/{product.file}") is None:
            what, remedy = f"was not written by {stage.name}", "this is a defect of the stage"
            raise ProductError(product.file, what, remedy)
    return files, outcome


def _commit(
    job: Job,
    stage: Stage,
    ledger: ProvenanceLedger,
    made_of: Mapping[str, str],
    files: Mapping[str, bytes | None],
    outcome: Outcome,
    wall_s: float,
) -> ProvenanceLedger:
    """Write a stage's files between two ledgers: one without its record, and one with it, which is
    returned.
    """
    from nearlift.results.provenance import ProvenanceLedger, StageRecord

    order = [s.name for s in job.stages]
    before = order[: order.index(stage.name)]
    # a later stage whose file is overwritten has to write it again
    records = {
        name: record
        for name, record in ledger.stages.items()
        if name in before or (name != stage.name and record.outputs.keys().isdisjoint(files))
    }
    # from here until its record is written the stage is stale, whatever happens
    without = ProvenanceLedger(
        campaign=job.campaign.name,
        vehicle=job.campaign.vehicle.name,
        nearlift=__version__,
        platform=platform.platform(),
        versions=versions(),
        options={"seed": job.seed},
        inputs={name: {"sha256": sha} for name, sha in job.inputs.items()},
        stages=records,
    )
    tables.write_whole(job.processed / LEDGER, tables.json_bytes(without))
    for name, content in files.items():
        job.put(name, content)
    records[stage.name] = StageRecord(
        material=made_of,
        outputs={n: tables.digest_of(c) for n, c in sorted(files.items()) if c is not None},
        rejected=outcome.rejected,
        notes=outcome.notes,
        wall_s=wall_s,
    )
    complete = replace(without, stages={n: records[n] for n in order if n in records})
    tables.write_whole(job.processed / LEDGER, tables.json_bytes(complete))
    return complete


@contextlib.contextmanager
def locked(job: Job) -> Iterator[None]:
    """Hold the lock of a campaign's products, which ends with the process that holds it; remove
    what a killed run left unfinished.

    Raises
    ------
    Busy
        Another process holds it.
    """
    import fcntl

    job.processed.mkdir(parents=True, exist_ok=True)
    with (job.processed / LOCK).open("a+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            raise Busy(
                str(job.processed),
                f"another run works on these products: process {file.read(20) or '?'}",
                "wait until it is done, end it, or choose another --out",
            ) from None
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        for folder in (job.processed, job.reports):
            for unfinished in folder.rglob(f".*{tables.UNFINISHED}"):
                unfinished.unlink(missing_ok=True)
        yield
        file.truncate(0)


def differences(job: Job) -> tuple[int, list[str]]:
    """Number of entries in provenance.json, and a line for each whose digest differs.

    Raises
    ------
    ProductError
        There is no provenance.json, or it is damaged.
    """
    from nearlift.results.provenance import ProvenanceLedger

    ledger = tables.load(job.processed / LEDGER, ProvenanceLedger)
    entries = {
        **{job.root / n: (e["sha256"], job.inputs.get(n, "")) for n, e in ledger.inputs.items()},
        **{
            job.place(name): (sha, tables.sha256_if_any(job.place(name)))
            for name, sha in ledger.outputs.items()
        },
    }
    return len(entries), [
        f"{path}: is {'not what it was' if now else 'missing'}"
        for path, (sha, now) in entries.items()
        if now != sha
    ]
