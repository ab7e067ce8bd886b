"""Force: density of the air.

    lift -> lift (rho / rho_ref)^density_exponent
    rho = (p - p_v) / (287.058 T) + p_v / (461.495 T),   p_v = humidity 610.94 exp(17.625 t / (t +
    243.04)),   t in degC

Mechanism: lift is proportional to density at a given speed and inflow.

Convention: density_exponent 1 is the full effect, less at a fixed throttle, where the motor speeds
up in thin air. rho_ref is the density at the campaign's median temperature and pressure and at
humidity 0.5. Unrecorded pressure and humidity default to `STANDARD` and then have no effect.

Size: -1.8 % for +5 degC, -2.3 % for -2.3 kPa, -0.8 % for humidity from 0 to 90 %.

Confounded with zero_temperature, gain_drift and session_gain over a day that warms up. It cancels
where free air is measured next to every trial.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null

#: What to take where the schedule does not say.
STANDARD = {"pressure_Pa": 101325.0, "pressure_ref_Pa": 101325.0, "humidity": 0.5}


def density(temperature_K: Any, pressure_Pa: Any, humidity: Any) -> Any:
    """Density of moist air in kg/m^3. Shapes broadcast."""
    celsius = temperature_K - 273.15
    vapour_Pa = humidity * 610.94 * np.exp(17.625 * celsius / (celsius + 243.04))
    return (pressure_Pa - vapour_Pa) / (287.058 * temperature_K) + vapour_Pa / (
        461.495 * temperature_K
    )


def evaluate(
    lift: Any,
    /,
    *,
    temperature_K: Any,
    pressure_Pa: Any,
    humidity: Any,
    temperature_ref_K: Any,
    pressure_ref_Pa: Any,
    density_exponent: Any,
) -> Any:
    """Lift in that air. Shapes broadcast."""
    relative = density(temperature_K, pressure_Pa, humidity) / density(
        temperature_ref_K, pressure_ref_Pa, STANDARD["humidity"]
    )
    return lift * relative**density_exponent


_ROOM = {"temperature_ref_K": 293.15, **STANDARD}

EFFECT = Effect(
    name="air_density",
    title="Air density",
    formula=r"L \to L \, (\rho / \rho_0)^{e}",
    evaluate=evaluate,
    acts_on="force",
    mechanism="lift is proportional to the density of the air",
    varies_with="temperature_K",
    separated_by="logged temperature, pressure and humidity",
    log_next_time=("temperature", "pressure", "humidity"),
    needs=("temperature_K", "pressure_Pa", "humidity", "temperature_ref_K", "pressure_ref_Pa"),
    parameters=(
        Parameter(
            name="density_exponent",
            unit="1",
            value=0.0,
            bounds=(-1.0, 3.0),
            prior=normal(0.0, 1.0),
            meaning=(
                "power of density that lift follows; 1 at constant speed, less at constant throttle"
            ),
        ),
    ),
    source=Source(
        citation=(
            "Ideal gases; saturation pressure after Magnus with the coefficients of Alduchov and"
            " Eskridge 1996"
        ),
        doubts=("At constant throttle the exponent was not measured; 0.6 to 1 is an estimate.",),
    ),
    checks=(
        null(0.3, temperature_K=298.15, **_ROOM),
        Check(
            x=1.0,
            expected=1.1769 / 1.1988,
            arguments={"temperature_K": 298.15, **_ROOM, "density_exponent": 1.0},
            tolerance=1e-4,
            quoted_by="1.1988 at 20 degC, 1.1769 at 25",
        ),
        Check(
            x=1.0,
            expected=1.1712 / 1.1988,
            arguments={
                "temperature_K": 293.15,
                **_ROOM,
                "pressure_Pa": 99000.0,
                "density_exponent": 1.0,
            },
            tolerance=1e-4,
            quoted_by="1.1712 at 99 kPa",
        ),
    ),
    notes=__doc__ or "",
)
