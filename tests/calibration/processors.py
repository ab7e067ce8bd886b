"""The demo's products on several processors, number by number.

A processor is what BLAS, numpy and the compiler of the scans take this one for: older ones are asked for by the variables that each
of them reads. ``python -m tests.calibration.processors`` prints the table of docs/stages/fit.md.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
#: Each with the variables that make OpenBLAS, numpy and numba take this processor for it.
PROCESSORS = {
    "Haswell": {"OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR", "NUMBA_CPU_NAME": "haswell"},
    "Sandybridge": {
        "OPENBLAS_CORETYPE": "Sandybridge",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
        "NUMBA_CPU_NAME": "sandybridge",
    },
    "Nehalem": {"OPENBLAS_CORETYPE": "Nehalem", "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR", "NUMBA_CPU_NAME": "nehalem"},
    "SkylakeX": {"OPENBLAS_CORETYPE": "SkylakeX"},
}
#: What is zero but for rounding, as part of the largest number of its column or list, is not compared.
ROUNDING = 1e-11
#: The relative difference that a product may have, and the larger ones that some may.
SAME = 1e-9
#: Some times what Nehalem needs. Refits in a stack stop at a step of 1e-7 of an uncertainty; directions in which the families of the loop
#: differ by 1e-8 are kept, and known to rounding over 1e-8; a p-value of 1e-66 has 150 times the relative error of its logarithm.
LARGER = {
    "fit.json": 1e-5,
    "posterior.parquet": 1e-8,
    "diagnosis.json": 1e-4,
    "loop_residuals.parquet": 1e-4,
    "profiles.parquet": 1e-4,
    "proximity.json": 1e-7,
}
#: What an undeclared size would move, in a model that does not use it: below `SAME` it is zero but for rounding.
ZERO = ".undeclared["
#: Products that say when, where or with what a run was made.
ABOUT_THE_RUN = {"provenance.json", "ledger.json", "inputs-cache.json"}


@dataclass(frozen=True)
class Difference:
    """The largest relative difference in one product, and where."""

    product: str
    numbers: int
    largest: float
    where: str


def tolerated(product: str) -> float:
    """The largest relative difference that a product may have."""
    return LARGER.get(Path(product).name, SAME)


def run(folder: Path, processor: str) -> None:
    """The demo as that processor makes it, into a folder of its own."""
    environment = {**os.environ, **PROCESSORS[processor], "PYTHONPATH": str(ROOT / "pipeline")}
    words = [sys.executable, "-W", "ignore", "-c", "from nearlift.cli import main; main()", "demo", "-q", "--out", str(folder)]
    subprocess.run(words, env=environment, check=True)


def numbers(path: Path) -> dict[str, np.ndarray]:
    """Every number of a product by its place; lists and columns as arrays."""
    if path.suffix == ".parquet":
        from pyarrow import parquet

        table = parquet.read_table(path)
        return {n: table[n].to_numpy() for n in table.column_names if table[n].type in ("double", "int64", "float")}
    return dict(_leaves(json.loads(path.read_text()), ""))


def _leaves(value: Any, at: str) -> Iterator[tuple[str, np.ndarray]]:
    if isinstance(value, dict):
        for key, each in value.items():
            yield from _leaves(each, f"{at}.{key}")
    elif isinstance(value, list):
        plain = [v for v in value if isinstance(v, int | float) and not isinstance(v, bool)]
        if plain and len(plain) == len(value):
            yield at, np.array(plain, dtype=float)
        else:
            for i, each in enumerate(value):
                yield from _leaves(each, f"{at}[{i}]")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield at, np.array([value], dtype=float)
    elif isinstance(value, str) and "sha256" not in at:
        yield f"{at}={value}", np.zeros(0)


def compare(a: Path, b: Path) -> list[Difference]:
    """Each product that both folders hold; words count as infinitely different where they are not the same."""
    found = []
    for path in sorted((a / "processed").rglob("*")):
        if path.suffix not in (".parquet", ".json") or path.name in ABOUT_THE_RUN:
            continue
        here, there = numbers(path), numbers(b / path.relative_to(a))
        away = dict.fromkeys(here.keys() ^ there.keys(), np.inf)
        for k in here.keys() & there.keys():
            if not (ZERO in k and np.abs(here[k]).max(initial=0.0) < SAME):
                away[k] = _apart(here[k].astype(float), there[k].astype(float))
        worst = max(away, key=lambda k: away[k], default="")
        count = sum(v.size for v in here.values())
        found.append(Difference(str(path.relative_to(a / "processed")), count, away.get(worst, 0.0), worst))
    return found


def _apart(x: np.ndarray, y: np.ndarray) -> float:
    if x.shape != y.shape or (np.isfinite(x) != np.isfinite(y)).any():
        return np.inf
    x, y = x[np.isfinite(x)], y[np.isfinite(y)]
    if not x.size:
        return 0.0
    size = np.maximum(np.abs(x), np.abs(y))
    seen = size > ROUNDING * size.max()
    return float(np.max(np.abs(x - y)[seen] / size[seen], initial=0.0))


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        for name in PROCESSORS:
            run(Path(folder) / name, name)
        first, *others = PROCESSORS
        each = {name: compare(Path(folder) / first, Path(folder) / name) for name in others}
    print("| product | numbers | " + " | ".join(others) + " |")
    print("|---|---|" + "---|" * len(others))
    for rows in zip(*each.values(), strict=True):
        print(f"| `{rows[0].product}` | {rows[0].numbers} | " + " | ".join(f"{r.largest:.1g}" for r in rows) + " |")


if __name__ == "__main__":
    main()
