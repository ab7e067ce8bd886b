"""Manifests of small campaigns, as their files hold them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nearlift.campaign import manifest as campaign
from nearlift.campaign.manifest import Campaign

UNITS = {"distance": "mm", "throttle": "percent"}
RATE = 200.0
HEAD, LIVE = 100, 400
CRAZYFLIE = {
    "name": "Crazyflie 2.0",
    "rotors": 4,
    "rotor_radius": "23 mm",
    "rotor_spacing": "65 mm",
    "mass": "27 g",
}
RIG = {
    "held": "throttle",
    "distance_datum": "rotor plane",
    "distance_offset": "0 mm",
    "gravity": "9.8 m/s^2",
}


def raw_manifest(**changes: Any) -> dict[str, Any]:
    """A manifest of means; `changes` replace whole keys."""
    raw: dict[str, Any] = {
        "schema": "nearlift.campaign/1",
        "name": "small",
        "vehicle": CRAZYFLIE | {"contact": {"ground": "12 mm", "ceiling": "2 mm"}},
        "rig": {**RIG},
        "records": {"reader": "means"},
        "uncertainty": [
            {"name": "distance datum", "on": "height", "value": "0.2 mm", "scope": "boundary"}
        ],
    }
    return raw | changes


def raw_bench_manifest(**changes: Any) -> dict[str, Any]:
    """A manifest of per-trial CSV files; `changes` replace keys of its sections, None takes a key
    away.
    """
    raw: dict[str, Any] = {
        "schema": "nearlift.campaign/1",
        "name": "bench",
        "vehicle": {**CRAZYFLIE},
        "rig": RIG | {"arena": "1.5 m"},
        "load_cell": {
            "sample_rate": f"{RATE:g} Hz",
            "tare": f"{HEAD / RATE:g} s",
            "range": "1 kgf",
        },
        "records": {
            "reader": "csv",
            "files": "trials/{trial}.csv",
            "force": {"column": "force", "unit": "mN", "sign": 1},
        },
        "trials": {"file": "trials.csv", "units": dict(UNITS)},
    }
    for section, values in changes.items():
        if isinstance(values, Mapping):
            merged = {**raw.get(section, {}), **values}
            raw[section] = {k: v for k, v in merged.items() if v is not None}
        else:
            raw[section] = values
    return raw


def manifest(**changes: Any) -> Campaign:
    return campaign.parse(raw_bench_manifest(**changes))
