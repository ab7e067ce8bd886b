"""Several campaigns: one after the other, each in a process, or on a dask cluster."""

from __future__ import annotations

import contextlib
import functools
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent import futures
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nearlift.errors import SOME_TRIALS_REJECTED, InputRefused, NearliftError, UsageError
from nearlift.run import engine
from nearlift.run.engine import Job, Stage, Step
from nearlift.run.workers import Result, open_executor, ordered

#: Time for a scheduler to answer, and for which a cluster may be without a worker, s.
ANSWER_S, WITHOUT_WORKERS_S = 10.0, 30.0
#: Exit codes by severity: a campaign that lost trials is better off than one that did not run.
SEVERITY = (0, SOME_TRIALS_REJECTED, 2, 5, 4)


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignOutcome:
    """Outcome of one campaign.

    `campaign` is its name, or its folder where the manifest was refused. `exit_code` is that of a
    run of it alone. `words` are one line of results or refusal. `ran` are the stages that were
    stale.
    """

    campaign: str
    exit_code: int
    words: str
    ran: tuple[str, ...]
    wall_s: float


def run_campaigns(
    roots: Sequence[Path],
    out: Path,
    stages: Sequence[Stage],
    executor: str,
    seed: int,
    words: Callable[[Job], str],
    only: str | None = None,
) -> Iterator[CampaignOutcome]:
    """Run each campaign, or one stage of each, in the order given; ends come as they are known.
    `words` are those of a campaign that is done.

    Raises
    ------
    UsageError
        Two campaigns have one name: they would overwrite each other's products.
    InputRefused
        A worker process, or the cluster, died. Finished campaigns stay finished.
    """
    _require_names(roots)
    kind, _, address = executor.partition(":")
    # the workers of a cluster have current folders of their own
    places = [*map(Path.absolute, roots)] if kind == "dask" else roots
    task = functools.partial(
        run_one,
        out=out.absolute() if kind == "dask" else out,
        stages=tuple(stages),
        executor="serial" if kind in ("processes", "dask") else executor,
        seed=seed,
        words=words,
        only=only,
    )
    if kind == "dask" and address:
        yield from on_cluster(address, task, places)
    elif kind == "processes":
        with open_executor(executor) as pool:
            try:
                yield from ordered(pool, task, places, ahead=len(places))
            except futures.BrokenExecutor:
                raise InputRefused(
                    "--executor",
                    "a worker process died; campaigns without a line above are not done",
                    "use fewer workers (memory?), or serial",
                ) from None
    else:
        yield from map(task, places)


def run_one(
    root: Path,
    *,
    out: Path,
    stages: tuple[Stage, ...],
    executor: str,
    seed: int,
    words: Callable[[Job], str],
    only: str | None,
) -> CampaignOutcome:
    """Run one campaign; a refusal is an answer like any other."""
    name, steps, start = str(root), list[Step](), time.perf_counter()
    try:
        wanted = None if only is None else (engine.stage_of(stages, only),)
        with engine.open_job(root, out, stages, executor, seed) as job:
            name = job.campaign.name
            for step in engine.run(job, wanted, force=only is not None):
                steps.append(step)
            line = words(job)
        rejected = sum(len(step.outcome.rejected) for step in steps)
        code = SOME_TRIALS_REJECTED if rejected else 0
        if not any(step.why for step in steps):
            line = f"{line}; up to date"
    except NearliftError as refusal:
        code = refusal.exit_code
        line = f"exit code {code}: {str(refusal).splitlines()[0]}"
    ran = tuple(step.stage.name for step in steps if step.why)
    wall_s = time.perf_counter() - start
    return CampaignOutcome(campaign=name, exit_code=code, words=line, ran=ran, wall_s=wall_s)


def _require_names(roots: Sequence[Path]) -> None:
    from nearlift.campaign import manifest as manifests

    seen: dict[str, Path] = {}
    for root in roots:
        try:
            name = manifests.load(root).name
        except NearliftError:
            continue  # its turn will say why
        if name in seen:
            raise UsageError(
                str(root),
                f"has the same name as {seen[name]}: {name!r}",
                "their products would overwrite each other: change `name`",
            )
        seen[name] = root


def most_serious(ends: Sequence[CampaignOutcome]) -> int:
    """The exit code of all campaigns."""
    return max((end.exit_code for end in ends), key=SEVERITY.index, default=0)


# ---- dask


def on_cluster(
    address: str, task: Callable[[Path], Result], places: Sequence[Path]
) -> Iterator[Result]:
    """Results of `task` over `places` by the workers of a dask cluster, in order.

    Raises
    ------
    UsageError
        The package is missing, or the scheduler does not answer.
    InputRefused
        The scheduler died, a worker died over a task, or no worker is left.
    """
    client = _client(address)
    try:
        # pure=False: dask would otherwise return one cached result for equal calls
        for future in [client.submit(task, place, pure=False, retries=2) for place in places]:
            _await(client, future, address)
            try:
                yield future.result()
            except Exception as fault:
                raise InputRefused(
                    "--executor",
                    f"the cluster at {address!r} lost a campaign: {fault}",
                    "see the log of its worker (memory?); finished campaigns stay finished",
                ) from None
    finally:
        with contextlib.suppress(Exception):
            client.close(timeout=2)


def _await(client: Any, future: Any, address: str) -> None:
    """Wait until a future is done, as long as there is a scheduler and a worker."""
    last_seen = time.monotonic()
    while client.status == "running" and not future.done():
        if client.scheduler_info()["workers"]:
            last_seen = time.monotonic()
        elif time.monotonic() - last_seen > WITHOUT_WORKERS_S:
            raise InputRefused(
                "--executor",
                f"the cluster at {address!r} has had no worker for {WITHOUT_WORKERS_S:g} s",
                "start one (dask worker ADDRESS) and repeat the command",
            )
        time.sleep(0.1)
    # a client that lost its scheduler cancels its futures, which are done then
    if client.status != "running":
        raise InputRefused(
            "--executor",
            f"the dask scheduler at {address!r} died",
            "start it again and repeat the command; finished campaigns stay finished",
        )


def _client(address: str) -> Any:
    """A connection to a dask scheduler."""
    import asyncio

    try:
        import distributed as library
    except ImportError:
        raise UsageError(
            "--executor",
            f"'dask:{address}' needs the package distributed",
            'pip install "nearlift[dask]"',
        ) from None
    distributed: Any = library

    async def answer() -> None:
        arguments = distributed.Security().get_connection_args("client")
        link = distributed.comm.connect(address, timeout=ANSWER_S, **arguments)
        (await asyncio.wait_for(link, ANSWER_S)).abort()

    try:
        # asked first, since a client that could not connect goes on trying and complaining; in a
        # thread, since a notebook has a loop already
        with futures.ThreadPoolExecutor(1) as one:
            one.submit(lambda: asyncio.run(answer())).result()
        client = distributed.Client(address)
    except (OSError, ValueError, TypeError) as fault:
        raise UsageError(
            "--executor",
            f"no dask scheduler answers at {address!r}:"
            f" {str(fault) or f'nothing came within {ANSWER_S:g} s'}",
            "start one (dask scheduler) and give the address that it prints: dask:tcp://HOST:8786",
        ) from None
    # a cluster that dies is reported once, here, and not by each of the library's loggers
    for name in [n for n in logging.root.manager.loggerDict if n.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    return client
