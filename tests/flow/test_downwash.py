"""Downwash through a cut: exact sums, recovery and coverage on wakes of known downwash, robustness,
what is warned of and refused.
"""

from __future__ import annotations

import dataclasses
import math
from functools import partial

import numpy as np
import pytest

from nearlift.errors import InputRefused
from nearlift.flow.average import average
from nearlift.flow.downwash import (
    Cut,
    CutDownwash,
    along_cut,
    check_plausible,
    measure,
    reduction,
    wake_speed_m_s,
)
from nearlift.flow.field import Scene, VelocityField, difference, spurious
from nearlift.synthetic.wake import Camera, Wake, fields

R, ROTORS = 0.023, (-0.0325, 0.0325)
X = 2e-3 * np.arange(-35, 36)
CUT = Cut(below_m=2 * R, half_span_m=R, centres_m=ROTORS, u_position_m=0.3e-3)


def scene(boundary: str = "none", z_hat: float = math.inf, tilt: float = 0.0) -> Scene:
    return Scene(
        boundary=boundary, distance_m=z_hat * R, tilt_rad=tilt, rotors_m=ROTORS, radius_m=R
    )  # type: ignore[arg-type]


def camera(**changes) -> Camera:
    return Camera(
        **({"x_m": X, "y_m": 2e-3 * np.arange(-26, -20), "gust": 0.05, "memory": 0.4} | changes)
    )


def measured(
    wake: Wake, picture: Camera, n: int, seed: int, threshold: float = 3.0, cut: Cut = CUT
) -> CutDownwash:
    series: list[np.ndarray] = []

    def passed():
        for one in fields(wake, picture, n, seed, "t"):
            kept = one.without(spurious(one.vx_m_s, one.vy_m_s, threshold))
            series.append(along_cut(kept.vy_m_s, kept.y_m, cut.below_m))
            yield kept

    found = average(passed())
    return measure(found, np.stack(series), cut, wake.scene)


CONTROL = Wake(scene=scene(), speed_m_s=8.0)
TRUE = CONTROL.downwash_m_s(CUT.below_m, CUT.half_span_m, ROTORS)


def test_the_cut_is_linear_between_rows_and_the_span_counts_partial_nodes():
    y = np.array([-0.06, -0.05, -0.04])
    vy = np.array([[-6.0, -6.0], [-5.0, -5.0], [-4.0, np.nan]])
    np.testing.assert_allclose(along_cut(vy, y, 0.0525), [5.25, 5.25])
    np.testing.assert_allclose(along_cut(vy, y, 0.045)[0], 4.5)
    assert np.isnan(along_cut(vy, y, 0.045)[1])
    assert np.isnan(along_cut(vy, y, 0.07)).all()
    x = np.arange(0.0, 11.0)
    cut = Cut(below_m=0.05, half_span_m=2.25, centres_m=(5.0,), u_position_m=0.0)
    weights = cut.weights(x)
    assert weights.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(weights[[2, 3, 5]], [0.0, 0.75 / 4.5, 1 / 4.5])
    profile = np.tile(np.where(x == 5, np.nan, -x), (3, 1))
    field = VelocityField(x_m=x, y_m=y, vx_m_s=profile, vy_m_s=profile)
    assert cut.mean(field) == (pytest.approx(5.0), pytest.approx(3.5 / 4.5))


def test_the_picture_makes_no_air():
    """A round jet over a tilted ground, with another that makes its fountain."""
    both = scene("ground", 2.6, 0.05)
    wake = Wake(scene=both, speed_m_s=8.0)
    jet = partial(wake._jet, both.rotors_m[1])
    h = 1e-5

    def velocity(x, y):
        rho = x - both.rotors_m[1]
        along, across = wake._slopes(jet, x, y)
        return along / rho, across / rho

    xx, yy = np.meshgrid(np.linspace(0.001, 0.08, 31), np.linspace(-0.05, 0.02, 30))
    rho = xx - both.rotors_m[1]
    divergence = (
        (rho + h) * velocity(xx + h, yy)[0]
        - (rho - h) * velocity(xx - h, yy)[0]
        + rho * (velocity(xx, yy + h)[1] - velocity(xx, yy - h)[1])
    ) / (2 * h * rho)
    assert np.abs(divergence).max() < 1e-3 * 8.0 / R


def test_known_downwash_is_recovered():
    found = measured(CONTROL, camera(), 60, seed=1)
    assert abs(found.value - TRUE) < 3 * found.u
    assert found.u < 0.02 * TRUE
    assert found.covered == pytest.approx(1.0)
    assert found.warnings == ()


def coverage(reps: int, n: int) -> tuple[float, float]:
    """Shares of 90 % intervals that hold: of the mean's noise about the picture without noise, and
    of the reduction against its truth.
    """
    near = Wake(scene=scene("ceiling", 0.7), speed_m_s=7.4)
    still = camera(noise_m_s=0.0, gust=0.0, outliers=0.0, dropouts=0.0)
    exact = {w: measured(w, still, 1, 0).value for w in (CONTROL, near)}
    truth = 1 - near.downwash_m_s(CUT.below_m, R, ROTORS) / TRUE
    noise = less = 0
    for seed in range(reps):
        a, b = measured(CONTROL, camera(), n, 2 * seed), measured(near, camera(), n, 2 * seed + 1)
        from scipy.stats import t

        noise += abs(a.value - exact[CONTROL]) < t.ppf(0.95, max(a.n_eff - 1, 1)) * a.u_noise
        found = reduction(b, a)
        less += found.lo90 < truth < found.hi90
    return noise / reps, less / reps


@pytest.mark.parametrize(
    ("reps", "n"),
    [
        pytest.param(40, 30, marks=pytest.mark.nightly),
        pytest.param(1000, 60, marks=pytest.mark.calibration),
    ],
)
def test_its_interval_covers(reps, n):
    """A nominal 0.90 less 3.3 binomial sd, and 0.03 for the estimate of correlation in time;
    position errors only widen.
    """
    noise, less = coverage(reps, n)
    print(f"90 % intervals: noise {noise:.3f}, reduction {less:.3f}")
    slack = 3.3 * math.sqrt(0.09 / reps)
    assert 0.87 - slack <= noise <= 0.90 + slack
    assert less >= 0.87 - slack


def test_outliers_do_not_move_it():
    """Five per cent of wrong vectors, uniform in +-1.5 V, pull a mean down by 5 % unless they are
    found.
    """
    picture = camera(outliers=0.05, gust=0.0)
    assert measured(CONTROL, picture, 30, 3).value == pytest.approx(TRUE, rel=0.012)
    assert measured(CONTROL, picture, 30, 3, threshold=0.0).value < 0.965 * TRUE


def test_a_mask_over_part_of_the_cut_is_said_and_widens():
    hidden = camera(shadows=((0.0325, 0.06, -0.1, 0.0),))
    found = measured(CONTROL, hidden, 30, 4)
    assert found.covered == pytest.approx(0.75, abs=0.03)
    assert "partly_covered" in found.warnings
    assert found.u_mask > 0
    assert abs(found.value - TRUE) < 3 * found.u


def test_a_cut_near_the_ground_is_not_the_inflow():
    tall = camera(y_m=2e-3 * np.arange(-40, 5))
    high, low = (
        measured(Wake(scene=scene("ground", z), speed_m_s=7.5), tall, 3, 5) for z in (4.5, 3.4)
    )
    assert high.warnings == ()
    assert low.warnings == ("deflection_zone",)
    assert low.clearance_hat == pytest.approx(1.4)
    under = measured(Wake(scene=scene("ground", 1.8), speed_m_s=7.5), tall, 3, 5)
    assert "meets_boundary" in under.warnings
    assert math.isnan(under.value)
    assert math.isnan(reduction(under, high).u)


def test_tilt_brings_one_end_of_the_cut_nearer():
    tilted = scene("ground", 3.4, math.radians(4.6))
    ends = tilted.height_m(np.array([-0.0555, 0.0555]), np.full(2, -2 * R)) / R
    assert ends[0] < 1.4 < ends[1]
    np.testing.assert_allclose(
        tilted.height_m(np.array([0.02]), tilted.boundary_y_m(np.array([0.02]))), 0.0, atol=1e-15
    )


def test_a_single_mean_field_says_that_its_noise_is_unknown():
    one = next(iter(fields(CONTROL, camera(outliers=0, dropouts=0), 1, 0, "one")))
    series = along_cut(one.vy_m_s, one.y_m, CUT.below_m)[None]
    assert measure(average([one]), series, CUT, scene()).warnings == ("no_scatter",)


def test_reduction_shares_what_case_and_control_share():
    none = dict.fromkeys(("u_noise", "u_mask", "u_position", "span", "u_scale"), 0.0)
    rest = {"u": 0.1, "covered": 1.0, "n_eff": 50.0, "clearance_hat": 9.0, "warnings": ()}

    def of(value: float, **parts: float) -> CutDownwash:
        return CutDownwash(value=value, **(rest | none | parts))

    assert reduction(
        of(9.0, span=0.9, u_scale=0.5), of(10.0, span=1.0, u_scale=0.5)
    ).u == pytest.approx(0.0, abs=1e-12)
    found = reduction(of(9.0, u_noise=0.09), of(10.0, u_noise=0.1))
    assert found.value == pytest.approx(0.1)
    assert found.u == pytest.approx(0.9 * 0.01 * math.sqrt(2))
    assert found.hi90 - found.value == pytest.approx(1.66 * found.u, rel=0.01)


def test_the_difference_to_the_control_is_of_speeds_and_nan_where_either_is_missing():
    x, y = np.linspace(-0.03, 0.03, 7), np.linspace(-0.05, 0.0, 6)
    slow = VelocityField(x_m=x, y_m=y, vx_m_s=np.full((6, 7), 3.0), vy_m_s=np.full((6, 7), -4.0))
    fast = VelocityField(
        x_m=x[1:], y_m=y, vx_m_s=np.full((6, 6), 6.0), vy_m_s=np.full((6, 6), -8.0)
    )
    found = difference(slow, fast)
    assert np.isnan(found[:, 0]).all()
    np.testing.assert_allclose(found[:, 1:], -5.0)


# ---- what cannot be true


def mean_field(wake: Wake = CONTROL) -> VelocityField:
    clear = camera(y_m=2e-3 * np.arange(-28, 16), noise_m_s=0.05, gust=0.0, outliers=0.0)
    return next(iter(fields(wake, clear, 1, 0, "m")))


def doubt(field: VelocityField, expected: float = 8.0) -> None:
    check_plausible(field, scene(), CUT, expected, "case a")


def test_a_true_field_is_not_doubted():
    doubt(mean_field())
    assert wake_speed_m_s(0.027, 9.8, 1.2, 4, R) == pytest.approx(8.14, abs=0.01)


def scaled(field: VelocityField, **factors: float) -> VelocityField:
    """The field with these of its arrays multiplied."""
    return dataclasses.replace(field, **{n: k * getattr(field, n) for n, k in factors.items()})


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda f: scaled(f, vy_m_s=-1), "is flipped against its axis.*\n.*v_sign = -1"),
        (
            lambda f: scaled(f, vx_m_s=-1, vy_m_s=-1),
            "moves along thrust, at 6.* m/s\n.*turn `thrust` round",
        ),
        (lambda f: scaled(f, vx_m_s=1e3, vy_m_s=1e3), "velocity_unit, .*mm/s written as m/s"),
        (lambda f: scaled(f, vx_m_s=0.02, vy_m_s=0.02), "0.019 times the 8 m/s of the hovering"),
        (lambda f: scaled(f, x_m=1e-3, y_m=1e-3), "the cut 46 mm below the rotor plane has no"),
        (
            lambda f: dataclasses.replace(f, y_m=f.y_m + 0.2),
            "the field spans x = -70 to 70 mm and y = 144 to 230 mm",
        ),
        # the wake then blows sideways, and next to nothing goes through the cut
        (
            lambda f: dataclasses.replace(f, vx_m_s=f.vy_m_s, vy_m_s=f.vx_m_s),
            r"through the cut .*\n.*components swapped\?",
        ),
    ],
)
def test_wrong_signs_units_and_swaps_are_caught(spoil, says):
    with pytest.raises(InputRefused, match=says):
        doubt(spoil(mean_field()))
