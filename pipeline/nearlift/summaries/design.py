"""A design's outlook as a table to draw, and as text for the console."""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np

from nearlift.summaries.evidence import Columns

#: Displayed units of sizes that are small in SI.
SHOWN = {"m": ("mm", 1e3), "N": ("mN", 1e3), "N/K": ("mN/K", 1e3), "N/m": ("mN/m", 1e3)}


def size_text(value: float, unit: str) -> str:
    """A size with its unit, in millimetres and millinewtons where these are handier."""
    shown, factor = SHOWN.get(unit, ("" if unit == "1" else unit, 1.0))
    return f"{factor * value:.3g} {shown}".strip()


def rows(found: dict[str, Any]) -> Columns:
    """The figure's rows. `panel` limits: `x` the detection limit over the plausible size (nan if
    never seen); confused: `x` the chance.
    """
    content: list[tuple[str, str, str, str, float, str]] = []
    for boundary, at in found["boundaries"].items():
        order = at["effects"]
        for row in order:
            name = label(row)
            limit = row["detection_limit"]
            ratio = np.nan if limit is None else limit / row["plausible_size"]
            text = "" if limit is None else size_text(limit, row["unit"])
            content.append((boundary, "limits", name, row["verdict"], ratio, text))
        for row in order:
            if row["verdict"] in ("silent", "too small to see"):
                continue
            content.append((boundary, "confused", label(row), row["effect"], row["within"], ""))
            content += [
                (boundary, "confused", label(row), rival, chance, "")
                for rival, chance in row["rivals"].items()
            ]
    boundary, panel, effect, series, x, note = zip(*content, strict=True)

    def text_of(values: tuple[str, ...]) -> Any:
        return np.array(values, dtype=object)

    return {
        "boundary": text_of(boundary),
        "panel": text_of(panel),
        "effect": text_of(effect),
        "series": text_of(series),
        "x": np.array(x, dtype=float),
        "note": text_of(note),
    }


def label(row: dict[str, Any]) -> str:
    """An effect's name; with its parameter where it has several sizes."""
    return str(row["parameter"]) if row["effect"] == "tilt" else str(row["effect"])


def text(found: dict[str, Any]) -> str:
    """The outlook in words, its numbers from `found`."""
    lines = [f"{found['campaign']}: a plan from {found['plan']}"]
    lines += [line for said in found["assumed"] for line in _wrap(f"Assumed: {said}.")]
    for boundary, at in found["boundaries"].items():
        lines += ["", f"{boundary}: {at['trials']} trials about {at['base_model']}", ""]
        lines += _boundary(at)
    lines += [line for note in found["notes"] for line in ("", *_wrap(f"Not weighed: {note}"))]
    s = found["schedule"]
    lines += [
        "",
        *_wrap(
            f"Random schedule (seed {s['seed']}): {s['trials']} trials at {s['visits']} visits in"
            f" {s['sessions']} sessions, about {s['hours']:.1f} h; {100 * s['from_afar']:.0f} % of"
            f" visits arrive moving towards the boundary, {s['detours']} drive past their station"
            " first (column via). Times are planned ones: put the true ones in."
        ),
        s["file"],
        "Copy it into the campaign's folder as trials.csv; nothing is written there.",
        "",
        *found["files"],
    ]
    return "\n".join(lines) + "\n"


def _boundary(at: dict[str, Any]) -> list[str]:
    noise = at["expected_noise"]
    lines = _wrap(
        f"Noise ({noise['source']}): {100 * noise['relative']:.2g} % of lift,"
        f" {1e3 * noise['force_N']:.2g} mN, {1e3 * noise['height_m']:.2g} mm per visit. False-alarm"
        f" rate {at['false_alarm_rate']:g}, for all tests together."
    )
    for name, c in at["coefficients"].items():
        wide = f"{c['u_with_undetected_effects']:.2g}"
        lines += _wrap(
            f"Expected: {name} = {c['expected']:.3g} +- {c['u']:.2g}; with every effect of"
            f" plausible size unnoticed, +- {wide}."
        )
    lines += [
        "",
        f"  {'effect':<22} {'limit':>12} {'plausible':>12} {'seen':>5} {'alone':>6}  verdict",
    ]
    for row in at["effects"]:
        limit = (
            "never"
            if row["detection_limit"] is None
            else size_text(row["detection_limit"], row["unit"])
        )
        plausible = size_text(row["plausible_size"], row["unit"])
        chances = f"{100 * row['seen']:4.0f}% {100 * row['alone']:5.0f}%"
        lines.append(f"  {label(row):<22} {limit:>12} {plausible:>12} {chances}  {row['verdict']}")
    lines += [
        "",
        (
            "  limit: size seen with 80 % chance; seen, alone: chances at the plausible size"
            " (alone: named without a rival)"
        ),
        "",
    ]
    hidden = [r for r in at["effects"] if r["verdict"] in ("silent", "too small to see")]
    first = next(iter(at["coefficients"]), None)
    if first is not None and hidden:
        worst = sorted(hidden, key=lambda r: -abs(r["bias"][first]["in_u"]))[:3]
        told = "; ".join(
            f"{label(r)} of {size_text(r['hides_up_to'], r['unit'])}:"
            f" {r['bias'][first]['shift']:+.2g}"
            for r in worst
        )
        lines += _wrap(f"Bias of {first} by what this plan would not see: {told}.")
    for limit in at["limits"]:
        lines += _wrap(limit["text"])
    for group in at["groups"]:
        lines += _wrap(f"Not told apart: {', '.join(group)}.")
    for lacking in at["untestable"]:
        if lacking["log_next_time"]:
            lines += _wrap(
                f"Untestable: {lacking['effect']}; log {', '.join(lacking['log_next_time'])}."
            )
    lines += _changes(at["changes"])
    return lines


def _changes(changes: dict[str, Any]) -> list[str]:
    if not changes["pairs"]:
        return ["", "Nothing that would be seen is confused with anything else."]
    lines = ["", "What would part them (expected evidence; 13 is enough for one pair)"]
    for pair in changes["pairs"]:
        head = (
            f"  {pair['pair'][0]} of {size_text(pair['size'], pair['unit'])} against"
            f" {pair['pair'][1]}: evidence {pair['evidence_now']:.1f}"
        )
        lines.append(head)
        if pair["held_together_by"] == "form":
            lines.append(
                "    more trials do not help: what is not known is the exact form of either"
            )
        elif not pair["options"]:
            lines.append("    none of the proposals parts them within ten times its trials")
        for o in pair["options"]:
            lines.append(f"    {o['change']}: {_cost(o)}")
        if pair["log"]:
            lines.append(f"    log: {', '.join(pair['log'])}")
    lines += ["", "Changes that serve most pairs"]
    for best in changes["best"]:
        cost = f"{best['trials']} trials" if best["trials"] else "no further trial"
        lines.append(
            f"  {best['change']} ({cost}): parts {best['pairs_parted']} of {best['pairs']}"
        )
        resolved = [r for r in best.get("rivals_after") or [] if r["after"] < r["before"] - 0.2]
        lines += [
            f"    {r['pair'][0]} taken for {r['pair'][1]}: {100 * r['before']:.0f} % ->"
            f" {100 * r['after']:.0f} %"
            for r in resolved[:4]
        ]
    return lines


def _cost(option: dict[str, Any]) -> str:
    if option["evidence_per_trial"] is None:
        return f"no further trial, evidence {option['evidence']:.1f}"
    return (
        f"some {option['trials_to_part']} trials (evidence {option['evidence_per_trial']:.2g} each)"
    )


def _wrap(text: str) -> list[str]:
    return textwrap.wrap(text, 110)
