"""Safety: set-points for a stated risk of contact, the paper's simulation, roll near a wall."""

from __future__ import annotations

from markupsafe import Markup

from nearlift.declare import BOUNDARIES
from nearlift.report import blocks
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place
from nearlift.stages.simulate import SAFETY

#: Assumptions on the loss of lift of the two pairs of rotors next to a wall.
ROLLS = {
    "near_pair_only": "the near pair alone loses lift",
    "same_law": "both pairs lose by one law, each over its own gap",
}


def facts(evidence: Evidence) -> Markup:
    """Set-points by risk, the paper's presets, and roll near a wall."""
    root = Place(evidence, SAFETY)
    fitted = [root.at("fitted", b) for b in BOUNDARIES if b in root.content["fitted"]]
    roll = root.at("roll")
    return blocks.join(
        blocks.figure("safety"),
        *map(_levels, fitted),
        blocks.fold("The paper's simulation, repeated", blocks.figure("fig6"))
        if root.content["presets"]
        else "",
        _roll(roll) if roll.content else "",
    )


def _levels(f: Place) -> Markup:
    """The lowest set-point for each stated risk."""
    rows: list[tuple[object, ...]] = []
    for level in f.every("levels"):
        content, risk = level.content, f"{100 * level.content['risk']:g} %"
        if content["value"] is None:
            rows.append((risk, "no set-point flown is safe enough"))
            continue
        least = "≤ " if content["value"] == content["lowest_flown"] else ""
        rates = [level.percent(k, digits=2) for k in ("rate_lo90", "rate_hi90")]
        rows.append(
            (
                risk,
                Markup("{}{}").format(least, level.number("value", places=2)),
                level.ends(places=2),
                level.number("relative_power", places=3),
                Markup("{} to {}").format(*rates),
                level.number("without_model", places=2),
                level.number("held", places=2),
                "yes" if content["agrees"] else "no: it depends on lift nearer than measured",
            )
        )
    heads = (
        *("risk of a flight", "ẑ₀", "90 %", "relative power", "crashes in other gusts, %"),
        *("ẑ₀ without the boundary's effect", "ẑ₀ with lift held constant", "advised"),
    )
    contact = f.number("contact_z_hat", places=2)
    caption = Markup("{}: lowest set-point for a stated risk of contact (ẑ = {}); {} flights")
    return blocks.table(caption.format(f.title, contact, f.content["flights"]), heads, rows)


def _roll(roll: Place) -> Markup:
    rows = []
    for law, words in ROLLS.items():
        r = roll.at(law)
        torque, low, high = (
            r.number(k, 0, scale=1000, digits=2, how="in N mm")
            for k in ("torque_N_m", "lo90_N_m", "hi90_N_m")
        )
        turns, *ends = (
            r.number(k, digits=3) for k in ("acceleration_deg_s2", "lo90_deg_s2", "hi90_deg_s2")
        )
        turning: object = Markup("{}{}").format(turns, blocks.span("{} to {}", *ends))
        if "acceleration_deg_s2" not in r.content:
            turning = "the manifest gives no roll_inertia"
        moment = Markup("{}{}").format(torque, blocks.span("{} to {}", low, high))
        rows.append((words, moment, turning))
    caption = Markup(
        "Roll next to a wall at a tip gap of ẑ = {} (90 %); the paper: 0.2 N mm, 400 deg/s²"
    )
    heads = ("assumption", "torque, N mm", "deg/s²")
    return blocks.table(caption.format(roll.number("z_hat", 0, digits=2)), heads, rows)
