"""The loop's figure: what it draws is what the products say, and nothing that they do not say."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from nearlift.reduction.quality import rejected
from nearlift.report import registry
from nearlift.report.figures import covariate_bins, style
from nearlift.report.figures import diagnosis as loop
from nearlift.report.figures.files import render
from nearlift.report.registry import FIGURES
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.document import typed
from nearlift.stages import diagnose, report
from nearlift.stages.diagnose import DIAGNOSIS, LOOP_RESIDUALS
from nearlift.stages.gathering import gather
from nearlift.stages.ingest import TRIALS

from . import quoted

SPEC = next(s for s in FIGURES if s.name == "diagnosis")
#: What the hand-made ground residual does before the loop: relative lift per volt.
SLOPE = 0.2


def candidate(name, log_evidence, accepted=False, left_in="supply"):
    return {
        "name": name,
        "gain": 100.0,
        "p_value": 0.5,
        "accepted": accepted,
        "log_evidence": log_evidence,
        "left_in": None if accepted else left_in,
    }


def error(before, after, floor=0.004):
    def block(v):
        return {"held_out_rmse": v, "lo90": 0.9 * v, "hi90": 1.1 * v}

    return {
        "unit": "fraction of lift",
        "noise_floor": floor,
        "before": block(before),
        "after": block(after),
        "chosen_in_folds": ["supply_sag"] * 3,
    }


def coefficient(name, value, after=None):
    before = {"value": value, "lo90": 0.95 * value, "hi90": 1.05 * value}
    moved = value if after is None else after
    ends = {
        "lo90": 0.94 * moved,
        "hi90": 1.08 * moved,
        "conditional": [0.96 * moved, 1.04 * moved],
        "constrained": [0.5 * moved, 1.6 * moved],
    }
    return {"before": {name: before}, "after": {name: {"value": moved, **ends}}}


FOUND = {
    "ground": {
        "base_model": "sanchez_cuevas",
        "verdict": "effect",
        "effects": [
            {
                "name": "supply_sag",
                "rivals": ["warm_up"],
                "mechanism": "voltage",
                "parameters": {"sag_exponent": {"value": 2.0, "lo90": 1.9, "hi90": 2.1}},
            }
        ],
        "explanations": [["supply_sag"], ["warm_up"]],
        "p_value": 1 / 1501,
        "structure": [
            {"covariate": "supply", "p_value": 1e-90, "significant": True},
            {"covariate": "tilt", "p_value": 0.4, "significant": False},
        ],
        "rounds": [
            {
                "decision": "accept supply_sag",
                "reason": "nothing is left",
                "candidates": [
                    candidate("gain_drift", -60.0),
                    candidate("warm_up", -14.5, accepted=True),
                    candidate("supply_sag", -12.0, accepted=True),
                    candidate("session_gain", -20.0, accepted=True),
                    candidate("reynolds", -900.0, left_in=None),
                ],
            }
        ],
        "error": error(0.02, 0.0045),
        "coefficients": coefficient("K_b", 1.6, 1.95),
    },
    "ceiling": {
        "base_model": "hsiao_chirarattananon",
        "verdict": "adequate",
        "effects": [],
        "p_value": 0.43,
        "structure": [{"covariate": "throttle", "p_value": 0.01, "significant": False}],
        "rounds": [
            {"candidates": [], "decision": "adequate", "reason": "nothing exceeds the threshold"}
        ],
        "error": error(0.0041, 0.0041),
        "coefficients": coefficient("alpha", 0.12),
    },
    "sidewall": {
        "base_model": "sidewall_decay",
        "verdict": "unexplained",
        "effects": [],
        "partial": [{"name": "gain_drift", "share": 0.2}],
        "p_value": 1 / 1501,
        "structure": [{"covariate": "start", "p_value": 1e-30, "significant": True}],
        "rounds": [
            {
                "candidates": [candidate("gain_drift", -60.0, left_in="start")],
                "decision": "no",
                "reason": "structure is left",
            }
        ],
        "error": error(0.01, 0.01),
        "coefficients": coefficient("a", 0.05),
    },
}
FOUND["sidewall"]["coefficients"]["before"]["lambda_"] = {"value": 0.35, "lo90": 0.3, "hi90": 0.4}


def diagnosed(job, found):
    """Give a job hand-made findings and residuals: along supply at the ground, none at the ceiling,
    a wave in run order at the wall.
    """
    trials = job.read(TRIALS)
    rng = np.random.default_rng(1)
    parts = []
    for boundary in found:
        mine = (trials["boundary"] == boundary) & ~rejected(trials["quality"])
        n = int(mine.sum())
        noise = 0.004 * rng.standard_normal(n)
        shape = {
            "ground": SLOPE * (trials["supply_V"][mine] - 3.84),
            "sidewall": 0.01 * np.cos(2 * np.pi * 9 * np.arange(n) / n),
        }
        before = noise + shape.get(boundary, 0.0)
        after = noise if found[boundary]["verdict"] == "effect" else before
        parts.append(
            (
                np.full(n, boundary, dtype=object),
                trials["trial"][mine],
                before,
                after,
                before,
                after,
            )
        )
    names = [c.name for c in LOOP_RESIDUALS.columns]
    job.write(
        LOOP_RESIDUALS,
        {name: np.concatenate([p[i] for p in parts]) for i, name in enumerate(names)},
    )
    job.write_json(DIAGNOSIS, quoted.diagnosis(found))
    quoted.write(job, found)
    return job


@pytest.fixture(scope="module")
def job(make_job):
    return diagnosed(make_job(simulated=True), FOUND)


@pytest.fixture(scope="module")
def evidence(job):
    return gather(job)


@pytest.fixture(scope="module")
def table(evidence):
    return loop.summarise(evidence)


def edited(make_job, change, boundaries=("ground",)):
    found = {b: copy.deepcopy(FOUND[b]) for b in boundaries}
    change(found)
    evidence = gather(diagnosed(make_job(boundaries=boundaries), found))
    return evidence, loop.summarise(evidence)


def drawn(table):
    look = style.Style()
    with style.context(look):
        figure = loop.draw(table, look)
        figure.draw_without_rendering()
        return figure


def pick(table, **wanted):
    keep = np.ones(len(table["panel"]), dtype=bool)
    for name, value in wanted.items():
        keep &= table[name] == value
    return {k: v[keep] for k, v in table.items()}


def panels(figure):
    """Axes by letter."""
    found = {}
    for ax in figure.axes:
        title = ax.get_title(loc="left")
        if title:
            found[title[0]] = ax
    return found


def test_every_panel_has_a_letter_of_its_own_in_reading_order(table):
    letters = list(dict.fromkeys(x for x in table["letter"].tolist() if x))
    assert letters == list("abcdefghijkl")
    titles = {letter: ax.get_title(loc="left") for letter, ax in panels(drawn(table)).items()}
    assert titles == {
        "a": "a) residual before",
        "b": "b) residual after",
        "c": "c) candidates",
        "d": "d) held-out error",
        "e": "e) coefficient",
        "f": "f) residual",
        "g": "g) held-out error",
        "h": "h) coefficient",
        "i": "i) residual",
        "j": "j) candidates, all rejected",
        "k": "k) held-out error",
        "l": "l) coefficient",
    }


def test_before_shows_the_slope_and_after_does_not(table):
    for when, slope in (("before", 100 * SLOPE), ("after", 0.0)):
        bins = pick(table, panel="ground", kind="bin", when=when)
        assert np.polyfit(bins["x"], bins["value"], 1)[0] == pytest.approx(slope, abs=2.0)
        assert set(bins["covariate"].tolist()) == {"supply_V"}


def test_bin_means_are_those_of_the_trials(table, job):
    trials, residuals = job.read(TRIALS), job.read(LOOP_RESIDUALS)
    volts = dict(zip(trials["trial"].tolist(), trials["supply_V"].tolist(), strict=True))
    before = dict(zip(residuals["trial"].tolist(), residuals["before"].tolist(), strict=True))
    cloud = pick(table, panel="ground", when="before", part="residual")
    cloud = {k: v[np.isin(cloud["kind"], ["trial", "beyond"])] for k, v in cloud.items()}
    assert all(
        cloud["x"][i] == volts[t] and cloud["value"][i] == pytest.approx(100 * before[t])
        for i, t in enumerate(cloud["label"].tolist())
    )
    bins = pick(table, panel="ground", when="before", kind="bin")
    assert bins["n_trials"].sum() == len(cloud["x"])
    assert np.sum(bins["n_trials"] * bins["value"]) == pytest.approx(cloud["value"].sum())
    assert np.sum(bins["n_trials"] * bins["x"]) == pytest.approx(cloud["x"].sum())


def test_before_and_after_have_the_same_axes_and_bins(table):
    axes = panels(drawn(table))
    assert axes["a"].get_ylim() == axes["b"].get_ylim()
    assert axes["a"].get_xlim() == pytest.approx(axes["b"].get_xlim())
    before, after = (
        pick(table, panel="ground", kind="bin", when=w)["x"] for w in ("before", "after")
    )
    np.testing.assert_array_equal(before, after)


def test_no_trial_is_lost_beyond_the_axis(make_job):
    evidence = gather(diagnosed(make_job(boundaries=("ground",)), {"ground": FOUND["ground"]}))
    wild = np.array(evidence.tables[LOOP_RESIDUALS.file]["before"])
    wild[5] = 3.0
    evidence.tables[LOOP_RESIDUALS.file]["before"] = wild
    table = loop.summarise(evidence)
    far = pick(table, kind="beyond", when="before")
    assert 300.0 in far["value"].tolist()
    reach = pick(table, kind="reach", when="before")["value"][0]
    assert reach < 100
    assert "of which" in loop.caption(evidence, table)
    ax = panels(drawn(table))["a"]
    ticks = [
        line
        for line in ax.lines
        if line.get_marker() == "|" and len(line.get_xdata()) == len(far["x"])
    ]
    assert np.all(np.abs(ticks[0].get_ydata()) < reach)


def test_adequate_shows_one_residual_and_no_candidates(table):
    own = pick(table, panel="ceiling")
    assert set(own["when"][own["part"] == "residual"].tolist()) == {"before"}
    assert not (own["part"] == "candidate").any()
    assert set(own["kind"][own["part"] == "coefficient"].tolist()) == {
        "quoted",
        "doubt",
        "reference",
    }
    assert (own["kind"] == "rmse").sum() == 1


def test_throttle_is_shown_along_distance_a_series_each(table):
    bins = pick(table, panel="ceiling", kind="bin")
    assert set(bins["covariate"].tolist()) == {"z_hat"}
    assert list(dict.fromkeys(bins["series"].tolist())) == ["25 %", "50 %", "75 %", "92 %"]
    legend = panels(drawn(table))["f"].get_legend()
    assert [t.get_text() for t in legend.get_texts()] == [
        "throttle:",
        "25 %",
        "50 %",
        "75 %",
        "92 %",
    ]


def test_unexplained_is_followed_by_a_curve_that_has_no_name(table):
    curve = pick(table, panel="sidewall", kind="curve")
    wave = np.cos(2 * np.pi * 9 * (curve["x"] - 1) / curve["x"].max())
    assert np.corrcoef(curve["value"], wave)[0, 1] > 0.97
    bins = pick(table, panel="sidewall", kind="bin")
    # sixteen bins would average the wave away
    assert np.ptp(bins["value"]) > 1.2
    assert set(
        table["when"][(table["panel"] == "sidewall") & (table["part"] == "residual")].tolist()
    ) == {"before"}
    assert not (pick(table, panel="ground")["kind"] == "curve").any()


def test_candidates_stand_by_evidence_and_say_what_they_leave(table):
    own = pick(table, panel="ground", part="candidate")
    assert list(
        zip(
            own["label"].tolist(),
            own["kind"].tolist(),
            own["value"].tolist(),
            own["note"].tolist(),
            strict=True,
        )
    ) == [
        ("supply_sag", "named", 0.0, ""),
        ("warm_up", "rival", 5.0, ""),
        ("session_gain", "worse", 16.0, ""),
        ("gain_drift", "rejected", 96.0, "leaves supply voltage"),
        ("reynolds", "rejected", 1776.0, "explains too little"),
    ]


def stand_ins(block):
    found = typed(BoundaryDiagnosis, quoted.diagnosis({"ground": block})["boundaries"]["ground"])
    return found.stand_ins(found.effects[0])


def test_two_effects_that_may_be_there_stand_beside_the_one_that_is_named(make_job):
    def pair(found):
        own = found["ground"]
        own["effects"][0]["rivals"] = ["warm_up", "tilt"]
        own["explanations"] = [["supply_sag"], ["warm_up"], ["supply_sag", "tilt"]]
        own["rounds"].append(
            {
                **own["rounds"][0],
                "candidates": [candidate("supply_sag + tilt", -10.0, accepted=True)],
            }
        )

    _, table = edited(make_job, pair)
    own = pick(table, panel="ground", part="candidate")
    kinds = dict(zip(own["label"].tolist(), own["kind"].tolist(), strict=True))
    assert kinds == {"supply_sag": "named", "warm_up": "rival", "supply_sag + tilt": "rival"} | {
        "session_gain": "worse",
        "gain_drift": "rejected",
        "reynolds": "rejected",
    }
    own = copy.deepcopy(FOUND["ground"])
    pair({"ground": own})
    assert stand_ins(own) == ["warm_up", "supply_sag + tilt"]
    # written before there was a list of explanations: the rivals as they stand
    del own["explanations"]
    assert stand_ins(own) == ["warm_up", "tilt"]


def test_accepted_candidates_are_filled_and_rejected_hollow(table):
    ax = panels(drawn(table))["c"]
    marks = [line for line in ax.lines if len(line.get_xdata()) == 1]
    assert [m.get_markerfacecolor() == "white" for m in marks] == [False, False, False, True, True]
    assert [t.get_text() for t in ax.get_yticklabels()] == [
        "supply sag",
        "warm-up",
        "session gain",
        "gain drift",
        "Reynolds number",
    ]
    low, high = ax.get_xlim()
    assert low <= 0 < 1776 < high


def test_a_single_effect_is_shown_beside_pairs(make_job):
    def pairs(found):
        own = found["ground"]
        listed = [candidate(f"supply_sag + e{i}", -10.0 - i, accepted=True) for i in range(9)]
        own["rounds"] = [
            {**own["rounds"][0], "candidates": [candidate("gain_drift", -70.0)]},
            {**own["rounds"][0], "candidates": listed},
        ]

    _, table = edited(make_job, pairs)
    shown = pick(table, part="candidate")["label"].tolist()
    assert len(shown) == loop.CANDIDATES
    assert shown[-1] == "gain_drift"


def test_errors_stand_with_their_interval_and_the_floor(table):
    own = pick(table, panel="ground", part="error")
    values = dict(
        zip(
            zip(own["kind"].tolist(), own["when"].tolist(), strict=True),
            own["value"].tolist(),
            strict=True,
        )
    )
    assert values == {
        ("floor", ""): pytest.approx(0.4),
        ("rmse", "before"): pytest.approx(2.0),
        ("rmse", "after"): pytest.approx(0.45),
    }
    assert own["lo90"][own["when"] == "before"][0] == pytest.approx(1.8)
    ax = panels(drawn(table))["d"]
    assert {"2.00", "0.450", "0.400"} <= {t.get_text() for t in ax.texts}
    assert ax.get_ylim()[0] == 0
    # a low floor's number stands above its line, where it covers no axis
    for floor, above in ((0.1, True), (1.5, False)):
        moved = {**table, "value": np.where(table["kind"] == "floor", floor, table["value"])}
        [number] = [t for t in panels(drawn(moved))["d"].texts if t.xy[0] == 2]
        assert (number.xyann[1] > 0) == above


def test_coefficient_intervals_are_the_products(table):
    own = pick(table, panel="ground", part="coefficient")
    spans = {
        n: (lo, hi)
        for k, n, lo, hi in zip(
            *(own[c].tolist() for c in ("kind", "note", "lo90", "hi90")), strict=True
        )
        if k != "reference"
    }
    after = FOUND["ground"]["coefficients"]["after"]["K_b"]
    before = FOUND["ground"]["coefficients"]["before"]["K_b"]
    assert spans == {
        "": (after["lo90"], after["hi90"]),
        "supply_sag alone, exactly in its stated form": tuple(after["conditional"]),
        "base model without any effect": (before["lo90"], before["hi90"]),
        "every undetected effect at its plausible size": tuple(after["constrained"]),
    }
    assert own["kind"].tolist()[0] == "quoted"
    reference = pick(table, panel="ceiling", kind="reference")
    assert (reference["value"].tolist(), reference["note"].tolist()) == ([0.125], ["theory"])


def test_the_widest_interval_is_drawn_whole(make_job):
    def widen(found):
        found["ground"]["coefficients"]["after"]["K_b"]["constrained"] = [-40.0, 60.0]

    _, table = edited(make_job, widen)
    ax = panels(drawn(table))["e"]
    low, high = ax.get_xlim()
    assert low < -40 < 60 < high


def test_two_coefficients_stand_side_by_side(table):
    labels = [ax.get_xlabel() for ax in drawn(table).axes]
    assert "$a$" in labels
    assert r"$\lambda$" in labels


def test_after_two_effects_the_covariate_of_the_other_is_shown_too(make_job):
    def second(found):
        found["ground"]["effects"].append({"name": "gain_drift", "rivals": [], "parameters": {}})

    evidence, table = edited(make_job, second)
    assert list(dict.fromkeys(table["covariate"][table["part"] == "residual"].tolist())) == [
        "supply_V",
        "run_order",
    ]
    assert [ax.get_title(loc="left")[3:] for ax in drawn(table).axes[:4]] == [
        "residual before",
        "residual after",
    ] * 2
    assert "and of the other effect" in loop.caption(evidence, table)
    assert "(a–d)" in loop.caption(evidence, table)


def test_minimal_findings_are_drawn_without_what_they_lack(make_job):
    def least(found):
        own = found["ground"]
        own["rounds"] = [
            {
                "candidates": [{"name": "supply_sag", "gain": 3.0, "p_value": 0.1}],
                "decision": "d",
                "reason": "r",
            }
        ]
        for key in ("error", "coefficients", "p_value"):
            del own[key]

    evidence, table = edited(make_job, least)
    # what is quoted is known whatever the findings lack
    assert set(table["part"].tolist()) == {"verdict", "residual", "coefficient"}
    assert sorted(panels(drawn(table))) == ["a", "b", "c"]
    assert loop.alt(evidence, table)
    render(SPEC.draw, table, style.Style())


def test_intervals_that_could_not_be_found_are_left_out(make_job):
    def unknown(found):
        found["ground"]["error"]["after"]["lo90"] = found["ground"]["error"]["after"]["hi90"] = None

    _, table = edited(make_job, unknown)
    assert np.isnan(pick(table, kind="rmse", when="after")["lo90"]).all()
    render(SPEC.draw, table, style.Style())


@pytest.mark.parametrize(
    "word",
    [
        "distance",
        "throttle",
        "start",
        "supply",
        "session",
        "approach",
        "tilt",
        "order_in_visit",
        "previous_throttle",
        "previous_distance",
        "previous_lift_N",
        "rig_$_colour",
    ],
)
def test_every_word_of_the_findings_can_be_drawn(make_job, word):
    def along(found):
        found["ground"]["structure"] = [{"covariate": word, "p_value": 1e-9, "significant": True}]

    _, table = edited(make_job, along)
    cloud = pick(table, part="residual", when="before")
    assert np.isin(cloud["kind"], ["trial", "beyond"]).sum() > 100
    figure = drawn(table)
    # what was not recorded is drawn in run order
    expected = {"tilt": "run_order", "rig_$_colour": "run_order"}.get(
        word, covariate_bins.AXES.get(word, covariate_bins.Abscissa(column=word)).column
    )
    assert set(cloud["covariate"].tolist()) == {expected}
    assert figure.axes[0].get_xlabel()


def test_bins_of_time_do_not_straddle_sessions():
    session = np.repeat([0, 1, 2], [50, 30, 100])
    label = covariate_bins.bins_of(
        "run_order", np.arange(180.0), np.random.default_rng(0).standard_normal(180), session
    )
    assert all(len(set(session[label == k].tolist())) == 1 for k in set(label.tolist()))
    assert sorted(set(label.tolist())) == list(range(label.max() + 1))


def test_the_figure_keeps_its_width_and_page(table):
    look = style.Style()
    figure = drawn(table)
    assert figure.get_figwidth() == pytest.approx(look.double_in)
    assert figure.get_figheight() <= look.height_in
    width, height = figure.get_size_inches() * figure.dpi
    for ax in figure.axes:
        for box in (ax.get_tightbbox(), *(t.get_window_extent() for t in ax.texts)):
            assert box.x0 > -1
            assert box.x1 < width + 1
            assert box.y0 > -1
            assert box.y1 < height + 1


@pytest.mark.parametrize("far", [13.0, 90.0, 1000.0])
def test_words_beside_candidates_stay_in_their_panel(table, far):
    mine = (table["part"] == "candidate") & (table["panel"] == "ground")
    value, note, label = (table[k].copy() for k in ("value", "note", "label"))
    value[mine] = np.linspace(0, far, mine.sum())
    note[mine] = np.where(table["kind"][mine] == "rejected", "leaves lift of the trial before", "")
    label[mine] = ["supply_sag", *["airframe_stagnation + room_recirculation"] * (mine.sum() - 1)]
    ax = panels(drawn({**table, "value": value, "note": note, "label": label}))["c"]
    frame = ax.get_window_extent()
    for text in ax.texts:
        box = text.get_window_extent()
        assert frame.x0 < box.x0
        assert box.x1 < frame.x1
    labels = [t.get_window_extent() for t in ax.get_yticklabels()]
    assert all(not a.overlaps(b) for i, a in enumerate(labels) for b in labels[i + 1 :])


def test_axes_do_not_overlap(table):
    boxes = [ax.get_window_extent() for ax in drawn(table).axes]
    for i, one in enumerate(boxes):
        assert not any(one.overlaps(other) for other in boxes[i + 1 :])


def test_caption_and_alternative_text_agree_with_the_picture(evidence, table):
    caption, alt = loop.caption(evidence, table), loop.alt(evidence, table)
    assert "Relative residuals (a, b, f, i)" in caption
    assert "Candidates (c, j)" in caption
    assert (
        "Ground: supply_sag (or warm_up); cross-validated error 2 % to 0.45 %, noise floor 0.4 %."
        " Assumptions: (1) supply_sag alone" in caption
    )
    assert "K_b, every undetected effect at its plausible size: 1.95, 90 % 0.975 to 3.12." in alt
    assert "Bin means before deviate by" in alt


def test_the_report_makes_it_and_shows_it_before_the_words(job, monkeypatch):
    monkeypatch.setattr(registry, "FIGURES", (SPEC,))  # the others are made elsewhere
    report.run(job)
    for kind in ("pdf", "png", "csv"):
        assert (job.reports / f"diagnosis.{kind}").stat().st_size > 1000
    text = (job.reports / "index.html").read_text()
    chapter = text[text.index('<section id="diagnosis"') :]
    assert chapter.index("diagnosis.pdf") < chapter.index("<h4>")


def test_a_real_diagnosis_can_be_drawn(make_job):
    def sag(table):
        table["lift_N"] = table["lift_N"] * (1 + SLOPE * (table["supply_V"] - 3.84))

    job = make_job(boundaries=("ground",), repeats=4, edit=sag)
    diagnose.run(job)
    evidence = gather(job)
    table = loop.summarise(evidence)
    assert (table["part"] == "residual").any()
    assert (table["part"] == "error").any()
    assert loop.caption(evidence, table)
    render(SPEC.draw, table, style.Style())
