"""SHA256SUMS, as `sha256sum * > SHA256SUMS` writes it beside the manifest or the records, held
against every file that is read.

Most formats have no check sum of their own: what a copy, a disk or a colleague changed between the
rig and the first ingest shows only here.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from nearlift.campaign.manifest import Campaign
from nearlift.errors import InputRefused, brief
from nearlift.readers.files import inside, source_of
from nearlift.readers.seam import MARK
from nearlift.run import store
from nearlift.run.job import Job

NAME = "SHA256SUMS"
#: A hundred thousand names.
MOST_BYTES = 16 << 20
#: A backslash where the name is escaped, the sum, and the name.
_LINE = re.compile(r"(\\?)([0-9a-fA-F]{64}) [ *]([^\0]+)")
_ESCAPES = {r"\\": "\\", r"\n": "\n", r"\r": "\r"}


def files(root: Path, campaign: Campaign) -> list[Path]:
    """The lists of sums that there are: in the campaign's folder, and in that of the records where
    it is the same for all of them.
    """
    folder = PurePosixPath(campaign.records.pattern.partition(MARK)[0] + "x").parent
    places = dict.fromkeys((NAME, (folder / NAME).as_posix()))
    return [path for place in places if (path := inside(root, place, NAME)).is_file()]


def stated(root: Path, path: Path) -> dict[str, str]:
    """Relative path to the SHA-256 that a list states.

    Raises
    ------
    InputRefused
        A line is none of `sha256sum`, names a file outside the campaign's folder, or says another
        sum than an earlier one.
    """
    if path.stat().st_size > MOST_BYTES:
        raise InputRefused(
            str(path), f"has more than {MOST_BYTES >> 20} MB", "list the campaign's own files"
        )
    sums: dict[str, str] = {}
    folder = PurePosixPath(source_of(root, path)).parent
    text = path.read_bytes().decode("utf-8-sig", "surrogateescape")
    for number, line in enumerate(text.split("\n"), start=1):
        line = line.removesuffix("\r")
        if not line.strip():
            continue
        where = f"{path}, line {number}"
        parts = _LINE.fullmatch(line)
        if parts is None:
            raise InputRefused(
                where,
                f"is no line of sha256sum: {brief(repr(line), 100)}",
                f"write it anew: sha256sum * > {NAME}",
            )
        escaped, sha, name = parts[1], parts[2].lower(), parts[3]
        if escaped:
            # a backslash before anything else stands for itself
            name = re.sub(r"\\[\\nr]", lambda pair: _ESCAPES[pair[0]], name)
        source = (folder / name).as_posix()
        inside(root, source, where)
        if sums.setdefault(source, sha) != sha:
            raise InputRefused(
                where,
                f"states another sum for {source} than a line above",
                f"write it anew: sha256sum * > {NAME}",
            )
    # written into the folder that it lists, it lists itself, empty
    sums.pop(source_of(root, path), None)
    return sums


def check(
    job: Job, shared: Sequence[str], records: Sequence[str]
) -> tuple[dict[str, str], list[str]]:
    """Hold what is to be read against the sums that are stated: what is wrong with `records`, of
    which a wrong one costs its one trial, by file, and what the user should know. Many trials rest
    on files that are `shared`, and on velocity grids, of which the job knows. Digests that the job
    has are not made again.

    Raises
    ------
    InputRefused
        A list cannot be read, a file that is not one trial's is not what it says, or most records
        are not.
    """
    faults: dict[str, str] = {}
    notes: list[str] = []
    alone = set(records)
    known = {*alone, *shared, *job.stamps}
    made = {**job.inputs, **{source: stamp["sha256"] for source, stamp in job.stamps.items()}}
    for path in files(job.root, job.campaign):
        name, sums = source_of(job.root, path), stated(job.root, path)
        digests = {source: made.get(source, "") for source in sums if source in known}
        unknown = [source for source, sha in digests.items() if not sha]
        fresh = store.sha256_of([job.root / source for source in unknown])
        digests |= zip(unknown, fresh, strict=True)
        wrong = [source for source, sha in digests.items() if sha != sums[source]]
        remedy = f"copy it anew from the rig; if it was changed on purpose, write {name} anew"
        for source in wrong:
            if source not in alone:
                raise InputRefused(str(job.root / source), f"is not what {name} states", remedy)
            faults[source] = f"{source} is not what {name} states; {remedy}"
        listed = [source for source in digests if source in alone]
        if 2 * len(wrong) > len(listed):
            remedy = (
                "were they copied as text, which changes line ends? copy them anew from the rig, or"
                " write the list anew"
            )
            others = f"{len(wrong)} of {len(listed)} records, such as {wrong[0]}"
            raise InputRefused(str(path), f"states other sums for {others}", remedy)
        missing = [source for source in sums if not (job.root / source).is_file()]
        notes += _note(missing, f"{name} lists", "missing: copy anew from the rig")
        covered, folder = {*sums, name}, PurePosixPath(name).parent
        unlisted = [
            source
            for source in (*shared, *records)
            if PurePosixPath(source).parent == folder and source not in covered
        ]
        notes += _note(unlisted, f"{name} does not list", "read all the same, and unchecked")
    return faults, notes


def _note(sources: Sequence[str], begin: str, end: str) -> list[str]:
    """One note about some files; none about none."""
    more = f" and {len(sources) - 3} more" if len(sources) > 3 else ""
    return [f"{begin} {', '.join(sources[:3])}{more}: {end}"] if sources else []
