"""The manifest `campaign.toml` in SI: facts about the rig, and choices.

An unknown key, a quantity without a unit and a unit of the wrong dimension are refused with key,
value and the nearest known one. No unit and no geometry has a default.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from nearlift.campaign import parsing
from nearlift.campaign.choices import Diagnose, FitOptions, Levels, Quality, Report
from nearlift.campaign.forecasts import Detect, Planned, Simulate
from nearlift.campaign.parsing import first_of, validated
from nearlift.campaign.piv import Piv
from nearlift.campaign.quantities import Section
from nearlift.campaign.rig import DistanceReference, LoadCell, Records, Rig, Trials, Vehicle
from nearlift.campaign.segments import Segments, fit_the_rest
from nearlift.campaign.uncertainty import INPUTS_WITH_UNIT, Uncertainty
from nearlift.declare import BOUNDARIES, Boundary
from nearlift.errors import ManifestError, brief


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
    report: Report = Report()
    quality: Quality = Quality()
    diagnose: Diagnose = Diagnose()
    piv: Piv | None = None
    design: Planned | None = None
    simulate: Simulate | None = None
    detect: Detect | None = None

    def nominal(self, on: str) -> float | None:
        """Value, SI, of a model's input that an `[[uncertainty]]` can be on, if it is given."""
        place = self.rig if on == "air_density" else self.vehicle
        value: float | None = getattr(place, on)
        return value

    def geometry(self) -> dict[str, Any]:
        """Inputs of lift models that all trials share, over rotor radius."""
        around = {"gap_hat": self.rig.gap, "edge_hat": self.rig.edge}
        r = self.vehicle.rotor_radius
        return self.vehicle.geometry() | {n: v / r for n, v in around.items() if v is not None}

    def distance_reference(self, boundary: Boundary) -> DistanceReference:
        """Datum and offset of the distances to a boundary.

        `ManifestError` if a table has no entry for the boundary. `ManifestError` also if the rotor
        axis is the datum of a ground or ceiling, or if the sidewall's offset from it is not minus
        one radius.
        """
        given: dict[str, Any] = {}
        for key in ("distance_datum", "distance_offset"):
            value = getattr(self.rig, key)
            if isinstance(value, dict) and boundary not in value:
                what = f"has no entry for the {boundary}"
                raise ManifestError(f"rig.{key}", what, f"add {boundary} = ... to the table")
            given[key] = value[boundary] if isinstance(value, dict) else value
        datum, offset, r = *given.values(), self.vehicle.rotor_radius
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
            raise ManifestError(
                where,
                "is missing, and what the vehicle touches first decides what counts as a crash",
                "measure from the datum to the boundary as it touches, and write [vehicle]"
                f' contact = {{ {boundary} = "24 mm" }}',
            )
        offset_m = self.distance_reference(boundary).offset_m
        if given + offset_m < 0:
            raise ManifestError(
                where,
                f"{1e3 * given:g} mm and a distance_offset of {1e3 * offset_m:g} mm put the rotors"
                f" into the {boundary}",
                "measure it as `distance` is, from the same datum",
            )
        return given + offset_m

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
            if u.on in INPUTS_WITH_UNIT and not u.relative and self.nominal(u.on) is None:
                raise ValueError(
                    f"uncertainty {u.name!r} is on the {u.on}, which is not given: give it, or"
                    " state the uncertainty in percent"
                )
        if self.records.reader == "means":
            if self.segments is not None:
                raise ValueError('[segments] cuts records, and reader = "means" has none')
            return self
        cell = self.load_cell
        if self.records.files is None or self.records.force is None:
            raise ValueError(
                '[records] needs `files` and `force` (only reader = "means" does without)'
            )
        if cell.sample_rate is None:
            raise ValueError('[load_cell] needs sample_rate, such as "1000 Hz"')
        if cell.tare is None:
            raise ValueError(
                '[load_cell] needs tare: "2 s" for a rotors-stopped head, "0 s" if the records are'
                ' already tared, "none" if unknown (an offset then enters the budget)'
            )
        fit_the_rest(self.segments, self.records, cell, cell.sample_rate)
        return self

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
        return parse(parsing.loads(file.read(parsing.MOST_BYTES + 1), str(path)), str(path))


#: Placeholder of `nearlift new` for values to fill in.
BLANK = "FILL IN"


def parse(raw: dict[str, object], where: str = "campaign.toml") -> Campaign:
    """A manifest from parsed TOML; `ManifestError` lists every fault, or every blank value."""
    values = list(leaves(raw))
    blank = [
        f"{key}: {value!r} is still to be filled in"
        for key, value in values
        if isinstance(value, str) and BLANK in value
    ]
    if blank:
        raise ManifestError(where, "\n  ".join(first_of(blank, len(blank))))
    huge = [key for key, value in values if isinstance(value, int) and abs(value) >= 1 << 63]
    if huge:
        raise ManifestError(
            where,
            f"{brief(huge[0])}: a whole number of TOML has at most 64 bits",
            "write a number that can be meant",
        )
    return validated(Campaign, raw, where)


def leaves(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Every text and number of parsed TOML with its key."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from leaves(inner, f"{key}.{name}".lstrip("."))
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            yield from leaves(inner, f"{key}.{i}")
    else:
        yield key, value


def boundaries_of(values: Collection[str]) -> list[Boundary]:
    """The boundaries present, in the order ground, ceiling, sidewall."""
    return [b for b in BOUNDARIES if b in values]
