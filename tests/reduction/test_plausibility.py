"""What only the whole campaign shows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.unit.manifests import manifest

from nearlift.errors import InputRefused
from nearlift.reduction import plausibility

WEIGHT = 0.027 * 9.8
FAR = {0.25: 0.107, 0.5: 0.239, 0.75: 0.409, 0.92: 0.551}


def table(factor: float = 1.0, **changes: Any) -> dict[str, Any]:
    """Two stations at each throttle, the near one with more lift."""
    rows = [
        ("ground", z, t, factor * lift * gain, "")
        for t, lift in FAR.items()
        for z, gain in ((2.0, 1.1), (20.0, 1.0))
    ]
    names = ("boundary", "z_hat", "throttle", "lift_N", "quality")
    columns = {
        n: np.array(v, dtype=object if isinstance(v[0], str) else float)
        for n, v in zip(names, zip(*rows, strict=True), strict=True)
    }
    return {**columns, **changes}


def test_far_lifts_are_those_of_the_farthest_station() -> None:
    throttles, lifts = plausibility.far_lifts(table())["ground"]
    np.testing.assert_allclose(throttles, list(FAR))
    np.testing.assert_allclose(lifts, list(FAR.values()))


def test_rejected_trials_do_not_judge() -> None:
    bad = table()
    bad["lift_N"][-1] = 1e6
    bad["quality"][-1] = "SATURATED"
    plausibility.against_weight(bad, WEIGHT, "N", "k")


@pytest.mark.parametrize(
    ("factor", "unit", "match"),
    [
        (
            1 / 9.80665e-3,
            "N",
            r'212 times the weight of 0\.2646 N\n  is the unit "gf" \(2\.1 times the weight\)',
        ),
        (1e3, "N", r'2.08e\+03 times the weight.*\n  is the unit "mN" \(2\.1 times the weight\)'),
        (9.80665e-3 / 9.80665, "kgf", r'is the unit .*"lbf".*rather than "kgf"|no usual unit'),
        (1e-3, "mN", r'0.00208 times the weight.*\n  is the unit "N"'),
        (1e3, "count", "check the calibration's gain .off by about 2.1e.03"),
        (1e9, "N", "no usual unit makes sense of it"),
        (9.80665, "gf", r'20\.4 times the weight.*\n  is the unit "mN" \(2\.1 times the weight\)'),
        (
            1 / 9.80665,
            "mN",
            (
                r'at 92 % throttle .* 0\.212 times the weight.*\n  is the unit "gf" \(2\.1 times'
                r" the weight\)"
            ),
        ),
    ],
)
def test_a_force_that_cannot_be_this_vehicles_is_refused(
    factor: float, unit: str, match: str
) -> None:
    with pytest.raises(InputRefused, match=match):
        plausibility.against_weight(table(factor), WEIGHT, unit, "records.force.unit")


@pytest.mark.parametrize(
    ("on", "value", "told"),
    [
        ("height", "10 m", "'datum': value = '10 m' is no less than the least distance, 46 mm"),
        ("height", "46.1 mm", "no less than the least distance"),
        ("height", "45.9 mm", ""),
        ("force", "0.61 N", "'datum': value = '0.61 N' is no less than the largest lift, 606 mN"),
        ("force", "0.6 N", ""),
        ("gain", "50 percent", ""),
    ],
)
def test_an_uncertainty_as_large_as_what_it_is_of_is_noted(on: str, value: str, told: str) -> None:
    part = {"name": "datum", "on": on, "value": value, "scope": "boundary"}
    notes = plausibility.overstated(table(), manifest(uncertainty=[part]))
    assert told in "".join(notes)
    assert bool(told) == bool(notes)


@pytest.mark.parametrize(
    ("cell", "told"),
    [
        (
            {"range": "100 gf", "accuracy": "20 gf"},
            "load_cell.accuracy = 196 mN is 20% of `range`, 981 mN, where cells have 0.02 to 1 %",
        ),
        ({"range": "100 gf", "accuracy": "4.9 gf"}, ""),
        (
            {"range": None, "accuracy": "1.5 gf"},
            (
                "load_cell.accuracy = 14.7 mN is that of the straight line at full range, and"
                " counts for nothing without `range`"
            ),
        ),
    ],
)
def test_a_load_cell_worse_than_any_is_noted_and_one_without_a_range(
    cell: dict[str, Any], told: str
) -> None:
    notes = plausibility.overstated(table(), manifest(load_cell=cell))
    assert told in "".join(notes)
    assert bool(told) == bool(notes)


@pytest.mark.parametrize("factor", [0.15, 1.0, 6.5])
def test_what_a_vehicle_may_lift_passes(factor: float) -> None:
    """From one rotor of eight to a racing quadrotor."""
    plausibility.against_weight(table(factor), WEIGHT, "N", "k")


def test_slow_rotors_may_lift_little() -> None:
    slow = table(0.02)
    plausibility.against_weight({**slow, "throttle": 0.5 * slow["throttle"]}, WEIGHT, "N", "k")


def test_a_wrong_sign_is_refused() -> None:
    with pytest.raises(
        InputRefused,
        match=r"far from the ground at 92 % throttle the lift is negative.*\n.*change the sign",
    ):
        plausibility.against_weight(table(-1.0), WEIGHT, "N", "k")


def test_free_air_judges_too() -> None:
    with pytest.raises(InputRefused, match="in free air"):
        plausibility.against_weight(
            table(1e3, boundary=np.array(["none"] * 8, dtype=object)), WEIGHT, "N", "k"
        )


def test_nothing_good_is_no_judge() -> None:
    plausibility.against_weight(
        table(quality=np.array(["STUCK"] * 8, dtype=object)), WEIGHT, "N", "k"
    )


def test_single_trials_beyond_reason() -> None:
    assert plausibility.implausible(np.array([0.3, 30.0, np.nan, -30.0]), WEIGHT).tolist() == [
        False,
        True,
        False,
        True,
    ]


def test_lift_that_does_not_rise_is_named() -> None:
    assert plausibility.not_rising(table()) == []
    flat = table()
    flat["lift_N"][(flat["z_hat"] == 20) & (flat["throttle"] == 0.92)] = FAR[0.75]
    assert plausibility.not_rising(flat) == [("ground", 0.75, 0.92, FAR[0.75], FAR[0.75])]


@pytest.mark.parametrize(
    ("samples", "before", "after"),
    [
        (1000, [], []),
        (960, ["truncated"], ["truncated"]),
        (900, ["truncated"], ["truncated", "SHORT"]),
        (900, [], ["short"]),
        (499, [], ["SHORT"]),
        (0, ["EMPTY"], ["EMPTY"]),
    ],
)
def test_lengths_are_judged_by_the_median(
    samples: int, before: list[str], after: list[str]
) -> None:
    codes: list[list[str]] = [[], [], [], list(before)]
    plausibility.lengths(np.array([1000, 1000, 1000, samples]), codes, 0.05)
    assert codes == [[], [], [], after]


def test_no_records_no_lengths() -> None:
    plausibility.lengths(np.array([0]), [[]], 0.05)


def repeated(far: dict[float, float], repeats: int, noise: float) -> dict[str, Any]:
    rng = np.random.default_rng(5)
    rows = [
        ("ground", 2.0, t, lift * (1 + noise * rng.standard_normal()), "")
        for t, lift in far.items()
        for _ in range(repeats)
    ]
    names = ("boundary", "z_hat", "throttle", "lift_N", "quality")
    return {
        n: np.array(v, dtype=object if isinstance(v[0], str) else float)
        for n, v in zip(names, zip(*rows, strict=True), strict=True)
    }


def test_a_lift_of_another_throttle_is_marked_where_repeats_show_it() -> None:
    trials = repeated(FAR, 8, 0.01)
    assert not plausibility.other_throttle(trials).any()
    trials["throttle"][1] = 0.92
    assert np.flatnonzero(plausibility.other_throttle(trials)).tolist() == [1]
    # nor is a supply that sags a label, though the sagged lift lies nearer to a lower throttle's
    sagged = repeated({0.50: 0.239, 0.52: 0.249}, 8, 0.001)
    sagged["lift_N"][9] = 0.2425
    assert not plausibility.other_throttle(sagged).any()
    # one trial each says nothing, nor does a label where two throttles lift alike within the
    # scatter
    assert not plausibility.other_throttle(repeated(FAR, 1, 0.01)).any()
    assert not plausibility.other_throttle(repeated({0.50: 0.239, 0.51: 0.241}, 20, 0.01)).any()


def test_a_campaign_that_never_leaves_the_ground_is_told_so() -> None:
    near = table(z_hat=np.tile([0.9, 1.3], 4))
    assert plausibility.only_near(near) == [("ground", 1.3)]
    assert plausibility.only_near(table()) == []
    near["boundary"][0] = "none"
    assert plausibility.only_near(near) == []


def lifts(lift, quality=None):
    n = len(lift)
    return {
        "boundary": np.full(n, "ground", dtype=object),
        "z_hat": np.full(n, 10.0),
        "throttle": np.full(n, 0.5),
        "lift_N": np.asarray(lift, dtype=float),
        "quality": np.asarray(quality if quality is not None else [""] * n, dtype=object),
    }


def test_a_lift_that_is_not_there_is_told_from_one_that_is():
    found = plausibility.without_lift(lifts([0.2, 0.21, 0.19, -0.0004, 0.000018, 0.0]))
    assert found.tolist() == [False, False, False, True, True, True]


def test_a_trial_rejected_for_another_reason_is_left_to_it():
    found = plausibility.without_lift(
        lifts([0.2, 0.21, np.nan, -1.0], ["", "", "NO_DATA", "SATURATED"])
    )
    assert not found.any()


def test_ten_times_the_weight_gets_a_note_and_a_usual_one_none():
    assert (
        "which is unusual"
        in plausibility.odd_weight(lifts([4.2, 4.1]), 0.265, "mN", "records.force.unit")[0]
    )
    assert plausibility.odd_weight(lifts([0.41, 0.42]), 0.265, "mN", "records.force.unit") == []


def test_a_campaign_of_unsettled_records_is_told_what_to_look_at():
    assert (
        "is `tare` or `settle` too short"
        in plausibility.mostly_unsettled(lifts([0.2] * 4, ["unsettled"] * 3 + [""]))[0]
    )
    assert plausibility.mostly_unsettled(lifts([0.2] * 4, ["unsettled"] + [""] * 3)) == []
