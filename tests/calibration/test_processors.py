"""The demo's answers do not depend on the processor that BLAS, numpy and numba take this one for:
each reads a variable that names an older one.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

ROOT = Path(__file__).parents[2]
AVX512 = "X86_V4 AVX512_ICL AVX512_SPR"
#: What OpenBLAS, numpy and numba are told.
PROCESSORS = {
    "Haswell": ("Haswell", AVX512, "haswell"),
    "Sandybridge": ("Sandybridge", f"X86_V3 {AVX512}", "sandybridge"),
    "Nehalem": ("Nehalem", f"X86_V3 {AVX512}", "nehalem"),
    "SkylakeX": ("SkylakeX", "", "skylake-avx512"),
}
#: Quoted values and limits may differ by this part of their standard uncertainty.
SAME_IN_U = 1e-4


def answers(folder, processor):
    """results.json's boundaries of a demo that is run as on that processor."""
    names = ("OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "NUMBA_CPU_NAME")
    environment = dict(zip(names, PROCESSORS[processor], strict=True))
    environment |= {**os.environ, **environment, "PYTHONPATH": str(ROOT / "pipeline")}
    command = "from nearlift.cli import main; main()"
    words = [sys.executable, "-W", "ignore", "-c", command, "demo", "-q", "--out", str(folder)]
    subprocess.run(words, env=environment, check=True)
    return json.loads((folder / "processed/demo/results.json").read_text())["boundaries"]


def differences(one, other):
    """Largest difference of value, u and 90 % limits of each quoted coefficient, in its u."""
    return {
        f"{boundary}, {name}": max(
            abs(a[key] - other[boundary]["coefficients"][name][key]) / a["u"]
            for key in ("value", "u", "lo90", "hi90")
        )
        for boundary, result in one.items()
        for name, a in result["coefficients"].items()
    }


@pytest.mark.calibration
def test_every_processor_gives_the_same_answers(tmp_path):
    """Prints the table of docs/stages/fit.md."""
    each = {name: answers(tmp_path / name, name) for name in PROCESSORS}
    first = each.pop("Haswell")
    for other in each.values():
        for boundary, result in first.items():
            for key in ("verdict", "effects", "rivals"):
                assert other[boundary].get(key) == result.get(key)
    table = pd.DataFrame({name: differences(first, other) for name, other in each.items()})
    print(table.map("{:.0e}".format))
    assert table.max(axis=None) < SAME_IN_U
