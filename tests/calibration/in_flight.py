"""Do flights in closed loop say what is true? Intervals of gain, decay length and K_b, and what the
loop names, on simulated flights.

    python -m tests.calibration.in_flight --n 100 --rows out/in_flight.jsonl

A campaign is three logs of two starts, 14 set-points each, of a vehicle of its own: K_b 1 to 3,
lift with the power 1.5 to 2 of the command, a lag of 40 to 100 ms, gusts of 0.3 to 2 % of the
weight that last 0.1 to 2 s. Finished campaigns are kept in the rows, and not made again.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta
from tests.calibration import flying
from tests.calibration.flying import FLIGHT, Craft
from tests.unit.bench_campaign import run_ingest

from nearlift import catalogue
from nearlift.errors import NotConverged
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget
from nearlift.loop.diagnose import diagnose
from nearlift.loop.search_problem import Options
from nearlift.manifest import campaign as manifests
from nearlift.products import TRIALS
from nearlift.results.quotation import CoefficientResult
from nearlift.stages import flown
from nearlift.stages.observe import observe

FIRST = 920_000
#: What each kind of flight has, and which names are right.
KINDS: dict[str, tuple[str, ...]] = {
    "nothing": (),
    "climb inflow": ("climb_inflow",),
    "translational lift": ("translational_lift",),
    "lag given wrong": ("motor_lag",),
    "a worse rotor": ("rotor_imbalance", "weight_at_rotor", "session_gain"),
}
HEIGHT = {"name": "rotor plane", "on": "height", "value": "1 mm", "scope": "campaign"}
LOGS = 3


def craft_of(kind: str, rng: np.random.Generator) -> Craft:
    craft = Craft(
        k_b=rng.uniform(1, 3),
        exponent=rng.uniform(1.5, 2.0),
        lag_s=rng.uniform(0.04, 0.1),
        gust_N=0.32 * np.exp(rng.uniform(math.log(0.003), math.log(0.02))),
        gust_s=np.exp(rng.uniform(math.log(0.1), math.log(2))),
        climb=0.0,
    )
    if kind == "climb inflow":
        return craft._replace(blades=rng.uniform(0.4, 1.0))
    if kind == "translational lift":
        return craft._replace(blades=rng.uniform(0.4, 1.0), sway_m_s=rng.uniform(3, 6))
    return craft


def record(folder: Path, craft: Craft, kind: str, rng: np.random.Generator) -> None:
    (folder / "logs").mkdir()
    for k in range(LOGS):
        # the last log is flown with a worse rotor
        worse = kind == "a worse rotor" and k == LOGS - 1
        own = craft._replace(health=(rng.uniform(0.85, 0.95), 1.0, 1.0, 1.0)) if worse else craft
        starts = [flying.fly(own, rng, flying.heights(rng, 14)) for _ in range(2)]
        flying.write_csv(folder / "logs" / f"l{k}.csv", flying.joined(*starts))
    rows = "".join(f"l{k},ground\n" for k in range(LOGS))
    (folder / "trials.csv").write_text(f"record,boundary\n{rows}")


def row(kind: str, seed: int) -> dict[str, Any]:
    """One campaign: truth, intervals with and without the set-point, and what the loop names."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    craft = craft_of(kind, rng)
    found: dict[str, Any] = {"kind": kind, "seed": seed, "truth": _truth(craft)}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        record(folder, craft, kind, rng)
        flight = {**FLIGHT}
        if kind == "lag given wrong":
            flight["lag"] = f"{1e3 * max(craft.lag_s - 0.03, 0.01):.0f} ms"
        for setpoint in (True, False):
            said = {k: v for k, v in flight.items() if setpoint or k != "setpoint"}
            given = manifests.parse(flying.manifest(said, uncertainty=[HEIGHT]))
            _, job = run_ingest(folder, folder / str(setpoint), given)
            data = observe(job.read(TRIALS), given, "ground")
            told = flown.Determined(given, data)
            key = "with" if setpoint else "without"
            try:
                found[key] = {n: _ends(c) for n, c in told.determined().items()}
            except NotConverged:
                found[key] = {}
            if not setpoint:
                continue
            found["lag"] = float(data.covariates["u_lag_s"][0])
            model, parts = catalogue.model("sanchez_cuevas"), budget.components(given)
            plain = CoefficientResult(
                value=fit(model, data, parts).theta[0], u=1.0, dof=9.0, unit="1", lo68=0.0,
                hi68=1.0, lo90=0.0, hi90=1.0, lo95=0.0, hi95=1.0, holds="",
            )  # fmt: skip
            quoted = told.coefficients(model, {"K_b": plain})["K_b"]
            if not quoted.refused:
                found[key]["K_b"] = _ends(quoted)
            first = diagnose(data, model, parts, Options(), confirm=False)
            if first.findings.verdict == "effect":
                first = diagnose(data, model, parts, Options())
            found["verdict"] = first.findings.verdict
            found["named"] = [e.name for e in first.findings.effects]
            found["rivals"] = [r for e in first.findings.effects for r in e.rivals]
    return found


def _truth(craft: Craft) -> dict[str, float]:
    def gain(z_hat: float) -> float:
        return flying.ground(z_hat * craft.radius, craft) - 1

    slope = (gain(2.01) - gain(1.99)) / 0.02
    return {"gain_at_2": gain(2.0), "decay_length": -gain(2.0) / slope, "K_b": craft.k_b}


def _ends(found: CoefficientResult) -> tuple[float, float, float]:
    return found.value, found.lo90, found.hi90


def share(k: int, n: int) -> str:
    """A count with its 95 % interval (Clopper and Pearson)."""
    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return f"{k} of {n} ({100 * low:.0f}-{100 * high:.0f})"


def tables(rows: list[dict[str, Any]]) -> str:
    """What the page shows."""
    lines = [
        "| 90 % interval | of | holds the truth | half-width over value |",
        "| --- | --- | --- | --- |",
    ]
    for key, word in (("with", "with set-point"), ("without", "without")):
        for name in ("gain_at_2", "decay_length", "K_b"):
            mine = [(r["truth"][name], r[key][name]) for r in rows if name in r.get(key, {})]
            if not mine:
                continue
            holds = sum(low <= truth <= high for truth, (_, low, high) in mine)
            half = float(np.median([(high - low) / 2 / v for _, (v, low, high) in mine]))
            lines.append(f"| `{name}` | {word} | {share(holds, len(mine))} | {half:.2f} |")
    lines += [
        "",
        "| in the flights | named right | among rivals | something else | nothing |",
        "| --- | --- | --- | --- | --- |",
    ]
    for kind, right in KINDS.items():
        mine = [r for r in rows if r["kind"] == kind]
        if not mine:
            continue
        named = sum(bool(set(r["named"]) & set(right)) for r in mine)
        rival = sum(
            not set(r["named"]) & set(right) and bool(set(r["rivals"]) & set(right)) for r in mine
        )
        none = sum(not r["named"] for r in mine)
        other = len(mine) - named - rival - none
        lines.append(
            f"| {kind} | "
            + " | ".join(share(k, len(mine)) for k in (named, rival, other, none))
            + " |"
        )
    return "\n".join(lines)


def wanted(n: int, first: int) -> Iterator[tuple[str, int]]:
    """As many without an effect, and a quarter of each of the others, in turns."""
    for seed in range(first, first + n):
        yield "nothing", seed
        if seed % 4 == 0:
            for kind in list(KINDS)[1:]:
                yield kind, seed


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--n", type=int, default=100)
    parser.add_argument("--seed", type=int, default=FIRST, help="the first")
    parser.add_argument("--rows", type=Path, required=True)
    asked = parser.parse_args()
    asked.rows.parent.mkdir(parents=True, exist_ok=True)
    asked.rows.touch()
    rows = [json.loads(line) for line in asked.rows.read_text().splitlines()]
    done = {(r["kind"], r["seed"]) for r in rows}
    with asked.rows.open("a") as file:
        for kind, seed in wanted(asked.n, asked.seed):
            if (kind, seed) not in done:
                rows.append(row(kind, seed))
                file.write(json.dumps(rows[-1]) + "\n")
                file.flush()
    print(tables(rows))


if __name__ == "__main__":
    main()
