"""The start of the command line."""

from __future__ import annotations

import contextlib
import gc
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from nearlift import terminal
from nearlift.__main__ import main

INTERRUPTED = """
import os, signal, sys

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == "nearlift.terminal":
            os.kill(os.getpid(), signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)
sys.meta_path.insert(0, Interrupt())
from nearlift.__main__ import main
main()
"""


def test_an_interrupt_during_imports_ends_quietly():
    ended = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, timeout=60)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, b"", b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device here")
def test_a_version_that_cannot_be_written_ends_with_a_message():
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            [sys.executable, "-m", "nearlift", "--version"],
            stdout=full,
            stderr=subprocess.PIPE,
            timeout=60,
        )
    assert (ended.returncode, b"No space left" in ended.stderr) == (4, True)
    assert b"Traceback" not in ended.stderr


def test_an_interrupt_that_a_library_swallows_is_repeated(monkeypatch):
    monkeypatch.setattr(terminal, "REPEAT_S", 0.05)
    before = signal.getsignal(signal.SIGTERM)

    def swallow():
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
        time.sleep(60)

    with pytest.raises(KeyboardInterrupt), terminal.interruptible():
        swallow()
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_machine_without_memory_is_told(monkeypatch, capsys):
    def full():
        raise MemoryError

    monkeypatch.setattr("nearlift.cli.main", full)
    monkeypatch.setattr(gc, "freeze", lambda: None)
    monkeypatch.setattr(gc, "set_threshold", lambda objects: None)
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 4
    assert capsys.readouterr().err.startswith("error: not enough memory: use --executor serial")
