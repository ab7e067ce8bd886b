"""What the interval to quote is worth under each verdict and for each kind of structure, from the
rows of runs of the harness.

python -m tests.calibration.verdicts out/*.jsonl        writes its section of docs/coverage.md
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from tests.calibration import pages
from tests.calibration.figures import Row, by_structure, share

#: What a campaign is, in the words of the table, and among which rows.
CAMPAIGNS = {
    "null": lambda r: not r["truth"],
    "one effect of the library": lambda r: r["kind"] == "one",
    "two effects": lambda r: r["kind"] == "two",
    "structure outside the library": lambda r: r["kind"] == "outside",
    "strange structure": lambda r: r["kind"] in r["truth"],
    "an effect under drifting noise": lambda r: (
        bool(r["truth"]) and r["kind"] in ("wander", "ar_95")
    ),
}
VERDICTS = ("adequate", "effect", "unexplained")
BODY = """## The number to quote

    python -m tests.calibration.verdicts out/records.jsonl out/pairs.jsonl out/strange.jsonl

90 % intervals of `results.json` that hold the coefficient, by kind of campaign and verdict, in the {n} campaigns of [calibration](calibration.md): count, 95 % limits of the share, and median width over that
of a fit with the true model and covariance.

{verdicts}
Structures outside the library: how many make a claim, how many get a name, and how often the interval holds the coefficient.

{structures}"""


def verdicts(rows: list[Row]) -> list[dict[str, Any]]:
    """A line for each kind of campaign, a cell for each verdict; then all together."""
    kinds = {**CAMPAIGNS, "**all**": lambda r: True}
    return [
        {"campaign": words}
        | {v: cell([r for r in rows if among(r) and r["verdict"] == v]) for v in VERDICTS}
        | {"all": cell([r for r in rows if among(r)])}
        for words, among in kinds.items()
        if any(map(among, rows))
    ]


def cell(rows: list[Row]) -> str:
    """Share that holds, its limits, and the width."""
    for found in share("", "", rows, "cover_quoted"):
        wide = float(np.median([r["width_quoted"] / r["oracle_width"] for r in rows]))
        return f"{found.brief}, {wide:.2f}"
    return "-"


def main() -> None:
    """Write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=Path("docs/coverage.md"))
    given = parser.parse_args()
    rows = [json.loads(line) for path in given.rows for line in path.read_text().splitlines()]
    rows = [r for r in rows if r["failed"] == ""]
    body = BODY.format(
        n=len(rows),
        verdicts=pages.table(verdicts(rows)),
        structures=pages.table(by_structure(rows)),
    )
    pages.write(given.out, "verdicts", body)


if __name__ == "__main__":
    main()
