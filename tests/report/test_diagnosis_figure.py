"""The loop's figure: what it draws is what the products say, and nothing that they do not say."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
from tests.unit import quoted

from nearlift.reduction.quality import rejected
from nearlift.report import registry
from nearlift.report.evidence import pick
from nearlift.report.figures import binning, style
from nearlift.report.figures import diagnosis as loop
from nearlift.stages import report
from nearlift.stages.diagnose import DIAGNOSIS, LOOP_RESIDUALS
from nearlift.stages.gathering import gather
from nearlift.stages.ingest import TRIALS

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
    return loop.table(evidence)


@pytest.fixture(scope="module")
def one_boundary(make_job):
    found = {"ground": FOUND["ground"]}
    return gather(diagnosed(make_job(boundaries=("ground",)), found)), found


def edited(make_job, change, boundaries=("ground",)):
    found = {b: copy.deepcopy(FOUND[b]) for b in boundaries}
    change(found)
    evidence = gather(diagnosed(make_job(boundaries=boundaries), found))
    return evidence, loop.table(evidence)


def drawn(table):
    look = style.Style()
    with style.context():
        figure = loop.draw(table, look)
        figure.draw_without_rendering()
        return figure


def panels(figure):
    """Axes by letter."""
    found = {}
    for ax in figure.axes:
        title = ax.get_title(loc="left")
        if title:
            found[title[0]] = ax
    return found


def test_every_panel_has_a_letter_of_its_own_in_reading_order(table):
    letters = [x for x in table["letter"].unique() if x]
    assert letters == list("abcdefghijkl")
    titles = [ax.get_title(loc="left") for ax in panels(drawn(table)).values()]
    assert titles == [
        "a) residual before",
        "b) residual after",
        "c) candidates",
        "d) held-out error",
        "e) coefficient",
        "f) residual",
        "g) held-out error",
        "h) coefficient",
        "i) residual",
        "j) candidates, all rejected",
        "k) held-out error",
        "l) coefficient",
    ]


def test_before_shows_the_slope_and_after_does_not(table):
    for when, slope in (("before", 100 * SLOPE), ("after", 0.0)):
        bins = pick(table, panel="ground", kind="bin", when=when)
        assert np.polyfit(bins["x"], bins["value"], 1)[0] == pytest.approx(slope, abs=2.0)
        assert set(bins["covariate"]) == {"supply_V"}


def test_bin_means_are_those_of_the_trials(table, job):
    trials, residuals = job.read(TRIALS), job.read(LOOP_RESIDUALS)
    volts = dict(zip(trials["trial"].tolist(), trials["supply_V"].tolist(), strict=True))
    before = dict(zip(residuals["trial"].tolist(), residuals["before"].tolist(), strict=True))
    cloud = pick(table, panel="ground", when="before", kind="trial")
    np.testing.assert_allclose(cloud["x"], [volts[t] for t in cloud["label"]])
    np.testing.assert_allclose(cloud["value"], [100 * before[t] for t in cloud["label"]])
    bins = pick(table, panel="ground", when="before", kind="bin")
    assert bins["n_trials"].sum() == len(cloud)
    for column in ("value", "x"):
        assert np.sum(bins["n_trials"] * bins[column]) == pytest.approx(cloud[column].sum())


def test_before_and_after_have_the_same_axes_and_bins(table):
    axes = panels(drawn(table))
    assert axes["a"].get_ylim() == axes["b"].get_ylim()
    before, after = (pick(table, panel="ground", kind="bin", when=w) for w in ("before", "after"))
    np.testing.assert_array_equal(before["x"], after["x"])


def test_no_trial_is_lost_beyond_the_axis(table):
    wild = table.copy()
    first = wild.index[(wild["kind"] == "trial") & (wild["when"] == "before")][5]
    wild.loc[first, "value"] = 300.0
    ax = panels(drawn(wild))["a"]
    reach = ax.get_ylim()[1]
    assert reach < 100
    [ticks] = [line for line in ax.lines if line.get_marker() == "|" and len(line.get_xdata()) > 0]
    assert wild.loc[first, "x"] in ticks.get_xdata()
    assert np.all(np.abs(ticks.get_ydata()) < reach)


def test_adequate_shows_one_residual_and_no_candidates(table):
    own = pick(table, panel="ceiling")
    assert set(pick(own, part="residual")["when"]) == {"before"}
    assert not len(pick(own, part="candidate"))
    assert set(pick(own, part="coefficient")["kind"]) == {"quoted", "doubt", "reference"}
    assert len(pick(own, kind="rmse")) == 1


def test_throttle_is_shown_along_distance_a_series_each(table):
    bins = pick(table, panel="ceiling", kind="bin")
    assert set(bins["covariate"]) == {"z_hat"}
    assert list(bins["series"].unique()) == ["25 %", "50 %", "75 %", "92 %"]
    legend = panels(drawn(table))["f"].get_legend()
    assert [t.get_text() for t in legend.get_texts()] == ["25 %", "50 %", "75 %", "92 %"]
    assert legend.get_title().get_text() == "throttle"


def test_bins_in_run_order_are_fine_enough_for_a_wave(table):
    """Sixteen bins would average it away."""
    bins = pick(table, panel="sidewall", kind="bin")
    wave = np.cos(2 * np.pi * 9 * (bins["x"] - 1) / bins["x"].max())
    assert np.corrcoef(bins["value"], wave)[0, 1] > 0.9
    assert np.ptp(bins["value"]) > 1.2


def test_candidates_are_ranked_by_evidence_with_what_they_leave(table):
    own = pick(table, panel="ground", part="candidate")
    assert list(own[["label", "kind", "value", "note"]].itertuples(index=False, name=None)) == [
        ("supply_sag", "named", 0.0, "named"),
        ("warm_up", "rival", 5.0, "rival"),
        ("session_gain", "worse", 16.0, "accepted"),
        ("gain_drift", "rejected", 96.0, "leaves supply voltage"),
        ("reynolds", "rejected", 1776.0, "explains too little"),
    ]
    ax = panels(drawn(table))["c"]
    marks = [line for line in ax.lines if len(line.get_xdata()) == 1]
    assert [m.get_markerfacecolor() == "white" for m in marks] == [False, False, False, True, True]
    names = ["supply sag", "warm-up", "session gain", "gain drift", "Reynolds number"]
    assert [t.get_text() for t in ax.get_yticklabels()] == names
    [outcomes] = ax.child_axes
    assert [t.get_text() for t in outcomes.get_yticklabels()][:4] == [
        "named",
        "rival",
        "accepted",
        "leaves supply voltage",
    ]


def test_a_pair_of_effects_is_a_rival_of_the_named_one(make_job):
    def pair(found):
        own = found["ground"]
        own["effects"][0]["rivals"] = ["warm_up", "tilt"]
        own["explanations"] = [["supply_sag"], ["warm_up"], ["supply_sag", "tilt"]]
        both = candidate("supply_sag + tilt", -10.0, accepted=True)
        own["rounds"].append({**own["rounds"][0], "candidates": [both]})
        own["probabilities"] = [{"effects": ["supply_sag", "tilt"], "probability": 0.21}]

    _, table = edited(make_job, pair)
    own = pick(table, part="candidate")
    assert own.set_index("label")["note"]["supply_sag + tilt"] == "rival, 21 %"
    assert dict(zip(own["label"], own["kind"], strict=True)) == {
        "supply_sag": "named",
        "warm_up": "rival",
        "supply_sag + tilt": "rival",
        "session_gain": "worse",
        "gain_drift": "rejected",
        "reynolds": "rejected",
    }
    headline = pick(table, part="verdict")["label"].iloc[0]
    assert headline == "supply_sag (or warm_up, supply_sag + tilt)"


def test_a_single_effect_is_shown_with_pairs(make_job):
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


def test_errors_have_their_interval_and_the_floor(table):
    own = pick(table, panel="ground", part="error")
    values = dict(zip(zip(own["kind"], own["when"], strict=True), own["value"], strict=True))
    assert values == {
        ("floor", ""): pytest.approx(0.4),
        ("rmse", "before"): pytest.approx(2.0),
        ("rmse", "after"): pytest.approx(0.45),
    }
    assert pick(own, when="before")["lo90"].tolist() == pytest.approx([1.8])
    ax = panels(drawn(table))["d"]
    assert {"2.00", "0.450", "0.400"} <= {t.get_text() for t in ax.texts}
    assert ax.get_ylim()[0] == 0


def test_coefficient_intervals_are_the_products(table):
    own = pick(table, panel="ground", part="coefficient")
    own = own[own["kind"] != "reference"]
    after = FOUND["ground"]["coefficients"]["after"]["K_b"]
    before = FOUND["ground"]["coefficients"]["before"]["K_b"]
    assert list(own[["note", "lo90", "hi90"]].itertuples(index=False, name=None)) == [
        ("", after["lo90"], after["hi90"]),
        ("supply_sag alone, exactly in its stated form", *after["conditional"]),
        ("base model without any effect", before["lo90"], before["hi90"]),
        ("every undetected effect at its plausible size", *after["constrained"]),
    ]
    reference = pick(table, panel="ceiling", kind="reference")
    assert (reference["value"].tolist(), reference["note"].tolist()) == ([0.125], ["theory"])
    labels = [ax.get_xlabel() for ax in drawn(table).axes]
    assert {"$a$", r"$\lambda$"} <= set(labels)


def test_the_widest_interval_is_drawn_whole(table):
    wide = table.copy()
    last = wide.index[(wide["panel"] == "ground") & (wide["kind"] == "doubt")][-1]
    wide.loc[last, ["lo90", "hi90"]] = -40.0, 60.0
    low, high = panels(drawn(wide))["e"].get_xlim()
    assert low < -40 < 60 < high


def test_after_two_effects_the_covariate_of_the_other_is_shown_too(make_job):
    def second(found):
        found["ground"]["effects"].append({"name": "gain_drift", "rivals": [], "parameters": {}})

    evidence, table = edited(make_job, second)
    residuals = pick(table, part="residual")
    assert list(residuals["covariate"].unique()) == ["supply_V", "run_order"]
    titles = [ax.get_title(loc="left")[3:] for ax in drawn(table).axes[:4]]
    assert titles == ["residual before", "residual after"] * 2
    assert "Relative residuals (a, b, c, d)" in loop.caption(evidence, table)


def test_minimal_findings_are_drawn_without_what_they_lack(make_job):
    def least(found):
        own = found["ground"]
        tried = {"name": "supply_sag", "gain": 3.0, "p_value": 0.1}
        own["rounds"] = [{"candidates": [tried], "decision": "d", "reason": "r"}]
        for key in ("error", "coefficients", "p_value"):
            del own[key]

    _, table = edited(make_job, least)
    # what is quoted is known whatever the findings lack
    assert set(table["part"]) == {"verdict", "residual", "coefficient"}
    assert sorted(panels(drawn(table))) == ["a", "b", "c"]


def test_intervals_that_could_not_be_computed_are_left_out(make_job):
    def unknown(found):
        found["ground"]["error"]["after"]["lo90"] = found["ground"]["error"]["after"]["hi90"] = None

    _, table = edited(make_job, unknown)
    assert pick(table, kind="rmse", when="after")["lo90"].isna().all()
    drawn(table)


@pytest.mark.parametrize(
    ("word", "column"),
    [
        ("distance", "z_hat"),
        ("session", "session"),
        ("approach", "z_hat"),
        ("order_in_visit", "order_in_visit"),
        ("previous_throttle", "previous_throttle_percent"),
        ("previous_distance", "previous_z_hat"),
        ("previous_lift_N", "previous_lift_N"),
        # not recorded: drawn in run order
        ("tilt", "run_order"),
        ("rig_$_colour", "run_order"),
    ],
)
def test_every_word_of_the_findings_can_be_drawn(one_boundary, word, column):
    evidence, found = one_boundary
    found = copy.deepcopy(found)
    found["ground"]["structure"] = [{"covariate": word, "p_value": 1e-9, "significant": True}]
    known = {**evidence.documents, DIAGNOSIS.file: quoted.diagnosis(found)}
    table = loop.table(replace(evidence, documents=known))
    cloud = pick(table, kind="trial", when="before")
    assert len(cloud) > 100
    assert set(cloud["covariate"]) == {column}
    assert drawn(table).axes[0].get_xlabel()


def test_bins_of_time_do_not_straddle_sessions():
    session = np.repeat([0, 1, 2], [50, 30, 100])
    label = binning.time_bins(np.random.default_rng(0).standard_normal(180), session)
    assert all(len(set(session[label == k].tolist())) == 1 for k in set(label.tolist()))
    assert sorted(set(label.tolist())) == list(range(label.max() + 1))


def test_the_figure_keeps_its_width_and_page_and_axes_do_not_overlap(table):
    look = style.Style()
    figure = drawn(table)
    assert figure.get_figwidth() == pytest.approx(look.double_in)
    assert figure.get_figheight() <= style.PAGE_IN
    width, height = figure.get_size_inches() * figure.dpi
    for ax in figure.axes:
        box = ax.get_tightbbox()
        assert box.x0 > -1
        assert box.x1 < width + 1
        assert box.y0 > -1
        assert box.y1 < height + 1
    boxes = [ax.get_window_extent() for ax in figure.axes]
    for i, one in enumerate(boxes):
        assert not any(one.overlaps(other) for other in boxes[i + 1 :])


def test_the_caption_agrees_with_the_picture(evidence, table):
    caption = loop.caption(evidence, table)
    assert "Relative residuals (a, b, f, i)" in caption
    assert "Candidates (c, j)" in caption
    assert (
        "Ground: supply_sag (or warm_up); cross-validated error 2 % to 0.45 %, noise floor 0.4 %."
        " Assumptions: (1) supply_sag alone" in caption
    )


def test_the_report_makes_it_and_shows_it_before_the_words(job, monkeypatch):
    monkeypatch.setattr(registry, "FIGURES", (loop.FIGURE,))  # the others are made elsewhere
    report.run(job)
    for kind in ("pdf", "png", "csv"):
        assert (job.reports / f"diagnosis.{kind}").stat().st_size > 1000
    text = (job.reports / "index.html").read_text()
    chapter = text[text.index('<section id="diagnosis"') :]
    assert chapter.index("diagnosis.pdf") < chapter.index("<h4>")
