"""Whether a schedule's distances, throttles and humidities can be true in the rig that the manifest
describes.

A distance outside the arena or a blade in the wall is refused, with the unit that would make sense
if one does.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from nearlift import units
from nearlift.campaign.manifest import Campaign
from nearlift.declare import BOUNDARIES, Boundary, FloatArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import columns
from nearlift.readers.columns import BY_NAME, ColumnTexts

#: Distance over radius that is none.
NEAREST = 1e-4
#: What a share is of, and what one below 1 % would be.
SHARES = {
    "throttle": ("full throttle", "at which no rotor lifts anything"),
    "humidity": ("saturation", "drier than any room"),
}


def distances(
    campaign: Campaign,
    cells: ColumnTexts | None,
    boundary: NDArray[np.object_],
    unit: str | None,
    blank: bool = False,
) -> FloatArray:
    """Rotor plane (sidewall: blade tip) to boundary in m, inf in free air, NaN where a cell is
    blank and may be; refuses what cannot be.
    """
    free = boundary == "none"
    if cells is None:
        return np.full(len(boundary), np.inf)
    recorded = columns.numbers(cells, blank=True)
    for i in np.flatnonzero(np.isfinite(recorded) == free):
        if free[i]:
            raise ManifestError(
                cells.at(int(i)), "free air (boundary none) has no distance", "leave the cell empty"
            )
        if blank:
            continue
        remedy = "every trial at a boundary needs its distance; free air is boundary none"
        raise ManifestError(cells.at(int(i)), columns.without(cells.texts[int(i)]), remedy)
    z_m = np.where(free, np.inf, columns.quantity(cells, BY_NAME["distance"], unit))
    for side in BOUNDARIES:
        here = np.flatnonzero((boundary == side) & np.isfinite(recorded))
        if len(here):
            offset = _offset(campaign, side)
            z_m[here] += offset
            _inside_the_arena(campaign, cells, recorded, z_m, here, side, offset, unit or "")
    return z_m


def _offset(campaign: Campaign, side: Boundary) -> float:
    """The datum's offset, m, checked against its name."""
    rig, r = campaign.rig, campaign.vehicle.rotor_radius
    offset = rig.offset(side)
    if rig.datum(side) != "rotor axis":
        return offset
    if side != "sidewall":
        raise ManifestError(
            "rig.distance_datum",
            f"the rotor axis is no datum for the {side}: it stands at right angles to it",
            'give each boundary its own, such as { ground = "rotor plane", sidewall = "rotor'
            ' axis" }',
        )
    if abs(offset + r) > 0.1 * r:
        raise ManifestError(
            "rig.distance_offset",
            f"is {1e3 * offset:g} mm at the sidewall, measured from the rotor axis",
            "z_hat counts from the nearest blade tip: make it minus one rotor radius, { sidewall"
            f' = "{-1e3 * r:g} mm", ... }}',
        )
    return offset


def _inside_the_arena(
    campaign: Campaign,
    cells: ColumnTexts,
    recorded: FloatArray,
    z_m: FloatArray,
    here: NDArray[np.intp],
    side: Boundary,
    offset: float,
    unit: str,
) -> None:
    """Refuse distances beyond the arena or behind the boundary.

    A unit is proposed only if it makes *every* distance to this boundary possible: within the
    arena, and no closer than a fiftieth of a radius (0.5 mm on a Crazyflie), which no traverse
    approaches on purpose.
    """
    arena, r = campaign.rig.arena, campaign.vehicle.rotor_radius
    farthest, nearest = (int(here[place(z_m[here])]) for place in (np.argmax, np.argmin))
    far, near = (f"{cells.texts[i].strip()} {unit}" for i in (farthest, nearest))
    if arena is not None and z_m[farthest] > arena:
        ends = recorded[here].min(), recorded[here].max()
        raise InputRefused(
            cells.at(farthest),
            f"{far} is outside the {arena:g} m arena"
            + _other_units(ends, r / 50 - offset, arena - offset, unit),
            "mend distance under [trials.units], the schedule, or [rig] arena",
        )
    if z_m[nearest] <= NEAREST * r:
        into = f"{-1e3 * z_m[nearest]:.3g} mm into the {side}"
        stands = into if z_m[nearest] < 0 else f"on the {side} itself"
        raise InputRefused(
            cells.at(nearest),
            f"{near} with an offset of {1e3 * offset:g} mm puts the rotor {stands}",
            "mend [rig] distance_datum and distance_offset, or the schedule",
        )
    if z_m[farthest] < r / 50:
        raise InputRefused(
            cells.at(farthest),
            f"{far} is the farthest from the {side}, {z_m[farthest] / r:.2g} of a rotor's radius"
            + _other_units(recorded[[farthest]], r, arena or 100 * r, unit),
            "mend distance under [trials.units], or the schedule",
        )


def _other_units(values: Iterable[float], low: float, high: float, unit: str) -> str:
    """The units that bring all distances between two others, m, as a question, if there are any."""
    first, *others = (units.plausible(float(value), "length", low, high) for value in values)
    fitting = [u for u in first if u != unit and all(u in other for other in others)]
    return f"; {' or '.join(fitting)}?" if fitting else ""


def share_is_plausible(name: str, values: FloatArray, cells: ColumnTexts, unit: str) -> None:
    """Refuse one of `SHARES` outside 0 to 1, or 1 % at most throughout, with the unit that would
    make sense; anything else is let through.
    """
    if name not in SHARES:
        return
    whole, too_little = SHARES[name]
    for i in np.flatnonzero((values < 0) | (values > 1 + 1e-9)).tolist():
        dimension = BY_NAME[name].dimension
        other = [
            u for u in units.plausible(float(cells.texts[i]), dimension, 0.0, 1.0) if u != unit
        ]
        raise InputRefused(
            cells.at(i),
            f"a {name} of {cells.texts[i].strip()} {unit} is not between 0 and 1",
            f"{other[0]}?" if other else f"{name} is a part of {whole}",
        )
    largest = int(np.argmax(np.nan_to_num(values)))
    if unit != "fraction" and 0 < values[largest] <= 0.01 + 1e-9:
        raise InputRefused(
            cells.at(largest),
            f"the largest {name} is {cells.texts[largest].strip()} {unit}, {too_little}",
            f"fraction? then mend {name} under [trials.units]",
        )
