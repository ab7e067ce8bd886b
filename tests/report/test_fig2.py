"""What Figure 2 says, read from its table: the same numbers as lift.parquet and the models, in
percent.
"""

from __future__ import annotations

import copy
import dataclasses
import re

import numpy as np
import pytest
from tests.unit import quoted

from nearlift import catalogue
from nearlift.report import curves, words
from nearlift.report.evidence import pick
from nearlift.report.figures import fig2
from nearlift.report.phrases import coefficient_text
from nearlift.stages.diagnose import DIAGNOSIS, LOOP_RESIDUALS
from nearlift.stages.fit import FIT, POSTERIOR, RESULTS
from nearlift.stages.gathering import gather
from nearlift.stages.reduce import LIFT

SIDES = ("ground", "ceiling", "sidewall")


@pytest.fixture(scope="module")
def table(evidence):
    return fig2.table(evidence)


def diagnosed(evidence, boundary, block, left):
    """The evidence with one finding, and its residuals before and after."""
    data = evidence.observations[boundary]
    residuals = {"boundary": np.full(data.n, boundary, dtype=object), "trial": data.trial, **left}
    return dataclasses.replace(
        evidence,
        tables={**evidence.tables, LOOP_RESIDUALS.file: residuals},
        documents={**evidence.documents, DIAGNOSIS.file: quoted.diagnosis({boundary: block})},
    )


def percent(model, z_hat, **known):
    return 100 * (model(np.asarray(z_hat), **known) - 1)


@pytest.mark.parametrize("boundary", SIDES)
def test_data_are_lift_over_the_fitted_level(evidence, table, boundary):
    cells = evidence.table(LIFT)
    drawn, mine = pick(table, panel=boundary, kind="data"), cells["boundary"] == boundary
    levels = evidence.base(boundary)[1].posterior.L_inf_N
    level = np.array([levels[t].median for t in cells["throttle"][mine]])
    # the mean of logs is below the log of the mean by half the scatter squared
    np.testing.assert_allclose(
        1 + drawn["delta_L_percent"] / 100, cells["lift_N"][mine] / level, rtol=1e-4
    )
    np.testing.assert_allclose(drawn["z_hat"], cells["z_hat"][mine])


@pytest.mark.parametrize("boundary", SIDES)
def test_every_row_can_be_drawn_within_the_stations(evidence, table, boundary):
    """The band of L_inf has ends and no Delta L; every other row is a point of its curve."""
    mine = pick(table, panel=boundary)
    data, level = pick(mine, kind="data"), pick(mine, kind="L_inf")
    assert mine["z_hat"].min() >= data["z_hat"].min() * (1 - 1e-9)
    assert mine["z_hat"].max() <= data["z_hat"].max() * (1 + 1e-9)
    known = curves.relative_lift(evidence, boundary).u_L_inf
    assert level["u_delta_L_percent"].tolist() == pytest.approx(2 * [100 * known])
    assert np.isnan(level["delta_L_percent"]).all()
    assert np.isfinite(mine["delta_L_percent"][mine["kind"] != "L_inf"]).all()
    np.testing.assert_allclose(pick(mine, kind="band")["above_fit_percent"], 0, atol=1e-12)


def test_points_at_scattered_heights_lie_about_the_line_by_their_bars(evidence):
    """Chi2 over the cells, each one trial, with the simulated noise told to the fit: within four
    standard deviations of its mean.

    An effect that changes lift by 3 % from trial to trial is corrected for by the residual of the
    whole model.
    """
    rng = np.random.default_rng(4)
    n, throttles, noise = 240, np.array([0.25, 0.5, 0.75, 0.92]), 0.01
    made, entry = quoted.fitted(copy.deepcopy(evidence), "ground")
    z = np.exp(rng.uniform(np.log(1.1), np.log(12.0), n))
    throttle = throttles[np.arange(n) % 4]
    error, other = noise * rng.standard_normal(n), 0.03 * rng.standard_normal(n)
    level = np.array([entry["posterior"]["L_inf_N"][f"{t:g}"]["median"] for t in throttle])
    lift = level * (1 + curves.line(made, "ground", z).middle) * np.exp(error + other)
    scattered = dataclasses.replace(
        made.observations["ground"],
        trial=np.array([f"s{i}" for i in range(n)], dtype=object),
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
    own = made.document(RESULTS)["boundaries"]["ground"]
    own |= {"effects": ["supply_sag"], "correlation": {"parameters": ["K_b"], "values": [[1.0]]}}
    best = {k: own["coefficients"]["K_b"][k] for k in ("value", "lo90", "hi90")}
    block = {
        "verdict": "effect",
        "noise_floor": {**quoted.EMPTY_BLOCK["noise_floor"], **scatter},
        "effects": [{"name": "supply_sag", "parameters": {}}],
        "coefficients": {"after": {"K_b": best}},
    }
    made = diagnosed(made, "ground", block, {"before": error + other, "after": error})
    over = curves.relative_lift(made, "ground")
    away = (over.delta_L - curves.line(made, "ground", over.z_hat).middle) / over.u
    assert abs(float(away @ away) - n) < 4 * np.sqrt(2 * n)
    # sixty trials a throttle, and the coefficient's slope with the level
    assert noise / np.sqrt(60) < over.u_L_inf < 3 * noise / np.sqrt(60)
    assert "are corrected for supply sag" in fig2.fit_note(made, "ground")


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
    levels = 0.1 + data.throttle
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
    moved = {**made.observations, "ceiling": dataclasses.replace(data, lift_N=lift)}
    made = dataclasses.replace(made, observations=moved)
    made = diagnosed(made, "ceiling", block, {"before": far, "after": far})
    table = fig2.table(made)
    band, points = (pick(table, panel="ceiling", kind=kind) for kind in ("band", "data"))
    line = percent(model, band["z_hat"] + 0.1, alpha=alpha)
    np.testing.assert_allclose(band["delta_L_percent"], line, rtol=1e-5)
    assert set(band["label"]) == {"H-C with height offset, fitted"}
    for row in points.itertuples():
        mine = (data.z_hat == row.z_hat) & np.isclose(data.throttle, row.throttle_fraction)
        measured = np.exp(np.mean(np.log(lift[mine] / levels[mine]))) - 1
        assert row.delta_L_percent == pytest.approx(100 * measured)
    assert (points["corrected_for"] == "").all()
    for end, x in ends.items():
        edge = percent(model, band["z_hat"] + 0.1, alpha=x)
        np.testing.assert_allclose(band[f"{end}_percent"], edge, rtol=1e-3)
    text = fig2.caption(made, table)
    assert "The points are as measured. The line includes height offset" in text


def test_a_stated_datum_moves_every_part_of_the_line(evidence):
    """The effect saturates at true distance, as the model does."""
    made = copy.deepcopy(evidence)
    data = made.observations["ceiling"]
    made.document(RESULTS)["boundaries"]["ceiling"]["effects"] = ["near_wall_saturation"]
    known = {"alpha": 0.15, "offset_m": -2e-4, "gap_hat2": 0.12, "saturation_power": 0.4}
    accepted = {
        "effects": ["near_wall_saturation"],
        "parameters": {n: {"value": x, "lo90": x, "hi90": x, "u": 0.0} for n, x in known.items()},
        "covariance": {"names": [*known], "values": np.zeros((4, 4)).tolist()},
    }
    block = {"verdict": "effect", "accepted": accepted}
    none = dict.fromkeys(("before", "after"), np.zeros(data.n))
    z_hat = np.array([0.1, 0.3, 2.0])
    moved = z_hat - 2e-4 / data.radius_m
    theory = 0.5 + 0.5 * np.sqrt(1 + 0.15 / moved**2)
    expected = (theory - 1) * (1 + 0.12 / moved**2) ** -0.4
    line = curves.line(diagnosed(made, "ceiling", block, none), "ceiling", z_hat)
    assert line.middle == pytest.approx(expected)


def test_theory_curves_take_the_published_values(table):
    model, r = catalogue.model("sanchez_cuevas"), 65 / 23
    own = {"K_b": 2.0, "spacing_hat": r, "diagonal_hat": np.sqrt(2) * r}
    for panel, label, theory in (
        ("ground", "C-B (theory)", lambda z: 1 / (1 - 1 / (16 * z**2)) - 1),
        ("ground", "S-C, K_b = 2", lambda z: model(z, **own) - 1),
        (
            "ground",
            "S-C (PQuad)",
            lambda z: model(z, K_b=2.0, spacing_hat=3.0, diagonal_hat=3 * np.sqrt(2)) - 1,
        ),
        ("ceiling", "H-C (theory)", lambda z: (np.sqrt(1 + 1 / (8 * z**2)) - 1) / 2),
    ):
        line = pick(table, panel=panel, label=label)
        expected = 100 * theory(line["z_hat"].to_numpy())
        np.testing.assert_allclose(line["delta_L_percent"], expected)


def test_the_line_is_drawn_at_the_fitted_height(evidence):
    made, entry = quoted.fitted(evidence, "ceiling")
    entry["height_error"] = {"value": 2e-4, "u": 1e-4, "unit": "m"}
    table = fig2.table(made)
    line = pick(table, panel="ceiling", kind="band")
    model, fit = made.base("ceiling")
    z_hat = line["z_hat"] + 2e-4 / made.observations["ceiling"].radius_m
    # the posterior's median is within a thousandth of the fit here; the height takes a twentieth
    moved = percent(model, z_hat, **made.known("ceiling", model), **fit.values)
    np.testing.assert_allclose(line["delta_L_percent"], moved, rtol=2e-3)
    assert "0.2 mm farther than recorded" in fig2.caption(made, table)


def test_line_and_band_are_of_one_posterior_and_least_squares_is_its_own_line(evidence):
    """A prior moves the posterior off the least squares: each is drawn under its own name, and the
    caption has what is quoted.
    """
    model, fit = evidence.base("ground")
    moved = copy.deepcopy(evidence)
    draws = moved.table(POSTERIOR)
    mine = (draws["boundary"] == "ground") & (draws["model"] == model.name)
    mine &= draws["parameter"] == "K_b"
    value = draws["value"]
    value[mine] = 1.0 + 0.5 * (value[mine] - value[mine].mean())
    median = float(np.median(value[mine]))
    moved, entry = quoted.fitted(moved, "ground")
    posterior = entry["posterior"]["parameters"]["K_b"]
    posterior |= {"median": median, "lo90": 0.9, "hi90": 1.1, "u": 0.06}
    table, known = fig2.table(moved), moved.known("ground", model)
    line, fitted = (pick(table, panel="ground", kind=kind) for kind in ("band", "least squares"))
    # the line is over recorded distance
    off = curves.height_found_m(fit) / moved.observations["ground"].radius_m
    at_median = percent(model, line["z_hat"] + off, **known, K_b=median)
    np.testing.assert_allclose(line["delta_L_percent"], at_median, rtol=1e-6)
    at_fit = percent(model, fitted["z_hat"] + off, **known, **fit.values)
    np.testing.assert_allclose(fitted["delta_L_percent"], at_fit, rtol=1e-9)
    assert (line["lo90_percent"] < line["delta_L_percent"]).all()
    assert (line["delta_L_percent"] < line["hi90_percent"]).all()
    assert {*line["label"], *fitted["label"]} == {"S-C, fitted", "S-C, least squares"}
    text = fig2.caption(moved, table)
    assert "Thin line (ground): least squares, which differs visibly." in text
    assert f"({coefficient_text(moved.quoted('ground').coefficients['K_b'], 'K_b')}, k = 1)" in text
    moved, entry = quoted.fitted(moved, "ground")
    entry["posterior"]["parameters"]["K_b"]["lo90"] = entry["parameters"]["K_b"]["lo90"] = None
    endless = fig2.table(moved)
    assert np.isnan(pick(endless, panel="ground", kind="band")["lo90_percent"]).all()
    assert "No band (ground)" in fig2.caption(moved, endless)


def test_where_structure_stays_unexplained_line_and_band_are_what_is_quoted(evidence, monkeypatch):
    """The base fit is least squares; a band is the interval, however uneven."""
    # curves are kept by evidence: not those of the evidence that other tests share
    evidence = copy.deepcopy(evidence)
    own, before = evidence.quoted("ground"), type(evidence).quoted
    K_b = dataclasses.replace(own.coefficients["K_b"], value=1.5, lo90=1.4, hi90=2.5)
    away = dataclasses.replace(
        own, verdict="unexplained", coefficients={**own.coefficients, "K_b": K_b}
    )
    monkeypatch.setattr(
        type(evidence), "quoted", lambda self, b: away if b == "ground" else before(self, b)
    )
    model, fit = evidence.base("ground")
    table, known = fig2.table(evidence), evidence.known("ground", model)
    line, plain = (pick(table, panel="ground", kind=kind) for kind in ("band", "least squares"))
    for column, value in (("delta_L_percent", 1.5), ("lo90_percent", 1.4), ("hi90_percent", 2.5)):
        drawn = percent(model, line["z_hat"], **known, K_b=value)
        np.testing.assert_allclose(line[column], drawn, rtol=1e-9)
    off = curves.height_found_m(fit) / evidence.observations["ground"].radius_m
    fitted = percent(model, plain["z_hat"] + off, **known, **fit.values)
    np.testing.assert_allclose(plain["delta_L_percent"], fitted, rtol=1e-9)


def test_one_rotor_is_not_compared_with_a_quadrotor(make_job):
    vehicle = {"name": "one", "rotors": 1, "rotor_radius": "23 mm", "mass": "27 g"}
    evidence = gather(make_job(boundaries=("ground",), vehicle=vehicle))
    table = fig2.table(evidence)
    assert set(table["label"][table["kind"] == "model"]) == {"C-B (theory)"}
    assert "PQuad" not in fig2.caption(evidence, table)


@pytest.mark.parametrize("boundary", SIDES)
def test_the_distance_of_a_change_of_two_percent_is_printed(evidence, boundary):
    text = words.Brief(evidence, boundary).reach
    z_hat = float(re.search(r"ẑ = ([\d.]+) ", text)[1])
    change = curves.line(evidence, boundary, np.array([z_hat])).middle[0]
    assert abs(change) == pytest.approx(0.02, rel=0.02)
