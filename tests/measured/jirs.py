"""The tables of J Intell Robot Syst 110.3 (2024) as campaigns: 20 cells each, ground and ceiling,
10- and 12-inch propellers.
"""

from __future__ import annotations

from pathlib import Path

from nearlift.datasets import jirs

FILE = (
    Path(__file__).parents[3]
    / "shared/data/jirs2024-unibz-surface/surface_jirs2024_effect_packet.csv"
)


def written(folder: Path, boundary: str, inches: int) -> Path:
    """A campaign of one of the tables."""
    root = folder / "raw"
    root.mkdir(parents=True)
    jirs.convert({FILE.name: FILE}, root, f"jirs2024-{boundary}-{inches}-inch")
    return root
