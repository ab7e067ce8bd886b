"""Executors: threads or processes share one campaign's trials; processes and a dask cluster take
whole campaigns.

A task is a top-level function of plain values, so that a process can run it. Results come in the
order of the tasks, whatever the executor and the number of workers.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent import futures
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from nearlift import blas, isolation
from nearlift.errors import SOME_TRIALS_REJECTED, InputRefused, NearliftError, UsageError
from nearlift.run import engine
from nearlift.run.engine import Job, Say, Stage, silent

Task = TypeVar("Task")
Result = TypeVar("Result")
#: Time for a scheduler to answer, and for which a cluster may be without a worker, s.
ANSWER_S, WITHOUT_WORKERS_S = 10.0, 30.0
#: Exit codes by severity: a campaign that lost trials is better off than one that did not run.
SEVERITY = (0, SOME_TRIALS_REJECTED, 2, 5, 4)


class SerialExecutor(futures.Executor):
    """Runs each task at once, in the calling thread."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> futures.Future[Any]:
        """Run the task and return a finished future."""
        future: futures.Future[Any] = futures.Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as fault:  # the future carries it, as any executor's would
            future.set_exception(fault)
        return future


class Processes(futures.ProcessPoolExecutor):
    """Fresh processes that import nothing from the current folder and end with this one."""

    def __init__(self, workers: int) -> None:
        import multiprocessing

        spawn = multiprocessing.get_context("spawn")
        # its queues start a resource tracker, which is an interpreter too
        with isolation.safe_path():
            super().__init__(workers, mp_context=spawn, initializer=_begin)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> futures.Future[Any]:
        """Run the task in a process, which may be started now and inherits the environment."""
        with isolation.safe_path():
            return super().submit(fn, *args, **kwargs)


def _begin() -> None:
    """Prepare a worker: it ends with its parent and has one BLAS thread."""
    isolation.end_with_parent()
    blas.default_to_one_thread()


@contextlib.contextmanager
def open_executor(text: str) -> Iterator[futures.Executor]:
    """The executor that ``--executor`` names within one campaign: ``serial``, ``threads:N`` or
    ``processes:N``. A cluster takes whole campaigns (`run_campaigns`).
    """
    kind, _, rest = text.partition(":")
    if kind == "serial" and not rest:
        yield SerialExecutor()
    elif kind in ("threads", "processes"):
        pool = futures.ThreadPoolExecutor if kind == "threads" else Processes
        with pool(_count(rest, text)) as opened:
            try:
                yield opened
            except BaseException:
                opened.shutdown(wait=False, cancel_futures=True)
                raise
    elif kind == "dask" and rest:
        raise UsageError(
            "--executor", f"{text!r} takes whole campaigns", "use serial, threads:N or processes:N"
        )
    else:
        raise UsageError(
            "--executor",
            f"{text!r} is not an executor",
            "use serial, threads:N, processes:N or dask:ADDRESS",
        )


def _count(text: str, whole: str) -> int:
    if text == "":
        return os.cpu_count() or 1
    if not text.isdigit() or int(text) < 1:
        raise UsageError("--executor", f"{whole!r} names no number of workers", "write threads:2")
    return int(text)


def ordered(
    executor: futures.Executor,
    task: Callable[[Task], Result],
    specs: Iterable[Task],
    ahead: int = 8,
) -> Iterator[Result]:
    """Results of `task` over `specs`, in order, with at most `ahead` in flight, so that memory
    stays flat.
    """
    waiting: deque[futures.Future[Result]] = deque()
    try:
        for spec in specs:
            waiting.append(executor.submit(task, spec))
            if len(waiting) >= ahead:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for future in waiting:
            future.cancel()


@contextlib.contextmanager
def open_campaign(
    root: Path,
    out: Path,
    stages: Sequence[Stage],
    executor: str,
    seed: int,
    *,
    say: Say = silent,
    keep: bool = True,
    planned: bool = False,
) -> Iterator[Job]:
    """A campaign as a job with its executor; see `engine.open_job`."""
    with (
        open_executor(executor) as pool,
        engine.open_job(root, out, stages, pool, seed, say=say, keep=keep, planned=planned) as job,
    ):
        yield job


# ---- several campaigns


@dataclass(frozen=True, slots=True, kw_only=True)
class End:
    """How one campaign ended.

    Attributes
    ----------
    campaign : str
        Its name, or its folder where the manifest was refused.
    exit_code : int
        As the same campaign alone would have ended.
    words : str
        One line: verdicts, or the refusal.
    ran : tuple of str
        Stages that were stale.
    wall_s, cpu_s : float
        Time it took, and processor time of the process that ran it.
    """

    campaign: str
    exit_code: int
    words: str
    ran: tuple[str, ...] = ()
    wall_s: float = 0.0
    cpu_s: float = 0.0


def run_campaigns(
    roots: Sequence[Path],
    out: Path,
    stages: Sequence[Stage],
    executor: str,
    seed: int,
    words: Callable[[Job], str],
    only: str | None = None,
    overrides: Mapping[str, object] | None = None,
) -> Iterator[End]:
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
    apart = kind in ("processes", "dask")
    # the workers of a cluster have current folders of their own
    there = Path.absolute if kind == "dask" else Path
    task = functools.partial(
        run_one,
        out=str(there(out)),
        stages=tuple(stages),
        executor="serial" if apart else executor,
        seed=seed,
        words=words,
        only=only,
        overrides=overrides,
    )
    places = [str(there(root)) for root in roots]
    if kind == "dask" and address:
        yield from _on_cluster(address, task, places)
    elif apart:
        with open_executor(executor) as pool:
            try:
                yield from ordered(pool, task, places, ahead=max(len(places), 1))
            except futures.BrokenExecutor:
                raise InputRefused(
                    "--executor",
                    "a worker process died; campaigns without a line above are not done",
                    "use fewer workers (memory?), or serial",
                ) from None
    else:
        yield from map(task, places)


def run_one(
    root: str,
    *,
    out: str,
    stages: tuple[Stage, ...],
    executor: str,
    seed: int,
    words: Callable[[Job], str],
    only: str | None = None,
    overrides: Mapping[str, object] | None = None,
) -> End:
    """Run one campaign; a refusal is an answer like any other."""
    start, used = time.perf_counter(), time.process_time()
    name, ran, rejected = root, [], 0
    try:
        wanted = None if only is None else (engine.stage_of(stages, only),)
        with open_campaign(Path(root), Path(out), stages, executor, seed) as job:
            name = job.campaign.name
            if only is not None and overrides:
                job = job.overriding(only, overrides)
            for step in engine.run(job, wanted, force=only is not None):
                rejected += len(step.outcome.rejected)
                ran += [step.stage.name] if step.why else []
            said = words(job)
    except NearliftError as refusal:
        code = refusal.exit_code
        line = f"exit code {code}: {str(refusal).splitlines()[0]}"
    else:
        line = (
            f"{said or 'done'}"
            f"{f'; {rejected} trials rejected' if rejected else ''}"
            f"{'' if ran else '; up to date'}"
        )
        code = SOME_TRIALS_REJECTED if rejected else 0
    return End(
        campaign=name,
        exit_code=code,
        words=line,
        ran=tuple(ran),
        wall_s=time.perf_counter() - start,
        cpu_s=time.process_time() - used,
    )


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


def most_serious(ends: Sequence[End]) -> int:
    """The exit code of all campaigns."""
    return max(
        (end.exit_code for end in ends),
        key=lambda code: SEVERITY.index(code) if code in SEVERITY else len(SEVERITY),
        default=0,
    )


# ---- dask


def _on_cluster(
    address: str, task: Callable[[str], Result], places: Sequence[str]
) -> Iterator[Result]:
    """Results of `task` over `places` by the workers of a dask cluster, in order.

    Raises
    ------
    InputRefused
        The scheduler died, a worker died over a task, or no worker is left.
    """
    with _client(address) as client:
        # pure=False: dask would otherwise return one cached result for equal calls
        waiting = [client.submit(task, place, pure=False, retries=2) for place in places]
        for future in waiting:
            _await(client, future, address)
            try:
                yield future.result()
            except NearliftError:
                raise
            except Exception as fault:
                raise InputRefused(
                    "--executor",
                    f"the cluster at {address!r} lost a campaign: {fault}",
                    "see the log of its worker (memory?); finished campaigns stay finished",
                ) from None


def _await(client: Any, future: Any, address: str) -> None:
    """Wait until a future is done, as long as there is a scheduler and a worker."""
    alone_since = time.monotonic()
    while client.status == "running" and not future.done():
        if client.scheduler_info()["workers"]:
            alone_since = time.monotonic()
        elif time.monotonic() - alone_since > WITHOUT_WORKERS_S:
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


@contextlib.contextmanager
def _client(address: str) -> Iterator[Any]:
    """A connection to a dask scheduler.

    Raises
    ------
    UsageError
        The package is missing, or the scheduler does not answer.
    """
    import asyncio

    try:
        import distributed
    except ImportError:
        raise UsageError(
            "--executor",
            f"'dask:{address}' needs the package distributed",
            'pip install "nearlift[dask]"',
        ) from None

    library: Any = distributed

    async def answer() -> None:
        arguments = library.Security().get_connection_args("client")
        link = await asyncio.wait_for(
            library.comm.connect(address, timeout=ANSWER_S, **arguments), ANSWER_S
        )
        link.abort()

    try:
        # asked first, since a client that could not connect goes on complaining; in a thread, since
        # a notebook has a loop of its own
        with futures.ThreadPoolExecutor(1) as one:
            one.submit(lambda: asyncio.run(answer())).result()
        client = library.Client(address)
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
    try:
        yield client
    finally:
        with contextlib.suppress(Exception):
            client.close(timeout=2)
