"""Records cut into trials by [segments] of the manifest, drawn before any fit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from nearlift import readers
from nearlift.campaign import manifest as manifests
from nearlift.errors import ManifestError
from nearlift.readers import segments
from nearlift.schedule import read_schedule


def cuts(campaign: Path, out: Path) -> tuple[dict[str, Any], str]:
    """Cuts of a campaign's records, as JSON and as text.

    The first records are drawn to reports/<name>/segments.png under `out`. `ManifestError` if the
    manifest has no [segments].
    """
    from nearlift.report.figures.cuts import picture

    given = manifests.load(campaign)
    rate_Hz = given.load_cell.sample_rate
    if given.segments is None or rate_Hz is None:
        raise ManifestError(
            str(campaign / "campaign.toml"),
            "has no [segments]: every record is one trial",
            "where a record holds many trials, add [segments] with column, settle and shortest",
        )
    reader = segments.cutting(readers.reader(given.records.reader))
    reader.checked_dialect(given.records.dialect)
    paths = reader.places(given, campaign, read_schedule(given, campaign).trial.tolist())
    records = [segments.read(given, campaign, reader, name, path) for name, path in paths.items()]
    place = out / "reports" / given.name / "segments.png"
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(picture(records, rate_Hz))
    contents, lines = [], []
    for record in records:
        name, cut = record.record.trial, record.cuts
        pieces = [
            {
                "trial": f"{name}#{p.number}",
                "since_s": p.since_s,
                "length_s": len(p.force_N) / rate_Hz,
                "lift_N": float(p.force_N.mean() - (p.tare_N.mean() if len(p.tare_N) else 0.0)),
                **p.brought,
            }
            for p in record.pieces
        ]
        content = {
            "record": name,
            "codes": list(record.record.codes),
            "pieces": pieces,
            "too_short": cut.short,
            "at_rest": record.at_rest,
            "settling_s": cut.settling / rate_Hz,
            "between_s": cut.between / rate_Hz,
        }
        contents.append(content)
        summary = (
            f"{name}: {len(pieces)} pieces, {cut.short} too short, {record.at_rest} at rest;"
            f" {content['settling_s']:.3g} s settling, {content['between_s']:.3g} s between"
        )
        lines.append(", ".join([summary, *record.record.codes]))
        for piece in pieces:
            trial, since, length, lift, *brought = piece.items()
            text = f"{since[1]:.6g} s, {length[1]:.4g} s, {lift[1]:.4g} N"
            lines.append(
                ", ".join([f"  {trial[1]}  from {text}", *(f"{n} {v:.4g}" for n, v in brought)])
            )
    return {"campaign": given.name, "picture": str(place), "records": contents}, "\n".join(
        [*lines, str(place)]
    )
