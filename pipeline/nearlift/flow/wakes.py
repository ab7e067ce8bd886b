"""Velocity grids to mean fields, downwash beneath the rotors, and the wake's topology."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from nearlift.campaign.manifest import Campaign
from nearlift.campaign.piv import Piv, PivCase
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.flow import downwash
from nearlift.flow.average import Average, average
from nearlift.flow.downwash import Cut, CutDownwash, along_cut
from nearlift.flow.field import Scene, VelocityField, mirrored, spurious
from nearlift.flow.topology import Vortex, jets, stagnation, vortices
from nearlift.results import Estimate

Row = dict[str, object]
Table = dict[str, NDArray[Any]]
#: Air where the manifest gives no density, kg/m^3; it serves a check of the order of magnitude
#: only.
USUAL_DENSITY = 1.2
#: Files between two reports of progress.
REPORTED = 25
#: Share of a case's files that may be refused.
MAX_REFUSED = 0.5


@dataclass(slots=True, kw_only=True)
class Wakes:
    """Wakes of all cases, as rows of the products, and facts of how they were averaged."""

    downwash: list[Row] = field(default_factory=list)
    topology: list[Row] = field(default_factory=list)
    profiles: list[Table] = field(default_factory=list)
    fields: list[Table] = field(default_factory=list)
    facts: Row
    notes: list[str] = field(default_factory=list)


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """Averaged fields of one case.

    `place` are the columns that say where it was taken. `series` (n, nx) is the downwash along the
    cut of each field, `outliers` the share of vectors left out as spurious. `measured` (nx,) are
    the columns that were measured, not mirrored.
    """

    place: Row
    scene: Scene
    cut: Cut
    mean: Average
    series: FloatArray
    outliers: float
    measured: NDArray[np.bool_]
    stream: Fields

    def through(self, stagnant: NDArray[np.bool_] | None = None) -> dict[str, CutDownwash]:
        """Cuts beneath each measured rotor, by its place, and beneath all of them."""
        series = np.where(self.measured, self.series, np.nan)
        each = {str(self.scene.rotors_m.index(c)): (c,) for c in self.cut.centres_m}
        return {
            rotor: downwash.measure(
                self.mean, series, replace(self.cut, centres_m=centres), self.scene, stagnant
            )
            for rotor, centres in (each | {"all": self.cut.centres_m}).items()
        }


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
    recordings = {}
    for i, case in enumerate(sorted(piv.case, key=lambda c: c.name != piv.control)):

        def say_part(text: str, share: float, i: int = i) -> None:
            say(text, (i + share) / len(piv.case))

        recordings[case.name] = _recorded(campaign, piv, case, fields_of(case), say_part)
    control = recordings[piv.control].through()
    reference, facts = control["all"].value, dict[str, Row]()
    done = Wakes(facts={"control": piv.control, "reference_m_s": reference, "cases": facts})
    warned = dict[str, list[str]]()
    for name, recording in ((case.name, recordings[case.name]) for case in piv.case):
        mean, scene = recording.mean.mean, recording.scene
        cores, stagnant = tuple[Vortex, ...](), np.zeros(mean.shape, dtype=bool)
        if scene.boundary == "ground":
            cores, zone = vortices(mean, scene, reference), stagnation(mean, scene, reference)
            stagnant, turns = zone.nodes, [v.circulation_m2_s > 0 for v in cores]
            row: Row = {
                "vortices_ccw": sum(turns),
                "vortices_cw": len(turns) - sum(turns),
                "stagnation_area_hat2": zone.area_m2 / scene.radius_m**2,
                "stagnation_height_hat": zone.height_m / scene.radius_m,
                # a mirrored half leans to neither side by construction
                "jets": jets(mean, scene) if recording.measured.all() else "",
            }
            done.topology.append(recording.place | row)
        cuts = recording.through(stagnant)
        for rotor, d in cuts.items():
            less = Estimate(value=0.0, u=0.0, lo90=0.0, hi90=0.0)
            if name != piv.control:
                less = downwash.reduction(d, control.get(rotor, control["all"]))
            done.downwash.append(_downwash_row(recording, rotor, d, less))
        done.profiles.append(_profile(recording))
        done.fields.append(_nodes(recording, stagnant))
        facts[name] = _facts(recording, cores)
        left_out = recording.stream.refused
        done.notes += [f"{name}: {file} left out: {why.what}" for file, why in left_out]
        for code in cuts["all"].warnings:
            warned.setdefault(code, []).append(name)
    done.notes += [
        f"{meaning} ({len(warned[code])} of {len(piv.case)} cases: {', '.join(warned[code])})"
        for code, meaning in downwash.WARNINGS.items()
        if code in warned
    ]
    return done


def _recorded(
    campaign: Campaign, piv: Piv, case: PivCase, stream: Fields, say: Callable[[str, float], None]
) -> Recording:
    """One pass over the files of a case: spurious vectors go, a measured half is mirrored."""
    vehicle, where = campaign.vehicle, f"piv case {case.name!r}"
    radius, z_hat = vehicle.rotor_radius, math.inf if case.z_hat is None else case.z_hat
    half, rotors = piv.setting(case, "mirror"), tuple(piv.setting(case, "rotors"))
    below, files = piv.below or 2 * radius, len(stream.files)
    series: list[FloatArray] = []
    wrong_of = np.zeros(2)

    def fields() -> Iterator[VelocityField]:
        for one in stream:
            if len(series) % REPORTED == 0:
                say(f"flow {case.name}: {len(series)} of {files} files", len(series) / files)
            wrong = spurious(one.vx_m_s, one.vy_m_s, piv.outliers)
            wrong_of[:] += wrong.sum(), one.valid.sum()
            whole = one.without(wrong)
            whole = whole if half is None else mirrored(whole, half)
            series.append(along_cut(whole.vy_m_s, whole.y_m, below))
            yield whole

    try:
        mean = average(fields(), where)
    except InputRefused as refusal:
        raise (stream.refused[0][1] if stream.refused and not series else refusal) from None
    if len(stream.refused) > MAX_REFUSED * files:
        what = f"{len(stream.refused)} of {files} files are refused"
        raise InputRefused(where, what, str(stream.refused[0][1]))
    scene = Scene(
        boundary=case.boundary,
        distance_m=z_hat * radius,
        tilt_rad=case.tilt,
        rotors_m=rotors,
        radius_m=radius,
    )
    cut = Cut(
        below_m=below,
        half_span_m=piv.half_span or radius,
        centres_m=tuple(c for c in rotors if half is None or (c > 0) == (half == "right"))
        or rotors,
        u_position_m=piv.u_position or mean.mean.dx_m / math.sqrt(12),
        u_scale=piv.u_scale,
    )
    density = campaign.rig.air_density or USUAL_DENSITY
    expected = downwash.wake_speed_m_s(
        vehicle.mass, campaign.rig.gravity, density, vehicle.rotors, radius
    )
    downwash.check_plausible(mean.mean, scene, cut, expected, where)
    x, place = mean.mean.x_m, {"case": case.name, "boundary": case.boundary}
    return Recording(
        place=place | {"z_hat": z_hat, "tilt_rad": case.tilt},
        scene=scene,
        cut=cut,
        mean=mean,
        series=np.stack(series),
        outliers=float(wrong_of[0] / max(wrong_of[1], 1)),
        measured=np.full(len(x), True) if half is None else (x >= -1e-9) == (half == "right"),
        stream=stream,
    )


# ---- rows of the products


def _downwash_row(recording: Recording, rotor: str, d: CutDownwash, less: Estimate) -> Row:
    """Row of downwash.parquet."""
    return recording.place | {
        **{f"u_{k}_m_s": getattr(d, f"u_{k}") for k in ("noise", "mask", "position", "scale")},
        "rotor": rotor,
        "below_m": recording.cut.below_m,
        "half_span_m": recording.cut.half_span_m,
        "downwash_m_s": d.value,
        "u_downwash_m_s": d.u,
        "u_span_m_s": abs(d.span),
        "covered": d.covered,
        "n_fields": recording.mean.n,
        "n_eff": d.n_eff,
        "clearance_hat": d.clearance_hat,
        "reduction": less.value,
        "u_reduction": less.u,
        "reduction_lo90": less.lo90,
        "reduction_hi90": less.hi90,
        "warnings": " ".join(d.warnings),
    }


def _profile(recording: Recording) -> Table:
    """Columns of downwash_profile.parquet."""
    mean, below = recording.mean.mean, recording.cut.below_m
    return {
        "case": np.full(len(mean.x_m), recording.place["case"], dtype=object),
        "x_m": mean.x_m,
        "downwash_m_s": along_cut(mean.vy_m_s, mean.y_m, below),
        "u_downwash_m_s": np.abs(along_cut(recording.mean.u_m_s[1], mean.y_m, below)),
        "mirrored": (~recording.measured).astype(np.int64),
    }


def _nodes(recording: Recording, stagnant: NDArray[np.bool_]) -> Table:
    """Columns of flow_fields.parquet."""
    moments, mean = recording.mean, recording.mean.mean
    xx, yy = np.meshgrid(mean.x_m, mean.y_m)
    (u_vx, u_vy), (sd_vx, sd_vy) = moments.u_m_s, np.sqrt(moments.variance)
    grids = {
        "x_m": xx,
        "y_m": yy,
        "z_m": recording.scene.height_m(xx, yy),
        "vx_m_s": mean.vx_m_s,
        "vy_m_s": mean.vy_m_s,
        "u_vx_m_s": u_vx,
        "u_vy_m_s": u_vy,
        "sd_vx_m_s": sd_vx,
        "sd_vy_m_s": sd_vy,
        "count": moments.count.astype(np.int64),
        "stagnant": stagnant.astype(np.int64),
        "mirrored": np.broadcast_to(~recording.measured, mean.shape).astype(np.int64),
    }
    case = np.full(xx.size, recording.place["case"], dtype=object)
    return {"case": case, **{name: grid.ravel() for name, grid in grids.items()}}


def _facts(recording: Recording, cores: tuple[Vortex, ...]) -> Row:
    """Block of a case in flow.json."""
    moments = recording.mean
    return recording.place | {
        "files": len(recording.stream.files),
        "fields": moments.n,
        "left_out": [{"file": file, "reason": why.what} for file, why in recording.stream.refused],
        "outliers": recording.outliers,
        "vectors": float(np.mean(moments.count / moments.n)),
        "mirrored": not bool(recording.measured.all()),
        "tau_fields": moments.tau,
        "rotors_m": recording.scene.rotors_m,
        "vortices": [asdict(v) for v in cores],
    }
