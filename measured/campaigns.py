"""Public measured campaigns: fetched by digest, or made from files at hand."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

from nearlift.datasets import registry
from nearlift.datasets.converters import write_campaign
from nearlift.datasets.fetch import cache_folder, get
from nearlift.errors import InputRefused
from nearlift.run.tables import sha256

#: Data sets of `nearlift data` that have a boundary, with a remark for readers of the row.
REMARKS = {
    "pitt-ras-2017": (
        "the distance was reduced while the battery fell. The supply's effect is found; k depends"
        " on the one sweep near the ground"
    ),
    "pitt-ras-older": (
        "no throttle repeats, so L_inf is a curve of throttle and supply. Both short sweeps near"
        " the ground are sessions of their own"
    ),
    "garofano-soldado-2023": (
        "vertical force. Tilt explains most, and changes the curve too; k is undetermined"
    ),
    "garofano-soldado-2023-axes": (
        "force along the rotors' axes. No effect of the library changes the curve with tilt as"
        " these rotors do; k is undetermined"
    ),
    "jirs2024-ground-10-inch": "one odd cell (z over R 1.18, full throttle) makes the floor",
    "jirs2024-ground-12-inch": (
        "an exponent of rotor speed beyond 3 (7.5 in a plain fit) has no physics: not named"
    ),
    "jirs2024-ceiling-10-inch": "one rotor's speed is blank nearest the ceiling",
    "jirs2024-ceiling-12-inch": (
        "the rotors turn 2.5 % faster near the ceiling at held pulse width"
    ),
}


#: Tables at hand that were transcribed from a published file.
TRANSCRIBED = {
    "pitt-ras-older": "pitt-ras-iarc7-thrust/v1_inline_sweeps.csv",
    "garofano-soldado-2023": "garofano-soldado-2023/thrust_vs_height.csv",
    "garofano-soldado-2023-axes": "garofano-soldado-2023/thrust_vs_height.csv",
}


def campaign(
    name: str, folder: Path, data: Path, say: Callable[[str], None], listed: Path = registry.OWN
) -> Path:
    """Campaign of a data set in `folder`, made where it is not there.

    Files come from the cache, from `data` by their digests, or from the server. The last resort is
    a transcribed table in `data`.

    Raises
    ------
    InputRefused
        A file is neither fetched nor at hand.
    """
    if (folder / "campaign.toml").is_file():
        return folder
    wanted = registry.dataset(name, listed)
    at_hand = {path.name: path for path in data.rglob("*")}
    for file in wanted.file:
        cached, path = cache_folder() / name / file.name, at_hand.get(file.name)
        if path and not cached.is_file() and path.is_file() and sha256(path) == file.sha256:
            say(f"{name}: {file.name} from {path}")
            cached.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, cached)
    try:
        get(wanted, folder, lambda text: say(f"{name}: {text}"))
    except InputRefused as fault:
        table = data / TRANSCRIBED.get(name, "")
        if not table.is_file():
            raise
        say(f"{name}: {fault.what}; made from {table}")
        write_campaign(folder, wanted.converter, {table.name: table}, name)
    return folder
