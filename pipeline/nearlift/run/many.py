"""Several campaigns in one go. Threads share one campaign's trials; processes and clusters take
whole campaigns, a few at a time.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from nearlift.campaign import manifest as manifests
from nearlift.errors import SOME_TRIALS_REJECTED, NearliftError, UsageError
from nearlift.products import DIAGNOSIS
from nearlift.results.diagnosis import NOTHING, BoundaryDiagnosis, NotDiagnosed
from nearlift.run import graph, store
from nearlift.run.executors import open_executor, ordered
from nearlift.run.opening import open_job

#: From the least to the gravest; a campaign that ran but lost trials is better off than one that
#: did not run.
GRAVITY = (0, SOME_TRIALS_REJECTED, 2, 5, 4)


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


def run(
    roots: Sequence[Path], out: Path, executor: str, seed: int, only: str | None = None
) -> Iterator[End]:
    """Run each campaign, or one stage of each, in the order given; ends come as they are known.

    Raises
    ------
    UsageError
        Two campaigns have one name: they would overwrite each other's products.
    """
    _distinct(roots)
    apart = executor.startswith(("processes", "dask"))
    # the workers of a cluster have current folders of their own
    there = Path.absolute if executor.startswith("dask") else Path
    inner = "serial" if apart else executor
    task = functools.partial(run_one, out=str(there(out)), executor=inner, seed=seed, only=only)
    places = [str(there(root)) for root in roots]
    if apart:
        with open_executor(executor) as pool:
            yield from ordered(pool, task, places, ahead=max(len(places), 1))
    else:
        yield from map(task, places)


def run_one(root: str, out: str, executor: str, seed: int, only: str | None = None) -> End:
    """Run one campaign, of plain values that any process can be sent; a refusal is an answer like
    any other.
    """
    wanted = graph.STAGES if only is None else (graph.stage(only),)
    start, used = time.perf_counter(), time.process_time()
    name, ran, rejected = root, [], 0
    try:
        with open_job(Path(root), Path(out), executor, seed) as job:
            name = job.campaign.name
            for step in graph.run(job, wanted, force=only is not None):
                rejected += len(step.outcome.rejected)
                ran += [step.stage.name] if step.why else []
    except NearliftError as refusal:
        code = refusal.exit_code
        words = f"exit code {code}: {str(refusal).splitlines()[0]}"
    else:
        diagnosed = store.load_if_whole(job.processed / DIAGNOSIS.file, NOTHING).boundaries
        verdicts = ", ".join(f"{boundary} {_verdict(loop)}" for boundary, loop in diagnosed.items())
        words = (
            f"{verdicts or 'done'}"
            f"{f'; {rejected} trials rejected' if rejected else ''}"
            f"{'' if ran else '; up to date'}"
        )
        code = SOME_TRIALS_REJECTED if rejected else 0
    return End(
        campaign=name,
        exit_code=code,
        words=words,
        ran=tuple(ran),
        wall_s=time.perf_counter() - start,
        cpu_s=time.process_time() - used,
    )


def _verdict(loop: BoundaryDiagnosis | NotDiagnosed) -> str:
    return " + ".join(effect.name for effect in loop.effects) or loop.verdict


def _distinct(roots: Sequence[Path]) -> None:
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


def gravest(ends: Sequence[End]) -> int:
    """The exit code of them all."""
    return max(
        (end.exit_code for end in ends),
        key=lambda code: GRAVITY.index(code) if code in GRAVITY else len(GRAVITY),
        default=0,
    )
