"""A synthetic campaign on disk, as a lab would have written it: manifest, schedule, and records
sample by sample.

Every trial has a random stream of its own, so that adding a boundary or a visit changes no other
trial's samples. The folder holds nothing that a lab would not know; the truth is what `simulate`
returns.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import UsageError
from nearlift.randomness import generator
from nearlift.synthetic.trial_schedule import TrialSchedule
from nearlift.synthetic.truth import Truth

Form = Literal["parquet", "csv"]
TRIALS_PER_ROW_GROUP = 150
GRAVITY = 9.8


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedBench:
    """The paper's rig with a Crazyflie: its records, and what the manifest declares.

    `contact_m` is where the vehicle first touches. `text` is appended to the manifest as it is (an
    ``[[uncertainty]]`` table, say).
    """

    radius_m: float = 0.023
    spacing_m: float = 0.065
    rate_Hz: float = 1000.0
    tare_s: float = 2.0
    record_s: float = 10.0
    contact_m: Mapping[Boundary, float] = field(default_factory=dict)
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
    z_m, lift, expected = np.empty((3, len(design)))
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
        ``"parquet"`` (one long table of counts) or ``"csv"`` (a file per trial with the force in
        mN).

    Raises
    ------
    UsageError
        The folder holds something else, which is left as it is.
    """
    _claim(folder)
    true = simulate(design, truths, bench=bench, seed=seed)
    quantum_N = next(iter(truths.values())).noise.quantum_N
    samples = (
        record(str(trial), lift, throttle, truths[side], bench, seed)
        for trial, lift, throttle, side in zip(
            design.trial, true.lift_N.tolist(), design.throttle.tolist(), design.boundary,
            strict=True,
        )
    )  # fmt: skip
    if form == "parquet":
        calibration = f'{{ gain = "{1e3 * quantum_N:g} mN/count", offset = "0 count" }}'
        records = f"""\
reader = "parquet"
files  = "records.parquet"
force  = {{ column = "force", unit = "count", sign = 1, calibration = {calibration} }}
"""
        _write_parquet(folder / "records.parquet", samples, design)
    else:
        records = """\
reader = "csv"
files  = "trials/{trial}.csv"
force  = { column = "force", unit = "mN", sign = 1 }
"""
        (folder / "trials").mkdir(exist_ok=True)
        for trial, counts in zip(design.trial, samples, strict=True):
            lines = ["force", *(f"{f:.4f}" for f in (1e3 * quantum_N * counts).tolist())]
            text = "\n".join(lines) + "\n"
            (folder / "trials" / f"{trial}.csv").write_text(text, encoding="ascii")
    text = manifest(name, note, bench, records, design)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    (folder / "trials.csv").write_text(schedule(design), encoding="utf-8")
    return true


def _claim(folder: Path) -> None:
    known = folder / "campaign.toml"
    if known.is_file() and "\nsimulated = true" in known.read_text(encoding="utf-8"):
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


def schedule(design: TrialSchedule) -> str:
    """The text of trials.csv."""
    columns: dict[str, Iterable[str]] = {
        "trial": design.trial,
        "boundary": design.boundary,
        "distance": [f"{1e3 * d:.6g}" for d in design.recorded_m],
        "throttle": [f"{100 * t:.6g}" for t in design.throttle],
        "start": [f"{s:.2f}" for s in design.start_s],
        "session": [str(s) for s in design.session],
        "approach": [f"{a:+.0f}" for a in design.approach],
    }
    if "supply_V" in design.further:
        columns["supply"] = [f"{v:.7g}" for v in design.further["supply_V"]]
    rows = [columns, *zip(*columns.values(), strict=True)]
    return "".join(",".join(row) + "\n" for row in rows)


def manifest(
    name: str, note: str, bench: SimulatedBench, records: str, design: TrialSchedule
) -> str:
    """The text of campaign.toml, with the content of its table `records`.

    It says that it is simulated, and of the truth only what a lab would know.
    """
    sides: list[Boundary] = list(dict.fromkeys(design.boundary))
    planes = {side: "blade tip" if side == "sidewall" else "rotor plane" for side in sides}
    datum = ", ".join(f'{side} = "{plane}"' for side, plane in planes.items())
    offset = ", ".join(f'{side} = "0 mm"' for side in sides)
    touches = ", ".join(f'{side} = "{1e3 * z:g} mm"' for side, z in bench.contact_m.items())
    contact = f"contact       = {{ {touches} }}\n" if touches else ""
    supply = 'supply = "V"\n' if "supply_V" in design.further else ""
    return f"""# SIMULATED. No such measurement was ever made: this campaign was written by \
nearlift.synthetic.
schema = "nearlift.campaign/1"
name   = "{name}"
simulated = true
note   = "{note}"

[vehicle]
name          = "Crazyflie 2.0"
rotors        = 4
rotor_radius  = "{1e3 * bench.radius_m:g} mm"
rotor_spacing = "{1e3 * bench.spacing_m:g} mm"
mass          = "27 g"
{contact}
[rig]
held            = "throttle"
distance_datum  = {{ {datum} }}
distance_offset = {{ {offset} }}
arena           = "1.5 m"
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
distance = "mm"
throttle = "percent"
start    = "s"
{supply}{bench.text}"""
