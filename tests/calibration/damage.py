"""Damage done to files of every format, 200 truncations and 200 flipped bits, and what nearlift and
others make of it.

Run as ``python -m tests.calibration.damage``, with the sections wanted (files, rows, tare; all if
none is named); it writes docs/damage.md. A truncation or a flip is *silent* when the reader gives
another number of samples, or other samples, than were written, without an error and without a mark.
"""

from __future__ import annotations

import gzip
import io
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tests.calibration import records
from tests.readers.reading import of_trials
from tests.readers.test_files import xlsx
from tests.unit import manifests, written

from nearlift import readers
from nearlift.errors import NearliftError
from nearlift.readers.base import Malformed, pick
from nearlift.run import tables
from nearlift.stages.ingest import TRIALS

TRIES = 200
#: What nearlift may raise over a damaged file: its own refusal, or that of the guarded process.
KNOWN = (NearliftError, Malformed)
SAMPLES = 400
FORCE = [round(float(x), 4) for x in np.random.default_rng(8).normal(250.0, 3.0, SAMPLES)]
#: What came of one damaged file: the right samples, refused or rejected, read with a mark, silently
#: fewer, silently others.
OUTCOMES = ("intact", "refused", "marked", "short", "wrong")

Read = Callable[[Path], tuple[Sequence[float], Sequence[str]]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """One format as one program reads it: the bytes, and a reading that gives samples and marks or
    raises.
    """

    format: str
    program: str
    content: bytes
    read: Read
    planned: bool = False


def outcome(subject: Subject, path: Path) -> str:
    """What the program makes of the file."""
    # another exception of ours is a fault of the program; libraries may raise anything
    known = KNOWN if subject.program.startswith("nearlift") else Exception
    try:
        found, marks = subject.read(path)
    except known:
        return "refused"
    if set(marks) & {"EMPTY", "NO_DATA"}:
        return "refused"
    want = np.array(FORCE)
    found = np.asarray(found, dtype=float)
    if len(found) != len(want) and subject.planned and "nearlift" in subject.program:
        # the manifest's `record` tells the number of samples
        return "marked"
    if marks:
        return "marked"
    if len(found) < len(want) and np.array_equal(found, want[: len(found)]):
        return "short"
    return "intact" if np.array_equal(found, want) else "wrong"


def damaged(content: bytes, how: str, seed: int) -> list[bytes]:
    """The content cut at random places, or with one bit flipped at each."""
    rng = np.random.default_rng(seed)
    if how == "cut":
        return [content[: int(at)] for at in rng.integers(1, len(content), TRIES)]
    found = []
    for at, bit in zip(
        rng.integers(0, len(content), TRIES), rng.integers(0, 8, TRIES), strict=True
    ):
        spoilt = bytearray(content)
        spoilt[at] ^= 1 << int(bit)
        found.append(bytes(spoilt))
    return found


def tally(subject: Subject, how: str, folder: Path) -> Counter[str]:
    """How often each outcome came of all tries."""
    path = folder / f"damaged{Path(subject.format.split()[-1]).suffix}"
    count: Counter[str] = Counter()
    for content in damaged(subject.content, how, seed=len(subject.format)):
        path.write_bytes(content)
        count[outcome(subject, path)] += 1
    return count


def ours(name: str, column: str, dialect: dict[str, Any] | None = None) -> Read:
    """Nearlift's own reader of that name."""
    form = readers.reader(name)

    def by_format(path: Path) -> tuple[Sequence[float], Sequence[str]]:
        if path.stat().st_size == 0:
            return [], ("EMPTY",)
        found = form.open(path, dialect or {}, (column,))
        if not found.channels:
            return [], found.codes
        return list(pick(found.channels, column, "k", "f").values), found.codes

    return by_format


def pandas_csv(path: Path) -> tuple[Sequence[float], Sequence[str]]:
    import pandas as pd

    frame = pd.read_csv(path)
    values = frame["force"]
    # a column that became text would stop any arithmetic
    return values.to_numpy(dtype=float), ()


def arrow_csv(path: Path) -> tuple[Sequence[float], Sequence[str]]:
    import pyarrow.csv as pc

    return pc.read_csv(path)["force"].to_numpy().astype(float), ()


def bare_tdms(path: Path) -> tuple[Sequence[float], Sequence[str]]:
    import nptdms

    return nptdms.TdmsFile.read(io.BytesIO(path.read_bytes()))["daq"]["force"][:], ()


def bare_mat(path: Path) -> tuple[Sequence[float], Sequence[str]]:
    import scipy.io

    return scipy.io.loadmat(path)["run"]["force"][0, 0].reshape(-1), ()


def bare_hdf5(path: Path) -> tuple[Sequence[float], Sequence[str]]:
    import h5py

    with h5py.File(path) as file:
        return file["daq/force"][()], ()


def bare_parquet(path: Path) -> tuple[Sequence[float], Sequence[str]]:
    import pandas as pd

    return pd.read_parquet(path)["lift_N"].to_numpy(), ()


def own_product(path: Path) -> tuple[Sequence[float], Sequence[str]]:
    return tables.read_table(path, TRIALS)["lift_N"], ()


def long_table(checksum: bool) -> bytes:
    """The series as the one trial of a long Parquet table, as pyarrow's defaults write it or with
    page checksums.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = pa.BufferOutputStream()
    pq.write_table(
        pa.table({"trial": ["t"] * len(FORCE), "force": FORCE}), sink, write_page_checksum=checksum
    )
    return bytes(sink.getvalue().to_pybytes())


def sheet_bytes() -> bytes:
    """The series as a sheet with its names above it."""
    with tempfile.TemporaryDirectory() as folder:
        rows = [("t", "force"), *((i / 1000, force) for i, force in enumerate(FORCE))]
        return xlsx(Path(folder) / "a.xlsx", rows).read_bytes()


def by_campaign(path: Path) -> tuple[Sequence[float], Sequence[str]]:
    """Nearlift's reading of a long table; a trial that is not there any more is rejected as
    MISSING.
    """
    force = {"column": "force", "unit": "N", "sign": 1}
    campaign = manifests.manifest(records={"reader": "parquet", "files": path.name, "force": force})
    found = of_trials("parquet", campaign, path.parent, ["t"])
    return (found[0].force_N, found[0].codes) if found else ([], ("NO_DATA",))


def product_bytes(checksum: bool) -> bytes:
    """The series as a product of ours, or as Parquet's defaults would write it."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    n = len(FORCE)
    kinds: dict[str, Any] = {
        "text": lambda: np.full(n, "x", dtype=object),
        "real": lambda: np.zeros(n),
        "integer": lambda: np.zeros(n, dtype=np.int64),
    }
    table = {c.name: kinds[c.kind]() for c in TRIALS.columns} | {"lift_N": np.array(FORCE)}
    if checksum:
        return tables.table_bytes(table, TRIALS)
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table({"lift_N": np.array(FORCE)}), sink)
    return bytes(sink.getvalue().to_pybytes())


def subjects() -> list[Subject]:
    """Every format as nearlift reads it, and as the usual library does."""
    column = {name: column for name, (_, column, _, _) in written.WRITERS.items()}
    titles = {
        "csv": "plain CSV",
        "text": "text, UTF-16, decimal commas",
        "rcbenchmark": "RCbenchmark CSV",
        "flight-stand": "Flight Stand CSV",
        "crazyflie": "Crazyflie CSV",
        "lvm": "LVM",
        "tdms": "TDMS",
        "mat": "MATLAB v7",
        "hdf5": "HDF5",
    }
    found = [
        Subject(
            format=titles[name],
            program="nearlift",
            content=written.WRITERS[name][0](FORCE),
            read=ours(name, column[name]),
        )
        for name in titles
    ]
    planned = [
        Subject(
            format=s.format,
            program="nearlift, `record` given",
            content=s.content,
            read=s.read,
            planned=True,
        )
        for s in found
        if s.format not in ("MATLAB v7", "HDF5")
    ]
    own_mat = ours("mat", "run.force")
    own_hdf5 = ours("hdf5", "/daq/force")
    plain, sums = written.mat(FORCE, compressed=False), written.hdf5(FORCE, fletcher=True)
    found += [
        Subject(
            format="MATLAB v5, not compressed", program="nearlift", content=plain, read=own_mat
        ),
        Subject(
            format="MATLAB v7.3",
            program="nearlift",
            content=written.v73(FORCE),
            read=ours("mat", "force"),
        ),
        Subject(format="HDF5 with fletcher32", program="nearlift", content=sums, read=own_hdf5),
        Subject(
            format="our own products",
            program="nearlift",
            content=product_bytes(True),
            read=own_product,
        ),
    ]
    found += [
        Subject(
            format="CSV in gzip",
            program="nearlift",
            content=gzip.compress(written.csv(FORCE), mtime=0),
            read=ours("csv", "force"),
        ),
        Subject(
            format="first sheet of a.xlsx",
            program="nearlift",
            content=sheet_bytes(),
            read=ours("sheet", "force"),
        ),
    ]
    plain_table, summed_table = long_table(False), long_table(True)
    found += [
        Subject(
            format="Parquet, defaults", program="nearlift", content=plain_table, read=by_campaign
        ),
        Subject(
            format="Parquet with page checksums",
            program="nearlift",
            content=summed_table,
            read=by_campaign,
        ),
    ]
    csv, tdms = written.csv(FORCE), written.tdms(FORCE)
    others = [
        Subject(format="plain CSV", program="pandas", content=csv, read=pandas_csv),
        Subject(format="plain CSV", program="pyarrow", content=csv, read=arrow_csv),
        Subject(format="TDMS", program="nptdms", content=tdms, read=bare_tdms),
        Subject(format="MATLAB v5, not compressed", program="scipy", content=plain, read=bare_mat),
        Subject(format="MATLAB v7", program="scipy", content=written.mat(FORCE), read=bare_mat),
        Subject(format="HDF5", program="h5py", content=written.hdf5(FORCE), read=bare_hdf5),
        Subject(format="HDF5 with fletcher32", program="h5py", content=sums, read=bare_hdf5),
        Subject(
            format="Parquet, defaults",
            program="pandas",
            content=product_bytes(False),
            read=bare_parquet,
        ),
    ]
    return found + planned + others


def table(folder: Path) -> dict[tuple[str, str, str], Counter[str]]:
    """(format, program, how) to outcomes."""
    return {
        (s.format, s.program, how): tally(s, how, folder)
        for s in subjects()
        for how in ("cut", "flip")
    }


def page(found: dict[tuple[str, str, str], Counter[str]]) -> str:
    """docs/damage.md."""
    head = f"""# Damaged files

{SAMPLES} samples in each format; {TRIES} copies cut at random places and {TRIES} with one bit flipped, each read by nearlift and by the usual library. *Refused*: an error, or
the trial is rejected. *Marked*: read, with a quality code. *Short* and *wrong*: fewer samples or other numbers, undetected. *Intact*: the samples are unchanged.
Made by `python -m tests.calibration.damage`; `make calibrate` tests these promises:

- A cut file is never short undetected if its format has a length or a checksum, or `[load_cell] record` states the length.
- No flipped bit passes in nearlift's own products.
- In outside formats without a checksum a flipped bit before ingest is not detectable; `sha256sum -c` detects it. After ingest, the SHA-256 of every input detects it; `nearlift run --check` hashes all.

| format | read by | cut: refused | marked | short | wrong | intact | bit: refused | marked | short | wrong | intact |
|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|
"""
    rows = []
    for fmt, program in dict.fromkeys(
        (f, p)
        for f, p, _ in sorted(found, key=lambda k: (k[0].casefold(), k[1] != "nearlift", k[1]))
    ):
        cells = [
            str(found[fmt, program, how][name])
            for how in ("cut", "flip")
            for name in ("refused", "marked", "short", "wrong", "intact")
        ]
        rows.append(f"| {fmt} | {program} | {' | '.join(cells)} |")
    return head + "\n".join(rows) + "\n"


def rows_page(found: dict[tuple[str, str], Counter[str]]) -> str:
    """The section of docs/damage.md on bytes and sectors."""
    head = f"""## From bytes to a row

A record of {records.TARE} and {records.LIVE} samples in each format; {records.FLIPS} copies with one byte replaced and {records.SECTORS} with one damaged sector of {records.SECTOR} bytes, each reduced as by `nearlift ingest`. Every
copy gets a row. *Reported*: by a quality code. *Within u*: undetected, and the lift is right within its standard error. *Silent*: undetected and wrong.

| format | byte: rejected | reported | within u | silent | sector: rejected | reported | within u | silent |
|---|--:|--:|--:|--:|--:|--:|--:|--:|
"""
    rows = []
    for name in dict.fromkeys(name for name, _ in found):
        cells = [
            str(found[name, kind][fate]) for kind in ("flip", "sector") for fate in records.FATES
        ]
        rows.append(f"| `{name}` | {' | '.join(cells)} |")
    return head + "\n".join(rows) + "\n"


def tare_page(folder: Path, alarms: int) -> str:
    """The section of docs/damage.md on the tare."""
    head = """## The tare

100 glitches of each kind in a tare of 2 s at 1000, 100, 20 and 4 Hz: lift 0.2 N, white noise of 2 mN. *Silent*: no code, and the lift is off by more than its standard error. The last
column is the largest undetected shift. No damage is longer than a third of the tare.

| glitch | samples | reported | of these rejected | silent | largest undetected shift |
|---|--:|--:|--:|--:|--:|
"""
    rows = []
    for name, glitch in records.GLITCHES.items():
        for rate_Hz, n in records.TARES:
            told = records.tare_glitches(rate_Hz, n, glitch)
            rows.append(
                f"| {name} | {n} | {told.told} | {told.rejected} | {told.silent} |"
                f" {told.largest:.2f} u |"
            )
    told, most = records.on_the_coefficient(folder)
    middle = f"""
A tare of fewer than 20 samples reveals single damaged samples only, and ingest notes it.

In a campaign of 112 trials one tare was damaged, {told.tries} times over: {told.told} were reported, {told.rejected} of them rejected. `K_b` moved by at most {told.largest:.2g} of its u undetected, by at
most {most:.2g} u where reported.

Clean tares that are flagged, of {alarms} each:

| noise | {" | ".join(f"{n} samples" for _, n in records.TARES)} |
|---|{"--:|" * len(records.TARES)}
"""
    flagged = records.false_alarms(alarms)
    names = dict.fromkeys(name for name, _ in flagged)
    last = [
        f"| {name} | {' | '.join(str(flagged[name, n][0]) for _, n in records.TARES)} |"
        for name in names
    ]
    return head + "\n".join(rows) + "\n" + middle + "\n".join(last) + "\n"


def put(section: str) -> None:
    """Replace that section of docs/damage.md, or all before the first one."""
    path = Path(__file__).parents[2] / "docs" / "damage.md"
    parts = re.split(r"(?m)^(?=## )", path.read_text(encoding="utf-8"))
    title = section.splitlines()[0] if section.startswith("## ") else ""
    at = next(
        (i for i, part in enumerate(parts) if part.splitlines()[0] == title),
        0 if not title else None,
    )
    if at is None:
        parts.insert(1, section + "\n")
    else:
        parts[at] = section + "\n"
    path.write_text("".join(parts).rstrip("\n") + "\n", encoding="utf-8")


def main(which: Sequence[str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        if "files" in which:
            put(page(table(Path(folder))))
        if "tare" in which:
            put(tare_page(Path(folder) / "campaign", 20000))
        if "rows" in which:
            put(rows_page(records.bytes_to_rows(Path(folder) / "rows")))


if __name__ == "__main__":
    main(sys.argv[1:] or ("files", "tare", "rows"))
