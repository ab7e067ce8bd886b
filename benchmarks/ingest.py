"""Ingest of the paper's whole campaign, compared with a bare parse and a lab's script.

nearlift digests every file, removes the tare, checks clock and samples, and takes mean, standard
error, drift and quality codes; pandas and pyarrow only parse; polars and duckdb parse and take mean
and standard deviation per file.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from benchmarks import _paper
from benchmarks.harness import Bench, Contestant, Target

#: The scale is written into a file, so that contestants know whether this is a quick look.
WHICH = "ingest-campaign"


def prepare(data: Path, quick: bool) -> str:
    folder = _paper.campaign(data, 0.1 if quick else 1.0)
    (data / WHICH).write_text(folder.name)
    return _paper.spoken(folder)


def campaign(data: Path) -> Path:
    return data / (data / WHICH).read_text()


def nearlift(data: Path) -> None:
    _paper.ingest(campaign(data))


def paths(data: Path) -> list[str]:
    return sorted(e.path for e in os.scandir(campaign(data) / "trials"))


def pyarrow(data: Path) -> None:
    from concurrent.futures import ThreadPoolExecutor

    import pyarrow as pa
    import pyarrow.csv as pc

    pa.set_cpu_count(1)
    options = pc.ReadOptions(use_threads=False)
    with ThreadPoolExecutor(2) as pool:
        sum(
            pool.map(
                lambda path: int(pc.read_csv(path, read_options=options).num_rows), paths(data)
            )
        )


def pandas(data: Path) -> None:
    import pandas as pd

    for path in paths(data):
        pd.read_csv(path)


def polars(data: Path) -> dict[str, Any]:
    import polars as pl

    live = pl.scan_csv(f"{campaign(data)}/trials/*.csv", include_file_paths="file").filter(
        pl.col("t") >= _paper.TARE
    )
    table = (
        live.group_by("file")
        .agg(pl.col("force").mean().alias("mean"), pl.col("force").std().alias("sd"))
        .collect()
    )
    return {"trials": len(table)}


def duckdb(data: Path) -> dict[str, Any]:
    import duckdb as db

    db.sql("set threads = 2")
    files = f"read_csv('{campaign(data)}/trials/*.csv', filename = true)"
    table = db.execute(
        f"select filename, avg(force), stddev(force) from {files} where t >= {_paper.TARE} group by"
        " filename"
    ).fetchall()
    return {"trials": len(table)}


BENCH = Bench(
    title="Ingest of the paper's whole campaign",
    prepare=prepare,
    one="pyarrow",
    contestants=(
        Contestant(name="pyarrow", title="pyarrow, bare parse, two outer threads", run=pyarrow),
        Contestant(name="nearlift", title="nearlift, digest and statistics", run=nearlift),
        Contestant(name="duckdb", title="duckdb, mean and deviation", run=duckdb, rounds=2),
        Contestant(name="polars", title="polars, mean and deviation", run=polars, rounds=2),
        Contestant(name="pandas", title="pandas, bare read_csv", run=pandas),
    ),
    targets=(
        Target(
            work="CSV ingest over pandas' bare read_csv", ours="nearlift", peer="pandas", must=1.0
        ),
        Target(work="CSV ingest", ours="nearlift", quantity="peak_MiB", must=250.0),
    ),
)
