"""Campaigns whose records hold many trials: a stand that steps its throttle, written as a stand
writes it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.campaign.manifest import Campaign

from .manifests import UNITS, manifest

RATE = 80.0
HEAD_S, HOLD_S, REST_S = 2.0, 4.0, 3.0
LAG_S = 0.1
THROTTLES = (0, 40, 60, 80, 0)
#: Full throttle lifts a few times the vehicle's weight.
FULL_N = 1.2
ZERO_N, NOISE_N = 0.05, 0.002
CUT: dict[str, Any] = {
    "column": "throttle",
    "unit": "percent",
    "settle": "1 s",
    "shortest": "2 s",
}


def lift_N(z_hat: float, throttle: float) -> float:
    """Steady lift of one rotor, by Cheeseman and Bennett."""
    return FULL_N * (throttle / 100) ** 1.5 / (1 - 1 / (16 * z_hat**2))


def sweep(
    z_hat: float, rng: np.random.Generator, throttles: Sequence[float] = THROTTLES
) -> dict[str, np.ndarray]:
    """Columns of one record: clock, throttle, force (mN), supply (V)."""
    thr = np.concatenate(
        [np.full(round((REST_S if t == 0 else HOLD_S) * RATE), float(t)) for t in throttles]
    )
    wanted = np.array([lift_N(z_hat, t) for t in thr])
    lift, keep = np.empty(len(thr)), np.exp(-1 / RATE / LAG_S)
    now = 0.0
    for i, w in enumerate(wanted):
        now = w + (now - w) * keep
        lift[i] = now
    force = lift + ZERO_N + rng.normal(0, NOISE_N, len(thr))
    return {
        "t": np.arange(len(thr)) / RATE,
        "throttle": thr,
        "force": np.round(1e3 * force, 4),
        "supply": np.round(16 - 0.01 * thr + rng.normal(0, 0.01, len(thr)), 4),
    }


def text_of(columns: Mapping[str, Any]) -> str:
    """The columns as plain CSV."""
    rows = zip(*(map(repr, map(float, c)) for c in columns.values()), strict=True)
    return ",".join(columns) + "\n" + "".join(",".join(row) + "\n" for row in rows)


def campaign(cut: Mapping[str, Any] | None = None, **changes: Any) -> Campaign:
    """The manifest of such a campaign; `cut` replaces keys of [segments], None takes one away."""
    keys = {k: v for k, v in {**CUT, **(cut or {})}.items() if v is not None}
    records = {
        "reader": "csv",
        "files": "sweeps/{record}.csv",
        "time": {"column": "t", "unit": "s"},
        **changes.pop("records", {}),
    }
    cell = {"sample_rate": f"{RATE:g} Hz", "tare": f"{HEAD_S:g} s", **changes.pop("load_cell", {})}
    return manifest(
        vehicle={"name": "rotor", "rotors": 1, "rotor_spacing": None},
        records={k: v for k, v in records.items() if v is not None},
        load_cell={"range": None, **cell},
        segments=keys,
        trials={"file": "records.csv", "units": UNITS, **changes.pop("trials", {})},
        **changes,
    )


def write(
    folder: Path,
    z_hats: Sequence[float] = (1.0, 2.0, 4.0),
    throttles: Sequence[float] = THROTTLES,
    seed: int = 1,
) -> Path:
    """A campaign's schedule and records, one sweep at each distance."""
    rng = np.random.default_rng(seed)
    (folder / "sweeps").mkdir(parents=True)
    rows = ["record,boundary,distance"]
    for k, z_hat in enumerate(z_hats):
        rows.append(f"r{k},ground,{23 * z_hat:g}")
        (folder / "sweeps" / f"r{k}.csv").write_text(text_of(sweep(z_hat, rng, throttles)))
    (folder / "records.csv").write_text("\n".join(rows) + "\n")
    return folder


def started(
    rest_s: float, rise_s: float, rate_Hz: float, seed: int, length_s: float = 4.0
) -> tuple[np.ndarray, np.ndarray]:
    """Times, and the force of rotors that start after some rest with an exponential rise."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(length_s * rate_Hz)) / rate_Hz
    rise = 1 - np.exp(-np.maximum(t - rest_s, 0) / max(rise_s, 1e-9))
    return t, 300 * np.where(t >= rest_s, rise, 0) + rng.normal(0, 1.0, len(t)) - 12
