"""Faults that only the whole campaign shows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.unit.manifests import manifest

from nearlift.errors import InputRefused
from nearlift.reduction import judge

FAR = {0.25: 0.107, 0.5: 0.239, 0.75: 0.409, 0.92: 0.551}


def rows(values: list[tuple[str, float, float, float]], **changes: Any) -> dict[str, Any]:
    """Columns of trials: boundary, z_hat, throttle, lift."""
    side, z, throttle, lift = zip(*values, strict=True)
    return {
        "boundary": np.array(side, dtype=object),
        "z_hat": np.array(z),
        "throttle": np.array(throttle),
        "lift_N": np.array(lift, dtype=float),
        "quality": np.full(len(lift), "", dtype=object),
    } | changes


def table(factor: float = 1.0, **changes: Any) -> dict[str, Any]:
    """Two stations at each throttle, the near one with more lift."""
    return rows(
        [
            ("ground", z, t, factor * lift * gain)
            for t, lift in FAR.items()
            for z, gain in ((2.0, 1.1), (20.0, 1.0))
        ],
        **changes,
    )


def lifts(lift: list[float], quality: list[str] | None = None) -> dict[str, Any]:
    """Trials at one place."""
    codes = np.array(quality or [""] * len(lift), dtype=object)
    return rows([("ground", 10.0, 0.5, x) for x in lift], quality=codes)


def repeated(far: dict[float, float], repeats: int, noise: float) -> dict[str, Any]:
    rng = np.random.default_rng(5)
    return rows(
        [
            ("ground", 2.0, t, lift * (1 + noise * rng.standard_normal()))
            for t, lift in far.items()
            for _ in range(repeats)
        ]
    )


def in_unit(unit: str) -> Any:
    gain = {"gain": "0.0098 mN/count", "offset": "120 count"} if unit == "count" else None
    force = {"column": "force", "unit": unit, "sign": 1}
    return manifest(records={"force": force | ({"calibration": gain} if gain else {})})


@pytest.mark.parametrize(
    ("factor", "unit", "match"),
    [
        (
            1 / 9.80665e-3,
            "N",
            r'212 times the weight of 0\.2646 N\n  is the unit "gf" \(2\.1 times the weight\)',
        ),
        (1e3, "N", r'2.08e\+03 times the weight.*\n  is the unit "mN" \(2\.1 times the weight\)'),
        (1e3, "count", "check the calibration's gain .off by about 2.1e.03"),
        (1e9, "N", "no usual unit makes sense of it"),
        (
            1 / 9.80665,
            "mN",
            r'at 92 % throttle .* 0\.212 times the weight.*\n  is the unit "gf" \(2\.1 times',
        ),
        (-1.0, "N", r"far from the ground at 92 % .* is negative.*\n.*change the sign"),
    ],
)
def test_a_force_that_cannot_be_this_vehicles_is_refused(
    factor: float, unit: str, match: str
) -> None:
    with pytest.raises(InputRefused, match=match):
        judge.against_weight(table(factor), in_unit(unit))
    free = table(1e3, boundary=np.array(["none"] * 8, dtype=object))
    with pytest.raises(InputRefused, match="in free air"):
        judge.against_weight(free, in_unit("N"))


def test_a_possible_lift_passes_and_rejected_trials_do_not_judge() -> None:
    """From one rotor of eight to a racing quadrotor; slow rotors may lift little."""
    slow, bad = table(0.02), table()
    slow["throttle"] *= 0.5
    bad["lift_N"][-1], bad["quality"][-1] = 1e6, "SATURATED"
    none = table(quality=np.array(["STUCK"] * 8, dtype=object))
    for trials in (table(0.15), table(), table(6.5), slow, bad, none):
        judge.against_weight(trials, in_unit("N"))
    assert "which is unusual" in judge.against_weight(lifts([3.9, 3.8]), in_unit("mN"))[0]
    assert judge.against_weight(lifts([0.41, 0.42]), in_unit("mN")) == []


@pytest.mark.parametrize(
    ("unsettled", "cell", "said"),
    [
        (3, {}, "Is `tare` or `settle` too short"),
        (0, {"range": None, "accuracy": "1.5 gf"}, "counts for nothing without `range`"),
        (1, {"range": "100 gf", "accuracy": "4.9 gf"}, ""),
    ],
)
def test_unsettled_records_and_an_accuracy_without_a_range_are_noted(
    unsettled: int, cell: dict[str, Any], said: str
) -> None:
    codes = ["unsettled"] * unsettled + [""] * (4 - unsettled)
    trials = lifts([0.41] * 4, codes) | {"visit": np.arange(4), "trial": np.arange(4)}
    notes = judge.judge(trials, manifest(load_cell=cell))
    assert said in "".join(notes)
    assert bool(said) == bool(notes)


def test_lift_that_does_not_rise_is_named() -> None:
    assert judge.not_rising(table()) == []
    flat = table()
    flat["lift_N"][(flat["z_hat"] == 20) & (flat["throttle"] == 0.92)] = FAR[0.75]
    assert judge.not_rising(flat) == [("ground", 0.75, 0.92, FAR[0.75], FAR[0.75])]


@pytest.mark.parametrize(
    ("samples", "before", "after", "planned"),
    [
        (1000, [], [], []),
        (999, [], [], ["short"]),
        (960, ["truncated"], ["truncated"], ["truncated", "short"]),
        (900, ["truncated"], ["truncated", "SHORT"], ["truncated", "SHORT"]),
        (900, [], ["short"], ["SHORT"]),
        (499, [], ["SHORT"], ["SHORT"]),
        (0, ["EMPTY"], ["EMPTY"], ["EMPTY"]),
    ],
)
def test_lengths_are_judged_by_the_median_or_by_the_plan(
    samples: int, before: list[str], after: list[str], planned: list[str]
) -> None:
    counts = np.array([1000, 1000, 1000, samples])
    plan = manifest(load_cell={"record": "5 s"})
    for campaign, codes in ((manifest(), after), (plan, planned)):
        given: list[list[str]] = [[], [], [], list(before)]
        judge.check_lengths({"n": counts, "samples": counts}, given, campaign)
        assert given == [[], [], [], codes]
    with pytest.raises(InputRefused, match=r"900 samples .*\n.* is the rate 180 Hz\?"):
        judge.check_lengths({"samples": np.array([900, 900])}, [[], []], plan)


@pytest.mark.parametrize(
    ("u_zero", "stuck"),
    # noise in every other tare; a quiet scale that flips a code now and then; no tares
    [([0.04, 0, 0.05, 0.04], [1]), ([1e-4, 0, 0, 1e-4], []), ([0, 0, 0, 0], [])],
)
def test_a_constant_tare_among_noisy_ones_is_stuck(u_zero: list[float], stuck: list[int]) -> None:
    codes: list[list[str]] = [[] for _ in u_zero]
    columns = {"n": np.full(4, 160), "u_zero_N": np.array(u_zero), "u_lift_N": np.full(4, 0.07)}
    judge.mark_constant_tares(columns, codes)
    assert [i for i, names in enumerate(codes) if names == ["STUCK"]] == stuck


def test_a_record_of_another_trial_is_named() -> None:
    columns = {
        "source_sha256": np.array(["a", "b", "a"], dtype=object),
        "lift_N": np.array([0.2, 0.3, 0.2]),
        "sd_N": np.ones(3),
        "u_lift_N": np.full(3, 0.01),
        "drift_N_s": np.zeros(3),
        "n": np.full(3, 1000),
    }
    codes: list[list[str]] = [[], [], []]
    owners = np.array(["t1", "t2", "t3"], dtype=object)
    notes = judge.record_codes(columns, codes, owners, manifest())
    assert notes == ["the record of t3 is that of t1, byte for byte"]
    assert codes == [[], [], ["DUPLICATE"]]


def test_a_record_saved_with_fewer_digits_is_that_of_the_other_trial() -> None:
    columns = {
        "source_sha256": np.array(["a", "b", "c"], dtype=object),
        "lift_N": np.array([0.2000001, 0.2, 0.20001]),
        "sd_N": np.array([0.1, 0.1000001, 0.1]),
        "u_lift_N": np.full(3, 0.001),
        "drift_N_s": np.array([0.0, 1e-8, 0.0]),
        "n": np.full(3, 1000),
    }
    codes: list[list[str]] = [[], [], []]
    owners = np.array(["t1", "t2", "t3"], dtype=object)
    notes = judge.record_codes(columns, codes, owners, manifest())
    assert notes == ["the record of t2 has the samples of t1, rounded"]
    assert codes == [[], ["DUPLICATE"], []]


def test_a_lift_of_another_throttle_is_marked_where_repeats_show_it() -> None:
    trials = repeated(FAR, 8, 0.01)
    assert not judge.other_throttle(trials)
    trials["throttle"][1] = 0.92
    assert judge.other_throttle(trials) == [1]
    # nor is a supply that sags a label, though the sagged lift lies nearer to a lower throttle's
    sagged = repeated({0.50: 0.239, 0.52: 0.249}, 8, 0.001)
    sagged["lift_N"][9] = 0.2425
    assert not judge.other_throttle(sagged)
    # one trial each says nothing, nor does a label where two throttles lift alike within the
    # scatter
    assert not judge.other_throttle(repeated(FAR, 1, 0.01))
    assert not judge.other_throttle(repeated({0.50: 0.239, 0.51: 0.241}, 20, 0.01))


def test_a_campaign_that_never_leaves_the_ground_is_named() -> None:
    near = table(z_hat=np.tile([0.9, 1.3], 4))
    assert judge.only_near(near) == [("ground", 1.3)]
    assert judge.only_near(table()) == []
    near["boundary"][0] = "none"
    assert judge.only_near(near) == []


def test_a_throttle_without_a_far_station_is_named_unless_free_air_has_it() -> None:
    near = table()
    near["z_hat"][(near["z_hat"] == 20) & (near["throttle"] == 0.5)] = 3.0
    assert judge.without_reference(near) == [("ground", 0.5, 3.0, 20.0)]
    near["boundary"][near["z_hat"] == 3.0] = "none"
    assert judge.without_reference(near) == []


@pytest.mark.parametrize(
    ("lift", "quality", "stopped"),
    [
        ([0.2, 0.21, 0.19, -0.0004, 0.000018, 0.0], [""] * 6, [3, 4, 5]),
        ([0.2, 0.21, np.nan, -1.0], ["", "", "NO_DATA", "SATURATED"], []),
    ],
)
def test_a_trial_without_lift_is_marked_unless_it_is_rejected_already(
    lift: list[float], quality: list[str], stopped: list[int]
) -> None:
    more = {"visit": np.arange(len(lift)), "trial": np.arange(len(lift))}
    trials = lifts(lift, quality) | more
    judge.judge(trials, manifest())
    assert [i for i, codes in enumerate(trials["quality"]) if "NO_LIFT" in codes] == stopped
