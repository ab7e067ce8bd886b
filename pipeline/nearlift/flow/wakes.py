"""Velocity grids to mean fields, downwash beneath the rotors, and the wake's topology."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from nearlift.campaign.manifest import Campaign
from nearlift.campaign.piv import Piv, PivCase
from nearlift.errors import InputRefused, ManifestError
from nearlift.flow import downwash
from nearlift.flow.case import FlowCase, recorded
from nearlift.flow.downwash import Cut, check_plausible, wake_speed_m_s
from nearlift.flow.field import Scene, VelocityField

Table = dict[str, NDArray[Any]]
#: Air where the manifest gives no density, kg/m^3; it serves a check of the order of magnitude
#: only.
USUAL_DENSITY = 1.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Wakes:
    """Wakes of all cases, as rows of the products, and facts of how they were averaged."""

    downwash: list[dict[str, object]]
    topology: list[dict[str, object]]
    profiles: list[Table]
    fields: list[Table]
    facts: dict[str, object]
    notes: tuple[str, ...]


class Fields(Protocol):
    """Velocity fields of a case, read one after the other; `refused` files with the reason."""

    @property
    def files(self) -> list[Path]:
        """Files of the case."""

    @property
    def refused(self) -> list[tuple[str, InputRefused]]:
        """Files that could not be read, so far."""

    def __iter__(self) -> Iterator[VelocityField]:
        """The fields."""


def wakes(
    campaign: Campaign,
    fields_of: Callable[[PivCase], Fields],
    say: Callable[[str, float], None],
) -> Wakes:
    """Average every case, cut its wake, compare with the control, find the wake's topology."""
    piv = campaign.piv
    if piv is None:
        raise ManifestError(
            "piv", "is missing", "list velocity grids under [piv], or leave this stage out"
        )
    first = sorted(piv.case, key=lambda c: c.name != piv.control)
    cases = {
        c.name: _measured(campaign, piv, c, fields_of(c), partial(_say_part, say, i, len(first)))
        for i, c in enumerate(first)
    }
    control = cases[piv.control]
    reference = control.cuts["all"].value
    ordered = [cases[c.name].described(reference) for c in piv.case]
    downwashes = [row for case in ordered for row in case.downwash_rows(control)]
    topologies = [row for case in ordered for row in case.topology_rows()]
    notes = [f"{c.name}: {file} left out: {why}" for c in ordered for file, why in c.refused]
    for code, meaning in downwash.WARNINGS.items():
        named = [c.name for c in ordered if code in c.cuts["all"].warnings]
        if named:
            notes.append(f"{meaning} ({len(named)} of {len(ordered)} cases: {', '.join(named)})")
    return Wakes(
        downwash=downwashes,
        topology=topologies,
        profiles=[case.profile() for case in ordered],
        fields=[case.nodes() for case in ordered],
        facts={
            "control": piv.control,
            "reference_m_s": reference,
            "cases": {c.name: c.facts() for c in ordered},
        },
        notes=tuple(notes),
    )


def _say_part(
    say: Callable[[str, float], None], i: int, count: int, text: str, share: float
) -> None:
    say(text, (i + share) / count)


def _measured(
    campaign: Campaign,
    piv: Piv,
    spec: PivCase,
    stream: Fields,
    say: Callable[[str, float], None],
) -> FlowCase:
    """One pass over the files of a case."""
    vehicle, where = campaign.vehicle, f"piv case {spec.name!r}"
    radius, z_hat = vehicle.rotor_radius, math.inf if spec.z_hat is None else spec.z_hat
    files = stream.files
    half = piv.setting(spec, "mirror")
    rotors = tuple(piv.setting(spec, "rotors"))
    scene = Scene(
        boundary=spec.boundary,
        distance_m=z_hat * radius,
        tilt_rad=spec.tilt,
        rotors_m=rotors,
        radius_m=radius,
    )
    below = piv.below or 2 * radius
    read = 0

    def fields() -> Iterator[VelocityField]:
        nonlocal read
        for one in stream:
            if read % 25 == 0:
                say(f"flow {spec.name}: {read} of {len(files)} files", read / len(files))
            read += 1
            yield one

    try:
        recording = recorded(fields(), where, threshold=piv.outliers, half=half, below_m=below)
    except InputRefused as refusal:
        raise (stream.refused[0][1] if stream.refused and not read else refusal) from None
    if len(stream.refused) > 0.5 * len(files):
        raise InputRefused(
            where,
            f"{len(stream.refused)} of {len(files)} files are refused",
            str(stream.refused[0][1]),
        )
    mean = recording.mean.mean
    measured = tuple(c for c in rotors if half is None or (c > 0) == (half == "right")) or rotors
    cut = Cut(
        below_m=below,
        half_span_m=piv.half_span or radius,
        centres_m=measured,
        u_position_m=piv.u_position or mean.dx_m / math.sqrt(12),
        u_scale=piv.u_scale,
    )
    rig = campaign.rig
    density = rig.air_density or USUAL_DENSITY
    expected = wake_speed_m_s(vehicle.mass, rig.gravity, density, vehicle.rotors, radius)
    check_plausible(mean, scene, cut, expected, where)
    x = mean.x_m
    return FlowCase(
        name=spec.name,
        z_hat=z_hat,
        scene=scene,
        recording=recording,
        cut=cut,
        measured=np.ones(len(x), dtype=bool) if half is None else (x >= -1e-9) == (half == "right"),
        files=len(files),
        refused=[(file, refusal.what) for file, refusal in stream.refused],
    ).cut_through()
