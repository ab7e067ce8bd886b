"""Write docs/campaigns.md from finished runs: python docs/tabulate_campaigns.py OUT NAME [NAME
...]; OUT holds processed/.
"""

import json
import sys
from pathlib import Path

HEAD = """# Measured and blind campaigns

Made by `python docs/tabulate_campaigns.py OUT NAME ...` from finished runs. Nothing was tuned on the blind campaigns, which others simulated with unknown effects or none; the rule for few, long visits was learnt from the measured
`pitt-ras-2017` ([its diagnosis](closing-the-loop.md#a-measured-campaign-the-wrong-sign)). *Before*: the base model's headline coefficient with its 90 % interval. *After*: with the named effect, over all rivals. Errors are held-out, in per cent of lift.

| campaign | base model | before | verdict | effects (rivals) | after | error before | after | floor |
|---|---|---|---|---|---|---|---|---|
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
    Path(__file__).with_name("campaigns.md").write_text(HEAD + table + "\n")
