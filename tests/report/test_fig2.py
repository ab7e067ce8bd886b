"""What Figure 2 says, read from its table: the same numbers as lift.parquet and the models, in
percent.
"""

from __future__ import annotations

import copy
import csv
import dataclasses
import io
import re
import shutil

import numpy as np
import pytest
from tests.unit import quoted

from nearlift import catalogue
from nearlift.errors import InputRefused, ManifestError
from nearlift.report import relative_lift, words
from nearlift.report.evidence import pick as rows
from nearlift.report.figures import binning, fig2, residuals
from nearlift.report.phrases import coefficient_text
from nearlift.report.tables import csv as to_csv
from nearlift.stages.diagnose import DIAGNOSIS, LOOP_RESIDUALS
from nearlift.stages.fit import FIT, POSTERIOR, RESULTS
from nearlift.stages.gathering import gather
from nearlift.stages.reduce import LIFT


@pytest.fixture(scope="module")
def evidence(small_job):
    return gather(small_job)


@pytest.fixture(scope="module")
def table(evidence):
    return fig2.table(evidence)


def test_data_are_lift_over_the_fitted_level(evidence, table):
    cells = evidence.table(LIFT)
    for boundary in ("ground", "ceiling", "sidewall"):
        drawn, mine = rows(table, panel=boundary, kind="data"), cells["boundary"] == boundary
        levels = evidence.base(boundary)[1].posterior.L_inf_N
        level = np.array([levels[t].median for t in cells["throttle"][mine]])
        # the mean of logs is below the log of the mean by half the scatter squared
        np.testing.assert_allclose(
            1 + drawn["delta_L_percent"] / 100, cells["lift_N"][mine] / level, rtol=1e-4
        )
        np.testing.assert_allclose(drawn["z_hat"], cells["z_hat"][mine])


@pytest.mark.parametrize("effects", [(), ("supply_sag",)])
def test_points_at_scattered_heights_stand_about_the_line_by_their_bars(evidence, effects):
    """Chi2 over the cells, each one trial, with the simulated noise told to the fit: within four
    standard deviations of its mean.

    An effect that changes lift by 3 % from trial to trial is corrected for by the residual of the
    whole model.
    """
    rng = np.random.default_rng(4)
    n, throttles, noise = 240, np.array([0.25, 0.5, 0.75, 0.92]), 0.01
    made, entry = quoted.fitted(copy.deepcopy(evidence), "ground")
    data = made.observations["ground"]
    z = np.exp(rng.uniform(np.log(1.1), np.log(12.0), n))
    line = relative_lift.line(made, "ground", z).middle
    levels = entry["posterior"]["L_inf_N"]
    throttle = throttles[np.arange(n) % 4]
    error = noise * rng.standard_normal(n)
    other = 0.03 * rng.standard_normal(n) * bool(effects)
    level = np.array([levels[f"{t:g}"]["median"] for t in throttle])
    trial = np.array([f"s{i}" for i in range(n)], dtype=object)
    lift = level * (1 + line) * np.exp(error + other)
    scattered = dataclasses.replace(
        data,
        trial=trial,
        z_hat=z,
        lift_N=lift,
        u_lift_N=1e-9 * lift,
        n_eff=np.full(n, 1e3),
        throttle=throttle,
        visit=np.arange(n),
        session=np.zeros(n, dtype=np.int64),
        covariates={},
    )
    made = dataclasses.replace(made, observations={**made.observations, "ground": scattered})
    scatter = {"relative": noise, "force_N": 0.0, "height_m": 0.0, "common": 0.0}
    made.document(FIT)["noise"]["ground"] |= scatter
    if effects:
        residuals = {
            "boundary": np.full(n, "ground", dtype=object),
            "trial": trial,
            "before": error + other,
            "after": error,
        }
        own = made.document(RESULTS)["boundaries"]["ground"]
        own["effects"] = list(effects)
        own["correlation"] = {"parameters": ["K_b"], "values": [[1.0]]}
        floor = {**quoted.EMPTY_BLOCK["noise_floor"], **scatter}
        best = {k: own["coefficients"]["K_b"][k] for k in ("value", "lo90", "hi90")}
        block = {
            "verdict": "effect",
            "noise_floor": floor,
            "effects": [{"name": name, "parameters": {}} for name in effects],
            "coefficients": {"after": {"K_b": best}},
        }
        diagnosis = quoted.diagnosis({"ground": block})
        made = dataclasses.replace(
            made,
            tables={**made.tables, LOOP_RESIDUALS.file: residuals},
            documents={**made.documents, DIAGNOSIS.file: diagnosis},
        )
    over = relative_lift.relative_lift(made, "ground")
    away = (over.delta_L - relative_lift.line(made, "ground", over.z_hat).middle) / over.u
    assert abs(float(away @ away) - n) < 4 * np.sqrt(2 * n)
    # sixty trials a throttle, and the coefficient's slope beside the level
    assert noise / np.sqrt(60) < over.u_L_inf < 3 * noise / np.sqrt(60)
    assert relative_lift.quoted_model(made, "ground").in_points == effects
    assert ("are corrected for" in fig2.fit_note(made, "ground")) == bool(effects)


@pytest.mark.parametrize("mean_over_rivals", [None, 0.3])
def test_an_effect_of_distance_is_in_the_line_and_the_points_are_as_measured(
    evidence, mean_over_rivals
):
    """An offset of 0.1 rotor radii at a ceiling: the line is the model at recorded distance plus
    offset, the points are lift over L_inf at recorded distance. A mean over rivals changes neither,
    and the band is that of the explanation that is drawn.
    """
    made = copy.deepcopy(evidence)
    data, (model, _) = made.observations["ceiling"], made.base("ceiling")
    offset_m, alpha = 0.1 * data.radius_m, 0.125
    level = {t: 0.1 + t for t in data.levels.tolist()}
    levels = np.array([level[t] for t in data.throttle.tolist()])
    far = np.random.default_rng(2).normal(0, 0.004, data.n)
    lift = levels * model(data.z_hat + 0.1, alpha=alpha) * np.exp(far)
    own = made.document(RESULTS)["boundaries"]["ceiling"]
    own["effects"], own["correlation"] = ["height_offset"], {"parameters": [], "values": []}
    own["coefficients"]["alpha"] |= {"value": mean_over_rivals or alpha}
    size = {"offset_m": {"value": offset_m, "lo90": offset_m, "hi90": offset_m}}
    ends = {"lo90": alpha - 1e-3, "hi90": alpha + 1e-3}
    block = {
        "verdict": "effect",
        "effects": [{"name": "height_offset", "parameters": size}],
        "coefficients": {"after": {"alpha": {"value": alpha, **ends}}},
    }
    residual = {"boundary": np.full(data.n, "ceiling", dtype=object), "trial": data.trial}
    made = dataclasses.replace(
        made,
        observations={**made.observations, "ceiling": dataclasses.replace(data, lift_N=lift)},
        tables={**made.tables, LOOP_RESIDUALS.file: residual | {"before": far, "after": far}},
        documents={**made.documents, DIAGNOSIS.file: quoted.diagnosis({"ceiling": block})},
    )
    table = fig2.table(made)
    band, points = (rows(table, panel="ceiling", kind=kind) for kind in ("band", "data"))
    moved = 100 * (model(band["z_hat"].to_numpy() + 0.1, alpha=alpha) - 1)
    np.testing.assert_allclose(band["delta_L_percent"], moved, rtol=1e-5)
    assert set(band["label"]) == {"H-C with height offset, fitted"}
    for row in points.itertuples():
        mine = (data.z_hat == row.z_hat) & np.isclose(data.throttle, row.throttle_fraction)
        measured = np.exp(np.mean(np.log(lift[mine] / levels[mine]))) - 1
        assert row.delta_L_percent == pytest.approx(100 * measured)
    assert (points["corrected_for"] == "").all()
    for end, x in ends.items():
        edge = 100 * (model(band["z_hat"].to_numpy() + 0.1, alpha=x) - 1)
        np.testing.assert_allclose(band[f"{end}_percent"], edge, rtol=1e-3)
    assert "The points are as measured. The line includes height offset" in fig2.caption(
        made, table
    )


def test_a_stated_datum_moves_every_part_of_the_line(evidence):
    """The effect saturates at true distance, as the model does."""
    made = copy.deepcopy(evidence)
    data = made.observations["ceiling"]
    made.document(RESULTS)["boundaries"]["ceiling"]["effects"] = ["near_wall_saturation"]
    known = {"alpha": 0.15, "offset_m": -2e-4, "gap_hat2": 0.12, "saturation_power": 0.4}
    parameters = {n: {"value": x, "lo90": x, "hi90": x, "u": 0.0} for n, x in known.items()}
    accepted = {
        "effects": ["near_wall_saturation"],
        "parameters": parameters,
        "covariance": {"names": [*known], "values": np.zeros((4, 4)).tolist()},
    }
    block = {"verdict": "effect", "accepted": accepted}
    left = {"boundary": np.full(data.n, "ceiling", dtype=object), "trial": data.trial}
    made = dataclasses.replace(
        made,
        tables={
            **made.tables,
            LOOP_RESIDUALS.file: left | dict.fromkeys(("before", "after"), np.zeros(data.n)),
        },
        documents={**made.documents, DIAGNOSIS.file: quoted.diagnosis({"ceiling": block})},
    )
    z_hat = np.array([0.1, 0.3, 2.0])
    moved = z_hat - 2e-4 / data.radius_m
    theory = 0.5 + 0.5 * np.sqrt(1 + 0.15 / moved**2)
    expected = (theory - 1) * (1 + 0.12 / moved**2) ** -0.4
    assert relative_lift.line(made, "ceiling", z_hat).middle == pytest.approx(expected)


def test_theory_curves_take_the_published_values(table):
    line = rows(table, panel="ground", label="C-B (theory)")
    np.testing.assert_allclose(
        line["delta_L_percent"], 100 * (1 / (1 - 1 / (16 * line["z_hat"] ** 2)) - 1)
    )
    line = rows(table, panel="ceiling", label="H-C (theory)")
    np.testing.assert_allclose(
        line["delta_L_percent"], 50 * (np.sqrt(1 + 1 / (8 * line["z_hat"] ** 2)) - 1)
    )
    own = rows(table, panel="ground", label="S-C, K_b = 2")
    geometry = {"spacing_hat": 65 / 23, "diagonal_hat": np.sqrt(2) * 65 / 23}
    np.testing.assert_allclose(
        own["delta_L_percent"],
        100 * (catalogue.model("sanchez_cuevas")(own["z_hat"], K_b=2.0, **geometry) - 1),
    )
    line = rows(table, panel="ground", label="S-C (PQuad)")
    model = catalogue.model("sanchez_cuevas")
    np.testing.assert_allclose(
        line["delta_L_percent"],
        100 * (model(line["z_hat"], K_b=2.0, spacing_hat=3.0, diagonal_hat=3 * np.sqrt(2)) - 1),
    )


def test_the_line_is_drawn_for_where_the_rotor_stood(evidence):
    moved, entry = quoted.fitted(evidence, "ceiling")
    entry["height_error"] = {"value": 2e-4, "u": 1e-4, "unit": "m"}
    still, entry = quoted.fitted(evidence, "ceiling")
    entry.pop("height_error", None)
    again = fig2.table(moved)
    plain, shifted = (rows(t, panel="ceiling", kind="band") for t in (fig2.table(still), again))
    np.testing.assert_array_equal(shifted["z_hat"], plain["z_hat"])
    model, fit = moved.base("ceiling")
    stood = shifted["z_hat"] + 2e-4 / moved.observations["ceiling"].radius_m
    arguments = {**moved.known("ceiling", model), **fit.values}
    # the posterior's median is within a thousandth of the fit here; the shift in height takes a
    # twentieth
    np.testing.assert_allclose(
        shifted["delta_L_percent"], 100 * (model(stood, **arguments) - 1), rtol=2e-3
    )
    assert shifted["delta_L_percent"][0] < 0.95 * plain["delta_L_percent"][0]
    assert "0.2 mm farther than recorded" in fig2.caption(moved, again)
    assert (
        "than recorded" not in fig2.caption(still, again).split("Sidewall:")[0].split("Ceiling:")[1]
    )


def test_band_holds_90_percent_of_draws_from_the_parameters(evidence, table):
    _, fit = evidence.base("sidewall")
    rng = np.random.default_rng(3)
    draws = rng.multivariate_normal([*fit.values.values()], fit.covariance.values, 4000)
    band = rows(table, panel="sidewall", kind="band")
    curve = 100 * (
        catalogue.model("sidewall_decay").evaluate(
            band["z_hat"], a=draws[:, :1], lambda_=draws[:, 1:]
        )
        - 1
    )
    low, high = (band[f"{end}90_percent"].to_numpy() for end in ("lo", "hi"))
    inside = ((curve >= low) & (curve <= high)).mean(axis=0)
    near = band["z_hat"] < 1
    assert np.all(np.abs(inside[near] - 0.9) < 0.03)


def test_line_and_band_are_of_one_posterior_and_least_squares_is_its_own_line(evidence):
    """A prior moves the posterior off the least squares: each is drawn under its own name, and the
    caption has what is quoted.
    """
    model, fit = evidence.base("ground")
    draws = evidence.table(POSTERIOR)
    mine = (
        (draws["boundary"] == "ground")
        & (draws["model"] == model.name)
        & (draws["parameter"] == "K_b")
    )
    moved = copy.deepcopy(evidence)
    value = moved.table(POSTERIOR)["value"]
    value[mine] = 1.0 + 0.5 * (value[mine] - value[mine].mean())
    moved, entry = quoted.fitted(moved, "ground")
    told = entry["posterior"]["parameters"]["K_b"]
    told |= {"median": float(np.median(value[mine])), "lo90": 0.9, "hi90": 1.1, "u": 0.06}
    table = fig2.table(moved)
    line, fitted = (rows(table, panel="ground", kind=kind) for kind in ("band", "least squares"))
    known = moved.known("ground", model)
    at_median = 100 * (model(line["z_hat"], **known, K_b=float(np.median(value[mine]))) - 1)
    np.testing.assert_allclose(line["delta_L_percent"], at_median, rtol=1e-6)
    np.testing.assert_allclose(
        fitted["delta_L_percent"],
        100 * (model(fitted["z_hat"], **known, **fit.values) - 1),
        rtol=1e-9,
    )
    assert (
        (line["lo90_percent"] < line["delta_L_percent"])
        & (line["delta_L_percent"] < line["hi90_percent"])
    ).all()
    assert (set(line["label"]), set(fitted["label"])) == (
        {"S-C, fitted"},
        {"S-C, least squares"},
    )
    text = fig2.caption(moved, table)
    assert "Thin line (ground): least squares, which differs visibly." in text
    own = moved.quoted("ground").coefficients["K_b"]
    assert f"({coefficient_text(own, 'K_b')}, k = 1)" in text
    moved, entry = quoted.fitted(moved, "ground")
    entry["posterior"]["parameters"]["K_b"]["lo90"] = entry["parameters"]["K_b"]["lo90"] = None
    endless = rows(fig2.table(moved), panel="ground", kind="band")
    assert np.isnan(endless["lo90_percent"]).all()
    assert "No band (ground)" in fig2.caption(moved, fig2.table(moved))


def test_where_structure_stays_unexplained_line_and_band_are_what_is_quoted(evidence, monkeypatch):
    """The base fit stands beside as least squares; a band is the interval, however uneven."""
    own, before = evidence.quoted("ground"), type(evidence).quoted
    K_b = dataclasses.replace(own.coefficients["K_b"], value=1.5, lo90=1.4, hi90=2.5)
    away = dataclasses.replace(
        own, verdict="unexplained", coefficients={**own.coefficients, "K_b": K_b}
    )
    monkeypatch.setattr(
        type(evidence), "quoted", lambda self, b: away if b == "ground" else before(self, b)
    )
    model, fit = evidence.base("ground")
    table = fig2.table(evidence)
    line, plain = (rows(table, panel="ground", kind=kind) for kind in ("band", "least squares"))
    known = evidence.known("ground", model)
    for column, value in (("delta_L_percent", 1.5), ("lo90_percent", 1.4), ("hi90_percent", 2.5)):
        drawn = 100 * (model(line["z_hat"], **known, K_b=value) - 1)
        np.testing.assert_allclose(line[column], drawn, rtol=1e-9)
    fitted = 100 * (model(plain["z_hat"], **known, **fit.values) - 1)
    np.testing.assert_allclose(plain["delta_L_percent"], fitted, rtol=1e-9)


def test_every_row_of_the_table_can_be_drawn(evidence, table):
    """The band of L_inf has ends and no Delta L; every other row is a point of its curve."""
    level = rows(table, panel="ground", kind="L_inf")
    known = relative_lift.relative_lift(evidence, "ground").u_L_inf
    assert level["u_delta_L_percent"].tolist() == pytest.approx(2 * [100 * known])
    assert np.isnan(level["delta_L_percent"]).all()
    assert np.isfinite(table["delta_L_percent"][table["kind"] != "L_inf"]).all()
    band = rows(table, panel="ground", kind="band")
    np.testing.assert_allclose(band["above_fit_percent"], 0, atol=1e-12)


def test_no_curve_is_drawn_beyond_the_stations(table):
    for boundary in ("ground", "ceiling", "sidewall"):
        data, mine = rows(table, panel=boundary, kind="data"), rows(table, panel=boundary)
        assert mine["z_hat"].min() >= data["z_hat"].min() * (1 - 1e-9)
        assert mine["z_hat"].max() <= data["z_hat"].max() * (1 + 1e-9)


def test_caption_says_what_is_assumed_and_what_the_bars_are(evidence, table):
    text = fig2.caption(evidence, table)
    for said in (
        "Bars: 1 standard uncertainty from scatter",
        "central 90 %",
        "unpublished rotor spacing",
        "360 mm",
        "K_b = 2",
        "u(L∞) = ",
    ):
        assert said in text


def test_one_rotor_is_not_compared_with_a_quadrotor(make_job):
    job = make_job(
        boundaries=("ground",),
        vehicle={"name": "one", "rotors": 1, "rotor_radius": "23 mm", "mass": "27 g"},
    )
    table = fig2.table(gather(job))
    assert set(table["label"][table["kind"] == "model"]) == {"C-B (theory)"}
    assert "PQuad" not in fig2.caption(gather(job), table)


def test_overlay_is_drawn_and_refusals_say_where(make_job, tmp_path):
    overlay = {"file": "other.csv", "label": "=Other group", "boundary": "ground"}
    job = make_job(boundaries=("ground",), report={"overlay": [overlay]})
    with pytest.raises(ManifestError, match=r"there is no file 'other\.csv'"):
        gather(job)
    file = job.root / "other.csv"
    file.write_text("# digitised\nz_hat,delta_L,u\n1.5,0.1,0.01\n2,0.05,\n")
    table = fig2.table(gather(job))
    drawn = rows(table, kind="overlay")
    np.testing.assert_allclose(drawn["delta_L_percent"], [10, 5])
    np.testing.assert_allclose(drawn["u_delta_L_percent"], [1, np.nan])
    assert b"\nground,overlay,'=Other group," in to_csv(table)
    file.write_text("z_hat,delta_L\n1,2\n")
    with pytest.raises(InputRefused, match="lacks u"):
        gather(job)
    file.write_text("z_hat,delta_L,u\n1,0.1,0.01\n-1,0.1,0.01\n")
    with pytest.raises(InputRefused, match=r"line 3: z_hat = '-1' is not a distance"):
        gather(job)
    (tmp_path / "outside.csv").write_text("z_hat,delta_L,u\n1,0.1,0.01\n")
    file.unlink()
    file.symlink_to(tmp_path / "outside.csv")
    with pytest.raises(ManifestError, match="outside the campaign's folder"):
        gather(job)


def test_an_overlay_is_a_file_or_a_campaign_of_the_workspace(make_job):
    job = make_job(boundaries=("ground",), report={"overlay": ["other.csv", "pitt"]})
    (job.root / "other.csv").write_text(
        "boundary,z_hat,delta_L,u\nground,1.5,0.1,0.01\nceiling,0.5,0.2,0.01\n,2,0.05,\n"
    )
    with pytest.raises(ManifestError, match="no campaign of that name was run here"):
        gather(job)
    other = job.processed.parent / "pitt"
    other.mkdir()
    shutil.copy(job.processed / LIFT.file, other / LIFT.file)
    evidence = gather(job)
    table = fig2.table(evidence)
    np.testing.assert_allclose(rows(table, label="other")["z_hat"], [1.5, 2.0])
    cells = evidence.table(LIFT)
    np.testing.assert_allclose(rows(table, label="pitt")["delta_L_percent"], 100 * cells["delta_L"])


def test_csv_holds_what_is_drawn_and_no_formula(table):
    text = to_csv(table).decode()
    read = list(csv.DictReader(io.StringIO(text)))
    assert len(read) == len(table["panel"])
    assert list(read[0]) == list(table)
    np.testing.assert_allclose(
        [float(r["delta_L_percent"] or "nan") for r in read], table["delta_L_percent"], rtol=1e-8
    )
    hostile = {
        "label": np.array(["=1+1", "+x", "-x", "@x", "fine", None], dtype=object),
        "x": np.array([-1.0, np.nan, np.inf, 0, 1, 2]),
    }
    assert to_csv(hostile).decode().splitlines() == [
        "label,x",
        "'=1+1,-1",
        "'+x,",
        "'-x,",
        "'@x,0",
        "fine,1",
        ",2",
    ]


def test_residuals_are_those_of_the_fit(evidence):
    for boundary in ("ground", "ceiling", "sidewall"):
        _, fit = evidence.base(boundary)
        of = residuals.residuals(evidence, boundary)
        assert of.base is None
        assert np.sqrt(np.mean(of.quoted**2)) == pytest.approx(fit.rmse, rel=1e-6)
        assert 0.7 < np.mean((of.quoted / of.sigma) ** 2) < 1.3


def test_bins_hold_every_trial_once_and_their_means_are_right(evidence):
    table = residuals.table(evidence, every=True)
    mine = rows(table, panel="ground", covariate="supply_V")
    trials, means = rows(mine, kind="trial"), rows(mine, kind="bin")
    assert means["n_trials"].sum() == len(trials["x"])
    weighted = np.sum(means["residual_percent"] * means["n_trials"]) / means["n_trials"].sum()
    assert weighted == pytest.approx(trials["residual_percent"].mean(), abs=1e-12)
    assert set(rows(table, panel="ground", kind="trial")["trial"]) <= set(
        evidence.observations["ground"].trial
    )
    assert "t0003" not in set(table["trial"])


def test_a_mean_never_stands_in_a_gap_of_its_covariate():
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(0, 1, 300), rng.uniform(9, 10, 300)])
    label = binning.bins(x)
    centres = np.bincount(label, x) / np.bincount(label)
    assert not np.any((centres > 1) & (centres < 9))
    assert set(label) == set(range(label.max() + 1))
    assert binning.bins(np.array([1.0, -1.0, 1.0])).tolist() == [1, 0, 1]


def test_where_an_effect_is_quoted_the_base_fit_is_shown_too(evidence):
    data = evidence.observations["ground"]
    own = copy.deepcopy(evidence.document(RESULTS))
    own["boundaries"]["ground"]["effects"] = ["supply_sag"]
    wave = 0.02 * np.cos(np.arange(data.n))
    left = {"boundary": np.full(data.n, "ground", dtype=object), "trial": data.trial}
    made = dataclasses.replace(
        evidence,
        tables={**evidence.tables, LOOP_RESIDUALS.file: left | {"before": wave, "after": 0 * wave}},
        documents={
            **evidence.documents,
            RESULTS.file: own,
            DIAGNOSIS.file: quoted.diagnosis({"ground": {"verdict": "effect"}}),
        },
    )
    table = residuals.table(made)
    of = {k: rows(table, panel="ground", covariate="z_hat", kind=k) for k in ("bin", "base")}
    assert np.abs(of["bin"]["residual_percent"]).max() < 1e-12
    mean = np.average(of["base"]["residual_percent"], weights=of["base"]["n_trials"])
    assert mean == pytest.approx(100 * wave.mean())
    assert not (rows(table, panel="ceiling")["kind"] == "base").any()
    assert "Hollow squares" in residuals.caption(made, table)


def test_captions_count_the_rejected(evidence):
    text = residuals.caption(evidence, residuals.table(evidence))
    assert "1 rejected (not shown)" in text


def test_the_distance_of_a_change_of_two_percent_is_printed(evidence):
    for boundary in ("ground", "ceiling", "sidewall"):
        text = words.Brief(evidence, boundary).reach
        z_hat = float(re.search(r"ẑ = ([\d.]+) ", text)[1])
        change = relative_lift.line(evidence, boundary, np.array([z_hat])).middle[0]
        assert abs(change) == pytest.approx(0.02, rel=0.02)
