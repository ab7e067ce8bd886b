"""Damage on its way from a record's bytes to a trial's row: flipped bytes, damaged sectors and cuts in
files of every format, glitches in the tare.

    python -m tests.calibration.damage        writes the tables of docs/damage.md

A trial is *reported* by any quality code. It is *silent* where its lift differs from that of the
whole file by more than its u, without a code.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import lfilter
from tests.calibration.bench import Array
from tests.calibration.figures import table, write
from tests.unit import written
from tests.unit.manifests import manifest

from nearlift.campaign.manifest import Campaign
from nearlift.readers import reader, rows
from nearlift.reduction.quality import joined, rejected
from nearlift.reduction.record import Reduced, reduce_record
from nearlift.reduction.samples import Conditions

#: How many damages of each kind.
TRIES = {"byte": 200, "sector": 100, "cut": 100}
SECTOR = 512
RATE, TARE, LIVE = 1000.0, 200, 1000
#: A record in the unit of its file: 7 of zero, then a lift of 200.
FORCE = [
    round(float(x), 4)
    for x in (
        7
        + 200 * (np.arange(TARE + LIVE) >= TARE)
        + 2 * np.random.default_rng(9).standard_normal(TARE + LIVE)
    )
]
#: What became of a trial.
FATES = ("rejected", "reported", "within u", "silent")


def flipped(content: bytes, rng: np.random.Generator) -> bytes:
    """One byte replaced by another."""
    changed = bytearray(content)
    changed[rng.integers(len(content))] ^= int(rng.integers(1, 256))
    return bytes(changed)


def sector(content: bytes, rng: np.random.Generator) -> bytes:
    """A sector zeroed, full of noise, or that of another place."""
    start = SECTOR * int(rng.integers((len(content) - 1) // SECTOR + 1))
    size = min(SECTOR, len(content) - start)
    other = int(rng.integers(max(1, len(content) - size)))
    new = (bytes(size), rng.bytes(size), content[other : other + size])[int(rng.integers(3))]
    return content[:start] + new + content[start + size :]


def cut(content: bytes, rng: np.random.Generator) -> bytes:
    """The content up to some place."""
    return content[: int(rng.integers(1, len(content)))]


def damages(content: bytes, tries: dict[str, int]) -> Iterator[tuple[str, bytes]]:
    """Copies of a file, each with one damage."""
    rng = np.random.default_rng(len(content))
    for kind, change in (("byte", flipped), ("sector", sector), ("cut", cut)):
        for _ in range(tries[kind]):
            yield kind, change(content, rng)


def rig(name: str) -> Campaign:
    """A campaign of files as `tests.unit.written` writes them."""
    _, column, unit, suffix = written.WRITERS[name]
    force = {"column": column, "unit": unit, "sign": 1}
    records = {"reader": name, "files": f"{{trial}}.{suffix}", "force": force}
    if name != "csv":
        records["dialect"] = {"ignore_rate": True}
    cell = {"sample_rate": f"{RATE:g} Hz", "tare": f"{TARE / RATE:g} s", "range": None}
    return manifest(load_cell=cell, records=records)


def reduced(campaign: Campaign, folder: Path, contents: list[bytes]) -> list[rows.Row]:
    """The rows of files with these contents."""
    names = [f"t{i:04d}" for i in range(len(contents))]
    for name, content in zip(names, contents, strict=True):
        written.put(folder, str(campaign.records.files).replace("{trial}", name), content)
    pieces, _ = reader(campaign.records.reader).plan(campaign, folder, names)
    common = {"root": folder, "campaign": campaign, "tare_after_N": {}, "digests": {}}
    tasks = (rows.Task(piece=piece, **common) for piece in pieces)
    return [row for task in tasks for answer in rows.reduce_piece(task) for row in answer.rows]


def fate(row: rows.Row, lift_N: float) -> str:
    """What became of a trial whose lift should be this; `[load_cell] record` reports a length that
    is not the planned one.
    """
    codes = row["codes"]
    if rejected(np.array([joined(codes)], dtype=object))[0]:
        return "rejected"
    if codes or row["samples"] != len(FORCE):
        return "reported"
    return "within u" if abs(row["lift_N"] - lift_N) <= row["u_lift_N"] else "silent"


def bytes_to_rows(folder: Path, tries: dict[str, int] = TRIES) -> pd.DataFrame:
    """Fates of damaged files: a line for each format, columns (kind of damage, fate)."""
    columns = pd.MultiIndex.from_product([tries, FATES])
    lines = pd.DataFrame(0, index=list(written.WRITERS), columns=columns)
    for name, (save, *_) in written.WRITERS.items():
        content = save(FORCE)
        kinds, contents = zip(*damages(content, tries), strict=True)
        whole, *damaged = reduced(rig(name), folder / name, [content, *contents])
        assert not whole["codes"]
        for kind, row in zip(kinds, damaged, strict=True):
            lines.loc[name, (kind, fate(row, whole["lift_N"]))] += 1
    return lines


# ---- the tare

Glitch = Callable[[Array, np.random.Generator], Array]


def _single(tare: Array, rng: np.random.Generator) -> Array:
    tare[rng.integers(len(tare))] += rng.choice([-1, 1]) * 10 ** rng.uniform(-3, 1)
    return tare


def _five(tare: Array, rng: np.random.Generator) -> Array:
    tare[rng.integers(len(tare), size=min(5, len(tare) // 4))] += 10 ** rng.uniform(-2, 1)
    return tare


def _stretch(tare: Array, rng: np.random.Generator, length: int) -> slice:
    start = rng.integers(len(tare) - length + 1)
    return slice(start, start + length)


def _together(tare: Array, rng: np.random.Generator) -> Array:
    tare[_stretch(tare, rng, min(5, len(tare) // 4))] += 10 ** rng.uniform(-2, 1)
    return tare


def _zeroed(tare: Array, rng: np.random.Generator) -> Array:
    place = _stretch(tare, rng, min(64, len(tare) // 3))
    tare[place] = -(10 ** rng.uniform(-2, 0))  # relative to the zero of the cell
    return tare


def _stopping(tare: Array, rng: np.random.Generator) -> Array:
    return tare + 0.2 * np.exp(-np.arange(len(tare)) / (len(tare) * 10 ** rng.uniform(-2, -0.5)))


def _starting(tare: Array, rng: np.random.Generator) -> Array:
    return tare + 0.2 * (np.arange(len(tare)) > len(tare) * (1 - 10 ** rng.uniform(-2, -0.5)))


def _step(tare: Array, rng: np.random.Generator) -> Array:
    size, after = 10 ** rng.uniform(-2, 1), rng.uniform(0.1, 0.9) * len(tare)
    return tare + size * (np.arange(len(tare)) > after)


GLITCHES: dict[str, Glitch] = {
    "a sample, 1 mN to 10 N": _single,
    "five samples, scattered, 10 mN to 10 N": _five,
    "five in a row, 10 mN to 10 N": _together,
    "64 zeroed, in a cell whose zero is at 10 mN to 1 N": _zeroed,
    "rotors still stopping": _stopping,
    "rotors started too early": _starting,
    "a step of 10 mN to 10 N": _step,
}
#: Samples of a tare of 2 s.
TARES = (2000, 200, 40, 8)


def _reduced(force: Array, n: int) -> Reduced:
    return reduce_record(force, Conditions(rate_Hz=n / 2, tare_s=2.0))


def tare_glitches(n: int, glitch: Glitch, tries: int = 100) -> pd.DataFrame:
    """Glitches in a tare of n samples, a line each: lift 0.2 N, white noise of 2 mN; the shift is
    that from the same record without the glitch, in its u.
    """
    rng, lines = np.random.default_rng(n), []
    for _ in range(tries):
        force = 7e-3 + 2e-3 * rng.standard_normal(6 * n)
        force[n:] += 0.2
        damaged = _reduced(np.concatenate([glitch(force[:n].copy(), rng), force[n:]]), n)
        shift = abs(damaged.lift_N - _reduced(force, n).lift_N) / damaged.u_lift_N
        lines.append(
            {
                "reported": bool(damaged.codes),
                "of these rejected": any(code.isupper() for code in damaged.codes),
                "silent": shift > 1 and not damaged.codes,
                "undetected": 0.0 if damaged.codes else shift,
            }
        )
    return pd.DataFrame(lines)


#: Noises of clean tares: correlation, hum and converter step, in its standard deviation.
NOISES: dict[str, tuple[float, float, float]] = {
    "white": (0.0, 0.0, 0.0),
    "AR(1) at 0.9": (0.9, 0.0, 0.0),
    "50 Hz of 10 times the noise": (0.0, 14.0, 0.0),
    "a step of the converter as large as the noise": (0.0, 0.0, 1.0),
    "ten times as large": (0.0, 0.0, 10.0),
}


def false_alarms(tries: int) -> pd.DataFrame:
    """How many clean tares are flagged: lines of noise, columns of samples."""
    rng, counts = np.random.default_rng(4), {}
    for n in TARES:
        clock = 2 * np.arange(n) / n
        for name, (correlation, hum, step) in NOISES.items():
            flagged = 0
            for _ in range(tries):
                force = rng.standard_normal(3 * n + 200)
                if correlation:
                    force = lfilter([(1 - correlation**2) ** 0.5], [1, -correlation], force)
                force = force[200:]
                if hum:
                    force[:n] += hum * np.sin(2 * np.pi * (50 * clock + rng.random()))
                force[n:] += 1e4  # so large that no drift of the live part is one
                if step:
                    force = step * np.round(force / step + rng.random())
                codes = {*_reduced(force, n).codes}
                alarms = codes & {"TARE", "drift", "DRIFT", "spikes"}
                flagged += "STUCK" not in codes and bool(alarms)
            counts[name, n] = flagged
    return pd.Series(counts).unstack(sort=False)


def main(alarms: int = 20000) -> None:
    """Write the tables of docs/damage.md."""
    page = Path(__file__).parents[2] / "docs" / "damage.md"
    glitches = [
        {"glitch": name, "samples": n}
        | {c: int(made[c].sum()) for c in ("reported", "of these rejected", "silent")}
        | {"largest undetected shift": f"{made['undetected'].max():.2f} u"}
        for name, glitch in GLITCHES.items()
        for n in TARES
        for made in [tare_glitches(n, glitch)]
    ]
    with tempfile.TemporaryDirectory() as folder:
        fates = bytes_to_rows(Path(folder))
    fates.columns = [f"{kind}: {f}" if f == FATES[0] else f for kind, f in fates.columns]
    fates = fates.set_axis([f"`{name}`" for name in fates.index]).reset_index(names="format")
    write(page, "rows", table(fates))
    write(page, "tare", table(pd.DataFrame(glitches)))
    flagged = false_alarms(alarms).add_suffix(" samples").reset_index(names="noise")
    write(page, "false alarms", table(flagged))


if __name__ == "__main__":
    main()
