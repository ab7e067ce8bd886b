"""Effects put into measured trials by arithmetic, and logged causes withheld.

A case is a campaign, a kind and a size. Sizes are in units of the campaign's noise floor: the rms
of the relative change of lift over its trials. A synthetic voltage acts with an exponent of 2; a
logged one is made to act more. Heights are in millimetres, as a lab reads them.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nearlift.randomness import generator

from . import loop

SEED = 46
#: Kind to the library's effect of the same cause.
KINDS = {
    "gain_drift": "gain_drift",
    "zero_offset": "zero_offset",
    "session_gain": "session_gain",
    "supply_sag": "supply_sag",
    "height_offset": "height_offset",
}
SIZES = (1.0, 2.0, 4.0)
HEIGHTS_MM = (0.3, 1.0)
SAG_EXPONENT = 2.0
#: Columns that hold a logged cause, by campaign.
WITHHELD = {
    "pitt-ras-2017": ("supply",),
    "garofano-soldado-2023": ("tilt", "beta"),
    "garofano-soldado-2023-axes": ("tilt", "beta"),
    "jirs2024-ground-10-inch": ("rpm",),
    "jirs2024-ground-12-inch": ("rpm",),
    "jirs2024-ceiling-10-inch": ("rpm",),
    "jirs2024-ceiling-12-inch": ("rpm",),
}
#: Campaigns of the page's table. Garofano-Soldado's are unexplained without an injection, and take
#: minutes each; `--case` makes single rows of them.
INJECTED = tuple(name for name in WITHHELD if not name.startswith("garofano"))
#: A shorter table is diagnosed as published, without an order; a drift has no name there.
FEWEST_ORDERED = 45
UNITS = {"start": "s", "supply": "V"}
MM_PER = {"m": 1e3, "cm": 1e1, "mm": 1.0}
Rows = list[dict[str, str]]


@dataclass(frozen=True)
class Case:
    """Variant of a campaign: of a kind of `KINDS`, or ``published`` (as it is), ``withheld``
    (without the columns of `WITHHELD`) or ``none`` (nothing put in, but with the order, start and
    supply that variants have and the lab did not publish).
    """

    campaign: str
    kind: str = "none"
    size: float = 0.0

    @property
    def name(self) -> str:
        """Name of its campaign on disk."""
        size = f"-{self.size:g}" if self.size else ""
        return f"{self.campaign}--{self.kind.replace('_', '-')}{size}".replace(".", "p")

    @property
    def words(self) -> str:
        """Arguments of the command that makes this row again."""
        return f"--case {self.campaign} {self.kind} {self.size:g}"


def cases(campaign: str) -> Iterator[Case]:
    """All injections into one campaign of `INJECTED`."""
    for kind in KINDS if campaign in INJECTED else ():
        for size in HEIGHTS_MM if kind == "height_offset" else SIZES:
            yield Case(campaign=campaign, kind=kind, size=size)


def outcome(case: Case, found: loop.Finding, without: loop.Finding) -> str:
    """Found, false (a name that is neither the cause nor in the answer without it), abstained
    (*unexplained*), or missed.
    """
    if KINDS[case.kind] in found.names - without.names:
        return "found"
    if found.effects and not found.names & (without.names | {KINDS[case.kind]}):
        return "false"
    if found.verdict == "unexplained":
        return "abstained"
    return "found" if KINDS[case.kind] in found.names else "missed"


def written(case: Case, folder: Path, made: Path, floor: float) -> Path:
    """Write the variant's manifest and trials."""
    manifest = (folder / "campaign.toml").read_text(encoding="utf-8")
    with (folder / "trials.csv").open(newline="") as file:
        rows: Rows = list(csv.DictReader(file))
    if case.kind == "withheld":
        columns = WITHHELD[case.campaign]
        rows = [{k: v for k, v in row.items() if k not in columns} for row in rows]
        manifest = re.sub(rf"(?m)^({'|'.join(columns)})\s*=.*\n", "", manifest)
    elif case.kind != "published":
        if re.search(r'(?m)^order\s*=\s*"unknown"', manifest) and len(rows) >= FEWEST_ORDERED:
            manifest = re.sub(r'(?m)^order\s*=\s*"unknown".*\n', "", manifest)
        if "start" not in rows[0]:
            rows = in_random_order(rows, case.campaign)
        sag = max(case.size, 1.0) if case.kind == "supply_sag" else 1.0
        rows = logged(rows, case.campaign, sag * floor / SAG_EXPONENT)
        missing = [n for n in UNITS if not re.search(rf"(?m)^{n}\s*=", manifest)]
        lines = "".join(f'{name} = "{UNITS[name]}"\n' for name in missing)
        manifest = manifest.replace("[trials.units]\n", f"[trials.units]\n{lines}", 1)
        unit = re.search(r'(?m)^distance\s*=\s*"(\w+)"', manifest)
        assert unit, f"{folder}: trials.units has no distance"
        rows = injected(rows, case, floor, MM_PER[unit[1]])
    manifest = re.sub(r'(?m)^name( *)= ".*"', f'name\\1= "{case.name}"', manifest, count=1)
    made.mkdir(parents=True, exist_ok=True)
    (made / "campaign.toml").write_text(manifest, encoding="utf-8")
    with (made / "trials.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return made


def in_random_order(rows: Rows, seed: str) -> Rows:
    """Rows of a table in the order in which a lab might have measured them, which is not published:
    sessions in random order, and trials in random order within each.
    """
    rng = generator(SEED, "order", seed)
    if "session" not in rows[0]:
        mixed = [rows[i] for i in rng.permutation(len(rows))]
        return [{**row, "session": str(1 + i // 5)} for i, row in enumerate(mixed)]
    sessions = rng.permutation(sorted({row["session"] for row in rows}))
    found: Rows = []
    for session in sessions:
        mine = [row for row in rows if row["session"] == session]
        found += [mine[i] for i in rng.permutation(len(mine))]
    return found


def logged(rows: Rows, seed: str, rms: float) -> Rows:
    """Rows with a start and a supply voltage where the lab logged none: 20 s from trial to trial,
    and a battery that falls within each session, by this rms of its logarithm over all trials.
    """
    rng = generator(SEED, "supply", seed)
    sessions = np.array([row["session"] for row in rows])
    rank = np.array([np.sum(sessions[:i] == s) for i, s in enumerate(sessions)])
    count = np.array([np.sum(sessions == s) for s in sessions])
    fall = -rank / count + 0.1 * rng.standard_normal(len(rows))
    volts = 4.0 * np.exp(rms * (fall - fall.mean()) / fall.std())
    return [
        {"start": f"{20 * i}", "supply": f"{volts[i]:.5f}", **row} for i, row in enumerate(rows)
    ]


def injected(rows: Rows, case: Case, floor: float, mm_per_unit: float) -> Rows:
    """Rows with the effect in their lift, or in their recorded distance."""
    if case.kind == "none":
        return rows
    if case.kind == "height_offset":
        return [
            {**row, "distance": f"{float(row['distance']) + case.size / mm_per_unit:.8g}"}
            for row in rows
        ]
    lift = np.array([float(row["lift"]) for row in rows])
    change = relative_change(rows, lift, case.kind)
    changed = lift * (1 + case.size * floor * change / np.sqrt(np.mean(change**2)))
    return [{**row, "lift": f"{x:.8g}"} for row, x in zip(rows, changed, strict=True)]


def relative_change(rows: Rows, lift: np.ndarray, kind: str) -> np.ndarray:
    """Relative change of each trial's lift, of any size."""
    if kind == "gain_drift":
        start = np.array([float(row["start"]) for row in rows])
        return 2 * (start - start.min()) / (start.max() - start.min()) - 1
    if kind == "zero_offset":
        return 1 / lift
    if kind == "session_gain":
        _, index = np.unique([row["session"] for row in rows], return_inverse=True)
        gain = generator(SEED, "session gain").standard_normal(index.max() + 1)
        return (gain - gain.mean())[index]
    volts = np.array([float(row["supply"]) for row in rows])
    return np.log(volts / np.exp(np.log(volts).mean()))
