"""Records cut into trials by [segments] of the manifest, drawn before any fit."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from nearlift import readers
from nearlift.campaign import manifest as manifests
from nearlift.errors import ManifestError, UsageError
from nearlift.readers import segments
from nearlift.readers.files import per_trial
from nearlift.readers.segments import Segmented
from nearlift.schedule import read_schedule

Document = dict[str, Any]
MANIFEST, PICTURE = "campaign.toml", "segments.png"


def cuts_document(record: Segmented, rate_Hz: float) -> dict[str, object]:
    """The pieces of one record, for machines."""
    return {
        "record": record.record.trial,
        "codes": list(record.record.codes),
        "pieces": [
            {
                "trial": f"{record.record.trial}#{p.number}",
                "since_s": p.since_s,
                "length_s": len(p.force_N) / rate_Hz,
                "lift_N": float(p.force_N.mean() - (p.tare_N.mean() if len(p.tare_N) else 0.0)),
                **p.brought,
            }
            for p in record.pieces
        ],
        "too_short": record.cuts.short,
        "at_rest": record.at_rest,
        "settling_s": record.cuts.settling / rate_Hz,
        "between_s": record.cuts.between / rate_Hz,
    }


def described(records: list[Document]) -> list[str]:
    """A line for each record, and one for each of its pieces."""
    lines = []
    for record in records:
        lines.append(
            f"{record['record']}: {len(record['pieces'])} pieces, {record['too_short']} too short,"
            f" {record['at_rest']} at rest; {record['settling_s']:.3g} s settling,"
            f" {record['between_s']:.3g} s between" + "".join(f", {c}" for c in record["codes"])
        )
        for piece in record["pieces"]:
            brought = [
                f"{name} {value:.4g}"
                for name, value in piece.items()
                if name not in ("trial", "since_s", "length_s", "lift_N")
            ]
            lines.append(
                f"  {piece['trial']}  from {piece['since_s']:.6g} s, {piece['length_s']:.4g} s,"
                f" {piece['lift_N']:.4g} N" + "".join(f", {b}" for b in brought)
            )
    return lines


def cuts(campaign: Path, out: Path, files: Collection[Path] = ()) -> tuple[Document, str]:
    """Cut the records of a campaign, or only these files of it; draw the first ones to
    reports/<name>/segments.png under `out`. Returns the answer as JSON and as text.

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
            str(campaign / "campaign.toml"),
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
    contents = [cuts_document(record, rate) for record in records]
    place = out / "reports" / given.name / PICTURE
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(picture(records, rate))
    answer = {"campaign": given.name, "picture": str(place), "records": contents}
    return answer, "\n".join([*described(contents), str(place)])


def campaign_of(path: Path) -> Path:
    """The folder above a file that holds its campaign's manifest.

    Raises
    ------
    UsageError
        No folder above it does.
    """
    for folder in path.absolute().parents:
        if (folder / MANIFEST).is_file():
            return folder
    raise UsageError(
        str(path), "belongs to no campaign", f"put it in a folder with a {MANIFEST} that lists it"
    )


def answers(paths: Sequence[Path], out: Path) -> list[tuple[Document, str]]:
    """Draw the cuts of each campaign, and of each file as a record of its campaign."""
    wanted: dict[Path, list[Path]] = {}
    for path in paths:
        if path.is_dir():
            wanted[path] = []
        else:
            wanted.setdefault(campaign_of(path), []).append(path)
    return [cuts(campaign, out, files) for campaign, files in wanted.items()]
