"""C, compiled on the spot with -O3: what the machine can do."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path


def compiler() -> str | None:
    return shutil.which("gcc") or shutil.which("cc")


def program(folder: Path, name: str, source: str) -> Path:
    """The program, compiled unless it stands there already."""
    path = folder / name
    if (found := compiler()) and not path.exists():
        path.with_suffix(".c").write_text(source)
        subprocess.run(
            [
                found,
                "-O3",
                "-march=native",
                "-pthread",
                "-o",
                str(path),
                str(path.with_suffix(".c")),
                "-lm",
            ],
            check=True,
        )
    return path
