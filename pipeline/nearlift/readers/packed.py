"""Text files packed by gzip, read as what is inside: the file itself is what is digested.

Whatever claims to unpack into more than `MOST_BYTES` is refused, as is what is cut off or fails its
check sum: gzip has one for the whole file.
"""

from __future__ import annotations

import gzip
import io
import zlib
from pathlib import Path
from typing import IO

from nearlift.errors import InputRefused

MAGIC = b"\x1f\x8b"
MOST_BYTES = 1 << 30


class _Unpacked(io.RawIOBase):
    """What a packed file holds, with gzip's complaints as refusals."""

    def __init__(self, file: IO[bytes], where: str) -> None:
        self._file, self._where, self._left = file, where, MOST_BYTES
        self._inner = gzip.GzipFile(fileobj=file)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        try:
            content = self._inner.read(len(buffer))
        except (EOFError, zlib.error, gzip.BadGzipFile) as fault:
            raise InputRefused(
                self._where,
                f"is compressed, and damaged or cut off: {fault}",
                "copy it anew from the rig",
            ) from None
        self._left -= len(content)
        if self._left < 0:
            raise InputRefused(
                self._where,
                f"is compressed, and holds more than {MOST_BYTES >> 20} MB",
                "unpack it, and cut it into records on the rig",
            )
        buffer[: len(content)] = content
        return len(content)

    def close(self) -> None:
        self._file.close()
        super().close()


def is_packed(path: Path) -> bool:
    """Whether a file is packed; False where it cannot be opened."""
    try:
        with path.open("rb") as file:
            return file.read(2) == MAGIC
    except OSError:
        return False


def opened(path: Path) -> IO[bytes]:
    """The file, or what is inside where it is packed."""
    file = path.open("rb")
    if file.peek(2)[:2] != MAGIC:
        return file
    return io.BufferedReader(_Unpacked(file, str(path)), 1 << 16)
