"""Damage on its way from a record's bytes to a trial's row: flipped bytes and sectors in files of
every format, glitches in the tare.

A trial is *told* of by any quality code. It is *silent* where its lift differs from that of the
whole file by more than its own u and no code tells. `tests.calibration.damage` writes what is found
into docs/damage.md.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.readers.reading import of_trials
from tests.unit import written
from tests.unit.manifests import manifest

from nearlift import catalogue
from nearlift.campaign import manifest as manifests
from nearlift.campaign.manifest import Campaign
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget
from nearlift.observed import observe
from nearlift.readers import reader, rows
from nearlift.reduction.quality import joined, rejected
from nearlift.reduction.record import reduce_record
from nearlift.reduction.samples import Conditions
from nearlift.stages import ingest
from nearlift.stages.ingest import TRIALS

FloatArray = NDArray[np.float64]

FLIPS, SECTORS, SECTOR = 200, 100, 512
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
FATES = ("rejected", "told", "within u", "silent")


def flipped(content: bytes, rng: np.random.Generator) -> bytes:
    """One byte replaced by another."""
    spoilt = bytearray(content)
    spoilt[rng.integers(len(content))] ^= int(rng.integers(1, 256))
    return bytes(spoilt)


def sector(content: bytes, rng: np.random.Generator) -> bytes:
    """A sector zeroed, full of noise, or that of another place."""
    start = SECTOR * int(rng.integers((len(content) - 1) // SECTOR + 1))
    size = min(SECTOR, len(content) - start)
    other = int(rng.integers(max(1, len(content) - size)))
    new = (bytes(size), rng.bytes(size), content[other : other + size])[int(rng.integers(3))]
    return content[:start] + new + content[start + size :]


def damages(
    content: bytes, flips: int = FLIPS, sectors: int = SECTORS
) -> Iterator[tuple[str, bytes]]:
    """Copies of a file, each with one damage."""
    rng = np.random.default_rng(len(content))
    for kind, change, number in (("flip", flipped, flips), ("sector", sector, sectors)):
        for _ in range(number):
            yield kind, change(content, rng)


def rig(name: str) -> Campaign:
    """A campaign of files as `tests.unit.written` writes them."""
    _, column, unit, suffix = written.WRITERS[name]
    return manifest(
        load_cell={"sample_rate": f"{RATE:g} Hz", "tare": f"{TARE / RATE:g} s", "range": None},
        records={
            "reader": name,
            "files": f"{{trial}}.{suffix}",
            "force": {"column": column, "unit": unit, "sign": 1},
            **({} if name == "csv" else {"dialect": {"ignore_rate": True}}),
        },
    )


def reduced(campaign: Campaign, folder: Path, contents: list[bytes]) -> list[rows.Row]:
    """The rows of files with these contents; whatever is raised here is a finding."""
    pattern = campaign.records.files or ""
    names = [f"t{i:04d}" for i in range(len(contents))]
    for name, content in zip(names, contents, strict=True):
        written.put(folder, pattern.replace("{trial}", name), content)
    pieces, _ = reader(campaign.records.reader).plan(campaign, folder, names)
    tasks = [
        rows.Task(root=folder, campaign=campaign, piece=piece, tare_after_N={}, digests={})
        for piece in pieces
    ]
    answers = (answer for task in tasks for answer in rows.reduce_piece(task))
    return [row for answer in answers for row in answer.rows]


def fate(row: rows.Row, lift_N: float, samples: int) -> str:
    """What became of a trial whose lift should be this; a length that is not the planned one is
    told by `[load_cell] record`.
    """
    codes = row["codes"]
    if rejected(np.array([joined(codes)], dtype=object))[0]:
        return "rejected"
    if codes or row["samples"] != samples:
        return "told"
    return "within u" if abs(row["lift_N"] - lift_N) <= row["u_lift_N"] else "silent"


def bytes_to_rows(
    folder: Path, flips: int = FLIPS, sectors: int = SECTORS
) -> dict[tuple[str, str], Counter[str]]:
    """(format, kind of damage) to fates."""
    found: dict[tuple[str, str], Counter[str]] = {}
    for name, (write, *_) in written.WRITERS.items():
        content = write(FORCE)
        kinds, contents = zip(*damages(content, flips, sectors), strict=True)
        whole, *rows = reduced(rig(name), folder / name, [content, *contents])
        assert not whole["codes"]
        assert len(rows) == len(contents)
        for kind, row in zip(kinds, rows, strict=True):
            found.setdefault((name, kind), Counter())[fate(row, whole["lift_N"], len(FORCE))] += 1
    return found


# ---- the tare


Glitch = Callable[[FloatArray, np.random.Generator], FloatArray]


def single(tare: FloatArray, rng: np.random.Generator) -> FloatArray:
    tare[rng.integers(len(tare))] += rng.choice([-1, 1]) * 10 ** rng.uniform(-3, 1)
    return tare


def five(tare: FloatArray, rng: np.random.Generator) -> FloatArray:
    tare[rng.integers(len(tare), size=min(5, len(tare) // 4))] += 10 ** rng.uniform(-2, 1)
    return tare


def together(tare: FloatArray, rng: np.random.Generator) -> FloatArray:
    length = min(5, len(tare) // 4)
    start = rng.integers(len(tare) - length + 1)
    tare[start : start + length] += 10 ** rng.uniform(-2, 1)
    return tare


def zeroed(tare: FloatArray, rng: np.random.Generator) -> FloatArray:
    length = min(64, len(tare) // 3)
    start = rng.integers(len(tare) - length + 1)
    # a cell whose zero is elsewhere: as seen from its own
    tare[start : start + length] = -(10 ** rng.uniform(-2, 0))
    return tare


def stopping(tare: FloatArray, rng: np.random.Generator) -> FloatArray:
    return tare + 0.2 * np.exp(-np.arange(len(tare)) / (len(tare) * 10 ** rng.uniform(-2, -0.5)))


def starting(tare: FloatArray, rng: np.random.Generator) -> FloatArray:
    return tare + 0.2 * (np.arange(len(tare)) > len(tare) * (1 - 10 ** rng.uniform(-2, -0.5)))


def step(tare: FloatArray, rng: np.random.Generator) -> FloatArray:
    return tare + 10 ** rng.uniform(-2, 1) * (
        np.arange(len(tare)) > rng.uniform(0.1, 0.9) * len(tare)
    )


def glitched(force: FloatArray, n: int, glitch: Glitch, rng: np.random.Generator) -> FloatArray:
    """A record of which the first n samples, its tare, are damaged."""
    return np.concatenate([glitch(force[:n].copy(), rng), force[n:]])


GLITCHES: dict[str, Glitch] = {
    "a sample, 1 mN to 10 N": single,
    "five samples, scattered, 10 mN to 10 N": five,
    "five in a row, 10 mN to 10 N": together,
    "64 zeroed, in a cell whose zero is at 10 mN to 1 N": zeroed,
    "rotors still stopping": stopping,
    "rotors started too early": starting,
    "a step of 10 mN to 10 N": step,
}
#: Rate and samples of a tare of 2 s.
TARES = ((1000.0, 2000), (100.0, 200), (20.0, 40), (4.0, 8))


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """Of glitches in the tare: how many, told, rejected, silent, and the largest shift that was not
    told, in u.
    """

    tries: int = 0
    told: int = 0
    rejected: int = 0
    silent: int = 0
    largest: float = 0.0


def tare_glitches(rate_Hz: float, n: int, glitch: Glitch, tries: int = 100) -> Told:
    """Lift 0.2 N, white noise of 2 mN; the shift is that from the same record without the
    glitch.
    """
    rng = np.random.default_rng(n)
    told = refused = silent = 0
    largest = 0.0
    for _ in range(tries):
        force = 7e-3 + 2e-3 * rng.standard_normal(6 * n)
        force[n:] += 0.2
        clean = reduce_record(force, Conditions(rate_Hz=rate_Hz, tare_s=n / rate_Hz))
        force = glitched(force, n, glitch, rng)
        got = reduce_record(force, Conditions(rate_Hz=rate_Hz, tare_s=n / rate_Hz))
        shift = abs(got.lift_N - clean.lift_N) / got.u_lift_N
        told += bool(got.codes)
        refused += any(code.isupper() for code in got.codes)
        silent += shift > 1 and not got.codes
        largest = max(largest, 0.0 if got.codes else shift)
    return Told(tries=tries, told=told, rejected=refused, silent=silent, largest=largest)


def false_alarms(tries: int) -> dict[tuple[str, int], tuple[int, int]]:
    """Noise and samples of a clean tare to how many were flagged, of how many."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(4)
    found = {}
    for rate_Hz, n in TARES:
        clock = np.arange(n) / rate_Hz
        for name in (
            "white",
            "AR(1) at 0.9",
            "50 Hz of 10 times the noise",
            "a step of the converter as large as the noise",
            "ten times as large",
        ):
            flagged = 0
            coarse = {
                "a step of the converter as large as the noise": 1.0,
                "ten times as large": 10.0,
            }.get(name)
            for _ in range(tries):
                force = rng.standard_normal(3 * n + 200)
                if name.startswith("AR"):
                    force = lfilter([0.19**0.5], [1, -0.9], force)
                force = force[200:]
                if name.startswith("50"):
                    force[:n] += 14 * np.sin(2 * np.pi * (50 * clock + rng.random()))
                # so large that no drift of the live part is one
                force[n:] += 1e4
                if coarse:
                    force = coarse * np.round(force / coarse + rng.random())
                codes = reduce_record(force, Conditions(rate_Hz=rate_Hz, tare_s=n / rate_Hz)).codes
                flagged += "STUCK" not in codes and not {
                    "TARE",
                    "drift",
                    "DRIFT",
                    "spikes",
                }.isdisjoint(codes)
            found[name, n] = flagged, tries
    return found


def on_the_coefficient(root: Path, tries: int = 100) -> tuple[Told, float]:
    """One tare of a campaign glitched, many times: K_b's shift from the fit of the whole campaign,
    in its u, and the largest that was told.
    """
    campaign, table = _ingested(root)
    model, parts = catalogue.model("sanchez_cuevas"), budget.components(campaign)
    before = fit(model, observe(table, campaign, "ground"), parts).estimates["K_b"]
    rng = np.random.default_rng(1)
    cell = campaign.load_cell
    n = round(campaign.tare_s * (cell.sample_rate or 1.0))
    told = refused = silent = 0
    largest, accepted = 0.0, 0.0
    for i in range(tries):
        row = int(rng.integers(len(table["trial"])))
        [record] = of_trials("csv", campaign, root, [str(table["trial"][row])])
        force = glitched(record.force_N, n, list(GLITCHES.values())[i % len(GLITCHES)], rng)
        conditions = Conditions(
            rate_Hz=cell.sample_rate or 1.0, tare_s=campaign.tare_s, settle_s=cell.settle
        )
        got = reduce_record(force, conditions)
        changed = {name: table[name].copy() for name in ("lift_N", "u_lift_N", "quality")}
        changed["lift_N"][row], changed["u_lift_N"][row], changed["quality"][row] = (
            got.lift_N,
            got.u_lift_N,
            joined(got.codes),
        )
        after = fit(model, observe({**table, **changed}, campaign, "ground"), parts).estimates[
            "K_b"
        ]
        shift = abs(after.value - before.value) / before.u
        told += bool(got.codes)
        refused += any(code.isupper() for code in got.codes)
        silent += shift > 1 and not got.codes
        largest, accepted = max(largest, 0.0 if got.codes else shift), max(accepted, shift)
    return Told(tries=tries, told=told, rejected=refused, silent=silent, largest=largest), accepted


def _ingested(root: Path) -> tuple[Campaign, dict[str, Any]]:
    from tests.unit import small_run

    small_run.write(root)
    campaign = manifests.load(root)
    job = small_run.job(root, root.parent / "out")
    ingest.run(job)
    return campaign, dict(job.read(TRIALS))
