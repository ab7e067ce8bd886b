"""Effects in newtons: additive errors of the reading. Each maps lift to lift."""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Prior, Source, normal, null

#: Median lift up to which a cell of 1 kgf serves. Zero errors are a share of the cell's range.
USUAL_LIFT_N = 1.0


def zero_offset(lift: Any, /, *, zero_N: Any) -> Any:
    """Force: a tare error common to all trials.

        lift -> lift + zero_N

    Mechanism: the tare is taken with rotors at rest, the lift with rotors turning. Forces that turn
    on with them (current in the leads, vibration rectified by the cell, thrust on the wiring) are
    not in the tare. They are the same at every trial.

    Convention: zero_N > 0 reads too much lift. The larger the lift, the less it matters in
    proportion; L_inf of a throttle takes up the part that does not vary with distance.

    Size on a Crazyflie: 0 to 0.5 gf (5 mN), 1.9 % of the weight.

    Confounded with K_b (it pushes every gain towards 1 in proportion), reynolds and
    cell_nonlinearity.
    """
    return lift + zero_N


ZERO_OFFSET = Effect(
    "zero_offset", "Zero offset", r"L \to L + F_0", zero_offset, acts_on="force", additive=True,
    varies_with="throttle", log_next_time=("tare_after",),
    mechanism="a force that turns on with the rotors is not in the tare",
    separated_by="a tare after the trial, low throttle, and check masses with the motors powered",
    parameters=(
        Parameter("zero_N", "N", 0.0, (-0.05, 0.05), normal(0.0, 0.005),
            "force left after the tare, the same at every trial; positive reads too much lift"),
    ),
    source=Source("Physics of the bench", doubts=("0.5 gf is the estimate for a cell of 1 kgf.",)),
    checks=(
        null(0.265),
        Check(0.265, 0.265 * 1.0185, {"zero_N": 4.903325e-3}, "0.5 gf is 1.9 % of 265 mN",
            tolerance=5e-5),
    ),
)  # fmt: skip


def zero_drift(
    lift: Any, /, *, session: Any, since_start_s: Any, zero_drift_N: Any, zero_drift_s: Any
) -> Any:
    """Force: the zero drifts after each start.

        lift -> lift + zero_drift_N (1 - exp(-since_start_s / zero_drift_s))

    Mechanism: cell and amplifier warm up once they are switched on or once the motors' air warms
    them. A tare taken before the session, or before the warmer part of each record, leaves the
    drift in.

    Convention: zero_drift_N > 0 reads too much lift later in the session; nothing at its first
    trial.

    Size on a Crazyflie: 0.1 gf/K over a few kelvin, 0 to 1 gf (10 mN), with 60 to 1800 s. Above a
    median lift of 1 N prior and bounds grow in proportion to it.

    Confounded with warm_up (in proportion to lift rather than the same at every throttle),
    cell_creep and zero_temperature.
    """
    return lift + zero_drift_N * -np.expm1(-since_start_s / zero_drift_s)


ZERO_DRIFT = Effect(
    "zero_drift", "Zero drift", r"L \to L + F_1 \left(1 - e^{-t_\mathrm{session} / \tau_0}\right)",
    zero_drift, acts_on="force", additive=True, varies_with="since_start_s",
    needs=("session", "since_start_s"), log_next_time=("session", "start", "tare_after"),
    mechanism="cell and amplifier warm up after each start, and their zero with them",
    separated_by="a tare after each trial, and several throttles at any time in the session",
    parameters=(
        Parameter("zero_drift_N", "N", 0.0, (-0.05, 0.05), normal(0.0, 0.004),
            "zero long after the start of a session less that at its start; positive reads too"
            " much lift later", usual_lift_N=USUAL_LIFT_N),
        Parameter("zero_drift_s", "s", 400.0, (30.0, 4000.0),
            Prior(distribution="lognorm", shape=(0.9,), scale=400.0),
            "time over which the zero settles to 1/e", grid=(100.0, 400.0, 1600.0)),
    ),
    source=Source("Physics of the bench; public reports on drift of load-cell amplifiers",
        doubts=("Sizes are estimates for cheap amplifiers.",)),
    checks=(
        null(0.3, session=0, since_start_s=900.0),
        Check(0.3, 0.3, {"session": 0, "since_start_s": 0.0, "zero_drift_N": 0.01},
            "nothing at the start"),
        Check(0.3, 0.3 + 0.01 * 0.6321206,
            {"session": 0, "since_start_s": 400.0, "zero_drift_N": 0.01},
            "by hand: 1 - 1/e at one time constant"),
    ),
)  # fmt: skip


def zero_temperature(
    lift: Any, /, *, temperature_K: Any, temperature_ref_K: Any, zero_N_per_K: Any
) -> Any:
    """Force: the zero follows temperature.

        lift -> lift + zero_N_per_K (temperature_K - temperature_ref_K)

    Mechanism: strain gauges, their glue and the amplifier are compensated only to so many counts
    per kelvin. The remainder is an error if the temperature changes between tare and trial.

    Convention: zero_N_per_K > 0 reads too much lift when warm. temperature_ref_K is the campaign's
    median. The recorded temperature is the air's; the cell's follows it with a delay.

    Size on a Crazyflie: 0 to 0.3 gf/K (3 mN/K); 0.1 gf/K is 0.4 % of the weight per kelvin. Above a
    median lift of 1 N prior and bounds grow in proportion to it.

    Confounded with air_density (in proportion to lift), zero_drift and gain_drift over a day that
    warms up.
    """
    return lift + zero_N_per_K * (temperature_K - temperature_ref_K)


ZERO_TEMPERATURE = Effect(
    "zero_temperature", "Thermal zero drift", r"L \to L + F_T \, (T - T_0)", zero_temperature,
    acts_on="force", additive=True, varies_with="temperature_K",
    needs=("temperature_K", "temperature_ref_K"), log_next_time=("temperature",),
    mechanism="the zero of cell and amplifier follows their temperature",
    separated_by="several throttles at each temperature, and motors-off records",
    parameters=(
        Parameter("zero_N_per_K", "N/K", 0.0, (-0.01, 0.01), normal(0.0, 0.0015),
            "change of zero per kelvin; positive reads too much lift when warm",
            usual_lift_N=USUAL_LIFT_N),
    ),
    source=Source("Physics of the bench",
        doubts=("0 to 0.3 gf/K is the range of cheap cells of 1 kgf.",)),
    checks=(
        null(0.265, temperature_K=300.0, temperature_ref_K=293.0),
        Check(0.265, 0.265 * 1.0037,
            {"temperature_K": 294.0, "temperature_ref_K": 293.0, "zero_N_per_K": 0.980665e-3},
            "0.1 gf/K is 0.4 % of 265 mN per kelvin", tolerance=5e-5),
    ),
)  # fmt: skip


def cell_nonlinearity(lift: Any, /, *, nonlinearity_per_N: Any) -> Any:
    """Force: the load cell's quadratic term.

        lift -> lift (1 + nonlinearity_per_N lift)

    Mechanism: the bridge's output is not quite proportional to force. The departure is larger under
    side load, or with a cell that was calibrated at two points of a far larger range.

    Convention: nonlinearity_per_N > 0 reads large forces too large. It works in newtons, hence
    `additive`, although its share grows with lift. L_inf of each throttle takes up the part that
    does not vary with distance; gains at high throttle are then read larger.

    Size on a Crazyflie: 0.1 % of full scale, 1e-4 per N for a cell of 1 kgf, invisible. A cell of 1
    N loaded off its axis 0.01 per N and more.

    Confounded with reynolds and zero_offset (gain against throttle), and with K_b at a single
    throttle.
    """
    return lift * (1.0 + nonlinearity_per_N * lift)


CELL_NONLINEARITY = Effect(
    "cell_nonlinearity", "Cell nonlinearity", r"L \to L + q L^2", cell_nonlinearity,
    acts_on="force", additive=True, loaded=True, varies_with="throttle",
    log_next_time=("check masses",),
    mechanism="the load cell's output has a quadratic term",
    separated_by="check masses up and down over the range used",
    parameters=(
        Parameter("nonlinearity_per_N", "1/N", 0.0, (-0.3, 0.3), normal(0.0, 0.03),
            "relative excess of the reading per newton; positive reads large forces too large"),
    ),
    source=Source("Data sheets of strain-gauge cells",
        doubts=(
            ("A sound cell of 1 kgf has 1e-4 per N, which is below the detection limit. The prior"
             " is that of a small cell badly mounted."),
        ),
    ),
    checks=(null(0.5), Check(0.5, 0.505, {"nonlinearity_per_N": 0.02}, "by hand: 0.02 x 0.25")),
)  # fmt: skip


def cell_creep(lift: Any, /, *, previous_lift_N: Any, rest_s: Any, creep: Any, creep_s: Any) -> Any:
    """Force: the cell still recovers from the trial before.

        lift -> lift + creep previous_lift_N exp(-rest_s / creep_s)

    Mechanism: a loaded cell creeps, and recovers after the load is gone. A record that begins
    before it has recovered has a wrong tare, in proportion to the load of the trial before.

    Convention: creep > 0 reads too much lift after a heavy trial. A tare that is taken during
    recovery gives creep < 0, so both signs are admitted. previous_lift_N is 0 at the start of a
    session, rest_s the pause since the end of the trial before. Without recorded times rest_s is 0,
    and creep takes up the pause's part.

    Size on a Crazyflie: 0 to 0.05 % of the load, 10 to 1000 s. It is below 0.02 gf on a cell of 1
    kgf, ten times that on a cheap one.

    Confounded with the previous throttle's other traces: warm motors, a battery that recovers.
    Throttles in ascending order make it part of L_inf.
    """
    return lift + creep * previous_lift_N * np.exp(-np.maximum(rest_s, 0.0) / creep_s)


CELL_CREEP = Effect(
    "cell_creep", "Cell creep",
    r"L \to L + c \, L_\mathrm{previous} \, e^{-t_\mathrm{rest} / \tau_c}", cell_creep,
    acts_on="force", additive=True, loaded=True, varies_with="previous_lift_N",
    needs=("previous_lift_N", "rest_s"), log_next_time=("start", "tare_after"),
    mechanism="the load cell still recovers from the load of the trial before",
    separated_by="throttles in random order, longer pauses, and a tare after each trial",
    parameters=(
        Parameter("creep", "1", 0.0, (-0.1, 0.1), normal(0.0, 0.005),
            "share of the previous load that is still read right after it; positive reads too"
            " much lift after a heavy trial", size_unit="fraction of the previous load"),
        Parameter("creep_s", "s", 60.0, (5.0, 2000.0),
            Prior(distribution="lognorm", shape=(1.2,), scale=60.0),
            "time over which the cell recovers to 1/e", grid=(15.0, 60.0, 400.0)),
    ),
    source=Source("Data sheets of strain-gauge cells; public reports on creep of cheap ones",
        doubts=("The sign depends on when the tare is taken.",)),
    checks=(
        null(0.3, previous_lift_N=0.5, rest_s=5.0),
        Check(0.3, 0.3025, {"previous_lift_N": 0.5, "rest_s": 0.0, "creep": 0.005},
            "by hand: 0.5 % of 0.5 N"),
        Check(0.3, 0.3 + 0.0025 * 0.36787944,
            {"previous_lift_N": 0.5, "rest_s": 60.0, "creep": 0.005},
            "by hand: 1/e after one time constant"),
    ),
)  # fmt: skip


def tether_stiffness(lift: Any, /, *, z_hat: Any, radius_m: Any, stiffness_N_per_m: Any) -> Any:
    """Force: the wiring pulls in proportion to height.

        lift -> lift + stiffness_N_per_m z_hat r

    Mechanism: leads and tether bend as the vehicle is moved. The tare does not remove all of their
    pull (it stiffens under current and in the jet). The rest varies with the distance from the
    boundary.

    Convention: stiffness_N_per_m > 0 reads too much lift far from the boundary. Counted from
    contact; in free air, where no distance is on record, nothing is added. A pull that is the same
    at all distances is `zero_offset`.

    Size on a Crazyflie: 0 to 20 mN/m, so 0 to 1 mN (0.4 % of the weight) over 50 mm. 5 mN at the
    farthest station of 265 mm.

    Confounded with K_b (a long tail), room_recirculation, plate_edge; at a single throttle with
    anything slow in distance.
    """
    return lift + stiffness_N_per_m * np.where(np.isinf(z_hat), 0.0, z_hat) * radius_m


TETHER_STIFFNESS = Effect(
    "tether_stiffness", "Tether stiffness", r"L \to L + k_c \, r \hat{z}", tether_stiffness,
    acts_on="force", additive=True, varies_with="z_hat",
    needs=("z_hat", "radius_m"), log_next_time=("motors-off sweep of heights",),
    mechanism="bent wiring pulls in proportion to height",
    separated_by=(
        "a sweep of heights with motors off, and low throttle, where it is largest in proportion"
    ),
    parameters=(
        Parameter("stiffness_N_per_m", "N/m", 0.0, (-0.2, 0.2), normal(0.0, 0.02),
            "pull of the wiring per metre from the boundary; positive reads too much lift far"
            " away"),
    ),
    source=Source("Physics of the bench",
        doubts=("0 to 20 mN/m is an estimate for thin leads; it depends on their routing.",)),
    checks=(
        null(0.265, z_hat=5.0, radius_m=0.023),
        Check(0.265, 0.266, {"z_hat": 50 / 23, "radius_m": 0.023, "stiffness_N_per_m": 0.02},
            "20 mN/m over 50 mm: 1 mN"),
    ),
)  # fmt: skip


EFFECTS = (
    ZERO_OFFSET,
    ZERO_DRIFT,
    ZERO_TEMPERATURE,
    CELL_NONLINEARITY,
    CELL_CREEP,
    TETHER_STIFFNESS,
)
