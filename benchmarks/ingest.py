"""Ingest of the paper's whole campaign, compared with a bare parse, a lab's script, and C.

nearlift digests every file, removes the tare, checks clock and samples, and takes mean, standard
error, drift and quality codes; pyarrow only parses; pandas, polars and duckdb parse and take mean
and standard deviation per file; C (two threads, its own parser of decimals, which trusts the file)
takes mean and standard deviation of tare and live part.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from benchmarks import _compiled, _paper
from benchmarks.harness import Bench, Contestant, Target

SOURCE = r"""
#include <dirent.h>
#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
static char **names; static long files; static atomic_long next; static const char *folder; static double total;
static const double power[19] = {1, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18};
static inline double number(const char **at) {
    const char *c = *at; int negative = *c == '-', down = 0; unsigned long m = 0;
    c += negative;
    while (*c >= '0') m = 10 * m + (*c++ - '0');
    if (*c == '.') { const char *p = ++c; while (*c >= '0') m = 10 * m + (*c++ - '0'); down = c - p; }
    *at = c;
    return (negative ? -1.0 : 1.0) * m / power[down];
}
static void *work(void *unused) {
    char *text = 0; size_t room = 0; double sum = 0;
    for (long i; (i = atomic_fetch_add(&next, 1)) < files;) {
        char path[4096]; struct stat s;
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        int f = open(path, O_RDONLY); fstat(f, &s);
        if ((size_t)s.st_size + 1 > room) text = realloc(text, room = s.st_size + 1);
        for (size_t got = 0; got < (size_t)s.st_size;) got += read(f, text + got, s.st_size - got);
        close(f); text[s.st_size] = 0;
        const char *at = strchr(text, '\n') + 1;
        double n[2] = {0}, mean[2] = {0}, square[2] = {0};
        while (*at) {
            const double t = number(&at); at++;
            const double x = number(&at); at++;
            const int part = t >= 1.9995; const double d = x - mean[part];
            n[part]++; mean[part] += d / n[part]; square[part] += d * (x - mean[part]);
        }
        sum += mean[1] - mean[0] + sqrt(square[1] / (n[1] - 1));
    }
    double *answer = malloc(sizeof *answer); *answer = sum;
    return answer;
}
int main(int argc, char **argv) {
    folder = argv[1];
    DIR *d = opendir(folder);
    for (struct dirent *e; (e = readdir(d));)
        if (e->d_name[0] != '.') { names = realloc(names, (files + 1) * sizeof *names); names[files++] = strdup(e->d_name); }
    pthread_t thread[2]; void *answer;
    for (int i = 0; i < 2; i++) pthread_create(thread + i, 0, work, 0);
    for (int i = 0; i < 2; i++) { pthread_join(thread[i], &answer); total += *(double *)answer; }
    printf("%ld files, %.6f\n", files, total);
    return 0;
}
"""
#: The scale is written into a file, so that contestants know whether this is a quick look.
WHICH = "ingest-campaign"


def prepare(data: Path, quick: bool) -> str:
    folder = _paper.campaign(data, 0.1 if quick else 1.0)
    (data / WHICH).write_text(folder.name)
    _compiled.program(data, "ingest-peer", SOURCE)
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


def pandas(data: Path) -> dict[str, Any]:
    import pandas as pd

    whole = pd.concat([pd.read_csv(path).assign(trial=Path(path).stem) for path in paths(data)])
    table = whole[whole.t >= _paper.TARE].groupby("trial").force.agg(["mean", "std"])
    return {"trials": len(table)}


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
    table = db.sql(
        f"select filename, avg(force), stddev(force) from {files} where t >= {_paper.TARE} group by"
        " filename"
    ).fetchall()
    return {"trials": len(table)}


C = Contestant(
    name="c",
    title="C, two threads",
    command=lambda data: [str(data / "ingest-peer"), str(campaign(data) / "trials")],
)
BENCH = Bench(
    title="Ingest of the paper's whole campaign",
    prepare=prepare,
    one="pyarrow",
    contestants=(
        Contestant(name="pyarrow", title="pyarrow, bare parse, two outer threads", run=pyarrow),
        Contestant(name="nearlift", title="nearlift, digest and statistics", run=nearlift),
        *([C] if _compiled.compiler() else []),
        Contestant(name="duckdb", title="duckdb, mean and deviation", run=duckdb, rounds=2),
        Contestant(name="polars", title="polars, mean and deviation", run=polars, rounds=2),
        Contestant(name="pandas", title="pandas, concat and groupby", run=pandas, rounds=1),
    ),
    targets=(
        Target(
            work="CSV ingest over pyarrow's bare parse on two threads",
            ours="nearlift",
            peer="pyarrow",
            must=0.6,
        ),
        Target(
            work="CSV ingest over pyarrow's bare parse on two threads",
            ours="nearlift",
            peer="pyarrow",
            quantity="cpu_s",
            must=0.6,
        ),
        Target(work="CSV ingest over C", ours="nearlift", peer="c", must=5.0, aim=1.5),
        Target(work="CSV ingest", ours="nearlift", quantity="peak_MiB", must=250.0),
    ),
)
