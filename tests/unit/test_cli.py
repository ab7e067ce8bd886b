"""The command line: exit codes, one JSON object, nothing written that was not asked for, and the
demo against the contract.
"""

from __future__ import annotations

import errno
import json
import math
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

from nearlift.campaign import manifest as manifests
from nearlift.cli import main
from nearlift.errors import ManifestError
from nearlift.run import engine, tables
from nearlift.stages import ORDER, STAGES
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT, LIFT_COVARIANCE
from nearlift.terminal import COMPUTES, HEADINGS, OPENS, SETTINGS

from . import small_run, written
from .small_run import nearlift, state

#: Stages of a campaign whose manifest has no section for the others.
ALWAYS = [s.name for s in STAGES if not s.where]


@pytest.fixture(scope="session")
def raw(small_campaign, tmp_path_factory) -> Path:
    return copy(small_campaign / "raw", tmp_path_factory.mktemp("cli") / "raw")


@pytest.fixture(scope="session")
def finished(small_campaign, tmp_path_factory) -> Path:
    """A folder with the products of a run."""
    out = tmp_path_factory.mktemp("cli-out")
    for folder in ("processed", "reports"):
        copy(small_campaign / folder, out / folder)
    return out


def copy(folder: Path, to: Path) -> Path:
    shutil.copytree(folder, to)
    return to


# ---- runs


@pytest.mark.usefixtures("plain_pictures")
def test_two_fresh_runs_give_the_same_bytes(raw, finished, tmp_path):
    """Another folder, another time, another executor: every product and page is the same; in
    provenance.json only wall times differ.
    """
    assert nearlift("run", raw, "--out", tmp_path, "--executor", "threads:2").exit_code == 0
    one, two = (
        {
            name: sha
            for name, (sha, _) in state(folder).items()
            if not name.endswith("inputs-cache.json")
        }
        for folder in (finished, tmp_path)
    )
    differ = {name for name in one.keys() | two.keys() if one.get(name) != two.get(name)}
    assert differ <= {"processed/small/provenance.json"}
    ledgers = [
        json.loads((folder / "processed/small/provenance.json").read_text())
        for folder in (finished, tmp_path)
    ]
    for ledger in ledgers:
        for stage in ledger["stages"].values():
            assert stage.pop("wall_s") > 0
    assert ledgers[0] == ledgers[1]


def test_a_second_run_does_nothing(raw, finished):
    before = state(finished)
    cache = "processed/small/inputs-cache.json"  # digests of raw files, kept from now on
    found = nearlift("run", raw, "--out", finished)
    assert found.exit_code == 0
    assert re.findall(r"^(\w+) +up to date$", found.stderr, re.M) == ALWAYS
    assert found.stdout == f"{finished}/reports/small/index.html\n"
    summary = (finished / "reports/small/summary.txt").read_text()
    assert "[[Ground]] " in summary
    assert found.stderr.endswith(f"\n{summary}\nunchanged since the last run\n")
    before.pop(cache, None)
    assert {k: v for k, v in state(finished).items() if k != cache} == before


@pytest.mark.usefixtures("plain_pictures")
def test_raw_is_never_touched(raw, tmp_path):
    """Content and times of every file, and no new one, whatever is run."""
    before, folders = state(raw), {p: p.stat().st_mtime_ns for p in (raw, raw / "trials")}
    for words in ("run --dry-run", "run", "run --check", "ingest"):
        assert nearlift(*words.split(), raw, "--out", tmp_path).exit_code == 0
    assert state(raw) == before
    assert {p: p.stat().st_mtime_ns for p in folders} == folders


@pytest.mark.parametrize("where", ["nothing", "finished", "stale"])
def test_a_dry_run_runs_nothing_and_writes_nothing(raw, finished, tmp_path, monkeypatch, where):
    out, root = tmp_path / "out", copy(raw, tmp_path / "raw")
    if where != "nothing":
        copy(finished, out)
    if where == "stale":
        (root / "trials.csv").write_text((root / "trials.csv").read_text() + "\n")
    before = state(tmp_path)
    monkeypatch.setattr(engine, "run", lambda *_: pytest.fail("a stage ran"))
    found = nearlift("run", "--dry-run", root, "--out", out)
    assert found.exit_code == 0
    after = state(tmp_path)
    assert {name for name in after if after[name] != before.get(name)} <= {
        "out/processed/small/inputs-cache.json"
    }
    assert before.keys() <= after.keys()
    assert out.exists() == (where != "nothing")
    expected = {
        "nothing": "run: has not run yet",
        "finished": "up to date",
        "stale": "run: trials.csv has changed",
    }[where]
    assert found.stdout.splitlines()[0] == f"ingest   {expected}"
    assert len(found.stdout.splitlines()) == len(ALWAYS)


def test_one_stage_runs_even_if_it_is_up_to_date_and_makes_the_same(raw, finished, tmp_path):
    out = copy(finished, tmp_path / "out")
    before = {
        name: sha
        for name, (sha, _) in state(out).items()
        if not re.search("provenance|cache", name)
    }
    found = nearlift("fit", raw, "--out", out)
    assert found.exit_code == 0
    assert "fit      fit lift models by least squares, with posteriors (asked for)" in found.stderr
    # what is quoted is the fit's again, until it is diagnosed
    again = nearlift("diagnose", raw, "--out", out)
    assert again.exit_code == 0
    assert {
        name: sha
        for name, (sha, _) in state(out).items()
        if not re.search("provenance|cache", name)
    } == before


def test_only_is_the_command_of_that_stage(raw, finished, tmp_path):
    one, two = (copy(finished, tmp_path / name) for name in ("one", "two"))
    command = nearlift("reduce", raw, "--out", one, "--json")
    option = nearlift("run", "--only", "reduce", raw, "--out", two, "--json")
    told = [json.loads(found.stdout)["stages"] for found in (command, option)]
    assert [[(s["stage"], s["why"]) for s in stages] for stages in told] == 2 * [
        [("reduce", "asked for")]
    ]


def test_a_stage_before_its_time_says_what_must_run_first(raw, tmp_path):
    found = nearlift("fit", raw, "--out", tmp_path)
    assert found.exit_code == 4
    assert "trials.parquet: is missing\n  run the stage that writes it" in found.stderr


# ---- exit codes


def test_2_for_a_bad_manifest_which_writes_nothing(raw, tmp_path):
    root = copy(raw, tmp_path / "raw")
    text = (root / "campaign.toml").read_text()
    (root / "campaign.toml").write_text(
        text.replace('rotor_radius  = "23 mm"', "rotor_radius = 23").replace("[rig]", "[rigg]")
    )
    for words in ("run", "ingest", "run --dry-run", "run --check"):
        found = nearlift(*words.split(), root, "--out", tmp_path / "out")
        assert found.exit_code == 2
        assert "vehicle.rotor_radius" in found.stderr
        assert "did you mean 'rig'?" in found.stderr
        assert "Traceback" not in found.stderr
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("run", "{raw}", "--executor", "gpu"), "'gpu' is not an executor"),
        (
            ("run", "{raw}/nowhere"),
            "holds no campaign.toml\n  `nearlift new DIR` writes one to fill in",
        ),
        (("describe", "sanches_cuevas"), "sanchez_cuevas"),
        (("run",), "Missing argument 'CAMPAIGN...'"),
        (("run", "{raw}", "--only", "plan"), "Invalid value for '--only'"),
        (("run", "{raw}", "--check", "--dry-run"), "--dry-run: was given with --check"),
        (("run", "{raw}", "--only", "fit", "--watch"), "--only: was given with --watch"),
        (("fly", "{raw}"), "No such command 'fly'"),
        (("run", "{raw}", "--seed", "x"), "'x' is not a valid integer"),
        (("new", "{raw}"), "is not empty\n  name a new folder; nothing is ever overwritten"),
        (("new", "{raw}/campaign.toml"), "is a file\n  name a new folder"),
    ],
)
def test_2_for_usage(raw, tmp_path, words, text):
    found = nearlift(
        *(w.format(raw=raw) for w in words),
        *(
            ()
            if words[0] in ("fly", "describe", "new") or len(words) < 2
            else ("--out", tmp_path / "out")
        ),
    )
    assert found.exit_code == 2
    assert text in found.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("plain_pictures")
def test_3_for_rejected_trials_each_with_its_reason_now_and_later(tmp_path):
    root, out = small_run.write(tmp_path / "raw", visits=2), tmp_path / "out"
    lost, broken = sorted((root / "trials").glob("*.csv"))[5:7]
    lost.unlink()
    broken.write_text("\n".join(broken.read_text().splitlines()[:40]) + "\n")
    for _ in range(2):
        found = nearlift("run", root, "--out", out)
        assert found.exit_code == 3
        assert "2 trials rejected:" in found.stderr
        for trial in (lost.stem, broken.stem):
            assert re.search(rf"^  {trial}: \w+", found.stderr, re.M)
        assert (out / "reports/small/index.html").is_file()
    answer = json.loads(nearlift("run", root, "--out", out, "--json").stdout)
    assert answer["exit_code"] == 3
    assert [t for t, _ in answer["stages"][0]["rejected"]] == [lost.stem, broken.stem]


def test_3_lists_ten_and_with_v_all(raw, tmp_path):
    root = copy(raw, tmp_path / "raw")
    for path in sorted((root / "trials").glob("*.csv"))[:12]:
        path.unlink()
    short, long = (
        nearlift("ingest", root, "--out", tmp_path / "out", *flag) for flag in ((), ("-v",))
    )
    assert "  ... and 2 more (-v lists all)" in short.stderr
    assert len(re.findall(r"^  t\d+: ", short.stderr, re.M)) == 10
    assert len(re.findall(r"^  t\d+: ", long.stderr, re.M)) == 12


def test_4_for_records_that_are_not_there(raw, tmp_path):
    root = copy(raw, tmp_path / "raw")
    shutil.rmtree(root / "trials")
    found = nearlift("run", root, "--out", tmp_path / "out")
    assert found.exit_code == 4
    assert re.search(r"none of the 112 trials has a record|no file", found.stderr)
    assert not {*state(tmp_path / "out")} - {"processed/small/.lock"}


def test_4_for_an_output_folder_that_cannot_be_written(raw, tmp_path):
    """A file stands where processed/ should: refused in one line, with the path."""
    (tmp_path / "processed").write_text("in the way")
    found = nearlift("run", raw, "--out", tmp_path)
    assert found.exit_code == 4
    assert re.search(r"error: .*processed.*: .*\n  check that it exists", found.stderr)
    assert "Traceback" not in found.output


def test_5_for_a_base_model_that_cannot_be_fitted(tmp_path):
    root = small_run.write_means(tmp_path / "raw", rows=6)
    found = nearlift("run", root, "--out", tmp_path)
    assert found.exit_code == 5
    assert (
        "error: fit of sanchez_cuevas: 6 usable trials for 5 unknowns\n  at least 7 trials are needed"
        in found.stderr
    )
    # what came before stands
    assert (tmp_path / "processed/means/lift.parquet").is_file()
    assert not (tmp_path / "processed/means/fit.json").exists()


@pytest.mark.usefixtures("plain_pictures")
def test_a_base_model_without_a_free_coefficient_goes_all_the_way(tmp_path):
    root = small_run.write(tmp_path / "raw", form="parquet")
    manifest = root / "campaign.toml"
    manifest.write_text(
        manifest.read_text() + '\n[fit.ground]\nbase = "sanchez_cuevas_published"\n'
    )
    found = nearlift("run", root, "--out", tmp_path)
    assert found.exit_code == 0, found.output
    assert (tmp_path / "reports/small/index.html").is_file()


@pytest.mark.usefixtures("plain_pictures")
def test_130_for_an_interrupt_after_which_the_same_command_goes_on(tmp_path, monkeypatch):
    raw = small_run.write_means(tmp_path / "raw", 24, quick=True)

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("nearlift.fit.models.fit_boundary", interrupted)
        found = nearlift("run", raw, "--out", tmp_path, "--json")
    assert found.exit_code == 130
    assert (
        "interrupted; finished products remain, and the same command continues from there"
        in found.stderr
    )
    assert json.loads(found.stdout)["exit_code"] == 130
    again = nearlift("run", raw, "--out", tmp_path)
    assert again.exit_code == 0
    assert re.findall(r"^(\w+) +up to date$", again.stderr, re.M) == ["ingest", "reduce"]


def test_a_defect_is_not_dressed_up_as_a_refusal(raw, tmp_path, monkeypatch):
    """Something that nobody foresaw must come out as what it is."""
    monkeypatch.setattr("nearlift.fit.models.fit_boundary", lambda *_, **__: 1 / 0)
    assert isinstance(nearlift("run", raw, "--out", tmp_path).exception, ZeroDivisionError)


@pytest.mark.parametrize("end", ["2>&-", "2>/dev/full"])
def test_a_stderr_that_is_closed_or_full_is_no_failure(raw, tmp_path, end):
    if "full" in end and not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    words = [sys.executable, "-P", "-c", "from nearlift.cli import main; main()"]
    command = shlex.join([*words, "ingest", str(raw), "--out", str(tmp_path)])
    assert subprocess.run(f"exec {command} {end}", shell=True, check=False).returncode == 0
    assert (tmp_path / "processed/small/trials.parquet").is_file()


def test_a_closed_pipe_is_no_refusal(monkeypatch):
    """`nearlift describe | head`: nobody listens any more, so nothing more is said."""

    def closed(_):
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    monkeypatch.setattr("nearlift.describe.describe", closed)
    found = nearlift("describe")
    assert (found.exit_code, found.output) == (1, "")


# ---- JSON


@pytest.mark.parametrize(
    ("words", "code", "keys"),
    [
        (("run", "{raw}", "--out", "{finished}"), 0, {"campaign", "exit_code", "report", "stages"}),
        (("run", "--dry-run", "{raw}", "--out", "{finished}"), 0, {"campaign", "stages"}),
        (
            ("run", "--check", "{raw}", "--out", "{finished}"),
            0,
            {"campaign", "checked", "differing"},
        ),
        (("run", "--check", "{raw}", "{raw}", "--out", "{finished}"), 0, {"campaigns"}),
        (("inspect", "{raw}/trials.csv", "{raw}/trials.csv"), 0, {"files"}),
        (("describe",), 0, {"name", "text"}),
        (("describe", "K_b"), 0, {"name", "text"}),
        (("new", "{new}"), 0, {"written", "fill_in", "notes"}),
        (("new", "{raw}"), 2, {"exit_code", "where", "what", "remedy"}),
        (("run", "{raw}/nowhere"), 2, {"exit_code", "where", "what", "remedy"}),
    ],
)
def test_json_is_one_object_and_nothing_else(raw, finished, tmp_path, words, code, keys):
    found = nearlift(
        *(w.format(raw=raw, finished=finished, new=tmp_path / "new") for w in words), "--json"
    )
    assert found.exit_code == code
    answer = json.loads(found.stdout)
    assert answer.keys() == keys
    assert answer.get("exit_code", 0) == code
    if code == 0:
        assert found.stderr == ""


def test_json_of_a_dry_run_says_what_is_stale(raw, tmp_path):
    stages = json.loads(nearlift("run", "--dry-run", raw, "--out", tmp_path, "--json").stdout)[
        "stages"
    ]
    assert stages[0] == {"stage": "ingest", "stale": True, "why": "has not run yet"}


def test_quiet_says_nothing(raw, finished):
    found = nearlift("run", raw, "--out", finished, "-q")
    assert (found.exit_code, found.output) == (0, "")


# ---- new, describe, help


def test_new_makes_a_folder_that_runs_once_it_is_filled_in(tmp_path):
    folder = tmp_path / "My Rig_é"
    found = nearlift("new", folder)
    assert found.exit_code == 0
    told = found.stdout.splitlines()
    assert {Path(line).name for line in told[: told.index("still to fill in:")]} == {
        "campaign.toml",
        "trials.csv",
        "trials",
    }
    # nothing physical stands in it: all of it is listed at once, here and when it is run
    text = (folder / "campaign.toml").read_text()
    blank = [line.partition("#")[0] for line in text.splitlines()]
    blank = [line for line in blank if "FILL IN" in line]
    assert len(blank) == 15
    for line in blank:
        assert f": {line.strip()}" in found.stdout
    with pytest.raises(ManifestError) as refused:
        manifests.load(folder)
    assert str(refused.value).count("is still to be filled in") == len(blank) + 1
    settings = tomllib.loads(re.sub(r".*FILL IN.*\n", "", text))
    assert settings == {
        "schema": "nearlift.campaign/1",
        "name": "my-rig-e",
        "vehicle": {},
        "rig": {},
        "load_cell": {"settle": "0 s"},
        "records": {"reader": "csv", "files": "trials/{trial}.csv"},
        "trials": {"file": "trials.csv", "units": {}},
    }
    rate, column = (
        {"sample_rate": '"1000 Hz"', "tare": '"2 s"'},
        {"distance": '"mm"', "throttle": '"percent"'},
    )
    text = written.fill_in(folder, **rate, **column)
    assert not any("FILL IN" in line.partition("#")[0] for line in text.splitlines())
    given = manifests.load(folder)
    assert given.name == "my-rig-e"
    assert given.vehicle.rotor_spacing == 0.065
    # the commented budget parses too
    manifest = (
        text.replace("# [[", "[[")
        .replace("\n# name", "\nname")
        .replace("# on ", "on ")
        .replace("# value", "value")
        .replace("# scope", "scope")
        .replace("FILL IN percent", "0.5 percent")
        .replace("FILL IN mm", "0.2 mm")
    )
    (folder / "campaign.toml").write_text(manifest)
    assert 2e-4 in [u.standard() for u in manifests.load(folder).uncertainty]
    assert nearlift("run", "--dry-run", folder, "--out", tmp_path).exit_code in (
        2,
        4,
    )  # an empty schedule is refused, not crashed on
    assert nearlift("new", folder).exit_code == 2
    assert (folder / "campaign.toml").read_text() == manifest


@pytest.mark.parametrize(
    ("name", "text"),
    [("sanchez_cuevas", "K_b"), ("supply_sag", "supply"), ("fit.json", "boundary"), ("z_hat", "z")],
)
def test_describe_knows_models_effects_products_and_symbols(name, text):
    found = nearlift("describe", name)
    assert found.exit_code == 0
    assert text in found.stdout
    assert f"`{name}`" in nearlift("describe").stdout


# ---- help, of every command


def commands() -> dict[str, click.Command]:
    """Every command by its whole name."""
    inner = {f"data {name}": command for name, command in main.commands["data"].commands.items()}
    return main.commands | inner


def test_every_summary_is_whole_in_a_list_of_80_columns():
    listed = CliRunner(env={"COLUMNS": "80"}).invoke(main, ["--help"]).stdout
    assert listed.count("...") == listed.count("[ARGS]...")
    assert max(map(len, listed.splitlines())) <= 80
    for name, command in main.commands.items():
        summary = command.help.split("\n")[0].rstrip(".")
        assert re.search(rf"^  {name} +{re.escape(summary)}$", listed, re.M), name
    assert [line[:-1] for line in listed.splitlines() if line[:-1] in HEADINGS] == list(HEADINGS)
    inner = CliRunner(env={"COLUMNS": "80"}).invoke(main, ["data", "--help"]).stdout
    assert inner.count("...") == inner.count("[ARGS]...")
    assert "list " in inner
    assert "get " in inner


def test_every_command_has_a_page_with_an_example_that_can_be_said():
    for name, made in commands().items():
        page = CliRunner(env={"COLUMNS": "80"}).invoke(main, [*name.split(), "--help"])
        assert page.exit_code == 0
        assert made.help.split("\n")[0] in " ".join(page.stdout.split())
        example = page.stdout.split("For example:")[1]
        calls = [line for line in example.splitlines() if line.strip()]
        assert calls, name
        for line in calls:
            context = click.Context(main, **main.context_settings)
            words, command = shlex.split(line)[1:], main
            while isinstance(command, click.Group):
                _, command, words = command.resolve_command(context, words)
            command.make_context(command.name, words, parent=context)


def test_settings_are_offered_where_they_do_something():
    """All that open a campaign take --out; what computes takes an executor and a seed; what only
    answers takes none of these.
    """
    for name, command in commands().items():
        if name == "data":
            continue
        options = {o for p in command.params if isinstance(p, click.Option) for o in p.opts}
        assert {"--json", "-q"} <= options
        given = {setting for setting in SETTINGS if f"--{setting}" in options}
        opens = any(p.name in ("campaign", "campaigns") for p in command.params)
        assert not opens or "out" in given, name
        if name in (*ORDER, "run", "demo"):
            assert given == set(COMPUTES), name
        elif name in ("new", "describe", "data list", "data get", "serve"):
            assert not given
        else:
            assert given <= set(OPENS), name


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("inspct", "did you mean 'inspect'?"),
        ("explian", "did you mean 'explain'?"),
    ],
)
def test_a_word_that_is_no_command_gets_what_may_be_meant(word, hint):
    found = nearlift(word, "x")
    assert found.exit_code == 2
    assert f"No such command '{word}': {hint}" in found.stderr


@pytest.mark.parametrize(
    ("words", "completed"), [("nearlift expl", "plain,explain"), ("nearlift run --dr", "--dry-run")]
)
def test_click_completes_commands_and_options(words, completed):
    env = {
        "_NEARLIFT_COMPLETE": "bash_complete",
        "COMP_WORDS": words,
        "COMP_CWORD": str(words.count(" ")),
    }
    assert completed in CliRunner().invoke(main, env=env, prog_name="nearlift").stdout


def test_quiet_is_quiet_everywhere(raw):
    for words in (
        ("describe",),
        ("run", "--dry-run", raw),
        ("inspect", raw / "trials.csv"),
        ("data", "list"),
    ):
        found = nearlift(*words, "-q")
        assert (found.exit_code, found.output) == (0, "")


def test_the_package_shows_what_there_is_and_imports_it_when_asked():
    told = (
        "import sys, nearlift; print(dir(nearlift)); "
        "print([m for m in sys.modules if m.startswith('nearlift.')]); "
        "print(nearlift.load.__module__, nearlift.Study.__name__)"
    )
    lines = subprocess.run(
        [sys.executable, "-c", told], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert lines == [
        "['Study', '__version__', 'load', 'trials']",
        "['nearlift.version']",
        "nearlift.study Study",
    ]


# ---- the demo


def test_the_demo_obeys_the_contract(demo):
    processed, reports = demo / "processed" / "demo", demo / "reports" / "demo"
    trials = tables.read_table(processed / "trials.parquet", TRIALS)
    record = {"lift_N", "u_lift_N", "n", "n_eff", "drift_N_s", "sd_N", "quality", "source_sha256"}
    assert {"trial", "boundary", "z_hat", "z_m", "throttle"} | record <= trials.keys()
    assert 0 < trials["throttle"].min() <= trials["throttle"].max() <= 1
    assert len(set(trials["trial"])) == len(trials["trial"])

    cells = tables.read_table(processed / "lift.parquet", LIFT)
    assert {
        "boundary",
        "z_hat",
        "throttle",
        "lift_N",
        "u_lift_N",
        "n_trials",
        "delta_L",
        "u_delta_L",
    } <= cells.keys()
    columns = tables.read_table(processed / "lift_covariance.parquet", LIFT_COVARIANCE)
    covariance = np.stack(list(columns.values()), axis=1)
    assert list(columns) == [f"c{i}" for i in range(len(cells["delta_L"]))]
    assert covariance == pytest.approx(covariance.T)
    assert np.sqrt(np.diag(covariance)) == pytest.approx(cells["u_delta_L"])
    for side in ("ground", "ceiling", "sidewall"):
        far = (cells["boundary"] == side) & (
            cells["z_hat"] == cells["z_hat"][cells["boundary"] == side].max()
        )
        assert (cells["delta_L"][far] == 0).all()
        assert (cells["u_delta_L"][far] == 0).all()

    fits = json.loads((processed / "fit.json").read_text())["boundaries"]
    assert set(fits) == {"ground", "ceiling", "sidewall"}
    for models in fits.values():
        for entry in models.values():
            assert {
                "parameters",
                "covariance",
                "chi2",
                "dof",
                "rmse",
                "r2",
                "aic",
                "bic",
                "L_inf_N",
                "degeneracies",
            } <= entry.keys()
            assert all(
                {"value", "u", "lo90", "hi90"} <= p.keys() for p in entry["parameters"].values()
            )
            assert len(entry["L_inf_N"]) == 4
    assert all("r2_near" in entry for entry in fits["ground"].values())

    diagnosis = json.loads((processed / "diagnosis.json").read_text())
    assert diagnosis["schema"] == "nearlift.diagnosis/1"
    for found in diagnosis["boundaries"].values():
        assert found["verdict"] in ("adequate", "effect", "unexplained")
        assert bool(found["effects"]) == (found["verdict"] == "effect")
        error = found["error"]
        assert error["noise_floor"] > 0
        assert all(math.isfinite(error[when]["held_out_rmse"]) for when in ("before", "after"))
        for when in ("before", "after"):
            assert all(
                {"value", "lo90", "hi90"} <= c.keys() for c in found["coefficients"][when].values()
            )
    assert (processed / "provenance.json").is_file()
    for name in ("index.html", "fig2.pdf", "fig2.png", "fig2.csv", "tables/coefficients.tex"):
        assert (reports / name).stat().st_size > 0


def test_the_demo_finds_what_is_in_it_and_says_that_it_is_simulated(demo):
    """Supply sag at the ground, which its manifest does not mention; at the ceiling saturation, in
    a form that the library does not have; nothing at the sidewall.
    """
    found = json.loads((demo / "processed/demo/diagnosis.json").read_text())["boundaries"]
    assert [e["name"] for e in found["ground"]["effects"]] == ["supply_sag"]
    K_b = found["ground"]["coefficients"]["after"]["K_b"]
    assert K_b["lo90"] < 2.0 < K_b["hi90"]
    before = found["ground"]["coefficients"]["before"]["K_b"]
    assert before["hi90"] < 1.0
    assert found["sidewall"]["verdict"] == "adequate"
    ceiling = found["ceiling"]
    assert [e["name"] for e in ceiling["effects"]] == ["near_wall_saturation"]
    alpha = ceiling["coefficients"]["after"]["alpha"]
    assert alpha["lo90"] < 0.125 < alpha["hi90"]
    assert "simulated" in (demo / "reports/demo/index.html").read_text().lower()
