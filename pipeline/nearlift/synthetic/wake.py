"""Velocity grids with known downwash: the jets of the rotors in a light sheet through their axes.

Each jet is symmetric about its axis and has a stream function Q, so that no air is made or lost:

    rho v_x = dQ/dy,   rho v_y = -dQ/dx,   Q = V r^2/4 T(m),   rho = |x - x_i|,

with T(m) = m for small m, the core, and 1 outside, the rest, and m the smaller (smoothly) of two:

- The free jet's is rho^2 / a(y)^2. Its radius a follows from the speed on the axis of a vortex
  cylinder. At s radii beneath the disk that is V/2 (1 + s / sqrt(1 + s^2)). The radius is r at the
  disk. Far beneath, where the speed is V (momentum theory), it is r / sqrt(2). A ceiling is the
  image of that cylinder.
- The wall jet's applies over a ground. That jet stagnates on the axis, runs outwards no faster than
  the free jet (Bernoulli) and slows as it spreads. Where inner wall jets meet, midway between the
  rotors, they turn up: the fountain. Its air leaves the picture sideways as it rises.

To that come a side wind and vortices, of a plane stream function. A kinematic picture for tests and
the demo, no solution of the flow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import derivative
from nearlift.declare import FloatArray
from nearlift.flow.field import Scene, VelocityField
from nearlift.randomness import generator

#: Sharpness of a jet's edge.
EDGE = 6
#: Usual size of the stagnation zone, radius from which wall jets slow down, height over which a
#: fountain loses its air, and of the side wind's layer on the ground; over rotor radius.
STAGNANT, SPREAD, FOUNTAIN, WALL = 2.0, 2.5, 5.0, 0.5
#: Share of its air by which a jet gains from the still air around it, within each radius.
GAINED = 0.06
#: Share of a jet's air that enters beneath a ceiling within each radius below it.
INFLOW = 1.2


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
    """Truth of one case.

    Attributes
    ----------
    scene : Scene
    speed_m_s : float
        Far wake V.
    lean : float
        Stream to the right over V r: what tilts the jets.
    blobs : tuple of Blob
    stagnant : float
        Radius over which the wall jet reaches its speed, over rotor radius.
    """

    scene: Scene
    speed_m_s: float
    lean: float = 0.0
    blobs: tuple[Blob, ...] = ()
    stagnant: float = STAGNANT

    def velocity(self, x_m: FloatArray, y_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Components at points, from the derivatives of the stream functions."""
        near = 1e-3 * self.scene.radius_m
        vx, vy = self._slopes(self._plane, x_m, y_m)
        for centre in self.scene.rotors_m:
            aside = x_m - centre
            # near the axis, the value next to it
            rho = np.where(np.abs(aside) < near, np.where(aside < 0, -near, near), aside)
            parts = self._slopes(partial(self._jet, centre), centre + rho, y_m)
            vx, vy = vx + parts[0] / rho, vy + parts[1] / rho
        return vx, vy

    def _slopes(
        self,
        stream: Callable[[FloatArray, FloatArray], FloatArray],
        x_m: FloatArray,
        y_m: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """d/dy and -d/dx of a stream function."""
        r = self.scene.radius_m
        along = derivative.at_zero(lambda t: stream(x_m, y_m + t * r)) / r
        across = derivative.at_zero(lambda t: stream(x_m + t * r, y_m)) / r
        return along, -across

    def _jet(self, centre_m: float, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        """The stream function Q of one jet, m^3/s."""
        scene, r = self.scene, self.scene.radius_m
        rho2 = ((x_m - centre_m) / r) ** 2
        on_axis = _on_axis(-y_m / r)
        if scene.boundary == "ceiling":
            on_axis = on_axis - _on_axis(y_m / r - 2 * scene.distance_m / r)
        m = 2 * rho2 * np.maximum(on_axis, 1e-9)
        if scene.boundary == "ceiling":
            # air that cannot come from above comes from the sides, evenly over a layer
            m = _smaller(m, INFLOW * np.maximum(scene.distance_m - y_m, 0.0) / r)
        if scene.boundary == "ground":
            height = np.maximum(scene.height_m(x_m, y_m) / r, 0.0)
            slow = (1 + rho2 / SPREAD**2) ** -0.75
            if len(scene.rotors_m) > 1:
                side = math.copysign(1.0, centre_m)
                apart = np.maximum(side * x_m / r, 0.0) + height**2 / FOUNTAIN
                height = height * apart / np.maximum(np.hypot(height, apart), 1e-12)
            wall = 4 * height * slow * rho2 / np.sqrt(rho2 + self.stagnant**2)
            m = _smaller(m, wall)
        gained = 1 + GAINED * (np.hypot(y_m / r, 1) - y_m / r + 2 * np.sqrt(rho2)) / 2
        result: FloatArray = (
            0.25 * self.speed_m_s * r**2 * m / (1 + (m / gained) ** EDGE) ** (1 / EDGE)
        )
        return result

    def _plane(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        """The stream function of side wind and vortices, m^2/s."""
        scene, r = self.scene, self.scene.radius_m
        wall = np.ones_like(y_m)
        if scene.boundary == "ground":
            wall = 1 - np.exp(-((np.maximum(scene.height_m(x_m, y_m) / r, 0.0) / WALL) ** 2))
        total = self.lean * 0.5 * (1 - np.tanh(y_m / r / 1.2)) * wall
        for b in self.blobs:
            distance2 = (x_m / r - b.x_hat) ** 2 + (y_m / r - b.y_hat) ** 2
            total = total + b.strength * np.exp(-distance2 / (2 * b.size**2)) * wall
        result: FloatArray = self.speed_m_s * r * total
        return result

    def downwash_m_s(
        self, below_m: float, half_span_m: float, centres_m: tuple[float, ...]
    ) -> float:
        """True mean downwash through a cut, by the midpoint rule."""
        across = half_span_m * (np.arange(4000) + 0.5 - 2000) / 2000
        x = np.concatenate([c + across for c in centres_m])
        return -float(self.velocity(x, np.full(x.shape, -below_m))[1].mean())


def _smaller(a: FloatArray, b: FloatArray) -> FloatArray:
    """The smaller of two positive numbers, smoothly."""
    return np.asarray(a * b / np.maximum(np.hypot(a, b), 1e-12))


def _on_axis(s: FloatArray) -> FloatArray:
    """Speed over V on the axis of a vortex cylinder that begins at s = 0."""
    return np.asarray(0.5 * (1 + s / np.sqrt(1 + s**2)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """Features of the image and its errors.

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
