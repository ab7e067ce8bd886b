"""Velocity grids with known downwash: two rotor jets from a stream function, so that no air is made
or lost.

    psi(x, y) = V r sum_i F((x - x_i) / r) A(y) G(h) + side wind + vortices,    vx = d psi / dy,  vy
    = -d psi / dx

F is the running integral of a top-hat jet; A grows from 0 high above the rotors through 1/2 at the
disk to 1 in the wake (momentum theory); G vanishes on the ground with height h above it and splits
each jet into two wall jets around slow air; at a ceiling A is brought to 0 there, and air enters
sideways. A kinematic picture for tests and the demo, no solution of the flow.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.flow.field import VelocityField
from nearlift.flow.scene import Scene
from nearlift.randomness import generator

#: Shear layer of a jet and wall jet, over radius.
EDGE, WALL = 0.22, 1.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Blob:
    """A vortex in the picture: centre over radius (beneath is negative), strength over V r
    (counter-clockwise positive), size over radius.
    """

    x_hat: float
    y_hat: float
    strength: float
    size: float = 0.45


@dataclass(frozen=True, slots=True, kw_only=True)
class Wake:
    """What is true of one case.

    Attributes
    ----------
    scene : Scene
    speed_m_s : float
        Far wake V.
    lean : float
        Stream to the right over V r: what tilts the jets.
    blobs : tuple of Blob
    """

    scene: Scene
    speed_m_s: float
    lean: float = 0.0
    blobs: tuple[Blob, ...] = ()

    def velocity(self, x_m: FloatArray, y_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Components at points, from central differences of the stream function."""
        step = 1e-4 * self.scene.radius_m
        vx = (self._psi(x_m, y_m + step) - self._psi(x_m, y_m - step)) / (2 * step)
        vy = -(self._psi(x_m + step, y_m) - self._psi(x_m - step, y_m)) / (2 * step)
        return vx, vy

    def _psi(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        scene, r = self.scene, self.scene.radius_m
        y = y_m / r
        across = np.sum([_integral((x_m - c) / r) for c in scene.rotors_m], axis=0) + self.lean
        # close to a ceiling less air comes from above, and more joins from the sides below
        late = 0.9 * math.exp(-scene.distance_m / r) if scene.boundary == "ceiling" else 0.0
        along = 0.5 * (1 - np.tanh((y + late) / 1.2))
        height = scene.height_m(x_m, y_m) / r
        wall = np.ones_like(along)
        if scene.boundary == "ground":
            wall = 1 - np.exp(-((np.maximum(height, 0.0) / WALL) ** 2))
        elif scene.boundary == "ceiling":
            above = np.maximum(height, 0.0)
            along = along * np.where(
                y > 0, np.tanh(above / 0.5) / math.tanh(scene.distance_m / r / 0.5), 1.0
            )
        total = across * along * wall
        for b in self.blobs:
            distance2 = (x_m / r - b.x_hat) ** 2 + (y - b.y_hat) ** 2
            total = total + b.strength * np.exp(-distance2 / (2 * b.size**2)) * wall
        result: FloatArray = self.speed_m_s * r * total
        return result

    def downwash_m_s(
        self, below_m: float, half_span_m: float, centres_m: tuple[float, ...]
    ) -> float:
        """True mean downwash through a cut: a difference of stream functions, exact."""
        found = [
            (
                self._psi(np.array([c + half_span_m]), np.array([-below_m]))
                - self._psi(np.array([c - half_span_m]), np.array([-below_m]))
            )[0]
            for c in centres_m
        ]
        return float(np.mean(found)) / (2 * half_span_m)


def _integral(xi: FloatArray) -> FloatArray:
    """Running integral of a smooth top hat of half-width 1 and height 1, odd."""
    return np.asarray(
        0.5 * EDGE * (_log_cosh((xi + 1) / EDGE) - _log_cosh((xi - 1) / EDGE)), dtype=np.float64
    )


def _log_cosh(a: FloatArray) -> FloatArray:
    return np.asarray(np.logaddexp(a, -a) - math.log(2), dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """What the picture shows and how badly.

    Attributes
    ----------
    x_m, y_m : (nx,), (ny,)
        Nodes in vehicle axes.
    noise_m_s : float
        Of one vector's component, sd.
    gust, memory : float
        Relative sd of the whole wake's speed from field to field, and its correlation from one
        field to the next.
    outliers, dropouts : float
        Shares of vectors that are wrong, and that are missing.
    shadows : tuple of (x from, x to, y from, y to)
        Rectangles without vectors, vehicle axes, m.
    """

    x_m: FloatArray
    y_m: FloatArray
    noise_m_s: float = 0.15
    gust: float = 0.05
    memory: float = 0.4
    outliers: float = 0.01
    dropouts: float = 0.01
    shadows: tuple[tuple[float, float, float, float], ...] = ()


def fields(wake: Wake, camera: Camera, n: int, seed: int, name: str) -> Iterator[VelocityField]:
    """`n` instantaneous fields, in vehicle axes; what lies behind the boundary has no vectors."""
    rng = generator(seed, "piv", name)
    xx, yy = np.meshgrid(camera.x_m, camera.y_m)
    vx, vy = wake.velocity(xx, yy)
    hidden = wake.scene.height_m(xx, yy) <= 0
    for x0, x1, y0, y1 in camera.shadows:
        hidden |= (xx >= x0) & (xx <= x1) & (yy >= y0) & (yy <= y1)
    gust = rng.standard_normal()
    for _ in range(n):
        gain = 1 + camera.gust * gust
        u = gain * vx + camera.noise_m_s * rng.standard_normal(vx.shape)
        v = gain * vy + camera.noise_m_s * rng.standard_normal(vx.shape)
        wrong = rng.random(vx.shape) < camera.outliers
        u[wrong], v[wrong] = wake.speed_m_s * rng.uniform(-1.5, 1.5, (2, int(wrong.sum())))
        missing = hidden | (rng.random(vx.shape) < camera.dropouts)
        yield VelocityField(
            x_m=camera.x_m,
            y_m=camera.y_m,
            vx_m_s=np.where(missing, np.nan, u),
            vy_m_s=np.where(missing, np.nan, v),
        )
        gust = camera.memory * gust + math.sqrt(1 - camera.memory**2) * rng.standard_normal()


def write_openpiv(path: Path, field: VelocityField) -> None:
    """OpenPIV's text: x, y in mm, u, v in m/s, flags (1 where there is no vector, written as 0),
    mask.
    """
    import pyarrow as pa
    import pyarrow.csv as pc

    xx, yy = np.meshgrid(1e3 * field.x_m, 1e3 * field.y_m)
    good = field.valid
    u, v = (np.where(good, component, 0.0) for component in (field.vx_m_s, field.vy_m_s))
    columns: list[NDArray[Any]] = [np.round(a, 4) for a in (xx, yy, u, v)]
    flags = (~good).astype(np.int64)
    cells: list[NDArray[Any]] = [*columns, flags, np.zeros_like(flags)]
    table = pa.table({str(i): c.ravel() for i, c in enumerate(cells)})
    sink = pa.BufferOutputStream()
    pc.write_csv(table, sink, pc.WriteOptions(include_header=False, delimiter="\t"))
    path.write_bytes(b"# x\ty\tu\tv\tflags\tmask\n" + sink.getvalue().to_pybytes())
