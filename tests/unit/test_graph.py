"""What makes a stage stale: content and nothing else; and what a run leaves behind."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from nearlift.errors import UsageError
from nearlift.products import TRIALS
from nearlift.run import graph, provenance, store
from nearlift.run.inputs import digests, remember
from nearlift.stages import fit

from . import small_run
from .small_run import job, ran, state

#: A campaign without grids of velocity, and for whose vehicle nothing is flown.
EVERY = [stage.name for stage in graph.STAGES if stage.name not in ("flow", "simulate", "detect")]


pytestmark = pytest.mark.usefixtures("plain_pictures")


@pytest.fixture(scope="session")
def finished(once) -> Path:
    """A folder with raw/ and an out/ that is up to date."""

    def run(place: Path) -> None:
        small_run.write(place / "raw")
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("nearlift.report.figures.files.render", small_run.undrawn)
            assert ran(job(place / "raw", place)) == EVERY

    return once("finished-undrawn", run)


@pytest.fixture
def place(finished, tmp_path) -> Path:
    """A copy of it to spoil."""
    shutil.copytree(finished, tmp_path / "copy")
    return tmp_path / "copy"


def stale(place: Path, **changes) -> dict[str, str]:
    """Name and reason of every stage that `plan` would run."""
    return {
        stage.name: why for stage, why in graph.plan(job(place / "raw", place, **changes)) if why
    }


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def test_nothing_is_stale_after_a_run_and_a_second_run_writes_nothing(place):
    before = state(place)
    assert stale(place) == {}
    assert ran(job(place / "raw", place)) == []
    assert state(place) == before


def test_times_do_not_count(place):
    for path in (place / "raw").rglob("*"):
        os.utime(path, (1e9, 1e9))
    for path in (place / "processed").rglob("*"):
        os.utime(path)
    assert stale(place) == {}


def test_a_changed_trial_runs_all_that_hangs_on_it(place):
    record = next((place / "raw" / "trials").glob("*.csv"))
    lines = record.read_text().splitlines()
    record.write_text("\n".join([*lines[:-1], f"{float(lines[-1]) + 5:.4f}"]) + "\n")
    why = stale(place)
    assert list(why) == EVERY
    assert why["ingest"] == f"trials/{record.name} has changed"
    assert why["fit"] == "ingest will run"
    assert ran(job(place / "raw", place)) == EVERY
    assert stale(place) == {}


def test_a_changed_number_in_the_schedule_counts_as_raw(place):
    edit(place / "raw" / "trials.csv", ",25,", ",25.0,")
    assert stale(place)["ingest"] == "trials.csv has changed"
    # the same numbers in other words: what ingest makes anew is what stood there, but for the
    # schedule's digest in the report
    assert ran(job(place / "raw", place)) == ["ingest", "report"]


@pytest.mark.parametrize(
    ("old", "new", "first", "wanted"),
    [
        ("[vehicle]", '[report]\ncolumn_width = "90 mm"\n\n[vehicle]', "report", ["report"]),
        ("# SIMULATED.", "# Simulated.", "report", ["report"]),
        ('"0.1 mm"', '"0.3 mm"', "fit", ["fit", "diagnose", "report"]),
        (
            "[vehicle]",
            "[fit.ground]\nrivals = []\n\n[vehicle]",
            "fit",
            ["fit", "diagnose", "report"],
        ),
        (
            "[vehicle]",
            "[diagnose]\nfalse_alarm_rate = 0.01\n\n[vehicle]",
            "diagnose",
            ["diagnose", "report"],
        ),
        (
            "[vehicle]",
            "[quality]\ndrift = 0.04\n\n[vehicle]",
            "ingest",
            ["ingest", "reduce", "report"],
        ),
        (
            '"65 mm"',
            '"66 mm"',
            "ingest",
            ["ingest", "reduce", "fit", "diagnose", "report"],
        ),
        (
            "[trials]",
            '[trials]\norder = "unknown"',
            "ingest",
            ["ingest", "reduce", "fit", "diagnose", "report"],
        ),
    ],
    ids=["style", "comment", "budget", "rivals", "false alarms", "quality", "spacing", "order"],
)
def test_an_edited_manifest_runs_what_the_edit_concerns(place, old, new, first, wanted):
    """Whatever it is, the report runs, since it prints the manifest's digest. Figures' style
    concerns nothing else.
    """
    edit(place / "raw" / "campaign.toml", old, new)
    assert next(iter(stale(place))) == first
    assert ran(job(place / "raw", place)) == wanted
    assert stale(place) == {}


def test_an_overlay_concerns_the_report_only(place):
    (place / "raw" / "others.csv").write_text("z_hat,delta_L,u\n2,0.05,0.01\n")
    overlay = (
        '[[report.overlay]]\nfile = "others.csv"\nlabel = "others"\nboundary ='
        ' "ground"\n\n[vehicle]'
    )
    edit(place / "raw" / "campaign.toml", "[vehicle]", overlay)
    assert ran(job(place / "raw", place)) == ["report"]
    edit(place / "raw" / "others.csv", "0.05", "0.06")
    assert stale(place) == {"report": "others.csv has changed"}


PRODUCTS = {
    "trials.parquet": "ingest",
    "lift.parquet": "reduce",
    "lift_covariance.parquet": "reduce",
    "fit.json": "fit",
    "diagnosis.json": "diagnose",
    "results.json": "diagnose",
}
#: Stages that have to follow: what `fit` quotes is overwritten by `diagnose`, which must then do so
#: again.
FOLLOW = {"fit": ["diagnose"]}


@pytest.mark.parametrize("file", PRODUCTS)
def test_a_deleted_product_is_made_again_and_nothing_else(place, file):
    path = place / "processed" / "small" / file
    content = path.read_bytes()
    path.unlink()
    assert stale(place)[PRODUCTS[file]] == f"processed/{file} is missing"
    assert ran(job(place / "raw", place)) == [PRODUCTS[file], *FOLLOW.get(PRODUCTS[file], [])]
    assert path.read_bytes() == content


@pytest.mark.parametrize("file", PRODUCTS)
def test_a_damaged_product_is_made_again_and_nothing_else(place, file):
    path = place / "processed" / "small" / file
    content = path.read_bytes()
    middle = len(content) // 2
    path.write_bytes(content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :])
    assert stale(place)[PRODUCTS[file]] == f"processed/{file} was changed after it was written"
    assert ran(job(place / "raw", place)) == [PRODUCTS[file], *FOLLOW.get(PRODUCTS[file], [])]
    assert path.read_bytes() == content


@pytest.mark.parametrize("file", ["index.html", "fig2.png", "fig2.csv", "tables/coefficients.tex"])
def test_a_deleted_page_is_made_again(place, file):
    (place / "reports" / "small" / file).unlink()
    assert stale(place) == {"report": f"reports/{file} is missing"}


def test_a_fit_of_a_doctored_product_does_not_pass_for_one_of_the_real(place):
    """`nearlift fit` on a trials.parquet that someone has edited, then `nearlift run`: the trials
    are restored, and the fit too.
    """
    path = place / "processed" / "small" / "trials.parquet"
    good = (place / "processed" / "small" / "fit.json").read_bytes()
    table = store.read_table(path, TRIALS)
    table["lift_N"] = table["lift_N"] * 1.01
    store.write_bytes(path, store.table_bytes(table, TRIALS))
    list(graph.run(job(place / "raw", place), (graph.stage("fit"),), force=True))
    assert (place / "processed" / "small" / "fit.json").read_bytes() != good
    assert ran(job(place / "raw", place))[:2] == ["ingest", "fit"]
    assert (place / "processed" / "small" / "fit.json").read_bytes() == good


def test_another_seed_another_code_another_version_make_all_stale(place, monkeypatch):
    assert set(stale(place, seed=1).values()) == {"the seed has changed"}
    with monkeypatch.context() as patch:
        patch.setattr(provenance, "code_digest", lambda: "another")
        assert stale(place) == dict.fromkeys(EVERY, "nearlift itself has changed")
    versions = {**provenance.versions(), "numpy": "1.0"}
    monkeypatch.setattr(provenance, "versions", lambda: versions)
    assert stale(place) == dict.fromkeys(EVERY, "version of numpy has changed")


@pytest.mark.parametrize("content", [None, "{ not json", '{"schema": "nearlift.provenance/99"}'])
def test_without_a_ledger_everything_runs_anew_and_comes_out_the_same(place, content):
    ledger = place / "processed" / "small" / "provenance.json"
    before = {
        name: sha for name, (sha, _) in state(place).items() if not name.endswith("provenance.json")
    }
    ledger.unlink() if content is None else ledger.write_text(content)
    assert stale(place) == dict.fromkeys(EVERY, "has not run yet")
    assert ran(job(place / "raw", place)) == EVERY
    assert {
        name: sha for name, (sha, _) in state(place).items() if not name.endswith("provenance.json")
    } == before


def test_a_stage_that_breaks_off_is_not_committed_and_those_before_it_are(place, monkeypatch):
    edit(place / "raw" / "campaign.toml", '"0.1 mm"', '"0.3 mm"')

    def interrupted(_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(fit, "run", interrupted)
        with pytest.raises(KeyboardInterrupt):
            ran(job(place / "raw", place))
    assert ran(job(place / "raw", place)) == ["fit", "diagnose", "report"]


def test_what_a_finished_stage_said_is_said_again(place):
    """Rejections and notes of a stage that need not run come from the ledger."""
    record = sorted((place / "raw" / "trials").glob("*.csv"))[5]
    record.unlink()
    first = [(s.stage.name, s.outcome) for s in graph.run(job(place / "raw", place))]
    second = [(s.stage.name, s.outcome) for s in graph.run(job(place / "raw", place))]
    assert [o.rejected for _, o in first] == [o.rejected for _, o in second]
    assert [list(o.notes) for _, o in first] == [list(o.notes) for _, o in second]
    (rejected,) = first[0][1].rejected
    assert rejected[0] == record.stem


def test_the_ledger_says_what_made_the_products(place):
    ledger = json.loads((place / "processed" / "small" / "provenance.json").read_text())
    assert ledger["schema"] == "nearlift.provenance/1"
    assert ledger["options"] == {"seed": 0}
    assert list(ledger["stages"]) == EVERY
    assert ledger["inputs"]["trials.csv"]["sha256"] == store.sha256(place / "raw" / "trials.csv")
    assert set(ledger["versions"]) >= {"python", "numpy", "scipy", "lmfit"}
    for stage in ledger["stages"].values():
        assert stage["wall_s"] > 0
        assert all(len(sha) == 64 for sha in stage["outputs"].values())


def test_a_stage_that_is_not_one_is_refused_with_those_that_are():
    with pytest.raises(
        UsageError, match="stage: 'fly' is not a stage\n  stages are ingest, reduce, fit"
    ):
        graph.stage("fly")


def test_every_stage_reads_only_what_an_earlier_one_writes():
    made = set()
    for stage in graph.STAGES:
        assert {p.file for p in stage.reads} <= made
        # what fit quotes stands until it is diagnosed
        assert made & {p.file for p in stage.writes} == (
            {"results.json"} if stage.name == "diagnose" else set()
        )
        made |= {p.file for p in stage.writes}


def test_what_is_quoted_belongs_to_the_stage_that_wrote_it_last(place):
    record = json.loads((place / "processed" / "small" / "provenance.json").read_text())["stages"]
    assert [name for name, own in record.items() if "processed/results.json" in own["outputs"]] == [
        "diagnose"
    ]
    list(graph.run(job(place / "raw", place), [graph.stage("fit")], force=True))
    assert stale(place)["diagnose"] == "processed/results.json is as an earlier stage left it"


# ---- digests of inputs


def test_a_file_is_hashed_again_only_where_size_or_time_has_changed(place, monkeypatch):
    given = job(place / "raw", place)
    for path in (place / "raw").rglob("*.*"):
        os.utime(path, (1e9, 1e9))
    inputs, stamps = digests(given.root, given.campaign, given.processed)
    remember(given.processed, stamps)
    hashed = []
    monkeypatch.setattr(store, "sha256", lambda path: hashed.append(Path(path).name) or "new")
    assert digests(given.root, given.campaign, given.processed)[0] == inputs
    assert hashed == []
    os.utime(place / "raw" / "trials.csv", (1e9, 1e9 + 1))
    assert digests(given.root, given.campaign, given.processed)[0]["trials.csv"] == "new"
    assert hashed == ["trials.csv"]


def test_a_file_changed_just_now_is_not_remembered(place):
    """It may change again within the clock's resolution, and its time would not tell."""
    given = job(place / "raw", place)
    for path in (place / "raw").rglob("*.*"):
        os.utime(path, (1e9, 1e9))
    (place / "raw" / "trials.csv").touch()
    _, stamps = digests(given.root, given.campaign, given.processed)
    remember(given.processed, stamps)
    kept = json.loads((given.processed / "inputs-cache.json").read_text())
    assert "trials.csv" not in kept
    assert "campaign.toml" in kept


def test_a_damaged_cache_is_no_cache(place):
    given = job(place / "raw", place)
    whole, _ = digests(given.root, given.campaign, given.processed)
    (given.processed / "inputs-cache.json").write_text('{"trials.csv": ')
    assert digests(given.root, given.campaign, given.processed)[0] == whole


def test_digests_write_nothing_and_are_kept_only_beside_products(place):
    given = job(place / "raw", place, processed=place / "elsewhere")
    _, stamps = digests(given.root, given.campaign, given.processed)
    remember(given.processed, stamps)
    assert not given.processed.exists()
