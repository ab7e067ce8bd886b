"""The demo's velocity grids: control, a ground and a ceiling series of which half was measured, and
six tilts of the ground.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from nearlift.flow.field import Scene
from nearlift.synthetic.records import SimulatedBench
from nearlift.synthetic.wake import Blob, Camera, Wake, fields, write_openpiv

FIELDS = 16
SPACING_M = 3.0e-3
#: The paper's tilts of the ground, degrees, at one distance.
TILTS, TILT_Z_HAT = (4.6, 3.1, 1.5, -1.7, -3.2, -4.9), 3.0
FREE_WAKE_M_S = 8.0
#: Shortfall of the far wake against the control's at each distance: with the cut at `CUT_M` the
#: reductions are near the paper's, 6 % at 3.4 above the ground and 22 % at 2 below the ceiling.
LESS = {
    "ground": {4.0: 0.01, 3.4: 0.018, 2.6: 0.025, 1.8: 0.03},
    "ceiling": {3.0: 0.11, 2.0: 0.20, 0.7: 0.20, 0.3: 0.22},
}
#: Distance of the cut beneath the rotors: half a radius, nearer to the inflow than the wake.
CUT_M = 11.5e-3
#: Radius over which the wall jet speeds up, at z_hat = 4 and per radius nearer: the stagnation zone
#: grows as the vehicle comes down, as the paper found.
STAGNANT_AT_4, STAGNANT_GROWS = 1.6, 0.6


def wakes(bench: SimulatedBench) -> dict[str, Wake]:
    """Truth of each case, by its name."""
    r, half = bench.radius_m, bench.spacing_m / 2

    def scene(boundary: str, z_hat: float, tilt_deg: float = 0.0) -> Scene:
        return Scene(
            boundary=boundary,  # type: ignore[arg-type]
            distance_m=z_hat * r,
            tilt_rad=math.radians(tilt_deg),
            rotors_m=(-half, half),
            radius_m=r,
        )

    cases = {"control": Wake(scene=scene("none", math.inf), speed_m_s=FREE_WAKE_M_S)}
    for boundary, stations in LESS.items():
        for z_hat, less in stations.items():
            cases[f"{boundary}-{z_hat:g}"] = Wake(
                scene=scene(boundary, z_hat),
                speed_m_s=FREE_WAKE_M_S * (1 - less),
                stagnant=STAGNANT_AT_4 + STAGNANT_GROWS * max(4.0 - z_hat, 0.0),
            )
    for tilt in TILTS:
        lean, blobs = _tilted(tilt)
        cases[f"tilt{tilt:+g}"] = Wake(
            scene=scene("ground", TILT_Z_HAT, tilt),
            speed_m_s=0.96 * FREE_WAKE_M_S,
            lean=lean,
            blobs=blobs,
        )
    return cases


def _tilted(tilt_deg: float) -> tuple[float, tuple[Blob, ...]]:
    """A second pair of vortices above the fountain's own at the steepest positive tilts.

    At negative tilts a single counter-clockwise one is in its place. The paper describes both.
    """
    lean = 0.015 * tilt_deg
    if tilt_deg > 3:
        return lean, (
            Blob(x_hat=-0.35, y_hat=-0.9, strength=0.15, size=0.3),
            Blob(x_hat=0.35, y_hat=-0.9, strength=-0.15, size=0.3),
        )
    if tilt_deg > 0:
        return lean, ()
    return lean, (Blob(x_hat=0.33, y_hat=-2.7, strength=0.4, size=0.4),)


def camera(wake: Wake, half: bool) -> Camera:
    """The picture of one case: the half at positive x, or all; a shadow about the body."""
    r = wake.scene.radius_m
    reach = {"ground": min(wake.scene.distance_m + 0.35 * r, 0.1), "ceiling": 0.1, "none": 0.1}[
        wake.scene.boundary
    ]
    top = min(0.036, wake.scene.distance_m) if wake.scene.boundary == "ceiling" else 0.036
    first = 0 if half else -27
    return Camera(
        x_m=SPACING_M * np.arange(first, 28, dtype=np.float64),
        y_m=SPACING_M
        * np.arange(
            -math.floor(reach / SPACING_M), math.floor(top / SPACING_M) + 1, dtype=np.float64
        ),
        gust=0.02,
        shadows=((-0.046, 0.046, -0.006, 0.003),)
        if not half
        else ((-0.002, 0.046, -0.006, 0.003), (-0.002, 0.0025, 0.003, 0.04)),
    )


def write_piv(folder: Path, bench: SimulatedBench, seed: int) -> str:
    """Write every case's fields under ``piv/`` and return the manifest's text."""
    half_mm = 500 * bench.spacing_m
    text = [
        "\n# Simulated like all else here.",
        "[piv]",
        'control = "control"',
        'length_unit = "mm"',
        'velocity_unit = "m/s"',
        'thrust = "+y"',
        'origin = ["0 mm", "0 mm"]',
        f'rotors = ["{-half_mm:g} mm", "{half_mm:g} mm"]',
        'rate = "15 Hz"',
        f'below = "{1e3 * CUT_M:g} mm"',
        'figure3 = ["control", "ground-3.4", "ceiling-2"]',
    ]
    for name, wake in wakes(bench).items():
        half = not name.startswith("tilt")
        place = folder / "piv" / name
        place.mkdir(parents=True, exist_ok=True)
        for i, one in enumerate(fields(wake, camera(wake, half), FIELDS, seed, name)):
            write_openpiv(place / f"{i:04d}.txt", one)
        scene = wake.scene
        text += [
            "",
            "[[piv.case]]",
            f'name = "{name}"',
            f'boundary = "{scene.boundary}"',
            f'files = "piv/{name}/*.txt"',
        ]
        if math.isfinite(scene.distance_m):
            text.append(f"z_hat = {scene.distance_m / scene.radius_m:.6g}")
        if scene.tilt_rad:
            text.append(f'tilt = "{math.degrees(scene.tilt_rad):.4g} deg"')
        if half:
            text.append('mirror = "right"')
    return "\n".join(text) + "\n"
