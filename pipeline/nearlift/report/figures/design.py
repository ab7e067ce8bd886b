"""A design's outlook: what it could see of each effect, and what it would take each one for; drawn,
and as text for the console.
"""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from nearlift.report.evidence import Columns, Rows, distinct, stack, where
from nearlift.report.figures.style import SERIES, Style, effects, note, plain_log
from nearlift.results.design import (
    BoundaryOutlook,
    ChangeOption,
    CheckedChange,
    DesignOutlook,
    PlanChanges,
)

#: Displayed units of sizes that are small in SI.
SHOWN = {"m": ("mm", 1e3), "N": ("mN", 1e3), "N/K": ("mN/K", 1e3), "N/m": ("mN/m", 1e3)}
LOOKS = {
    "named": SERIES[2],
    "seen, seldom named": SERIES[4],
    "detectable, confounded": SERIES[0],
    "too small to see": SERIES[1],
    "silent": ("0.5", "x"),
}
#: Chances below this are left blank.
LEAST = 0.05


def size_text(value: float, unit: str) -> str:
    """A size with its unit, in millimetres and millinewtons where these are handier."""
    shown, factor = SHOWN.get(unit, ("" if unit == "1" else unit, 1.0))
    return f"{factor * value:.3g} {shown}".strip()


def rows(outlook: DesignOutlook) -> Columns:
    """The figure's rows. `panel` limits: `x` the detection limit over the plausible size (nan if
    never seen); confused: `x` the chance.
    """
    parts: list[dict[str, object]] = []
    for boundary, at in outlook.boundaries.items():
        for row in at.effects:
            limit = row.detection_limit
            parts.append(
                {
                    "boundary": boundary,
                    "panel": "limits",
                    "effect": row.label,
                    "series": row.verdict,
                    "x": None if limit is None else limit / row.plausible_size,
                    "note": "" if limit is None else size_text(limit, row.unit),
                }
            )
        # of what would not be seen nothing is said beyond its limit
        for row in (r for r in at.effects if not r.hidden):
            shared = {"boundary": boundary, "panel": "confused", "effect": row.label}
            named = [(row.effect, row.within), *row.rivals.items()]
            parts += [{**shared, "series": name, "x": chance} for name, chance in named]
    return stack(parts)


def text(outlook: DesignOutlook) -> str:
    """The outlook in words."""
    lines = [f"{outlook.campaign}: a plan from {outlook.plan}"]
    lines += [line for said in outlook.assumed for line in wrap(f"Assumed: {said}.")]
    for boundary, at in outlook.boundaries.items():
        lines += ["", f"{boundary}: {at.trials} trials about {at.base_model}", ""]
        lines += _boundary(at)
    lines += [line for note in outlook.notes for line in ("", *wrap(f"Not weighed: {note}"))]
    s = outlook.schedule
    lines += [
        "",
        *wrap(
            f"Random schedule (seed {s.seed}): {s.trials} trials at {s.visits} visits in"
            f" {s.sessions} sessions, about {s.hours:.1f} h; {100 * s.from_afar:.0f} % of"
            f" visits arrive moving towards the boundary, {s.detours} drive past their station"
            " first (column via). Times are planned ones: put the true ones in."
        ),
        s.file,
        "Copy it into the campaign's folder as trials.csv; nothing is written there.",
        "",
        *(outlook.files or ()),
    ]
    return "\n".join(lines) + "\n"


def _boundary(at: BoundaryOutlook) -> list[str]:
    noise = at.expected_noise
    lines = wrap(
        f"Noise ({noise.source}): {100 * noise.relative:.2g} % of lift,"
        f" {1e3 * noise.force_N:.2g} mN, {1e3 * noise.height_m:.2g} mm per visit. False-alarm"
        f" rate {at.false_alarm_rate:g}, for all tests together."
    )
    for name, c in at.coefficients.items():
        lines += wrap(
            f"Expected: {name} = {c.expected:.3g} +- {c.u:.2g}; with every effect of"
            f" plausible size unnoticed, +- {c.u_with_undetected_effects:.2g}."
        )
    columns = f"  {'effect':<22} {'limit':>12} {'plausible':>12} {'seen':>5} {'alone':>6}  verdict"
    lines += ["", columns]
    for row in at.effects:
        size, unit = row.detection_limit, row.unit
        limit = "never" if size is None else size_text(size, unit)
        plausible = size_text(row.plausible_size, unit)
        chances = f"{100 * row.seen:4.0f}% {100 * row.alone:5.0f}%"
        lines.append(f"  {row.label:<22} {limit:>12} {plausible:>12} {chances}  {row.verdict}")
    meant = (
        "  limit: size seen with 80 % chance; seen, alone: chances at the plausible size (alone:"
        " named without a rival)"
    )
    lines += ["", meant, ""]
    hidden = [r for r in at.effects if r.hidden]
    first = next(iter(at.coefficients), None)
    if first is not None and hidden:
        worst = sorted(hidden, key=lambda r: -abs(r.bias[first].in_u))[:3]
        biases = "; ".join(
            f"{r.label} of {size_text(r.hides_up_to, r.unit)}: {r.bias[first].shift:+.2g}"
            for r in worst
        )
        lines += wrap(f"Bias of {first} by what this plan would not see: {biases}.")
    lines += [line for unknown in at.limits for line in wrap(unknown.text)]
    for group in at.groups:
        lines += wrap(f"Confounded: {', '.join(group)}.")
    for lacking in at.untestable:
        if lacking.log_next_time:
            lines += wrap(f"Untestable: {lacking.effect}; log {', '.join(lacking.log_next_time)}.")
    lines += _changes(at.changes)
    return lines


def _changes(changes: PlanChanges) -> list[str]:
    if not changes.pairs:
        return ["", "Nothing that would be seen is confused with anything else."]
    lines = ["", "What would part them (expected evidence; 13 is enough for one pair)"]
    for pair in changes.pairs:
        one, other = pair.pair
        lines.append(
            f"  {one} of {size_text(pair.size, pair.unit)} against {other}: evidence"
            f" {pair.evidence_now:.1f}"
        )
        if pair.held_together_by == "form":
            lines.append(
                "    more trials do not help: what is not known is the exact form of either"
            )
        elif not pair.options:
            lines.append("    none of the proposals parts them within ten times its trials")
        lines += [f"    {option.change}: {_cost(option)}" for option in pair.options]
        if pair.log:
            lines.append(f"    log: {', '.join(pair.log)}")
    lines += ["", "Changes that serve most pairs"]
    for best in changes.best:
        cost = f"{best.trials} trials" if best.trials else "no further trial"
        lines.append(f"  {best.change} ({cost}): parts {best.pairs_parted} of {best.pairs}")
        checked = (best.rivals_after if isinstance(best, CheckedChange) else None) or ()
        resolved = [r for r in checked if r.after < r.before - 0.2]
        lines += [
            f"    {r.pair[0]} taken for {r.pair[1]}: {100 * r.before:.0f} % ->"
            f" {100 * r.after:.0f} %"
            for r in resolved[:4]
        ]
    return lines


def _cost(option: ChangeOption) -> str:
    if option.evidence_per_trial is None:
        return f"no further trial, evidence {option.evidence:.1f}"
    return f"some {option.trials_to_part} trials (evidence {option.evidence_per_trial:.2g} each)"


def wrap(text: str) -> list[str]:
    """Lines of a console's text."""
    return textwrap.wrap(text, 110)


def draw(rows: Rows, look: Style) -> Figure:
    """A line of two panels for each boundary."""
    sides = distinct(rows["boundary"])
    limits = [where(rows, boundary=side, panel="limits") for side in sides]
    heights = [1.55 + 0.155 * len(distinct(part["effect"])) for part in limits]
    figure = Figure(figsize=(look.double_in, sum(heights)), layout="constrained")
    grid = figure.subplots(
        len(sides), 2, squeeze=False, width_ratios=(1, 1.25), height_ratios=heights
    )
    for line, side, part in zip(grid, sides, limits, strict=True):
        _limits(line[0], part, side)
        _confused(line[1], where(rows, boundary=side, panel="confused"))
    return figure


def _limits(ax: Axes, rows: Rows, side: str) -> None:
    names, verdict, x, sizes = (rows[k] for k in ("effect", "series", "x", "note"))
    place = np.arange(len(names))[::-1]
    finite = x[np.isfinite(x)]
    low, high = (finite.min(), finite.max()) if len(finite) else (0.1, 10.0)
    edge = 3.0 * max(high, 1.0)
    ax.axvspan(1.0, 30 * edge, color="0.93", linewidth=0, zorder=0)
    for y, kind, limit, size in zip(place, verdict, x, sizes, strict=True):
        colour, marker = LOOKS[kind]
        at, text = limit, size
        if not np.isfinite(limit):
            at, marker, text = edge, "x", "never"
        ax.plot([at], [y], marker=marker, color=colour, markersize=4, zorder=3)
        note(ax, text, (at, y), (5, -2.4), color="0.25")
    ax.set_xscale("log")
    ax.set_xlim(0.5 * min(low, 0.5), 12 * edge)
    plain_log(ax.xaxis)
    ax.set_yticks(place, [effects(str(n)) for n in names])
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(-0.8, len(names) - 0.2)
    ax.set_xlabel("detection limit over plausible size", labelpad=1)
    ax.set_title(f"{side}: what could be seen")
    looks = {kind: look for kind, look in LOOKS.items() if kind in verdict}
    ax.legend(
        [
            Line2D([], [], linestyle="none", marker=marker, color=colour, markersize=4)
            for colour, marker in looks.values()
        ],
        list(looks),
        loc="upper center",
        bbox_to_anchor=(0.4, -0.1 - 1.6 / (6 + len(names))),
        ncols=2,
        columnspacing=0.8,
        handlelength=1.0,
    )


def _confused(ax: Axes, rows: Rows) -> None:
    if not len(rows["x"]):
        ax.set_axis_off()
        return
    truth, said = distinct(rows["effect"]), distinct(rows["series"])
    taken = [t for t in dict.fromkeys([*truth, *said]) if t in said]
    table = np.full((len(truth), len(taken)), np.nan)
    for a, b, chance in zip(rows["effect"], rows["series"], rows["x"], strict=True):
        if chance >= LEAST:
            table[truth.index(a), taken.index(b)] = 100 * chance
    ax.imshow(table, cmap="Blues", vmin=0, vmax=130, aspect="auto")
    # "100" stays within its cell
    size = min(rcParams["legend.fontsize"], 105 / len(taken))
    for i, j in zip(*np.nonzero(np.isfinite(table)), strict=True):
        same = truth[i] == taken[j]
        ax.text(
            j, i, f"{table[i, j]:.0f}", ha="center", va="center",
            fontsize=size, fontweight="bold" if same else "normal",
            color="white" if table[i, j] > 70 else "black",
        )  # fmt: skip
    ax.set_xticks(np.arange(len(taken)), [effects(str(t)) for t in taken], rotation=90)
    ax.set_yticks(np.arange(len(truth)), [effects(str(t)) for t in truth])
    ax.tick_params(length=0)
    ax.set_xticks(np.arange(len(taken)) - 0.5, minor=True)
    ax.set_yticks(np.arange(len(truth)) - 0.5, minor=True)
    ax.grid(which="minor", color="0.9", linewidth=0.4)
    ax.tick_params(which="minor", length=0)
    ax.set_title("if this acts, this is named or a rival (%)")
