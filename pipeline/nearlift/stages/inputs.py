"""Which raw files a campaign consists of, and their digests; hashed again only where size or time has changed."""

from __future__ import annotations

import time
from pathlib import Path

from nearlift import store
from nearlift.campaign import Campaign
from nearlift.stages import ingest

#: A file younger than this may change again without its time stamp telling, so its digest is not kept.
RACY_NS = 2_000_000_000


def digests(root: Path, campaign: Campaign, processed: Path, keep: bool = True) -> dict[str, str]:
    """Relative path to SHA-256 of every raw input, in a fixed order.

    Digests of files whose size and modification time are as before are taken from the cache beside the products, which is
    brought up to date where `keep` says so. A damaged cache is no cache.
    """
    cache_path = processed / "inputs-cache.json"
    cache = store.read_json_if_whole(cache_path)
    result, fresh = {}, {}
    overlays = (o.file for o in campaign.report.overlay if (root / o.file).is_file())
    for name in dict.fromkeys((*ingest.inputs(root, campaign), *overlays)):
        status = (root / name).stat()
        known = cache.get(name)
        stamp = [status.st_size, status.st_mtime_ns, status.st_ino]
        sha = known["sha256"] if known and known["stamp"] == stamp else store.sha256(root / name)
        result[name] = sha
        if time.time_ns() - status.st_mtime_ns > RACY_NS:
            fresh[name] = {"stamp": stamp, "sha256": sha}
    if keep and fresh != cache and processed.is_dir():
        store.write_json(cache_path, fresh)
    return result
