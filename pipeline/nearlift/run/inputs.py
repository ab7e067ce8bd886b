"""Which raw files a campaign consists of, and their digests; hashed again only where size or time
has changed.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from nearlift.campaign.manifest import Campaign
from nearlift.campaign.piv import PivCase
from nearlift.readers.files import source_of
from nearlift.run import store
from nearlift.run.job import PIV_INPUT, FileStamp
from nearlift.stages import ingest

#: A file younger than this may change again without its time stamp telling, so its digest is not
#: kept.
RACY_NS = 2_000_000_000
CACHE = "inputs-cache.json"
#: By relative path.
Stamps = dict[str, FileStamp]


def digests(
    root: Path, campaign: Campaign, processed: Path, meanwhile: Callable[[], None] = lambda: None
) -> tuple[dict[str, str], Stamps]:
    """Relative path to SHA-256 of every raw input, in a fixed order, and what `remember` takes.
    Writes nothing.

    Digests of files whose size and modification time are as before are taken from the cache beside
    the products; a damaged cache is no cache. `meanwhile` is called where several must be read:
    what it starts becomes ready while they are.
    """
    folder = root.as_posix()
    cache = store.read_json_if_whole(processed / CACHE)
    result: dict[str, str] = {}
    fresh: Stamps = {}

    def look(names: Iterable[str]) -> None:
        """Digest those files, all that must be read at once."""
        unknown = []
        for name in names:
            status = os.stat(f"{folder}/{name}")  # noqa: PTH116 - paths made one by one take longer
            known = cache.get(name)
            stamp = [status.st_size, status.st_mtime_ns, status.st_ino]
            remembered = bool(known and known["stamp"] == stamp)
            racy = time.time_ns() - status.st_mtime_ns <= RACY_NS
            fresh[name] = {
                "stamp": stamp,
                "sha256": known["sha256"] if known and remembered else "",
                "remembered": remembered,
                "racy": racy,
            }
            unknown += [] if remembered else [name]
        for name, sha in zip(
            unknown,
            store.sha256_of([f"{folder}/{name}" for name in unknown], meanwhile),
            strict=True,
        ):
            fresh[name]["sha256"] = sha

    overlays = (o.file for o in campaign.report.overlay if (root / o.file).is_file())
    listed = list(dict.fromkeys((*ingest.inputs(root, campaign), *overlays)))
    look(listed)
    result.update((name, fresh[name]["sha256"]) for name in listed)
    for case in campaign.piv.case if campaign.piv is not None else ():
        # hundreds of files in one line: names and digests of all of them
        label, files = listing(root, case)
        look(files)
        result[label] = store.listing_sha256({name: fresh[name]["sha256"] for name in files})
    return result, fresh


def listing(root: Path, case: PivCase) -> tuple[str, list[str]]:
    """What the velocity grids of one case are called among the inputs, and their paths."""
    # only campaigns with grids need the readers of grids
    from nearlift.readers.piv.cases import files_of

    files = [source_of(root, path) for path in files_of(root, case)]
    return f"{PIV_INPUT}{case.name} ({len(files)} files)", files


def remember(processed: Path, stamps: Stamps) -> None:
    """Keep digests for the next command, beside products where there are any; a file that says the
    same already is left alone.
    """
    kept = {
        name: {"stamp": s["stamp"], "sha256": s["sha256"]}
        for name, s in stamps.items()
        if not s["racy"]
    }
    if processed.is_dir() and kept != store.read_json_if_whole(processed / CACHE):
        store.write_bytes(processed / CACHE, json.dumps(kept).encode())
