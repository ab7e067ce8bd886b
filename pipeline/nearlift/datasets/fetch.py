"""From the list to a campaign: files fetched into a cache and checked, then converted; the folder
appears whole or not at all.
"""

from __future__ import annotations

import contextlib
import importlib
import logging
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from nearlift.datasets.registry import UNKNOWN, Dataset, PublicFile
from nearlift.errors import InputRefused, UsageError
from nearlift.run.tables import sha256

TIMEOUT_S = 30


#: What a converter module has: of files by name, an empty folder and the campaign's name, it writes
#: ``campaign.toml`` and ``trials.csv``.
Convert = Callable[[dict[str, Path], Path, str], None]


def cache_folder() -> Path:
    """Folder of fetched files: ``NEARLIFT_CACHE``, else the system's place for caches."""
    import pooch

    return Path(os.environ.get("NEARLIFT_CACHE") or pooch.os_cache("nearlift"))


def get(
    wanted: Dataset,
    folder: Path,
    *,
    trust: bool = False,
    cache: Path | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Path:
    """Fetch what the cache lacks, and write the campaign into a new or empty folder; returns the
    folder.

    Raises
    ------
    UsageError
        The folder holds something already, or a file's digest is unknown and it is not to be
        trusted.
    InputRefused
        A file cannot be fetched, is another than the one that is known, or does not hold what it
        should.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(
            str(folder),
            "is not empty" if folder.is_dir() else "is a file",
            "name a new folder; nothing is ever overwritten",
        )
    if wanted.unknown and not trust:
        listed = ", ".join(f.name for f in wanted.unknown)
        raise UsageError(
            wanted.name,
            f"has files whose digest is unknown: {listed}",
            "look at what the URL gives, then say --trust",
        )
    store = (cache or cache_folder()) / wanted.name
    files = {file.name: _fetched(file, store, say) for file in wanted.file}
    convert: Convert = importlib.import_module(f"nearlift.datasets.{wanted.converter}").convert
    folder.parent.mkdir(parents=True, exist_ok=True)
    made = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        convert(files, made, wanted.name)
        lines = [
            f"{wanted.title}.",
            f"Cite: {wanted.citation}.",
            f"Licence: {wanted.licence}. {wanted.home}",
            wanted.note,
            "Converted by nearlift from",
            *(
                f"{file.name}  sha256 {sha256(files[file.name])}  {file.url}"
                for file in wanted.file
            ),
        ]
        (made / "SOURCE.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
        made.chmod(0o755)
        with contextlib.suppress(FileNotFoundError):
            folder.rmdir()
        made.rename(folder)
    except BaseException:
        shutil.rmtree(made, ignore_errors=True)
        raise
    return folder


def _fetched(file: PublicFile, store: Path, say: Callable[[str], None]) -> Path:
    """The file in the cache, checked; fetched if it is not there, or not what it should be."""
    import pooch
    from requests import RequestException

    pooch.get_logger().setLevel(logging.ERROR)
    path = store / file.name
    known = None if file.sha256 == UNKNOWN else f"sha256:{file.sha256}"
    if not (path.is_file() and (known is None or sha256(path) == file.sha256)):
        say(f"fetching {file.name}")
    try:
        # written under another name, checked, then renamed: a wrong or cut file leaves nothing
        # behind
        downloader = pooch.HTTPDownloader(timeout=TIMEOUT_S)
        return Path(
            pooch.retrieve(
                file.url, known_hash=known, fname=file.name, path=store, downloader=downloader
            )
        )
    except RequestException as fault:
        reason = type(fault).__name__
        if fault.response is not None:
            reason = f"the server says {fault.response.status_code}"
            # pooch leaves it open
            fault.response.close()
        raise InputRefused(
            file.url,
            f"cannot be fetched ({reason})",
            f"are you online? or put the file there by hand: {path}",
        ) from None
    except ValueError as fault:
        if "hash" not in str(fault):
            raise InputRefused(
                file.url, str(fault), "the URL of a data set begins with https://"
            ) from None
        raise InputRefused(
            file.url,
            f"is not the file that is known here (its SHA-256 is not {file.sha256[:12]}...)",
            "it was changed or cut; nothing was kept: try again",
        ) from None
