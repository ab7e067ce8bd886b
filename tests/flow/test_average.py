"""The streamed average: moments, masks, correlation in time."""

from __future__ import annotations

import numpy as np
import pytest

from nearlift.errors import InputRefused
from nearlift.flow.average import average, correlation_time, integrated
from nearlift.flow.field import (
    VelocityField,
    has_flipped_component,
    mirrored,
    on_grid,
    orient,
    spurious,
)

X, Y = np.linspace(-0.04, 0.04, 17), np.linspace(-0.06, 0.02, 13)


def field(vx: np.ndarray, vy: np.ndarray) -> VelocityField:
    return VelocityField(x_m=X, y_m=Y, vx_m_s=vx, vy_m_s=vy)


def stack(n: int, seed: int = 0, offset: float = 0.0) -> np.ndarray:
    return offset + np.random.default_rng(seed).standard_normal((n, 2, len(Y), len(X)))


@pytest.mark.parametrize("n", [1, 2, 33])
def test_moments_are_those_of_numpy_whatever_is_missing(n):
    cube = stack(n, offset=1e4)
    hole = np.random.default_rng(1).random((n, len(Y), len(X))) < 0.2
    hole[:, 3, 4] = True
    cube[np.broadcast_to(hole[:, None], cube.shape)] = np.nan
    found = average(field(*c) for c in cube)
    some = ~hole.all(axis=0)
    assert found.n == n
    np.testing.assert_array_equal(found.count, (~hole).sum(axis=0))
    np.testing.assert_allclose(
        found.mean.vy_m_s[some], np.nanmean(cube[:, 1][:, some], axis=0), rtol=1e-12
    )
    assert np.isnan(found.mean.vx_m_s[3, 4])
    several = (~hole).sum(axis=0) > 1
    np.testing.assert_allclose(
        found.variance[0][several], np.nanvar(cube[:, 0][:, several], axis=0, ddof=1), rtol=1e-6
    )
    assert np.isnan(found.variance[0][~several]).all()


def test_a_vector_that_lacks_one_component_is_no_vector():
    vx, vy = stack(1)[0]
    vx[0, 0] = np.nan
    found = average([field(vx, vy), field(*stack(1, 5)[0])])
    assert found.count[0, 0] == 1


def test_another_grid_is_refused():
    vx, vy = stack(1)[0]
    other = VelocityField(x_m=X + 1e-3, y_m=Y, vx_m_s=vx, vy_m_s=vy)
    with pytest.raises(InputRefused, match="field 2 has another grid than the first"):
        average([field(vx, vy), other], "case a")
    with pytest.raises(InputRefused, match="holds no field"):
        average([])


def ar1(n: int, rho: float, rng: np.random.Generator) -> np.ndarray:
    e, x = rng.standard_normal(n), np.empty(n)
    x[0] = e[0]
    for i in range(1, n):
        x[i] = rho * x[i - 1] + np.sqrt(1 - rho**2) * e[i]
    return x


@pytest.mark.parametrize(("rho", "low", "high"), [(0.0, 1.0, 1.3), (0.6, 3.2, 5.2)])
def test_correlation_in_time_is_found(rho, low, high):
    """Theory: (1 + rho) / (1 - rho) = 1 and 4; 221 x 2 independent nodes put its estimate within a
    few per cent of its own mean.
    """
    rng = np.random.default_rng(3)
    cube = np.stack([ar1(150, rho, rng) for _ in range(2 * len(X) * len(Y))], axis=1).reshape(
        150, 2, len(Y), len(X)
    )
    found = average(field(*c) for c in cube)
    assert low <= found.tau <= high


def test_the_standard_error_covers():
    """90 % intervals of 400 means of 60 correlated values; binomial 5-sigma band of a true 0.90,
    widened by 0.03 for the estimated tau.
    """
    rng = np.random.default_rng(8)
    hits = 0
    for _ in range(400):
        x = 2.0 + ar1(60, 0.5, rng)
        tau = correlation_time(x[:, None])
        hits += abs(x.mean() - 2.0) < 1.699 * np.sqrt(x.var(ddof=1) * tau / 60)
    assert 0.90 - 5 * 0.015 - 0.03 < hits / 400 < 0.90 + 5 * 0.015


def test_integrated_time_of_nothing_is_one():
    assert integrated(np.array([0.0, 0.0, 0.0]), 100) == 1.0
    assert integrated(np.array([1.0, 0.9, 0.8]), 4) == 1.0


def test_orientation_brings_every_picture_into_vehicle_axes():
    """A jet along -y of the vehicle, drawn in a picture in each of the ways it can lie."""
    vx, vy = 0.1 * np.outer(Y, X), -np.exp(-((X / 0.01) ** 2)) * (1 + Y[:, None])
    true = field(vx, vy)
    ways = {
        ("+y", "+x"): VelocityField(x_m=X, y_m=Y, vx_m_s=vx, vy_m_s=vy),
        ("-y", "+x"): VelocityField(x_m=X, y_m=-Y[::-1], vx_m_s=vx[::-1], vy_m_s=-vy[::-1]),
        ("-y", "-x"): VelocityField(
            x_m=-X[::-1], y_m=-Y[::-1], vx_m_s=-vx[::-1, ::-1], vy_m_s=-vy[::-1, ::-1]
        ),
        ("+x", "+y"): VelocityField(x_m=Y, y_m=X, vx_m_s=vy.T, vy_m_s=vx.T),
        ("-x", "+y"): VelocityField(
            x_m=-Y[::-1], y_m=X, vx_m_s=-vy.T[:, ::-1], vy_m_s=vx.T[:, ::-1]
        ),
    }
    for (thrust, across), picture in ways.items():
        found = orient(picture, thrust=thrust, across=across)
        for name in ("x_m", "y_m", "vx_m_s", "vy_m_s"):
            np.testing.assert_allclose(
                getattr(found, name), getattr(true, name), err_msg=f"{thrust} {across} {name}"
            )
    np.testing.assert_allclose(orient(true, thrust="+y", origin_m=(0.01, -0.02)).y_m, Y + 0.02)


def test_mass_betrays_one_flipped_component():
    yy, xx = np.meshgrid(Y, X, indexing="ij")
    vx, vy = 50 * xx, -50 * yy
    assert not has_flipped_component(field(vx, vy))
    assert has_flipped_component(field(vx, -vy))
    assert not has_flipped_component(field(np.full(vx.shape, np.nan), vy))


def test_a_measured_half_is_reflected():
    half = np.linspace(-0.005, 0.05, 12)
    square = np.tile(half**2, (3, 1))
    measured = VelocityField(
        x_m=half, y_m=np.arange(3.0), vx_m_s=np.ones_like(square), vy_m_s=square
    )
    whole = mirrored(measured, "right")
    x, sign = whole.x_m, whole.vx_m_s
    np.testing.assert_allclose(x, -x[::-1])
    np.testing.assert_allclose(whole.vy_m_s, np.tile(x**2, (3, 1)), atol=1e-12)
    assert (sign[:, x < -1e-9] == -1).all()
    assert (sign[:, x >= 0] == 1).all()


def test_scattered_rows_find_their_nodes():
    xx, yy = np.meshgrid(X, Y)
    order = np.random.default_rng(0).permutation(xx.size)[:-5]
    x, y, (values,) = on_grid(
        xx.ravel()[order], yy.ravel()[order], ((xx + 10 * yy).ravel()[order],), "f"
    )
    np.testing.assert_allclose(x, X)
    np.testing.assert_allclose(y, Y)
    assert np.isnan(values).sum() == 5
    known = np.isfinite(values)
    np.testing.assert_allclose(values[known], (xx + 10 * yy)[known])


def test_outliers_are_found_and_a_shear_layer_is_left_alone():
    rng = np.random.default_rng(2)
    xx = np.linspace(-0.05, 0.05, 60)
    jet = np.tile(-4.0 * np.exp(-((xx / 0.015) ** 4)), (50, 1))
    vx, vy = 0.05 * rng.standard_normal(jet.shape), jet + 0.05 * rng.standard_normal(jet.shape)
    wrong = rng.random(jet.shape) < 0.03
    vx[wrong], vy[wrong] = rng.uniform(-8, 8, (2, int(wrong.sum())))
    found = spurious(vx, vy, 3.0)
    assert (found & wrong).sum() > 0.9 * wrong.sum()
    assert (found & ~wrong).sum() < 0.04 * (~wrong).sum()
    assert not spurious(vx, vy, 0.0).any()
