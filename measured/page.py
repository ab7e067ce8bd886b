"""Tables and figures of docs/measured.md."""

from __future__ import annotations

import csv
import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from nearlift.report.figures.style import SERIES, Style, context
from nearlift.run import tables
from nearlift.stages.ingest import TRIALS

from .campaigns import Measured
from .injections import HEIGHTS_MM, KINDS, SIZES, WITHHELD, Case, outcome
from .loop import Finding

DOCS = Path(__file__).resolve().parent.parent / "docs"
OUTCOMES = ("found", "missed", "false", "abstained")
#: Marker and colour of each outcome.
LOOKS = dict(zip(("missed", "false", "found", "abstained"), SERIES, strict=False))
HEAD = """# Measured campaigns

Made by `make measured` from the public data of `nearlift data`, which this repository does not hold. *Error*: cross-validated rms over visits (trials, where their order is unknown) in per cent of lift, with its 90 % range, of the base model and of the final one. *Floor*: noise floor.
*Depends on*: shift of the quoted coefficient without its most influential visit. *Holds*: campaigns without one visit (of more than 24, one distance) or one trial (of more than 24, the most influential) in which the verdict is the same, and a named effect is named again or a rival.

![errors before and after](figures/measured-errors.png)

*Held-out error of the base model (open) and of the final one (filled), 90 % ranges; the tick is the noise floor.*

| campaign | trials | verdict: effects (rivals) | error before | after | floor | quoted coefficient (90 %) | depends on | holds: visits, trials |
|---|---|---|---|---|---|---|---|---|
"""
TAIL = """
*Unexplained* campaigns have structure and no acceptable candidate. A verdict that changes without one visit or trial depends on it; the page and `results.json` (`rests_on`) say so. No campaign is of a tethered vehicle; [how to send one](public-data.md#sending-a-data-set). The five wall tables of the JIRS paper hold force and moment of the wall and no lift; `roll_moment`, `pitch_moment` and `wall_force` are carried as outcomes.

"""


def number(x: Any) -> str:
    """Three digits; a dash where there is none."""
    return "–" if x is None or not math.isfinite(float(x)) else f"{float(x):.3g}"


def percent(e: Any) -> str:
    """An error and its range, in per cent."""
    if e is None:
        return "–"
    value, low, high = (e["held_out_rmse"], e["lo90"], e["hi90"]) if isinstance(e, dict) else e
    return f"{100 * value:.2f} ({100 * low:.1f} to {100 * high:.1f})"


def interval(e: Any) -> str:
    """A coefficient and its range."""
    value, low, high = e
    return f"{number(value)} ({number(low)} to {number(high)})"


def effects(found: list[tuple[str, tuple[str, ...]]]) -> str:
    """Names with their rivals."""
    return "; ".join(f"`{n}`" + (f" ({', '.join(r)})" if r else "") for n, r in found)


def products(place: Path) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """Boundary, its diagnosis and its result."""
    [(boundary, d)] = json.loads((place / "diagnosis.json").read_text())["boundaries"].items()
    return (
        boundary,
        d,
        json.loads((place / "results.json").read_text())["boundaries"][boundary],
    )


def row(one: Measured, place: Path, held: dict[str, Any]) -> tuple[str, str]:
    """The campaign's line, and a remark for below the table."""
    boundary, d, quoted = products(place)
    name, c = next(iter(quoted["coefficients"].items()))
    named = effects([(e["name"], e["rivals"]) for e in d["effects"]])
    if d["verdict"] == "unexplained":
        along = dict.fromkeys(s["covariate"] for s in d["structure"])
        named = f"structure along {', '.join(along)}"
    visit = c["influence"]["visit"]
    on = "–" if visit is None else f"z_hat = {visit['z_hat']:.3g}: {visit['shift']:+.2g}"
    e = d["error"]
    cells = [
        one.name,
        str(len(tables.read_table(place / TRIALS.file, TRIALS)["trial"])),
        f"**{d['verdict']}**" + (f": {named}" if named else ""),
        percent(e["before"]),
        percent(e["after"]),
        f"{100 * e['noise_floor']:.2f}",
        f"{name} = {interval((c['value'], c['lo90'], c['hi90']))}",
        on,
        ", ".join(f"{a} of {b}" for a, b in (held["visits"], held["trials"])),
    ]
    remark = f"- **{one.name}** ({d['base_model']}, {boundary}): {one.remark}."
    if lost := held["lost"]:
        more = "" if len(lost) <= 4 else f" and {len(lost) - 4} more"
        remark += f" Another verdict without {', '.join(lost[:4])}{more}."
    if partial := d.get("partial"):
        shares = [f"`{x['name']}` {100 * x['share']:.0f} %" for x in partial[:2]]
        remark += f" In part: {', '.join(shares)}."
    if wanted := [n["measure"] for n in d["next_experiment"]][:2]:
        remark += f" To measure next: {'; '.join(wanted)}."
    logs = dict.fromkeys(w for u in d["untestable"] for w in u.get("log_next_time", u["needs"]))
    if logs:
        remark += f" To log next time: {', '.join(list(logs)[:6])}."
    return "| " + " | ".join(cells) + " |", remark


def said(found: Finding) -> str:
    """Verdict with its effects."""
    return f"{found.verdict}" + (f": {effects(list(found.effects))}" if found.effects else "")


WITHHELD_HEAD = """## A logged cause withheld

The loop sees the campaign without the column. *Unexplained*, or a confounded cause with its rivals, is right there. One line makes a row again: `python -m measured --case NAME withheld`.

| campaign | withheld | with it | without it | error before | after | coefficient with it | without it |
|---|---|---|---|---|---|---|---|
"""
#: Reading of that table, of these data.
WITHHELD_TAIL = """
Without its supply column pitt-ras-2017 is *unexplained*, and k has the wrong sign again. Two answers are wrong. Along the rotors' axes Garofano-Soldado's campaign has a name without its tilts: `session_gain` is the cause, since each configuration is a session, and `room_recirculation` is not.
The 12-inch rotors above ground are *adequate* without their speed: what is left in distance is too little for 20 cells.
"""


def withheld(pairs: list[tuple[Case, Finding, Finding]]) -> str:
    """Table of campaigns with and without the column of a logged cause."""
    lines = []
    for case, without, full in pairs:
        cells = [
            case.campaign,
            ", ".join(WITHHELD[case.campaign]),
            said(full),
            said(without),
            percent(without.before),
            percent(without.after),
            f"{full.coefficient} = {interval(full.number)}",
            interval(without.number),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return WITHHELD_HEAD + "\n".join(lines) + "\n" + WITHHELD_TAIL


INJECTIONS_HEAD = """## Effects put into measured trials

By arithmetic on the measured means. Sizes are in units of the campaign's noise floor (rms of the relative change of lift); height offsets in mm. A campaign without start or supply gets a random order and a battery, and is compared with itself without the injection.
*Found*: named, or a rival. *False*: a name that is neither the cause nor in the answer without the injection. *Abstained*: unexplained. *Missed*: the answer is that without the injection.

![outcomes](figures/measured-injections.png)

*Outcome of each injection, by campaign.*

"""
#: Reading of that table, of these data.
INJECTIONS_TAIL = """
- A table of 20 cells has no order, so no drift is searched, and only single effects are tried: a second one next to a first ends *unexplained*.
- L_inf at each throttle takes up most of a zero offset, and the library limits it to 50 mN.
- A height offset of 1 mm changes lift by 1 % at most, at the nearest distance of 50 mm: less than the noise floor.
- In nine sweeps, a gain drift and a session gain of twice the noise end *unexplained*: both are confounded with the sag and the distance.
"""


def injections(found: list[tuple[Case, Finding, Finding]]) -> str:
    """Table of outcomes by kind and size, and one of campaigns."""
    count = Counter((c.kind, c.size, outcome(c, f, base)) for c, f, base in found)
    anyway = sum(
        base.verdict == "unexplained" and outcome(c, f, base) == "abstained" for c, f, base in found
    )
    lines = [
        "| effect | size | " + " | ".join(OUTCOMES) + " |",
        "|---|---|" + "---|" * len(OUTCOMES),
    ]
    for kind in KINDS:
        for size in HEIGHTS_MM if kind == "height_offset" else SIZES:
            unit = " mm" if kind == "height_offset" else ""
            cells = [str(count[kind, size, o]) for o in OUTCOMES]
            lines.append(f"| `{kind}` | {size:g}{unit} | " + " | ".join(cells) + " |")
    sums = [str(sum(n for key, n in count.items() if key[2] == o)) for o in OUTCOMES]
    lines.append("| all | | " + " | ".join(sums) + " |")
    lines += [
        "",
        (
            f"{anyway} of those that abstained are in campaigns that are unexplained anyway. All rows,"
            " with errors and the coefficient with and without the injection:"
            " [measured-injections.csv](measured-injections.csv). One line makes a row again:"
            " `python -m measured --case jirs2024-ceiling-12-inch gain_drift 2`."
        ),
        "",
        "| campaign | without an injection | interval holds the coefficient without it |",
        "|---|---|---|",
    ]
    for name in dict.fromkeys(c.campaign for c, *_ in found):
        mine = [(f, base) for c, f, base in found if c.campaign == name]
        holds = sum(f.number[1] <= base.number[0] <= f.number[2] for f, base in mine)
        lines.append(f"| {name} | {said(mine[0][1])} | {holds} of {len(mine)} |")
    return INJECTIONS_HEAD + "\n".join(lines) + "\n" + INJECTIONS_TAIL


def write_rows(path: Path, found: list[tuple[Case, Finding, Finding]]) -> None:
    """Every injection as a row of a CSV file."""
    head = (
        "campaign,effect,size,outcome,verdict,effects,error_before,error_after,coefficient,value,"
        "lo90,hi90,value_without,lo90_without,hi90_without,command"
    )
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head.split(","))
        for case, f, base in found:
            errors = [f"{e[0]:.4g}" if e else "" for e in (f.before, f.after)]
            numbers = [f"{x:.4g}" for x in (*f.number, *base.number)]
            names = "; ".join(" or ".join((n, *r)) for n, r in f.effects)
            writer.writerow(
                [
                    case.campaign,
                    case.kind,
                    f"{case.size:g}",
                    outcome(case, f, base),
                    f.verdict,
                    names,
                    *errors,
                    f.coefficient,
                    *numbers,
                    f"python -m measured {case.words}",
                ]
            )


def draw_errors(places: dict[str, Path]) -> Figure:
    """Held-out errors before and after, by campaign."""
    look = Style()
    figure = Figure(figsize=(look.double_in, 2.5), layout="constrained")
    ax = figure.subplots()
    colour = SERIES[0][0]
    for i, place in enumerate(places.values()):
        e = products(place)[1]["error"]
        for shift, key, face in ((-0.13, "before", "white"), (0.13, "after", colour)):
            x = [100 * e[key][k] for k in ("held_out_rmse", "lo90", "hi90")]
            ax.errorbar(
                x[0],
                i + shift,
                xerr=[[max(x[0] - x[1], 0)], [max(x[2] - x[0], 0)]],
                color=colour,
                marker="o",
                markersize=4,
                markerfacecolor=face,
                elinewidth=0.8,
                label=key if i == 0 else None,
            )
        ax.plot(
            [100 * e["noise_floor"]] * 2,
            [i - 0.32, i + 0.32],
            color="0.35",
            linewidth=1.4,
            label="noise floor" if i == 0 else None,
        )
    ax.set_yticks(range(len(places)), list(places))
    ax.tick_params(axis="y", length=0)
    ax.invert_yaxis()
    ax.set_xlim(0)
    ax.set_xlabel("error on visits left out (% of lift)")
    ax.legend(loc="lower right")
    return figure


def draw_injections(found: list[tuple[Case, Finding, Finding]]) -> Figure:
    """A mark for each injection, by campaign (rows), effect and size (columns)."""
    look = Style()
    names = list(dict.fromkeys(c.campaign for c, *_ in found))
    columns = list(dict.fromkeys((c.kind, c.size) for c, *_ in found))
    where = {}
    for i, (kind, size) in enumerate(columns):
        where[kind, size] = i + 0.6 * list(KINDS).index(kind)
    figure = Figure(figsize=(look.double_in, 0.9 + 0.24 * len(names)), layout="constrained")
    ax = figure.subplots()
    for name in OUTCOMES:
        at = [
            (where[c.kind, c.size], names.index(c.campaign))
            for c, f, base in found
            if outcome(c, f, base) == name
        ]
        colour, marker = LOOKS[name]
        x, y = np.array(at).reshape(-1, 2).T
        face = "none" if name in ("missed", "abstained") else colour
        ax.plot(
            x, y, linestyle="none", marker=marker, color=colour, markerfacecolor=face, label=name
        )
    ax.set_xticks([where[c] for c in columns], [f"{size:g}" for _, size in columns])
    ax.set_yticks(range(len(names)), names)
    ax.tick_params(length=0)
    ax.set_ylim(len(names) - 0.5, -0.5)
    for kind in dict.fromkeys(kind for kind, _ in columns):
        mine = [where[c] for c in columns if c[0] == kind]
        unit = ", mm" if kind == "height_offset" else ""
        ax.text(np.mean(mine), -0.75, kind.replace("_", " ") + unit, ha="center", va="bottom")
    ax.set_xlabel("size, in noise floors")
    figure.legend(loc="outside lower right", ncols=len(OUTCOMES))
    return figure


def save(draw: Any, what: Any, path: Path) -> None:
    """Draw in the style of figures and keep a PNG without dates."""
    with context(Style()):
        draw(what).savefig(path, dpi=160, metadata={"Software": None})
