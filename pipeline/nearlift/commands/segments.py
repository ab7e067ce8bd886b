"""segments: where the records of a campaign are cut, drawn before anything is fitted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from nearlift import readers
from nearlift.commands.common import CAMPAIGN, Call, declared
from nearlift.errors import ManifestError
from nearlift.manifest import campaign as manifests
from nearlift.readers import segments
from nearlift.readers.files import per_trial
from nearlift.readers.schedule import read_schedule
from nearlift.readers.segments import Segmented

PICTURE = "segments.png"


def cuts_document(record: Segmented, rate_Hz: float) -> dict[str, object]:
    """What one record was cut into, for machines."""
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


def described(records: list[dict[str, Any]]) -> list[str]:
    """The same in words: a line for each record, and one for each of its pieces."""
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


@declared("segments")
@CAMPAIGN
def command(call: Call, campaign: Path) -> None:
    """The pieces of every record, and the picture of the first ones."""
    from nearlift.report import segments_preview

    given = manifests.load(campaign)
    rate = given.load_cell.sample_rate
    if given.segments is None or rate is None:
        raise ManifestError(
            str(campaign / "campaign.toml"),
            "has no [segments]: every record is one trial",
            "where a record holds many trials, add [segments] with by, settle and shortest",
        )
    reader = readers.reader(given.records.reader)
    segments.format_of(reader).checked_dialect(given.records.dialect)
    ids = read_schedule(given, campaign).trial.tolist()
    records = [
        segments.read(given, campaign, reader, record, path)
        for record, (path, _) in per_trial(given, campaign, ids).items()
    ]
    contents = [cuts_document(record, rate) for record in records]
    place = call.out / "reports" / given.name / PICTURE
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(segments_preview.picture(records, rate))
    call.answer(
        {"picture": str(place), "records": contents}, "\n".join([*described(contents), str(place)])
    )
