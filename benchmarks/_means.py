"""A campaign of means, of any number of trials at one boundary: what grows when only the trials
grow.
"""

from __future__ import annotations

from pathlib import Path

THROTTLES = 4
STATIONS = 20
MANIFEST = """# SIMULATED. No such measurement was ever made.
schema = "nearlift.campaign/1"
name   = "{name}"
simulated = true

[vehicle]
name          = "Crazyflie 2.0"
rotors        = 4
rotor_radius  = "23 mm"
rotor_spacing = "65 mm"
mass          = "27 g"

[rig]
held            = "throttle"
distance_datum  = "rotor plane"
distance_offset = "0 mm"
arena           = "1.5 m"
air_density     = "1.2 kg/m^3"
gravity         = "9.8 m/s^2"

[load_cell]
sample_rate = "1000 Hz"
range       = "1 kgf"
accuracy    = "1.5 gf"

[records]
reader = "means"

[trials]
file = "trials.csv"
[trials.units]
distance    = "mm"
throttle    = "percent"
lift        = "N"
lift_sd     = "N"
start       = "s"
supply      = "V"
temperature = "K"

[[uncertainty]]
name  = "distance datum"
on    = "height"
value = "0.05 mm"
scope = "boundary"
"""


def campaign(
    data: Path, trials: int, *, sessions: int = 12, scattered: bool = False, sagging: bool = False
) -> Path:
    """The folder of a campaign above the ground, of visits of four throttles each, written if it is
    not there.

    `sagging`: lift follows the battery, so that the loop has something to name.
    `scattered`: every visit has a height of its own, as where the traverse reports where it
    stopped; else 20 stations.
    """
    import numpy as np

    from nearlift.synthetic import demo
    from nearlift.synthetic.trial_schedule import battery_V, randomised

    name = f"means-{trials}-{sessions}{'-scattered' if scattered else ''}{'-sagging' if sagging else ''}"
    folder = data / name
    if (folder / "trials.csv").exists():
        return folder
    rng = np.random.default_rng(trials)
    stations = 0.023 * np.geomspace(1.1, 12.0, STATIONS)
    visits = trials // (THROTTLES * STATIONS)
    plan = randomised({"ground": stations}, seed=1, visits=visits, sessions=sessions)
    visit = plan.visit
    recorded = plan.recorded_m * (
        np.exp(0.05 * rng.standard_normal(visit[-1] + 1))[visit] if scattered else 1.0
    )
    recorded = np.round(recorded, 6)
    true = recorded + 5e-5 * rng.standard_normal(visit[-1] + 1)[visit]
    truth = demo.truths()["ground"]
    expected = np.empty(len(plan))
    for throttle, lift in truth.lift_inf_N.items():
        here = plan.throttle == throttle
        expected[here] = lift * truth.model.evaluate(
            true[here] / 0.023, **truth.parameters, **truth.geometry
        )
    lift = expected * (
        1
        + 0.005 * rng.standard_normal(len(plan))
        + 0.002 * rng.standard_normal(visit[-1] + 1)[visit]
    )
    supply = battery_V(plan, seed=1)
    if sagging:
        lift = lift * (supply / np.median(supply)) ** 1.5
    temperature = 293 + plan.start_s / 36000 + 0.05 * rng.standard_normal(len(plan))
    rows = [
        "trial,boundary,distance,throttle,start,session,approach,lift,lift_sd,n,supply,temperature"
    ]
    rows += [
        f"{plan.trial[i]},ground,{1e3 * recorded[i]:.6g},{100 * plan.throttle[i]:.6g},{plan.start_s[i]:.2f},{plan.session[i]},"
        f"{plan.approach[i]:+.0f},{lift[i]:.7g},0.002,10000,{supply[i]:.7g},{temperature[i]:.6g}"
        for i in range(len(plan))
    ]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.toml").write_text(MANIFEST.format(name=name))
    (folder / "trials.csv").write_text("\n".join(rows) + "\n")
    return folder
