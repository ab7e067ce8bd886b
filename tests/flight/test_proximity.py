"""Height from lift: the inverse, its coverage, folds, the range of detection; products,
chapter and command.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.unit import quoted, small_run
from tests.unit.small_run import nearlift

from nearlift import catalogue
from nearlift.campaign.choices import LiftReading
from nearlift.errors import InputRefused
from nearlift.flight.proximity import BoundarySensor, grid, locate, ranges, read, refuse_folds
from nearlift.results.fit import FitResults
from nearlift.rounding import plain
from nearlift.stages import detect
from nearlift.stages.detect import DETECTION, PROXIMITY
from nearlift.stages.diagnose import DIAGNOSIS, quoted_lifts
from nearlift.stages.fit import RESULTS
from nearlift.stages.gathering import gather

CRAZYFLIE = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}
FAR = grid(0.8, 12.0)


def ground(z_hat, K_b=2.0):
    return catalogue.model("sanchez_cuevas")(z_hat, K_b=K_b, **CRAZYFLIE)


def wall(z_hat, a=0.05, lambda_=0.5):
    return 1 - a * np.exp(-z_hat / lambda_)


# ---- distance from a reading


def test_a_sharp_reading_is_inverted():
    for z_hat in (1.0, 1.5, 2.5):
        height, beyond = locate(float(ground(z_hat)), 5e-4, FAR, ground(FAR)[None])
        assert height.median == pytest.approx(z_hat, rel=0.02)
        assert height.lo90 <= z_hat <= height.hi90
        assert beyond < 1e-6
    # as wide as the reading's error over the model's slope
    slope = float(ground(2.51) - ground(2.49)) / 0.02
    assert height.hi90 - height.lo90 == pytest.approx(2 * 1.645 * 5e-4 / abs(slope), rel=0.15)
    draws = np.stack([ground(FAR, k) for k in np.linspace(1, 3, 21)])
    sure, unsure = (
        locate(float(ground(1.5)), 0.002, FAR, r)[0] for r in (ground(FAR)[None], draws)
    )
    assert unsure.hi90 - unsure.lo90 > 2 * (sure.hi90 - sure.lo90)


@pytest.mark.nightly
def test_intervals_hold_the_height_as_often_as_they_say():
    """Heights from the prior, models from their uncertainty, readings with noise: 90 % intervals of
    300; binomial sd 1.7 %.
    """
    rng = np.random.default_rng(5)
    low, high, u = 0.8, 6.0, 0.004
    near = grid(low, high)
    draws = np.stack([ground(near, k) for k in rng.normal(2, 0.3, 80)])
    held = 0
    for _ in range(300):
        z_hat = math.exp(rng.uniform(math.log(low), math.log(high)))
        measured = float(ground(z_hat, rng.normal(2, 0.3))) + u * rng.standard_normal()
        height, _ = locate(measured, u, near, draws)
        held += height.lo90 <= z_hat <= height.hi90
    assert 0.82 < held / 300 < 0.97


def test_a_reading_of_one_says_that_there_may_be_nothing():
    height, beyond = locate(1.0, 0.003, FAR, ground(FAR)[None])
    assert beyond > 0.5
    assert height.lo90 > 5
    # lift is L_inf to 0.1 %, and a ground within one radius gives 7 % more: both likelihoods
    # underflow
    near = grid(0.5, 1.0)
    height, beyond = locate(1.0, 0.001, near, 1 / (1 - 1 / (16 * near[None] ** 2)))
    assert beyond == pytest.approx(1.0)
    assert 0.99 < height.lo90 <= height.median <= height.hi90 <= 1.0


def test_refusals():
    def folded(z):
        return 1 + 0.2 * np.exp(-z) - 0.4 * np.exp(-3 * z)

    z_hat, near = grid(0.2, 10.0), grid(0.1, 10.0)
    flat, monotonic, fold = np.ones_like(z_hat), wall(z_hat), folded(z_hat)
    words = r"ground x: the model folds at z_hat = 0.8.*two heights\n.*above 0.8"
    for ratios in ([fold], [monotonic, flat, fold]):
        with pytest.raises(InputRefused, match=words):
            refuse_folds(z_hat, np.stack(ratios), "ground x")
    refuse_folds(grid(1.0, 10.0), folded(grid(1.0, 10.0))[None], "ground x")
    # a draw at a bound may be constant, the best estimate may not
    refuse_folds(z_hat, np.stack([monotonic, flat]), "sidewall")
    with pytest.raises(InputRefused, match="does not change with distance"):
        refuse_folds(z_hat, np.stack([flat, monotonic]), "wall")
    with pytest.raises(InputRefused, match=r"no value at z_hat = 0.2"):
        refuse_folds(near, catalogue.model("cheeseman_bennett_fixed")(near)[None], "ground")
    with pytest.raises(InputRefused, match="standard uncertainties from everything"):
        locate(2.0, 0.001, FAR, ground(FAR)[None])
    with pytest.raises(InputRefused, match="positive standard uncertainty"):
        locate(1.1, 0.0, FAR, ground(FAR)[None])


# ---- range


def test_range_is_where_the_model_gives_that_change():
    near = grid(0.02, 10.0)
    z_hat, lo90, hi90 = ranges(FAR, ground(FAR)[None], 0.03)
    assert float(ground(z_hat)) - 1 == pytest.approx(0.03, rel=1e-3)
    assert lo90 == hi90 == z_hat
    assert ranges(near, wall(near)[None], 0.02)[0] == pytest.approx(0.5 * math.log(2.5), rel=1e-3)
    assert np.isnan(ranges(near, wall(near)[None], 0.06)[0])
    assert ranges(FAR, ground(FAR)[None], 1e-9)[0] == pytest.approx(12.0)
    # draws without a range count as zero
    draws = [wall(near, a) for a in (0.05, *np.linspace(0.03, 0.07, 40))]
    best, low, high = ranges(near, np.stack(draws), 0.04)
    assert 0.0 == low < best < high


# ---- products


SENSOR = {"force_noise": "3 mN", "force_bandwidth": "50 Hz"}


@pytest.fixture(scope="module")
def done(remake):
    job = remake(detect=SENSOR)
    return job, detect.run(job)


def reading(job, **given):
    return read(quoted_lifts(job), LiftReading.model_validate({"boundary": "ground"} | given))


def test_products(done):
    job, outcome = done
    table = job.read(DETECTION)
    assert set(table["boundary"]) == {"ground", "ceiling", "sidewall"}
    near_ground = table["boundary"] == "ground"
    columns = (table[k][near_ground] for k in ("payload", "averaging_s", "range_z_hat"))
    z_hat = {(p, t): z for p, t, z in zip(*columns, strict=True)}
    assert z_hat[0.0, 0.1] < z_hat[0.0, 10.0]
    # an unknown payload limits what averaging can do
    assert not z_hat[0.05, 100.0] > 0.5 * z_hat[0.0, 100.0]
    assert table["range_m"] == pytest.approx(0.023 * table["range_z_hat"], nan_ok=True)
    # at the stated change an alarm at 1 % is missed in 10 %
    missed = stats.norm.cdf(table["needed"] / table["sigma"] - stats.norm.isf(0.01))
    assert missed == pytest.approx(0.9)
    wall = (table["boundary"] == "sidewall") & (table["payload"] >= 0.05)
    assert np.isnan(table["range_z_hat"][wall]).all()
    assert (table["hi90"][wall] == 0).all()
    content = job.read_json(PROXIMITY)["boundaries"]
    for side in ("ground", "ceiling", "sidewall"):
        significant, lift = content[side]["significant"], quoted.fitted_lift(job, side, 2)
        change = float(lift.ratio()(np.array([significant["z_hat"]]))[0]) - 1
        assert abs(change) == pytest.approx(0.02, abs=1e-4)
        assert significant["lo90"] <= significant["z_hat"] <= significant["hi90"]
    assert content["sidewall"]["largest_change"] < 0 < content["ground"]["largest_change"]
    assert outcome.notes == ()


def test_supply_costs_range(remake, done):
    job, _ = done
    both = remake(detect=SENSOR | {"supply": ["0 percent", "2 percent"]})
    detect.run(both)
    before, after = job.read(DETECTION), both.read(DETECTION)
    worse = after["voltage"] == 0.02
    assert after["supply"][worse] == pytest.approx(0.04)  # lift as the square of the supply
    assert after["needed"][~worse] == pytest.approx(before["needed"])
    assert (after["needed"][worse] > before["needed"]).all()


def test_a_reading_becomes_a_distance(done):
    """The ratio that the fitted model has at 1.5 radii, and the throttle at which a vehicle would
    hover there, give 1.5 radii.
    """
    job, _ = done
    ratio = float(quoted.fitted_lift(job, "ground", 50).ratio()(np.array([1.5]))[0])
    by_ratio = reading(job, ratio=ratio, u="0.3 percent")
    assert by_ratio.z_hat.lo90 < 1.5 < by_ratio.z_hat.hi90
    assert by_ratio.z_hat.median == pytest.approx(1.5, rel=0.05)
    assert by_ratio.z_m.median == pytest.approx(0.023 * by_ratio.z_hat.median)
    assert by_ratio.beyond < 1e-3
    assert re.search(r"z_hat = 1.\d+ \(90 %: 1.", by_ratio.text)
    assert "11.5: below 0.01 % (50 % before" in by_ratio.text
    # lift scales as throttle^1.4 here: the throttle that lifts weight / ratio far away
    hover = {"throttle": f"{100 * (0.027 * 9.8 / ratio / 0.6) ** (1 / 1.4)} percent"}
    exact = reading(job, **hover, u="0 percent")
    assert exact.ratio == pytest.approx(ratio, rel=0.02)
    assert exact.z_hat.lo90 < 1.5 < exact.z_hat.hi90
    wider = reading(job, **hover, u="0 percent", weight="1 percent", supply="1 percent")
    expected = math.hypot(exact.u, 0.01 * exact.ratio, 0.02 * exact.ratio)
    assert wider.u == pytest.approx(expected, rel=1e-3)
    heavier = reading(job, **hover, u="0 percent", mass="28 g", weight="2 percent")
    assert heavier.ratio == pytest.approx(exact.ratio * 28 / 27)
    uncertain = reading(job, **hover, u="1 percent")
    share = 0.01 / exact.throttle
    assert uncertain.u == pytest.approx(math.hypot(exact.u, 1.4 * share * ratio), rel=0.05)
    with pytest.raises(InputRefused, match=r"0.99 is outside 0.25 to"):
        reading(job, throttle="99 percent", u="0 percent")


def test_the_command_line_takes_a_reading(tmp_path):
    raw = small_run.write(tmp_path / "raw")
    for stage in ("ingest", "reduce", "fit"):
        assert nearlift(stage, raw, "--out", tmp_path, "-q").exit_code == 0

    def asked(*more, **options):
        words = [w for name, value in options.items() if value for w in (f"--{name}", value)]
        return nearlift("detect", raw, "--out", tmp_path, *words, *more)

    by_ratio = {"boundary": "ground", "ratio": "1.1", "u": "1 percent"}
    answer = asked(**by_ratio)
    assert answer.exit_code == 0, answer.output
    assert "ground, sanchez_cuevas: L/L_inf = 1.1 +- 0.01\nz_hat = " in answer.stdout
    z_hat = json.loads(asked("--json", **by_ratio).stdout)["z_hat"]
    assert z_hat["lo90"] < z_hat["median"] < z_hat["hi90"]
    hover = asked(boundary="ground", throttle="50 percent", u="0.5 percent", mass="27 g")
    assert "(hover at 50 % throttle)" in hover.stdout
    assert not (tmp_path / "processed" / small_run.NAME / "proximity.json").exists()
    for changed, code, words in (
        ({"boundary": None, "u": None}, 2, "--boundary: is missing"),
        ({"boundary": "ceiling"}, 2, "nothing was fitted at the ceiling"),
        ({"u": None}, 2, "u: is missing"),
        ({"ratio": None}, 2, "one of both"),
        ({"ratio": "3"}, 4, "standard uncertainties from everything"),
    ):
        refused = asked(**by_ratio | changed)
        assert refused.exit_code == code
        assert words in refused.stderr


def test_the_sensor_s_noise_and_the_bench_s_floor(remake):
    """Of the manifest's force sensor, else of the bench's records."""
    bench, flown = (
        BoundarySensor(quoted_lifts(remake("ground", detect=given)), "ground")
        for given in ({}, SENSOR)
    )
    fitted = remake("ground").load(FitResults)
    far = fitted.of_base("ground").L_inf_N.values()
    floor = math.hypot(fitted.noise["ground"].relative, np.median([e.u / e.value for e in far]))
    assert bench.floor == flown.floor == pytest.approx(floor)
    # 3 mN, white up to 50 Hz
    assert flown.short == pytest.approx(3e-3 / (0.027 * 9.8) / 10)
    sigma = flown.sigma(4.0, payload=0.002, voltage=0.01)
    assert sigma == pytest.approx(math.hypot(flown.short / 2, floor, 0.002, 0.02))
    # 2 mN after 4 s, by the bench's own records
    trials = bench.quoted.trials
    records = {"u_lift_N": np.full(len(trials["n"]), 2e-3), "n": np.full(len(trials["n"]), 4000)}
    cell = bench.quoted.campaign.load_cell.model_copy(update={"sample_rate": 1000.0})
    campaign = bench.quoted.campaign.model_copy(update={"load_cell": cell})
    noisy = replace(bench.quoted, trials={**trials, **records}, campaign=campaign)
    expected = 2e-3 * math.sqrt(4) / (0.027 * 9.8)
    assert BoundarySensor(noisy, "ground").short == pytest.approx(expected)


def test_a_change_that_no_measured_height_has(remake):
    never = remake("sidewall", detect=SENSOR | {"significant": "20 percent"})
    detect.run(never)
    assert never.read_json(PROXIMITY)["boundaries"]["sidewall"]["significant"]["z_hat"] is None
    assert ">not measured<" in small_run.chapter(gather(never), "proximity")


def test_a_model_that_folds_is_not_inverted_and_said_so(remake):
    job = remake("ground", detect=SENSOR)
    content = job.read_json(RESULTS)
    content["boundaries"]["ground"]["coefficients"]["K_b"] |= {"value": -3.0}
    job.write(RESULTS, content)
    (note,) = detect.run(job).notes
    assert "the model folds at z_hat" in note
    assert "folds" in job.read_json(PROXIMITY)["boundaries"]["ground"]["refused"]


def test_the_chapter_has_every_range(done):
    job, _ = done
    text = small_run.chapter(gather(job), "proximity")
    listed = text.partition("Distance of a significant change of lift")[2]
    rows = re.findall(r'<tr><th scope="row">(\w+)</th>', listed)
    assert rows[:3] == ["Ground", "Ceiling", "Sidewall"]
    every, far = job.read(DETECTION), text.partition("Ground: farthest")[2].partition("</table>")[0]
    mine = (every["boundary"] == "ground") & (every["payload"] == 0.01)
    shown = re.findall(
        r"<td>([^<]+)</td>", far.partition('<th scope="row">1<')[2].split("</tr>")[0]
    )
    assert shown[1:] == [plain(z, 3) for z in every["range_z_hat"][mine]]


def test_lift_far_away_and_its_noise_are_those_of_the_accepted_model(remake):
    """The base fit, which a named effect rejects, has another L_inf and a larger scatter."""
    job = remake("ground", detect=SENSOR)
    base = job.load(FitResults).of_base("ground").L_inf_N
    accepted = {str(t): {"value": 1.02 * e.value, "u": 0.001 * e.value} for t, e in base.items()}
    sag = {"value": 2.0, "lo90": 1.9, "hi90": 2.1}
    block = {
        "verdict": "effect",
        "effects": [{"name": "supply_sag", "parameters": {"sag_exponent": sag}}],
        "noise_floor": quoted.EMPTY_BLOCK["noise_floor"] | {"relative": 0.003},
        "L_inf_N": accepted,
    }
    job.write(DIAGNOSIS, quoted.diagnosis({"ground": block}))
    quoted.write(job, {"ground": block})
    floor = BoundarySensor(quoted_lifts(job), "ground").floor
    assert floor == pytest.approx(math.hypot(0.003, 0.001 / 1.02))
    hover = reading(job, throttle="50 percent", u="0 percent", mass="26 g")
    assert hover.ratio == pytest.approx(0.026 * 9.8 / (1.02 * base[0.5].value))
    assert hover.u == pytest.approx(hover.ratio * 0.001 / 1.02)
