"""Published tables as campaigns of means: their rows, and the campaign's two files.

The manifest of a data set is the template ``<converter>.toml``.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from nearlift.errors import InputRefused


def read_rows(path: Path, columns: Sequence[str]) -> list[dict[str, str]]:
    """Rows of a CSV table as they are; `InputRefused` where a column is lacking."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file)
        lacking = [c for c in columns if c not in (reader.fieldnames or ())]
        if lacking:
            raise InputRefused(
                str(path),
                f"lacks the columns {', '.join(lacking)}",
                f"it has to have {', '.join(columns)}",
            )
        return list(reader)


def write_campaign(folder: Path, converter: str, lines: Sequence[str], **facts: object) -> None:
    """Write ``campaign.toml``, its template filled in, and the schedule's `lines`."""
    template = Path(__file__).with_name(f"{converter}.toml").read_text(encoding="utf-8")
    (folder / "campaign.toml").write_text(template.format(**facts), encoding="utf-8")
    (folder / "trials.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
