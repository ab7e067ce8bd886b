"""The bench's page over a long campaign: how soon a trial is told, and what 4000 of them take."""

from __future__ import annotations

import csv
import http.client
import json
import shutil
import time
from pathlib import Path

import pytest
from tests.unit import small_run
from tests.unit.test_serve import PATIENCE_S, served

pytest.importorskip("starlette", reason="nearlift[serve] is not installed")
pytestmark = pytest.mark.calibration
TRIALS, LATE = 4000, 60


def grown(root: Path, count: int) -> list[Path]:
    """A campaign of so many trials, each with a record of its own; their paths."""
    small_run.write(root, visits=2)
    schedule = root / "trials.csv"
    head, *rows = list(csv.reader(schedule.read_text().splitlines()))
    records = [root / "trials" / f"{row[0]}.csv" for row in rows]
    texts = [path.read_text() for path in records]
    start = head.index("start")
    made = []
    with schedule.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(head)
        for i in range(count):
            row = list(rows[i % len(rows)])
            row[0], row[start] = f"n{i:05d}", str(20 * i)
            writer.writerow(row)
            made.append(root / "trials" / f"n{i:05d}.csv")
            made[-1].write_text(texts[i % len(rows)] + f"{250 + 1e-3 * i:.4f}\n")
    for path in records:
        path.unlink()
    return made


def resident_MB(pid: int) -> float:
    """Memory that a process has."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024


def test_a_trial_is_told_soon_and_thousands_take_little(tmp_path, capsys):
    work = tmp_path / "work"
    paths = grown(work / "raw" / "small", TRIALS)
    late = [Path(shutil.move(p, tmp_path / p.name)) for p in paths[-LATE:]]
    with served(work) as own:
        own.enter()
        line = http.client.HTTPConnection("127.0.0.1", own.port, timeout=PATIENCE_S)
        told = {"Host": own.host, "Cookie": own.cookie}
        line.request("GET", "/events/live?campaign=raw/small", headers=told)
        answer = line.getresponse()

        def landed():
            while not (text := answer.readline()).startswith(b"data:"):
                assert text
            trials = json.loads(text[5:])["trials"]
            return {t["trial"] for t in trials if t["lift"] is not None}

        seen: set[str] = set()
        memory = {}
        while len(seen) < TRIALS - LATE:
            seen |= landed()
            memory.setdefault(len(seen) // 1000, resident_MB(own.process.pid))
        waits = []
        for path in late:
            begun = time.monotonic()
            shutil.move(path, paths[0].with_name(path.name))
            while path.stem not in (seen := seen | landed()):
                pass
            waits.append(time.monotonic() - begun)
        last = resident_MB(own.process.pid)
        answer.close()
        line.close()
    waits.sort()
    with capsys.disabled():
        print(
            f"\nlatency of {LATE} trials beside {TRIALS - LATE}: median {waits[LATE // 2]:.2f} s,"
        )
        print(f"longest {waits[-1]:.2f} s; memory {memory}, at the end {last:.0f} MB")
    assert len(seen) == TRIALS
    # a row of a trial is a few hundred bytes; a record kept would be ten thousand
    assert last - memory[1] < 3000 * 5e-3
