"""One run at a time, and room for it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from nearlift.run import lock, store
from nearlift.run.lock import Busy, NoRoom, locked, require_free_space, size
from nearlift.run.transaction import Homes

HOLD = """
import sys, time
from pathlib import Path
from nearlift.run.lock import locked
from nearlift.run.transaction import Homes
with locked(Homes(processed=Path(sys.argv[1]), reports=Path("r"))):
    print("held", flush=True)
    time.sleep(60)
"""


def homes(place: Path) -> Homes:
    return Homes(processed=place / "p", reports=place / "r")


@pytest.fixture
def holder(tmp_path):
    """Another process that holds the lock."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path / "p")], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


def test_a_second_run_is_refused_and_told_whose_lock_it_is(tmp_path, holder):
    with (
        pytest.raises(
            Busy,
            match=(
                rf"another run works on these products: process {holder.pid} on .*, since"
                r" 20\d\d-.*\n  wait until it is done"
            ),
        ) as fault,
        locked(homes(tmp_path)),
    ):
        pass
    assert fault.value.exit_code == 4


def test_a_lock_of_a_killed_run_is_taken_over_and_its_litter_swept(tmp_path, holder):
    (tmp_path / "r").mkdir()
    strays = [tmp_path / "p" / ".fit.json.1.tmp", tmp_path / "r" / ".fig2.pdf.1.tmp"]
    for stray in strays:
        stray.write_text("half")
    (tmp_path / "p" / "fit.json").write_text("whole")
    holder.kill()
    holder.wait()
    with locked(homes(tmp_path)) as told:
        assert told.startswith(f"an earlier run was killed: process {holder.pid} on ")
        assert not any(stray.exists() for stray in strays)
        assert json.loads((tmp_path / "p" / lock.LOCK).read_text())["pid"] == os.getpid()
    assert [p.name for p in (tmp_path / "p").iterdir()] == ["fit.json"]


def test_what_others_left_is_not_swept_away(tmp_path):
    homes = Homes(processed=tmp_path / "p", reports=tmp_path / "r")
    elsewhere = tmp_path / "elsewhere"
    for folder in (elsewhere, homes.processed, homes.reports):
        folder.mkdir()
    kept = [
        elsewhere / ".fit.json.1.tmp",
        homes.processed / ".cache.tmp",
        homes.reports / "fig2.pdf.1.tmp",
    ]
    for path in kept:
        path.write_text("somebody's")
    (homes.processed / "link").symlink_to(elsewhere)
    (homes.reports / ".fig2.pdf.1.tmp").symlink_to(kept[0])
    with locked(homes):
        assert all(path.exists() for path in kept)


def test_what_a_finished_run_left_is_swept_and_a_living_runs_is_not(tmp_path, holder):
    """A run killed after its last commit: nothing is stale, so nobody needs the lock, and yet
    nothing shall lie about.
    """
    lock.swept(homes(tmp_path))
    assert (tmp_path / "p" / lock.LOCK).exists()
    (tmp_path / "p" / ".staged").mkdir()
    (tmp_path / "p" / "unfinished" / "fit").mkdir(parents=True)
    (tmp_path / "p" / "fit.json").write_text("whole")
    holder.kill()
    holder.wait()
    lock.swept(homes(tmp_path))
    assert [p.name for p in (tmp_path / "p").iterdir()] == ["fit.json"]


def test_a_damaged_lock_file_is_no_obstacle(tmp_path):
    (tmp_path / lock.LOCK).write_text("{half")
    with locked(Homes(processed=tmp_path, reports=tmp_path / "r")) as told:
        assert told == ""


def test_a_lock_leaves_no_folder_behind_that_it_made(tmp_path):
    with locked(Homes.within(tmp_path, "c")):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_seen_before_the_start(tmp_path, monkeypatch):
    monkeypatch.setattr(
        shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(10, 7, 3_000_000)
    )
    require_free_space(tmp_path / "not" / "yet", 2_000_000)
    with pytest.raises(
        NoRoom,
        match=r"needs about 5 MB, and the disk has 3 MB left\n  free 2 MB, or choose another --out",
    ):
        require_free_space(tmp_path / "not" / "yet", 5_000_000)
    assert not (tmp_path / "not").exists()


@pytest.mark.parametrize(
    ("count", "text"), [(12, "12 bytes"), (3400, "3.4 kB"), (2.5e6, "2.5 MB"), (7e9, "7 GB")]
)
def test_sizes_in_words(count, text):
    assert size(int(count)) == text


def test_litter_of_a_write_that_cannot_even_clean_up_is_swept_by_the_next(tmp_path, monkeypatch):
    class Dead(store.Disk):
        def rename(self, old: Path, new: Path) -> None:
            raise OSError(5, "Input/output error")

        def unlink(self, path: Path) -> None:
            raise OSError(5, "Input/output error")

    monkeypatch.setattr(store, "disk", Dead())
    with pytest.raises(OSError, match="Input/output"):
        store.write_bytes(tmp_path / "a.json", b"{}")
    assert len(list(tmp_path.iterdir())) == 1
    with locked(Homes(processed=tmp_path, reports=tmp_path / "r")):
        pass
    assert list(tmp_path.iterdir()) == []
