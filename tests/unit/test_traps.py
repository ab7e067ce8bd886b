"""The table of traps in docs/flights.md names tests that exist."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_trap_has_a_test_that_is_there() -> None:
    table = (ROOT / "docs" / "flights.md").read_text(encoding="utf-8").split("## Traps")[1]
    rows = [line for line in table.splitlines() if line.startswith("| ")][2:]
    assert len(rows) > 20
    for row in rows:
        named = re.findall(r"`([\w/]*(?:\.py)?)::(test_\w+)`", row)
        assert named, row
        file = ""
        for place, test in named:
            file = place or file
            path = ROOT / (file if "/" in file else f"tests/unit/{file}")
            assert f"def {test}(" in path.read_text(encoding="utf-8"), (file, test)
