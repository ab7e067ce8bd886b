"""The demo's answers on several processors.

A processor is what BLAS, numpy and numba take this one for: each reads a variable that names an
older one.

    python -m tests.calibration.processors        prints the table of docs/stages/fit.md
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: Each with the variables that make OpenBLAS, numpy and numba take this processor for it.
PROCESSORS = {
    "Haswell": {
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
        "NUMBA_CPU_NAME": "haswell",
    },
    "Sandybridge": {
        "OPENBLAS_CORETYPE": "Sandybridge",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
        "NUMBA_CPU_NAME": "sandybridge",
    },
    "Nehalem": {
        "OPENBLAS_CORETYPE": "Nehalem",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
        "NUMBA_CPU_NAME": "nehalem",
    },
    "SkylakeX": {"OPENBLAS_CORETYPE": "SkylakeX"},
}
#: Quoted values and limits may differ by this part of their standard uncertainty.
SAME_IN_U = 1e-4


def answers(folder: Path, processor: str) -> dict[str, dict]:
    """results.json's boundaries of a demo that is run as on that processor, in `folder`."""
    environment = {**os.environ, **PROCESSORS[processor], "PYTHONPATH": str(ROOT / "pipeline")}
    command = "from nearlift.cli import main; main()"
    words = [sys.executable, "-W", "ignore", "-c", command, "demo", "-q", "--out", str(folder)]
    subprocess.run(words, env=environment, check=True)
    return json.loads((folder / "processed/demo/results.json").read_text())["boundaries"]


def verdicts(found: dict[str, dict]) -> dict[str, tuple]:
    """Verdict, identified effects and rivals of each boundary."""
    return {b: (r["verdict"], r.get("effects"), r.get("rivals")) for b, r in found.items()}


def differences(one: dict[str, dict], other: dict[str, dict]) -> dict[str, float]:
    """Largest difference of value, u and 90 % limits of each quoted coefficient, in its u."""
    return {
        f"{boundary}, {name}": max(
            abs(a[key] - other[boundary]["coefficients"][name][key]) / a["u"]
            for key in ("value", "u", "lo90", "hi90")
        )
        for boundary, result in one.items()
        for name, a in result["coefficients"].items()
    }


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        each = {name: answers(Path(folder) / name, name) for name in PROCESSORS}
    first, *others = PROCESSORS
    print(f"| coefficient | {' | '.join(others)} |\n|---|{'--:|' * len(others)}")
    columns = [differences(each[first], each[name]) for name in others]
    for name in columns[0]:
        print(f"| {name} | {' | '.join(f'{c[name]:.0e}' for c in columns)} |")


if __name__ == "__main__":
    main()
