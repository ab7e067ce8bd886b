"""The chapter on safety: crash rates by the paper's models and by the fitted ones, risk against
energy, roll near a wall.
"""

from __future__ import annotations

from markupsafe import Markup

from nearlift.declare import BOUNDARIES
from nearlift.report import blocks
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place
from nearlift.report.phrases import listed
from nearlift.report.tables import typeset
from nearlift.stages.simulate import SAFETY

#: Assumptions on the loss of lift of the two pairs of rotors next to a wall.
ROLLS = {
    "near_pair_only": "the near pair alone loses lift",
    "same_law": "both pairs lose by one law, each over its own gap",
}


def facts(evidence: Evidence) -> Markup:
    """Advised set-points, set-points by risk, the paper's presets, and roll near a wall."""
    root = Place(evidence, SAFETY)
    fitted = [root.at("fitted", b) for b in BOUNDARIES if b in root.content["fitted"]]
    presets, roll = root.every("presets"), root.at("roll")
    return blocks.join(
        *(_advice(f) for f in fitted),
        blocks.figure("safety"),
        *(_levels(f) for f in fitted),
        blocks.fold(
            "The paper's simulation, repeated", *map(_preset, presets), blocks.figure("fig6")
        )
        if presets
        else "",
        _roll(roll) if roll.content else "",
    )


def _advice(f: Place) -> Markup:
    level = f.every("levels")[-1]
    content, side = level.content, blocks.bold(f"{str(f.key).capitalize()}:")
    risk = f"{100 * content['risk']:g} %"
    if not content["agrees"] or content["value"] is None:
        text = (
            "{} no set-point is advised: at a risk of {} it depends on lift nearer than measured."
        )
        return blocks.paragraph(text, side, risk)
    return blocks.paragraph(
        "{} the probability of contact is {} a flight at the set-point ẑ₀ {} {}{}, against {}"
        " without the boundary's effect on lift.",
        side,
        risk,
        "≤" if content["value"] == content["lowest_flown"] else "=",
        level.number("value", places=2),
        blocks.span("90 %: {}", level.ends(places=2)),
        level.number("without_model", places=2),
    )


def _levels(f: Place) -> Markup:
    said, contact = f.content, f.number("contact_z_hat", places=2)
    rows: list[tuple[object, ...]] = []
    for level in f.every("levels"):
        content, risk = level.content, f"{100 * level.content['risk']:g} %"
        if content["value"] is None:
            rows.append((risk, "no set-point flown is safe enough"))
            continue
        rates = [level.percent(k, digits=2) for k in ("rate_lo90", "rate_hi90")]
        advice = "" if content["agrees"] else "no advice: it depends on lift nearer than measured"
        rows.append(
            (
                risk,
                Markup("{}{}").format(
                    "≤ " if content["value"] == content["lowest_flown"] else "",
                    level.number("value", places=2),
                ),
                level.ends(places=2),
                level.number("relative_power", places=3),
                Markup("{} to {}").format(*rates),
                level.number("without_model", places=2),
                Markup("{}{}").format(
                    level.number("held", places=2), blocks.note(advice) if advice else ""
                ),
            )
        )
    gains = [f.number("gains", k, digits=3) for k in ("kP", "kD", "kI")]
    effects, bench = (listed(said[k]) for k in ("effects", "left_on_the_bench"))
    droop = (
        " By the end of a flight the supply has changed lift by {} %, with and without a boundary."
    )
    step = (
        "Halving the time step changes these rates beyond their intervals: choose a smaller step."
    )
    return blocks.fold(
        f"{str(f.key).capitalize()}: set-points by risk",
        blocks.paragraph(
            "{}. {} draws of the model from {}.{}{}{}",
            typeset(said["title"]),
            said["draws"],
            said["draws_from"],
            typeset(f" The simulation includes {effects}.") if effects else "",
            typeset(f" {bench} belongs to the bench and is not simulated.") if bench else "",
            Markup(droop).format(f.percent("droop", digits=2)) if said["droop"] else "",
        ),
        blocks.paragraph(
            "A crash is ẑ ≤ {}, where the vehicle first touches ({} mm from the rotor plane). Flown"
            " with k<sub>P</sub> = {} 1/(m s), k<sub>D</sub> = {} 1/m and k<sub>I</sub> = {}"
            " 1/(m s²).",
            contact,
            f.number("contact_m", scale=1000, digits=3, how="in mm"),
            *gains,
        ),
        blocks.paragraph(
            "Below ẑ = {} nothing was measured: lift there follows the model's own form, or is held"
            " constant. Nothing is advised where the two disagree.{}",
            f.number("measured_z_hat", 0, places=2),
            "" if said["convergence"]["converged"] else blocks.note(step),
        ),
        blocks.table(
            Markup(
                "Lowest set-point for a stated risk of contact at ẑ = {}. Relative power to hover"
                " there, and crashes in {} flights with other gusts"
            ).format(contact, said["flights"]),
            (
                *("risk of a flight", "ẑ₀", "90 %", "relative power", "crashes, %"),
                *("ẑ₀ without the boundary's effect", "ẑ₀ with lift held constant"),
            ),
            rows,
        ),
    )


def _preset(place: Place) -> Markup:
    tests = [boundary.at("convergence") for boundary in place.every("boundaries")]
    worst = max(tests, key=lambda test: float(test.content["worst"]))
    converged = all(test.content["converged"] for test in tests)
    return blocks.paragraph(
        "{}: {}. Halving the step changes a crash rate by up to {} on {} flights: {}.",
        blocks.bold(str(place.key)),
        place.content["meaning"],
        worst.number("worst", digits=2),
        worst.number("flights", digits=6),
        "converged" if converged else "not converged, its numbers depend on the step",
    )


def _roll(roll: Place) -> Markup:
    rows = []
    for law, words in ROLLS.items():
        r = roll.at(law)
        torque, low, high = (
            r.number(k, 0, scale=1000, digits=2, how="in N mm")
            for k in ("torque_N_m", "lo90_N_m", "hi90_N_m")
        )
        turns = [
            r.number(k, digits=3) for k in ("acceleration_deg_s2", "lo90_deg_s2", "hi90_deg_s2")
        ]
        known = "acceleration_deg_s2" in r.content
        rows.append(
            (
                words,
                Markup("{}{}").format(torque, blocks.span("90 %: {} to {}", low, high)),
                Markup("{}{}").format(turns[0], blocks.span("90 %: {} to {}", *turns[1:]))
                if known
                else "the manifest gives no roll_inertia",
            )
        )
    caption = Markup(
        "Torque and angular acceleration at a tip gap of ẑ = {}. The paper gives 0.2 N mm and"
        " 400 deg/s². Standard uncertainty assumed for the inertia: {} %"
    ).format(roll.number("z_hat", 0, digits=2), roll.percent("u_inertia", digits=2))
    heads = ("assumption", "torque, N mm", "deg/s²")
    return blocks.fold("Roll next to a wall", blocks.table(caption, heads, rows))
