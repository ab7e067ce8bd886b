"""Effects have the sizes and signs that the bench's physics gives them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from nearlift.declare import Effect, compose
from nearlift.effects import EFFECTS
from nearlift.effects.gain import density
from nearlift.models.images import CHEESEMAN_BENNETT, IMAGES, IMAGES_TILTED, SANCHEZ_CUEVAS, square
from nearlift.models.momentum import HSIAO_CHIRARATTANANON
from nearlift.models.sidewall import SIDEWALL_DECAY

R = 0.023
GEOMETRY = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}
LAYOUT = np.array(square(65 / 23))


def effect(name: str) -> Effect:
    return next(e for e in EFFECTS if e.name == name)


def ground(z_hat: Any, *names: str, **values: Any) -> Any:
    both = compose(SANCHEZ_CUEVAS, *(effect(n) for n in names))
    return both(z_hat, **GEOMETRY, **values)


def ceiling(z_hat: Any, *names: str, **values: Any) -> Any:
    return compose(HSIAO_CHIRARATTANANON, *(effect(n) for n in names))(z_hat, **values)


@pytest.mark.parametrize(
    ("at", "z_hat", "percent_per_mm", "within"),
    [
        *((ground, z, slope, 0.005) for z, slope in ((1.14, 0.43), (1.5, 0.26), (2.0, 0.19))),
        *(
            (ceiling, z, slope, 0.02 * slope)
            for z, slope in ((0.1, 74.0), (0.2, 17.0), (0.3, 6.5), (0.5, 1.8))
        ),
    ],
)
def test_datum_error(at: Any, z_hat: float, percent_per_mm: float, within: float) -> None:
    step = 1e-7
    more, less = (at(z_hat, "height_offset", radius_m=R, offset_m=s) for s in (step, -step))
    assert (less - more) / (2 * step) * 1e-3 * 100 == pytest.approx(percent_per_mm, abs=within)


def test_datum_error_of_a_sidewall_is_its_amplitude() -> None:
    gap = np.linspace(0.1, 3.0, 9)
    shifted = compose(SIDEWALL_DECAY, effect("height_offset"))(
        gap, radius_m=R, offset_m=1e-3, a=0.05, lambda_=0.4
    )
    np.testing.assert_allclose(
        shifted,
        SIDEWALL_DECAY(gap, a=0.05 * np.exp(-1e-3 / R / 0.4), lambda_=0.4),
        rtol=1e-14,
    )


def test_height_scale_under_a_ceiling_is_alpha() -> None:
    z_hat = np.geomspace(0.1, 5.0, 9)
    np.testing.assert_allclose(
        ceiling(z_hat, "height_scale", z_scale=0.02),
        ceiling(z_hat, alpha=0.125 / 1.02**2),
        rtol=1e-14,
    )


def test_backlash_splits_the_branches_by_a_tenth_at_the_nearest_ceiling_station() -> None:
    both = ceiling(
        0.1, "approach_backlash", radius_m=R, approach=np.array([-1.0, 1.0]), backlash_m=0.3e-3
    )
    middle = ceiling(0.1)
    assert (both[0] - middle) / middle == pytest.approx(0.06, abs=0.02)
    assert both[0] > middle > both[1]
    low = ground(
        1.14, "approach_backlash", radius_m=R, approach=np.array([-1.0, 1.0]), backlash_m=0.3e-3
    )
    assert low[0] - low[1] < 0.002


def test_viscous_gap_takes_the_quoted_share_at_the_nearest_ceiling_station() -> None:
    assert ceiling(0.1) == pytest.approx(2.337, abs=5e-4)
    assert ceiling(0.1, "near_wall_saturation", gap_hat2=0.15**2) == pytest.approx(1.60, abs=5e-3)
    # the height form that it stands for
    z_hat = np.geomspace(0.1, 3.0, 20)
    height_form = ceiling(np.hypot(z_hat, 0.15))
    np.testing.assert_allclose(
        ceiling(z_hat, "near_wall_saturation", gap_hat2=0.15**2), height_form, rtol=0.025
    )
    assert (
        np.diff(ceiling(z_hat) / ceiling(z_hat, "near_wall_saturation", gap_hat2=0.15**2)) < 0
    ).all()


def test_suckdown_loses_and_stagnation_gains_close_to_the_ground_only() -> None:
    z_hat = np.array([0.5, 1.0, 3.0, 11.5])
    change = ground(z_hat, "airframe_stagnation", stagnation=0.02) - ground(z_hat)
    np.testing.assert_allclose(change, 0.02 / z_hat**2, rtol=1e-9)
    assert change[-1] < 2e-4
    np.testing.assert_allclose(
        ground(z_hat, "airframe_stagnation", stagnation=-0.02) - ground(z_hat), -change, rtol=1e-9
    )
    held = effect("airframe_stagnation").evaluate(
        np.ones(2), z_hat=np.array([0.05, 0.2]), stagnation=0.02, stagnation_power=2.0
    )
    np.testing.assert_allclose(held, 1.5)


def test_the_fountain_peaks_where_it_says_and_is_gone_at_contact_and_far_away() -> None:
    z_hat = np.geomspace(0.05, 60.0, 4001)
    bump = ground(
        np.maximum(z_hat, 0.6), "fountain_shape", fountain=0.02, fountain_height=0.55
    ) - ground(np.maximum(z_hat, 0.6))
    assert z_hat[np.argmax(bump)] == pytest.approx(0.55 * 65 / 23, rel=2e-3)
    alone = (
        effect("fountain_shape")(1.0, z_hat=z_hat[[0, -1]], spacing_hat=65 / 23, fountain=0.02)
        - 1.0
    )
    assert np.abs(alone).max() < 1e-8


def test_image_strength_is_the_coefficient_of_a_single_rotor_exactly() -> None:
    z_hat = np.geomspace(0.5, 10.0, 9)
    scaled = compose(CHEESEMAN_BENNETT, effect("image_strength"))(z_hat, strength=1.4)
    np.testing.assert_allclose(scaled, CHEESEMAN_BENNETT(z_hat, k=1.4), rtol=1e-13)


def test_image_strength_beside_a_free_fountain_scales_the_images_alone() -> None:
    z_hat = np.geomspace(0.8, 10.0, 9)
    only_images = IMAGES(z_hat, layout_hat=LAYOUT)
    scaled = ground(z_hat, "image_strength", strength=1.2, K_b=0.0)
    np.testing.assert_allclose(1 - 1 / scaled, 1.2 * (1 - 1 / only_images), rtol=1e-12)


def test_a_large_plate_costs_little() -> None:
    z_hat = np.array([1.14, 1.7, 3.0])
    lost = 1 - (ground(z_hat, "plate_edge", edge_share=1.0, edge_width_hat=8 / 2) - 1) / (
        ground(z_hat) - 1
    )
    np.testing.assert_allclose(lost, [0.000, 0.004, 0.169], atol=1e-3)


def test_tilt_follows_the_sum_over_images_to_second_order() -> None:
    z_hat = np.array([1.0, 1.5, 2.0, 3.0])
    tilt_rad = np.deg2rad(5.0)
    flat = IMAGES(z_hat, layout_hat=LAYOUT)
    tilted = IMAGES_TILTED(z_hat, layout_hat=LAYOUT, tilt_rad=tilt_rad)
    needed = (tilted - flat) / (flat - 1) / tilt_rad**2 * z_hat**2
    # the inflow counts along the tilted axis: a cosine, at every distance
    distances = needed + 0.5 * z_hat**2
    assert (distances > 3.4).all()
    assert (distances < 5.1).all()
    both = compose(IMAGES, effect("tilt"))
    for sign in (-1, 1):
        got = both(z_hat, layout_hat=LAYOUT, tilt_rad=sign * tilt_rad, tilt_second=needed)
        np.testing.assert_allclose(got, tilted, rtol=1e-12)


def test_tilt_about_a_point_off_centre_changes_sign_with_tilt() -> None:
    z_hat, off_centre_hat, tilt_rad = 2.0, 0.2, np.deg2rad(2.0)
    moved = (
        ground(z_hat - off_centre_hat * tilt_rad) - ground(z_hat + off_centre_hat * tilt_rad)
    ) / 2
    first = moved / (ground(z_hat) - 1) / tilt_rad
    got = ground(z_hat, "tilt", tilt_rad=tilt_rad, tilt_first=first, tilt_decay=0.0) - ground(
        z_hat, "tilt", tilt_rad=-tilt_rad, tilt_first=first, tilt_decay=0.0
    )
    assert got == pytest.approx(2 * moved, rel=1e-9)
    assert abs(first) < 1.5


def test_recirculation_takes_the_quoted_share_of_free_air() -> None:
    room = effect("room_recirculation")
    for inflow, loss in ((0.1, 0.009), (0.3, 0.026)):
        free = room(
            1.0, z_hat=np.inf, throttle=0.6, throttle_ref=0.6, recirculation=0.35 * inflow / 4.07
        )
        assert 1 - free == pytest.approx(loss, abs=5e-4)
    near, far = room(
        1.0, z_hat=np.array([1.0, 10.0]), throttle=0.6, throttle_ref=0.6, recirculation=0.02
    )
    assert near > far


@pytest.mark.parametrize(
    ("celsius", "pressure_Pa", "humidity", "rho"),
    [
        (20, 101325, 0.5, 1.1988),
        (25, 101325, 0.5, 1.1769),
        (15, 101325, 0.5, 1.2211),
        (20, 99000, 0.5, 1.1712),
    ],
)
def test_density_of_moist_air(
    celsius: float, pressure_Pa: float, humidity: float, rho: float
) -> None:
    assert density(celsius + 273.15, pressure_Pa, humidity) == pytest.approx(rho, abs=6e-5)


@pytest.mark.parametrize(
    ("change", "percent"),
    [
        ({"temperature_K": 298.15}, -1.8),
        ({"pressure_Pa": 99000.0}, -2.3),
        ({"humidity": 0.9}, -0.4),
        ({"humidity": 0.0}, 0.4),
    ],
)
def test_sizes_of_air_density(change: dict[str, float], percent: float) -> None:
    standard = {
        "temperature_K": 293.15,
        "pressure_Pa": 101325.0,
        "humidity": 0.5,
        "temperature_ref_K": 293.15,
        "pressure_ref_Pa": 101325.0,
    }
    lift = effect("air_density")(1.0, **(standard | change), density_exponent=1.0)
    assert 100 * (lift - 1) == pytest.approx(percent, abs=0.06)


def test_a_tare_error_matters_most_at_low_throttle() -> None:
    change = ground(
        1.14, "zero_offset", lift_inf_N=np.array([0.107, 0.551]), zero_N=0.002
    ) - ground(1.14)
    assert change[0] > change[1] > 0
