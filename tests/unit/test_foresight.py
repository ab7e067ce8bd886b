"""What a design could see, foretold: against trials drawn at random, against closed forms, and
through the command line.
"""

import csv
import dataclasses
import json

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.errors import NotConverged
from nearlift.likelihood.covariates import derive
from nearlift.loop import foresight as loop_foresight
from nearlift.loop import outlook, proposals
from nearlift.loop.absorption import unknowable
from nearlift.loop.diagnose import set_up
from nearlift.loop.handle import LIMIT_POWER, Power, handles
from nearlift.loop.rehearsal import planned
from nearlift.loop.search import run
from nearlift.loop.search_problem import Options
from nearlift.loop.within_trial import heating, power
from nearlift.manifest import campaign as manifests
from nearlift.readers.schedule import read_schedule
from nearlift.results import Noise
from nearlift.stages.design import schedule_text
from nearlift.stages.plans import draw
from nearlift.synthetic.trial_schedule import _williams, balanced, from_both_sides, randomised

from . import small_run
from .simulated import campaign, hsiao
from .small_run import nearlift, state

GROUND = catalogue.model("sanchez_cuevas")
NOISE = Noise(relative=0.004, force_N=3e-4, height_m=1e-4)


def foresee(**changes):
    data = campaign(7, visits=8, **changes)
    return planned(data, GROUND, (), NOISE, Options(), np.array([2.0]))[0]


@pytest.fixture(scope="module")
def foresight():
    return foresee()


def handle(name, which=0):
    return handles(catalogue.effect(name))[which]


# ---- the core


def test_a_name_is_foretold_to_compete_with_a_gain_that_wanders(foresight, monkeypatch):
    sessions, tilt = handle("session_gain"), handle("tilt")
    chances = []
    for _ in range(2):
        chances.append([foresight.contest(h, foresight.limit(h)).within for h in (sessions, tilt)])
        monkeypatch.setattr(loop_foresight, "worth", lambda scores, *_: np.zeros(scores.shape[1]))
    (differing, tilted), (alone, upright) = chances
    assert differing < alone - 0.1
    assert tilted == pytest.approx(upright, abs=0.02)


def test_without_an_effect_the_chance_is_the_false_alarm_rate(foresight):
    nothing = np.zeros(foresight._space[0].shape[1])
    # 1000 draws at 5 %, and a threshold from 6000: 3 sd of their difference is 2.2 %
    assert dataclasses.replace(foresight, quiet=1.0).seen(nothing).mean() == pytest.approx(
        0.05, abs=0.022
    )
    # the floor comes out a little higher than the noise is
    assert 0.85 < foresight.quiet < 1.03


def test_a_limit_is_where_the_chance_is_eighty_per_cent(foresight):
    h = handle("supply_sag")
    limit = foresight.limit(h)
    assert foresight.seen(foresight.visible(h, limit)).mean() == pytest.approx(
        LIMIT_POWER, abs=0.03
    )
    # four times the trials of the same kind see half the size
    data = foresight.stage.data
    index = np.tile(np.arange(data.n), 4)
    more = dataclasses.replace(
        data.take(index),
        visit=data.visit[index] + np.repeat(np.arange(4), data.n) * (data.visit.max() + 1),
    )
    assert planned(more, GROUND, (), NOISE, Options(), np.array([2.0]))[0].limit(
        h
    ) / limit == pytest.approx(0.5, abs=0.13)


def test_the_foretold_chance_is_that_of_drawn_trials(foresight):
    """24 campaigns at the limit, seen in 80 %: 11 or fewer by chance once in a thousand, all of
    them once in two hundred.
    """
    h = handle("session_gain")
    limit = foresight.limit(h)
    stage = foresight.stage
    rng = np.random.default_rng(5)
    seen = 0
    for _ in range(24):
        draw = rng.normal(size=5)
        gain = limit * (draw - draw.mean()) / np.std(draw)
        d = stage.data
        jitter = rng.normal(0, NOISE.height_m, d.visit.max() + 1)[d.visit] * stage.slope
        noise = (
            NOISE.relative * rng.normal(size=d.n)
            + NOISE.force_N / d.lift_N * rng.normal(size=d.n)
            + jitter
        )
        log_lift = np.log(d.lift_N) + np.log1p(gain[d.session]) + noise
        trial = dataclasses.replace(
            stage, log_lift=log_lift, data=dataclasses.replace(d, lift_N=np.exp(log_lift))
        )
        seen += trial.nothing_added[0].present
    assert 12 <= seen <= 23


def test_the_first_visible_part_is_what_theta_and_levels_leave(foresight):
    raw, left = foresight.signature(handle("height_offset"), 1e-3)
    stage = foresight.stage
    assert np.sqrt(np.mean(left**2)) < 0.4 * np.sqrt(np.mean(raw**2))
    absorbed = raw - left
    columns = np.hstack(
        [np.eye(4)[stage.data.level], stage.candidate().jacobian(stage.base_fit.vector)]
    )
    assert absorbed == pytest.approx(
        columns @ np.linalg.lstsq(columns, absorbed, rcond=None)[0], abs=1e-9
    )
    # per cent of lift per mm at z_hat = 1.14, as the declaration says
    assert raw[np.argmin(stage.data.z_hat)] == pytest.approx(-0.0043, rel=0.25)


def test_harm_is_the_shift_of_a_fit_to_trials_that_hold_the_effect(foresight):
    stage = foresight.stage
    shift = foresight.harm(handle("height_offset"), 5e-4)[0]
    held = stage.candidate(catalogue.effect("height_offset")).log_ratio(np.array([2.0, 5e-4]))
    fitted = dataclasses.replace(
        stage, log_lift=np.log(stage.data.covariates["lift_inf_N"]) + held
    ).base_fit
    assert shift == pytest.approx(fitted.vector[0] - 2.0, abs=2e-3)
    assert shift < -0.03


def test_a_near_double_is_a_rival_and_a_stranger_is_not(foresight):
    contest = foresight.contest(handle("image_strength"), 0.2)
    assert contest.seen > 0.95
    assert contest.rivals["held_quantity"] > 0.6
    assert contest.rivals["airframe_stagnation"] > 0.8
    assert contest.rivals.get("supply_sag", 0.0) < 0.05
    assert contest.alone < 0.1
    shares = foresight.absorbed(handle("image_strength"))
    assert shares["held_quantity"] > 0.99
    assert all(0 <= s <= 1 for s in shares.values())
    assert list(shares.values()) == sorted(shares.values(), reverse=True)


def test_a_contest_foretells_the_search(foresight):
    """A strong sag is named alone in the forecast, and by the search on drawn trials."""
    h = handle("supply_sag")
    contest = foresight.contest(h, 0.5)
    assert contest.alone > 0.99
    data = campaign(31, visits=8, gain=lambda c: (c["supply_V"] / 3.8) ** 0.5)
    answer = run(set_up(data, GROUND, (), Options())[0])
    assert [e.name for e in answer.accepted] == ["supply_sag"]


def test_chances_are_ordered(foresight):
    found = foresight.power(handle("zero_drift"))
    for name in ("seen", "within", "first", "alone"):
        assert np.all((getattr(found, name) >= 0) & (getattr(found, name) <= 1))
    assert np.all(found.within <= found.seen + 1e-12)
    assert np.all(found.first <= found.within + 1e-12)
    assert np.all(found.alone <= found.first + 1e-12)
    assert found.seen[0] < 0.1 < 0.9 < found.seen[-1]


def test_limits_are_read_off_a_curve():
    size = np.array([0.0, 1.0, 2.0])
    curve = Power(
        size=size,
        seen=np.array([0.0, 0.6, 1.0]),
        within=np.array([0.0, 0.1, 0.2]),
        first=size * 0,
        alone=size * 0,
    )
    assert curve.limit() == pytest.approx(1.5)
    assert curve.limit("within") is None


def test_what_theta_absorbs_is_silent_and_has_no_limit():
    data = campaign(
        3,
        boundary="ceiling",
        ratio=hsiao,
        stations=(0.15, 0.2, 0.3, 0.5, 0.8, 1.5, 3.0, 10.0),
        visits=8,
    )
    foresight, library, _ = planned(
        data, catalogue.model("hsiao_chirarattananon"), (), NOISE, Options(), np.array([0.125])
    )
    row = outlook.weigh(foresight, handle("height_scale"))
    assert row["verdict"] == "silent"
    assert row["detection_limit"] is None
    assert row["bias"]["alpha"]["in_u"] != 0
    assert "height_scale" in {e.name for e in library}


def test_too_few_planned_trials_are_refused():
    data = campaign(3, visits=1).take(np.arange(4))
    with pytest.raises(NotConverged, match="at least 45 trials are wanted"):
        planned(data, GROUND, (), NOISE, Options(), np.array([2.0]))


# ---- proposals


def test_groups_are_linked_pairs():
    def row(name, verdict="seen, not told apart", **rivals):
        return {"effect": name, "verdict": verdict, "rivals": rivals}

    rows = [
        row("a", b=0.9),
        row("b", c=0.6),
        row("c"),
        row("d", e=0.4),
        row("f", "too small to see", a=0.9),
        row("g", h=0.7),
    ]
    assert outlook.groups(rows) == [["a", "b", "c"], ["g", "h"]]


def test_changes_part_what_they_promise(foresight):
    pair = proposals.Pair(handle=handle("reynolds"), rival="zero_offset", size=0.1, chance=0.8)
    found = proposals.changes(foresight, [pair], {})
    assert [p["pair"] for p in found["pairs"]] == [["reynolds", "zero_offset"]]
    asked = found["pairs"][0]
    assert asked["evidence_now"] < proposals.APART
    # a zero of the cell stands where the rotors do not, and costs little
    sweep = next(o for o in asked["options"] if o["change"].startswith("a motors-off sweep"))
    assert sweep["trials_to_part"] == 2 * len(np.unique(foresight.stage.data.z_hat))
    assert "rpm" in asked["log"]
    assert "start" not in asked["log"]
    costs = [o["trials_to_part"] for o in asked["options"]]
    assert costs == sorted(costs)
    checked = [b for b in found["best"] if b.get("rivals_after")]
    assert checked
    assert all(0 <= r["after"] <= 1 for b in checked for r in b["rivals_after"])


def test_a_gauge_parts_an_offset_from_what_else_acts_close_by(foresight):
    pair = proposals.Pair(
        handle=handle("image_strength"), rival="height_offset", size=0.2, chance=1.0
    )
    options = proposals.changes(foresight, [pair], {})["pairs"][0]["options"]
    assert any(
        o["change"].startswith("touch the traverse off") and o["trials_to_part"] == 0
        for o in options
    )


def test_the_same_trials_from_both_sides_let_backlash_show(foresight):
    """Always from afar, backlash is an offset; from both sides it is itself."""
    data = foresight.stage.data
    one_sided = dataclasses.replace(
        data, covariates={**data.covariates, "approach": np.where(np.arange(data.n) < 8, 1.0, -1.0)}
    )
    mixed = np.where(np.random.default_rng(1).random(data.visit.max() + 1) < 0.5, 1.0, -1.0)[
        data.visit
    ]
    both_sided = dataclasses.replace(data, covariates={**data.covariates, "approach": mixed})
    h = handle("approach_backlash")
    lengths = []
    for trials in (one_sided, both_sided):
        lengths.append(
            np.linalg.norm(
                planned(trials, GROUND, (), NOISE, Options(), np.array([2.0]))[0].visible(h, 2e-4)
            )
        )
    assert lengths[1] > 1.8 * lengths[0]


# ---- within a trial


def test_heating_is_seen_at_its_limit_with_the_stated_chance():
    data = campaign(4, visits=5)
    rng = np.random.default_rng(1)

    def with_drift(mean):
        return dataclasses.replace(
            data, covariates={**data.covariates, "drift_hat": mean + rng.normal(0, 0.02, data.n)}
        )

    told = power(with_drift(0.0), 0.05, 0.8)
    assert told.visits == 50
    library = catalogue.effects()
    seen = sum(heating(with_drift(told.limit), library, 0.05).significant for _ in range(200))
    # 160 of 200 expected; the limit itself is known to a tenth, which is worth 5 %
    assert 125 <= seen <= 190
    assert power(data, 0.05, 0.8) is None


# ---- schedules


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6])
def test_each_throttle_follows_each_other_equally_often(count):
    orders = _williams(count)
    follows = np.zeros((count, count), dtype=int)
    for row in orders:
        assert sorted(row) == list(range(count))
        np.add.at(follows, (row[:-1], row[1:]), 1)
    assert len(set(follows[~np.eye(count, dtype=bool)])) == 1


def test_a_balanced_schedule_keeps_visits_and_comes_from_both_sides():
    stations = [0.026, 0.03, 0.04, 0.06, 0.1, 0.25, 0.25]
    plain = randomised({"ground": stations}, seed=3, visits=8)
    drawn = from_both_sides(balanced(plain, seed=3), overshoot_m=0.005, seed=3)
    assert np.array_equal(drawn.recorded_m, plain.recorded_m)
    for visit in np.unique(drawn.visit):
        assert sorted(drawn.throttle[drawn.visit == visit]) == [0.25, 0.5, 0.75, 0.92]
    middle = drawn.recorded_m == 0.06
    assert drawn.approach[middle].mean() == 0
    # nearest and farthest can be reached from one side alone
    assert set(drawn.approach[drawn.recorded_m == 0.026]) == {-1.0}
    via = drawn.further["via_m"]
    detour = np.isfinite(via)
    assert np.all((via[detour] >= 0.026) & (via[detour] <= 0.25))
    assert np.array_equal(np.sign(drawn.recorded_m - via)[detour], drawn.approach[detour])
    # a station that stands twice is visited twice a round, and not twice running
    stops = np.unique(drawn.visit, return_index=True)[1]
    far = drawn.recorded_m[stops] == 0.25
    assert far.sum() == 16
    assert np.mean(far[1:] & far[:-1]) < 0.05


# ---- the command line

PLAN = """
[design]
distances = { ground = ["26 mm", "35 mm", "52 mm", "92 mm", "265 mm"] }
throttles = ["25 percent", "50 percent", "92 percent"]
lift = ["10.9 gf", "24.4 gf", "56.2 gf"]
visits = 5
sessions = 3
supply = ["4.05 V", "3.75 V"]
logs = ["supply"]
noise = { relative = "0.4 percent", force = "0.3 mN", height = "0.05 mm" }
"""
MANIFEST = """
schema = "nearlift.campaign/1"
name = "planned"
report = { style = "screen" }
vehicle = { name = "Crazyflie 2.0", rotors = 4, rotor_radius = "23 mm", rotor_spacing = "65 mm", mass = "27 g" }
rig = { held = "throttle", distance_datum = "rotor plane", distance_offset = "0 mm", gravity = "9.8 m/s^2" }
load_cell = { sample_rate = "1000 Hz", tare = "2 s" }
records = { reader = "csv", files = "trials/{trial}.csv", force = { column = "force", unit = "mN", sign = 1 } }
[trials.units]
distance = "mm"
throttle = "percent"
start = "s"
supply = "V"
"""


@pytest.fixture
def plan(tmp_path):
    folder = tmp_path / "plan"
    folder.mkdir()
    (folder / "campaign.toml").write_text(MANIFEST + PLAN)
    return folder


@pytest.fixture(scope="module")
def weighed(tmp_path_factory):
    base = tmp_path_factory.mktemp("design")
    folder = base / "plan"
    folder.mkdir()
    (folder / "campaign.toml").write_text(MANIFEST + PLAN)
    before = state(folder)
    answer = nearlift("design", folder, "--out", base / "out", "--json")
    assert (answer.exit_code, answer.stderr) == (0, "")
    assert state(folder) == before
    return base, json.loads(answer.stdout)


def test_design_writes_a_schedule_that_nearlift_reads(weighed):
    base, found = weighed
    text = (base / "out/reports/planned/design/trials.csv").read_text()
    rows = list(csv.DictReader(text.splitlines()))
    assert len(rows) == 75
    assert found["schedule"]["trials"] == 75
    assert {r["supply"] for r in rows} == {""}
    assert found["schedule"]["hours"] == pytest.approx((75 * 20 + 25 * 8 + 2 * 300) / 3600, rel=0.1)
    # each distance in each session, but for the rounding of five rounds over three sessions
    for session in "123":
        assert len({r["distance"] for r in rows if r["session"] == session}) == 5
    copied = base / "copied"
    copied.mkdir()
    (copied / "campaign.toml").write_text(MANIFEST)
    (copied / "trials.csv").write_text(text)
    loaded = manifests.load(copied)
    schedule = read_schedule(loaded, copied)
    assert len(schedule) == 75
    assert schedule.visit.max() == 24
    again = nearlift("design", copied, "--out", base / "again", "--noise-from", "nobody")
    assert again.exit_code == 2
    assert "nobody has no diagnosis.json" in again.stderr


def test_design_says_what_it_assumes_and_finds(weighed):
    base, found = weighed
    at = found["boundaries"]["ground"]
    assert at["trials"] == 75
    rows = {r["effect"]: r for r in at["effects"]}
    assert rows["supply_sag"]["verdict"] == "named"
    assert rows["height_scale"]["verdict"] == "too small to see"
    assert 0.02 < at["coefficients"]["K_b"]["u"] < 0.1
    assert (
        at["coefficients"]["K_b"]["u_with_undetected_effects"] > 3 * at["coefficients"]["K_b"]["u"]
    )
    assert {u["effect"] for u in at["untestable"]} >= {"tilt", "air_density"}
    assert any("supply falls from 4.05 to 3.75 V" in said for said in found["assumed"])
    for kind in ("json", "pdf", "png", "csv"):
        assert (base / f"out/reports/planned/design/design.{kind}").stat().st_size > 500


def test_the_same_seed_draws_the_same_schedule_and_another_another(weighed, plan, tmp_path):
    base, _ = weighed
    drawn = (base / "out/reports/planned/design/trials.csv").read_bytes()
    loaded = manifests.load(plan)
    assert schedule_text(draw(loaded, 0), loaded).encode() == drawn
    assert schedule_text(draw(loaded, 1), loaded).encode() != drawn
    target = tmp_path / "trials.csv"
    target.write_bytes(drawn)
    for path in (target, tmp_path):
        refused = nearlift("design", plan, "--out", tmp_path / "o", "--write", path)
        assert refused.exit_code == 2
        assert "a schedule that may have been run is never overwritten" in refused.stderr
    assert target.read_bytes() == drawn


def test_a_plan_without_a_plan_is_refused(plan, tmp_path):
    (plan / "campaign.toml").write_text(MANIFEST)
    found = nearlift("design", plan, "--out", tmp_path)
    assert found.exit_code == 2
    assert "has neither a schedule with trials nor a [design]" in found.stderr


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            ('lift = ["10.9 gf", "24.4 gf", "56.2 gf"]', 'lift = ["10.9 gf"]'),
            "lift lists 1 values for 3 throttles",
        ),
        (
            ('throttles = ["25 percent", "50', 'throttles = ["50 percent", "50'),
            "a throttle stands twice",
        ),
        (("visits = 5", "visits = 0"), "design.visits"),
        (('"26 mm", ', '"26", '), "design.distances"),
        (("sessions = 3", "sesions = 3"), "did you mean 'sessions'?"),
        (("logs", "expected = { ground = { K_c = 2.0 } }\nlogs"), "sanchez_cuevas has no K_c"),
    ],
)
def test_a_design_with_a_slip_is_refused(plan, tmp_path, change, text):
    (plan / "campaign.toml").write_text(MANIFEST + PLAN.replace(*change))
    found = nearlift("design", plan, "--out", tmp_path)
    assert found.exit_code == 2
    assert text in found.stderr


def test_derived_covariates_do_not_depend_on_the_planned_lift():
    data = campaign(1, visits=3)
    levels = np.array([1.0, 2.0, 3.0, 4.0])
    one, two = (
        derive(dataclasses.replace(data, lift_N=data.lift_N * f), levels[data.level])
        for f in (1.0, 3.0)
    )
    assert np.array_equal(one.covariates["previous_lift_N"], two.covariates["previous_lift_N"])


# ---- one effect explained


@pytest.fixture(scope="module")
def explained(tmp_path_factory):
    base = tmp_path_factory.mktemp("explain")
    raw, out = small_run.write(base / "raw"), base / "out"
    with (raw / "campaign.toml").open("a") as file:
        file.write('[report]\nstyle = "screen"\n')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("nearlift.report.figures.encoding.render", small_run.undrawn)
        assert nearlift("run", raw, "--out", out, "-q", "--executor", "serial").exit_code == 0
    return raw, out


def test_explain_says_what_why_and_how_large(explained):
    raw, out = explained
    answer = nearlift("diagnose", raw, "--out", out, "--explain", "height_offset", "--json")
    assert (answer.exit_code, answer.stderr) == (0, "")
    found = json.loads(answer.stdout)
    at = found["boundaries"]["ground"]
    size = at["sizes"][0]
    assert (size["parameter"], size["unit"]) == ("offset_m", "m")
    assert size["signature"]["rms_left"] < size["signature"]["rms"]
    assert size["bias"]["K_b"]["shift"] != 0
    assert {c["effect"] for c in size["confused_with"][:6]} & {
        "image_strength",
        "held_quantity",
        "near_wall_saturation",
    }
    assert all(
        c["correlation"] == pytest.approx(c["energy_absorbed"] ** 0.5)
        for c in size["confused_with"]
    )
    assert found["source"]["citation"]
    folder = out / "reports/small/explain"
    first = {p.name: p.read_bytes() for p in folder.iterdir()}
    words = nearlift("diagnose", raw, "--out", out, "--explain", "height_offset").stdout
    # the same bytes again
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == first
    for part in (
        "Mechanism: the traverse's zero is not the rotor plane",
        "Source: ",
        "In small, ground",
        "Confused with",
        "Unnoticed at that size",
    ):
        assert part in words
    with (out / "reports/small/explain/height_offset.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {r["panel"] for r in rows} == {"signature", "power", "confused"}
    assert len([r for r in rows if r["series"] == "left"]) == at["trials"]


@pytest.mark.usefixtures("plain_pictures")
def test_explain_stales_nothing_and_no_stage_adopts_its_files(explained):
    raw, out = explained
    nearlift("diagnose", raw, "--out", out, "--explain", "gain_drift", "-q")
    before = state(out)
    found = nearlift("plan", raw, "--out", out)
    assert all("up to date" in line for line in found.stdout.splitlines())
    assert nearlift("report", raw, "--out", out, "-q").exit_code == 0
    ledger = json.loads((out / "processed/small/provenance.json").read_text())
    recorded = set(ledger["stages"]["report"]["outputs"])
    assert {"reports/index.html", "reports/fig2.pdf", "reports/tables/coefficients.tex"} <= recorded
    assert not any("explain" in name for name in recorded)
    # gone again, nothing is missing
    for path in (out / "reports/small/explain").iterdir():
        path.unlink()
    assert all(
        "up to date" in line for line in nearlift("plan", raw, "--out", out).stdout.splitlines()
    )
    assert set(before) >= {"reports/small/explain/gain_drift.png"}


def test_explain_names_what_to_log_and_what_does_not_exist(explained):
    raw, out = explained
    words = nearlift("diagnose", raw, "--out", out, "--explain", "supply_sag").stdout
    assert "Untestable: supply_V, supply_ref_V are unknown" in words
    assert "Log next time: supply" in words
    assert not (out / "reports/small/explain/supply_sag.png").exists()
    heating_words = nearlift("diagnose", raw, "--out", out, "--explain", "motor_heating").stdout
    assert "would be seen with 80 % chance" in heating_words
    refused = nearlift("diagnose", raw, "--out", out, "--explain", "suply_sag")
    assert refused.exit_code == 2
    assert "did you mean supply_sag" in refused.stderr


def test_a_visit_holds_one_distance_always_and_that_is_no_finding(foresight):
    """Sessions hold them all; only a campaign of a few long visits has no more sessions than
    visits.
    """
    stage = foresight.stage
    assert unknowable(stage, stage.base_fit) == ()
    data = stage.data
    first = data.take(np.isin(data.visit, np.unique(data.visit)[:15]))
    few, _, _ = planned(first, GROUND, (), NOISE, Options(), np.array([2.0]))
    texts = [f.text for f in unknowable(few.stage, few.stage.base_fit)]
    assert any("A gain of its own for every visit" in t for t in texts)
