"""Published files into a cache, checked, and from there into a campaign's folder."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from pathlib import Path

from nearlift.datasets.converters import write_campaign
from nearlift.datasets.registry import Dataset, PublicFile
from nearlift.errors import InputRefused, UsageError

TIMEOUT_S = 30


def cache_folder() -> Path:
    """Folder of fetched files: ``NEARLIFT_CACHE``, else the system's place for caches."""
    import pooch

    return Path(os.environ.get("NEARLIFT_CACHE") or pooch.os_cache("nearlift"))


def get(wanted: Dataset, folder: Path, say: Callable[[str], None]) -> None:
    """Fetch what the cache lacks, and write the campaign into a new or empty folder.

    Raises
    ------
    UsageError
        The folder holds something already.
    InputRefused
        A file cannot be fetched, is another than the one that is known, or does not hold what it
        should. No campaign is written.
    """
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        what = "is not empty" if folder.is_dir() else "is a file"
        raise UsageError(str(folder), what, "name a new folder; nothing is ever overwritten")
    store = cache_folder() / wanted.name
    files = {file.name: _fetched(file, store, say) for file in wanted.file}
    write_campaign(folder, wanted.converter, files, wanted.name)
    lines = [
        f"{wanted.title}.",
        f"Cite: {wanted.citation}.",
        f"Licence: {wanted.licence}. {wanted.home}",
        wanted.note,
        "Converted by nearlift from",
        *(f"{file.name}  sha256 {file.sha256}  {file.url}" for file in wanted.file),
    ]
    (folder / "SOURCE.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _fetched(file: PublicFile, store: Path, say: Callable[[str], None]) -> Path:
    """Path of the file in the cache; fetched if it is not there, or not what it should be."""
    import pooch
    from requests import RequestException

    pooch.get_logger().setLevel(logging.ERROR)
    path = store / file.name
    if not path.is_file():
        say(f"fetching {file.name}")
    try:
        pooch.retrieve(
            file.url,
            known_hash=f"sha256:{file.sha256}",
            fname=file.name,
            path=store,
            downloader=pooch.HTTPDownloader(timeout=TIMEOUT_S),
        )
    except RequestException as fault:
        reason = type(fault).__name__
        if fault.response is not None:
            reason = f"the server says {fault.response.status_code}"
            # pooch leaves it open
            fault.response.close()
        remedy = f"are you online? or put the file there by hand: {path}"
        raise InputRefused(file.url, f"cannot be fetched ({reason})", remedy) from None
    except ValueError:
        raise InputRefused(
            file.url,
            f"is not the file that is known here (its SHA-256 is not {file.sha256[:12]}...)",
            "it was changed or cut; nothing was kept: try again",
        ) from None
    return path
