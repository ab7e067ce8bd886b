"""Flights of a simulated quadrotor that weighs itself: a rigid vehicle in closed loop with lagging
motors, ground effect, climb inflow, a sagging battery, gusts and noisy sensors; and its logs, as a
flight controller writes them.

Nothing here is the product's: formulas are written out from their sources, files by their layouts.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

G = 9.81
STEP_S, EVERY = 0.002, 5
"""Step of the simulation, and how many of them a log's sample takes: 100 Hz."""
FULL = 65535


class Craft(NamedTuple):
    """The truth of a flight. Lift at command u and supply V is weight * ((u V) / (u0 V0))^exponent
    times ground effect and 1 - climb * v_z; lengths in m.
    """

    mass: float = 0.0327
    radius: float = 0.0231
    spacing: float = 0.065
    plane: float = 0.030
    """Rotor plane above the feet."""
    k_b: float = 2.0
    exponent: float = 1.7
    climb: float = 0.045
    lag_s: float = 0.075
    hover: float = 0.62
    supply_V: float = 3.9
    sag_V_s: float = 0.004
    resistance: float = 0.35
    """Volts of sag at full throttle."""
    gust_N: float = 0.003
    gust_s: float = 0.4
    height_noise: float = 0.002
    acceleration_noise: float = 0.15
    shares: tuple[float, ...] = (1.04, 0.97, 1.03, 0.96)
    """What each rotor is told beside the others."""
    blades: float = 0.0
    """Loss of thrust per rise of the inflow, solidity x lift slope / (8 inflow ratio of hover), in
    place of `climb`: 0.6 is a small propeller's."""
    sway_m_s: float = 0.0
    """How fast it goes sideways to and fro, at most."""
    health: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    """What each rotor gives beside a sound one at the same command."""


Log = dict[str, NDArray[np.float64]]


def ground(z_m: float, craft: Craft) -> float:
    """Lift over lift far away: Sanchez-Cuevas, Heredia and Ollero 2017, with the fountain's K_b."""
    r, d = craft.radius, craft.spacing
    b = math.sqrt(2) * d
    own = (r / (4 * z_m)) ** 2
    near = r**2 * z_m / (d**2 + 4 * z_m**2) ** 1.5
    far = 0.5 * r**2 * z_m / (2 * d**2 + 4 * z_m**2) ** 1.5
    fountain = 2 * r**2 * z_m / (b**2 + 4 * z_m**2) ** 1.5 * craft.k_b
    return 1 / (1 - own - near - far - fountain)


def inflow(climb: float, level: float, craft: Craft) -> float:
    """Thrust over that of hover at the same command, in climb and level flight, m/s: the balance of
    blade elements, whose thrust falls as the inflow rises, and of momentum (Glauert), by halving.
    """
    disks = 4 * math.pi * craft.radius**2
    hover = math.sqrt(craft.mass * G / (2 * 1.2 * disks))
    w, u = climb / hover, level / hover
    low, high = 0.3, 3.0
    for _ in range(40):
        thrust = 0.5 * (low + high)
        # over that of hover: what blades that lift so much let through, climb and all
        through = 1 + (1 - thrust) / craft.blades
        if (through - w) * math.hypot(u, through) > thrust:
            low = thrust
        else:
            high = thrust
    return thrust


def trimmed(craft: Craft) -> tuple[tuple[float, ...], float]:
    """What each rotor is told over the mean of all, so that moments balance, and what all lift
    then over sound ones at that mean.
    """
    told = [s * h ** (-1 / craft.exponent) for s, h in zip(craft.shares, craft.health, strict=True)]
    mean = sum(told) / len(told)
    shares = tuple(t / mean for t in told)

    def whole(shares: tuple[float, ...], health: tuple[float, ...]) -> float:
        return sum(h * s**craft.exponent for s, h in zip(shares, health, strict=True))

    return shares, whole(shares, craft.health) / whole(craft.shares, (1.0,) * 4)


def heights(rng: np.random.Generator, n: int) -> NDArray[np.float64]:
    """Set-points of a flight, above the floor, in m: low ones as often as high ones, and a brisk
    start.
    """
    return np.r_[0.3, np.exp(rng.uniform(math.log(0.02), math.log(0.5), n - 1))]


def fly(
    craft: Craft,
    rng: np.random.Generator,
    targets: NDArray[np.float64],
    hold_s: float = 2.0,
    on_floor_s: float = 1.5,
    floor_reads: float = 0.0,
) -> Log:
    """One start, its set-points in turn, and a landing, sampled at 100 Hz; `floor_reads` is what
    the height sensor says on the floor.
    """
    weight = craft.mass * G
    length = on_floor_s + hold_s * len(targets) + 3.0
    steps = round(length / STEP_S)
    z = v = gust = motor = told = integral = asked = 0.0
    fade = math.exp(-STEP_S / craft.gust_s)
    kick = craft.gust_N * math.sqrt(1 - fade**2)
    follow = 1 - math.exp(-STEP_S / craft.lag_s)
    noise = rng.standard_normal((steps, 2))
    rows = []
    u0v0 = craft.hover * craft.supply_V
    landed = False
    shares, whole = trimmed(craft)
    beat = 2 * math.pi * 0.08
    for k in range(steps):
        t = k * STEP_S
        if k % EVERY == 0:
            at = int((t - on_floor_s) // hold_s)
            flies = t >= on_floor_s and not landed
            target = float(targets[at]) if at < len(targets) else -0.2
            # a set-point moves at 0.6 m/s at most
            asked += np.clip(target - asked, -0.006, 0.006) if flies else 0.0
            read = z + craft.height_noise * noise[k, 1]
            if flies:
                away = asked - read
                integral = float(np.clip(integral + 0.4 * away * 0.01, -0.3, 0.3))
                rate = 6.0 * away - 3.5 * v
                told = float(np.clip(craft.hover * (1 + integral + 0.16 * rate), 0.05, 1.0))
            else:
                told, integral = 0.0, 0.0
            if at >= len(targets) and z <= 0.0 and v <= 0.0:
                landed = True
        motor += follow * (told - motor)
        supply = craft.supply_V - craft.sag_V_s * t - craft.resistance * motor**2
        gust = fade * gust + kick * noise[k, 0]
        # sideways at a speed that comes and goes, with the lean that this takes
        swell = craft.sway_m_s * math.sin(beat / 7 * t) if z > 0 else 0.0
        level, pull = swell * math.sin(beat * t), swell * beat * math.cos(beat * t)
        moving = inflow(v, level, craft) if craft.blades else 1 - craft.climb * v
        lift = (
            weight
            * (max(motor, 0.0) * supply / u0v0) ** craft.exponent
            * whole
            * ground(max(z, 0.0) + craft.plane, craft)
            * moving
        )
        lean = lift * (1 - G / math.hypot(G, pull))
        force = lift - lean + (gust if z > 0 else 0.0) - weight
        if z <= 0.0 and force < 0.0:
            felt, v, z = G, 0.0, 0.0
        else:
            felt = G + (force + lean) / craft.mass
            v += force / craft.mass * STEP_S
            z += v * STEP_S
            if z < 0.0:
                z, v = 0.0, 0.0
        if k % EVERY == 0:
            rows.append((t, z, v, felt, told, supply, asked, level))
    t, z_m, v_m, felt, command, volts, setpoint, level_m_s = np.array(rows).T
    n = len(t)
    slow = rng.standard_normal((n, 3))
    log = {
        "t": t,
        "z": z_m + floor_reads + craft.height_noise * slow[:, 0],
        "vz": v_m + 0.005 * slow[:, 1],
        "az": felt + craft.acceleration_noise * slow[:, 2],
        "setpoint": setpoint,
        "supply": volts,
    }
    if craft.sway_m_s:
        log |= {"vx": level_m_s, "vy": 0.0 * level_m_s}
    for k, share in enumerate(shares, start=1):
        log[f"m{k}"] = np.round(np.clip(command * share, 0, 1) * FULL)
    return log


def joined(*logs: Log, pause_s: float = 0.01) -> Log:
    """Flights of one log, one behind the other."""
    parts, at = [], 0.0
    for log in logs:
        parts.append({**log, "t": log["t"] + at})
        at = float(parts[-1]["t"][-1]) + pause_s
    return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}


def write_csv(path: Path, log: Mapping[str, Any], tick: float = 1000.0, unit: str = "ms") -> None:
    """A log as text, a row a sample; its clock in `unit`, `tick` of them to a second."""
    names = [name for name in log if name != "t"]
    lines = [",".join([f"t ({unit})" if unit else "t", *names])]
    for row in zip(np.round(log["t"] * tick, 3), *(log[name] for name in names), strict=True):
        lines.append(",".join(f"{value:.9g}" for value in row))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def usd(log: Mapping[str, Any], version: int = 2) -> bytes:
    """A log of the Crazyflie's uSD deck, one event of floats."""
    names = [name for name in log if name != "t"]
    head = struct.pack("<BHH", 0xBC, version, 1) + struct.pack("<H", 7) + b"fixedFrequency\0"
    head += struct.pack("<H", len(names)) + b"".join(f"{n}(f)".encode() + b"\0" for n in names)
    body = bytearray(head)
    clock = ("<I", 1e3) if version == 1 else ("<Q", 1e6)
    for i, t in enumerate(log["t"]):
        body += struct.pack("<H", 7) + struct.pack(clock[0], round(float(t) * clock[1]))
        body += struct.pack(f"<{len(names)}f", *(float(log[n][i]) for n in names))
    return bytes(body) + struct.pack("<I", zlib.crc32(body))


def topics(log: Mapping[str, Any]) -> dict[str, tuple[NDArray[np.float64], dict[str, Any]]]:
    """A log as a controller with topics has it: clocks of their own, the supply at 10 Hz, z down."""
    t = log["t"]
    slow = slice(None, None, 10)
    return {
        "sensor_combined": (t, {"accelerometer_z": -log["az"]}),
        "vehicle_local_position": (t + 0.003, {"z": -log["z"], "vz": -log["vz"]}),
        "actuator_outputs": (t + 0.001, {f"output_{k}": log[f"m{k}"] for k in (1, 2, 3, 4)}),
        "battery_status": (t[slow], {"voltage_v": log["supply"][slow]}),
    }


#: What ROS 2 writes of a message of floats with a header.
DEFINED = """std_msgs/Header header
{fields}
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def rosbag(path: Path, log: Mapping[str, Any], late_s: float = 0.05, defined: bool = True) -> None:
    """A bag of those topics in SQLite, messages in CDR, written `late_s` after each was measured;
    by ROS 2 before Iron without their definitions.
    """
    import sqlite3

    bag = sqlite3.connect(path)
    bag.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT,"
        " serialization_format TEXT, offered_qos_profiles TEXT)"
    )
    bag.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,"
        " data BLOB)"
    )
    if defined:
        bag.execute(
            "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, encoding"
            " TEXT, encoded_message_definition TEXT, type_description_hash TEXT)"
        )
    for k, (name, (clock, columns)) in enumerate(topics(log).items(), 1):
        kind = f"logged/msg/T{k}"
        bag.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", (k, f"/{name}", kind))
        if defined:
            text = DEFINED.format(fields="\n".join(f"float64 {c}" for c in columns))
            bag.execute(
                "INSERT INTO message_definitions VALUES (?, ?, 'ros2msg', ?, '')", (k, kind, text)
            )
        for i, t in enumerate(clock):
            nano = round(t * 1e9) + 10**18
            # encapsulation, stamp, an empty text with its end, and padding to eight bytes
            head = struct.pack("<4siII", b"\0\1\0\0", nano // 10**9, nano % 10**9, 1) + bytes(4)
            data = head + struct.pack(f"<{len(columns)}d", *(v[i] for v in columns.values()))
            when = nano + round(late_s * 1e9)
            bag.execute(
                "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", (k, when, data)
            )
    bag.commit()
    bag.close()


#: What a manifest says of such topics.
TOPICS: dict[str, Any] = {
    "acceleration": {
        "column": "sensor_combined.accelerometer_z",
        "unit": "m/s^2",
        "sign": -1,
        "gravity": "included",
        "axes": "body",
    },
    "command": {"columns": [f"actuator_outputs.output_{k}" for k in (1, 2, 3, 4)], "full": FULL},
    "supply": {"column": "battery_status.voltage_v", "unit": "V"},
    "height": {
        "column": "vehicle_local_position.z",
        "unit": "m",
        "sign": -1,
        "zero": "each start",
    },
    "velocity": {"column": "vehicle_local_position.vz", "unit": "m/s", "sign": -1},
}


def ulog(log: Mapping[str, Any], begun_us: int = 7_000_000) -> bytes:
    """A ULog of PX4 with those topics."""
    out = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", begun_us))

    def message(kind: bytes, body: bytes) -> None:
        out.extend(struct.pack("<H", len(body)) + kind + body)

    message(b"B", bytes(40))
    each = list(topics(log).items())
    for name, (_, columns) in each:
        fields = "".join(f"float {c};" for c in columns)
        message(b"F", f"{name}:uint64_t timestamp;{fields}".encode())
    for k, (name, _) in enumerate(each):
        message(b"A", struct.pack("<BH", 0, k) + name.encode())
    rows = sorted((t, k, i) for k, (_, (clock, _)) in enumerate(each) for i, t in enumerate(clock))
    for t, k, i in rows:
        values = [float(c[i]) for c in each[k][1][1].values()]
        body = struct.pack("<HQ", k, begun_us + round(t * 1e6))
        message(b"D", body + struct.pack(f"<{len(values)}f", *values))
    return bytes(out)


def mcap(path: Path, log: Mapping[str, Any], late_s: float = 0.05) -> None:
    """A bag of those topics in JSON, written `late_s` after each was measured."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for name, (clock, columns) in topics(log).items():
            schema = writer.register_schema(name=name, encoding="jsonschema", data=b"{}")
            channel = writer.register_channel(
                topic=f"/{name}", message_encoding="json", schema_id=schema
            )
            for i, t in enumerate(clock):
                nano = round(t * 1e9) + 10**18
                stamp = {"sec": nano // 10**9, "nanosec": nano % 10**9}
                row = {"header": {"stamp": stamp}, **{c: float(v[i]) for c, v in columns.items()}}
                when = nano + round(late_s * 1e9)
                writer.add_message(channel, when, json.dumps(row).encode(), when)
        writer.finish()


#: What a manifest says of such a log.
FLIGHT: dict[str, Any] = {
    "acceleration": {"column": "az", "unit": "m/s^2", "gravity": "included", "axes": "body"},
    "command": {"columns": ["m1", "m2", "m3", "m4"], "full": FULL},
    "supply": {"column": "supply", "unit": "V"},
    "height": {"column": "z", "unit": "m", "zero": "each start"},
    "velocity": {"column": "vz", "unit": "m/s"},
    "setpoint": {"column": "setpoint", "unit": "m"},
}


def manifest(flight: Mapping[str, Any] = FLIGHT, **changes: Any) -> dict[str, Any]:
    """A campaign of such logs as parsed TOML; `changes` replace whole tables."""
    craft = Craft()
    return {
        "schema": "nearlift.campaign/1",
        "name": "flown",
        "simulated": True,
        "vehicle": {
            "name": "simulated",
            "rotors": 4,
            "rotor_radius": f"{1e3 * craft.radius:g} mm",
            "rotor_spacing": f"{1e3 * craft.spacing:g} mm",
            "mass": f"{1e3 * craft.mass:g} g",
        },
        "rig": {
            "held": "command",
            "distance_datum": "airframe",
            "distance_offset": f"{1e3 * craft.plane:g} mm",
            "gravity": f"{G} m/s^2",
        },
        "records": {
            "reader": "text",
            "files": "logs/{record}.csv",
            "time": {"column": "t", "unit": "ms"},
        },
        "flight": dict(flight),
        **changes,
    }
