"""A workspace with a campaign that is still being recorded."""

from __future__ import annotations

import functools
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imsave
from tests.unit import small_run

from nearlift.planning.question import VisitQuestion
from nearlift.run.watch import watch
from nearlift.stages import STAGES, looks

from .client import Client, served

REPORT = '<script>stolen = 1</script><h1 id="r">Report</h1>'


@pytest.fixture(scope="session")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """84 of 112 trials of a campaign after one round of `run --watch`, one with a glitch in its tare.
    Figures and report are stand-ins. A secret and another campaign lie outside the workspace.
    """
    base = tmp_path_factory.mktemp("serve")
    root = base / "work"
    raw = small_run.write(root / "raw" / "small", visits=4)
    records = sorted((raw / "trials").iterdir())
    (base / "late").mkdir()
    for record in records[84:]:
        shutil.move(record, base / "late")
    head, *rows = (line.split(",") for line in records[60].read_text().splitlines())
    for row in rows[10:30]:
        row[-1] = str(float(row[-1]) + 400.0)
    records[60].write_text("".join(",".join(row) + "\n" for row in (head, *rows)))
    for record in records[:84]:
        os.utime(record, (time.time() - 3600,) * 2)
    asked = VisitQuestion.parsed("K_b", until=0.05)
    stages = [s for s in STAGES if s.name in ("ingest", "reduce", "fit", "diagnose")]
    next(watch(raw, root, stages, "serial", 0, functools.partial(looks.look, asked)))
    reports = root / "reports" / "small"
    reports.mkdir(parents=True, exist_ok=True)
    (reports / "index.html").write_text(REPORT)
    for name in ("fig2", "residuals"):
        imsave(reports / f"{name}.png", np.zeros((8, 1200, 3)))
        (reports / f"{name}.csv").write_text("panel,x\nground,1\n")
    (base / "secret.txt").write_text("secret")
    (reports / "leak.txt").symlink_to(base / "secret.txt")
    (root / "processed" / "out").symlink_to(base / "elsewhere")
    shutil.copytree(root / "processed" / "small", base / "elsewhere")
    return root


@pytest.fixture(scope="session")
def client(workspace: Path) -> Iterator[Client]:
    """A browser that came by the link."""
    with served(workspace) as opened:
        opened.enter()
        yield opened
