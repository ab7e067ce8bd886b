"""Public measured campaigns: fetched by digest, or made from files at hand."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from nearlift.datasets import garofano_soldado, pitt_ras_older, registry
from nearlift.datasets.fetch import cache_folder, get
from nearlift.errors import InputRefused
from nearlift.run.tables import sha256

#: Files at hand that were transcribed from a published one, with what makes a campaign of them.
TRANSCRIBED: dict[str, tuple[str, Callable[[Path, Path, str], object]]] = {
    "pitt-ras-older": (
        "pitt-ras-iarc7-thrust/v1_inline_sweeps.csv",
        lambda table, folder, name: pitt_ras_older.write(_sweeps(table), folder, name),
    ),
    "garofano-soldado-2023": (
        "garofano-soldado-2023/thrust_vs_height.csv",
        lambda table, folder, name: garofano_soldado.write_table(table, folder, name=name),
    ),
    "garofano-soldado-2023-axes": (
        "garofano-soldado-2023/thrust_vs_height.csv",
        lambda table, folder, name: garofano_soldado.write_table(
            table, folder, along_axes=True, name=name
        ),
    ),
}


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A data set of `nearlift data`, and a remark for readers of its row."""

    name: str
    remark: str


CAMPAIGNS = (
    Measured(
        name="pitt-ras-2017",
        remark=(
            "the distance was reduced while the battery fell. The supply's effect is found; k"
            " depends on the one sweep near the ground"
        ),
    ),
    Measured(
        name="pitt-ras-older",
        remark=(
            "no throttle repeats, so L_inf is a curve of throttle and supply. Both short sweeps"
            " near the ground are sessions of their own"
        ),
    ),
    Measured(
        name="garofano-soldado-2023",
        remark="vertical force. Tilt explains most, and changes the curve too; k is undetermined",
    ),
    Measured(
        name="garofano-soldado-2023-axes",
        remark=(
            "force along the rotors' axes. No effect of the library changes the curve with tilt as"
            " these rotors do; k is at its bound"
        ),
    ),
    Measured(
        name="jirs2024-ground-10-inch",
        remark="one odd cell (z over R 1.18, full throttle) makes the floor",
    ),
    Measured(
        name="jirs2024-ground-12-inch",
        remark=(
            "an exponent of rotor speed beyond 3 (7.5 in a plain fit) has no physics: not named"
        ),
    ),
    Measured(
        name="jirs2024-ceiling-10-inch",
        remark="one rotor's speed is blank nearest the ceiling",
    ),
    Measured(
        name="jirs2024-ceiling-12-inch",
        remark="the rotors turn 2.5 % faster near the ceiling at held pulse width",
    ),
)


def _sweeps(table: Path) -> list[pitt_ras_older.Point]:
    with table.open(newline="") as file:
        return [
            (int(sweep), *rest)  # type: ignore[misc]
            for sweep, *rest in list(csv.reader(file))[1:]
        ]


def campaign(
    name: str,
    folder: Path,
    data: Path,
    say: Callable[[str], None],
    *,
    listed: Path = registry.OWN,
    cache: Path | None = None,
) -> Path:
    """Campaign of a data set in `folder`, made where it is not there.

    Files come from the cache, from the server, or from `data`, known by their digests; a
    transcribed table of `data` is the last resort.

    Raises
    ------
    InputRefused
        A file is neither fetched nor at hand.
    """
    if (folder / "campaign.toml").is_file():
        return folder
    wanted = registry.dataset(name, listed)
    store = (cache or cache_folder()) / name
    copied = _from_hand({f.sha256: f.name for f in wanted.file}, data, store)
    if copied:
        say(f"{name}: {copied} files from {data}")
    try:
        return get(wanted, folder, cache=store.parent, say=lambda text: say(f"{name}: {text}"))
    except InputRefused as fault:
        table, convert = TRANSCRIBED.get(name, ("", None))
        if convert is None or not (data / table).is_file():
            raise
        say(f"{name}: {fault.what}; made from {data / table}")
        folder.mkdir(parents=True, exist_ok=True)
        convert(data / table, folder, name)
        return folder


def _from_hand(wanted: dict[str, str], data: Path, store: Path) -> int:
    """Copy the files of `data` that have these digests into the cache; their number."""
    missing = {digest: name for digest, name in wanted.items() if not (store / name).is_file()}
    names = set(missing.values())
    copied = 0
    for path in sorted(data.rglob("*")) if missing else ():
        # published names may hold characters that a file system refuses, so size is no criterion
        if path.name in names and path.is_file() and (digest := sha256(path)) in missing:
            store.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, store / missing[digest])
            copied += 1
    return copied
