"""A campaign that is being recorded, as its page has it: each trial as stage ingest reduces it,
whatever state its record is in.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import time

import numpy as np
import pytest

from nearlift.products import TRIALS
from nearlift.run import graph
from nearlift.serve import pages
from nearlift.serve.answers import PageQuery
from nearlift.serve.bench import ServedWorkspace
from nearlift.serve.live import Live, looked, looks
from nearlift.stages.asked import ROUNDS

from . import small_run

pytest.importorskip("starlette", reason="nearlift[serve] is not installed")


@pytest.fixture
def bench(tmp_path):
    small_run.write(tmp_path / "raw" / "small", visits=2)
    return ServedWorkspace(tmp_path)


def everything(live: Live) -> dict:
    """Look until nothing is new; all trials by id."""
    turn = None
    while turn != (live.epoch, live.turn):
        turn = live.epoch, live.turn
        live._next = 0.0
        live.look()
    return {t["trial"]: t for t in live.since(-1, -1)[0]["trials"]}


def test_every_trial_is_as_ingest_has_it(bench, tmp_path):
    place = bench.campaign("raw/small")
    found = everything(Live(place))
    job = small_run.job(place.root, tmp_path)
    list(graph.run(job, graph.STAGES[:1]))
    table = job.read(TRIALS)
    assert found.keys() == set(table["trial"].tolist())
    for i, trial in enumerate(table["trial"].tolist()):
        assert found[trial]["lift"] == float(f"{table['lift_N'][i]:.7g}")
        assert set(found[trial]["codes"]) <= set(table["quality"][i].split())


def test_a_record_is_there_once_it_has_landed_and_only_that_is_told(bench, tmp_path):
    place = bench.campaign("raw/small")
    record = sorted((place.root / "trials").iterdir())[5]
    shutil.move(record, tmp_path / record.name)
    live = Live(place)
    assert everything(live).keys().isdisjoint({record.stem})
    epoch, turn = live.epoch, live.turn
    shutil.move(tmp_path / record.name, record)
    everything(live)
    told, *_ = live.since(epoch, turn)
    assert [t["trial"] for t in told["trials"]] == [record.stem]
    assert not told["fresh"]


def test_a_record_that_is_taken_away_is_told_no_more(bench, tmp_path):
    place = bench.campaign("raw/small")
    live = Live(place)
    whole = everything(live)
    record = sorted((place.root / "trials").iterdir())[5]
    shutil.move(record, tmp_path / record.name)
    assert whole.keys() - everything(live).keys() == {record.stem}
    shutil.move(tmp_path / record.name, record)
    assert everything(live).keys() == whole.keys()


def test_a_glitch_in_the_tare_is_called_out(bench):
    place = bench.campaign("raw/small")
    record = sorted((place.root / "trials").iterdir())[3]
    head, *lines = record.read_text().splitlines()
    cells = [line.split(",") for line in lines]
    force = head.split(",").index("force_mN") if "force_mN" in head else len(cells[0]) - 1
    for row in cells[10:30]:
        row[force] = str(float(row[force]) + 400.0)
    record.write_text("\n".join([head, *(",".join(c) for c in cells)]) + "\n")
    found = everything(Live(place))[record.stem]
    assert "TARE" in found["codes"]
    assert "the force changes within the tare" in found["said"]


def test_what_is_still_being_written_is_pending_and_read_again(bench):
    place = bench.campaign("raw/small")
    record = sorted((place.root / "trials").iterdir())[0]
    whole = record.read_bytes()
    record.write_bytes(whole[: len(whole) // 2 - 3])
    live = Live(place)
    assert "PENDING" in everything(live)[record.stem]["codes"]
    record.write_bytes(whole)
    os.utime(record, ns=(time.time_ns(), time.time_ns() + 1000))
    assert "PENDING" not in everything(live)[record.stem]["codes"]


def test_a_manifest_half_saved_is_refused_until_it_is_mended(bench):
    place = bench.campaign("raw/small")
    manifest = place.root / "campaign.toml"
    whole = manifest.read_text()
    manifest.write_text(whole[: len(whole) // 2] + "= =")
    live = Live(place)
    everything(live)
    assert "campaign.toml" in live.refusal
    manifest.write_text(whole)
    assert everything(live)
    assert live.refusal == ""


def test_before_the_first_look_nothing_is_claimed(bench):
    found = looked(bench.campaign("raw/small"))
    assert (found["verdicts"], found["suspects"], found["curves"]) == ([], [], {})


def test_what_to_measure_next_is_what_the_command_says(bench):
    bench.ask(["ingest", "raw/small"])
    # the share that goes round stands in the form, and in the command where it is another
    form = pages.live(bench, PageQuery.parsed("campaign=raw/small")).body.decode()
    assert f'value="{ROUNDS}"' in re.search('<input name="rounds"[^>]*>', form)[0]
    asked = PageQuery.parsed(f"campaign=raw/small&for=K_b&until=0.02&rounds={ROUNDS}")
    shown = json.loads(pages.upcoming(bench, asked).body)
    words = ["next", "raw/small", "--for=K_b", "--until=0.02"]
    assert shown.pop("command") == "nearlift next raw/small --for=K_b --until=0.02"
    assert shown == json.loads(bench.ask([*words, "--json"]))
    assert "more trials;" in " ".join(shown["boundaries"]["ground"]["text"])
    fewer = json.loads(
        pages.upcoming(bench, PageQuery.parsed("campaign=raw/small&for=K_b&until=&rounds=0.2")).body
    )
    assert fewer["command"] == "nearlift next raw/small --for=K_b --rounds=0.2"
    assert fewer["boundaries"]["ground"]["after"] < shown["boundaries"]["ground"]["after"]
    rows = pages.upcoming(
        bench, PageQuery.parsed("campaign=raw/small&for=K_b&as=csv")
    ).body.decode()
    assert rows == bench.ask(["next", "raw/small", "--for=K_b", "--csv"])
    refused = json.loads(pages.upcoming(bench, PageQuery.parsed("campaign=raw/small&for=K_x")).body)
    assert "no base model of this campaign has that coefficient" in refused["refusal"]


def test_looks_are_read_among_other_lines():
    lines = ["note", '{"words": "w", "refused": "", "good": 1, "scheduled": 2, "ran": []}', "{}"]
    assert list(looks(lines)) == [{"words": "w", "refused": "", "good": 1, "scheduled": 2}]


def test_a_throttle_has_the_level_of_its_farthest_trials(bench):
    live = Live(bench.campaign("raw/small"))
    trials = everything(live).values()
    far = live.since(-1, -1)[0]["far"]["ground"]
    for throttle, level in far.items():
        own = [t for t in trials if f"{t['throttle']:.6g}" == throttle]
        most = max(t["z"] for t in own)
        assert level == pytest.approx(
            np.median([t["lift"] for t in own if t["z"] == most]), rel=1e-6
        )
