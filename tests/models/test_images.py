"""Laws of the ground models: limits, symmetries, and the image sum done again by brute force."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearlift.models.images import (
    CHEESEMAN_BENNETT,
    CHEESEMAN_BENNETT_CONSTANT_POWER,
    CHEESEMAN_BENNETT_THEORY,
    CORRIDOR,
    IMAGES,
    IMAGES_EDGE,
    IMAGES_TILTED,
    SANCHEZ_CUEVAS,
    SANCHEZ_CUEVAS_AS_PRINTED,
    SANCHEZ_CUEVAS_FREE_EXPONENT,
    corridor_cancelled,
    gain,
    image,
    image_share,
    level_cancelled,
    square,
    tilted_cancelled,
)

Z = np.geomspace(0.4, 40, 60)
spacing = st.floats(2.0, 8.0)
height = st.floats(0.6, 30.0)
strength = st.floats(-5.0, 8.0)


def cancelled_by_brute_force(z_hat, layout, tilt_rad=0.0):
    """Each rotor's cancelled inflow from sources mirrored one by one in a plane in space, in the
    rotors' frame.

    A rotor far from the boundary draws v through its disk; its image is a point source of flux pi
    R^2 v, whose velocity at a distance s is flux / (4 pi s^2). Counted along the rotor's axis, per
    unit of v and R.
    """
    normal = np.array([math.sin(tilt_rad), 0.0, math.cos(tilt_rad)])
    out = []
    for xi, yi in layout:
        rotor, total = np.array([xi, yi, 0.0]), 0.0
        for xj, yj in layout:
            source = np.array([xj, yj, 0.0])
            mirrored = source - 2 * (source @ normal + z_hat) * normal
            away = rotor - mirrored
            total += math.pi / (4 * math.pi) * away[2] / np.linalg.norm(away) ** 3
        out.append(total)
    return np.array(out)


# --- the images of any layout


@given(
    z=height,
    positions=st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=1, max_size=6),
)
def test_formula_is_the_sum_of_mirrored_sources(z, positions):
    np.testing.assert_allclose(
        level_cancelled(z, layout_hat=positions),
        cancelled_by_brute_force(z, positions),
        rtol=1e-10,
    )


@given(
    z=st.floats(1.5, 20),
    tilt=st.floats(-0.2, 0.2),
    positions=st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4)), min_size=1, max_size=5),
)
def test_tilted_formula_is_the_sum_of_mirrored_sources(z, tilt, positions):
    got = tilted_cancelled(z, layout_hat=positions, tilt_rad=tilt)
    np.testing.assert_allclose(got, cancelled_by_brute_force(z, positions, tilt), rtol=1e-9)


def test_one_rotor_is_cheeseman_and_bennett():
    np.testing.assert_allclose(
        IMAGES(Z, layout_hat=((0.0, 0.0),)), CHEESEMAN_BENNETT_THEORY(Z), rtol=1e-13
    )


@given(d=spacing)
def test_square_is_sanchez_cuevas_without_fountain(d):
    without = SANCHEZ_CUEVAS(Z, spacing_hat=d, diagonal_hat=math.sqrt(2) * d, K_b=0.0)
    np.testing.assert_allclose(IMAGES(Z, layout_hat=square(d)), without, rtol=1e-12)


@given(d=spacing, z=height)
def test_images_do_not_depend_on_where_the_layout_lies(d, z):
    layout = np.asarray(square(d))
    turn = np.array([[math.cos(0.7), -math.sin(0.7)], [math.sin(0.7), math.cos(0.7)]])
    np.testing.assert_allclose(
        IMAGES(z, layout_hat=layout @ turn + [3.0, -1.0]),
        IMAGES(z, layout_hat=layout),
        rtol=1e-12,
    )


@given(d=spacing, z=height)
def test_every_further_rotor_adds_lift(d, z):
    gains = [float(IMAGES(z, layout_hat=square(d)[:n])) for n in range(1, 5)]
    assert all(a < b for a, b in itertools.pairwise(gains))


# --- tilted planes


@given(d=spacing, z=st.floats(1.5, 10))
def test_no_tilt_is_the_flat_boundary(d, z):
    assert float(IMAGES_TILTED(z, layout_hat=square(d), tilt_rad=0.0)) == pytest.approx(
        float(IMAGES(z, layout_hat=square(d))), rel=1e-13
    )


@given(d=st.floats(2, 4), z=st.floats(1.5, 10), tilt=st.floats(0.001, 0.15))
def test_tilting_a_symmetric_layout_either_way_is_the_same(d, z, tilt):
    layout = square(d)
    assert float(IMAGES_TILTED(z, layout_hat=layout, tilt_rad=tilt)) == pytest.approx(
        float(IMAGES_TILTED(z, layout_hat=layout, tilt_rad=-tilt)), rel=1e-12
    )
    one, other = (
        gain(tilted_cancelled(z, layout_hat=layout, tilt_rad=tilt)),
        gain(tilted_cancelled(z, layout_hat=layout, tilt_rad=-tilt)),
    )
    np.testing.assert_allclose(one, other[[1, 0, 3, 2]], rtol=1e-12)


@pytest.mark.parametrize(("z", "larger"), [(1.14, 1.18), (2.0, 1.35), (4.0, 1.46)])
def test_levelling_moment_counts_the_inflow_along_the_axis(z, larger):
    layout = np.array(square(65 / 23))
    tilt = 1e-3
    heights = z + layout[:, 0] * math.sin(tilt)
    apart = np.hypot(*(layout[:, None] - layout).transpose(2, 0, 1))
    normal = 1 / (1 - image(np.add.outer(heights, heights), apart).sum(axis=-1))
    axial = gain(tilted_cancelled(z, layout_hat=layout, tilt_rad=tilt))
    assert (axial @ layout[:, 0]) / (normal @ layout[:, 0]) == pytest.approx(larger, abs=6e-3)
    assert axial.mean() == pytest.approx(normal.mean(), rel=1e-6)


def test_mean_effect_of_tilt_is_of_second_order():
    one, two = (
        float(IMAGES_TILTED(1.5, layout_hat=square(2.83), tilt_rad=t))
        - float(IMAGES(1.5, layout_hat=square(2.83)))
        for t in (0.01, 0.02)
    )
    assert two / one == pytest.approx(4, rel=0.02)


def test_rotor_in_the_boundary_has_no_ratio():
    gains = gain(tilted_cancelled(0.3, layout_hat=((0.0, 0.0), (-8.0, 0.0)), tilt_rad=0.1))
    assert np.isnan(gains).any()
    assert np.isnan(IMAGES_TILTED(0.3, layout_hat=((0.0, 0.0), (-8.0, 0.0)), tilt_rad=0.1))


# --- partial ground


def counted(edge, z, along=0.0, across=0.0):
    """Share of an image up to the edge, from sources counted one by one over the boundary."""
    step = np.sinh(6 * np.linspace(-1, 1, 401)) / math.sinh(6) * 40 * math.hypot(z, along, across)
    x, y = np.meshgrid(step, step, indexing="ij")
    area = np.outer(np.gradient(step), np.gradient(step))
    to = (np.hypot(x - s * along / 2, y - s * across / 2) ** 2 + z**2 for s in (1, -1))
    weight = area / math.prod(to) ** 1.5
    return weight[x <= edge].sum() / weight.sum()


@pytest.mark.parametrize("edge", [-2.0, -0.5, 0.0, 0.7, 3.0])
@pytest.mark.parametrize("z", [0.5, 1.0, 3.0])
def test_own_image_is_the_sum_over_the_boundary_that_is_there(edge, z):
    assert image_share(edge, 2 * z, 0.0) == pytest.approx(counted(edge, z), abs=6e-3)
    assert image_share(edge, 2 * z, 0.0) + image_share(-edge, 2 * z, 0.0) == pytest.approx(1)


@pytest.mark.parametrize(("z", "off"), [(0.5, 0.0045), (1.0, 0.0025), (2.0, 0.001)])
def test_a_vehicle_at_an_edge_is_off_by_what_the_model_says(z, off):
    layout = square(65 / 23)
    for edge in (-3.0, -1.0, 0.0, 1.0, 2.0):
        sums = [
            sum(
                image(2 * z, math.dist(i, j))
                * counted(edge - (i[0] + j[0]) / 2, z, j[0] - i[0], j[1] - i[1])
                for j in layout
            )
            for i in layout
        ]
        exact = np.mean([1 / (1 - s) for s in sums])
        assert IMAGES_EDGE(z, layout_hat=layout, edge_hat=edge) == pytest.approx(exact, abs=off)


@given(z=height)
def test_an_edge_far_away_is_the_whole_ground_and_one_far_behind_is_none(z):
    layout = square(2.83)
    whole = float(IMAGES(z, layout_hat=layout))
    for edge, expected in ((np.inf, whole), (1e4, whole), (-1e4, 1.0)):
        assert IMAGES_EDGE(z, layout_hat=layout, edge_hat=edge) == pytest.approx(expected, abs=1e-6)
    part = [float(IMAGES_EDGE(z, layout_hat=layout, edge_hat=e)) for e in np.linspace(-9, 9, 19)]
    assert (np.diff(part) > 0).all()
    assert 1 < part[0] < part[-1] < whole


# --- ground and ceiling at once


@settings(max_examples=15)
@given(z=st.floats(0.5, 3.0), more=st.floats(0.3, 4.0), d=spacing, kappa=st.floats(0, 1))
def test_a_corridor_is_every_image_mirrored_one_by_one(z, more, d, kappa):
    gap, layout = z + more, square(d)
    cancelled = 0.0
    for ceiling in (False, True):
        height, sense, weight = z, -1.0, 1.0
        for n in range(60):
            # in the plane that did not make it last; a mirror turns the way that it blows round
            height, sense = (2 * gap - height if ceiling else -height), -sense
            weight *= kappa if ceiling else 1.0
            apart = [image(abs(height - z), math.dist(layout[0], j)) for j in layout]
            # of an alternating sum the last counts by half
            cancelled += sense * weight * float(np.sum(apart)) * (0.5 if n == 59 else 1.0)
            ceiling = not ceiling
    got = corridor_cancelled(z, layout_hat=layout, gap_hat=gap, kappa=kappa)
    assert got == pytest.approx(np.full(4, cancelled), abs=2e-4 / gap**2)


@given(z=height, d=spacing, kappa=st.floats(0, 1))
def test_a_gap_without_end_or_no_ceiling_is_the_ground(z, d, kappa):
    ground = float(IMAGES(z, layout_hat=square(d)))
    wide = CORRIDOR(z, layout_hat=square(d), gap_hat=1e4, kappa=kappa)
    none = CORRIDOR(z, layout_hat=square(d), gap_hat=z + 1, kappa=0.0)
    assert [wide, none] == pytest.approx([ground, ground], nan_ok=True, abs=1e-6)


def test_between_two_mirrors_up_and_down_are_alike_and_the_middle_gains_least():
    z = np.linspace(0.5, 3.5, 61)
    between = CORRIDOR(z, layout_hat=square(2.83), gap_hat=4.0, kappa=1.0)
    np.testing.assert_allclose(between, between[::-1], rtol=2e-5)
    assert np.argmin(between) == 30
    one = CORRIDOR(z, layout_hat=((0.0, 0.0),), gap_hat=4.0, kappa=1.0)
    s = (math.pi / 4) ** 2 * (1 / np.sin(math.pi * z / 4) ** 2 - 1 / 3) / 16
    np.testing.assert_allclose(one, 1 / (1 - s), rtol=1e-5)


def test_a_corridor_has_no_ratio_at_its_ceiling_or_beyond_and_free_air_is_free():
    known = {"layout_hat": square(2.83), "gap_hat": 4.0}
    got = CORRIDOR(np.array([2.0, 4.0, 5.0, np.inf]), **known)
    np.testing.assert_array_equal(np.isnan(got), [False, True, True, False])
    assert got[3] == 1.0


# --- Sanchez-Cuevas


def test_distant_rotors_leave_cheeseman_and_bennett():
    alone = SANCHEZ_CUEVAS(Z, spacing_hat=1e6, diagonal_hat=1e6)
    np.testing.assert_allclose(alone, CHEESEMAN_BENNETT_THEORY(Z), rtol=1e-10)


@given(d=spacing, z=height)
def test_fountain_term_is_four_images_at_the_diagonal(d, z):
    b = math.sqrt(2) * d
    one = (
        cancelled_by_brute_force(z, [(0.0, 0.0), (b, 0.0)])[0]
        - cancelled_by_brute_force(z, [(0.0, 0.0)])[0]
    )
    left = [SANCHEZ_CUEVAS.downwash(z, spacing_hat=d, diagonal_hat=b, K_b=k) for k in (0.0, 1.0)]
    fountain = left[0] - left[1]
    assert fountain == pytest.approx(4 * one, rel=1e-9)


@given(d=spacing, z=height, K_b=strength)
def test_equation_as_published(d, z, K_b):
    """The equation typed a second time, term by term, in dimensional form (R = 23 mm)."""
    R, b = 0.023, math.sqrt(2) * d
    D, B, H = R * d, R * b, R * z
    s = (
        (R / (4 * H)) ** 2
        + R**2 * H / math.sqrt((D**2 + 4 * H**2) ** 3)
        + R**2 / 2 * H / math.sqrt((2 * D**2 + 4 * H**2) ** 3)
    )
    s += 2 * R**2 * K_b * H / math.sqrt((B**2 + 4 * H**2) ** 3)
    got = float(SANCHEZ_CUEVAS(z, spacing_hat=d, diagonal_hat=b, K_b=K_b))
    assert got == pytest.approx(1 / (1 - s), rel=1e-10) if s < 1 else math.isnan(got)


@given(d=spacing, z=height, K_b=st.floats(0.05, 20))
def test_equation_as_printed(d, z, K_b):
    s = (
        1 / (16 * z**2)
        + z / math.sqrt((d**2 + 4 * z**2) ** 3)
        + z / (2 * math.sqrt((2 * d**2 + 4 * z**2) ** 3))
    )
    s += z / (2 * K_b * math.sqrt((d**2 + 4 * z**2) ** 3))
    got = float(SANCHEZ_CUEVAS_AS_PRINTED(z, spacing_hat=d, inverse_K_b=1 / K_b))
    assert got == pytest.approx(1 / (1 - s), rel=1e-10) if s < 1 else math.isnan(got)


# --- poles and exponents


@given(k=st.floats(0.1, 15))
def test_pole_is_refused_and_approached_from_above(k):
    pole = math.sqrt(k) / 4
    assert np.isnan(CHEESEMAN_BENNETT(0.999 * pole, k=k))
    assert float(CHEESEMAN_BENNETT(1.001 * pole, k=k)) > 400


@given(z=height, n=st.floats(0.1, 2), K_b=strength)
def test_free_exponent_is_the_power_of_the_base(z, n, K_b):
    layout = {"spacing_hat": 2.83, "diagonal_hat": 4.0}
    base = float(SANCHEZ_CUEVAS(z, **layout, K_b=K_b))
    assert float(SANCHEZ_CUEVAS_FREE_EXPONENT(z, **layout, K_b=K_b, n=n)) == pytest.approx(
        base**n, rel=1e-12, nan_ok=True
    )


def test_constant_power_gains_less_than_constant_inflow():
    np.testing.assert_allclose(
        CHEESEMAN_BENNETT_CONSTANT_POWER(Z) ** 1.5, CHEESEMAN_BENNETT(Z), rtol=1e-12
    )


def test_downwash_and_lift_are_reciprocal_where_the_inflow_is_unchanged():
    arguments = {"spacing_hat": 2.83, "diagonal_hat": 4.0, "K_b": 2.0}
    np.testing.assert_allclose(
        SANCHEZ_CUEVAS.downwash(Z, **arguments) * SANCHEZ_CUEVAS(Z, **arguments),
        1.0,
        rtol=1e-12,
    )
