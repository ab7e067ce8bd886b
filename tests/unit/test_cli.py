"""The command line: exit codes, one JSON object, help, and nothing written that was not asked for."""

from __future__ import annotations

import errno
import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from nearlift.campaign import manifest as manifests
from nearlift.cli import main
from nearlift.errors import ManifestError
from nearlift.run import engine
from nearlift.stages import STAGES
from nearlift.terminal import COMMON, HEADINGS

from . import small_run, written
from .small_run import nearlift, state

#: Stages of a campaign whose manifest has no section for the others.
ALWAYS = [s.name for s in STAGES if not s.where]
LEDGER, CACHE = (f"processed/small/{name}" for name in ("provenance.json", "inputs-cache.json"))


@pytest.fixture(scope="session")
def raw(small_campaign, tmp_path_factory) -> Path:
    return shutil.copytree(small_campaign / "raw", tmp_path_factory.mktemp("cli") / "raw")


@pytest.fixture(scope="session")
def finished(small_campaign, tmp_path_factory) -> Path:
    """A folder with the products of a run."""
    out = tmp_path_factory.mktemp("cli-out")
    for folder in ("processed", "reports"):
        shutil.copytree(small_campaign / folder, out / folder)
    return out


def digests(folder: Path) -> dict[str, str]:
    """Digest of every file, but of the ledger and the cache of digests."""
    return {n: sha for n, (sha, _) in state(folder).items() if n not in (LEDGER, CACHE)}


# ---- runs


@pytest.mark.usefixtures("plain_pictures")
def test_two_fresh_runs_give_the_same_bytes_and_leave_raw_alone(raw, finished, tmp_path):
    """Another folder, time and executor; in provenance.json only wall times differ."""
    before, folders = state(raw), {p: p.stat().st_mtime_ns for p in (raw, raw / "trials")}
    assert nearlift("run", raw, "--out", tmp_path, "--executor", "threads:2").exit_code == 0
    assert digests(tmp_path) == digests(finished)
    ledgers = [json.loads((folder / LEDGER).read_text()) for folder in (finished, tmp_path)]
    for ledger in ledgers:
        for stage in ledger["stages"].values():
            assert stage.pop("wall_s") > 0
    assert ledgers[0] == ledgers[1]
    assert nearlift("run", "--check", raw, "--out", tmp_path).exit_code == 0
    assert state(raw) == before
    assert {p: p.stat().st_mtime_ns for p in folders} == folders


def test_a_second_run_does_nothing(raw, finished):
    before = state(finished)
    answer = nearlift("run", raw, "--out", finished)
    assert answer.exit_code == 0
    assert re.findall(r"^(\w+) +up to date$", answer.stderr, re.M) == ALWAYS
    assert answer.stdout == f"{finished}/reports/small/index.html\n"
    summary = (finished / "reports/small/summary.txt").read_text()
    assert "[[Ground]] " in summary
    assert answer.stderr.endswith(f"\n{summary}\nunchanged since the last run\n")
    after = state(finished)
    assert {n for n in after if after[n] != before.get(n)} <= {CACHE}


def test_a_run_says_what_changed_since_the_last_one(finished, tmp_path):
    out = shutil.copytree(finished, tmp_path / "out")
    root = small_run.write(tmp_path / "raw", visits=2)
    answer = nearlift("ingest", root, "--out", out)
    assert (
        "changed since the last run:\n  trials: 56 of 56 accepted (was 112 of 112 accepted)\n"
        in (answer.stderr)
    )


@pytest.mark.parametrize("where", ["nothing", "finished", "stale"])
def test_a_dry_run_runs_nothing_and_writes_nothing(raw, finished, tmp_path, monkeypatch, where):
    out, root = tmp_path / "out", shutil.copytree(raw, tmp_path / "raw")
    if where != "nothing":
        shutil.copytree(finished, out)
    if where == "stale":
        (root / "trials.csv").write_text((root / "trials.csv").read_text() + "\n")
    before = state(tmp_path)
    monkeypatch.setattr(engine, "run", lambda *_: pytest.fail("a stage ran"))
    answer = nearlift("run", "--dry-run", root, "--out", out)
    assert answer.exit_code == 0
    after = state(tmp_path)
    assert before.keys() <= after.keys()
    assert {n for n in after if after[n] != before.get(n)} <= {f"out/{CACHE}"}
    assert out.exists() == (where != "nothing")
    expected = {
        "nothing": "run: has not run yet",
        "finished": "up to date",
        "stale": "run: trials.csv has changed",
    }[where]
    assert answer.stdout.splitlines()[0] == f"ingest   {expected}"
    assert len(answer.stdout.splitlines()) == len(ALWAYS)


def test_one_stage_runs_even_if_it_is_up_to_date_and_makes_the_same(raw, finished, tmp_path):
    out = shutil.copytree(finished, tmp_path / "out")
    answer = nearlift("run", "--only", "fit", raw, "--out", out)
    assert "fit      fit lift models by least squares, with posteriors (asked for)" in answer.stderr
    assert re.search(r"  ground: K_b = .*, not diagnosed \(was K_b = .*, adequate\)", answer.stderr)
    # what is quoted is the fit's, until it is diagnosed again
    assert nearlift("diagnose", raw, "--out", out).exit_code == 0
    assert digests(out) == digests(finished)


# ---- exit codes


def test_2_for_a_bad_manifest_which_writes_nothing(raw, tmp_path):
    root = shutil.copytree(raw, tmp_path / "raw")
    text = (root / "campaign.toml").read_text()
    text = text.replace('rotor_radius  = "23 mm"', "rotor_radius = 23").replace("[rig]", "[rigg]")
    (root / "campaign.toml").write_text(text)
    for words in ("run", "ingest", "run --dry-run", "run --check"):
        answer = nearlift(*words.split(), root, "--out", tmp_path / "out")
        assert answer.exit_code == 2
        assert "vehicle.rotor_radius" in answer.stderr
        assert "did you mean 'rig'?" in answer.stderr
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("run {raw} --executor gpu", "'gpu' is not an executor"),
        ("run {raw}/nowhere", "holds no campaign.toml\n  `nearlift new DIR` writes one to fill in"),
        ("describe sanches_cuevas", "sanchez_cuevas"),
        ("run", "Missing argument 'CAMPAIGN...'"),
        ("run {raw} --only plan", "Invalid value for '--only'"),
        ("run {raw} --check --dry-run", "was given with --"),
        ("run {raw} --only fit --watch", "--only: was given with --watch"),
        ("fly {raw}", "No such command 'fly'"),
        ("explian x", "No such command 'explian': did you mean 'explain'?"),
        ("run {raw} --seed x", "'x' is not a valid integer"),
        ("new {raw}", "is not empty\n  name a new folder; nothing is ever overwritten"),
        ("new {raw}/campaign.toml", "is a file\n  name a new folder"),
    ],
)
def test_2_for_usage(raw, tmp_path, monkeypatch, words, text):
    monkeypatch.chdir(tmp_path)
    answer = nearlift(*words.format(raw=raw).split())
    assert answer.exit_code == 2
    assert text in answer.stderr
    assert not [*tmp_path.iterdir()]


def test_3_for_rejected_trials_each_with_its_reason_now_and_later(tmp_path):
    root, out = small_run.write(tmp_path / "raw"), tmp_path / "out"
    lost = sorted((root / "trials").glob("*.csv"))[:12]
    for path in lost:
        path.unlink()
    short, long = (nearlift("ingest", root, "--out", out, *flag) for flag in ((), ("-v",)))
    assert short.exit_code == long.exit_code == 3
    assert "12 trials rejected:" in short.stderr
    assert "  ... and 2 more (-v lists all)" in short.stderr
    assert len(re.findall(r"^  t\d+: MISSING", short.stderr, re.M)) == 10
    assert len(re.findall(r"^  t\d+: MISSING", long.stderr, re.M)) == 12
    answer = json.loads(nearlift("ingest", root, "--out", out, "--json").stdout)
    assert answer["exit_code"] == 3
    assert [t for t, _ in answer["stages"][0]["rejected"]] == [path.stem for path in lost]


def test_4_for_records_that_are_not_there_and_a_stage_before_its_time(raw, tmp_path):
    root = shutil.copytree(raw, tmp_path / "raw")
    shutil.rmtree(root / "trials")
    answer = nearlift("run", root, "--out", tmp_path / "out")
    assert answer.exit_code == 4
    assert re.search(r"none of the 112 trials has a record|no file", answer.stderr)
    left = {"processed/small/.lock", "processed/small/inputs-cache.json"}
    assert not {*state(tmp_path / "out")} - left
    # the manifest is taken for its folder
    answer = nearlift("fit", raw / "campaign.toml", "--out", tmp_path)
    assert answer.exit_code == 4
    assert "trials.parquet: is missing\n  run the stage that writes it" in answer.stderr


def test_4_for_an_output_folder_that_cannot_be_written(raw, tmp_path):
    (tmp_path / "processed").write_text("in the way")
    answer = nearlift("run", raw, "--out", tmp_path)
    assert answer.exit_code == 4
    assert re.search(r"error: .*processed.*: .*\n  check that it exists", answer.stderr)


def test_5_for_a_base_model_that_cannot_be_fitted(tmp_path):
    root = small_run.write_means(tmp_path / "raw", rows=6)
    answer = nearlift("run", root, "--out", tmp_path)
    assert answer.exit_code == 5
    refusal = "error: fit of sanchez_cuevas: 6 usable trials for 5 unknowns\n  at least 7 trials"
    assert refusal in answer.stderr
    assert (tmp_path / "processed/means/lift.parquet").is_file()
    assert not (tmp_path / "processed/means/fit.json").exists()


def test_130_for_an_interrupt_after_which_the_same_command_goes_on(tmp_path, monkeypatch):
    raw = small_run.write_means(tmp_path / "raw", 24, quick=True)

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("nearlift.fit.models.fit_boundary", interrupted)
        answer = nearlift("run", raw, "--out", tmp_path, "--json")
    assert answer.exit_code == 130
    assert (
        "interrupted\n  finished products remain, and the same command continues" in answer.stderr
    )
    assert json.loads(answer.stdout)["exit_code"] == 130
    plan = nearlift("run", "--dry-run", raw, "--out", tmp_path).stdout.splitlines()
    assert [line.split()[0] for line in plan if "up to date" in line] == ["ingest", "reduce"]
    # a defect is no refusal
    monkeypatch.setattr("nearlift.fit.models.fit_boundary", lambda *_, **__: 1 / 0)
    assert isinstance(nearlift("fit", raw, "--out", tmp_path).exception, ZeroDivisionError)


@pytest.mark.parametrize("end", ["2>&-", "2>/dev/full"])
def test_a_stderr_that_is_closed_or_full_is_no_failure(raw, tmp_path, end):
    if "full" in end and not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    words = [sys.executable, "-P", "-c", "from nearlift.cli import main; main()"]
    command = shlex.join([*words, "ingest", str(raw), "--out", str(tmp_path)])
    assert subprocess.run(f"exec {command} {end}", shell=True, check=False).returncode == 0
    assert (tmp_path / "processed/small/trials.parquet").is_file()


def test_a_closed_pipe_is_no_refusal(monkeypatch):
    """`nearlift describe | head` ends quietly."""

    def closed(_):
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    monkeypatch.setattr("nearlift.describe.describe", closed)
    answer = nearlift("describe")
    assert (answer.exit_code, answer.output) == (1, "")


# ---- JSON, quiet


@pytest.mark.parametrize(
    ("words", "code", "keys"),
    [
        ("run {raw} --out {finished}", 0, {"campaign", "exit_code", "report", "stages"}),
        ("run --dry-run {raw} --out {finished}", 0, {"campaign", "stages"}),
        ("run --check {raw} --out {finished}", 0, {"campaign", "checked", "differing"}),
        ("run --check {raw} {raw} --out {finished}", 0, {"campaigns"}),
        ("inspect {raw}/trials.csv {raw}/trials.csv", 0, {"files"}),
        ("describe K_b", 0, {"name", "text"}),
        ("new {new}", 0, {"written", "fill_in", "notes"}),
        ("new {raw}", 2, {"exit_code", "where", "what", "remedy"}),
    ],
)
def test_json_is_one_object_and_quiet_is_quiet(raw, finished, tmp_path, words, code, keys):
    def called(name: str) -> list[str]:
        return words.format(raw=raw, finished=finished, new=tmp_path / name).split()

    answer = nearlift(*called("new"), "--json")
    content = json.loads(answer.stdout)
    assert (answer.exit_code, content.keys()) == (code, keys)
    assert content.get("exit_code", 0) == code
    if code == 0:
        assert answer.stderr == ""
        quiet = nearlift(*called("other"), "-q")
        assert (quiet.exit_code, quiet.output) == (0, "")


# ---- new


def test_new_makes_a_folder_that_runs_once_it_is_filled_in(tmp_path):
    folder = tmp_path / "My Rig_é"
    answer = nearlift("new", folder)
    assert answer.exit_code == 0
    lines = answer.stdout.splitlines()
    made = {Path(line).name for line in lines[: lines.index("still to fill in:")]}
    assert made == {"campaign.toml", "trials.csv", "trials"}
    # nothing physical has a default: all of it is listed at once, here and when it is run
    text = (folder / "campaign.toml").read_text()
    blank = [x for line in text.splitlines() if "FILL IN" in (x := line.partition("#")[0])]
    assert len(blank) == 15
    assert all(f": {line.strip()}" in answer.stdout for line in blank)
    with pytest.raises(ManifestError) as refused:
        manifests.load(folder)
    assert str(refused.value).count("is still to be filled in") == len(blank) + 1
    given = {"sample_rate": '"1000 Hz"', "tare": '"2 s"', "distance": '"mm"'}
    text = written.fill_in(folder, throttle='"percent"', **given)
    known = manifests.load(folder)
    assert (known.name, known.vehicle.rotor_spacing) == ("my-rig-e", 0.065)
    # the commented budget parses too
    for old, new in (("# [[", "[["), ("FILL IN percent", "0.5 percent"), ("FILL IN mm", "0.2 mm")):
        text = text.replace(old, new)
    (folder / "campaign.toml").write_text(re.sub(r"(?m)^# (name|on|value|scope)\b", r"\1", text))
    assert 2e-4 in [u.standard() for u in manifests.load(folder).uncertainty]
    # an empty schedule is refused, not crashed on
    assert nearlift("run", "--dry-run", folder, "--out", tmp_path).exit_code in (2, 4)


# ---- help


def commands() -> dict[str, click.Command]:
    """Every command by its whole name."""
    inner = {f"data {name}": command for name, command in main.commands["data"].commands.items()}
    return main.commands | inner


def helped(*words: str) -> str:
    return CliRunner(env={"COLUMNS": "80"}).invoke(main, [*words, "--help"]).stdout


def test_every_command_has_a_summary_and_a_page_with_an_example_and_the_contract_s_options():
    listed = helped()
    assert max(map(len, listed.splitlines())) <= 80
    assert [line[:-1] for line in listed.splitlines() if line[:-1] in HEADINGS] == list(HEADINGS)
    for name, made in commands().items():
        page, summary = helped(*name.split()), made.help.split("\n")[0]
        if name in main.commands:
            assert re.search(rf"^  {name} +{re.escape(summary.rstrip('.'))}$", listed, re.M), name
        assert summary in " ".join(page.split())
        calls = page.split("For example:")[1].strip().splitlines()
        assert calls, name
        for line in calls:
            context = click.Context(main, **main.context_settings)
            words, command = shlex.split(line)[1:], main
            while isinstance(command, click.Group):
                _, command, words = command.resolve_command(context, words)
            command.make_context(command.name, words, parent=context)
            assert {*COMMON} <= {*command.params}


def test_click_completes_commands_and_options():
    for words, completed in (
        ("nearlift expl", "plain,explain"),
        ("nearlift run --dr", "--dry-run"),
    ):
        count = str(words.count(" "))
        env = {"_NEARLIFT_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": count}
        assert completed in CliRunner().invoke(main, env=env, prog_name="nearlift").stdout
