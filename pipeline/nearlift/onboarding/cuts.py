"""Records cut into trials by [segments] of the manifest, drawn before any fit."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from nearlift import readers
from nearlift.campaign import manifest as manifests
from nearlift.errors import ManifestError, UsageError
from nearlift.readers import segments
from nearlift.readers.files import per_trial
from nearlift.readers.segments import Segmented
from nearlift.schedule import read_schedule

MANIFEST, PICTURE = "campaign.toml", "segments.png"


class CutsAnswer(NamedTuple):
    """The pieces of a campaign's records, for machines and as text."""

    content: dict[str, Any]
    text: str


def answers(paths: Sequence[Path], out: Path) -> list[CutsAnswer]:
    """Draw the cuts of each campaign, and of each file as a record of its campaign."""
    wanted: dict[Path, list[Path]] = {}
    for path in paths:
        if path.is_dir():
            wanted[path] = []
        else:
            wanted.setdefault(campaign_of(path), []).append(path)
    return [cuts(campaign, out, files) for campaign, files in wanted.items()]


def campaign_of(path: Path) -> Path:
    """The folder above a file that holds its campaign's manifest; `UsageError` if none does."""
    for folder in path.absolute().parents:
        if (folder / MANIFEST).is_file():
            return folder
    raise UsageError(
        str(path), "belongs to no campaign", f"put it in a folder with a {MANIFEST} that lists it"
    )


def cuts(campaign: Path, out: Path, files: Collection[Path] = ()) -> CutsAnswer:
    """Cut the records of a campaign, or only these files of it; draw the first ones to
    reports/<name>/segments.png under `out`.

    Raises
    ------
    ManifestError
        The manifest has no [segments].
    UsageError
        A file is no record of the campaign.
    """
    from nearlift.report.figures.cuts import picture

    given = manifests.load(campaign)
    rate = given.load_cell.sample_rate
    if given.segments is None or rate is None:
        raise ManifestError(
            str(campaign / MANIFEST),
            "has no [segments]: every record is one trial",
            "where a record holds many trials, add [segments] with by, settle and shortest",
        )
    reader = readers.reader(given.records.reader)
    segments.cutting(reader).checked_dialect(given.records.dialect)
    pieces = per_trial(given, campaign, read_schedule(given, campaign).trial.tolist())
    paths = {record: path for record, (path, _) in pieces.items()}
    if files:
        known = {path.resolve(): record for record, path in paths.items()}
        for file in files:
            if file.resolve() not in known:
                raise UsageError(
                    str(file),
                    f"is no record of {campaign}",
                    f"list it in {given.trials.file}, or check [records] files",
                )
        paths = {known[file.resolve()]: file for file in files}
    records = [
        segments.read(given, campaign, reader, record, path) for record, path in paths.items()
    ]
    place = out / "reports" / given.name / PICTURE
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(picture(records, rate))
    answer = {"campaign": given.name, "picture": str(place)}
    contents = [_content(record, rate) for record in records]
    lines = [line for record in records for line in _lines(record, rate)]
    return CutsAnswer({**answer, "records": contents}, "\n".join([*lines, str(place)]))


def _pieces(record: Segmented, rate_Hz: float) -> list[dict[str, Any]]:
    """Each piece's trial, beginning, length, lift, and what it brings."""
    return [
        {
            "trial": f"{record.record.trial}#{p.number}",
            "since_s": p.since_s,
            "length_s": len(p.force_N) / rate_Hz,
            "lift_N": float(p.force_N.mean() - (p.tare_N.mean() if len(p.tare_N) else 0.0)),
            **p.brought,
        }
        for p in record.pieces
    ]


def _content(record: Segmented, rate_Hz: float) -> dict[str, object]:
    """The pieces of one record, for machines."""
    return {
        "record": record.record.trial,
        "codes": list(record.record.codes),
        "pieces": _pieces(record, rate_Hz),
        "too_short": record.cuts.short,
        "at_rest": record.at_rest,
        "settling_s": record.cuts.settling / rate_Hz,
        "between_s": record.cuts.between / rate_Hz,
    }


def _lines(record: Segmented, rate_Hz: float) -> list[str]:
    """A line for a record, and one for each of its pieces."""
    cut = record.cuts
    summary = (
        f"{record.record.trial}: {len(record.pieces)} pieces, {cut.short} too short,"
        f" {record.at_rest} at rest; {cut.settling / rate_Hz:.3g} s settling,"
        f" {cut.between / rate_Hz:.3g} s between"
    )
    lines = [", ".join([summary, *record.record.codes])]
    for piece in _pieces(record, rate_Hz):
        trial, since, length, lift, *brought = piece.items()
        text = f"{since[1]:.6g} s, {length[1]:.4g} s, {lift[1]:.4g} N"
        more = (f"{name} {value:.4g}" for name, value in brought)
        lines.append(f"  {trial[1]}  from {', '.join([text, *more])}")
    return lines
