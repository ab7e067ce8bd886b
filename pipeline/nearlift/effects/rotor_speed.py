"""Force: lift follows the rotor speed that was logged.

    lift -> lift speed_hat^speed_exponent,   speed_hat = rpm / its median at the throttle

Mechanism: a trial holds its throttle, not its speed. Supply, motor temperature and the boundary's
own change of torque move the speed from trial to trial. At a given inflow geometry lift scales as
its square.

Convention: speed_exponent is 2 where C_L is constant, a little more where it rises with Reynolds
number. It is less where the logged speed is noisy or that of a part of the rotors. 0 is no effect,
and there is no mechanism by which lift falls with speed. More than 3 is beyond any measured rise of
C_L. Speeds are relative to the throttle's own median, since L_inf is free for each throttle.

Size: in Bitcraze's table of 2015 lift scales as speed to the power of 2.15. Under a ceiling, at
held pulse width, a quadrotor of 12-inch propellers turned 2.5 % faster, equivalent to 5 % of lift.

Confounded with the coefficients, where the boundary itself changes the speed, and with supply_sag
and warm_up, which act through it. The effect locates the change of lift; it does not explain why
the speed changed.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, speed_hat: Any, speed_exponent: Any) -> Any:
    """Lift at that speed. Shapes broadcast."""
    return lift * speed_hat**speed_exponent


EFFECT = Effect(
    name="rotor_speed",
    title="Rotor speed",
    formula=r"L \to L \, (f / f_0)^{s}",
    evaluate=evaluate,
    acts_on="force",
    belongs_to="vehicle",
    mechanism="lift scales as the square of rotor speed, which constant throttle does not fix",
    varies_with="speed_hat",
    separated_by="repeats at one distance at other supply voltages",
    log_next_time=("rpm",),
    needs=("speed_hat",),
    parameters=(
        Parameter(
            name="speed_exponent",
            unit="1",
            value=0.0,
            bounds=(0.0, 3.0),
            prior=normal(0.0, 2.0),
            meaning="power of rotor speed that lift follows; 2 at constant C_L",
        ),
    ),
    source=Source(
        citation=(
            "Momentum and blade-element theory (lift = C_L rho f^2 r^4); rise of C_L: Bitcraze, PWM"
            " to thrust"
        ),
        doubts=(
            (
                "That the inflow near a boundary keeps its geometry while the speed changes is an"
                " assumption."
            ),
        ),
    ),
    checks=(
        null(0.3, speed_hat=1.03),
        Check(
            x=0.3,
            expected=0.363,
            arguments={"speed_hat": 1.1, "speed_exponent": 2.0},
            quoted_by="by hand: 1.1 squared",
        ),
    ),
    notes=__doc__ or "",
)
