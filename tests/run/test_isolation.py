"""Compiled code is kept where no other user can write, or not at all; workers and readers end with
the process that started them.
"""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from nearlift import compiler, isolation


@pytest.fixture
def cache(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_the_folder_of_code_is_its_owners_alone(cache):
    old = os.umask(0)
    try:
        folder = isolation.code_folder()
    finally:
        os.umask(old)
    assert folder == cache / "nearlift" / "code"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert isolation.code_folder() == folder


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o755, 0o1777])
def test_a_folder_that_others_can_reach_is_not_used(cache, mode):
    isolation.code_folder().chmod(mode)
    assert isolation.code_folder() is None


def test_another_users_folder_and_a_link_in_its_place_are_not_used(cache, tmp_path, monkeypatch):
    folder, me = isolation.code_folder(), os.geteuid()
    with monkeypatch.context() as patch:
        patch.setattr(os, "geteuid", lambda: me + 1)
        assert isolation.code_folder() is None
    folder.rename(tmp_path / "elsewhere")
    folder.symlink_to(tmp_path / "elsewhere")
    assert isolation.code_folder() is None


def test_a_folder_is_not_used_below_one_in_which_anybody_may_rename(cache):
    # the last as /tmp is
    for mode, used in ((0o755, True), (0o777, False), (0o1777, True)):
        cache.mkdir(exist_ok=True)
        cache.chmod(mode)
        assert bool(isolation.code_folder()) is used


def test_the_users_cache_may_be_a_link_of_the_users(cache, tmp_path):
    (tmp_path / "scratch").mkdir()
    cache.symlink_to(tmp_path / "scratch")
    assert isolation.code_folder() == cache / "nearlift" / "code"


@pytest.mark.parametrize("home", ["cache", "./cache", "/dev/null"])
def test_without_a_place_of_the_users_own_nothing_is_kept(tmp_path, monkeypatch, home):
    """A relative folder would lie in the current one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", home)
    assert isolation.code_folder() is None
    assert list(tmp_path.iterdir()) == []


def twice(x):
    return 2 * x


def test_numba_keeps_code_there_and_nowhere_else(cache, tmp_path, monkeypatch):
    """The user's own functions go on being kept where the user says."""
    monkeypatch.setattr(compiler.config, "CACHE_DIR", str(tmp_path / "users"))
    assert compiler.compiled(twice)(2) == 4
    assert {path.suffix for path in isolation.code_folder().rglob("test_isolation.twice*")} == {
        ".nbi",
        ".nbc",
    }
    assert str(tmp_path / "users") == compiler.config.CACHE_DIR
    assert not (tmp_path / "users").exists()


def test_without_a_folder_numba_keeps_nothing(monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    function = compiler.compiled(twice)
    assert function(2) == 4
    assert not function.stats.cache_path


POOL = """
import os, sys, time
from nearlift.run.workers import open_executor
if __name__ == "__main__":
    with open_executor("processes:2") as pool:
        print(*{pool.submit(os.getpid).result() for _ in range(4)}, *[pool.submit(time.sleep, 600) and "" for _ in range(2)], flush=True)
        time.sleep(600)
"""
READER = """
import sys
from pathlib import Path
from nearlift.readers import guarded, mat
print(guarded.run.start().pid, flush=True)
guarded.run(mat.contents, Path(sys.argv[1]), {}, None)
"""


def gone(pid: int) -> bool:
    """Whether a process has ended; one that nobody has asked after yet has."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (ProcessLookupError, FileNotFoundError):
        return True


@pytest.mark.skipif(
    not Path("/proc/self/stat").exists(), reason="tells the living from the dead by /proc"
)
@pytest.mark.parametrize("program", [POOL, READER], ids=["workers", "reader"])
def test_who_works_for_a_killed_process_ends(tmp_path, program):
    """Workers in the midst of a task, and a reader whose file never comes."""
    (tmp_path / "program.py").write_text(program)
    os.mkfifo(tmp_path / "never.mat")
    parent = subprocess.Popen(
        [sys.executable, tmp_path / "program.py", tmp_path / "never.mat"],
        stdout=subprocess.PIPE,
        text=True,
    )
    pids = [int(word) for word in parent.stdout.readline().split()]
    assert pids
    assert not any(map(gone, pids))
    time.sleep(0.5)
    parent.send_signal(signal.SIGKILL)
    parent.communicate()
    deadline = time.monotonic() + 60
    while not all(map(gone, pids)):
        assert time.monotonic() < deadline, "they live on"
        time.sleep(0.05)
