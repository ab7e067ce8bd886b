"""Force: lift sinks within a trial as the motors heat.

    lift -> lift (1 + heating drift_hat / 2)

Mechanism: in ten seconds at full throttle a coreless motor's winding warms by tens of kelvin.
Copper's resistance rises by 0.39 %/K; current, speed and lift sink. The mean of a record that falls
linearly by the fraction drift_hat is less than the cold lift by half of that.

Convention: drift_hat is the slope of the record times its length over its mean, < 0 where lift
sinks. heating 1 is the whole effect on the mean, 0 none.

Where it shows: within the records, early against late half. On the means of trials almost nothing
is left, since L_inf of each throttle takes up what its trials have in common.

Size on a Crazyflie: 0 to 8 % with 5 to 120 s; a few percent in ten seconds at 92 %.

Confounded with supply_sag within the trial (a battery sinks likewise).
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, drift_hat: Any, heating: Any) -> Any:
    """Mean lift of a record that drifts. Shapes broadcast."""
    return lift * (1.0 + 0.5 * heating * drift_hat)


EFFECT = Effect(
    name="motor_heating",
    title="Motor heating",
    formula=r"L \to L \left(1 + \frac{h}{2} \frac{\dot{L} \, t_\mathrm{record}}{L}\right)",
    evaluate=evaluate,
    acts_on="force",
    mechanism="the windings heat during a trial and lift sinks",
    varies_with="throttle",
    separated_by="logged voltage and current, cold and warm repeats",
    log_next_time=("raw records",),
    needs=("drift_hat",),
    within_trial=True,
    parameters=(
        Parameter(
            name="heating",
            unit="1",
            value=0.0,
            bounds=(-1.0, 3.0),
            prior=normal(0.0, 1.0),
            meaning=(
                "share of the linear fall within a record that is missing from its mean, 1 if it"
                " begins at the cold lift"
            ),
        ),
    ),
    source=Source(
        citation="Physics of the bench; temperature coefficient of copper",
        doubts=(
            (
                "A fall that levels off within the record takes more than half of itself from the"
                " mean."
            ),
        ),
    ),
    checks=(
        null(0.5, drift_hat=-0.03),
        Check(
            x=0.5,
            expected=0.495,
            arguments={"drift_hat": -0.02, "heating": 1.0},
            quoted_by="by hand: a fall of 2 % takes 1 % from the mean",
        ),
    ),
    notes=__doc__ or "",
)
