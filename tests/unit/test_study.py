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

VEHICLE = {"rotor_radius": "23 mm", "mass": "27 g"}


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> nearlift.Study:
    folder = tmp_path_factory.mktemp("study")
    raw = small_run.write(folder / "raw", form="parquet")
    return nearlift.load(raw, folder, executor="serial")


@pytest.fixture(scope="module")
def fit(study: nearlift.Study) -> Fit:
    return study.fit()


@pytest.fixture(scope="module")
def base(fit: Fit):
    return fit.results.of_base("ground")


@pytest.fixture(scope="module")
def K_b(base):
    return base.parameters["K_b"]


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


def test_a_fit_says_what_fit_json_says(study, fit, base, K_b):
    content = json.loads((study.processed / "fit.json").read_text())
    entry = content["boundaries"]["ground"]["sanchez_cuevas"]["parameters"]["K_b"]
    row = fit.coefficients[fit.coefficients["base"]].iloc[0]
    assert (row["model"], row["coefficient"]) == ("sanchez_cuevas", "K_b")
    for key in ("value", "u", "lo90", "hi90"):
        assert row[key] == entry[key]
    assert fit.draws()["K_b"].mean() == pytest.approx(row["value"], abs=0.3 * row["u"])
    assert "[[ground: Sanchez-Cuevas]]" in str(fit)
    assert coefficient_text(K_b, "K_b") in str(fit)
    assert len(repr(fit).splitlines()) < 40
    assert len(fit.residuals) == base.n_trials
    rms = np.sqrt(np.mean(fit.residuals["residual"] ** 2))
    assert rms == pytest.approx(base.rmse, rel=0.05)


def test_what_is_not_there_is_refused_with_what_is(study, fit):
    for refused, given, match in (
        (fit.draws, ("ceiling",), r"'ceiling': was not fitted\n  there are ground"),
        (fit.to_lmfit, ("ground", "hayden "), r"hayden : was not fitted at the ground"),
        (fit.draws, ("ground", "sanchez_cuevas_published"), "there are none at the ground"),
        (study.plot, ("fig9",), r"is no figure(.|\n)*fig2"),
        (study.plot, ("fig3",), "cannot be drawn"),
        (study.read, ("trials.csv",), r"is no table product(.|\n)*trials\.parquet"),
    ):
        with pytest.raises(UsageError, match=match):
            refused(*given)


def test_a_fit_becomes_lmfit_parameters(fit, K_b):
    parameters = fit.to_lmfit()
    assert (parameters["K_b"].value, parameters["K_b"].stderr) == (K_b.value, K_b.u)
    two = fit.to_lmfit("ground", "sanchez_cuevas_free_exponent")
    assert -1 < two["K_b"].correl["n"] < 1


def test_a_fit_becomes_inference_data(fit, K_b):
    pytest.importorskip("arviz")
    mean = float(fit.to_arviz().posterior["K_b"].mean())
    assert mean == pytest.approx(K_b.value, abs=0.3 * K_b.u)


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
    quoted = loop.quoted["ground"].coefficients["K_b"]
    assert loop.boundaries["ground"].verdict == verdict
    assert loop.coefficients[["verdict", "value"]].to_numpy().tolist() == [[verdict, quoted.value]]
    assert f"verdict: {verdict}" in str(loop)
    assert coefficient_text(quoted, "K_b") in str(loop)
    assert len(loop.residuals) == len(loop.trials)
    assert len(repr(loop).splitlines()) < 40


def test_a_plot_is_a_figure_that_can_be_adjusted(study, tmp_path):
    figure = study.plot("fig2")
    figure.axes[0].set_title("mine")
    figure.savefig(tmp_path / "a.pdf")
    assert (tmp_path / "a.pdf").read_bytes()[:4] == b"%PDF"


@pytest.mark.parametrize("radii", [False, True])
def test_a_table_of_trials_gives_the_fit_of_its_campaign(fit, K_b, radii):
    rows = fit.trials.drop(columns="trial")
    if not radii:
        rows = rows.assign(z_mm=1e3 * rows["z_m"], lift_mN=1e3 * rows["lift_N"])
        rows = rows.drop(columns="lift_N")
    rows = rows.drop(columns="z_m")
    quick = {"ground": {"rivals": []}}
    stated = [{"name": "datum", "on": "height", "value": "1 um", "scope": "boundary"}]
    more = {"fit": quick, "simulated": True, "uncertainty": stated}
    own = nearlift.trials(rows, rotor_spacing="65 mm", **more, **VEHICLE)
    assert own.manifest.simulated
    refit = own.fit().results.of_base("ground").parameters["K_b"]
    assert refit.value == pytest.approx(K_b.value, abs=0.3 * K_b.u)


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
    ("name", "what"),
    [("force_N", "no column of the lift"), ("lift_stone", "no known unit")],
)
def test_a_table_of_trials_that_cannot_be_read_is_refused(fit, name, what):
    with pytest.raises(UsageError, match=what):
        nearlift.trials(fit.trials.rename(columns={"lift_N": name}), **VEHICLE)


def test_residuals_leave_out_rejected_trials(tmp_path):
    raw = small_run.write(tmp_path / "raw")
    (next((raw / "trials").iterdir())).write_bytes(b"")
    fit = nearlift.load(raw, tmp_path, executor="serial").fit()
    (rejected,) = fit.trials.loc[fit.trials["quality"] == "EMPTY", "trial"]
    assert len(fit.residuals) == len(fit.trials) - 1
    assert rejected not in set(fit.residuals["trial"])
    assert fit.residuals["residual"].notna().all()
