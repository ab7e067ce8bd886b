"""Write docs/campaigns.md from finished runs: python docs/tabulate_campaigns.py OUT NAME [NAME ...]; OUT holds processed/."""

import json
import sys
from pathlib import Path

HEAD = """# Measured and blind campaigns

Run with `nearlift run ../shared/... --out OUT`, and tabulated by `docs/tabulate_campaigns.py`. Nothing was tuned on
them.

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
*fall* towards the ground. The supply voltage fell from run to run while the distance was made smaller: the two are
confounded by design. The loop sees the structure (in supply, start and session alike). By evidence it would name the
gain of each session, which can absorb distance altogether; on runs left out that gains nothing, so it is not named, and
the verdict is `unexplained`, with session_gain as a partial explanation. The supply alone leaves more between runs than
the scatter within a run allows, and the loop does not yet know how well a whole run repeats. A plain least-squares
fit of log lift with a supply exponent, checked by hand, cuts the error on runs left out from 5.98 % to 1.60 % (exponent
2.27, k from -2.7 to 0.52): that the loop does not find this by itself is its first defect to mend.
"""


def interval(c: dict[str, float]) -> str:
    """Value and 90 % interval."""
    return f"{c['value']:.3g} ({c['lo90']:.3g} to {c['hi90']:.3g})"


def row(out: Path, name: str) -> list[str]:
    """One line per boundary."""
    found = json.loads((out / "processed" / name / "diagnosis.json").read_text())["boundaries"]
    lines = []
    for boundary, d in found.items():
        effects = "; ".join(e["name"] + (f" ({', '.join(e['rivals'])})" if e["rivals"] else "") for e in d["effects"])
        if not effects and d["verdict"] == "unexplained":
            effects = f"structure in {d['structure'][0]['covariate']}"
        headline = next(iter(d["coefficients"]["before"]))
        before, after = d["coefficients"]["before"][headline], d["coefficients"]["after"][headline]
        e = d["error"]
        errors = [f"{100 * v:.2f}" for v in (e["before"]["held_out_rmse"], e["after"]["held_out_rmse"], e["noise_floor"])]
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
