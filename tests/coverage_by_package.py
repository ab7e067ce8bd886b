"""Line coverage of each package, of the core and of the whole, from what `make test COVERAGE=1` recorded.

The exit code is 1 where the core is below `CORE` or the whole below `WHOLE` per cent.
"""

from __future__ import annotations

import sys
import tempfile
import tomllib
from pathlib import Path

import coverage
import pandas as pd

#: Per cent of lines that tests must run.
CORE, WHOLE = 95.0, 88.0
ROOT = Path(__file__).resolve().parents[1]


def core_rooms() -> set[str]:
    """The loop and every package below it in the layers of pyproject.toml."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    [layers] = (c["layers"] for c in settings["tool"]["importlinter"]["contracts"] if "layers" in c)
    rooms = [layer.replace(":", " ").replace("|", " ").split() for layer in layers]
    first = next(i for i, layer in enumerate(rooms) if "loop" in layer)
    return {room for layer in rooms[first:] for room in layer}


def packages(report: Path) -> pd.DataFrame:
    """Lines, and those that ran, by package, from a report of coverage.py in JSON."""
    files = pd.read_json(report, typ="series")["files"]
    table = pd.DataFrame(
        [
            (Path(name).resolve().relative_to(ROOT / "pipeline" / "nearlift").parts, f["summary"])
            for name, f in files.items()
        ],
        columns=["parts", "summary"],
    )
    table["package"] = [parts[0].removesuffix(".py") for parts in table["parts"]]
    table["lines"] = [s["num_statements"] for s in table["summary"]]
    table["ran"] = [s["covered_lines"] for s in table["summary"]]
    return table.groupby("package")[["lines", "ran"]].sum()


def main() -> int:
    """Print the table."""
    data = coverage.Coverage()
    data.combine()
    data.save()
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        data.json_report(outfile=str(report))
        table = packages(report)
    core = table[table.index.isin(core_rooms())].sum().rename("core")
    table = pd.concat([table, core.to_frame().T, table.sum().rename("whole").to_frame().T])
    table["per cent"] = (100 * table["ran"] / table["lines"]).round(1)
    print(table.to_string())
    share = table["per cent"]
    return int(share["core"] < CORE or share["whole"] < WHOLE)


if __name__ == "__main__":
    sys.exit(main())
