"""flow: velocity grids to mean fields, downwash beneath the rotors, and the wake's topology, where
[piv] lists any.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.flow import downwash, topology
from nearlift.flow.average import Average, average
from nearlift.flow.bootstrap import Resamples, block_length
from nearlift.flow.doubts import refuse_what_cannot_be, wake_speed_m_s
from nearlift.flow.downwash import Cut, Downwash
from nearlift.flow.field import Field, mirrored, take_columns
from nearlift.flow.outliers import spurious
from nearlift.flow.scene import Scene
from nearlift.manifest.piv import Piv, PivCase
from nearlift.products import DOWNWASH, DOWNWASH_PROFILE, FLOW, FLOW_FIELDS, FLOW_TOPOLOGY, Product
from nearlift.randomness import generator
from nearlift.readers.piv.cases import Stream, files_of
from nearlift.run.job import Job, Outcome

#: Air where the manifest gives no density, kg/m^3; it serves a check of the order of magnitude
#: only.
USUAL_DENSITY = 1.2


@dataclass
class Case:
    """One case as it is being worked out."""

    spec: PivCase
    scene: Scene
    found: Average
    cut: Cut
    series: FloatArray
    outliers: float
    resamples: FloatArray
    refused: list[tuple[str, str]]
    files: int
    measured: NDArray[np.bool_]
    topology: topology.Topology | None = None
    cuts: dict[str, Downwash] = field(default_factory=dict)


def run(job: Job) -> Outcome:
    """Average every case, cut its wake, compare with the control, describe what the ground makes of
    it.

    Raises
    ------
    ManifestError
        There is no [piv].
    InputRefused
        The files of a case cannot be read, or say what cannot be.
    """
    piv = job.campaign.piv
    if piv is None:
        raise ManifestError(
            "piv", "is missing", "list velocity grids under [piv], or leave this stage out"
        )
    cases = {
        c.name: _work_out(job, piv, c)
        for c in sorted(piv.case, key=lambda c: c.name != piv.control)
    }
    control = cases[piv.control]
    control.cuts = _cuts(control, None)
    reference = control.cuts["all"].value
    for case in cases.values():
        if case.spec.boundary == "ground":
            case.topology = topology.describe(case.found.mean, case.scene, reference)
        case.cuts = _cuts(case, None if case.topology is None else case.topology.stagnant)
    ordered = [cases[c.name] for c in piv.case]
    job.write(
        DOWNWASH,
        _table(DOWNWASH, [row for case in ordered for row in _downwash_rows(case, control)]),
    )
    job.write(DOWNWASH_PROFILE, _stacked(DOWNWASH_PROFILE, [_profile(case) for case in ordered]))
    job.write(FLOW_FIELDS, _stacked(FLOW_FIELDS, [_nodes(case) for case in ordered]))
    job.write(
        FLOW_TOPOLOGY,
        _table(FLOW_TOPOLOGY, [row for case in ordered for row in _topology_rows(case, reference)]),
    )
    job.write_json(
        FLOW,
        {
            "schema": FLOW.schema,
            "control": piv.control,
            "reference_m_s": reference,
            "cases": {c.spec.name: _facts(c) for c in ordered},
        },
    )
    notes = [f"{c.spec.name}: {file} left out: {why}" for c in ordered for file, why in c.refused]
    notes += [
        f"{c.spec.name}: {downwash.WARNINGS[w]}" for c in ordered for w in c.cuts["all"].warnings
    ]
    return Outcome(notes=tuple(notes))


def _work_out(job: Job, piv: Piv, spec: PivCase) -> Case:
    """One pass over the files of a case."""
    vehicle = job.campaign.vehicle
    radius = vehicle.rotor_radius
    files = files_of(job.root, spec)
    stream = Stream(root=job.root, piv=piv, case=spec, files=files)
    half = piv.of(spec, "mirror")
    rotors = tuple(piv.of(spec, "rotors"))
    scene = Scene(
        boundary=spec.boundary,
        distance_m=math.inf if spec.z_hat is None else spec.z_hat * radius,
        tilt_rad=spec.tilt,
        rotors_m=rotors,
        radius_m=radius,
    )
    below = piv.below or 2 * radius
    profiles: list[FloatArray] = []
    spoilt = [0, 0]
    grounded = spec.boundary == "ground"
    rng = generator(job.seed, "flow", "bootstrap", spec.name)
    drawn: Resamples | None = None

    def passed() -> Iterator[Field]:
        nonlocal drawn
        for i, one in enumerate(stream):
            if i % 25 == 0:
                job.say(f"flow {spec.name}: {i} of {len(files)} files")
            wrong = spurious(one.vx_m_s, one.vy_m_s, piv.outliers)
            spoilt[0] += int(wrong.sum())
            spoilt[1] += int(one.valid.sum())
            kept = replace(
                one,
                vx_m_s=np.where(wrong, np.nan, one.vx_m_s),
                vy_m_s=np.where(wrong, np.nan, one.vy_m_s),
            )
            whole = kept if half is None else _reflect(kept, half)
            profiles.append(downwash.along_cut(whole.vy_m_s, whole.y_m, below))
            if grounded:
                if drawn is None:
                    drawn = Resamples(
                        piv.bootstrap, 2 * whole.vx_m_s.size, block_length(len(files)), rng
                    )
                drawn.add(np.concatenate([whole.vx_m_s.ravel(), whole.vy_m_s.ravel()]))
            yield whole

    try:
        found = average(passed(), f"piv case {spec.name!r}")
    except InputRefused as refusal:
        raise (stream.refused[0][1] if stream.refused and not profiles else refusal) from None
    if len(stream.refused) > 0.5 * len(files):
        raise InputRefused(
            f"piv case {spec.name!r}",
            f"{len(stream.refused)} of {len(files)} files are refused",
            str(stream.refused[0][1]),
        )
    step = found.mean.dx_m / math.sqrt(12)
    measured = tuple(c for c in rotors if half is None or (c > 0) == (half == "right")) or rotors
    cut = Cut(
        below_m=below,
        half_span_m=piv.half_span or radius,
        centres_m=measured,
        u_position_m=piv.u_position or step,
        u_scale=piv.u_scale,
    )
    expected = wake_speed_m_s(
        vehicle.mass,
        job.campaign.rig.gravity,
        job.campaign.rig.air_density or USUAL_DENSITY,
        vehicle.rotors,
        radius,
    )
    refuse_what_cannot_be(found.mean, scene, cut, expected, f"piv case {spec.name!r}")
    x = found.mean.x_m
    return Case(
        spec=spec,
        scene=scene,
        found=found,
        cut=cut,
        series=np.stack(profiles),
        outliers=spoilt[0] / max(spoilt[1], 1),
        resamples=drawn.means() if drawn is not None else np.zeros((0, 0)),
        refused=[(file, refusal.what) for file, refusal in stream.refused],
        files=len(files),
        measured=np.ones(len(x), dtype=bool) if half is None else (x >= -1e-9) == (half == "right"),
    )


def _reflect(one: Field, half: Any) -> Field:
    """The whole of which one half was measured."""
    x, position, sign = mirrored(one.x_m, half)
    noise = None if one.u_m_s is None else take_columns(one.u_m_s, position)
    return Field(
        x_m=x,
        y_m=one.y_m,
        vx_m_s=sign * take_columns(one.vx_m_s, position),
        vy_m_s=take_columns(one.vy_m_s, position),
        u_m_s=noise,
    )


def _cuts(case: Case, stagnant: NDArray[np.bool_] | None) -> dict[str, Downwash]:
    """The cut beneath each measured rotor, and beneath all of them."""
    series = (
        np.where(case.measured, case.series, np.nan) if not case.measured.all() else case.series
    )
    order = {str(list(case.scene.rotors_m).index(c)): (c,) for c in case.cut.centres_m}
    return {
        name: downwash.measure(
            case.found, series, replace(case.cut, centres_m=centres), case.scene, stagnant
        )
        for name, centres in (order | {"all": case.cut.centres_m}).items()
    }


def _downwash_rows(case: Case, control: Case) -> Iterator[dict[str, Any]]:
    for rotor, d in case.cuts.items():
        against = control.cuts.get(rotor, control.cuts["all"])
        less = (
            downwash.reduction(d, against)
            if case is not control
            else downwash.Reduction(value=0.0, u=0.0, lo90=0.0, hi90=0.0)
        )
        yield _place(case) | {
            "rotor": rotor,
            "below_m": case.cut.below_m,
            "half_span_m": case.cut.half_span_m,
            "downwash_m_s": d.value,
            "u_downwash_m_s": d.u,
            "u_noise_m_s": d.u_noise,
            "u_mask_m_s": d.u_mask,
            "u_position_m_s": d.u_position,
            "u_span_m_s": abs(d.span),
            "u_scale_m_s": d.u_scale,
            "covered": d.covered,
            "n_fields": case.found.n,
            "n_eff": d.n_eff,
            "clearance_hat": d.clearance_hat,
            "reduction": less.value,
            "u_reduction": less.u,
            "reduction_lo90": less.lo90,
            "reduction_hi90": less.hi90,
            "warnings": " ".join(d.warnings),
        }


def _place(case: Case) -> dict[str, Any]:
    z_hat = math.inf if case.spec.z_hat is None else case.spec.z_hat
    return {
        "case": case.spec.name,
        "boundary": case.spec.boundary,
        "z_hat": z_hat,
        "tilt_rad": case.spec.tilt,
    }


def _profile(case: Case) -> dict[str, Any]:
    mean = case.found.mean
    error = downwash.along_cut(case.found.u_y, mean.y_m, case.cut.below_m)
    return {
        "case": np.full(len(mean.x_m), case.spec.name, dtype=object),
        "x_m": mean.x_m,
        "downwash_m_s": downwash.along_cut(mean.vy_m_s, mean.y_m, case.cut.below_m),
        "u_downwash_m_s": np.abs(error),
        "mirrored": (~case.measured).astype(np.int64),
    }


def _nodes(case: Case) -> dict[str, Any]:
    found, mean = case.found, case.found.mean
    xx, yy = np.meshgrid(mean.x_m, mean.y_m)
    stagnant = np.zeros(mean.shape, dtype=bool) if case.topology is None else case.topology.stagnant
    grids = {
        "x_m": xx,
        "y_m": yy,
        "z_m": case.scene.height_m(xx, yy),
        "vx_m_s": mean.vx_m_s,
        "vy_m_s": mean.vy_m_s,
        "u_vx_m_s": found.u_x,
        "u_vy_m_s": found.u_y,
        "sd_vx_m_s": np.sqrt(found.var_x),
        "sd_vy_m_s": np.sqrt(found.var_y),
        "count": found.count.astype(np.int64),
        "stagnant": stagnant.astype(np.int64),
        "mirrored": np.broadcast_to(~case.measured, mean.shape).astype(np.int64),
    }
    return {"case": np.full(xx.size, case.spec.name, dtype=object)} | {
        name: grid.ravel() for name, grid in grids.items()
    }


def _topology_rows(case: Case, reference: float) -> Iterator[dict[str, Any]]:
    if case.topology is None:
        return
    mean = case.found.mean
    draws: list[dict[str, float]] = []
    for row in case.resamples:
        vx, vy = row.reshape(2, *mean.shape)
        seen = np.where(mean.valid, 1.0, np.nan)
        draws.append(
            topology.describe(
                replace(mean, vx_m_s=seen * vx, vy_m_s=seen * vy, u_m_s=None), case.scene, reference
            ).numbers
        )
    for name in topology.QUANTITIES:
        value = case.topology.numbers[name]
        spread = np.array([d[name] for d in draws])
        if name == "asymmetry" and not case.measured.all():
            # a mirrored half is as the measured one by construction
            value, spread = math.nan, np.full_like(spread, math.nan)
        spread = spread[np.isfinite(spread)]
        enough = case.found.n > 1 and len(spread) > 1
        low, high = np.quantile(spread, [0.05, 0.95]) if enough else (math.nan, math.nan)
        count = name.startswith("vort")
        # a height is read on the grid: anywhere within one step of it looks the same
        step = mean.dy_m / case.scene.radius_m if name == "stagnation_height_hat" else 0.0
        place = _place(case)
        yield {k: place[k] for k in ("case", "z_hat", "tilt_rad")} | {
            "quantity": name,
            "value": value,
            "u": math.hypot(float(spread.std(ddof=1)), step / math.sqrt(12))
            if enough
            else math.nan,
            "lo90": float(low) - 0.45 * step,
            "hi90": float(high) + 0.45 * step,
            "agreement": float(np.mean(spread == value)) if count and enough else math.nan,
        }


def _facts(case: Case) -> dict[str, Any]:
    """What flow.json says of one case."""
    moved = case.found.convergence
    return {
        **_place(case),
        "files": case.files,
        "fields": case.found.n,
        "left_out": [{"file": file, "reason": why} for file, why in case.refused],
        "outliers": case.outliers,
        "vectors": float(np.mean(case.found.count / case.found.n)),
        "mirrored": not bool(case.measured.all()),
        "tau_fields": case.found.tau,
        "convergence": {
            "n": moved.n,
            "moved": moved.moved,
            "relative_standard_error": moved.error,
            "fields_for_a_thousandth": moved.needed,
        },
        "rotors_m": case.scene.rotors_m,
        "vortices": []
        if case.topology is None
        else [
            {
                "x_m": v.x_m,
                "y_m": v.y_m,
                "circulation_m2_s": v.circulation_m2_s,
                "area_m2": v.area_m2,
            }
            for v in case.topology.vortices
        ],
    }


def _table(product: Product, rows: list[dict[str, Any]]) -> dict[str, Any]:
    kinds = {"text": object, "integer": np.int64, "real": float}
    return {
        c.name: np.array([row[c.name] for row in rows], dtype=kinds[c.kind])
        for c in product.columns
    }


def _stacked(product: Product, tables: list[dict[str, Any]]) -> dict[str, Any]:
    return {c.name: np.concatenate([t[c.name] for t in tables]) for c in product.columns}
