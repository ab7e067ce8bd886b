"""Write docs/campaigns.md from finished runs: python docs/tabulate_campaigns.py OUT NAME [NAME
...]; OUT holds processed/.
"""

import json
import sys
from pathlib import Path

HEAD = """# Measured and blind campaigns

Run with `nearlift run ../shared/... --out OUT`, and tabulated by `docs/tabulate_campaigns.py`. Nothing was tuned on
the blind ones; that few, long visits are judged in a way of their own was learnt from `pitt-ras-2017`.

`pitt-ras-2017` is measured (one rotor, nine throttle sweeps at four distances; public data of the Pitt-RAS team); the
blind campaigns are simulated by others, with unknown effects inside, or none. *Before* is the base model's headline
coefficient with its 90 % interval at the noise floor; *after* adds the named effect, over all rivals with their form
uncertain. Errors are held-out, in per cent of lift.

| campaign | base model | before | verdict | effects (rivals) | after | error before | after | floor |
|---|---|---|---|---|---|---|---|---|
"""
TAIL = """
## The measured campaign, as it is

The Cheeseman-Bennett coefficient of `pitt-ras-2017` comes out with the wrong sign (theory: k = 1): lift seems to
*fall* towards the ground. The supply voltage fell from run to run while the distance was made smaller, so a fit without
the supply charges its effect to distance (over the trials the two correlate by -0.5).

Nine runs are nine long visits of one distance each, so each is left out in turn, and what predicts it decides (see the
[stage page](stages/diagnose.md)). `supply_sag` is found unaided, and in each of the nine folds: the error on runs left
out falls from 5.71 % to 1.64 % (to 29 %), the exponent is 2.31 (90 %: 2.17 to 2.45, jackknife over runs), and k goes
from -2.8 to 0.6. A plain least-squares fit, by hand, gives 5.98 to 1.60 %, 2.27 and 0.52. No second effect earns its
place.

What stays unknown is said by the loop itself: k rests to two thirds on the one run near the ground (0.6 with a 90 %
interval from -0.7 to 1.8, which holds 1 and 0 alike, and is not forced to theory); and a gain of its own for every run
would absorb k altogether, since no run holds more than one distance. It asks for more visits near the ground, and for
several distances within each session. Structure within runs is left; it decides nothing.
"""


def interval(c: dict[str, float]) -> str:
    """Value and 90 % interval."""
    return f"{c['value']:.3g} ({c['lo90']:.3g} to {c['hi90']:.3g})"


def row(out: Path, name: str) -> list[str]:
    """One line per boundary."""
    found = json.loads((out / "processed" / name / "diagnosis.json").read_text())["boundaries"]
    lines = []
    for boundary, d in found.items():
        effects = "; ".join(
            e["name"] + (f" ({', '.join(e['rivals'])})" if e["rivals"] else "")
            for e in d["effects"]
        )
        if not effects and d["verdict"] == "unexplained":
            effects = f"structure in {d['structure'][0]['covariate']}"
        headline = next(iter(d["coefficients"]["before"]))
        before, after = d["coefficients"]["before"][headline], d["coefficients"]["after"][headline]
        e = d["error"]
        errors = [
            f"{100 * v:.2f}"
            for v in (e["before"]["held_out_rmse"], e["after"]["held_out_rmse"], e["noise_floor"])
        ]
        cells = [
            name,
            f"{d['base_model']} ({boundary})",
            f"{headline} = {interval(before)}",
            d["verdict"],
            effects or "none",
            interval(after),
            *errors,
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


if __name__ == "__main__":
    out, names = Path(sys.argv[1]), sys.argv[2:]
    table = "\n".join(line for name in names for line in row(out, name))
    Path(__file__).with_name("campaigns.md").write_text(HEAD + table + "\n" + TAIL)
