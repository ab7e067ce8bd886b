"""The demo's products on several processors, number by number.

A processor is what BLAS, numpy and the compiler of the scans take this one for: older ones are
asked for by the variables that each of them reads. ``python -m tests.calibration.processors``
prints the table of docs/stages/fit.md.
"""

from __future__ import annotations

import json
import os
import re
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
#: What is zero but for rounding, as part of the largest number of its column or list, is not
#: compared.
ROUNDING = 1e-11
#: The relative difference that a number may have.
SAME = 1e-9
#: Larger ones, each the rounding of a sum over the trials (2.2e-16 times the root of 400) times
#: what makes it worse, rounded up to a power of ten: a direction in which the loop's families
#: differ by 1e-8 is kept, and known to that over 1e-8; the limit of u is that of 1e8 times the
#: trials beside what was declared once; a height's slope by differences of 1e-4 of it is known to
#: that over 1e-4, and u with the height unknown to that over the root of 1 - r^2, 1e-2; the
#: deviance, 400, tells a size of noise that is 1e-4 of the scatter by the square of that.
DIRECTIONS, REPEATS, SLOPES, SIZES = 1e-6, 1e-6, 1e-8, 1e-6
LARGER = {
    r"(diagnosis|results)\.json.*": DIRECTIONS,
    r"loop_residuals\.parquet:.*": DIRECTIONS,
    r".*\.u_limit": REPEATS,
    r".*\.u_if_free": SLOPES,
    r"fit\.json:\.noise\..*|.*\.u_input": SIZES,
}
#: Differences of numbers that agree, and what they are of: held against the largest of their
#: column, list or family; its place has a star.
DIFFERENCES = re.compile(
    r"(.*\.budget\[)\d+(\]\.u)|(.*\.models\.)\w+\.(?:u_)?(?:d_)?(rmse|elpd)"
    r"|(.*\.candidates\[)\d+(\]\.(?:gain|log_evidence))|(.*\.(?:silent|limits)\[)\d+(\]\.share(?:_visible)?)"
    r"|(rise|before|after|held_out_before|held_out_after)()"
)
#: Probabilities: one of exp(-x) has x times the relative error of x, which is compared.
TAILS = re.compile(r".*\.(p_value|beyond)")
#: What an undeclared size would move, in a model that does not use it: below `SAME` it is zero but
#: for rounding. A sensitivity is u over its input's.
ZERO, TWICE = ".undeclared[", ".sensitivity"
#: Products that say when, where or with what a run was made.
ABOUT_THE_RUN = {"provenance.json", "inputs-cache.json"}


@dataclass(frozen=True)
class Difference:
    """The largest relative difference in one product, and where."""

    product: str
    numbers: int
    largest: float
    where: str

    @property
    def tolerated(self) -> float:
        """The largest relative difference that this number may have."""
        place = f"{Path(self.product).name}:{self.where}"
        return next(
            (limit for pattern, limit in LARGER.items() if re.fullmatch(pattern, place)), SAME
        )


def run(folder: Path, processor: str) -> None:
    """The demo as that processor makes it, into a folder of its own."""
    environment = {**os.environ, **PROCESSORS[processor], "PYTHONPATH": str(ROOT / "pipeline")}
    words = [
        sys.executable,
        "-W",
        "ignore",
        "-c",
        "from nearlift.cli import main; main()",
        "demo",
        "-q",
        "--out",
        str(folder),
    ]
    subprocess.run(words, env=environment, check=True)


def numbers(path: Path) -> dict[str, np.ndarray]:
    """Every number of a product by its place; lists and columns as arrays."""
    if path.suffix == ".parquet":
        from pyarrow import parquet

        table = parquet.read_table(path)
        return {
            n: table[n].to_numpy()
            for n in table.column_names
            if table[n].type in ("double", "int64", "float")
        }
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


def families(found: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The same with differences of one family as one list, and probabilities as their
    logarithms.
    """
    together: dict[str, list[np.ndarray]] = {}
    for place, values in found.items():
        own = (
            "*".join(part for part in match.groups() if part is not None)
            if (match := DIFFERENCES.fullmatch(place))
            else place
        )
        if TWICE not in place:
            tail = TAILS.fullmatch(place) and (values > 0).all()
            together.setdefault(own, []).append(np.log(values) if tail else values)
    return {place: np.concatenate(values) for place, values in together.items()}


def compare(a: Path, b: Path) -> list[Difference]:
    """Each product that both folders hold, by what comes nearest to its limit; words count as
    infinitely different where they are not the same.
    """
    found = []
    for path in sorted((a / "processed").rglob("*")):
        if path.suffix not in (".parquet", ".json") or path.name in ABOUT_THE_RUN:
            continue
        here, there = (families(numbers(p)) for p in (path, b / path.relative_to(a)))
        product, count = str(path.relative_to(a / "processed")), sum(v.size for v in here.values())
        away = [Difference(product, count, np.inf, k) for k in here.keys() ^ there.keys()]
        for k in here.keys() & there.keys():
            if not (ZERO in k and np.abs(here[k]).max(initial=0.0) < SAME):
                largest = _apart(
                    here[k].astype(float),
                    there[k].astype(float),
                    whole="*" in k or bool(DIFFERENCES.fullmatch(k)),
                )
                away.append(Difference(product, count, largest, k))
        found.append(
            max(
                away,
                key=lambda d: d.largest / d.tolerated,
                default=Difference(product, count, 0.0, ""),
            )
        )
    return found


def _apart(x: np.ndarray, y: np.ndarray, whole: bool) -> float:
    if x.shape != y.shape or (np.isfinite(x) != np.isfinite(y)).any():
        return np.inf
    x, y = x[np.isfinite(x)], y[np.isfinite(y)]
    if not x.size:
        return 0.0
    size = np.maximum(np.abs(x), np.abs(y))
    if whole:
        size[:] = size.max()
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
        print(
            f"| `{rows[0].product}` | {rows[0].numbers} | "
            + " | ".join(f"{r.largest:.1g}" for r in rows)
            + " |"
        )


if __name__ == "__main__":
    main()
