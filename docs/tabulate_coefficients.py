"""Write docs/coefficients.md from finished runs: python docs/tabulate_coefficients.py OUT NAME
[NAME ...]; OUT holds processed/.
"""

import json
import math
import sys
from pathlib import Path
from typing import Any

from nearlift.results.document import typed
from nearlift.results.quotation import Results

HEAD = """# Coefficients of measured and blind campaigns

Made by `python docs/tabulate_coefficients.py OUT NAME ...` from finished runs. `pitt-ras-2017` is measured (one rotor, nine throttle sweeps at four distances). The blind campaigns were simulated by others, with unknown
effects or none; nothing was tuned on them. These are *base* models, before any [named effect](campaigns.md): where the residuals hold one, the values are biased. `pitt-ras-2017` has nine visits of one distance each; the jackknife over
them gives k = -2.8 (90 %: -8 to 15). Intervals are 90 %. *Over the exponents* is the range of least-squares values for the ratio raised to 1, 0.82, 2/3, 0.60 ([why](assumptions.md#held-quantity)).

| campaign | base model | coefficient | least squares | posterior | chi2/dof | over the exponents |
|---|---|---|---|---|---|---|
"""
BUDGET = """
## Budget

u without one source, over u, of the [quoted](results.md) coefficients; A from repeats, B stated or assumed. Sources of less than half a per cent are left out.

| campaign | coefficient | verdict | u | dof | sources |
|---|---|---|---|---|---|
"""
COLLAPSE = """
## Dependence on throttle

The [test](assumptions.md#throttle), and the largest difference of Delta L between two throttles that 95 % confidence does not exclude.

| campaign | p | at most |
|---|---|---|
"""


def span(e: dict[str, Any]) -> str:
    """Value and 90 % interval."""
    if e["value"] is None or not math.isfinite(e["value"]):
        return "-"
    return (
        f"{e['value']:.4g} ({e['lo90']:.4g} to {e['hi90']:.4g})"
        if math.isfinite(e["lo90"] or math.nan)
        else f"{e['value']:.4g} (no end)"
    )


def chance(p: float) -> str:
    """A p-value; below a thousandth only that."""
    return f"{p:.2g}" if p >= 1e-3 else "< 0.001"


def bases(out: Path, name: str) -> list[tuple[str, str, dict[str, Any], dict[str, Any]]]:
    """Boundary, base model, its entry, and the whole document."""
    found = json.loads((out / "processed" / name / "fit.json").read_text())
    return [(b, model, found["boundaries"][b][model], found) for b, model in found["base"].items()]


def posterior(found: dict[str, Any], boundary: str, model: str, parameter: str) -> str:
    """The posterior's interval where it was drawn."""
    entry = found["boundaries"][boundary][model].get("posterior") or found.get("posterior", {}).get(
        boundary, {}
    ).get(model, {})
    e = (entry.get("parameters") or {}).get(parameter)
    if e is None:
        return "-"
    return span(
        {
            "value": e.get("value", e.get("median", e.get("mean"))),
            "lo90": e["lo90"],
            "hi90": e["hi90"],
        }
    )


def estimates(out: Path, name: str) -> list[str]:
    """A line per coefficient."""
    lines = []
    for boundary, model, entry, found in bases(out, name):
        for i, (p, e) in enumerate(entry["parameters"].items()):
            plausible = found.get("held_quantity", {}).get(boundary, {}).get("plausible") or []
            values = [x["value"] for x in plausible]
            over = f"{min(values):.3g} to {max(values):.3g}" if values and not i else ""
            cells = [
                name,
                f"{model} ({boundary})",
                p.rstrip("_"),
                span(e),
                posterior(found, boundary, model, p),
                f"{entry['chi2'] / entry['dof']:.2f}",
                over,
            ]
            lines.append("| " + " | ".join(cells) + " |")
    return lines


def budgets(out: Path, name: str) -> list[str]:
    """A line per coefficient, as it is quoted."""
    lines = []
    quoted = typed(Results, json.loads((out / "processed" / name / "results.json").read_text()))
    for own in quoted.boundaries.values():
        for p, c in own.coefficients.items():
            shown = sorted(
                (x for x in c.budget if x.u_without < 0.995 * c.u), key=lambda x: x.u_without
            )
            sources = "; ".join(f"{x.source} ({x.kind}) {x.u_without / c.u:.2f}" for x in shown)
            dof = f"{c.dof:.0f}" if math.isfinite(c.dof) else "inf"
            lines.append(
                f"| {name} | {p.rstrip('_')} | {own.verdict} | {c.u:.3g} | {dof} | {sources} |"
            )
    return lines


def bound(departure: dict[str, Any] | None) -> str:
    """The largest departure in per cent."""
    if departure is None:
        return "-"
    x = 100 * departure["bound95"]
    return f"{x:.0f} %" if x >= 10 else f"{x:.2g} %"


def collapses(out: Path, name: str) -> list[str]:
    """A line per boundary."""
    lines = []
    for boundary, _, _, found in bases(out, name):
        c = found["throttle_collapse"][boundary]
        p = chance(c["test"]["p_value"]) if c["test"] else "-"
        lines.append(f"| {name} ({boundary}) | {p} | {bound(c['largest_departure'])} |")
    return lines


if __name__ == "__main__":
    out, names = Path(sys.argv[1]), sys.argv[2:]
    page = HEAD + "\n".join(line for n in names for line in estimates(out, n)) + "\n"
    sources = [line for n in names for line in budgets(out, n)]
    page += BUDGET + "\n".join(sources) + "\n" if sources else ""
    page += COLLAPSE + "\n".join(line for n in names for line in collapses(out, n)) + "\n"
    Path(__file__).with_name("coefficients.md").write_text(page)
