"""The loop's figure: what it draws is what the products say, and nothing that they do not say."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from tests.unit import quoted

from nearlift.reduction.quality import rejected
from nearlift.report.evidence import pick
from nearlift.report.figures import diagnosis as loop
from nearlift.report.figures import style
from nearlift.stages.diagnose import DIAGNOSIS, LOOP_RESIDUALS
from nearlift.stages.gathering import gather
from nearlift.stages.ingest import TRIALS

#: What the hand-made ground residual does before the loop: relative lift per volt.
SLOPE = 0.2


def candidate(name, log_evidence, accepted=False, left_in="supply"):
    tried = {"name": name, "gain": 100.0, "p_value": 0.5, "accepted": accepted}
    return {**tried, "log_evidence": log_evidence, "left_in": None if accepted else left_in}


def around(value, share, higher=None):
    """A value and its 90 % interval, in shares of it."""
    return {"value": value, "lo90": (1 - share) * value, "hi90": (1 + (higher or share)) * value}


def block(model, verdict, covariate, errors, name, before, after=None, candidates=(), **more):
    """Findings of one boundary: structure along `covariate`, one round of candidates."""
    p, after = 1e-30 if verdict != "adequate" else 0.01, after or before
    rmse = [{"held_out_rmse": e["value"], **e} for e in (around(v, 0.1) for v in errors)]
    folds = {
        "unit": "fraction of lift",
        "noise_floor": 0.004,
        "chosen_in_folds": ["supply_sag"] * 3,
    }
    ends = {"conditional": [0.96 * after, 1.04 * after], "constrained": [0.5 * after, 1.6 * after]}
    return {
        "base_model": model,
        "verdict": verdict,
        "p_value": 0.43 if verdict == "adequate" else 1 / 1501,
        "effects": [],
        "structure": [{"covariate": covariate, "p_value": p, "significant": p < 1e-3}],
        "rounds": [{"candidates": [*candidates], "decision": "d", "reason": "r"}],
        "error": {**folds, "before": rmse[0], "after": rmse[1]},
        "coefficients": {
            "before": {name: around(before, 0.05)},
            "after": {name: around(after, 0.06, 0.08) | ends},
        },
        **more,
    }


SAG = {
    "name": "supply_sag",
    "rivals": ["warm_up"],
    "mechanism": "voltage",
    "parameters": {"sag_exponent": {"value": 2.0, "lo90": 1.9, "hi90": 2.1}},
}
GROUND = block(
    "sanchez_cuevas",
    "effect",
    "supply",
    (0.02, 0.0045),
    "K_b",
    1.6,
    1.95,
    [
        candidate("gain_drift", -60.0),
        candidate("warm_up", -14.5, accepted=True),
        candidate("supply_sag", -12.0, accepted=True),
        candidate("session_gain", -20.0, accepted=True),
        candidate("reynolds", -900.0, left_in=None),
    ],
    effects=[SAG],
    explanations=[["supply_sag"], ["warm_up"]],
)
CEILING = block("hsiao_chirarattananon", "adequate", "throttle", (0.0041, 0.0041), "alpha", 0.12)
SIDEWALL = block(
    "sidewall_decay",
    "unexplained",
    "start",
    (0.01, 0.01),
    "a",
    0.05,
    candidates=[candidate("gain_drift", -60.0, left_in="start")],
    partial=[{"name": "gain_drift", "share": 0.2}],
)
SIDEWALL["coefficients"]["before"]["lambda_"] = {"value": 0.35, "lo90": 0.3, "hi90": 0.4}
FOUND = {"ground": GROUND, "ceiling": CEILING, "sidewall": SIDEWALL}


def diagnosed(job, found):
    """Give a job hand-made findings and residuals: along supply at the ground, none at the ceiling,
    a wave in run order at the wall.
    """
    trials, rng = pd.DataFrame(job.read(TRIALS)), np.random.default_rng(1)
    parts = []
    for boundary in found:
        mine = trials[(trials["boundary"] == boundary) & ~rejected(trials["quality"])]
        n = len(mine)
        noise = 0.004 * rng.standard_normal(n)
        shape = {
            "ground": SLOPE * (mine["supply_V"].to_numpy() - 3.84),
            "sidewall": 0.01 * np.cos(2 * np.pi * 9 * np.arange(n) / n),
        }
        before = noise + shape.get(boundary, 0.0)
        after = noise if found[boundary]["verdict"] == "effect" else before
        values = (boundary, mine["trial"], before, after, before, after)
        names = (c.name for c in LOOP_RESIDUALS.columns)
        parts.append(pd.DataFrame(dict(zip(names, values, strict=True))))
    whole = pd.concat(parts, ignore_index=True)
    texts = {n: whole[n].to_numpy(dtype=object) for n in ("boundary", "trial")}
    job.write(LOOP_RESIDUALS, {str(n): x.to_numpy() for n, x in whole.items()} | texts)
    job.write(DIAGNOSIS, quoted.diagnosis(found))
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
def ground(make_job):
    """Evidence of the ground alone."""
    return gather(diagnosed(make_job(boundaries=("ground",)), {"ground": GROUND}))


def edited(ground, change):
    """Evidence and table of the ground with changed findings."""
    own = copy.deepcopy(GROUND)
    change(own)
    known = {**ground.documents, DIAGNOSIS.file: quoted.diagnosis({"ground": own})}
    evidence = replace(ground, documents=known)
    return evidence, loop.table(evidence)


def drawn(table):
    with style.context():
        figure = loop.draw(table)
        figure.draw_without_rendering()
        return figure


def panels(figure):
    """Axes by letter."""
    titled = {ax.get_title(loc="left")[:1]: ax for ax in figure.axes}
    return {letter: ax for letter, ax in titled.items() if letter}


def rows(table, *columns):
    return [*table[[*columns]].itertuples(index=False, name=None)]


def test_panels_have_a_letter_each_in_reading_order_and_do_not_overlap(table):
    """An adequate boundary has one residual and no candidates."""
    assert [x for x in table["letter"].unique() if x] == list("abcdefghijkl")
    figure = drawn(table)
    titles = [ax.get_title(loc="left")[3:] for ax in panels(figure).values()]
    assert titles == [
        *("residual before", "residual after", "candidates", "held-out error", "coefficient"),
        *("residual", "held-out error", "coefficient"),
        *("residual", "candidates, all rejected", "held-out error", "coefficient"),
    ]
    assert figure.get_figwidth() == pytest.approx(style.DOUBLE_IN)
    assert figure.get_figheight() <= style.PAGE_IN
    width, height = figure.get_size_inches() * figure.dpi
    for ax in figure.axes:
        box = ax.get_tightbbox()
        assert min(box.x0, box.y0) > -1
        assert box.x1 < width + 1
        assert box.y1 < height + 1
    boxes = [ax.get_window_extent() for ax in figure.axes]
    for i, one in enumerate(boxes):
        assert not any(one.overlaps(other) for other in boxes[i + 1 :])


def test_before_shows_the_slope_and_after_does_not_on_the_same_bins_and_axes(table):
    before, after = (pick(table, panel="ground", kind="bin", when=w) for w in ("before", "after"))
    for bins, slope in ((before, 100 * SLOPE), (after, 0.0)):
        assert np.polyfit(bins["x"], bins["value"], 1)[0] == pytest.approx(slope, abs=2.0)
        assert set(bins["covariate"]) == {"supply_V"}
    np.testing.assert_array_equal(before["x"], after["x"])
    axes = panels(drawn(table))
    assert axes["a"].get_ylim() == axes["b"].get_ylim()


def test_dots_and_bin_means_are_those_of_the_trials(table, job):
    trials, residuals = (pd.DataFrame(job.read(p)) for p in (TRIALS, LOOP_RESIDUALS))
    cloud = pick(table, panel="ground", when="before", kind="trial")
    both = residuals.merge(trials[["trial", "supply_V"]], on="trial").set_index("trial")
    np.testing.assert_allclose(cloud["x"], both["supply_V"][cloud["label"]])
    np.testing.assert_allclose(cloud["value"], 100 * both["before"][cloud["label"]])
    bins = pick(table, panel="ground", when="before", kind="bin")
    assert bins["n_trials"].sum() == len(cloud)
    for column in ("value", "x"):
        assert np.sum(bins["n_trials"] * bins[column]) == pytest.approx(cloud[column].sum())


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


def test_throttle_is_shown_along_distance_a_series_each(table):
    bins, series = pick(table, panel="ceiling", kind="bin"), ["25 %", "50 %", "75 %", "92 %"]
    assert set(bins["covariate"]) == {"z_hat"}
    assert list(bins["series"].unique()) == series
    legend = panels(drawn(table))["f"].get_legend()
    assert [t.get_text() for t in (legend.get_title(), *legend.get_texts())] == [
        "throttle",
        *series,
    ]


def test_bins_in_run_order_are_fine_enough_for_a_wave(table):
    """Sixteen bins would average it away."""
    bins = pick(table, panel="sidewall", kind="bin")
    wave = np.cos(2 * np.pi * 9 * (bins["x"] - 1) / bins["x"].max())
    assert np.corrcoef(bins["value"], wave)[0, 1] > 0.9
    assert np.ptp(bins["value"]) > 1.2


def test_candidates_are_ranked_by_evidence_with_what_they_leave(table):
    own = pick(table, panel="ground", part="candidate")
    assert rows(own, "label", "kind", "value", "note") == [
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
    assert [t.get_text() for t in outcomes.get_yticklabels()] == list(own["note"])


def test_a_pair_of_effects_is_a_rival_of_the_named_one(ground):
    def pair(own):
        own["effects"][0]["rivals"] = ["warm_up", "tilt"]
        own["explanations"] = [["supply_sag"], ["warm_up"], ["supply_sag", "tilt"]]
        both = candidate("supply_sag + tilt", -10.0, accepted=True)
        own["rounds"].append({**own["rounds"][0], "candidates": [both]})
        own["probabilities"] = [{"effects": ["supply_sag", "tilt"], "probability": 0.21}]

    _, table = edited(ground, pair)
    own = pick(table, part="candidate", label="supply_sag + tilt")
    assert rows(own, "kind", "note") == [("rival", "rival, 21 %")]
    headline = pick(table, part="verdict")["label"].iloc[0]
    assert headline == "supply_sag (or warm_up, supply_sag + tilt)"


def test_a_single_effect_is_shown_with_pairs(ground):
    def pairs(own):
        listed = [candidate(f"supply_sag + e{i}", -10.0 - i, accepted=True) for i in range(9)]
        rounds = ([candidate("gain_drift", -70.0)], listed)
        own["rounds"] = [{**own["rounds"][0], "candidates": c} for c in rounds]

    _, table = edited(ground, pairs)
    shown = pick(table, part="candidate")["label"].tolist()
    assert len(shown) == loop.CANDIDATES
    assert shown[-1] == "gain_drift"


def test_errors_have_their_interval_and_the_floor(table):
    own = pick(table, panel="ground", part="error").set_index(["kind", "when"])
    assert own["value"].to_dict() == pytest.approx(
        {("floor", ""): 0.4, ("rmse", "before"): 2.0, ("rmse", "after"): 0.45}
    )
    assert own["lo90"]["rmse", "before"] == pytest.approx(1.8)
    ax = panels(drawn(table))["d"]
    assert {"2.00", "0.450", "0.400"} <= {t.get_text() for t in ax.texts}
    assert ax.get_ylim()[0] == 0


def test_coefficient_intervals_are_the_products_and_drawn_whole(table):
    own = pick(table, panel="ground", part="coefficient")
    before, after = (GROUND["coefficients"][when]["K_b"] for when in ("before", "after"))
    assert rows(own[own["kind"] != "reference"], "note", "lo90", "hi90") == [
        ("", after["lo90"], after["hi90"]),
        ("supply_sag alone, exactly in its stated form", *after["conditional"]),
        ("base model without any effect", before["lo90"], before["hi90"]),
        ("every undetected effect at its plausible size", *after["constrained"]),
    ]
    assert rows(pick(table, panel="ceiling", kind="reference"), "value", "note") == [
        (0.125, "theory")
    ]
    wide = table.copy()
    last = wide.index[(wide["panel"] == "ground") & (wide["kind"] == "doubt")][-1]
    wide.loc[last, ["lo90", "hi90"]] = -40.0, 60.0
    figure = drawn(wide)
    low, high = panels(figure)["e"].get_xlim()
    assert low < -40 < 60 < high
    assert {"$a$", r"$\lambda$"} <= {ax.get_xlabel() for ax in figure.axes}


def test_a_coefficient_without_a_symbol_has_its_name(table):
    """As those of a package's model have."""
    named = table.replace({"label": {"K_b": "my_gain"}})
    assert "my_gain" in {ax.get_xlabel() for ax in drawn(named).axes}


def test_after_two_effects_the_covariate_of_the_other_is_shown_too(ground):
    drift = {"name": "gain_drift", "rivals": [], "parameters": {}}
    evidence, table = edited(ground, lambda own: own["effects"].append(drift))
    residuals = pick(table, part="residual")
    assert list(residuals["covariate"].unique()) == ["supply_V", "run_order"]
    titles = [ax.get_title(loc="left")[3:] for ax in drawn(table).axes[:4]]
    assert titles == ["residual before", "residual after"] * 2
    assert "Relative residuals (a, b, c, d)" in loop.caption(evidence, table)


def test_minimal_findings_are_drawn_without_what_they_lack(ground):
    def least(own):
        tried = {"name": "supply_sag", "gain": 3.0, "p_value": 0.1}
        own["rounds"] = [{"candidates": [tried], "decision": "d", "reason": "r"}]
        for key in ("error", "coefficients", "p_value"):
            del own[key]

    _, table = edited(ground, least)
    # what is quoted is known whatever the findings lack
    assert set(table["part"]) == {"verdict", "residual", "coefficient"}
    assert sorted(panels(drawn(table))) == ["a", "b", "c"]
    none = {"lo90": None, "hi90": None}
    _, table = edited(ground, lambda own: own["error"]["after"].update(none))
    assert pick(table, kind="rmse", when="after")["lo90"].isna().all()
    drawn(table)


@pytest.mark.parametrize(
    ("word", "column"),
    [
        ("approach", "z_hat"),
        ("previous_throttle", "previous_throttle_percent"),
        # not recorded: drawn in run order
        ("rig_$_colour", "run_order"),
    ],
)
def test_every_word_of_the_findings_can_be_drawn(ground, word, column):
    structure = [{"covariate": word, "p_value": 1e-9, "significant": True}]
    _, table = edited(ground, lambda own: own.update(structure=structure))
    cloud = pick(table, kind="trial", when="before")
    assert len(cloud) > 100
    assert set(cloud["covariate"]) == {column}
    assert drawn(table).axes[0].get_xlabel()


def test_the_caption_agrees_with_the_picture(evidence, table):
    caption = loop.caption(evidence, table)
    assert "Relative residuals (a, b, f, i)" in caption
    assert "Candidates (c, j)" in caption
    assert (
        "Ground: supply_sag (or warm_up); cross-validated error 2 % to 0.45 %, noise floor 0.4 %."
        " Assumptions: (1) supply_sag alone" in caption
    )
