"""Effects on gain: factors of lift, the same whatever its unit."""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Prior, Source, normal, null


def room_recirculation(
    lift: Any,
    /,
    *,
    z_hat: Any,
    throttle: Any,
    throttle_ref: Any,
    recirculation: Any,
    recirculation_reach_hat: Any,
) -> Any:
    """Force: the room's air comes back.

        lift -> lift (1 - recirculation (throttle / throttle_ref) (1 - exp(-z_hat /
        recirculation_reach_hat)))

    Mechanism: in a closed room the jet sets the air in motion. It comes back to the rotors as an
    axial inflow V_c and takes away 0.35 V_c / v_i of the lift. A boundary close by spreads the jet
    along itself and shields the rotors from it; far from it the inflow is complete. A record is
    shorter than the room's turnover (40 to 125 s), so the inflow rises with the jet.

    Convention: recirculation >= 0 loses lift; it is the loss in free air at the median throttle.

    Size on a Crazyflie: 0.027 m^3/s into a cube of 1.5 m give V_c of 0.1 to 0.3 m/s, -0.9 to -2.6
    %.

    Confounded with tether_stiffness, zero_offset and whatever acts beyond z_hat = 3.
    """
    inflow = (throttle / throttle_ref) * -np.expm1(
        -np.maximum(z_hat, 0.0) / recirculation_reach_hat
    )
    return lift * (1.0 - recirculation * inflow)


ROOM_RECIRCULATION = Effect(
    "room_recirculation", "Room recirculation",
    r"L \to L \left[1 - a \frac{\tau}{\tau_0} \left(1 - e^{-\hat{z} / \hat{h}}\right)\right]",
    room_recirculation, acts_on="force", varies_with="z_hat",
    needs=("z_hat", "throttle", "throttle_ref"),
    mechanism=(
        "air set in motion by the jet comes back to the rotors as inflow, the more the farther the"
        " boundary"
    ),
    separated_by="longer pauses, an open door, or one long run",
    parameters=(
        Parameter("recirculation", "1", 0.0, (0.0, 0.15),
            Prior(distribution="halfnorm", scale=0.02),
            "relative loss of lift in free air at the median throttle; larger loses more",
            size_unit="fraction of lift, in free air"),
        Parameter("recirculation_reach_hat", "1", 8.0, (2.0, 40.0),
            Prior(distribution="lognorm", shape=(0.7,), scale=8.0),
            "distance, in rotor radii, beyond which the boundary no longer shields the rotors",
            grid=(3.0, 8.0, 20.0)),
    ),
    source=Source(
        "Physics of the bench: blade-element momentum theory for the inflow, room volume over jet"
        " flux for the time",
        doubts=(
            ("How a boundary shields the rotors is an own guess; the far wakes merge into one jet"
             " after 2.5 vehicle diameters."),
        ),
    ),
    checks=(
        null(0.265, z_hat=5.0, throttle=0.9, throttle_ref=0.6),
        Check(1.0, 0.974,
            {"z_hat": float("inf"), "throttle": 0.6, "throttle_ref": 0.6,
                "recirculation": 0.35 * 0.3 / 4.07},
            "V_c = 0.3 m/s and v_i = 4.07 m/s: -2.6 %", tolerance=5e-4),
        Check(1.0, 1 - 0.02 * 0.5 * 0.6321206,
            {"z_hat": 8.0, "throttle": 0.3, "throttle_ref": 0.6, "recirculation": 0.02},
            "by hand: half the throttle, 1 - 1/e at one reach"),
    ),
)  # fmt: skip


def session_gain(lift: Any, /, *, session: Any, gain: Any) -> Any:
    """Force: gain differs by session.

        lift -> lift (1 + gain[session])

    Mechanism: between sittings a propeller is changed, the vehicle is mounted again, the cell's
    excitation or range is set again, or the density differs. All lift of the sitting is larger or
    smaller in proportion.

    Convention: gain > 0 reads more lift. One number for each session; L_inf takes up their mean.

    Size on a Crazyflie: span 0.5 %, mounting and propellers 1 to 5 %.

    Confounded with distance where a session ran at few distances: it can take the whole effect of
    the boundary. Also with gain_drift and air_density, of which it is the coarse version.
    """
    return lift * (1.0 + gain)


SESSION_GAIN = Effect(
    "session_gain", "Session gain", r"L \to L \, (1 + g_\mathrm{session})", session_gain,
    acts_on="force", varies_with="session", needs=("session",), log_next_time=("session",),
    mechanism="propellers, mounting, excitation or density differ from one sitting to the next",
    separated_by=(
        "check masses, lift in free air in every session, and distances spread over sessions"
    ),
    parameters=(
        Parameter("gain", "1", 0.0, (-0.3, 0.3), normal(0.0, 0.02),
            "relative gain of a session; positive reads more lift", per="session",
            size_unit="fraction of lift"),
    ),
    source=Source("Physics of the bench",
        doubts=(
            "Sizes are estimates; a cell's span alone is good to 0.5 %.",
            "With one number for each session it explains any slow change a little.",
        ),
    ),
    checks=(
        null(0.3, session=2),
        Check(0.3, 0.303, {"session": 2, "gain": 0.01}, "by hand: 1 % of 0.3"),
    ),
)  # fmt: skip


def gain_drift(lift: Any, /, *, elapsed_hat: Any, drift: Any) -> Any:
    """Force: gain drifts over the campaign.

        lift -> lift (1 + drift elapsed_hat)

    Mechanism: brushes, bearings and blades wear, the amplifier ages or follows the day, a supply
    settles: lift changes slowly and in one direction.

    Convention: elapsed_hat runs from -1 at the first trial to +1 at the last. drift > 0 reads more
    lift later, and is half the change over the campaign.

    Size on a Crazyflie: 0 to 2 % over a day of runs; brushed motors lose several percent in ten
    hours.

    Confounded with distance or throttle where they were run in order, with session_gain (of which a
    trend over sessions is part), air_density and supply_sag.
    """
    return lift * (1.0 + drift * elapsed_hat)


GAIN_DRIFT = Effect(
    "gain_drift", "Gain drift", r"L \to L \, (1 + d \, \hat{t}), \quad \hat{t} \in [-1, 1]",
    gain_drift, acts_on="force", varies_with="start_s", needs=("elapsed_hat",),
    log_next_time=("start",),
    mechanism="wear of motors and blades, or the amplifier's gain, moves slowly in one direction",
    separated_by="random order, and lift in free air every few trials",
    parameters=(
        Parameter("drift", "1", 0.0, (-0.15, 0.15), normal(0.0, 0.01),
            "half the relative change over the campaign; positive reads more lift later",
            size_unit="fraction of lift, first to last trial"),
    ),
    source=Source("Physics of the bench",
        doubts=("A straight line approximates any slow monotone change.",)),
    checks=(
        null(0.3, elapsed_hat=1.0),
        Check(0.3, 0.297, {"elapsed_hat": -1.0, "drift": 0.01},
            "by hand: 1 % less at the first trial"),
    ),
)  # fmt: skip


def warm_up(lift: Any, /, *, session: Any, since_start_s: Any, warming: Any, warming_s: Any) -> Any:
    """Force: motors warm up within a session.

        lift -> lift (1 + warming exp(-since_start_s / warming_s))

    Mechanism: at the start of a sitting windings, bearings and grease are cold. Warm copper (+0.39
    %/K) takes current away, warm grease gives speed; over the first minutes lift settles.

    Convention: warming is the excess of lift at the session's first trial over the settled state.
    It is > 0 where lift sinks as motors warm (copper), < 0 where it rises (grease). since_start_s
    is the time since the first trial of the session.

    Size on a Crazyflie: 0 to 8 % with 5 to 120 s for the winding alone, slower for motor and arm
    together. Cooling in a rest between trials is not included.

    Confounded with zero_drift (same time, additive), supply_sag of a battery, and distance where
    every session begins at the same station. A warm-up run before the first trial avoids it.
    """
    return lift * (1.0 + warming * np.exp(-since_start_s / warming_s))


WARM_UP = Effect(
    "warm_up", "Warm-up", r"L \to L \left(1 + w \, e^{-t_\mathrm{session} / \tau_w}\right)",
    warm_up, acts_on="force", varies_with="since_start_s",
    needs=("session", "since_start_s"), log_next_time=("session", "start"),
    mechanism="motors warm up over the first minutes of a session",
    separated_by="random order and cold repeats",
    parameters=(
        Parameter("warming", "1", 0.0, (-0.15, 0.15), normal(0.0, 0.02),
            "relative excess of lift at the start of a session; positive where lift sinks as"
            " motors warm", size_unit="fraction of lift, at the start of a session"),
        Parameter("warming_s", "s", 300.0, (20.0, 4000.0),
            Prior(distribution="lognorm", shape=(1.0,), scale=300.0),
            "time over which the excess falls to 1/e", grid=(80.0, 300.0, 1200.0)),
    ),
    source=Source("Physics of the bench; temperature coefficient of copper",
        doubts=(
            "The sign depends on what warms first.",
            "Times of a motor in its arm are estimates.",
        ),
    ),
    checks=(
        null(0.3, session=0, since_start_s=0.0),
        Check(0.3, 0.306, {"session": 0, "since_start_s": 0.0, "warming": 0.02},
            "by hand: 2 % at the start"),
        Check(1.0, 1.0073576,
            {"session": 0, "since_start_s": 300.0, "warming": 0.02, "warming_s": 300.0},
            "by hand: 0.02 / e"),
    ),
)  # fmt: skip


def rotor_speed(lift: Any, /, *, speed_hat: Any, speed_exponent: Any) -> Any:
    """Force: lift follows the rotor speed that was logged.

        lift -> lift speed_hat^speed_exponent,   speed_hat = rpm / its median at the throttle

    Mechanism: a trial holds its throttle, not its speed. Supply, motor temperature and the
    boundary's own change of torque move the speed from trial to trial. At a given inflow geometry
    lift scales as its square.

    Convention: speed_exponent is 2 where C_L is constant, a little more where it rises with
    Reynolds number. It is less where the logged speed is noisy or that of a part of the rotors. 0
    is no effect, and there is no mechanism by which lift falls with speed. More than 3 is beyond
    any measured rise of C_L. Speeds are relative to the throttle's own median, since L_inf is free
    for each throttle.

    Size: in Bitcraze's table of 2015 lift scales as speed to the power of 2.15. Under a ceiling, at
    held pulse width, a quadrotor of 12-inch propellers turned 2.5 % faster, equivalent to 5 % of
    lift.

    Confounded with the coefficients, where the boundary itself changes the speed, and with
    supply_sag and warm_up, which act through it. The effect locates the change of lift; it does not
    explain why the speed changed.
    """
    return lift * speed_hat**speed_exponent


ROTOR_SPEED = Effect(
    "rotor_speed", "Rotor speed", r"L \to L \, (f / f_0)^{s}", rotor_speed, acts_on="force",
    belongs_to="vehicle", varies_with="speed_hat", needs=("speed_hat",), log_next_time=("rpm",),
    mechanism="lift scales as the square of rotor speed, which constant throttle does not fix",
    separated_by="repeats at one distance at other supply voltages",
    parameters=(
        Parameter("speed_exponent", "1", 0.0, (0.0, 3.0), normal(0.0, 2.0),
            "power of rotor speed that lift follows; 2 at constant C_L",
            size_unit="exponent of rotor speed"),
    ),
    source=Source(
        "Momentum and blade-element theory (lift = C_L rho f^2 r^4); rise of C_L: Bitcraze, PWM to"
        " thrust",
        doubts=(
            ("That the inflow near a boundary keeps its geometry while the speed changes is an"
             " assumption."),
        ),
    ),
    checks=(
        null(0.3, speed_hat=1.03),
        Check(0.3, 0.363, {"speed_hat": 1.1, "speed_exponent": 2.0}, "by hand: 1.1 squared"),
    ),
)  # fmt: skip


def supply_sag(lift: Any, /, *, supply_V: Any, supply_ref_V: Any, sag_exponent: Any) -> Any:
    """Force: lift follows the supply voltage.

        lift -> lift (supply_V / supply_ref_V)^sag_exponent

    Mechanism: throttle is a duty cycle; the motor sees it times the voltage at the board, which
    sags with current, leads and the battery's charge.

    Convention: sag_exponent > 0 where lift falls with voltage, about 2 for a motor at fixed duty.
    It is 0 where the firmware compensates exactly, < 0 where it compensates too much. supply_ref_V
    is the campaign's median; what sags with throttle alone is in L_inf.

    Size on a Crazyflie: exponent 1.5 to 2.5, the firmware's cubic up to 3. A power box gives 4.01 V
    idle and 3.30 V at 94 %. Ten seconds of hover take 0.5 to 1 % of lift out of a battery.

    Confounded with gain_drift, warm_up and session_gain where each battery is a session.
    """
    return lift * (supply_V / supply_ref_V) ** sag_exponent


SUPPLY_SAG = Effect(
    "supply_sag", "Supply sag", r"L \to L \, (U / U_0)^{p}", supply_sag, acts_on="force",
    belongs_to="vehicle", varies_with="supply_V", needs=("supply_V", "supply_ref_V"),
    log_next_time=("supply",),
    mechanism="the motors see the throttle times a supply voltage that sags",
    separated_by=(
        "logged voltage under load, charge varied against the order of distances, and a stiff"
        " supply"
    ),
    parameters=(
        Parameter("sag_exponent", "1", 0.0, (-2.0, 5.0), normal(0.0, 2.0),
            "power of voltage that lift follows; positive where lift falls with voltage, about 2"
            " uncompensated", size_unit="exponent of supply voltage"),
    ),
    source=Source("Bitcraze, PWM to thrust, and the firmware's battery compensation",
        doubts=(
            "That half the duty is half the voltage is an assumption that Bitcraze itself flags.",
        ),
    ),
    checks=(
        null(0.3, supply_V=3.5, supply_ref_V=3.7),
        Check(0.3, 0.243, {"supply_V": 3.33, "supply_ref_V": 3.7, "sag_exponent": 2.0},
            "by hand: 0.9 squared"),
    ),
)  # fmt: skip


#: What to take where the schedule does not say.
STANDARD = {"pressure_Pa": 101325.0, "pressure_ref_Pa": 101325.0, "humidity": 0.5}


def density(temperature_K: Any, pressure_Pa: Any, humidity: Any) -> Any:
    """Density of moist air in kg/m^3. Shapes broadcast."""
    celsius = temperature_K - 273.15
    vapour_Pa = humidity * 610.94 * np.exp(17.625 * celsius / (celsius + 243.04))
    return (pressure_Pa - vapour_Pa) / (287.058 * temperature_K) + vapour_Pa / (
        461.495 * temperature_K
    )


def air_density(
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
    """Force: density of the air.

        lift -> lift (rho / rho_ref)^density_exponent
        rho = (p - p_v) / (287.058 T) + p_v / (461.495 T)
        p_v = humidity 610.94 exp(17.625 t / (t + 243.04)),   t in degC

    Mechanism: lift is proportional to density at a given speed and inflow.

    Convention: density_exponent 1 is the full effect, less at a fixed throttle, where the motor
    speeds up in thin air. rho_ref is the density at the campaign's median temperature and pressure
    and at humidity 0.5. Unrecorded pressure and humidity default to `STANDARD` and then have no
    effect.

    Size: -1.8 % for +5 degC, -2.3 % for -2.3 kPa, -0.8 % for humidity from 0 to 90 %.

    Confounded with zero_temperature, gain_drift and session_gain over a day that warms up. It
    cancels where free air is measured next to every trial.
    """
    relative = density(temperature_K, pressure_Pa, humidity) / density(
        temperature_ref_K, pressure_ref_Pa, STANDARD["humidity"]
    )
    return lift * relative**density_exponent


_ROOM = {"temperature_ref_K": 293.15, **STANDARD}


AIR_DENSITY = Effect(
    "air_density", "Air density", r"L \to L \, (\rho / \rho_0)^{e}", air_density, acts_on="force",
    varies_with="temperature_K",
    needs=("temperature_K", "pressure_Pa", "humidity", "temperature_ref_K", "pressure_ref_Pa"),
    log_next_time=("temperature", "pressure", "humidity"),
    mechanism="lift is proportional to the density of the air",
    separated_by="logged temperature, pressure and humidity",
    parameters=(
        Parameter("density_exponent", "1", 0.0, (-1.0, 3.0), normal(0.0, 1.0),
            "power of density that lift follows; 1 at constant speed, less at constant throttle",
            size_unit="exponent of air density"),
    ),
    source=Source(
        "Ideal gases; saturation pressure after Magnus with the coefficients of Alduchov and"
        " Eskridge 1996",
        doubts=("At constant throttle the exponent was not measured; 0.6 to 1 is an estimate.",)),
    checks=(
        null(0.3, temperature_K=298.15, **_ROOM),
        Check(1.0, 1.1769 / 1.1988, {"temperature_K": 298.15, **_ROOM, "density_exponent": 1.0},
            "1.1988 at 20 degC, 1.1769 at 25", tolerance=1e-4),
        Check(1.0, 1.1712 / 1.1988,
            {"temperature_K": 293.15, **_ROOM, "pressure_Pa": 99000.0, "density_exponent": 1.0},
            "1.1712 at 99 kPa", tolerance=1e-4),
    ),
)  # fmt: skip


EFFECTS = (
    ROOM_RECIRCULATION,
    SESSION_GAIN,
    GAIN_DRIFT,
    WARM_UP,
    ROTOR_SPEED,
    SUPPLY_SAG,
    AIR_DENSITY,
)
