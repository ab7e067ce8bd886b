"""The files of one case of [piv], and their fields in vehicle axes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from nearlift.errors import InputRefused, ManifestError
from nearlift.flow.field import VelocityField, masked, orient
from nearlift.manifest.piv import Piv, PivCase
from nearlift.readers.child import Child
from nearlift.readers.files import inside, source_of
from nearlift.readers.piv.sniff import read
from nearlift.readers.piv.vectors import Setting


def files_of(root: Path, case: PivCase) -> list[Path]:
    """Every file of a case, in the order of the numbers in their names; `ManifestError` where the
    pattern leads outside the campaign's folder, or matches nothing, `InputRefused` where a file
    leads outside by a link, or is no regular file.
    """
    where = f"piv case {case.name!r}: files"
    if Path(case.files).is_absolute() or ".." in Path(case.files).parts:
        raise ManifestError(
            where,
            f"{case.files!r} leads outside the campaign's folder",
            "put the files themselves into the folder",
        )
    files = sorted(
        (p for p in root.glob(case.files) if p.is_file()),
        key=lambda p: _natural(source_of(root, p)),
    )
    if not files:
        raise ManifestError(
            where,
            f"no file matches {case.files!r} in {root}",
            'write a pattern such as "piv/ground-3.4/*.txt"',
        )
    return [inside(root, source_of(root, p), where) for p in files]


def _natural(name: str) -> list[str | int]:
    # every second part is a number
    return [int(part) if i % 2 else part for i, part in enumerate(re.split(r"(\d+)", name))]


@dataclass
class Stream:
    """The fields of one case, one in memory at a time; `refused` lists what was (file, reason)."""

    root: Path
    piv: Piv
    case: PivCase
    files: list[Path]
    refused: list[tuple[str, InputRefused]] = field(default_factory=list)

    def __iter__(self) -> Iterator[VelocityField]:
        said = partial(self.piv.setting, self.case)
        setting = Setting(
            length_unit=said("length_unit"),
            velocity_unit=said("velocity_unit"),
            scale_m=said("scale"),
            frame_time_s=said("frame_time"),
        )
        lie = {name: said(name) for name in ("thrust", "across")}
        lie |= {"origin_m": said("origin"), "v_sign": said("v_sign", 1)}
        hidden = said("mask", [])
        # started only if a file needs it
        with Child() as child:
            for path in self.files:
                try:
                    for field in read(path, setting, said("format"), child):
                        yield masked(orient(field, **lie), hidden)
                except InputRefused as refusal:
                    self.refused.append((source_of(self.root, path), refusal))
