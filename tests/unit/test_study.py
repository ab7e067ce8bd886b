"""The Python interface: the command line's stages, ledger and products as typed values."""

from __future__ import annotations

import dataclasses
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
    return nearlift.load(small_run.write(folder / "raw", form="parquet"), folder, executor="serial")


@pytest.fixture(scope="module")
def fit(study: nearlift.Study) -> Fit:
    return study.fit()


def product(study: nearlift.Study, name: str) -> dict:
    return json.loads((study.processed / name).read_text())


def test_importing_nearlift_is_cheap():
    heavy = ("numpy", "pandas", "pydantic", "scipy", "matplotlib", "pyarrow", "click")
    told = subprocess.run(
        [
            sys.executable,
            "-c",
            (
                f"import nearlift, sys; print([m for m in {heavy} if m in sys.modules],"
                " nearlift.load.__name__)"
            ),
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stdout.split() == ["[]", "load"]


def test_there_is_nothing_else_to_import():
    assert set(nearlift.__all__) == {"Study", "__version__", "load", "trials"}
    with pytest.raises(AttributeError, match="'nearlift' has no attribute 'laod'"):
        _ = nearlift.laod


def test_load_checks_the_manifest_and_runs_nothing(tmp_path):
    with pytest.raises(ManifestError, match=r"holds no campaign\.toml"):
        nearlift.load(tmp_path)
    raw = small_run.write_means(tmp_path / "raw", 24)
    study = nearlift.load(raw, tmp_path / "out")
    assert study.plan()["ingest"] == "has not run yet"
    assert not (tmp_path / "out").exists()
    assert study.report == tmp_path / "out" / "reports" / "means" / "index.html"


def test_a_reduction_is_the_products(study):
    found = study.reduce()
    assert len(found.trials) == 112
    assert found.covariance.shape == (len(found.cells), len(found.cells))
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(found.cells["u_delta_L"])
    assert list(found.covariance.index[0]) == list(
        found.cells.iloc[0][["boundary", "z_hat", "throttle"]]
    )
    assert f"ground: 112 trials in {len(found.cells)} cells" in repr(found)


def test_a_fit_says_what_fit_json_says(study, fit):
    entry = product(study, "fit.json")["boundaries"]["ground"]["sanchez_cuevas"]
    K_b = fit["ground"].base.coefficients["K_b"]
    assert fit["ground"].base is fit["ground"]["sanchez_cuevas"]
    assert {k: getattr(K_b, k) for k in ("value", "u", "lo90", "hi90")} == {
        k: entry["parameters"]["K_b"][k] for k in ("value", "u", "lo90", "hi90")
    }
    assert fit["ground"].base.L_inf_N[0.25].unit == "N"
    assert [at.boundary for at in fit] == ["ground"]
    rows = fit.coefficients
    row = rows[rows["base"]].iloc[0]
    assert (row["model"], row["coefficient"]) == ("sanchez_cuevas", "K_b")
    assert (row["value"], row["lo90"]) == (K_b.value, K_b.lo90)
    draws = fit.draws("ground")
    assert draws["K_b"].mean() == pytest.approx(
        entry["parameters"]["K_b"]["value"], abs=0.3 * entry["parameters"]["K_b"]["u"]
    )


def test_answers_are_frozen(fit):
    with pytest.raises(dataclasses.FrozenInstanceError):
        fit["ground"].base.parameters = {}


def test_what_is_not_there_is_refused_with_what_is(study, fit):
    with pytest.raises(UsageError, match=r"'ceiling' is no boundary of(.|\n)*there are ground"):
        fit["ceiling"]
    with pytest.raises(UsageError, match=r"no fit of 'hayden ' at the ground"):
        fit["ground"]["hayden "]
    with pytest.raises(UsageError, match=r"is no figure(.|\n)*fig2"):
        study.plot("fig9")
    with pytest.raises(UsageError, match=r"cannot be drawn"):
        study.plot("fig3")
    with pytest.raises(UsageError, match=r"is no table product(.|\n)*trials\.parquet"):
        study.read("trials.csv")
    with pytest.raises(UsageError, match=r"there are none at the ground"):
        fit.draws("ground", "sanchez_cuevas_published")


def test_a_fit_prints_as_a_report(fit):
    K_b = fit["ground"].base.coefficients["K_b"]
    assert "[[ground: Sanchez-Cuevas]]" in str(fit)
    assert coefficient_text(K_b, "K_b") in str(fit)
    assert len(str(fit).splitlines()) < 40
    assert repr(fit) == str(fit)


def test_residuals_are_those_of_the_base_model(fit):
    rows = fit.residuals
    base = fit["ground"].base
    assert len(rows) == base.n_trials
    assert np.sqrt(np.mean(rows["residual"] ** 2)) == pytest.approx(base.rmse, rel=0.05)


def test_a_fit_becomes_lmfit_parameters_and_inference_data(fit):
    K_b = fit["ground"].base.coefficients["K_b"]
    parameters = fit.to_lmfit("ground")
    assert (parameters["K_b"].value, parameters["K_b"].stderr) == (K_b.value, K_b.u)
    two = fit.to_lmfit("ground", "sanchez_cuevas_free_exponent")
    assert -1 < two["K_b"].correl["n"] < 1
    pytest.importorskip("arviz")
    posterior = fit.to_arviz("ground").posterior
    assert float(posterior["K_b"].mean()) == pytest.approx(K_b.value, abs=0.3 * K_b.u)


def test_the_same_call_gives_the_same_answer_whatever_is_on_disk(study, fit):
    study.diagnose()
    again = study.fit()
    assert str(again) == str(fit)
    assert again.coefficients.equals(fit.coefficients)


def test_the_same_ledger_as_the_command_line(study, fit):
    """What Python fitted the command line finds up to date, and the other way round."""
    told = json.loads(
        small_run.nearlift("run", "--dry-run", study.root, "--out", study.out, "--json").stdout
    )["stages"]
    assert {s["stage"]: s["stale"] for s in told if s["stage"] in ("ingest", "reduce", "fit")} == {
        "ingest": False,
        "reduce": False,
        "fit": False,
    }
    before = (study.processed / "provenance.json").stat()
    study.fit()
    assert (study.processed / "provenance.json").stat() == before


def test_a_diagnosis_says_what_diagnosis_json_says(study):
    found = study.diagnose()
    entry = product(study, "diagnosis.json")["boundaries"]["ground"]
    at = found["ground"]
    assert at.verdict == entry["verdict"]
    assert at.noise_floor == entry["error"]["noise_floor"]
    after = entry["coefficients"]["after"]["K_b"]
    assert (at.after["K_b"].lo90, at.after["K_b"].constrained) == (
        after["lo90"],
        tuple(after["constrained"]),
    )
    assert [e.name for e in at.effects] == [e["name"] for e in entry["effects"]]
    assert set(at.untestable) == {u["effect"] for u in entry["untestable"]}
    assert found.coefficients["verdict"].tolist() == [at.verdict]
    K_b = found.quoted["ground"].coefficients["K_b"]
    assert found.coefficients["value"].tolist() == [K_b.value]
    assert f"verdict: {at.verdict}" in str(found)
    assert coefficient_text(K_b, "K_b") in str(found)
    assert len(found.residuals) == len(found.trials)
    assert repr(found) == str(found)


def test_a_plot_is_a_figure_that_can_be_adjusted(study, tmp_path):
    figure = study.plot("fig2")
    figure.axes[0].set_title("mine")
    figure.savefig(tmp_path / "a.pdf")
    assert (tmp_path / "a.pdf").read_bytes()[:4] == b"%PDF"


@pytest.mark.parametrize("radii", [False, True])
def test_a_table_of_trials_gives_the_fit_of_its_campaign(study, fit, radii):
    rows = fit.trials.drop(columns="trial")
    if radii:
        rows = rows.drop(columns="z_m")
    else:
        rows = rows.assign(z_mm=1e3 * rows["z_m"], lift_mN=1e3 * rows["lift_N"])
        rows = rows.drop(columns=["z_m", "lift_N"])
    vehicle = study.manifest.vehicle
    own = nearlift.trials(
        rows,
        rotor_radius=f"{1e3 * vehicle.rotor_radius} mm",
        rotor_spacing=f"{1e3 * vehicle.rotor_spacing} mm",
        mass="27 g",
        fit={"ground": {"rivals": []}},
    )
    found = own.fit()["ground"].base.coefficients["K_b"]
    declared = fit["ground"].base.coefficients["K_b"]
    assert found.value == pytest.approx(declared.value, abs=0.3 * declared.u)


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
    assert len(fit.residuals) == fit["ground"].base.n_trials == len(fit.trials) - 1
    assert rejected not in set(fit.residuals["trial"])
    assert fit.residuals["residual"].notna().all()


def test_rejected_trials_and_notes_are_carried(tmp_path):
    raw = small_run.write(tmp_path / "raw")
    (next((raw / "trials").iterdir())).write_bytes(b"")
    found = nearlift.load(raw, tmp_path, executor="serial").reduce()
    assert [reason.split()[0].rstrip(":") for _, reason in found.rejected] == ["EMPTY"]
    assert "EMPTY" in str(found)
