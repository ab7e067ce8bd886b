"""Vortices, stagnation zone and jets of flows that have them by construction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from nearlift.flow.field import Scene, VelocityField
from nearlift.flow.topology import (
    INNER_HAT,
    gamma,
    jets,
    stagnation,
    vortices,
)
from nearlift.randomness import generator
from nearlift.synthetic.demo_flow import wakes
from nearlift.synthetic.records import SimulatedBench
from nearlift.synthetic.wake import Wake

R = 0.023
X, Y = 2e-3 * np.arange(-35, 36), 2e-3 * np.arange(-40, 12)
XX, YY = np.meshgrid(X, Y)
GROUND = Scene(
    boundary="ground", distance_m=3.4 * R, tilt_rad=0.0, rotors_m=(-0.0325, 0.0325), radius_m=R
)


def swirl(x: float, y: float, turn: float, core: float = 0.012) -> tuple[np.ndarray, np.ndarray]:
    r2 = (XX - x) ** 2 + (YY - y) ** 2
    speed = turn * 4.0 * np.exp(-r2 / (2 * core**2))
    return -speed * (YY - y) / core, speed * (XX - x) / core


def field(*parts: tuple[np.ndarray, np.ndarray]) -> VelocityField:
    return VelocityField(
        x_m=X, y_m=Y, vx_m_s=sum(p[0] for p in parts), vy_m_s=sum(p[1] for p in parts)
    )


def test_gamma_is_one_at_the_centre_of_a_vortex_and_zero_in_a_stream_and_in_strain():
    whirl = field(swirl(0.0, -0.04, 1.0))
    at = (int(np.argmin(np.abs(Y + 0.04))), int(np.argmin(np.abs(X))))
    assert gamma(whirl, 0.4 * R)[at] == pytest.approx(1.0, abs=1e-6)
    assert gamma(field(swirl(0.0, -0.04, -1.0)), 0.4 * R)[at] == pytest.approx(-1.0, abs=1e-6)
    stream = VelocityField(x_m=X, y_m=Y, vx_m_s=np.full(XX.shape, 3.0), vy_m_s=np.zeros(XX.shape))
    assert np.nanmax(np.abs(gamma(stream, 0.4 * R)[8:-8, 8:-8])) < 1e-9
    strain = field((50 * XX, -50 * YY))
    assert np.nanmax(np.abs(gamma(strain, 0.4 * R)[8:-8, 8:-8])) < 1e-6


def test_vortices_are_counted_with_their_sign_and_place_whatever_is_missing():
    whirl = field(swirl(-0.02, -0.04, 1.0), swirl(0.02, -0.045, -1.0))
    holes = generator(0, "gaps").random(XX.shape) < 0.05
    for each in (whirl, whirl.without(holes)):
        left, right = vortices(each, GROUND, 8.0)
        assert left.circulation_m2_s > 0 > right.circulation_m2_s
        assert (left.x_m, left.y_m) == pytest.approx((-0.02, -0.04), abs=2e-3)
        assert (right.x_m, right.y_m) == pytest.approx((0.02, -0.045), abs=2e-3)


def test_a_vortex_that_is_carried_along_does_not_stand():
    carried = field(swirl(0.0, -0.04, 1.0), (np.full(XX.shape, 9.0), np.zeros(XX.shape)))
    assert np.nanmax(gamma(carried, 0.4 * R)) > 0.9  # Gamma_2 does not see the stream
    assert vortices(carried, GROUND, 8.0) == ()


def mean_of(wake: Wake) -> VelocityField:
    vx, vy = wake.velocity(XX, YY)
    hidden = wake.scene.height_m(XX, YY) <= 0
    return VelocityField(x_m=X, y_m=Y, vx_m_s=vx, vy_m_s=vy).without(hidden)


WAKE = Wake(scene=GROUND, speed_m_s=8.0)
#: Downwash of that wake far from boundaries, and its stagnation zone over r^2 on a fine grid.
U, AREA = 5.4, 0.30


def test_the_stagnation_zone_rests_on_the_ground_beneath_the_rotors():
    found = mean_of(WAKE)
    zone = stagnation(found, GROUND, U)
    assert zone.nodes.any()
    assert GROUND.beneath(XX[zone.nodes], INNER_HAT + 0.05).all()
    assert found.speed_m_s[zone.nodes].max() < 1.02 * 0.3 * U  # the zone's own step
    assert (zone.nodes != zone.nodes[:, ::-1]).sum() <= 4  # nodes on its edge
    assert not stagnation(replace(found, vx_m_s=found.vx_m_s + 9), GROUND, U).nodes.any()


def contracted(half: float) -> VelocityField:
    """Two plane jets of this half-width over radius, which end in still air 0.5 r above the
    ground.
    """
    inside = np.any([np.abs(XX - c) <= half * R for c in GROUND.rotors_m], axis=0)
    height = GROUND.height_m(XX, YY)
    vy = np.where(inside & (height > 0.5 * R), -8.0, 0.0)
    still = np.zeros(vy.shape)
    return VelocityField(x_m=X, y_m=Y, vx_m_s=still, vy_m_s=vy).without(height <= 0)


@pytest.mark.parametrize("half", [0.72, 1.0])
def test_the_stagnation_zone_does_not_leak_up_beside_a_contracted_wake(half):
    """Momentum theory's wake contracts to 0.71 r; the still air around reaches the rotor plane."""
    zone = stagnation(contracted(half), GROUND, 8.0)
    # within a grid spacing of what was built
    assert zone.height_m / R == pytest.approx(0.5, abs=2e-3 / R)
    assert zone.area_m2 / R**2 == pytest.approx(4 * INNER_HAT * 0.5, rel=0.2)


def impinging(half: float, shift_x: float, shift_y: float) -> VelocityField:
    """Jets of this half-width over radius that stagnate on the ground, on a grid of 3 mm moved by
    these shares of it.
    """
    x, y = 3e-3 * (np.arange(-28, 29) + shift_x), 3e-3 * (np.arange(-28, 12) + shift_y)
    xx, yy = np.meshgrid(x, y)
    height = GROUND.height_m(xx, yy) / R
    vx, vy = np.zeros(xx.shape), np.zeros(xx.shape)
    for centre in GROUND.rotors_m:
        xi = (xx - centre) / R
        jet = 0.5 * (np.tanh((xi + half) / 0.1) - np.tanh((xi - half) / 0.1))
        vy -= 8 * jet * np.tanh(np.maximum(height, 0) / 1.2)
        vx += 8 * np.tanh(xi) * np.exp(-np.abs(xi) / 3 - np.maximum(height, 0) / 0.35)
    return VelocityField(x_m=x, y_m=y, vx_m_s=vx, vy_m_s=vy).without(height <= 0)


def demo_like(half: float, shift_x: float, shift_y: float) -> VelocityField:
    """The demo's wake on such a grid."""
    grid = impinging(half, shift_x, shift_y)
    xx, yy = np.meshgrid(grid.x_m, grid.y_m)
    vx, vy = WAKE.velocity(xx, yy)
    return replace(grid, vx_m_s=vx, vy_m_s=vy).without(~grid.valid)


@pytest.mark.parametrize(("flow", "half"), [(impinging, 0.65), (impinging, 1.0), (demo_like, 1.0)])
def test_the_stagnation_zone_does_not_depend_on_where_the_nodes_stand(flow, half):
    """On a coarse grid, 0.13 r, at 16 offsets; nor on how far the wake has contracted."""
    reference, expected = (8.0, 0.365) if flow is impinging else (U, AREA)
    areas = [
        stagnation(flow(half, i / 4, j / 4), GROUND, reference).area_m2 / R**2
        for i in range(4)
        for j in range(4)
    ]
    assert max(areas) - min(areas) < 0.1 * np.mean(areas)
    assert np.mean(areas) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(("flow", "reference"), [(impinging, 8.0), (demo_like, U)])
@pytest.mark.parametrize("share", [0.05, 0.2])
def test_vectors_that_are_missing_everywhere_hardly_change_the_zone(flow, reference, share):
    whole, rng = flow(0.71, 0.25, 0.5), generator(1, "missing")
    area = stagnation(whole, GROUND, reference).area_m2
    for _ in range(4):
        holed = whole.without(rng.random(whole.shape) < share)
        assert stagnation(holed, GROUND, reference).area_m2 == pytest.approx(area, rel=0.1)
        assert jets(holed, GROUND) == "two jets"


def test_vortices_are_seen_wherever_there_are_vectors():
    """Next to the disks and above them, too; not within a quarter radius of the rotor plane."""
    for x, y in ((0.0325 + 1.2 * R, -0.04), (-0.0325, -0.5 * R - 0.012)):
        (found,) = vortices(field(swirl(x, y, 1.0)), GROUND, 8.0)
        assert (found.x_m, found.y_m) == pytest.approx((x, y), abs=3e-3)
    assert vortices(field(swirl(0.0, 0.0, 1.0, core=0.004)), GROUND, 8.0) == ()


# ---- the demo's wakes


def test_jets_lean_to_the_side_of_more_momentum():
    assert jets(mean_of(WAKE), GROUND) == "two jets"
    assert jets(mean_of(replace(WAKE, lean=0.1)), GROUND) == "two jets, leaning right"
    assert jets(mean_of(replace(WAKE, lean=-0.1)), GROUND) == "two jets, leaning left"
    across = mean_of(WAKE)
    assert jets(replace(across, vx_m_s=across.vx_m_s + 9), GROUND) == "one jet, leaning right"
    assert jets(replace(across, vx_m_s=across.vx_m_s - 9), GROUND) == "one jet, leaning left"


def test_the_demo_s_tilts_have_the_paper_s_vortices():
    """Two pairs at +4.6 and +3.1 degrees; a single counter-clockwise vortex at negative tilts. The
    wake leans to the side where the ground falls away.
    """
    seen = {
        n: (mean_of(w), w.scene) for n, w in wakes(SimulatedBench()).items() if n.startswith("tilt")
    }
    turns = {n: [v.circulation_m2_s > 0 for v in vortices(*of, U)] for n, of in seen.items()}
    for t in (4.6, 3.1):
        assert sorted(turns[f"tilt{t:+g}"]) == [False, False, True, True]
        assert jets(*seen[f"tilt{t:+g}"]) == "two jets, leaning right"
    for t in (-1.7, -3.2, -4.9):
        assert turns[f"tilt{t:+g}"] == [True]
    for t in (-3.2, -4.9):
        assert jets(*seen[f"tilt{t:+g}"]) == "two jets, leaning left"
