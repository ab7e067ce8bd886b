"""A synthetic campaign on disk, as a lab would have written it: manifest, schedule, and records
sample by sample.

Every trial has a random stream of its own, so that adding a boundary or a visit changes no other
trial's samples. The folder holds nothing that a lab would not know; the truth is what `simulate`
returns.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import UsageError
from nearlift.randomness import generator
from nearlift.synthetic.trial_schedule import TrialSchedule
from nearlift.synthetic.truth import Truth

Form = Literal["parquet", "csv", "csv_with_time"]
TRIALS_PER_ROW_GROUP = 150
GRAVITY = 9.8
#: How a covariate is logged: its column, unit, and that unit's number of one in SI.
LOGGED = {
    "supply_V": ("supply", "V", 1.0),
    "current_A": ("current", "A", 1.0),
    "temperature_K": ("temperature", "K", 1.0),
    "humidity": ("humidity", "percent", 100.0),
    "tilt_rad": ("tilt", "rad", 1.0),
    "power_W": ("power", "W", 1.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedBench:
    """The rig of a synthetic campaign; the paper's, unless said otherwise.

    `offset_m` is what the manifest declares between datum and rotor plane, `contact_m` where the
    vehicle first touches. `text` is appended to
    the manifest as it is (an ``[[uncertainty]]`` table, say).
    """

    vehicle: str = "Crazyflie 2.0"
    rotors: int = 4
    radius_m: float = 0.023
    spacing_m: float = 0.065
    mass_kg: float = 0.027
    contact_m: Mapping[Boundary, float] | None = None
    arena_m: float = 1.5
    rate_Hz: float = 1000.0
    tare_s: float = 2.0
    record_s: float = 10.0
    offset_m: Mapping[Boundary, float] | None = None
    distance_unit: str = "mm"
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulated:
    """Truth of each trial: distance with the visit's jitter, lift with the trial's noise,
    and lift as the model has it.
    """

    z_m: FloatArray
    lift_N: FloatArray
    expected_N: FloatArray


def simulate(
    design: TrialSchedule,
    truths: Mapping[Boundary, Truth],
    *,
    bench: SimulatedBench = SimulatedBench(),
    seed: int,
) -> Simulated:
    """The true lift of every trial; all randomness but the samples'."""
    z_m, lift, expected = np.empty(len(design)), np.empty(len(design)), np.empty(len(design))
    columns = {
        "approach": design.approach,
        "session": design.session.astype(float),
        "start_s": design.start_s,
        **design.further,
    }
    for side, truth in truths.items():
        here = design.boundary == side
        jitter = {
            v: generator(seed, "height", side, str(v)).standard_normal()
            for v in np.unique(design.visit[here])
        }
        away = truth.noise.height_m * np.array([jitter[v] for v in design.visit[here]])
        # a traverse does not push the blades into the wall
        z_m[here] = np.maximum(design.z_m[here] + away, 0.1 * design.z_m[here])
        known = {name: values[here] for name, values in columns.items()}
        expected[here] = truth.lift_N(z_m[here] / bench.radius_m, design.throttle[here], known)
        scatter = np.array(
            [generator(seed, "trial", t).standard_normal() for t in design.trial[here]]
        )
        lift[here] = expected[here] * (1 + truth.noise.trial * scatter)
    return Simulated(z_m=z_m, lift_N=lift, expected_N=expected)


def record(
    trial: str, lift_N: float, throttle: float, truth: Truth, bench: SimulatedBench, seed: int
) -> NDArray[np.int32]:
    """Counts of one record: tare head, then the rotors at this lift."""
    noise = truth.noise
    rng = generator(seed, "record", trial)
    head, live = round(bench.tare_s * bench.rate_Hz), round(bench.record_s * bench.rate_Hz)
    n = head + live
    share = truth.lift_inf_N[throttle] / max(truth.lift_inf_N.values())
    force = noise.sample_N * rng.standard_normal(n)
    force += (
        noise.zero_N * rng.standard_normal()
        + noise.drift_N * rng.standard_normal() * np.arange(n) / n
    )
    turns = rng.random() + noise.tone_Hz * np.sqrt(share) / bench.rate_Hz * np.arange(live)
    force[head:] += lift_N + noise.tone_N * share * np.sin(2 * np.pi * turns)
    return np.asarray(np.round(force / noise.quantum_N), dtype=np.int32)


def write_campaign(
    folder: Path,
    design: TrialSchedule,
    truths: Mapping[Boundary, Truth],
    *,
    name: str,
    note: str,
    seed: int,
    bench: SimulatedBench = SimulatedBench(),
    form: Form = "parquet",
) -> Simulated:
    """Write a campaign at record level into `folder` and return what is true in it.

    Parameters
    ----------
    folder : Path
        New, or empty, or one that this function has written before, which it replaces.
    truths : mapping of boundary to Truth
        One for each boundary of the design. All share the cell, so the `quantum_N` of the first
        counts.
    form : str
        ``"parquet"`` (one long table of counts), ``"csv"`` (a file per trial with the force in mN)
        or ``"csv_with_time"``.

    Raises
    ------
    UsageError
        The folder holds something else, which is left as it is.
    """
    _claim(folder)
    true = simulate(design, truths, bench=bench, seed=seed)
    quantum = next(iter(truths.values())).noise.quantum_N
    (folder / "campaign.toml").write_text(
        manifest(name, note, bench, form, quantum, design), encoding="utf-8"
    )
    (folder / "trials.csv").write_text(schedule(design, bench), encoding="utf-8")
    each = zip(
        design.trial, true.lift_N.tolist(), design.throttle.tolist(), design.boundary, strict=True
    )
    samples = (
        record(str(trial), lift, throttle, truths[side], bench, seed)
        for trial, lift, throttle, side in each
    )
    if form == "parquet":
        _write_parquet(folder / "records.parquet", samples, design)
    else:
        rate_Hz = bench.rate_Hz if form == "csv_with_time" else None
        _write_csv(folder / "trials", samples, design, quantum, rate_Hz)
    return true


def _claim(folder: Path) -> None:
    manifest_there = folder / "campaign.toml"
    if manifest_there.is_file() and "\nsimulated = true" in manifest_there.read_text(
        encoding="utf-8"
    ):
        return
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(
            str(folder),
            "holds something other than a simulated campaign",
            "name an empty or a new folder; nothing there was touched",
        )
    folder.mkdir(parents=True, exist_ok=True)


def _write_parquet(path: Path, samples: Iterator[NDArray[np.int32]], design: TrialSchedule) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = pa.array(list(design.trial), type=pa.string())
    schema = pa.schema([("trial", pa.dictionary(pa.int32(), pa.string())), ("force", pa.int32())])
    numbers = np.arange(len(design), dtype=np.int32)
    with pq.ParquetWriter(path, schema, compression="zstd", write_page_checksum=True) as writer:
        for first in range(0, len(design), TRIALS_PER_ROW_GROUP):
            group = numbers[first : first + TRIALS_PER_ROW_GROUP]
            held = list(itertools.islice(samples, len(group)))
            index = pa.array(np.repeat(group, [len(counts) for counts in held]))
            trial = pa.DictionaryArray.from_arrays(index, names)
            writer.write_table(pa.table([trial, pa.array(np.concatenate(held))], schema=schema))


def _write_csv(
    folder: Path,
    samples: Iterator[NDArray[np.int32]],
    design: TrialSchedule,
    quantum_N: float,
    rate_Hz: float | None,
) -> None:
    folder.mkdir(exist_ok=True)
    for trial, counts in zip(design.trial, samples, strict=True):
        force = (1e3 * quantum_N * counts).tolist()
        if rate_Hz is None:
            lines = ["force", *(f"{f:.4f}" for f in force)]
        else:
            lines = ["t,force", *(f"{i / rate_Hz:.6g},{f:.4f}" for i, f in enumerate(force))]
        (folder / f"{trial}.csv").write_text("\n".join(lines) + "\n", encoding="ascii")


def schedule(design: TrialSchedule, bench: SimulatedBench) -> str:
    """The text of trials.csv."""
    per_unit = {"mm": 1e3, "cm": 1e2, "m": 1.0}[bench.distance_unit]
    columns: dict[str, Iterable[str]] = {
        "trial": design.trial,
        "boundary": design.boundary,
        "distance": [f"{per_unit * d:.6g}" for d in design.recorded_m],
        "throttle": [f"{100 * t:.6g}" for t in design.throttle],
        "start": [f"{s:.2f}" for s in design.start_s],
        "session": [str(s) for s in design.session],
        "approach": [f"{a:+.0f}" for a in design.approach],
    }
    for name, values in design.further.items():
        column, _, per_SI = LOGGED.get(name, (name, "", 1.0))
        columns[column] = [f"{v:.7g}" for v in per_SI * values]
    rows = [columns, *zip(*columns.values(), strict=True)]
    return "".join(",".join(row) + "\n" for row in rows)


def manifest(
    name: str, note: str, bench: SimulatedBench, form: Form, quantum_N: float, design: TrialSchedule
) -> str:
    """The text of campaign.toml, which says that it is simulated, and of the truth only what a lab
    would know.
    """
    offsets = {
        side: (bench.offset_m or {}).get(side, 0.0) for side in dict.fromkeys(design.boundary)
    }
    datum = ", ".join(
        f'{side} = "{"blade tip" if side == "sidewall" else "rotor plane"}"' for side in offsets
    )
    offset = ", ".join(f'{side} = "{1e3 * value:g} mm"' for side, value in offsets.items())
    spacing = f'rotor_spacing = "{1e3 * bench.spacing_m:g} mm"\n' if bench.rotors > 1 else ""
    touches = ", ".join(f'{s} = "{1e3 * v:g} mm"' for s, v in (bench.contact_m or {}).items())
    contact = f"contact       = {{ {touches} }}\n" if touches else ""
    if form == "parquet":
        force = (
            '{ column = "force", unit = "count", sign = 1, calibration = { gain ='
            f' "{1e3 * quantum_N:g} mN/count", offset = "0 count" }} }}'
        )
        records = f'reader = "parquet"\nfiles  = "records.parquet"\nforce  = {force}\n'
    else:
        records = (
            'reader = "csv"\nfiles  = "trials/{trial}.csv"\nforce  = { column = "force", unit ='
            ' "mN", sign = 1 }\n'
        )
        records += 'time   = { column = "t", unit = "s" }\n' if form == "csv_with_time" else ""
    logged = (LOGGED[name] for name in design.further if name in LOGGED)
    further = "".join(f'{column} = "{unit}"\n' for column, unit, _ in logged)
    return f"""# SIMULATED. No such measurement was ever made: this campaign was written by \
nearlift.synthetic.
schema = "nearlift.campaign/1"
name   = "{name}"
simulated = true
note   = "{note}"

[vehicle]
name          = "{bench.vehicle}"
rotors        = {bench.rotors}
rotor_radius  = "{1e3 * bench.radius_m:g} mm"
{spacing}mass          = "{1e3 * bench.mass_kg:g} g"
{contact}
[rig]
held            = "throttle"
distance_datum  = {{ {datum} }}
distance_offset = {{ {offset} }}
arena           = "{bench.arena_m:g} m"
air_density     = "1.2 kg/m^3"
gravity         = "{GRAVITY:g} m/s^2"

[load_cell]
sample_rate = "{bench.rate_Hz:g} Hz"
tare        = "{bench.tare_s:g} s"
settle      = "0 s"
range       = "1 kgf"
accuracy    = "1.5 gf"

[records]
{records}
[trials]
file = "trials.csv"
[trials.units]
distance = "{bench.distance_unit}"
throttle = "percent"
start    = "s"
{further}{bench.text}"""
