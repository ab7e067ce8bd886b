"""Which raw files a campaign consists of, and their digests; hashed again only where size or time has changed."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from nearlift import store
from nearlift.campaign import Campaign
from nearlift.readers.seam import source_of
from nearlift.stages import ingest
from nearlift.stages.job import PIV_INPUT

#: A file younger than this may change again without its time stamp telling, so its digest is not kept.
RACY_NS = 2_000_000_000
CACHE = "inputs-cache.json"
#: Relative path to `stamp` (size, modification time, inode), the digest that went with it, whether that was `remembered` rather than
#: made, and whether the file was so young (`racy`) that it must not be.
Stamps = dict[str, Any]


def digests(root: Path, campaign: Campaign, processed: Path) -> tuple[dict[str, str], Stamps]:
    """Relative path to SHA-256 of every raw input, in a fixed order, and what `remember` takes. Writes nothing.

    Digests of files whose size and modification time are as before are taken from the cache beside the products; a damaged
    cache is no cache.
    """
    cache: Stamps = store.read_json_if_whole(processed / CACHE)
    result: dict[str, str] = {}
    fresh: Stamps = {}

    def look(names: Iterable[str]) -> None:
        """Digest those files, all that must be read at once."""
        unknown = []
        for name in names:
            status = (root / name).stat()
            known = cache.get(name)
            stamp = [status.st_size, status.st_mtime_ns, status.st_ino]
            remembered = bool(known and known["stamp"] == stamp)
            racy = time.time_ns() - status.st_mtime_ns <= RACY_NS
            fresh[name] = {"stamp": stamp, "sha256": known["sha256"] if known and remembered else "", "remembered": remembered, "racy": racy}
            unknown += [] if remembered else [name]
        for name, sha in zip(unknown, store.sha256_of([root / name for name in unknown]), strict=True):
            fresh[name]["sha256"] = sha

    overlays = (o.file for o in campaign.report.overlay if (root / o.file).is_file())
    own = list(dict.fromkeys((*ingest.inputs(root, campaign), *overlays)))
    look(own)
    result.update((name, fresh[name]["sha256"]) for name in own)
    if campaign.piv is None:
        return result, fresh
    from nearlift.readers.piv.cases import files_of

    for case in campaign.piv.case:
        # hundreds of files in one line: names and digests of all of them
        listed = hashlib.sha256()
        files = [source_of(root, path) for path in files_of(root, case)]
        look(files)
        for name in files:
            listed.update(f"{name} {fresh[name]['sha256']}\n".encode())
        result[f"{PIV_INPUT}{case.name} ({len(files)} files)"] = listed.hexdigest()
    return result, fresh


def remember(processed: Path, stamps: Stamps) -> None:
    """Keep digests for the next command, beside products where there are any; a file that says the same already is left alone."""
    stamps = {name: {"stamp": s["stamp"], "sha256": s["sha256"]} for name, s in stamps.items() if not s["racy"]}
    if processed.is_dir() and stamps != store.read_json_if_whole(processed / CACHE):
        store.write_json(processed / CACHE, stamps)
