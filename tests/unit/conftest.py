"""A small campaign as products on disk, made from formulas, for the tests of summaries, figures and
the report.
"""

from __future__ import annotations

import copy
import hashlib
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nearlift.campaign import manifest as manifest
from nearlift.run.engine import Job
from nearlift.run.workers import SerialExecutor
from nearlift.stages import diagnose, fit, reduce
from nearlift.stages.fit import FIT, RESULTS
from nearlift.stages.ingest import TRIALS

from . import small_run
from .manifests import raw_manifest

STATIONS = {
    "ground": [1.14, 1.3, 1.6, 2.0, 2.6, 3.5, 11.5],
    "ceiling": [0.12, 0.2, 0.3, 0.5, 0.9, 2.0, 10.5],
    "sidewall": [0.05, 0.15, 0.3, 0.6, 1.2, 10.7],
}
"""What each boundary is measured at."""


def true_ratio(boundary: str, z: np.ndarray) -> np.ndarray:
    if boundary == "ground":
        d, b = 65 / 23, np.sqrt(2) * 65 / 23
        image = lambda h: z / (h**2 + 4 * z**2) ** 1.5  # noqa: E731
        return 1 / (1 - 1 / (16 * z**2) - image(d) - image(np.sqrt(2) * d) / 2 - 2 * 1.8 * image(b))
    if boundary == "ceiling":
        return 0.5 + 0.5 * np.sqrt(1 + 0.09 / z**2)
    return 1 - 0.05 * np.exp(-z / 0.35)


def trial_table(
    boundaries: list[str], throttles: list[float], repeats: int, seed: int = 7
) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    rows, visit = [], 0
    for boundary in boundaries:
        stops = [(z, k) for z in STATIONS[boundary] for k in range(repeats)]
        for i in rng.permutation(len(stops)):
            z, _ = stops[i]
            rows += [(boundary, z, t, visit) for t in rng.permutation(throttles)]
            visit += 1
    n = len(rows)
    boundary = np.array([r[0] for r in rows], dtype=object)
    z_hat, throttle = np.array([r[1] for r in rows]), np.array([r[2] for r in rows])
    ratio = np.concatenate(
        [true_ratio(b, z_hat[boundary == b]) for b in dict.fromkeys(boundary.tolist())]
    )
    lift = 0.6 * throttle**1.4 * ratio * np.exp(0.004 * rng.standard_normal(n))
    quality = np.full(n, "", dtype=object)
    quality[[3, 11]] = ["SATURATED", "drift spikes"]
    return {
        "trial": np.array([f"t{i:04d}" for i in range(n)], dtype=object),
        "boundary": boundary,
        "z_hat": z_hat,
        "z_m": 0.023 * z_hat,
        "throttle": throttle,
        "lift_N": lift,
        "u_lift_N": 0.0005 * lift,
        "n": np.full(n, 10000),
        "n_eff": np.full(n, 4000.0),
        "drift_N_s": 1e-6 * rng.standard_normal(n),
        "sd_N": np.full(n, 0.01),
        "quality": quality,
        "visit": np.array([r[3] for r in rows]),
        "source_sha256": np.full(n, "0" * 64, dtype=object),
        "start_s": 20.0 * np.arange(n),
        "session": np.array([str(1 + 3 * i // n) for i in range(n)], dtype=object),
        "supply_V": 3.9 - 0.1 * throttle + 0.01 * rng.standard_normal(n),
        "approach": rng.choice([-1.0, 1.0], n),
    }


MakeJob = Callable[..., Job]


@pytest.fixture(scope="session")
def make_job(tmp_path_factory: pytest.TempPathFactory, once: Any) -> MakeJob:
    """Make a job whose trials are written, reduced, fitted and, if asked, diagnosed: once for
    the same trials and manifest, and copied.
    """

    def make(
        boundaries: tuple[str, ...] = ("ground", "ceiling", "sidewall"),
        throttles: tuple[float, ...] = (0.25, 0.5, 0.75, 0.92),
        repeats: int = 6,
        edit: Any = None,
        diagnosed: bool = False,
        **changes: Any,
    ) -> Job:
        raw = raw_manifest(**changes)
        table = trial_table(list(boundaries), list(throttles), repeats)
        if edit is not None:
            edit(table)

        def job(root: Path) -> Job:
            return Job(
                root=root,
                campaign=manifest.parse(copy.deepcopy(raw)),
                processed=root / "processed",
                reports=root / "reports",
                executor=SerialExecutor(),
                inputs={"campaign.toml": "a" * 64, "trials.csv": "b" * 64},
            )

        columns = [(name, str(column.dtype), column.tolist()) for name, column in table.items()]
        name = f"job-{hashlib.sha256(repr([raw, columns]).encode()).hexdigest()[:16]}"

        def fitted(root: Path) -> None:
            first = job(root)
            first.write(TRIALS, table)
            reduce.run(first)
            fit.run(first)

        def searched(root: Path) -> None:
            shutil.copytree(once(name, fitted), root, dirs_exist_ok=True)
            diagnose.run(job(root))

        root = tmp_path_factory.mktemp("campaign")
        made = once(f"{name}-diagnosed", searched) if diagnosed else once(name, fitted)
        shutil.copytree(made, root, dirs_exist_ok=True)
        return job(root)

    return make


@pytest.fixture
def plain_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """No figure is drawn: in its files stands a digest of its table. For tests of what is written
    when, not of how it looks.
    """
    monkeypatch.setattr("nearlift.report.figures.files.render", small_run.undrawn)


@pytest.fixture(scope="session")
def small_job(make_job: MakeJob) -> Job:
    return make_job(simulated=True)


@pytest.fixture(scope="session")
def remake(small_job: Job, tmp_path_factory: pytest.TempPathFactory) -> MakeJob:
    """The small campaign, fitted once, with another manifest: for what comes after the fit. With
    names of boundaries, only those are fitted.
    """

    def again(*boundaries: str, **changes: Any) -> Job:
        root = tmp_path_factory.mktemp("again")
        shutil.copytree(small_job.processed, root / "processed")
        folders = {"processed": root / "processed", "reports": root / "reports"}
        job = replace(
            small_job, root=root, campaign=manifest.parse(raw_manifest(**changes)), **folders
        )
        for product in (FIT, RESULTS) if boundaries else ():
            content = job.read_json(product)
            kept = {b: content["boundaries"][b] for b in boundaries}
            job.write(product, content | {"boundaries": kept})
        return job

    return again
