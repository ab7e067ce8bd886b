"""Compiled loops as machine code: kept, damaged, unkept, and by numba's public road, they give the
same answers.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from nearlift import isolation, native
from nearlift.native import POINTER, REAL, WHOLE, Kernel
from nearlift.readers import scanner

TEXT = b"t,force,x\n0.000,-1.3230,7\n0.001,17.25,8\n0.002,0.1,9\n"
TRUE = [-1.3230, 17.25, 0.1]
CLOCK = np.arange(9) / 1000


def found(text: bytes = TEXT) -> list[float] | None:
    columns = scanner.scan(text, text.find(b"\n") + 1, 3, [1, 0])
    return None if columns is None else columns[0].tolist()


def steady(monkeypatch: pytest.MonkeyPatch, folder: Path | None) -> Kernel:
    """A kernel that has not been made ready, kept in that folder, or nowhere."""
    monkeypatch.setattr(isolation, "code_folder", lambda: folder)
    return Kernel("nearlift.reduction.sums_kernel", "steady", POINTER, WHOLE, REAL)


def test_it_is_kept_and_found_again_and_damage_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled = []
    real = Kernel.compiled
    monkeypatch.setattr(Kernel, "compiled", lambda self: compiled.append(1) or real(self))

    def answer() -> int:
        return steady(monkeypatch, tmp_path)(native.address(CLOCK), len(CLOCK), 1000.0)

    assert answer() == 1
    (kept,) = tmp_path.glob("steady-*.code")
    assert answer() == 1
    assert len(compiled) == 1
    content = bytearray(kept.read_bytes())
    content[-1] ^= 1
    kept.write_bytes(content)
    assert answer() == 1
    assert len(compiled) == 2
    kept.chmod(0o640)
    assert answer() == 1
    assert len(compiled) == 3
    assert native.checked(kept.read_bytes()) is not None


def test_what_cannot_be_kept_is_compiled_each_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in (None, tmp_path / "missing"):
        assert steady(monkeypatch, folder)(native.address(CLOCK), len(CLOCK), 1000.0) == 1


def test_numbas_public_road_gives_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    def moved(self: Kernel) -> tuple[str, bytes]:
        raise AttributeError("no such thing in this numba")

    kernel = steady(monkeypatch, None)
    monkeypatch.setattr(Kernel, "compiled", moved)
    assert kernel(native.address(CLOCK), len(CLOCK), 1000.0) == 1
    assert kernel(native.address(CLOCK), len(CLOCK), 900.0) == 0


def test_what_is_kept_serves_without_the_compiler() -> None:
    found()
    code = (
        "import sys; from nearlift.readers import scanner\n"
        "(force,) = scanner.scan(b'f\\n1.5\\n', 2, 1, [0])\n"
        "print(len(force), force[0], 'numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.split() == ["1", "1.5", "False"]


def test_the_scanner_refuses_what_is_not_plain() -> None:
    assert found() == TRUE
    assert found(TEXT.replace(b"17.25", b"1e1")) is None
    assert found(TEXT[:-1]) is None
    assert scanner.scan(TEXT, 0, 3, [1]) is None
    assert scanner.scan(TEXT, len(TEXT) + 1, 3, [1]) is None
    # more rows than bytes of so many columns can hold
    assert scanner.scan(TEXT, 10, 30, [1]) is None
