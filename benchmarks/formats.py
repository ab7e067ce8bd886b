"""Ingest of Parquet, TDMS and HDF5 beside a bare read of the same files by the library that knows them, on two threads where it can.

A tenth of the paper's campaign: one long Parquet table; one TDMS or HDF5 file for each trial, force and clock. TDMS and HDF5 are read in a child
process, which may crash without taking the run along; the bare reads trust the files.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks import _paper
from benchmarks.harness import Bench, Contestant, Target


def prepare(data: Path, quick: bool) -> str:
    source = _paper.campaign(data, 0.1)
    for form in ("parquet", "tdms", "hdf5"):
        folder = data / f"paper-0.1-{form}"
        if not folder.exists():
            convert(source, folder, form)
    sizes = {form: sum(f.stat().st_size for f in (data / f"paper-0.1-{form}").rglob("*") if f.is_file()) / 1e6 for form in LIBRARIES}
    return (
        _paper.spoken(source).replace("CSV files (`t,force`)", "trials")
        + " "
        + ", ".join(f"{form} {size:.0f} MB" for form, size in sizes.items())
        + "."
    )


def convert(source: Path, folder: Path, form: str) -> None:
    """The same campaign in another format."""
    import shutil

    import numpy as np

    (folder / "trials").mkdir(parents=True)
    shutil.copy(source / "trials.csv", folder)
    files = sorted((source / "trials").glob("*.csv"))
    series = {path.stem: np.loadtxt(path, delimiter=",", skiprows=1).T for path in files}
    manifest = (source / "campaign.toml").read_text()
    if form == "parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pa.table(
            {
                "trial": pa.array(np.repeat(list(series), [s.shape[1] for s in series.values()])).dictionary_encode(),
                "t": np.concatenate([s[0] for s in series.values()]),
                "force": np.concatenate([s[1] for s in series.values()]),
            }
        )
        pq.write_table(table, folder / "records.parquet", row_group_size=150 * 12000)
        manifest = manifest.replace("trials/{trial}.csv", "records.parquet")
    for trial, (t, force) in series.items() if form == "hdf5" else ():
        import h5py

        with h5py.File(folder / "trials" / f"{trial}.h5", "w") as file:
            file["t"], file["force"] = t, force
    for trial, (t, force) in series.items() if form == "tdms" else ():
        import nptdms

        with nptdms.TdmsWriter(folder / "trials" / f"{trial}.tdms") as writer:
            writer.write_segment([nptdms.ChannelObject("rig", "t", t), nptdms.ChannelObject("rig", "force", force)])
    manifest = manifest.replace('reader = "csv"', f'reader = "{form}"').replace("{trial}.csv", "{trial}." + {"hdf5": "h5"}.get(form, form))
    (folder / "campaign.toml").write_text(manifest)


def ours(form: str) -> Any:
    return lambda data: _paper.ingest(data / f"paper-0.1-{form}")


def bare_parquet(data: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pa.set_cpu_count(2)
    pq.read_table(data / "paper-0.1-parquet" / "records.parquet")


def bare_hdf5(data: Path) -> None:
    import h5py

    for path in sorted((data / "paper-0.1-hdf5" / "trials").iterdir()):
        with h5py.File(path, "r") as file:
            file["t"][()], file["force"][()]


def bare_tdms(data: Path) -> None:
    import nptdms

    def read(path: Path) -> None:
        with nptdms.TdmsFile.open(path) as file:
            for channel in file["rig"].channels():
                channel[:]

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(read, sorted((data / "paper-0.1-tdms" / "trials").iterdir())))


LIBRARIES = {"parquet": ("pyarrow", bare_parquet), "tdms": ("npTDMS", bare_tdms), "hdf5": ("h5py", bare_hdf5)}
BENCH = Bench(
    title="Ingest of Parquet, TDMS and HDF5",
    prepare=prepare,
    one="parquet",
    rounds=3,
    contestants=tuple(
        c
        for form, (library, bare) in LIBRARIES.items()
        for c in (
            Contestant(name=form, title=f"{library}, bare read of {form}", run=bare),
            Contestant(name=f"nearlift-{form}", title=f"nearlift, {form}", run=ours(form)),
        )
    ),
    targets=tuple(
        Target(work=f"{form} ingest over {library}'s bare read", ours=f"nearlift-{form}", peer=form, must=must)
        for (form, (library, _)), must in zip(LIBRARIES.items(), (4.0, 4.0, 4.0), strict=True)
    ),
)
