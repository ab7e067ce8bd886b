"""The checks of a base fit's assumptions in words, as fit.json keeps them."""

from __future__ import annotations

import numpy as np

from nearlift.fit import collapse, held_quantity
from nearlift.fit.rotor import PAPER, Rotor
from nearlift.rounding import plus_minus

NO_SPEED = (
    "No rotor speed is known: log rpm in trials.csv, or give [vehicle.throttle_map], and C_L is"
    " estimated per throttle."
)
NO_DENSITY = (
    "The density of air is not known: give air_density in [rig], or log temperature (pressure,"
    " humidity)."
)
#: Significance level of every test here.
REJECTS = 0.05
NAMES = {"speed_Hz": "rotor speed", "power_W": "power", "supply_V": "supply voltage"}


def chance(p: float) -> str:
    """A p-value as text: ``p = 0.31``, or ``p < 0.001``."""
    return f"p = {p:.2g}" if p >= 1e-3 else "p < 0.001"


def percent(x: float) -> str:
    """A fraction in per cent: two digits, and whole numbers from ten on."""
    return f"{100 * x:.0f}" if x >= 0.1 else f"{100 * x:.2g}"


def throttle_collapse(tested: collapse.Collapse) -> str:
    """Outcome of the throttle-collapse tests, and 95 % bounds on differences between throttles."""
    if len(tested.throttles) < 2:
        return "All trials ran at one throttle: whether Delta L depends on it cannot be tested."
    tests = {
        f"one {tested.name}": tested.coefficient,
        "one curve": tested.curve,
        "one Delta L in all cells of a distance, no model": tested.cells,
    }
    made = {claim: test for claim, test in tests.items() if test is not None}
    if not made:
        return "These trials cannot test whether Delta L depends on throttle."
    rejected = [
        f"{claim} ({chance(test.p_value)})"
        for claim, test in made.items()
        if test.p_value < REJECTS
    ]
    kept = [
        f"{claim} ({chance(test.p_value)})"
        for claim, test in made.items()
        if test.p_value >= REJECTS and not test.quiet
    ]
    quiet = [f"{claim} ({chance(test.p_value)})" for claim, test in made.items() if test.quiet]
    parts = [
        f"For all throttles {verdict}: {'; '.join(claims)}."
        for verdict, claims in (("rejected", rejected), ("not rejected", kept))
        if claims
    ]
    if quiet:
        parts.append(
            f"Not tested: {'; '.join(quiet)}. Trials are more even than their noise would let them"
            " be: the noise is overestimated, or shared by trials in a way that it does not"
            " represent. That is no evidence of a collapse."
        )
    bounds = [
        f"{percent(d.bound95)} % in {what} (between {100 * d.between[0]:.3g} and"
        f" {100 * d.between[1]:.3g} %)"
        for what, d in ((tested.name, tested.of_coefficient), ("Delta L", tested.of_curve))
        if d is not None and np.isfinite(d.bound95)
    ]
    if bounds:
        parts.append(
            "With 95 % confidence no two throttles differ by more than"
            f" {', nor by more than '.join(bounds)}."
        )
    return " ".join(parts)


def held(examined: held_quantity.Held, name: str) -> str:
    """Effect of the exponent on the coefficient, and the exponents that lift and logs support."""
    parts = []
    if examined.plausible:
        least, most = (
            min(examined.plausible, key=lambda x: x.value),
            max(examined.plausible, key=lambda x: x.value),
        )
        ends = f"{least.value:.3g} (n = {least.n:.2g}) to {most.value:.3g} (n = {most.n:.2g})"
        parts.append(f"Over the plausible exponents the base fit’s {name} runs from {ends}.")
    if np.isfinite(examined.n):
        n = plus_minus(examined.n, examined.u_n)
        parts.append(f"Lift alone, the form taken for true, gives n = {n}.")
        excluded = [
            f"{x.n:.2g} ({chance(x.p_value)})" for x in examined.plausible if x.p_value < REJECTS
        ]
        if excluded:
            parts.append(
                f"Under this form it is against n = {', '.join(excluded)}; a wrong form does that"
                " too."
            )
    else:
        parts.append(f"Lift alone cannot tell the exponent from {name}.")
    parts += [_response(r) for r in examined.responses]
    if deciding := [NAMES[q] for q in examined.unanswered if q != "supply_V"]:
        parts.append(
            f"The {' and the '.join(deciding)} was logged, but at too few visits within a session"
            " to infer the exponent from it."
        )
    elif not examined.supported:
        parts.append("Log rpm, or power, and the exponent can be inferred.")
    elif examined.at_ends:
        (low, high), values = examined.supported, [x.value for x in examined.at_ends]
        parts.append(
            f"By theory the logs leave {low:.2f} < n < {high:.2f}, so {name} from {min(values):.3g}"
            f" to {max(values):.3g}."
        )
    return " ".join(parts)


def declared(held: str) -> str:
    """What the manifest's `held` means for the exponent."""
    follows = "the exponent n of the ratio depends on what else stays constant."
    return {
        "throttle": f"A trial holds the throttle, which fixes neither speed nor power; {follows}",
        "command": (
            "A window of flight holds nothing: L_inf follows the command and the supply, and at a"
            f" given command neither speed nor power is fixed; {follows}"
        ),
        "voltage": (
            f"A trial is said to hold the voltage, which fixes neither speed nor power; {follows}"
        ),
        "rpm": (
            "A trial is said to hold the rotor speed: blade-element theory then wants n between"
            " 0.60 and 0.82."
        ),
        "power": "A trial is said to hold the power: momentum theory then wants n = 2/3.",
    }[held]


def _response(r: held_quantity.Response) -> str:
    what, answer = NAMES[r.quantity], f"{plus_minus(r.slope, r.u)}, {chance(r.p_value)}"
    spread = f"it varied by {percent(r.spread)} % within a throttle"
    if r.held:
        return f"The {what} logged does not follow the boundary (response {answer}); {spread}."
    return (
        f"The {what} logged was not held: it follows the change of lift with a power of"
        f" {r.slope:+.2g} ± {r.u:.1g} ({chance(r.p_value)}); {spread}."
    )


def rotor(estimated: Rotor, exact_map: bool) -> str:
    """C_L, its trend, and the paper's constant."""
    law = estimated.trend
    low, high = estimated.C_L.min(), estimated.C_L.max()
    text = (
        f"C_L is {low:.3g} to {high:.3g}"
        if len(estimated.C_L) > 1
        else f"C_L is {low:.3g} ± {estimated.u[0]:.1g}"
    )
    text += (
        f" ({100 * (estimated.trend.mean / PAPER - 1):+.0f} % against the {PAPER:g} that the paper"
        " takes)."
    )
    if law.p_constant is not None and law.p_trend is not None:
        verdict = "is rejected" if law.p_constant < REJECTS else "is not rejected"
        text += (
            f" One C_L for all throttles {verdict} ({chance(law.p_constant)}); it goes as speed,"
            " and so as the Reynolds number, to the power "
        )
        text += f"{plus_minus(law.exponent, law.u_exponent)} ({chance(law.p_trend)} for none)."
        if law.excess > 1:
            text += (
                f" About that power law C_L scatters {law.excess:.2g} times as much as its"
                " uncertainties say, which has widened the interval."
            )
    return text + (" The speeds of the map are taken as exact." if exact_map else "")
