"""Posteriors through the stages: the table, fit.json, the report, a killed run, posterior.nc."""

import importlib.util
import json
import shutil
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from tests.unit import small_run

from nearlift import cli
from nearlift.errors import ManifestError
from nearlift.run import tables
from nearlift.stages.export import FORMATS
from nearlift.stages.fit import FIT, POSTERIOR
from nearlift.stages.ingest import TRIALS


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A campaign that is ingested and fitted, and its output folder."""
    raw = small_run.write(tmp_path_factory.mktemp("posterior") / "raw", visits=2)
    out = tmp_path_factory.mktemp("posterior-out")
    for stage in ("ingest", "fit"):
        assert small_run.nearlift(stage, raw, "--out", out).exit_code == 0
    return raw, out


def products(out):
    return out / "processed" / small_run.NAME


def ask(raw, folder, text):
    """The same campaign with a [fit] section."""
    copy = shutil.copytree(raw, folder / "raw")
    (copy / "campaign.toml").write_text((raw / "campaign.toml").read_text() + f"\n[fit]\n{text}\n")
    return copy


def test_the_table_holds_every_model_and_fit_json_says_how(done):
    _, out = done
    table = tables.read_table(products(out) / POSTERIOR.file, POSTERIOR)
    fits = json.loads((products(out) / FIT.file).read_text())
    for name, entry in fits["boundaries"]["ground"].items():
        said = entry["posterior"]
        assert said["model"] == name
        assert said["data_sha256"] == tables.sha256(products(out) / TRIALS.file)
        assert entry["log_evidence"]["u"] < 0.1
        for parameter, summary in said["parameters"].items():
            draws = table["value"][(table["model"] == name) & (table["parameter"] == parameter)]
            assert len(draws) == said["chains"] * said["draws"] >= 4000
            # the grid's where there is one coefficient: within five standard errors of the mean of
            # the draws
            assert summary["value"] == pytest.approx(
                draws.mean(), rel=1e-9, abs=5 * summary["u"] / np.sqrt(summary["ess"])
            )
            assert summary["lo90"] < summary["median"] < summary["hi90"]
            assert summary["ess"] >= 4000
            assert summary["prior"]["text"]
    base = table["model"] == "sanchez_cuevas"
    assert {"K_b", "L_inf_N[0.25]", "L_inf_N[0.92]"} <= set(table["parameter"][base])
    assert not any(p.startswith("L_inf") for p in table["parameter"][~base])
    levels = fits["boundaries"]["ground"]["sanchez_cuevas"]
    for throttle, level in levels["posterior"]["L_inf_N"].items():
        assert level["value"] == pytest.approx(
            levels["L_inf_N"][throttle]["value"], abs=3 * level["u"]
        )


def test_too_few_steps_end_the_run_with_code_5(done, tmp_path):
    raw, out = done
    asked = ask(
        raw,
        tmp_path,
        'ess = 20000\nsteps = 400\nground = { base = "sanchez_cuevas_free_exponent", rivals = [] }',
    )
    found = small_run.nearlift("fit", asked, "--out", out)
    assert found.exit_code == 5
    assert "run at least" in found.stderr
    assert "Traceback" not in found.stderr
    raw_again = small_run.nearlift("fit", raw, "--out", out)
    assert raw_again.exit_code == 0


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('sampler = "emcee"', "known here"),
        ("ess = 5", "fit.ess"),
        ("walkers = 8", "did you mean|known here"),
    ],
)
def test_what_cannot_be_asked_for_is_refused(done, tmp_path, text, told):
    raw, _ = done
    from nearlift.campaign import manifest as campaign

    with pytest.raises(ManifestError, match=told):
        campaign.load(ask(raw, tmp_path, text))


def test_posterior_nc_opens_in_arviz(done):
    raw, out = done
    found = small_run.nearlift("export", raw, "--out", out, "--netcdf")
    assert found.exit_code == 0
    path = Path(found.stdout.strip())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import arviz
    table = tables.read_table(products(out) / POSTERIOR.file, POSTERIOR)
    mine = (table["model"] == "sanchez_cuevas") & (table["parameter"] == "K_b")
    if int(arviz.__version__.split(".")[0]) >= 1:
        tree = arviz.from_netcdf(path)
        root, group = tree["posterior"], tree["ground/sanchez_cuevas/posterior"]
    else:
        root = arviz.from_netcdf(path).posterior
        group = arviz.InferenceData.from_netcdf(path, base_group="ground/sanchez_cuevas").posterior
    for opened in (root, group):
        np.testing.assert_array_equal(np.asarray(opened["K_b"]).ravel(), table["value"][mine])
        assert opened["K_b"].attrs["prior"] == "normal, mean 2, sd 4"
    assert list(np.asarray(group["throttle"])) == [0.25, 0.5, 0.75, 0.92]
    assert group.attrs["data_sha256"] == tables.sha256(products(out) / TRIALS.file)
    assert float(arviz.ess(np.asarray(root["K_b"]))) > 3800


def test_export_asks_for_a_format_and_all_are_on_the_command_line(done):
    raw, out = done
    flags = {p.name for p in cli.main.commands["export"].params if getattr(p, "is_flag", False)}
    assert FORMATS.keys() <= flags
    found = small_run.nearlift("export", raw, "--out", out)
    assert found.exit_code == 2
    assert "no format was asked for" in found.stderr


def test_posterior_nc_without_its_package_is_refused(done, monkeypatch):
    raw, out = done
    monkeypatch.setitem(sys.modules, "h5netcdf", None)
    found = small_run.nearlift("export", raw, "--out", out, "--netcdf")
    assert found.exit_code == 4
    assert "pip install 'nearlift[netcdf]'" in found.stderr
    assert importlib.util.find_spec("emcee")


def test_a_fit_writes_posterior_nc_when_asked_and_leaves_no_old_one(done, tmp_path):
    raw, out = done
    asked = ask(raw, tmp_path, "netcdf = true\nground = { rivals = [] }")
    assert small_run.nearlift("fit", asked, "--out", out).exit_code == 0
    assert (products(out) / "posterior.nc").is_file()
    assert small_run.nearlift("fit", raw, "--out", out).exit_code == 0
    assert not (products(out) / "posterior.nc").exists()


def test_one_coefficient_is_quoted_from_the_grid_and_the_draws_agree_within_their_error(small_job):
    fits, draws = small_job.read_json(FIT)["boundaries"]["ground"], small_job.read(POSTERIOR)
    for model, entry in fits.items():
        if len(entry["parameters"]) != 1:
            continue
        ((name, told),) = entry["posterior"]["parameters"].items()
        mine = (
            (draws["boundary"] == "ground")
            & (draws["model"] == model)
            & (draws["parameter"] == name)
        )
        sampled = np.quantile(draws["value"][mine], [0.05, 0.5, 0.95])
        # four standard errors of a quantile in the tail of a normal, sqrt(0.05 0.95 / n) / 0.103 u,
        # at the effective number of draws
        within = 4 * np.sqrt(0.05 * 0.95 / told["ess_tail"]) / 0.103 * told["u"]
        assert [told["lo90"], told["median"], told["hi90"]] == pytest.approx(sampled, abs=within)
        assert not np.array_equal([told["lo90"], told["hi90"]], sampled[[0, 2]])
