"""Make again the figures of docs/flights.md: ``python docs/worked/flight.py OUT``.

Simulates three logs of a Crazyflie-like vehicle whose rotors lose thrust in a climb, writes them as
a controller would, brings them from file to named effects in OUT, and puts reduced pictures of each
step into docs/figures.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from closing_the_loop import FIGURES, keep, nearlift
from tests.calibration import flying
from tests.calibration.flying import Craft, Log

from nearlift.products import TRIALS
from nearlift.run import store

CRAFT = Craft(blades=0.6, climb=0.0, gust_N=0.0015)
#: What `new` leaves to be filled in, as it is of this vehicle.
FILLED = {
    'name          = "FILL IN"': 'name          = "simulated"',
    'rotors        = "FILL IN"': "rotors        = 4",
    'rotor_radius  = "FILL IN mm"': 'rotor_radius  = "23.1 mm"',
    'rotor_spacing = "FILL IN mm"': 'rotor_spacing = "65 mm"',
    'mass          = "FILL IN g"': 'mass          = "32.7 g"',
    'distance_datum  = "FILL IN"': 'distance_datum  = "airframe"',
    'distance_offset = "FILL IN mm"': 'distance_offset = "30 mm"',
    'gravity         = "FILL IN m/s^2"': 'gravity         = "9.81 m/s^2"',
}
HEIGHT = """
[[uncertainty]]
name = "rotor plane above the feet"
on = "height"
value = "1 mm"
scope = "campaign"
"""


def drawn(name: str, log: Log, out: Path) -> None:
    """The first 40 s of a log, as it was logged."""
    fig, axes = plt.subplots(3, 1, figsize=(9, 5), sharex=True, layout="constrained")
    own = log["t"] < 40
    t = log["t"][own]
    for key, label in (("z", "height"), ("setpoint", "set-point")):
        axes[0].plot(t, log[key][own], label=label, lw=1)
    axes[0].set_ylabel("m")
    axes[0].legend(loc="upper right")
    told = np.mean([log[f"m{k}"][own] for k in (1, 2, 3, 4)], axis=0)
    axes[1].plot(t, 100 * told / flying.FULL, lw=1)
    axes[1].set_ylabel("command, %")
    axes[2].plot(t, log["az"][own], lw=0.6)
    axes[2].set_ylabel("felt, m/s²")
    axes[2].set_xlabel("time, s")
    fig.savefig(out / f"{name}.png", dpi=150)
    plt.close(fig)
    keep(out / f"{name}.png", name)


def windows(name: str, trials: store.Table, out: Path) -> None:
    """Height, climb and lift of each window, by what became of it."""
    fig, axes = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    weight = CRAFT.mass * flying.G
    good = trials["quality"] == ""
    axes[0].plot(trials["z_hat"][good], trials["lift_N"][good] / weight, ".", ms=3)
    axes[0].set_xlabel("height over rotor radius")
    axes[0].set_ylabel("lift over weight")
    volts = trials["throttle"][good] * trials["supply_V"][good]
    points = axes[1].scatter(
        np.log(volts), np.log(trials["lift_N"][good]), c=trials["climb_m_s"][good], s=5, cmap="RdBu"
    )
    axes[1].set_xlabel("log (command x supply)")
    axes[1].set_ylabel("log lift")
    fig.colorbar(points, label="climb, m/s")
    fig.savefig(out / f"{name}.png", dpi=150)
    plt.close(fig)
    keep(out / f"{name}.png", name)


def campaign(out: Path) -> Path:
    """Three logs, and the folder that `nearlift new` makes of them, filled in."""
    rng, logs, root = np.random.default_rng(2026), out / "logs", out / "flown"
    logs.mkdir(parents=True)
    for k in range(3):
        starts = [flying.fly(CRAFT, rng, flying.heights(rng, 14)) for _ in range(2)]
        log = flying.joined(*starts)
        (logs / f"l{k}").write_bytes(flying.usd(log))
        if k == 0:
            drawn("flight-log", log, out)
    nearlift("new", root, *(x for k in range(3) for x in ("--from", logs / f"l{k}")))
    text = (root / "campaign.toml").read_text()
    for blank, fact in FILLED.items():
        text = text.replace(blank, fact)
    # no contact and no arena in this one
    text = "".join(line for line in text.splitlines(True) if "FILL IN" not in line)
    text = text.replace('name   = "flown"', 'name   = "flown"\nsimulated = true')
    (root / "campaign.toml").write_text(text + HEIGHT)
    rows = (root / "trials.csv").read_text()
    (root / "trials.csv").write_text(rows.replace("FILL IN", "ground"))
    return root


if __name__ == "__main__":
    out = Path(sys.argv[1])
    root = campaign(out)
    nearlift("run", root, "--out", out, "-q")
    windows("flight-windows", store.read_table(out / "processed/flown" / TRIALS.file, TRIALS), out)
    nearlift("diagnose", root, "--out", out, "--explain", "climb_inflow", "-q")
    reports = out / "reports/flown"
    keep(reports / "fig2.png", "flight-curve")
    keep(reports / "diagnosis.png", "flight-loop")
    keep(reports / "explain/climb_inflow.png", "flight-climb")
    print((reports / "summary.txt").read_text())
    print(sorted(p.name for p in FIGURES.glob("flight-*")))
