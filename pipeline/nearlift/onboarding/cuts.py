"""Records cut into trials by [segments] of the manifest, drawn before any fit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from nearlift import readers
from nearlift.campaign import manifest as manifests
from nearlift.errors import ManifestError
from nearlift.readers import segments
from nearlift.readers.segments import Segmented
from nearlift.schedule import read_schedule


def cuts(campaign: Path, out: Path) -> tuple[dict[str, Any], str]:
    """Cuts of a campaign's records, as JSON and as text.

    The first records are drawn to reports/<name>/segments.png under `out`. `ManifestError` if the
    manifest has no [segments].
    """
    from nearlift.report.figures.cuts import picture

    given = manifests.load(campaign)
    rate = given.load_cell.sample_rate
    if given.segments is None or rate is None:
        raise ManifestError(
            str(campaign / "campaign.toml"),
            "has no [segments]: every record is one trial",
            "where a record holds many trials, add [segments] with column, settle and shortest",
        )
    reader = segments.cutting(readers.reader(given.records.reader))
    reader.checked_dialect(given.records.dialect)
    pieces = reader.places(given, campaign, read_schedule(given, campaign).trial.tolist())
    records = [
        segments.read(given, campaign, reader, record, path) for record, path in pieces.items()
    ]
    place = out / "reports" / given.name / "segments.png"
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(picture(records, rate))
    contents = [_content(record, rate) for record in records]
    lines = [line for content in contents for line in _lines(content)]
    content = {"campaign": given.name, "picture": str(place), "records": contents}
    return content, "\n".join([*lines, str(place)])


def _content(record: Segmented, rate_Hz: float) -> dict[str, Any]:
    """Pieces of one record: each one's trial, beginning, length, lift, and columns."""
    pieces = [
        {
            "trial": f"{record.record.trial}#{p.number}",
            "since_s": p.since_s,
            "length_s": len(p.force_N) / rate_Hz,
            "lift_N": float(p.force_N.mean() - (p.tare_N.mean() if len(p.tare_N) else 0.0)),
            **p.brought,
        }
        for p in record.pieces
    ]
    return {
        "record": record.record.trial,
        "codes": list(record.record.codes),
        "pieces": pieces,
        "too_short": record.cuts.short,
        "at_rest": record.at_rest,
        "settling_s": record.cuts.settling / rate_Hz,
        "between_s": record.cuts.between / rate_Hz,
    }


def _lines(content: dict[str, Any]) -> list[str]:
    """A line for a record, and one for each of its pieces."""
    summary = (
        f"{content['record']}: {len(content['pieces'])} pieces, {content['too_short']} too short,"
        f" {content['at_rest']} at rest; {content['settling_s']:.3g} s settling,"
        f" {content['between_s']:.3g} s between"
    )
    lines = [", ".join([summary, *content["codes"]])]
    for piece in content["pieces"]:
        trial, since, length, lift, *brought = piece.items()
        text = f"{since[1]:.6g} s, {length[1]:.4g} s, {lift[1]:.4g} N"
        more = (f"{name} {value:.4g}" for name, value in brought)
        lines.append(f"  {trial[1]}  from {', '.join([text, *more])}")
    return lines
