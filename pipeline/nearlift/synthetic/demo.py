"""The demo: a small simulated campaign at all three boundaries, with something in it that its
manifest does not mention.

Ground trials ran on batteries, ceiling and sidewall trials on a bench supply, and lift goes with
the square of the supply. The schedule logs the supply, as a lab's would; nothing says that it
matters. Finding that out is what the demo is about.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary, Check, Effect, Parameter, Source, normal
from nearlift.synthetic.demo_flow import write_piv
from nearlift.synthetic.records import GRAVITY, SimulatedBench, write_campaign
from nearlift.synthetic.table_1 import PERCENT_DIAMETER
from nearlift.synthetic.trial_schedule import TrialSchedule, battery_V, bench_V, randomised
from nearlift.synthetic.truth import Truth

SEED = 20210501
NAME = "demo"
VISITS = 8
SUPPLY_EXPONENT = 2.0
SUPPLY_REFERENCE_V = 3.9
#: Every other station of Table 1 read as hundredths of a diameter, and two in the gap that this
#: reading leaves at the ground.
TAKEN = (0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 19)
GAP_M = (45e-3, 90e-3)
#: A Crazyflie's feet are 24 mm below its rotors; above them stand the propellers' hubs.
CONTACT_M: dict[Boundary, float] = {"ground": 24e-3, "ceiling": 2e-3}
#: Whole-vehicle thrust of a Crazyflie 2.0 in grams-force by throttle (Bitcraze's bench table; 92 %
#: between its entries).
THRUST_GF = {0.25: 10.9, 0.5: 24.4, 0.75: 41.7, 0.92: 56.2}

NOTE = (
    "Simulated by nearlift for its demo, after Carter, Bouchard and Quinn 2021: ground"
    " (Sanchez-Cuevas, K_b = 2), ceiling (Hsiao-Chirarattananon, alpha = 0.125), sidewall (loss of"
    " 5 % at the wall). Something else is in it that this manifest does not mention."
)
UNCERTAINTY = """
[[uncertainty]]
name  = "distance datum"
on    = "height"
value = "0.1 mm"
scope = "boundary"

[simulate]
flights      = 60
draws        = 4
risks        = [0.5, 0.05]
roll_inertia = "1.6e-5 kg*m^2"

[detect]
supply = ["0 percent", "2 percent"]

[[detect.reading]]
boundary = "ground"
throttle = "49.5 percent"
u        = "0.2 percent"
weight   = "1 percent"

[[detect.reading]]
boundary = "ceiling"
ratio    = 1.08
u        = "1 percent"
"""


def supply_gain(lift: Any, /, *, supply_V: Any, exponent: Any) -> Any:
    """Lift times (supply / 3.9 V)^exponent."""
    return lift * (np.asarray(supply_V) / SUPPLY_REFERENCE_V) ** exponent


#: The demo's own, on purpose not the catalogue's: what is found must not be found by its name.
SUPPLY = Effect(
    name="demo_supply",
    title="supply voltage",
    formula=r"L \to L (V / V_0)^p",
    evaluate=supply_gain,
    acts_on="force",
    mechanism="a brushed motor at fixed duty turns more slowly on a lower voltage",
    varies_with="supply_V",
    parameters=(
        Parameter(
            name="exponent",
            unit="1",
            value=0.0,
            bounds=(-4.0, 4.0),
            prior=normal(2.0, 0.5),
            meaning="power of the supply voltage; positive where lift falls with it",
        ),
    ),
    needs=("supply_V",),
    source=Source(
        citation="own form; a DC motor's speed scales as its voltage, lift with the square of speed"
    ),
    checks=(
        Check(
            x=1.0,
            expected=0.81,
            arguments={"supply_V": 3.51, "exponent": 2.0},
            tolerance=1e-12,
            quoted_by="0.9 squared",
        ),
    ),
)


def design() -> TrialSchedule:
    """The demo's schedule, supply included."""
    sides: tuple[Boundary, ...] = ("ground", "ceiling", "sidewall")
    stations = {side: PERCENT_DIAMETER.z_m(side)[list(TAKEN)] for side in sides}
    stations["ground"] = np.sort(np.concatenate([stations["ground"], GAP_M]))
    plan = randomised(stations, seed=SEED, visits=VISITS, sessions=4)
    volts = np.where(
        plan.boundary == "ground", battery_V(plan, seed=SEED), bench_V(plan, seed=SEED)
    )
    return dataclasses.replace(plan, further={"supply_V": volts})


def truths() -> dict[Boundary, Truth]:
    """What is true in the demo."""
    bench = SimulatedBench()
    far = {throttle: 1e-3 * GRAVITY * grams for throttle, grams in THRUST_GF.items()}
    geometry = {
        "spacing_hat": bench.spacing_m / bench.radius_m,
        "diagonal_hat": np.sqrt(2) * bench.spacing_m / bench.radius_m,
    }
    undeclared = ((SUPPLY, {"exponent": SUPPLY_EXPONENT}),)
    values: dict[Boundary, tuple[str, dict[str, float]]] = {
        "ground": ("sanchez_cuevas", {"K_b": 2.0}),
        "ceiling": ("hsiao_chirarattananon", {"alpha": 0.125}),
        "sidewall": ("sidewall_decay", {"a": 0.05, "lambda_": 0.5}),
    }
    return {
        side: Truth(
            model=catalogue.model(name),
            parameters=given,
            effects=undeclared,
            lift_inf_N=far,
            geometry=geometry,
        )
        for side, (name, given) in values.items()
    }


def write_demo(folder: Path) -> Path:
    """Write the demo campaign, the same bytes each time, and return its folder.

    Raises
    ------
    UsageError
        The folder holds something other than a simulated campaign.
    """
    bench = SimulatedBench(
        rate_Hz=500.0, tare_s=0.5, record_s=2.0, contact_m=CONTACT_M, text=UNCERTAINTY
    )
    write_campaign(folder, design(), truths(), name=NAME, note=NOTE, seed=SEED, bench=bench)
    listed = write_piv(folder, bench, SEED)
    manifest = folder / "campaign.toml"
    manifest.write_text(manifest.read_text(encoding="utf-8") + listed, encoding="utf-8")
    return folder
