"""The manifest `campaign.toml` in SI: facts about the rig, and choices.

An unknown key, a quantity without a unit and a unit of the wrong dimension are refused with key,
value and the nearest known one. No unit and no geometry has a default.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, Literal, Self, TypeVar

import numpy as np
from pydantic import BaseModel, Field, ValidationError, model_validator

from nearlift.campaign.choices import (
    Detect,
    Diagnose,
    FitOptions,
    Levels,
    Planned,
    Quality,
    Simulate,
)
from nearlift.campaign.piv import Piv
from nearlift.campaign.quantities import Section
from nearlift.campaign.rig import (
    DistanceReference,
    LoadCell,
    Records,
    Rig,
    Segments,
    Trials,
    Uncertainty,
    Vehicle,
    check_records,
)
from nearlift.declare import BOUNDARIES, Boundary
from nearlift.errors import ManifestError, brief, did_you_mean

#: Largest manifest, bytes; five hundred velocity cases take 150 kB.
MOST_BYTES = 1 << 19
#: Faults listed of one manifest.
MOST_FAULTS = 50
#: Placeholder of `nearlift new` for values to fill in.
BLANK = "FILL IN"
#: Keys that were renamed, and what to write instead.
RENAMED = {
    "segments.by": 'column = "...", or cut = "plateaus" or "windows"',
    "segments.maps": "becomes",
    "segments.only": "keep_where",
    "segments.hold": "tolerance",
}
# a dotted key of nine parts; a manifest needs four, and the parser takes their square in time
_DEEP = re.compile(r"""(?<![\w"'-])(?:[\w"'-]++\s*+\.\s*+){8}[\w"'-]""")
Kind = TypeVar("Kind", bound=BaseModel)


class Campaign(Section):
    """A whole manifest."""

    schema_: Literal["nearlift.campaign/1"] = Field(alias="schema")
    name: str
    simulated: bool = False
    note: str = ""
    vehicle: Vehicle
    rig: Rig
    load_cell: LoadCell = LoadCell()
    records: Records
    segments: Segments | None = None
    levels: Levels | None = None
    trials: Trials = Trials()
    uncertainty: list[Uncertainty] = []
    fit: FitOptions = FitOptions()
    quality: Quality = Quality()
    diagnose: Diagnose = Diagnose()
    piv: Piv | None = None
    design: Planned | None = None
    simulate: Simulate | None = None
    detect: Detect | None = None

    @model_validator(mode="after")
    def _coherent(self) -> Self:
        if not re.fullmatch(r"[a-z0-9][a-z0-9._-]*", self.name):
            raise ValueError(
                f"name {self.name!r} is not a slug: lower-case letters, digits, '-', '_' and '.',"
                " since it names folders"
            )
        if len({u.name for u in self.uncertainty}) != len(self.uncertainty):
            raise ValueError("two [[uncertainty]] components have the same name")
        for u in self.uncertainty:
            if not u.relative and self.nominal(u.on) is None and hasattr(self._place(u.on), u.on):
                raise ValueError(
                    f"uncertainty {u.name!r} is on the {u.on}, which is not given: give it, or"
                    " state the uncertainty in percent"
                )
        check_records(self.records, self.load_cell, self.segments)
        return self

    def _place(self, on: str) -> Section:
        return self.rig if on == "air_density" else self.vehicle

    def nominal(self, on: str) -> float | None:
        """Value, SI, of a model's input that an `[[uncertainty]]` can be on, if it is given."""
        value: float | None = getattr(self._place(on), on, None)
        return value

    def geometry(self) -> dict[str, Any]:
        """Inputs of lift models that all trials share, over rotor radius, as far as they are known:
        `spacing_hat`, `diagonal_hat`, `layout_hat` (rotors, 2), `gap_hat`, `edge_hat`.
        """
        known: dict[str, Any] = {}
        v, r, n = self.vehicle, self.vehicle.rotor_radius, self.vehicle.rotors
        if n > 1 and v.rotor_spacing is not None:
            known["spacing_hat"] = v.rotor_spacing / r
            # a regular polygon whose side is the adjacent spacing
            known["diagonal_hat"] = v.rotor_spacing / math.sin(math.pi / n) / r
            angles = 2 * math.pi * (np.arange(n) + 0.5) / n
            circumradius = known["spacing_hat"] / (2 * math.sin(math.pi / n))
            known["layout_hat"] = circumradius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        if n > 1 and v.rotor_diagonal is not None:
            known["diagonal_hat"] = v.rotor_diagonal / r
        if n == 1:
            known["layout_hat"] = np.zeros((1, 2))
        around = {"gap_hat": self.rig.gap, "edge_hat": self.rig.edge}
        return known | {name: x / r for name, x in around.items() if x is not None}

    def distance_reference(self, boundary: Boundary) -> DistanceReference:
        """Datum and offset of the distances to a boundary.

        `ManifestError` if a table has no entry for the boundary, or if the rotor axis is the datum
        of a ground or ceiling. Also if the sidewall's offset from that axis is not minus one
        radius.
        """
        given: list[Any] = []
        for key in ("distance_datum", "distance_offset"):
            value = getattr(self.rig, key)
            if isinstance(value, dict) and boundary not in value:
                what = f"has no entry for the {boundary}"
                raise ManifestError(f"rig.{key}", what, f"add {boundary} = ... to the table")
            given.append(value[boundary] if isinstance(value, dict) else value)
        datum, offset, r = *given, self.vehicle.rotor_radius
        if datum == "rotor axis" and boundary != "sidewall":
            what = f"the rotor axis is no datum for the {boundary}: it is at right angles to it"
            example = '{ ground = "rotor plane", sidewall = "rotor axis" }'
            remedy = f"give each boundary its own, such as {example}"
            raise ManifestError("rig.distance_datum", what, remedy)
        if datum == "rotor axis" and abs(offset + r) > 0.1 * r:
            what = f"is {1e3 * offset:g} mm at the sidewall, measured from the rotor axis"
            remedy = "z_hat counts from the nearest blade tip: make it minus one rotor radius,"
            remedy += f' {{ sidewall = "{-1e3 * r:g} mm", ... }}'
            raise ManifestError("rig.distance_offset", what, remedy)
        return DistanceReference(datum, offset)

    def contact_m(self, boundary: Boundary) -> float:
        """Rotor plane to boundary, m, at first touch; `ManifestError` if it is missing, or if a
        rotor would be in the boundary.
        """
        where, given = f"vehicle.contact.{boundary}", self.vehicle.contact.get(boundary)
        if given is None:
            what = "is missing, and what the vehicle touches first decides what counts as a crash"
            remedy = "measure from the datum to the boundary as it touches, and write [vehicle]"
            raise ManifestError(where, what, f'{remedy} contact = {{ {boundary} = "24 mm" }}')
        offset_m = self.distance_reference(boundary).offset_m
        if given + offset_m < 0:
            what = f"{1e3 * given:g} mm and a distance_offset of {1e3 * offset_m:g} mm put the"
            remedy = "measure it as `distance` is, from the same datum"
            raise ManifestError(where, f"{what} rotors into the {boundary}", remedy)
        return given + offset_m

    @property
    def cuts_records(self) -> bool:
        """Whether one record holds many trials."""
        return self.segments is not None

    @property
    def tare_s(self) -> float:
        """Length of the rotors-stopped head of each record, s (0 where there is none)."""
        return self.load_cell.tare if isinstance(self.load_cell.tare, float) else 0.0


def load(folder: Path) -> Campaign:
    """Read and check ``campaign.toml`` of a folder; `ManifestError` lists every fault."""
    path = folder / "campaign.toml"
    if not path.is_file():
        what = "`nearlift new DIR` writes one to fill in"
        if folder.is_dir() and any(folder.iterdir()):
            what = "`nearlift new DIR --from FILES` writes one for the files that are there"
        raise ManifestError(str(folder), "holds no campaign.toml", what)
    with path.open("rb") as file:
        return parse(loads(file.read(MOST_BYTES + 1), str(path)), str(path))


def loads(content: bytes, where: str) -> dict[str, Any]:
    """The tables of a TOML file; `ManifestError` if it is too large or too deep, or is no UTF-8 or
    no TOML. It may have a byte order mark.
    """
    if len(content) > MOST_BYTES:
        what = f"has more than {MOST_BYTES} bytes"
        raise ManifestError(where, what, "list trials in the schedule, not here")
    try:
        text = content.decode("utf-8-sig")
        if deep := _DEEP.search(text):
            place = f"{where}, line {text.count(chr(10), 0, deep.start()) + 1}"
            raise ManifestError(place, "has a key of more than 8 parts", "no key of a manifest has")
        return tomllib.loads(text)
    except UnicodeDecodeError as fault:
        what = f"is not UTF-8 text ({fault.reason} at byte {fault.start})"
        raise ManifestError(where, what, "save it as UTF-8") from None
    # also of brackets within brackets, and of numbers of thousands of digits
    except (ValueError, RecursionError) as fault:
        what = f"is not valid TOML: {brief(str(fault))}"
        raise ManifestError(where, what, "correct that line") from None


def parse(raw: dict[str, object], where: str = "campaign.toml") -> Campaign:
    """A manifest from parsed TOML; `ManifestError` lists every fault, or every blank value."""
    blank = []
    for key, value in _leaves(raw):
        if isinstance(value, int) and abs(value) >= 1 << 63:
            what = f"{brief(key)}: a whole number of TOML has at most 64 bits"
            raise ManifestError(where, what, "write a smaller number")
        if isinstance(value, str) and BLANK in value:
            blank.append(f"{key}: {value!r} is still to be filled in")
    if blank:
        raise ManifestError(where, _listed(blank))
    return validated(Campaign, raw, where)


def _leaves(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Every text and number of parsed TOML with its key."""
    if not isinstance(value, dict | list):
        yield key, value
        return
    for name, inner in value.items() if isinstance(value, dict) else enumerate(value):
        yield from _leaves(inner, f"{key}.{name}".lstrip("."))


def validated(kind: type[Kind], raw: dict[str, object], where: str) -> Kind:
    """A table of the manifest from plain values; raises `ManifestError` that lists every fault with
    its key.
    """
    try:
        return kind.model_validate(raw)
    except ValidationError as fault:
        errors = fault.errors(include_url=False)
        text = _listed([*dict.fromkeys(_explain(error, kind) for error in errors)])
        if any(error["type"] == "missing" for error in errors):
            text += "\n  `nearlift new DIR` writes a manifest that explains each key"
        raise ManifestError(where, text) from None


def _listed(faults: list[str]) -> str:
    """The first `MOST_FAULTS` faults, each cut to a readable line."""
    lines = [brief(fault) for fault in faults[:MOST_FAULTS]]
    more = [f"and {len(faults) - MOST_FAULTS} more"] if len(faults) > MOST_FAULTS else []
    return "\n  ".join([*lines, *more])


def _explain(error: Any, kind: type[BaseModel]) -> str:
    """One fault: key, value, and the nearest known key."""
    # pydantic adds the branch of a union to the place
    location = [
        part
        for part in error["loc"]
        if not re.fullmatch(r"float|str|.*(?:function|\[).*", str(part))
    ]
    key, value = ".".join(map(str, location)) or "manifest", error["input"]
    if key in RENAMED:
        return f"{key}: was renamed; write {RENAMED[key]}"
    if error["type"] == "extra_forbidden":
        known = _known_keys(kind, location[:-1])
        hint = did_you_mean(str(location[-1]), known) or f"known here: {', '.join(known)}"
        return f"{key}: unknown key; {hint}"
    if error["type"] == "missing":
        return f"{key}: is missing"
    if error["type"] == "literal_error" and key == "schema":
        return (
            f"schema: is {value!r}, and this nearlift reads {error['ctx']['expected']}: correct it,"
            " or take the version that wrote it"
        )
    message = error["msg"].removeprefix("Value error, ").replace("\n", "; ")
    known_value = isinstance(value, dict | list) or str(value) in message
    return f"{key}: {message}" + ("" if known_value else f" (found {value!r})")


def _known_keys(kind: type[BaseModel], tables: list[Any]) -> list[str]:
    """Keys allowed in the table at this place."""
    fields = {f.alias or name: f for name, f in kind.model_fields.items()}
    for part in tables:
        if part in fields and (section := _section_in(fields[part].annotation)):
            fields = {f.alias or name: f for name, f in section.model_fields.items()}
    return list(fields)


def _section_in(annotation: Any) -> Any:
    """The Section class inside an annotation such as `list[Uncertainty] | None`."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return annotation
    inner = map(_section_in, getattr(annotation, "__args__", ()))
    return next((section for section in inner if section is not None), None)


def boundaries_of(values: Collection[str]) -> list[Boundary]:
    """The boundaries present, in the order ground, ceiling, sidewall."""
    return [b for b in BOUNDARIES if b in values]
