"""Force: the load cell's gain follows its temperature.

    lift -> lift (1 + span_per_K (temperature_K - temperature_ref_K))

Mechanism: the modulus of the cell's metal falls as it warms, so that the same force bends it more;
what the maker's compensation leaves.

Convention: span_per_K > 0 reads too much lift when warm. temperature_ref_K is the campaign's
median.

Confounded with air_density, which is in proportion to lift as well and has the sign of colder air;
a dead weight hung on the cell, cold and warm, separates them.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal


def evaluate(lift: Any, /, *, temperature_K: Any, temperature_ref_K: Any, span_per_K: Any) -> Any:
    """Lift as read, in N, at that temperature. Shapes broadcast."""
    return lift * (1.0 + span_per_K * (temperature_K - temperature_ref_K))


EFFECT = Effect(
    name="span_temperature",
    title="Gain against temperature",
    formula=r"L \to L \left(1 + s \, (T - T_0)\right)",
    evaluate=evaluate,
    acts_on="force",
    mechanism="the load cell bends more when it is warm",
    varies_with="temperature_K",
    log_next_time=("temperature",),
    needs=("temperature_K", "temperature_ref_K"),
    parameters=(
        Parameter(
            name="span_per_K",
            unit="1/K",
            value=0.0,
            bounds=(-0.01, 0.01),
            prior=normal(0.0, 0.0005),
            meaning="relative change of gain per kelvin; positive reads too much lift when warm",
        ),
    ),
    source=Source(
        citation=(
            "Physics of the bench: Young's modulus of aluminium falls by about 0.05 % per kelvin"
        ),
        doubts=("What compensation leaves is unknown.",),
    ),
    checks=(
        Check(
            x=0.265,
            expected=0.265,
            arguments={"temperature_K": 300.0, "temperature_ref_K": 293.0},
            quoted_by="null",
        ),
        Check(
            x=0.2,
            expected=0.201,
            arguments={"temperature_K": 303.0, "temperature_ref_K": 293.0, "span_per_K": 0.0005},
            quoted_by="by hand: 0.5 % in 10 K",
        ),
    ),
    notes=__doc__ or "",
)
