"""Posteriors through the stages: the table, fit.json, the report, a killed run, posterior.nc."""

import json
import shutil
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from tests.unit import small_run

from nearlift import cli
from nearlift.campaign import manifest as manifests
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


@pytest.fixture
def command(done):
    """Run a stage of the campaign, or of another, into the same folder."""
    return lambda *words, raw=done[0]: small_run.nearlift(
        words[0], raw, "--out", done[1], *words[1:]
    )


@pytest.fixture
def products(done):
    return done[1] / "processed" / small_run.NAME


@pytest.fixture
def asking(done, tmp_path):
    """The same campaign with a [fit] section."""

    def copy(text):
        root = shutil.copytree(done[0], tmp_path / "raw")
        manifest = root / "campaign.toml"
        manifest.write_text(f"{manifest.read_text()}\n[fit]\n{text}\n")
        return root

    return copy


def draws_of(table, **where):
    """Draws of a parameter of a model at a boundary."""
    mine = np.logical_and.reduce([table[name] == value for name, value in where.items()])
    return table["value"][mine]


def test_the_table_holds_every_model_and_fit_json_says_how(products):
    table = tables.read_table(products / POSTERIOR.file, POSTERIOR)
    fits = json.loads((products / FIT.file).read_text())["boundaries"]["ground"]
    for name, entry in fits.items():
        said = entry["posterior"]
        assert said["model"] == name
        assert said["data_sha256"] == tables.sha256(products / TRIALS.file)
        assert entry["log_evidence"]["u"] < 0.1
        for parameter, summary in said["parameters"].items():
            draws = draws_of(table, model=name, parameter=parameter)
            assert len(draws) == said["chains"] * said["draws"] >= 4000
            # the grid's where there is one coefficient: within five standard errors of the mean of
            # the draws
            error = 5 * summary["u"] / np.sqrt(summary["ess"])
            assert summary["value"] == pytest.approx(draws.mean(), rel=1e-9, abs=error)
            assert summary["lo90"] < summary["median"] < summary["hi90"]
            assert summary["ess"] >= 4000
            assert summary["prior"]["text"]
    base = table["model"] == "sanchez_cuevas"
    assert {"K_b", "L_inf_N[0.25]", "L_inf_N[0.92]"} <= set(table["parameter"][base])
    assert not any(p.startswith("L_inf") for p in table["parameter"][~base])
    own = fits["sanchez_cuevas"]
    for throttle, level in own["posterior"]["L_inf_N"].items():
        fitted = own["L_inf_N"][throttle]["value"]
        assert level["value"] == pytest.approx(fitted, abs=3 * level["u"])


def test_too_few_steps_end_the_run_with_code_5(command, asking):
    base = 'ground = { base = "sanchez_cuevas_free_exponent", rivals = [] }'
    refused = command("fit", raw=asking(f"ess = 20000\nsteps = 400\n{base}"))
    assert refused.exit_code == 5
    assert "run at least" in refused.stderr
    assert "Traceback" not in refused.stderr
    assert command("fit").exit_code == 0


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('sampler = "emcee"', "known here"),
        ("ess = 5", "fit.ess"),
        ("walkers = 8", "did you mean|known here"),
    ],
)
def test_what_cannot_be_asked_for_is_refused(asking, text, match):
    with pytest.raises(ManifestError, match=match):
        manifests.load(asking(text))


def test_posterior_nc_opens_in_arviz(command, products):
    exported = command("export", "--netcdf")
    assert exported.exit_code == 0
    path = Path(exported.stdout.strip())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import arviz
    table = tables.read_table(products / POSTERIOR.file, POSTERIOR)
    draws = draws_of(table, model="sanchez_cuevas", parameter="K_b")
    root = arviz.from_netcdf(path).posterior
    group = arviz.InferenceData.from_netcdf(path, base_group="ground/sanchez_cuevas").posterior
    for opened in (root, group):
        np.testing.assert_array_equal(np.asarray(opened["K_b"]).ravel(), draws)
        assert opened["K_b"].attrs["prior"] == "normal, mean 2, sd 4"
    assert list(np.asarray(group["throttle"])) == [0.25, 0.5, 0.75, 0.92]
    assert group.attrs["data_sha256"] == tables.sha256(products / TRIALS.file)
    assert float(arviz.ess(np.asarray(root["K_b"]))) > 3800
    assert float(arviz.rhat(np.asarray(root["K_b"]))) < 1.02
    first = path.read_bytes()
    assert command("export", "--netcdf").exit_code == 0
    assert path.read_bytes() == first


def test_export_asks_for_a_format_and_its_package_and_all_are_on_the_command_line(
    command, monkeypatch
):
    flags = {p.name for p in cli.main.commands["export"].params if getattr(p, "is_flag", False)}
    assert FORMATS.keys() <= flags
    refused = command("export")
    assert (refused.exit_code, "no format was asked for" in refused.stderr) == (2, True)
    monkeypatch.setitem(sys.modules, "arviz", None)
    refused = command("export", "--netcdf")
    told = "pip install 'nearlift[arviz]'" in refused.stderr
    assert (refused.exit_code, told) == (4, True)


def test_a_fit_writes_posterior_nc_when_asked_and_leaves_no_old_one(command, asking, products):
    asked = asking("netcdf = true\nground = { rivals = [] }")
    for raw, there in (({"raw": asked}, True), ({}, False)):
        assert command("fit", **raw).exit_code == 0
        assert (products / "posterior.nc").is_file() is there


def test_one_coefficient_is_quoted_from_the_grid_and_the_draws_agree_within_their_error(small_job):
    fits, table = small_job.read_json(FIT)["boundaries"]["ground"], small_job.read(POSTERIOR)
    for model, entry in fits.items():
        if len(entry["parameters"]) != 1:
            continue
        [(name, exact)] = entry["posterior"]["parameters"].items()
        draws = draws_of(table, boundary="ground", model=model, parameter=name)
        sampled = np.quantile(draws, [0.05, 0.5, 0.95])
        # four standard errors of a quantile in the tail of a normal, sqrt(0.05 0.95 / n) / 0.103 u,
        # at the effective number of draws
        within = 4 * np.sqrt(0.05 * 0.95 / exact["ess_tail"]) / 0.103 * exact["u"]
        quoted = [exact[key] for key in ("lo90", "median", "hi90")]
        assert quoted == pytest.approx(sampled, abs=within)
        assert not np.array_equal(quoted, sampled)
