"""The Python interface: the command line's stages and products as typed values and DataFrames."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

import nearlift
from nearlift.errors import ManifestError, UsageError
from nearlift.onboarding.frames import columns_of
from nearlift.report.phrases import coefficient_text
from nearlift.study import Fit

from . import small_run


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> nearlift.Study:
    folder = tmp_path_factory.mktemp("study")
    raw = small_run.write(folder / "raw", form="parquet")
    return nearlift.load(raw, folder, executor="serial")


@pytest.fixture(scope="module")
def fit(study: nearlift.Study) -> Fit:
    return study.fit()


def test_importing_nearlift_is_cheap_and_loads_the_interface_when_asked():
    heavy = ("numpy", "pandas", "pydantic", "scipy", "matplotlib", "pyarrow", "click")
    code = (
        f"import nearlift, sys; print(dir(nearlift), [m for m in {heavy} if m in sys.modules]);"
        " print(nearlift.load.__module__, nearlift.Study.__name__)"
    )
    command = [sys.executable, "-c", code]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    assert lines == ["['Study', '__version__', 'load', 'trials'] []", "nearlift.study Study"]
    with pytest.raises(AttributeError, match="'nearlift' has no attribute 'laod'"):
        _ = nearlift.laod


def test_load_checks_the_manifest_and_runs_nothing(tmp_path):
    with pytest.raises(ManifestError, match=r"holds no campaign\.toml"):
        nearlift.load(tmp_path)
    nearlift.load(small_run.write_means(tmp_path / "raw", 24), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_reduction_is_the_cells_and_their_covariance(study):
    cells, covariance = study.reduce(), study.read("lift_covariance.parquet")
    assert cells["n_trials"].sum() == 112
    assert np.sqrt(np.diag(covariance)) == pytest.approx(cells["u_delta_L"])


def test_a_fit_says_what_fit_json_says(study, fit):
    content = json.loads((study.processed / "fit.json").read_text())
    entry = content["boundaries"]["ground"]["sanchez_cuevas"]["parameters"]["K_b"]
    rows = fit.coefficients
    row = rows[rows["base"]].iloc[0]
    assert (row["model"], row["coefficient"]) == ("sanchez_cuevas", "K_b")
    for key in ("value", "u", "lo90", "hi90"):
        assert row[key] == entry[key]
    assert fit.draws()["K_b"].mean() == pytest.approx(row["value"], abs=0.3 * row["u"])


def test_what_is_not_there_is_refused_with_what_is(study, fit):
    with pytest.raises(UsageError, match=r"'ceiling': was not fitted\n  there are ground"):
        fit.draws("ceiling")
    with pytest.raises(UsageError, match=r"hayden : was not fitted at the ground"):
        fit.to_lmfit("ground", "hayden ")
    with pytest.raises(UsageError, match=r"there are none at the ground"):
        fit.draws("ground", "sanchez_cuevas_published")
    with pytest.raises(UsageError, match=r"is no figure(.|\n)*fig2"):
        study.plot("fig9")
    with pytest.raises(UsageError, match=r"cannot be drawn"):
        study.plot("fig3")
    with pytest.raises(UsageError, match=r"is no table product(.|\n)*trials\.parquet"):
        study.read("trials.csv")


def test_a_fit_prints_as_a_report(fit):
    K_b = fit.results.of_base("ground").parameters["K_b"]
    assert "[[ground: Sanchez-Cuevas]]" in str(fit)
    assert coefficient_text(K_b, "K_b") in str(fit)
    assert len(repr(fit).splitlines()) < 40


def test_residuals_are_those_of_the_base_model(fit):
    base = fit.results.of_base("ground")
    assert len(fit.residuals) == base.n_trials
    rms = np.sqrt(np.mean(fit.residuals["residual"] ** 2))
    assert rms == pytest.approx(base.rmse, rel=0.05)


def test_a_fit_becomes_lmfit_parameters_and_inference_data(fit):
    K_b = fit.results.of_base("ground").parameters["K_b"]
    parameters = fit.to_lmfit()
    assert (parameters["K_b"].value, parameters["K_b"].stderr) == (K_b.value, K_b.u)
    two = fit.to_lmfit("ground", "sanchez_cuevas_free_exponent")
    assert -1 < two["K_b"].correl["n"] < 1
    pytest.importorskip("arviz")
    posterior = fit.to_arviz().posterior
    assert float(posterior["K_b"].mean()) == pytest.approx(K_b.value, abs=0.3 * K_b.u)


def test_a_fit_is_the_same_whatever_is_on_disk_and_up_to_date_for_the_command_line(study, fit):
    study.diagnose()
    before = (study.processed / "provenance.json").stat()
    again = study.fit()
    assert (study.processed / "provenance.json").stat() == before
    assert str(again) == str(fit)
    assert again.coefficients.equals(fit.coefficients)
    words = ("run", "--dry-run", study.root, "--out", study.out, "--json")
    stages = json.loads(small_run.nearlift(*words).stdout)["stages"]
    assert [s["stage"] for s in stages if not s["stale"]] == ["ingest", "reduce", "fit", "diagnose"]


def test_a_diagnosis_says_what_its_products_say(study):
    loop = study.diagnose()
    content = json.loads((study.processed / "diagnosis.json").read_text())
    verdict = content["boundaries"]["ground"]["verdict"]
    K_b = loop.quoted["ground"].coefficients["K_b"]
    assert loop.boundaries["ground"].verdict == verdict
    assert loop.coefficients["verdict"].tolist() == [verdict]
    assert loop.coefficients["value"].tolist() == [K_b.value]
    assert f"verdict: {verdict}" in str(loop)
    assert coefficient_text(K_b, "K_b") in str(loop)
    assert len(loop.residuals) == len(loop.trials)
    assert len(repr(loop).splitlines()) < 40


def test_a_plot_is_a_figure_that_can_be_adjusted(study, tmp_path):
    figure = study.plot("fig2")
    figure.axes[0].set_title("mine")
    figure.savefig(tmp_path / "a.pdf")
    assert (tmp_path / "a.pdf").read_bytes()[:4] == b"%PDF"


@pytest.mark.parametrize("radii", [False, True])
def test_a_table_of_trials_gives_the_fit_of_its_campaign(fit, radii):
    rows = fit.trials.drop(columns="trial")
    if radii:
        rows = rows.drop(columns="z_m")
    else:
        rows = rows.assign(z_mm=1e3 * rows["z_m"], lift_mN=1e3 * rows["lift_N"])
        rows = rows.drop(columns=["z_m", "lift_N"])
    own = nearlift.trials(
        rows,
        rotor_radius="23 mm",
        rotor_spacing="65 mm",
        mass="27 g",
        fit={"ground": {"rivals": []}},
    )
    refit = own.fit().results.of_base("ground").parameters["K_b"]
    declared = fit.results.of_base("ground").parameters["K_b"]
    assert refit.value == pytest.approx(declared.value, abs=0.3 * declared.u)


def test_a_unit_follows_the_last_underscore():
    frame = pd.DataFrame(columns=["boundary", "z_mm", "throttle_percent", "lift_gf", "lift_sd_gf"])
    assert columns_of(frame) == {
        "boundary": ("boundary", ""),
        "z_mm": ("distance", "mm"),
        "throttle_percent": ("throttle", "percent"),
        "lift_gf": ("lift", "gf"),
        "lift_sd_gf": ("lift_sd", "gf"),
    }


@pytest.mark.parametrize(
    ("renamed", "what"),
    [({"lift_N": "force_N"}, "no column of the lift"), ({"lift_N": "lift_stone"}, "no known unit")],
)
def test_a_table_of_trials_that_cannot_be_read_is_refused(fit, renamed, what):
    with pytest.raises(UsageError, match=what):
        nearlift.trials(fit.trials.rename(columns=renamed), rotor_radius="23 mm", mass="27 g")


def test_residuals_leave_out_rejected_trials(tmp_path):
    raw = small_run.write(tmp_path / "raw")
    (next((raw / "trials").iterdir())).write_bytes(b"")
    fit = nearlift.load(raw, tmp_path, executor="serial").fit()
    (rejected,) = fit.trials.loc[fit.trials["quality"] == "EMPTY", "trial"]
    assert len(fit.residuals) == len(fit.trials) - 1
    assert rejected not in set(fit.residuals["trial"])
    assert fit.residuals["residual"].notna().all()
