"""Runs that are kept: one for each that found something else, whole or not at all, and the way
back to the manifest of an earlier one.
"""

from __future__ import annotations

import datetime
import json
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from nearlift.errors import ManifestError
from nearlift.run import graph, history, lock, store
from nearlift.run.transaction import Homes

from . import small_run
from .faulty import Faulty
from .small_run import nearlift
from .test_lock import HOLD

FITTED = ("ingest", "reduce", "fit")


def fitted(campaign: Path, out: Path) -> None:
    """Up to the fit, by one run of the graph."""
    told: list[str] = []
    job = small_run.job(campaign, out, announce=told.append)
    wanted = tuple(graph.stage(name) for name in FITTED)
    for _ in graph.run(job, wanted):
        pass
    assert told == []


def heavier(campaign: Path, grams: int) -> None:
    file = campaign / "campaign.toml"
    text = file.read_text()
    start = text.index('mass = "') + len('mass = "')
    file.write_text(text[:start] + str(grams) + text[text.index(" g", start) :])


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """A fitted campaign of means, which is not diagnosed."""
    folder = tmp_path_factory.mktemp("history")
    file = small_run.write_means(folder / "raw", 24) / "campaign.toml"
    file.write_text(file.read_text() + '[fit]\nsampler = "importance"\nground = { rivals = [] }\n')
    fitted(folder / "raw", folder)
    return folder


@pytest.fixture
def place(first, tmp_path):
    shutil.copytree(first, tmp_path, dirs_exist_ok=True)
    return tmp_path


@pytest.fixture
def two(place):
    """The same with a second run of another manifest: the folder, and the two manifests."""
    (run,) = kept(place)
    heavier(place / "raw", 30)
    manifest = (place / "raw" / "campaign.toml").read_bytes()
    with lock.locked(homes(place)):
        history.keep(homes(place), manifest, run.results)
    return place, run.manifest, manifest


def homes(place: Path) -> Homes:
    return Homes.within(place, "means")


def kept(place: Path) -> list[history.Kept]:
    return list(history.runs(homes(place)))


def undo(place: Path, *words: str) -> tuple[int, str]:
    told = nearlift("undo", place / "raw", "--out", place, *words)
    return told.exit_code, told.output


def test_a_run_keeps_what_it_was_asked_and_what_it_found(place):
    (run,) = kept(place)
    assert run.manifest == (place / "raw" / "campaign.toml").read_bytes()
    assert run.results == (homes(place).processed / "results.json").read_bytes()
    assert sorted(p.name for p in run.folder.iterdir()) == ["campaign.toml", "results.json"]
    assert json.loads(run.results)["boundaries"]["ground"]["verdict"] == "not_diagnosed"


def test_a_run_that_changed_nothing_makes_no_entry(place):
    before = small_run.state(homes(place).processed / "history")
    fitted(place / "raw", place)
    told = nearlift("fit", place / "raw", "--out", place, "--executor", "serial", "-q")
    assert told.exit_code == 0
    assert small_run.state(homes(place).processed / "history") == before


def test_stages_that_write_no_results_keep_nothing(place):
    heavier(place / "raw", 31)
    for stage in ("ingest", "reduce"):
        nearlift(stage, place / "raw", "--out", place, "-q")
    assert len(kept(place)) == 1


def test_a_run_killed_before_it_was_kept_is_kept_by_the_next(place):
    shutil.rmtree(homes(place).processed / "history")
    fitted(place / "raw", place)
    assert len(kept(place)) == 1


def test_a_manifest_changed_while_it_is_worked_on_is_not_taken_for_that_of_the_run(place):
    shutil.rmtree(homes(place).processed / "history")
    job = small_run.job(place / "raw", place)
    heavier(place / "raw", 31)
    assert list(graph.run(job, tuple(graph.stage(name) for name in FITTED)))
    assert kept(place) == []


def test_the_oldest_are_given_up(place, monkeypatch):
    monkeypatch.setattr(history, "MOST", 3)
    job = small_run.job(place / "raw", place)
    for name in "bcde":
        history.remember(job, name.encode(), wrote=True, alone=False)
    assert [run.manifest for run in kept(place)] == [b"e", b"d", b"c"]


def test_a_clock_that_was_set_back_changes_no_order(place, monkeypatch):
    class Early(datetime.datetime):
        @classmethod
        def now(cls, tz=None):
            return cls(2001, 1, 1, tzinfo=tz)

    monkeypatch.setattr(datetime, "datetime", Early)
    with lock.locked(homes(place)):
        history.keep(homes(place), b"later")
    assert kept(place)[0].manifest == b"later"


def test_a_campaign_that_grows_keeps_no_run_of_each_round(place):
    heavier(place / "raw", 30)
    job = small_run.job(place / "raw", place)
    assert list(graph.run(job, tuple(graph.stage(name) for name in FITTED), keep=False))
    assert len(kept(place)) == 1


@pytest.mark.parametrize("at", [1, 3, 5])
def test_a_full_disk_costs_the_entry_and_not_the_run(place, monkeypatch, at):
    told: list[str] = []
    job = small_run.job(place / "raw", place, announce=told.append)
    shutil.rmtree(homes(place).processed / "history")
    manifest = history.manifest_of(job)
    monkeypatch.setattr(store, "disk", Faulty(at, "lasting"))
    history.remember(job, manifest, wrote=True, alone=False)
    monkeypatch.undo()
    assert "this run is not in the history" in told[0]
    assert kept(place) == []
    # what was left half made is no run, and goes with the next
    history.remember(job, manifest, wrote=True, alone=False)
    assert [p.name for p in (homes(place).processed / "history").iterdir()] == [
        kept(place)[0].folder.name
    ]


def test_products_that_may_only_be_read_are_no_obstacle(place, monkeypatch):
    """As root no folder is read-only, so the refusal is made."""
    told: list[str] = []
    shutil.rmtree(homes(place).processed / "history")

    def refused(homes: Homes) -> None:
        raise PermissionError(13, "Permission denied", str(homes.processed))

    monkeypatch.setattr(history, "locked", refused)
    job = small_run.job(place / "raw", place, announce=told.append)
    assert list(graph.run(job, tuple(graph.stage(name) for name in FITTED)))
    assert told == []
    found = nearlift("history", place / "raw", "--out", place)
    assert (found.exit_code, found.output) == (0, "no run of means is kept yet\n")


def test_history_lists_each_run_with_its_headline(two):
    place, _, _ = two
    told = nearlift("history", place / "raw", "--out", place)
    assert told.exit_code == 0
    newest, oldest = told.output.splitlines()
    assert "ground K_b = " in newest
    assert "not diagnosed  (the present manifest)" in newest
    # times are told to the second: both may be the same
    assert newest.split("Z")[0] >= oldest.split("Z")[0]
    assert "present" not in oldest
    content = json.loads(nearlift("history", place / "raw", "--out", place, "--json").output)
    assert [entry["present_manifest"] for entry in content] == [True, False]
    assert [entry["digest"] for entry in content] == [run.digest for run in kept(place)]


@pytest.mark.parametrize("file", ["campaign.toml", "results.json"])
def test_a_damaged_run_is_told_and_counts_for_nothing(two, file):
    place, _, second = two
    last, before = kept(place)
    content = bytearray((before.folder / file).read_bytes())
    content[40] ^= 1
    (before.folder / file).write_bytes(content)
    told = nearlift("history", place / "raw", "--out", place)
    assert f"{before.folder.name}  damaged" in told.output
    assert kept(place) == [last]
    code, words = undo(place)
    assert code == 2
    assert "no run with another manifest is kept" in words
    assert undo(place, "--to", before.digest)[0] == 2
    assert (place / "raw" / "campaign.toml").read_bytes() == second


def test_what_is_no_run_is_not_listed(place):
    home = homes(place).processed / "history"
    (home / "notes-of-mine").mkdir()
    (home / "20261399T000000.000Z-0123456789ab").mkdir()
    told = nearlift("history", place / "raw", "--out", place)
    assert told.exit_code == 0
    assert "notes" not in told.output
    assert "20261399T000000.000Z-0123456789ab  damaged" in told.output


def test_results_of_another_version_are_said_to_be_so(place):
    (run,) = kept(place)
    other = run.results.replace(b"nearlift.results/1", b"nearlift.results/9")
    with lock.locked(homes(place)):
        history.keep(homes(place), run.manifest, other)
    told = nearlift("history", place / "raw", "--out", place)
    assert "results.json has schema nearlift.results/9" in told.output


def test_undo_brings_the_last_manifest_back_and_then_the_other(two):
    place, one, second = two
    file = place / "raw" / "campaign.toml"
    file.chmod(0o640)
    results = (homes(place).processed / "results.json").read_bytes()
    code, words = undo(place)
    assert code == 0
    assert file.read_bytes() == one
    assert stat.S_IMODE(file.stat().st_mode) == 0o640
    assert "vehicle.mass: '30 g' -> '27 g'" in words
    assert "what stood there was kept before" in words
    assert f"`nearlift run {place / 'raw'}` makes them again" in words
    assert (homes(place).processed / "results.json").read_bytes() == results
    assert undo(place)[0] == 0
    assert file.read_bytes() == second
    told = nearlift("plan", place / "raw", "--out", place).output
    assert told.startswith("ingest   run: [vehicle] of the manifest has changed")
    assert len(kept(place)) == 2


def test_undo_keeps_first_what_was_not_run(two):
    place, one, second = two
    file = place / "raw" / "campaign.toml"
    file.write_bytes(b"half a manifest [")
    # its name is gone, and with it the way to its products
    with pytest.raises(ManifestError, match="names no campaign"):
        history.undo(place / "raw", place)
    file.write_bytes(broken := b'name = "means"\n[half a manifest')
    done = history.undo(place / "raw", place)
    assert file.read_bytes() == second
    assert done.put_aside is not None
    assert done.put_aside.manifest == broken
    assert "put aside by undo, not run" in nearlift("history", place / "raw", "--out", place).output
    code, _ = undo(place)
    assert (code, file.read_bytes()) == (0, broken)
    assert json.loads(undo(place, "--to", kept(place)[-1].digest[:6], "--json")[1])["restored"]
    assert file.read_bytes() == one


def test_undo_follows_a_link(two):
    place, one, _ = two
    file = place / "raw" / "campaign.toml"
    file.rename(place / "elsewhere.toml")
    file.symlink_to(place / "elsewhere.toml")
    assert undo(place)[0] == 0
    assert file.is_symlink()
    assert (place / "elsewhere.toml").read_bytes() == one


def test_undo_to_a_run_that_is_not_there_lists_those_that_are(two):
    place, _, second = two
    code, words = undo(place, "--to", "zz")
    assert code == 2
    assert "'zz' begins the digest of no whole run" in words
    assert all(run.digest in words for run in kept(place))
    assert (place / "raw" / "campaign.toml").read_bytes() == second


def test_without_a_kept_run_undo_says_when_there_will_be_one(tmp_path):
    small_run.write_means(tmp_path / "raw", 24)
    code, words = undo(tmp_path)
    assert code == 2
    assert "every run that finds something new is kept from now on" in words
    assert not (tmp_path / "processed").exists()


def test_undo_waits_for_no_run_that_is_at_work(two):
    place, _, second = two
    words = [sys.executable, "-c", HOLD, str(homes(place).processed)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        try:
            assert other.stdout.readline() == "held\n"
            code, told = undo(place)
            assert code == 4
            assert "another run works on these products" in told
            assert (place / "raw" / "campaign.toml").read_bytes() == second
            assert nearlift("history", place / "raw", "--out", place).exit_code == 0
        finally:
            other.kill()


def test_a_manifest_that_cannot_be_written_stays_and_is_kept(two, monkeypatch):
    place, _, _ = two
    file = place / "raw" / "campaign.toml"
    file.write_bytes(file.read_bytes() + b"# mine\n")
    mine, real = file.read_bytes(), store.write_bytes

    def refuse(path: Path, content: bytes) -> None:
        if path.parent == place / "raw":
            raise PermissionError(13, "Permission denied", str(path))
        real(path, content)

    monkeypatch.setattr(store, "write_bytes", refuse)
    code, words = undo(place)
    assert code == 4
    assert "permission denied" in words
    assert file.read_bytes() == mine
    assert any(run.manifest == mine for run in kept(place))


def test_changes_are_told_by_key_and_comments_do_not_count():
    old = b'a = 1 # one\n[b]\nc = ["x", "y"]\n'
    new = b'[b]\nc = ["x", "z"]\nd = true\n'
    assert history.changes(old, new) == (
        ("a", "1", None),
        ("b.c.1", "'y'", "'z'"),
        ("b.d", None, "True"),
    )
    assert history.changes(old, b"# nothing else\n" + old) == ()
    assert history.changes(old, b"a = \n[b]")[0] == ("line 0", "a = 1 # one", "a = ")


@pytest.mark.parametrize("name", ["..", ".hidden", "a/b", ""])
def test_a_name_that_leads_elsewhere_is_none(tmp_path, name):
    file = tmp_path / "campaign.toml"
    file.write_text(f'name = "{name}"\n')
    with pytest.raises(ManifestError, match="names no campaign"):
        history.name_of(file)
    file.write_text('name = "rig-2.1"\n')
    assert history.name_of(file) == "rig-2.1"
