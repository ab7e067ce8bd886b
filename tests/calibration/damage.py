"""Damage on its way from a record's bytes to a trial's row: flipped bytes, damaged sectors and cuts in
files of every format, glitches in the tare.

    python -m tests.calibration.damage        writes the tables of docs/damage.md

A trial is *reported* by any quality code. It is *silent* where its lift differs from that of the
whole file by more than its u, without a code.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import lfilter
from tests.calibration.bench import Array
from tests.calibration.figures import table, write
from tests.readers.reading import of_trials
from tests.unit import small_run, written
from tests.unit.manifests import manifest

from nearlift import catalogue
from nearlift.campaign import manifest as manifests
from nearlift.campaign.manifest import Campaign
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget
from nearlift.observed import observe
from nearlift.readers import reader, rows
from nearlift.reduction.quality import joined, rejected
from nearlift.reduction.record import Reduced, reduce_record
from nearlift.reduction.samples import Conditions
from nearlift.stages import ingest
from nearlift.stages.ingest import TRIALS

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
    records = {
        "reader": name,
        "files": f"{{trial}}.{suffix}",
        "force": {"column": column, "unit": unit, "sign": 1},
    }
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
    return [
        row
        for piece in pieces
        for answer in rows.reduce_piece(
            rows.Task(root=folder, campaign=campaign, piece=piece, tare_after_N={}, digests={})
        )
        for row in answer.rows
    ]


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
    lines = {}
    for name, (save, *_) in written.WRITERS.items():
        content = save(FORCE)
        kinds, contents = zip(*damages(content, tries), strict=True)
        whole, *damaged = reduced(rig(name), folder / name, [content, *contents])
        assert not whole["codes"]
        fates = [fate(row, whole["lift_N"]) for row in damaged]
        lines[name] = Counter(zip(kinds, fates, strict=True))
    return pd.DataFrame(
        [[count[kind, f] for kind in tries for f in FATES] for count in lines.values()],
        index=list(lines),
        columns=pd.MultiIndex.from_product([tries, FATES]),
    )


# ---- the tare

Glitch = Callable[[Array, np.random.Generator], Array]


def single(tare: Array, rng: np.random.Generator) -> Array:
    tare[rng.integers(len(tare))] += rng.choice([-1, 1]) * 10 ** rng.uniform(-3, 1)
    return tare


def five(tare: Array, rng: np.random.Generator) -> Array:
    tare[rng.integers(len(tare), size=min(5, len(tare) // 4))] += 10 ** rng.uniform(-2, 1)
    return tare


def together(tare: Array, rng: np.random.Generator) -> Array:
    length = min(5, len(tare) // 4)
    start = rng.integers(len(tare) - length + 1)
    tare[start : start + length] += 10 ** rng.uniform(-2, 1)
    return tare


def zeroed(tare: Array, rng: np.random.Generator) -> Array:
    length = min(64, len(tare) // 3)
    start = rng.integers(len(tare) - length + 1)
    # relative to the zero of the cell
    tare[start : start + length] = -(10 ** rng.uniform(-2, 0))
    return tare


def stopping(tare: Array, rng: np.random.Generator) -> Array:
    return tare + 0.2 * np.exp(-np.arange(len(tare)) / (len(tare) * 10 ** rng.uniform(-2, -0.5)))


def starting(tare: Array, rng: np.random.Generator) -> Array:
    return tare + 0.2 * (np.arange(len(tare)) > len(tare) * (1 - 10 ** rng.uniform(-2, -0.5)))


def step(tare: Array, rng: np.random.Generator) -> Array:
    size, after = 10 ** rng.uniform(-2, 1), rng.uniform(0.1, 0.9) * len(tare)
    return tare + size * (np.arange(len(tare)) > after)


GLITCHES: dict[str, Glitch] = {
    "a sample, 1 mN to 10 N": single,
    "five samples, scattered, 10 mN to 10 N": five,
    "five in a row, 10 mN to 10 N": together,
    "64 zeroed, in a cell whose zero is at 10 mN to 1 N": zeroed,
    "rotors still stopping": stopping,
    "rotors started too early": starting,
    "a step of 10 mN to 10 N": step,
}
#: Samples of a tare of 2 s.
TARES = (2000, 200, 40, 8)


def glitched(force: Array, n: int, glitch: Glitch, rng: np.random.Generator) -> Array:
    """A record of which the first n samples, its tare, are damaged."""
    return np.concatenate([glitch(force[:n].copy(), rng), force[n:]])


def _reduced(force: Array, n: int) -> Reduced:
    return reduce_record(force, Conditions(rate_Hz=n / 2, tare_s=2.0))


def _judged(codes: tuple[str, ...], shift: float) -> dict[str, float]:
    """One damaged tare, whose shift is in u."""
    return {
        "reported": bool(codes),
        "of these rejected": any(code.isupper() for code in codes),
        "silent": shift > 1 and not codes,
        "shift": shift,
        "undetected": 0.0 if codes else shift,
    }


def tare_glitches(n: int, glitch: Glitch, tries: int = 100) -> pd.DataFrame:
    """Glitches in a tare of n samples, a line each: lift 0.2 N, white noise of 2 mN; the shift is
    that from the same record without the glitch.
    """
    rng, lines = np.random.default_rng(n), []
    for _ in range(tries):
        force = 7e-3 + 2e-3 * rng.standard_normal(6 * n)
        force[n:] += 0.2
        clean, damaged = _reduced(force, n), _reduced(glitched(force, n, glitch, rng), n)
        shift = abs(damaged.lift_N - clean.lift_N) / damaged.u_lift_N
        lines.append(_judged(damaged.codes, shift))
    return pd.DataFrame(lines)


NOISES = {
    "white": {},
    "AR(1) at 0.9": {"chain": True},
    "50 Hz of 10 times the noise": {"hum": True},
    "a step of the converter as large as the noise": {"step": 1.0},
    "ten times as large": {"step": 10.0},
}


def false_alarms(tries: int) -> pd.DataFrame:
    """How many clean tares are flagged: lines of noise, columns of samples."""
    rng, counts = np.random.default_rng(4), {}
    for n in TARES:
        clock = 2 * np.arange(n) / n
        for name, how in NOISES.items():
            flagged = 0
            for _ in range(tries):
                force = rng.standard_normal(3 * n + 200)
                if "chain" in how:
                    force = lfilter([0.19**0.5], [1, -0.9], force)
                force = force[200:]
                if "hum" in how:
                    force[:n] += 14 * np.sin(2 * np.pi * (50 * clock + rng.random()))
                force[n:] += 1e4  # so large that no drift of the live part is one
                if "step" in how:
                    force = how["step"] * np.round(force / how["step"] + rng.random())
                codes = {*_reduced(force, n).codes}
                flagged += "STUCK" not in codes and bool(
                    codes & {"TARE", "drift", "DRIFT", "spikes"}
                )
            counts[name, n] = flagged
    return pd.Series(counts).unstack(sort=False)


def on_the_coefficient(root: Path, tries: int = 100) -> pd.DataFrame:
    """One tare of a campaign glitched, many times: a line each, with K_b's shift from the fit of the
    whole campaign, in its u.
    """
    small_run.write(root)
    campaign, job = manifests.load(root), small_run.job(root, root.parent / "out")
    ingest.run(job)
    table = dict(job.read(TRIALS))
    model, parts = catalogue.model("sanchez_cuevas"), budget.components(campaign)
    before = fit(model, observe(table, campaign, "ground"), parts).estimates["K_b"]
    rng, cell, lines = np.random.default_rng(1), campaign.load_cell, []
    rate_Hz = cell.sample_rate or 1.0
    conditions = Conditions(rate_Hz=rate_Hz, tare_s=campaign.tare_s, settle_s=cell.settle)
    for i in range(tries):
        row = int(rng.integers(len(table["trial"])))
        [record] = of_trials("csv", campaign, root, [str(table["trial"][row])])
        glitch = list(GLITCHES.values())[i % len(GLITCHES)]
        n = round(campaign.tare_s * rate_Hz)
        damaged = reduce_record(glitched(record.force_N, n, glitch, rng), conditions)
        changed = {name: table[name].copy() for name in ("lift_N", "u_lift_N", "quality")}
        changed["lift_N"][row], changed["u_lift_N"][row] = damaged.lift_N, damaged.u_lift_N
        changed["quality"][row] = joined(damaged.codes)
        data = observe({**table, **changed}, campaign, "ground")
        after = fit(model, data, parts).estimates["K_b"]
        lines.append(_judged(damaged.codes, abs(after.value - before.value) / before.u))
    return pd.DataFrame(lines)


# ---- the page

ROWS = """## From bytes to a row

A record of {tare} and {live} samples in each format; {byte} copies with one byte replaced, {sector} with one damaged sector of 512 bytes and {cut} cut at a random place, each reduced as by `nearlift ingest`. Every
copy gets a row. *Reported*: by a quality code, or by the length that `[load_cell] record` states. *Within u*: undetected, and the lift is right within its standard error. *Silent*: undetected and wrong.

{rows}"""
TARE_PAGE = """## The tare

100 glitches of each kind in a tare of 2 s at 1000, 100, 20 and 4 Hz: lift 0.2 N, white noise of 2 mN. *Silent*: no code, and the lift is off by more than its standard error. The last
column is the largest undetected shift. No damage is longer than a third of the tare.

{glitches}
A tare of fewer than 20 samples reveals single damaged samples only, and ingest notes it.

In a campaign of 112 trials one tare was damaged, {tries} times over: {reported} were reported, {refused} of them rejected. `K_b` moved by at most {undetected:.2g} of its u undetected, by at
most {shift:.2g} u where reported.

Clean tares that are flagged, of {alarms} each:

{flagged}"""


def main(alarms: int = 20000) -> None:
    """Write the sections of docs/damage.md."""
    page = Path(__file__).parents[2] / "docs" / "damage.md"
    counted = ["reported", "of these rejected", "silent"]
    glitches = [
        {"glitch": name, "samples": n}
        | {c: int(made[c].sum()) for c in counted}
        | {"largest undetected shift": f"{made['undetected'].max():.2f} u"}
        for name, glitch in GLITCHES.items()
        for n in TARES
        for made in [tare_glitches(n, glitch)]
    ]
    flagged = false_alarms(alarms).add_suffix(" samples").reset_index(names="noise")
    with tempfile.TemporaryDirectory() as folder:
        fates = bytes_to_rows(Path(folder) / "rows")
        moved = on_the_coefficient(Path(folder) / "campaign")
    fates.columns = [f"{kind}: {f}" if f == FATES[0] else f for kind, f in fates.columns]
    fates = fates.set_axis([f"`{name}`" for name in fates.index]).reset_index(names="format")
    write(page, "rows", ROWS.format(tare=TARE, live=LIVE, rows=table(fates), **TRIES))
    text = TARE_PAGE.format(
        glitches=table(pd.DataFrame(glitches)),
        flagged=table(flagged),
        alarms=alarms,
        tries=len(moved),
        reported=int(moved["reported"].sum()),
        refused=int(moved["of these rejected"].sum()),
        undetected=moved["undetected"].max(),
        shift=moved["shift"].max(),
    )
    write(page, "tare", text)


if __name__ == "__main__":
    main()
