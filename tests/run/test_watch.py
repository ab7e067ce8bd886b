"""`nearlift run --watch`: trials that land are taken up; what must wait, waits; Ctrl-C ends it."""

from __future__ import annotations

import contextlib
import functools
import json
import os
import shutil
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.unit import small_run

from nearlift.campaign import manifest as manifests
from nearlift.errors import ManifestError
from nearlift.planning.question import VisitQuestion
from nearlift.run import engine
from nearlift.run import watch as watching
from nearlift.run.watch import Round, watch
from nearlift.stages import STAGES, looks

FIRST = STAGES[:2]
PERIOD_S = 0.05


def old(path: Path) -> Path:
    """As if written an hour ago."""
    os.utime(path, (time.time() - 3600,) * 2)
    return path


@pytest.fixture
def recording(tmp_path) -> tuple[Path, list[Path]]:
    """A campaign of which 84 records are there, and the 28 that are still to come."""
    raw = small_run.write(tmp_path / "raw", visits=4)
    records = sorted((raw / "trials").iterdir())
    for path in records:
        old(path)
    return raw, [Path(shutil.move(path, tmp_path / path.name)) for path in records[84:]]


def watching_of(raw, stages=FIRST, asked=None, period_s=PERIOD_S):
    look = functools.partial(looks.look, asked)
    return watch(raw, raw.parent / "out", stages, "serial", 0, look, period_s)


def until(rounds, wanted, limit_s: float = 60.0) -> list[Round]:
    """Rounds up to the first that is wanted."""
    seen = []
    end = time.monotonic() + limit_s
    for round_ in rounds:
        seen.append(round_)
        if wanted(round_):
            return seen
        assert time.monotonic() < end, seen
    raise AssertionError("a watch has no end")


def until_good(rounds, count) -> list[Round]:
    return until(rounds, lambda one: one.good == count)


def same_as_unwatched(raw, stages, *names) -> None:
    """The same products as of a campaign that nobody watched."""
    plain = small_run.job(raw, raw.parent / "plain")
    list(engine.run(plain, stages))
    for name in names:
        watched = raw.parent / "out/processed/small" / name
        assert (plain.processed / name).read_bytes() == watched.read_bytes()


def test_the_next_visits_are_said_after_each_look(recording):
    raw, late = recording
    rounds = watching_of(raw, asked=VisitQuestion.parsed("K_b", until=0.05))
    places, stop = next(rounds).next
    assert places.startswith("next at the ground: ")
    assert places.count(" mm") == 10
    before = int(stop.partition("about ")[2].split(" more")[0])
    for path in late:
        shutil.copy2(path, raw / "trials" / path.name)
    _, stop = until_good(rounds, 112)[-1].next
    # 28 trials on, and the fewer to come
    assert int(stop.partition("about ")[2].split(" more")[0]) < before


def test_trials_are_taken_up_as_they_land(recording):
    raw, late = recording

    def drop() -> None:
        for path in late:
            time.sleep(0.02)
            part = raw / "trials" / f".{path.name}.part"
            shutil.copy2(path, part)
            part.rename(raw / "trials" / path.name)

    rounds = watching_of(raw)
    assert next(rounds).words == "trials 84 of 112 accepted"
    hand = threading.Thread(target=drop)
    hand.start()
    seen = until_good(rounds, 112)
    hand.join()
    assert [one.good for one in seen] == sorted(one.good for one in seen)
    assert seen[-1].ran == ("ingest", "reduce")
    same_as_unwatched(raw, FIRST, "trials.parquet", "lift.parquet")


def test_a_record_still_being_written_is_read_again_though_nothing_changes(recording):
    raw, late = recording
    rounds = watching_of(raw)
    next(rounds)
    text = late[0].read_bytes()
    landing = raw / "trials" / late[0].name
    landing.write_bytes(text[: len(text) // 2])
    until_good(rounds, 84)
    landing.write_bytes(text)
    assert until_good(rounds, 85)[-1].refused == ""


def test_a_schedule_half_saved_waits_for_the_rest(recording):
    raw, _ = recording
    rounds = watching_of(raw)
    next(rounds)
    schedule = (raw / "trials.csv").read_text()
    (raw / "trials.csv").write_text(schedule[: schedule.rindex(",ground,") + 3])
    half = next(rounds)
    assert half.words.startswith("waiting: ")
    assert "trials.csv" in half.refused
    (raw / "trials.csv").write_text(schedule)
    (raw / "trials" / "of-nobody.csv").write_text("makes the folder another one")
    assert until(rounds, lambda one: not one.refused)[-1].good == 84


def test_nothing_new_is_no_round(recording, monkeypatch):
    raw, _ = recording
    slept = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        if len(slept) == 5:
            raise KeyboardInterrupt

    monkeypatch.setattr(watching.time, "sleep", sleep)
    rounds = watching_of(raw, period_s=7.0)
    next(rounds)
    with pytest.raises(KeyboardInterrupt):
        next(rounds)
    assert slept == [7.0] * 5


def test_a_manifest_that_is_refused_is_not_waited_for(tmp_path):
    with pytest.raises(ManifestError, match=r"holds no campaign\.toml"):
        next(watching_of(tmp_path))


def test_ctrl_c_ends_it_with_130_and_products_stand(recording, tmp_path, monkeypatch):
    raw, _ = recording

    def interrupted(seconds: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(watching.time, "sleep", interrupted)
    monkeypatch.setattr("nearlift.cli.STAGES", FIRST)
    found = small_run.nearlift(
        "run", raw, "--watch", "--every", "1", "--out", tmp_path, "--json", "--executor", "serial"
    )
    assert found.exit_code == 130
    lines = [json.loads(line) for line in found.stdout.splitlines()]
    assert lines[0]["good"] == 84
    assert lines[-1]["exit_code"] == 130
    assert (tmp_path / "processed/small/lift.parquet").is_file()


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["{raw}", "--watch"], "was given 2 campaigns"),
        (["--next", "K_b"], "--next needs --watch"),
        (["--until", "0.05"], "--until needs --next"),
        (["--watch", "--until", "0.05"], "--until needs --next"),
    ],
)
def test_a_question_is_for_who_watches_one_campaign(tmp_path, words, text):
    raw = small_run.write_means(tmp_path / "raw", 24)
    refused = small_run.nearlift("run", raw, *(word.format(raw=raw) for word in words))
    assert refused.exit_code == 2
    assert text in refused.output.replace(": ", " ")


def test_looks_are_paid_for_until_the_last_trial_is_in(recording):
    raw, late = recording
    rounds = watching_of(raw, STAGES[:5])
    product = raw.parent / "out/processed/small/diagnosis.json"
    words = next(rounds).words
    assert "; ground K_b = " in words
    claims = "claims need p < 0.001, and p < 0.05 once all are measured"
    assert f", adequate (a look at 84 of 112 trials; {claims})" in words
    assert json.loads(product.read_text())["boundaries"]["ground"]["look"]["scheduled"] == 112
    for path in late:
        shutil.copy2(path, raw / "trials" / path.name)
    assert until_good(rounds, 112)[-1].words.endswith(", adequate")
    same_as_unwatched(raw, STAGES[:5], "diagnosis.json")


def test_a_schedule_that_grows_is_told_to_say_how_long_it_will_be(tmp_path, monkeypatch):
    """With no trial to come each look is the end; only the manifest can say otherwise."""
    stamps = iter(range(9))
    monkeypatch.setattr(manifests, "load", lambda root: SimpleNamespace(name="grows"))
    monkeypatch.setattr(watching, "_stamps", lambda root: next(stamps))
    step = engine.Step(stage=STAGES[0], why="asked for", outcome=engine.Outcome())
    monkeypatch.setattr(engine, "open_job", lambda *_, **__: contextlib.nullcontext())
    monkeypatch.setattr(engine, "run", lambda job: [step])
    for planned in (False, True):
        rounds = iter(Round(scheduled=n, planned=planned, words="so far") for n in (80, 80, 96))
        seen = watch(
            tmp_path, tmp_path, (), "serial", 0, lambda *_, rounds=rounds: next(rounds), 0.0
        )
        words = [next(seen).words for _ in range(3)]
        assert words[:2] == ["so far", "so far"]
        assert words[2] == ("so far" if planned else f"so far; {watching.GROWS}")
