"""The scanner as machine code: kept, damaged, unkept, and by numba's public road, it finds the same numbers."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from nearlift.readers import native

TEXT = b"t,force,x\n0.000,-1.3230,7\n0.001,17.25,8\n0.002,0.1,9\n"
TRUE = [-1.3230, 17.25, 0.1]


def found(text: bytes = TEXT) -> list[float] | None:
    force, time = np.empty(20), np.empty(20)
    rows = native.scan(text, text.find(b"\n") + 1, 3, 1, 0, force, time)
    return None if rows is None else force[:rows].tolist()


@pytest.fixture(autouse=True)
def fresh():
    native._scanner.cache_clear()
    yield
    native._scanner.cache_clear()


def test_it_is_kept_and_found_again_and_damage_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    compiled = []
    real = native._compiled
    (tmp_path / "no folder").touch()
    monkeypatch.setattr(native, "_folders", lambda: iter([tmp_path / "no folder", tmp_path]))
    monkeypatch.setattr(native, "_compiled", lambda: compiled.append(1) or real())
    assert found() == TRUE
    (kept,) = tmp_path.glob("scan-*.code")
    native._scanner.cache_clear()
    assert found() == TRUE
    assert len(compiled) == 1
    content = bytearray(kept.read_bytes())
    content[-1] ^= 1
    kept.write_bytes(content)
    native._scanner.cache_clear()
    assert found() == TRUE
    assert len(compiled) == 2
    assert native._checked(kept.read_bytes()) is not None


def test_numbas_public_road_finds_the_same(monkeypatch: pytest.MonkeyPatch):
    def moved() -> tuple[str, bytes]:
        raise AttributeError("no such thing in this numba")

    monkeypatch.setattr(native, "_folders", lambda: iter(()))
    monkeypatch.setattr(native, "_compiled", moved)
    assert found() == TRUE


def test_what_is_kept_serves_without_the_compiler():
    found()
    code = (
        "import sys, numpy as np; from nearlift.readers import native\n"
        "force = np.empty(9); rows = native.scan(b'f\\n1.5\\n', 2, 1, 0, None, force, np.empty(0))\n"
        "print(rows, force[0], 'numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.split() == ["1", "1.5", "False"]


def test_it_refuses_what_is_not_plain():
    assert found(TEXT.replace(b"17.25", b"1e1")) is None
    assert found(TEXT[:-1]) is None
    assert native.scan(TEXT, 0, 3, 1, None, np.empty(20), np.empty(0)) is None
    assert native.scan(TEXT, len(TEXT) + 1, 3, 1, None, np.empty(20), np.empty(0)) is None
    assert native.scan(TEXT, 10, 3, 1, None, np.empty(2), np.empty(0)) is None
