"""Force: the zero follows temperature.

    lift -> lift + zero_N_per_K (temperature_K - temperature_ref_K)

Mechanism: strain gauges, their glue and the amplifier are compensated only to so many counts per
kelvin. The remainder is an error if the temperature changes between tare and trial.

Convention: zero_N_per_K > 0 reads too much lift when warm. temperature_ref_K is the campaign's
median. The recorded temperature is the air's; the cell's follows it with a delay.

Size on a Crazyflie: 0 to 0.3 gf/K (3 mN/K); 0.1 gf/K is 0.4 % of the weight per kelvin.

Confounded with air_density (in proportion to lift), zero_drift and gain_drift over a day that warms
up.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, temperature_K: Any, temperature_ref_K: Any, zero_N_per_K: Any) -> Any:
    """Lift as read, in N, at that temperature. Shapes broadcast."""
    return lift + zero_N_per_K * (temperature_K - temperature_ref_K)


EFFECT = Effect(
    name="zero_temperature",
    title="Thermal zero drift",
    formula=r"L \to L + F_T \, (T - T_0)",
    evaluate=evaluate,
    acts_on="force",
    additive=True,
    mechanism="the zero of cell and amplifier follows their temperature",
    varies_with="temperature_K",
    contains_line=True,
    separated_by="several throttles at each temperature, and motors-off records",
    log_next_time=("temperature",),
    needs=("temperature_K", "temperature_ref_K"),
    parameters=(
        Parameter(
            name="zero_N_per_K",
            unit="N/K",
            value=0.0,
            bounds=(-0.01, 0.01),
            prior=normal(0.0, 0.0015),
            meaning="change of zero per kelvin; positive reads too much lift when warm",
        ),
    ),
    source=Source(
        citation="Physics of the bench",
        doubts=("0 to 0.3 gf/K is the range of cheap cells of 1 kgf.",),
    ),
    checks=(
        null(0.265, temperature_K=300.0, temperature_ref_K=293.0),
        Check(
            x=0.265,
            expected=0.265 * 1.0037,
            arguments={
                "temperature_K": 294.0,
                "temperature_ref_K": 293.0,
                "zero_N_per_K": 0.980665e-3,
            },
            tolerance=5e-5,
            quoted_by="0.1 gf/K is 0.4 % of 265 mN per kelvin",
        ),
    ),
    notes=__doc__ or "",
)
