"""L_inf as a curve of throttle and supply: as free levels where throttles repeat, honest where they
do not, refused where it would be stretched.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from tests.unit import small_run
from tests.unit.simulated import GEOMETRY, RADIUS, campaign, findings, sanchez_cuevas

from nearlift import catalogue
from nearlift.campaign import manifest as manifests
from nearlift.errors import InputRefused, ManifestError, NotConverged
from nearlift.fit.least_squares import fit
from nearlift.fit.summary import summary
from nearlift.likelihood import level_curve
from nearlift.likelihood.level_curve import with_curve
from nearlift.loop import confirmation
from nearlift.results import Noise, Observations
from nearlift.results.document import as_json, typed
from nearlift.results.fit import ModelFit

BASE = catalogue.model("sanchez_cuevas")
KNOWN = Noise(relative=0.004, force_N=3e-4)


def scattered(seed: int, visits: int = 60, exponent: float = 1.7, sag: float = 1.2) -> Observations:
    """Visits of four trials at scattered heights, throttles and supplies, no two alike; K_b = 2."""
    rng = np.random.default_rng(seed)
    n = 4 * visits
    z = np.repeat(np.exp(rng.uniform(np.log(1.2), np.log(12), visits)), 4)
    throttle, supply = rng.uniform(0.3, 0.9, n), rng.uniform(3.6, 4.1, n)
    lift = 0.6 * throttle**exponent * (supply / 3.8) ** sag * sanchez_cuevas(z)
    return Observations(
        boundary="ground",
        trial=np.array([f"t{i}" for i in range(n)], dtype=object),
        z_hat=z,
        lift_N=lift * (1 + rng.normal(0, 0.004, n)),
        u_lift_N=np.full(n, 1e-4),
        n_eff=np.full(n, 50.0),
        throttle=throttle,
        visit=np.repeat(np.arange(visits), 4),
        session=np.zeros(n, dtype=np.int64),
        radius_m=RADIUS,
        geometry=GEOMETRY,
        covariates={"supply_V": supply, "start_s": 20.0 * np.arange(n)},
    )


# ---- as free levels, where throttles repeat


def test_a_curve_through_every_throttle_is_the_free_levels() -> None:
    data = campaign(1)
    free = fit(BASE, data, scatter=KNOWN)
    # four throttles, and a polynomial of four coefficients: the same space
    curve = fit(BASE, with_curve(data, ["throttle"], 3), scatter=KNOWN)
    np.testing.assert_allclose(curve.theta, free.theta, rtol=1e-7)
    np.testing.assert_allclose(curve.covariance, free.covariance, rtol=1e-6)
    assert curve.chi2 == pytest.approx(free.chi2, rel=1e-9)
    assert curve.dof == free.dof
    assert list(curve.levels) == list(free.levels)
    for t, level in free.levels.items():
        assert curve.levels[t].value == pytest.approx(level.value, rel=1e-8)
        assert curve.levels[t].u == pytest.approx(level.u, rel=1e-6)


# ---- where none repeats


def test_coefficients_where_no_throttle_repeats() -> None:
    found = [
        fit(BASE, with_curve(scattered(seed), ["throttle", "supply_V"], 1)) for seed in range(8)
    ]
    z = [(f.theta[0] - 2.0) / f.estimates["K_b"].u for f in found]
    # 8 normal deviates: root mean square above 1.9 once in 10,000
    assert np.sqrt(np.mean(np.square(z))) < 1.9
    assert max(f.estimates["K_b"].u for f in found) < 0.1


def test_a_supply_that_takes_part_in_the_level_is_no_effect() -> None:
    data = scattered(4)
    with_supply = findings(with_curve(data, ["throttle", "supply_V"], 1), BASE)
    assert with_supply["verdict"] == "adequate"
    without = findings(with_curve(data, ["throttle"], 1), BASE)
    assert [e["name"] for e in without["effects"]] == ["supply_sag"]
    assert without["effects"][0]["parameters"]["sag_exponent"]["value"] == pytest.approx(
        1.2, abs=0.1
    )


def test_a_bend_in_throttle_that_the_degree_lacks_is_structure() -> None:
    data = scattered(6)
    bent = dataclasses.replace(data, lift_N=data.lift_N * np.exp(0.15 * np.log(data.throttle) ** 2))
    found = findings(with_curve(bent, ["throttle", "supply_V"], 1), BASE)
    assert found["verdict"] != "adequate"
    assert "throttle" in {s["covariate"] for s in found["structure"]}


@pytest.mark.parametrize(("bend", "degree"), [(0.0, 1), (0.1, 2)])
def test_the_degree_is_judged_by_visits_left_out(bend: float, degree: int) -> None:
    data = scattered(7, exponent=1.7)
    data = dataclasses.replace(
        data, lift_N=data.lift_N * np.exp(bend * np.log(data.throttle / 0.6) ** 2)
    )
    judged = with_curve(data, ["throttle", "supply_V"], None)
    assert judged.curve is not None
    assert judged.curve.degree == degree
    errors = level_curve.held_out_rms(judged)
    assert errors[degree] < 0.006
    if degree > 1:
        assert errors[1] > 1.5 * errors[2]


# ---- what is told of it


def test_a_curve_is_told_with_its_uncertainty_and_not_beyond_its_trials() -> None:
    found = fit(BASE, with_curve(scattered(8), ["throttle", "supply_V"], 1))
    entry = typed(ModelFit, json.loads(json.dumps(as_json(summary(found)))))
    levels = entry.levels
    assert levels is not None
    assert len(entry.L_inf_N) == level_curve.SHOWN
    value, u = levels.lift_inf_N(throttle=0.6, supply_V=3.8)
    assert abs(value - 0.6 * 0.6**1.7) < 5 * u
    assert u < 0.005 * value
    t, shown = next(iter(entry.L_inf_N.items()))
    assert levels.lift_inf_N(throttle=t)[0] == pytest.approx(shown.value, rel=1e-9)
    with pytest.raises(InputRefused, match=r"throttle = 0\.95.*lies outside 0\.30\d* to 0\.8"):
        levels.lift_inf_N(throttle=0.95)
    with pytest.raises(InputRefused, match=r"supply_V = 3.*where lift was measured"):
        levels.lift_inf_N(throttle=0.6, supply_V=3.0)


def test_visits_left_out_beyond_the_others_are_not_predicted() -> None:
    data = with_curve(scattered(9), ["throttle"], 1)
    highest = data.visit == data.visit[np.argmax(data.throttle)]
    known = data.level_known_from(~highest)
    assert not known[np.argmax(data.throttle)]
    assert known[~highest].all()
    masks = confirmation.folds(data)
    assert all(data.level_known_from(~m)[m].mean() > 0.9 for m in masks)


# ---- refused


def test_what_a_curve_cannot_be_of_is_refused() -> None:
    data = scattered(10)
    constant = dataclasses.replace(data, covariates={"supply_V": np.full(data.n, 3.8)})
    with pytest.raises(InputRefused, match=r"supply_V hardly varies: 3\.8 to 3\.8"):
        with_curve(constant, ["throttle", "supply_V"], 1)
    blank = data.covariates["supply_V"].copy()
    blank[:3] = np.nan
    with pytest.raises(InputRefused, match="supply_V is blank or not positive in 3 of 240 trials"):
        with_curve(
            dataclasses.replace(data, covariates={"supply_V": blank}), ["throttle", "supply_V"], 1
        )
    with pytest.raises(InputRefused, match="the trials have no current_A"):
        with_curve(data, ["throttle", "current_A"], 1)
    # three throttles carry no cubic
    few = dataclasses.replace(data, throttle=np.resize([0.3, 0.5, 0.8], data.n))
    with pytest.raises(NotConverged, match="do not determine a curve of degree 3 in throttle"):
        fit(BASE, with_curve(few, ["throttle"], 3), scatter=KNOWN)


@pytest.mark.parametrize(
    ("levels", "text"),
    [
        ({"by": "throttle", "degree": 2}, 'degree go with by = "curve"'),
        ({"by": "curve", "of": ["supply"]}, 'of needs "throttle"'),
        (
            {"by": "curve", "of": ["throttle", "throttle"]},
            "levels.of: names one of its values twice",
        ),
        ({"by": "curve", "degree": 9}, "levels.degree"),
        ({"by": "spline"}, "levels.by"),
    ],
)
def test_a_manifest_with_a_slip_is_refused(
    tmp_path: Path, levels: dict[str, object], text: str
) -> None:
    root = small_run.write_means(tmp_path / "raw", 4)
    raw = manifests.loads((root / "campaign.toml").read_bytes(), "campaign.toml")
    with pytest.raises(ManifestError) as refusal:
        manifests.parse({**raw, "levels": levels})
    assert text in str(refusal.value)


# ---- from file to page


@pytest.mark.nightly
def test_a_campaign_whose_throttles_do_not_repeat(tmp_path: Path) -> None:
    data = scattered(11)
    root = small_run.write_means(tmp_path / "raw", 4)
    manifest = (root / "campaign.toml").read_text()
    columns = ["trial,boundary,distance,throttle,supply,lift,start"]
    columns += [
        f"{t},ground,{1000 * z * RADIUS:.4f},{100 * x:.4f},{v:.4f},{1000 * f:.5f},{s:g}"
        for t, z, x, v, f, s in zip(
            data.trial,
            data.z_hat,
            data.throttle,
            data.covariates["supply_V"],
            data.lift_N,
            data.covariates["start_s"],
            strict=True,
        )
    ]
    (root / "trials.csv").write_text("\n".join(columns) + "\n")
    units = '[trials.units]\nsupply = "V"\nstart = "s"\n'
    levels = '[levels]\nby = "curve"\nof = ["throttle", "supply"]\n'
    (root / "campaign.toml").write_text(manifest.replace("[trials.units]\n", units) + levels)
    done = small_run.nearlift("run", root, "--out", tmp_path)
    assert done.exit_code == 0, done.output
    out = tmp_path / "processed" / "means"
    entry = json.loads((out / "fit.json").read_text())["boundaries"]["ground"]["sanchez_cuevas"]
    assert entry["levels"]["curve"]["of"] == ["throttle", "supply_V"]
    assert entry["levels"]["curve"]["degree"] == 1
    quoted = json.loads((out / "results.json").read_text())["boundaries"]["ground"]
    assert quoted["verdict"] == "adequate"
    k = quoted["coefficients"]["K_b"]
    assert k["lo95"] < 2.0 < k["hi95"]
    page = (tmp_path / "reports" / "means" / "index.html").read_text()
    assert "of throttle and supply" in page
