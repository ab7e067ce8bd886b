"""Which raw files a campaign consists of, and their digests; hashed again only where size or time has changed."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from nearlift import store
from nearlift.campaign import Campaign
from nearlift.stages import ingest

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
    overlays = (o.file for o in campaign.report.overlay if (root / o.file).is_file())
    result, fresh = {}, {}
    for name in dict.fromkeys((*ingest.inputs(root, campaign), *overlays)):
        status = (root / name).stat()
        known = cache.get(name)
        stamp = [status.st_size, status.st_mtime_ns, status.st_ino]
        sha = known["sha256"] if known and known["stamp"] == stamp else store.sha256(root / name)
        result[name] = sha
        racy = time.time_ns() - status.st_mtime_ns <= RACY_NS
        fresh[name] = {"stamp": stamp, "sha256": sha, "remembered": bool(known and known["stamp"] == stamp), "racy": racy}
    return result, fresh


def remember(processed: Path, stamps: Stamps) -> None:
    """Keep digests for the next command, beside products where there are any; a file that says the same already is left alone."""
    stamps = {name: {"stamp": s["stamp"], "sha256": s["sha256"]} for name, s in stamps.items() if not s["racy"]}
    if processed.is_dir() and stamps != store.read_json_if_whole(processed / CACHE):
        store.write_json(processed / CACHE, stamps)
