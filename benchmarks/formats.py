"""Ingest of 1200 records in CSV, TDMS, HDF5 and Parquet, compared with a bare read by each format's
library.

A third of the paper's campaign: one column of whole numbers in CSV, as a converter's logger prints
them; one TDMS or HDF5 file for each trial, force and clock; one long Parquet table. Whole
processes, as somebody would start them: `nearlift ingest` as it comes, and a loop over the files.
TDMS and HDF5 are read in a child process, which may crash without taking the run along; the bare
reads trust the files.
"""

from __future__ import annotations

import shutil
import sys
from functools import partial
from pathlib import Path

from benchmarks import _paper
from benchmarks.harness import Bench, Contestant, Target, command_line

WHICH = "formats-scale"
#: What a count of the integer records is worth, mN.
COUNT_MN = 0.01
#: Library, the most that ingest may cost over it, and its bare read.
PEERS = {
    "csv": (
        "pandas",
        1.0,
        "import pandas as library\nfor file in files: library.read_csv(file)",
    ),
    "tdms": (
        "npTDMS",
        2.5,
        (
            "import nptdms\nfor file in files:\n    with nptdms.TdmsFile.open(file) as tdms:\n     "
            "   for channel in tdms['rig'].channels(): channel[:]"
        ),
    ),
    "hdf5": (
        "h5py",
        2.5,
        (
            "import h5py\nfor file in files:\n    with h5py.File(file, 'r') as hdf5: hdf5['t'][()],"
            " hdf5['force'][()]"
        ),
    ),
    "parquet": (
        "pyarrow",
        4.0,
        "import pyarrow.parquet as library\nfor file in files: library.read_table(file)",
    ),
}


def prepare(data: Path, quick: bool) -> str:
    scale = 0.1 if quick else 1 / 3
    (data / WHICH).write_text(f"{scale:g}")
    source = _paper.campaign(data, scale)
    for form in PEERS:
        if not campaign(data, form).exists():
            convert(source, campaign(data, form), form)
    sizes = {form: sum(file.stat().st_size for file in records(data, form)) / 1e6 for form in PEERS}
    count = len(list((source / "trials").iterdir()))
    listed = ", ".join(f"{form} {size:.0f} MB" for form, size in sizes.items())
    return f"{count} records of 12 s at 1 kHz ({listed}), page cache warm, whole processes."


def campaign(data: Path, form: str) -> Path:
    return data / f"formats-{(data / WHICH).read_text()}-{form}"


def records(data: Path, form: str) -> list[Path]:
    folder = campaign(data, form)
    return (
        [folder / "records.parquet"] if form == "parquet" else sorted((folder / "trials").iterdir())
    )


def convert(source: Path, folder: Path, form: str) -> None:
    """The same campaign in another format."""
    import numpy as np

    (folder / "trials").mkdir(parents=True)
    shutil.copy(source / "trials.csv", folder)
    series = {
        path.stem: np.loadtxt(path, delimiter=",", skiprows=1).T
        for path in sorted((source / "trials").glob("*.csv"))
    }
    manifest = (source / "campaign.toml").read_text()
    if form == "parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pa.table(
            {
                "trial": (
                    pa.array(
                        np.repeat(list(series), [s.shape[1] for s in series.values()])
                    ).dictionary_encode()
                ),
                "t": np.concatenate([s[0] for s in series.values()]),
                "force": np.concatenate([s[1] for s in series.values()]),
            }
        )
        pq.write_table(table, folder / "records.parquet", row_group_size=150 * 12000)
        manifest = manifest.replace("trials/{trial}.csv", "records.parquet")
    if form == "csv":
        counts = (
            f'unit = "count", sign = 1, calibration = {{ gain = "{COUNT_MN:g} mN/count", offset ='
            ' "0 count" } }'
        )
        manifest = manifest.replace('unit = "mN", sign = 1 }', counts).replace(
            'time   = { column = "t", unit = "s" }\n', ""
        )
    for trial, (t, force) in series.items():
        if form == "csv":
            lines = ["force", *map(str, np.round(force / COUNT_MN).astype(int).tolist())]
            (folder / "trials" / f"{trial}.csv").write_text("\n".join(lines) + "\n")
        if form == "hdf5":
            import h5py

            with h5py.File(folder / "trials" / f"{trial}.h5", "w") as file:
                file["t"], file["force"] = t, force
        if form == "tdms":
            import nptdms

            with nptdms.TdmsWriter(folder / "trials" / f"{trial}.tdms") as writer:
                writer.write_segment(
                    [
                        nptdms.ChannelObject("rig", "t", t),
                        nptdms.ChannelObject("rig", "force", force),
                    ]
                )
    manifest = manifest.replace('reader = "csv"', f'reader = "{form}"').replace(
        "{trial}.csv", "{trial}." + {"hdf5": "h5"}.get(form, form)
    )
    (folder / "campaign.toml").write_text(manifest)


def bare(data: Path, form: str) -> list[str]:
    files = "import sys, glob\nfiles = sorted(glob.glob(sys.argv[1]))\n"
    pattern = str(records(data, form)[0].with_stem("*"))
    return [sys.executable, "-c", files + PEERS[form][2], pattern]


def nearlift(data: Path, form: str) -> list[str]:
    """A first ingest, which begins with nothing."""
    out = data / "formats-out" / form
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    return command_line("ingest", str(campaign(data, form)), "--out", str(out), "-q")


BENCH = Bench(
    title="Ingest of CSV, TDMS, HDF5 and Parquet, whole process",
    prepare=prepare,
    one="csv",
    # a quiet machine is not: five turns differ by a tenth
    rounds=15,
    contestants=tuple(
        c
        for form, (library, _, _) in PEERS.items()
        for c in (
            Contestant(
                name=form,
                title=f"{library}, bare read of {form}",
                command=partial(bare, form=form),
            ),
            Contestant(
                name=f"nearlift-{form}",
                title=f"nearlift, {form}",
                command=partial(nearlift, form=form),
            ),
        )
    ),
    targets=tuple(
        Target(
            work=f"{form} ingest of 1200 records over a bare read by {library}",
            ours=f"nearlift-{form}",
            peer=form,
            quantity=quantity,
            must=must,
        )
        for form, (library, must, _) in PEERS.items()
        for quantity in ("wall_s", "cpu_s")
    ),
)
