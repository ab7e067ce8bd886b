"""The Python interface: the command line's stages, ledger and products, as typed values that show
themselves in a notebook.
"""

from __future__ import annotations

import dataclasses
import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import nearlift
from nearlift.errors import ManifestError, UsageError
from nearlift.study.answers import Fit

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


class Balanced(HTMLParser):
    """Every element that is opened is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        if tag != "img":
            self.open.append(tag)
        else:
            assert dict(attrs)["alt"]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


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
    assert set(nearlift.__all__) == {"Study", "__version__", "load"}
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
    Balanced(found._repr_html_())
    assert "112" in found._repr_html_()


def test_a_fit_says_what_fit_json_says(study, fit):
    entry = product(study, "fit.json")["boundaries"]["ground"]["sanchez_cuevas"]
    K_b = fit["ground"].base.coefficients["K_b"]
    assert fit["ground"].base is fit["ground"]["sanchez_cuevas"]
    assert {k: getattr(K_b, k) for k in ("value", "u", "lo90", "hi90")} == {
        k: entry["parameters"]["K_b"][k] for k in ("value", "u", "lo90", "hi90")
    }
    assert fit["ground"].base.L_inf_N[0.25].unit == "N"
    assert [at.boundary for at in fit] == ["ground"]
    told = fit.quoted["ground"].coefficients["K_b"]
    row = fit.table.iloc[0]
    assert (row["coefficient"], row["value"], row["lo95"]) == ("K_b", told.value, told.lo95)
    draws = fit.draws("ground")
    assert draws["K_b"].mean() == pytest.approx(
        entry["parameters"]["K_b"]["value"], abs=0.3 * entry["parameters"]["K_b"]["u"]
    )


def test_answers_are_frozen(fit):
    with pytest.raises(dataclasses.FrozenInstanceError):
        fit["ground"].base.parameters = {}


def test_what_is_not_there_is_refused_with_what_is(study, fit):
    with pytest.raises(UsageError, match=r"'ceiling' was not fitted(.|\n)*there are ground"):
        fit["ceiling"]
    with pytest.raises(UsageError, match=r"no fit of 'hayden ' at the ground"):
        fit["ground"]["hayden "]
    with pytest.raises(UsageError, match=r"is no figure(.|\n)*fig2"):
        study.figure("fig9")
    with pytest.raises(UsageError, match=r"cannot be drawn"):
        study.figure("fig3", bring=False)
    with pytest.raises(UsageError, match=r"is no table product(.|\n)*trials\.parquet"):
        study.read("trials.csv")
    with pytest.raises(UsageError, match=r"there are none at the ground"):
        fit.draws("ground", "sanchez_cuevas_published")


def test_a_fit_shows_intervals_and_figure_2(fit):
    shown = fit._repr_html_()
    Balanced(shown)
    assert re.search(
        r"<td>ground</td><td>Sanchez-Cuevas</td><td>K_b</td><td>[\d.]+ ± [\d.]+</td><td>[\d.]+ to"
        r" [\d.]+</td>",
        shown,
    )
    assert 'src="data:image/png;base64,' in shown
    assert "http" not in shown


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
    assert found.table["verdict"].tolist() == [at.verdict]
    assert found.table["value"].tolist() == [found.quoted["ground"].coefficients["K_b"].value]
    Balanced(found._repr_html_())
    assert at.verdict in found._repr_html_()


def test_a_figure_has_words_and_its_table(study, fit, tmp_path):
    drawn = fit.drawing
    assert drawn.name == "fig2"
    assert len(drawn.data) == len(next(iter(drawn.table.values())))
    assert drawn.save(tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    assert drawn.save(tmp_path / "a.pdf").read_bytes()[:4] == b"%PDF"
    with pytest.raises(UsageError, match=r"neither \.png nor \.pdf"):
        drawn.save(tmp_path / "a.gif")


def test_rejected_trials_and_notes_are_carried(tmp_path):
    raw = small_run.write(tmp_path / "raw")
    (next((raw / "trials").iterdir())).write_bytes(b"")
    found = nearlift.load(raw, tmp_path, executor="serial").reduce()
    assert [reason.split()[0].rstrip(":") for _, reason in found.rejected] == ["EMPTY"]
    assert "EMPTY" in found._repr_html_()


def test_the_repr_of_a_study_is_its_plan(study, fit):
    Balanced(study._repr_html_())
    assert "up to date" in study._repr_html_()
    assert repr(Path(study.root).name)[1:-1] in repr(study)
