"""The demo: the paper's campaign, simulated, with something in it that its manifest does not
mention.

Table 1's distances, four throttles and 1000 Hz are the paper's (Carter, Bouchard and Quinn 2021).
Ground trials ran on batteries, a worn one close to the ground; ceiling and sidewall trials on a
bench supply. Lift scales as the square of the supply. The schedule logs the supply, and the
manifest does not mention that it matters. Below the ceiling lift falls short of the theory by a
form that the library does not have.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary, Check, Effect, Parameter, Source, normal, null
from nearlift.synthetic.demo_flow import write_piv
from nearlift.synthetic.records import GRAVITY, SimulatedBench, write_campaign
from nearlift.synthetic.table_1 import stations_m
from nearlift.synthetic.trial_schedule import TrialSchedule, battery_V, bench_V, randomised
from nearlift.synthetic.truth import Truth

SEED = 20210501
NAME = "demo"
VISITS = 8
SUPPLY_EXPONENT = 2.0
SUPPLY_REFERENCE_V = 3.9
#: Visits nearer to the ground than this ran on a worn battery, whose supply is lower by this.
WORN_BELOW_M, WORN_V = 60e-3, 0.05
#: Stations in the gap that Table 1, read as hundredths of a diameter, leaves at the ground.
GAP_M = (45e-3, 90e-3)
#: A Crazyflie's feet are 24 mm below its rotors; above them stand the propellers' hubs.
CONTACT_M: dict[Boundary, float] = {"ground": 24e-3, "ceiling": 2e-3}
#: Whole-vehicle thrust of a Crazyflie 2.0 in grams-force by throttle (Bitcraze's bench table; 92 %
#: between its entries).
THRUST_GF = {0.25: 10.9, 0.5: 24.4, 0.75: 41.7, 0.92: 56.2}

NOTE = (
    "Simulated by nearlift for its demo, after Carter, Bouchard and Quinn 2021: ground"
    " (Sanchez-Cuevas, K_b = 2), ceiling (Hsiao-Chirarattananon, alpha = 0.125, less gain below"
    " z_hat = 0.5), sidewall (loss of 5 % at the wall). Something else is in it that this manifest"
    " does not mention."
)
UNCERTAINTY = """
[[uncertainty]]
name  = "distance datum"
on    = "height"
value = "0.1 mm"
scope = "boundary"

[[uncertainty]]
name  = "radius"
on    = "rotor_radius"
value = "0.1 mm"
scope = "campaign"

[[uncertainty]]
name  = "spacing"
on    = "rotor_spacing"
value = "0.3 mm"
scope = "campaign"

[simulate]
flights      = 60
draws        = 4
risks        = [0.5, 0.05]
roll_inertia = "1.6e-5 kg*m^2"

[detect]
supply = ["0 percent", "2 percent"]
"""


def supply_gain(lift: Any, /, *, supply_V: Any, exponent: Any) -> Any:
    """Lift times (supply / 3.9 V)^exponent."""
    return lift * (np.asarray(supply_V) / SUPPLY_REFERENCE_V) ** exponent


#: The demo's own, on purpose not the catalogue's: what is found must not be found by its name.
SUPPLY = Effect(
    "demo_supply", "supply voltage", r"L \to L (V / V_0)^p", supply_gain,
    acts_on="force", varies_with="supply_V", needs=("supply_V",),
    mechanism="a brushed motor at fixed duty turns more slowly on a lower voltage",
    parameters=(
        Parameter("exponent", "1", 0.0, (-4.0, 4.0), normal(2.0, 0.5),
            "power of the supply voltage; positive where lift falls with it"),
    ),
    source=Source("own form; a DC motor's speed scales as its voltage, lift with the square of"
        " speed", doubts=("Exact in these simulated records only.",)),
    checks=(
        null(1.0, supply_V=3.51),
        Check(1.0, 0.81, {"supply_V": 3.51, "exponent": 2.0}, "0.9 squared", tolerance=1e-12),
    ),
)  # fmt: skip


def held_back(ratio: Any, /, *, z_hat: Any, shortfall: Any) -> Any:
    """1 + (ratio - 1) (1 - shortfall (1 - z_hat / 0.5)^2) below z_hat = 0.5."""
    near = np.clip(1.0 - np.asarray(z_hat) / CEILING_NEAR, 0.0, 1.0)
    return 1.0 + (ratio - 1.0) * (1.0 - shortfall * near**2)


CEILING_NEAR = 0.5
#: Leaves a gain of 60 % at z_hat = 0.1, the paper's largest, of the theory's 134 %.
CEILING_SHORTFALL = 0.861
#: The demo's own form: no effect of the library has it.
SHORTFALL = Effect(
    "demo_ceiling", "ceiling's shortfall",
    r"\frac{L}{L_\infty} \to 1 + (\frac{L}{L_\infty} - 1)(1 - s (1 - 2 \hat{z})^2)", held_back,
    acts_on="ratio", varies_with="z_hat", needs=("z_hat",),
    mechanism="the gain close to a ceiling is less than potential flow predicts",
    parameters=(
        Parameter("shortfall", "1", 0.0, (0.0, 1.0), normal(0.0, 0.5),
            "share of the gain that is lost at the ceiling itself"),
    ),
    source=Source("own form, after the measured 60 % of Carter, Bouchard and Quinn 2021",
        doubts=("Exact in these simulated records only.",)),
    checks=(
        null(2.337117, z_hat=0.1),
        Check(2.337117, 1.600, {"z_hat": 0.1, "shortfall": CEILING_SHORTFALL},
            "Carter, Bouchard and Quinn 2021: up to 60 %", tolerance=1e-3),
    ),
)  # fmt: skip


def design() -> TrialSchedule:
    """The demo's schedule, supply included."""
    sides: tuple[Boundary, ...] = ("ground", "ceiling", "sidewall")
    stations = {side: stations_m(side) for side in sides}
    stations["ground"] = np.sort(np.concatenate([stations["ground"], GAP_M]))
    plan = randomised(stations, seed=SEED, visits=VISITS, sessions=4)
    worn = np.where(plan.recorded_m < WORN_BELOW_M, WORN_V, 0.0)
    volts = np.where(
        plan.boundary == "ground", battery_V(plan, seed=SEED) - worn, bench_V(plan, seed=SEED)
    )
    return dataclasses.replace(plan, further={"supply_V": volts})


def truths() -> dict[Boundary, Truth]:
    """Truth of the demo."""
    bench = SimulatedBench()
    far = {throttle: 1e-3 * GRAVITY * grams for throttle, grams in THRUST_GF.items()}
    geometry = {
        "spacing_hat": bench.spacing_m / bench.radius_m,
        "diagonal_hat": np.sqrt(2) * bench.spacing_m / bench.radius_m,
    }
    undeclared = (SUPPLY, {"exponent": SUPPLY_EXPONENT})
    shortfall = (SHORTFALL, {"shortfall": CEILING_SHORTFALL})
    values: dict[Boundary, tuple[str, dict[str, float]]] = {
        "ground": ("sanchez_cuevas", {"K_b": 2.0}),
        "ceiling": ("hsiao_chirarattananon", {"alpha": 0.125}),
        "sidewall": ("sidewall_decay", {"a": 0.05, "lambda_": 0.5}),
    }
    return {
        side: Truth(
            model=catalogue.model(name),
            parameters=given,
            effects=(undeclared, shortfall) if side == "ceiling" else (undeclared,),
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
    bench = SimulatedBench(tare_s=0.5, record_s=2.0, contact_m=CONTACT_M, text=UNCERTAINTY)
    write_campaign(folder, design(), truths(), name=NAME, note=NOTE, seed=SEED, bench=bench)
    listed = write_piv(folder, bench, SEED)
    manifest = folder / "campaign.toml"
    manifest.write_text(manifest.read_text(encoding="utf-8") + listed, encoding="utf-8")
    return folder
