"""One case of velocity grids: its mean field, cuts and topology, and their rows in products."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.flow import downwash, topology
from nearlift.flow.average import Average, average
from nearlift.flow.downwash import Cut, CutDownwash
from nearlift.flow.field import Half, Scene, VelocityField, mirrored, spurious
from nearlift.results import Estimate

Rows = Iterator[dict[str, object]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """Mean of the fields of a case, downwash along the cut of each field (n, nx), and share of
    vectors left out as spurious.
    """

    mean: Average
    series: FloatArray
    outliers: float


def recorded(
    fields: Iterable[VelocityField],
    where: str,
    *,
    threshold: float,
    half: Half | None,
    below_m: float,
) -> Recording:
    """Average the fields without their spurious vectors, mirrored where half was measured."""
    profiles: list[FloatArray] = []
    wrong_of = np.zeros(2)

    def passed() -> Iterator[VelocityField]:
        for one in fields:
            wrong = spurious(one.vx_m_s, one.vy_m_s, threshold)
            wrong_of[:] += wrong.sum(), one.valid.sum()
            vx, vy = (np.where(wrong, np.nan, v) for v in (one.vx_m_s, one.vy_m_s))
            whole = replace(one, vx_m_s=vx, vy_m_s=vy)
            whole = whole if half is None else mirrored(whole, half)
            profiles.append(downwash.along_cut(whole.vy_m_s, whole.y_m, below_m))
            yield whole

    mean = average(passed(), where)
    return Recording(
        mean=mean,
        series=np.stack(profiles),
        outliers=float(wrong_of[0] / max(wrong_of[1], 1)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FlowCase:
    """Results of one case; z_hat is inf without a boundary, and only a ground has a topology.

    `measured` (nx,) are the columns that were measured, not mirrored; `refused` files with the
    reason. `cuts` are those beneath each measured rotor, by its place, and beneath all of them.
    """

    name: str
    z_hat: float
    scene: Scene
    recording: Recording
    cut: Cut
    measured: NDArray[np.bool_]
    files: int
    refused: Sequence[tuple[str, str]]
    topology: topology.WakeTopology | None = None
    cuts: Mapping[str, CutDownwash] = field(default_factory=dict)

    def described(self, reference_m_s: float) -> FlowCase:
        """Case with the topology of its wake near a ground, and cuts checked against its stagnation
        zone.
        """
        if self.scene.boundary != "ground":
            return self
        wake = topology.wake_topology(self.recording.mean.mean, self.scene, reference_m_s)
        return replace(self, topology=wake).cut_through()

    def cut_through(self) -> FlowCase:
        """Case with its cuts measured."""
        series = np.where(self.measured, self.recording.series, np.nan)
        order = {str(list(self.scene.rotors_m).index(c)): (c,) for c in self.cut.centres_m}
        stagnant = None if self.topology is None else self.topology.stagnation.nodes
        cuts = {
            name: downwash.measure(
                self.recording.mean,
                series,
                replace(self.cut, centres_m=centres),
                self.scene,
                stagnant,
            )
            for name, centres in (order | {"all": self.cut.centres_m}).items()
        }
        return replace(self, cuts=cuts)

    @property
    def place(self) -> dict[str, object]:
        """The columns that say where it was taken."""
        return {
            "case": self.name,
            "boundary": self.scene.boundary,
            "z_hat": self.z_hat,
            "tilt_rad": self.scene.tilt_rad,
        }

    def downwash_rows(self, control: FlowCase) -> Rows:
        """Rows of downwash.parquet."""
        none = Estimate(value=0.0, u=0.0, lo90=0.0, hi90=0.0)
        for rotor, d in self.cuts.items():
            other = control.cuts.get(rotor, control.cuts["all"])
            less = none if self.name == control.name else downwash.reduction(d, other)
            yield self.place | {
                "rotor": rotor,
                "below_m": self.cut.below_m,
                "half_span_m": self.cut.half_span_m,
                "downwash_m_s": d.value,
                "u_downwash_m_s": d.u,
                "u_noise_m_s": d.u_noise,
                "u_mask_m_s": d.u_mask,
                "u_position_m_s": d.u_position,
                "u_span_m_s": abs(d.span),
                "u_scale_m_s": d.u_scale,
                "covered": d.covered,
                "n_fields": self.recording.mean.n,
                "n_eff": d.n_eff,
                "clearance_hat": d.clearance_hat,
                "reduction": less.value,
                "u_reduction": less.u,
                "reduction_lo90": less.lo90,
                "reduction_hi90": less.hi90,
                "warnings": " ".join(d.warnings),
            }

    def profile(self) -> dict[str, NDArray[Any]]:
        """Columns of downwash_profile.parquet."""
        moments, mean = self.recording.mean, self.recording.mean.mean
        error = downwash.along_cut(moments.u_y, mean.y_m, self.cut.below_m)
        return {
            "case": np.full(len(mean.x_m), self.name, dtype=object),
            "x_m": mean.x_m,
            "downwash_m_s": downwash.along_cut(mean.vy_m_s, mean.y_m, self.cut.below_m),
            "u_downwash_m_s": np.abs(error),
            "mirrored": (~self.measured).astype(np.int64),
        }

    def nodes(self) -> dict[str, NDArray[Any]]:
        """Columns of flow_fields.parquet."""
        moments, mean = self.recording.mean, self.recording.mean.mean
        xx, yy = np.meshgrid(mean.x_m, mean.y_m)
        wake = self.topology
        stagnant = np.zeros(mean.shape, bool) if wake is None else wake.stagnation.nodes
        grids = {
            "x_m": xx,
            "y_m": yy,
            "z_m": self.scene.height_m(xx, yy),
            "vx_m_s": mean.vx_m_s,
            "vy_m_s": mean.vy_m_s,
            "u_vx_m_s": moments.u_x,
            "u_vy_m_s": moments.u_y,
            "sd_vx_m_s": np.sqrt(moments.var_x),
            "sd_vy_m_s": np.sqrt(moments.var_y),
            "count": moments.count.astype(np.int64),
            "stagnant": stagnant.astype(np.int64),
            "mirrored": np.broadcast_to(~self.measured, mean.shape).astype(np.int64),
        }
        return {"case": np.full(xx.size, self.name, dtype=object)} | {
            name: grid.ravel() for name, grid in grids.items()
        }

    def topology_rows(self) -> Rows:
        """Row of flow_topology.parquet."""
        if self.topology is None:
            return
        turns = [v.circulation_m2_s > 0 for v in self.topology.vortices]
        zone, r = self.topology.stagnation, self.scene.radius_m
        yield {k: self.place[k] for k in ("case", "z_hat", "tilt_rad")} | {
            "vortices_ccw": sum(turns),
            "vortices_cw": len(turns) - sum(turns),
            "stagnation_area_hat2": zone.area_m2 / r**2,
            "stagnation_height_hat": zone.height_m / r,
            # a mirrored half leans to neither side by construction
            "jets": self.topology.jets if self.measured.all() else "",
        }

    def facts(self) -> dict[str, object]:
        """Its block of flow.json."""
        moments = self.recording.mean
        return {
            **self.place,
            "files": self.files,
            "fields": moments.n,
            "left_out": [{"file": file, "reason": why} for file, why in self.refused],
            "outliers": self.recording.outliers,
            "vectors": float(np.mean(moments.count / moments.n)),
            "mirrored": not bool(self.measured.all()),
            "tau_fields": moments.tau,
            "convergence": moments.convergence,
            "rotors_m": self.scene.rotors_m,
            "vortices": [] if self.topology is None else list(map(asdict, self.topology.vortices)),
        }
