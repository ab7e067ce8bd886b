"""A campaign opened to be worked on: what every command that reads its records or products begins
with.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

from nearlift.campaign import manifest as manifests
from nearlift.run import provenance
from nearlift.run.executors import open_executor, threads_of
from nearlift.run.inputs import Stamps, digests, remember
from nearlift.run.job import Job, Say, silent
from nearlift.run.lock import settled
from nearlift.run.transaction import Homes
from nearlift.run.workspace import spare_raw
from nearlift.stages import ingest


@contextlib.contextmanager
def open_job(
    root: Path,
    out: Path,
    executor: str,
    seed: int,
    say: Say = silent,
    keep: bool = True,
    announce: Callable[[str], None] = silent,
    planned: bool = False,
) -> Iterator[Job]:
    """The campaign as a job: manifest checked, inputs digested, executor open; `keep` what a
    finished job knows of its inputs for the next. One that is only `planned` has no records yet:
    no input is looked for.
    """
    if executor.startswith("dask"):
        # the workers of a cluster have current folders of their own
        root = root.absolute()
    loaded = manifests.load(root)
    spare_raw(root, out)
    homes = Homes.within(out, loaded.name)

    def meanwhile() -> None:
        if keep:
            ingest.soon(loaded, threads_of(executor))
            provenance.code_digest()
            provenance.versions()

    inputs: dict[str, str] = {}
    stamps: Stamps = {}
    if not planned:
        settled(homes)
        inputs, stamps = digests(root, loaded, homes.processed, meanwhile)
    with open_executor(executor) as pool:
        yield Job(
            root=root,
            campaign=loaded,
            processed=homes.processed,
            reports=homes.reports,
            executor=pool,
            inputs=inputs,
            stamps=stamps,
            seed=seed,
            say=say,
            announce=announce,
        )
    if keep and not planned:
        remember(homes.processed, stamps)
