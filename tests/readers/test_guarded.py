"""The process that parses foreign bytes: its limits, its end, and what it may answer."""

from __future__ import annotations

import gzip
import io
import os
import pickle
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit import written

from nearlift import readers
from nearlift.readers import guarded, text
from nearlift.readers.base import Malformed
from nearlift.readers.dialect import NoNames

FORCE = [1.0, 2.0, 3.0]
LIMIT_KB = 1 << 20


@pytest.fixture(scope="module")
def small() -> Iterator[guarded.Guarded]:
    process = guarded.Guarded(wall_s=60.0)
    yield process
    process.close()


def test_a_relative_path_is_of_the_current_folder(
    small: guarded.Guarded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (("a", 1), ("b", 2)):
        (tmp_path / name).mkdir()
        written.put(tmp_path / name, "r.csv", f"F\n{value}\n{value}\n".encode())
        monkeypatch.chdir(tmp_path / name)
        assert small(text.contents, Path("r.csv"), {}, None).channels[0].values[0] == value


def test_a_refusal_keeps_its_type_and_all_that_it_says(
    small: guarded.Guarded, tmp_path: Path
) -> None:
    path = written.put(tmp_path, "a.csv", b"1,2,3\n4,5,6\n")
    with pytest.raises(NoNames, match=r"a\.csv.*\n  ") as raised:
        small(text.contents, path, {}, None)
    assert raised.value.columns == 3
    with pytest.raises(Malformed, match=r"^cannot be read: could not convert string"):
        small(float, "x")


@pytest.mark.parametrize(
    ("limits", "function", "arguments", "match"),
    [
        ({}, bytes, (2 << 30,), "needs more memory than its reader is allowed"),
        ({}, np.zeros, (17 << 20,), "unpacks to more than 128 MB"),
        ({}, os.abort, (), rf"crashed \(exit code -{signal.SIGABRT.value}\), at most 1024 MiB"),
        ({"cpu_s": 1}, sum, (range(1 << 60),), "stopped after 1 s of computing"),
        ({"wall_s": 1.5}, time.sleep, (600,), r"stopped after 1\.5 s"),
    ],
)
def test_a_crash_or_a_limit_costs_one_call(
    small: guarded.Guarded, limits: Any, function: Any, arguments: Any, match: str
) -> None:
    process = guarded.Guarded(**limits) if limits else small
    process.start()
    with pytest.raises(Malformed, match=match):
        process(function, *arguments)
    if limits:
        assert process.process is None
    else:
        assert small(sum, (1, 2)) == 3


def test_one_process_serves_file_after_file_for_all_threads(small: guarded.Guarded) -> None:
    found: list[int] = []
    threads = [threading.Thread(target=lambda: found.append(small(os.getpid))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 8
    assert set(found) == {small.start().pid} != {os.getpid()}


@pytest.mark.filterwarnings("ignore:.*fork")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
def test_a_forked_copy_asks_a_process_of_its_own() -> None:
    """Two that shared a pipe would get each other's answers."""
    ours = guarded.run.start().pid
    if not (copy := os.fork()):
        os._exit(guarded.run.start().pid == ours)
    assert os.waitpid(copy, 0)[1] == 0
    assert guarded.run(os.getpid) == ours


def test_the_process_is_limited_and_writes_no_file(small: guarded.Guarded, tmp_path: Path) -> None:
    assert small(resource.getrlimit, resource.RLIMIT_AS) == (1 << 30, 1 << 30)
    assert small(resource.getrlimit, resource.RLIMIT_CORE) == (0, 0)
    with pytest.raises(Malformed, match="File too large"):
        small(Path.write_text, tmp_path / "a", "text")
    assert small(os.getsid, 0) == small.start().pid


def test_only_numbers_texts_and_own_types_are_accepted(small: guarded.Guarded) -> None:
    """A process that a file has taken over could send anything."""
    with pytest.raises(Malformed, match="crashed"):
        small(Path, "of another package")
    for code in (b"cos\nsystem\n(S'true'\ntR.", b"cnearlift.run.tables\nwrite_whole\n."):
        with pytest.raises(pickle.UnpicklingError, match="is no answer"):
            guarded._Unpickler(io.BytesIO(code)).load()


def test_nothing_is_imported_from_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("h5py", "numpy", "json", "sitecustomize"):
        written.put(tmp_path, f"{name}.py", b"open('pwned', 'w')\nraise SystemExit\n")
    path = written.put(tmp_path, "a.h5", written.hdf5(FORCE))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend("")
    fresh = guarded.Guarded()
    read = readers.reader("hdf5").contents
    assert fresh(read, path, {}, None).channels[0].values.tolist() == FORCE
    fresh.close()
    assert not (tmp_path / "pwned").exists()


PARENT = """
import os, sys, threading, time
from nearlift.readers.guarded import run
print(run.start().pid, flush=True)
call = {"asleep": (time.sleep, 600), "computing": (sum, range(1 << 60))}[sys.argv[1]]
threading.Thread(target=run, args=call, daemon=True).start()
time.sleep(600)
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks /proc who lives")
@pytest.mark.parametrize("busy", [pytest.param("asleep", marks=pytest.mark.nightly), "computing"])
def test_the_process_ends_with_its_parent_within_a_call_into_c(busy: str) -> None:
    with subprocess.Popen([sys.executable, "-c", PARENT, busy], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        time.sleep(3.0)
        assert Path(f"/proc/{pid}").exists()
        parent.send_signal(signal.SIGKILL)
    deadline = time.monotonic() + 5
    while Path(f"/proc/{pid}").exists():
        assert time.monotonic() < deadline, "it lives on"
        time.sleep(0.05)


# ---- small files that unpack to gigabytes


def hdf5_bomb(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        # chunks that were never written read as zeros
        file.create_dataset("force", (1 << 29,), dtype="f8", chunks=(1 << 20,), compression="gzip")


def parquet_bomb(path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    trial = pa.array(["a"] * 1_000_000).dictionary_encode()
    part = pa.table({"trial": trial, "force": pa.array(np.zeros(1_000_000, dtype=np.int8))})
    with pq.ParquetWriter(path, part.schema) as file:
        for _ in range(40):
            file.write_table(part)


def mat_bomb(path: Path) -> None:
    import scipy.io

    scipy.io.savemat(path, {"force": np.zeros((36 << 20, 1))}, do_compression=True)


def gzip_bomb(path: Path) -> None:
    with gzip.open(path, "wb", compresslevel=9) as file:
        file.write(b"force,t\n")
        for _ in range(128):
            file.write(b"0,0\n" * (1 << 18))


READ = """
import resource, sys
from pathlib import Path
from nearlift.onboarding.inspection import inspect
from nearlift.errors import InputRefused
from nearlift.readers import guarded
guarded.run.start()
try:
    inspect(Path(sys.argv[1]))
except InputRefused as refusal:
    print(refusal.what)
[peak] = [line for line in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in line]
print(peak.split()[1])
guarded.run.close()
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="measured in the kB of Linux")
@pytest.mark.parametrize(
    ("name", "write"),
    [
        pytest.param("bomb.h5", hdf5_bomb, marks=pytest.mark.nightly),
        ("bomb.parquet", parquet_bomb),
        pytest.param("bomb.mat", mat_bomb, marks=pytest.mark.nightly),
        ("bomb.csv.gz", gzip_bomb),
    ],
)
def test_a_small_file_fills_no_memory(
    name: str, write: Callable[[Path], None], tmp_path: Path
) -> None:
    """Neither the memory of the process that parses it, nor of the one that asks."""
    path = tmp_path / name
    write(path)
    assert path.stat().st_size < 3_000_000
    done = subprocess.run(
        [sys.executable, "-c", READ, path], stdout=subprocess.PIPE, text=True, check=True
    )
    *what, parent, child = done.stdout.splitlines()
    words = ("memory", "allocate", "unpacks to more", "holds more")
    assert any(word in what[0] for word in words)
    assert max(int(parent), int(child)) <= LIMIT_KB
