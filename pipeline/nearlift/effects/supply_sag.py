"""Force: lift follows the supply voltage.

    lift -> lift (supply_V / supply_ref_V)^sag_exponent

Mechanism: throttle is a duty cycle; the motor sees it times the voltage at the board, which sags
with current, leads and the battery's charge.

Convention: sag_exponent > 0 where lift falls with voltage, about 2 for a motor at fixed duty. It
is 0 where the firmware compensates exactly, < 0 where it compensates too much. supply_ref_V is the
campaign's median; what sags with throttle alone is in L_inf.

Size on a Crazyflie: exponent 1.5 to 2.5, the firmware's cubic up to 3. A power box gives 4.01 V
idle and 3.30 V at 94 %. Ten seconds of hover take 0.5 to 1 % of lift out of a battery.

Confounded with gain_drift, warm_up and session_gain where each battery is a session.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, supply_V: Any, supply_ref_V: Any, sag_exponent: Any) -> Any:
    """Lift at that voltage. Shapes broadcast."""
    return lift * (supply_V / supply_ref_V) ** sag_exponent


EFFECT = Effect(
    name="supply_sag",
    title="Supply sag",
    formula=r"L \to L \, (U / U_0)^{p}",
    # in time, not in height: at its reference the supply changes nothing
    evaluate=evaluate,
    acts_on="force",
    belongs_to="vehicle",
    mechanism="the motors see the throttle times a supply voltage that sags",
    varies_with="supply_V",
    separated_by=(
        "logged voltage under load, charge varied against the order of distances,"
        " and a stiff supply"
    ),
    log_next_time=("supply",),
    needs=("supply_V", "supply_ref_V"),
    parameters=(
        Parameter(
            name="sag_exponent",
            unit="1",
            value=0.0,
            bounds=(-2.0, 5.0),
            prior=normal(0.0, 2.0),
            meaning=(
                "power of voltage that lift follows; positive where lift falls with voltage, about"
                " 2 uncompensated"
            ),
        ),
    ),
    source=Source(
        citation="Bitcraze, PWM to thrust, and the firmware's battery compensation",
        doubts=(
            "That half the duty is half the voltage is an assumption that Bitcraze itself flags.",
        ),
    ),
    checks=(
        null(0.3, supply_V=3.5, supply_ref_V=3.7),
        Check(
            x=0.3,
            expected=0.243,
            arguments={"supply_V": 3.33, "supply_ref_V": 3.7, "sag_exponent": 2.0},
            quoted_by="by hand: 0.9 squared",
        ),
    ),
    notes=__doc__ or "",
)
