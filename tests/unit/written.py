"""Files in outside formats as instruments write them, from a series of numbers: for round trips,
damage and fuzzing.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

RC_HEADER = (
    "\ufeffTime (s),ESC signal (\u00b5s),Servo 1 (\u00b5s),AccX (g),Torque (N\u00b7m),Thrust"
    " (gf),Voltage (V),Motor Electrical Speed (RPM),Vibration (g),App message,"
)
TYTO_HEADER = (
    "Time (s),Powertrain 1 - ESC throttle (\u03bcs),Powertrain 1 - force Fz (thrust) (N),"
    "Powertrain 1 - torque MZ (torque) (N\u22c5m),Powertrain 1 - rotation speed (rpm)"
)

#: Of a bench with one CSV file per trial.
MANIFEST = """
schema = "nearlift.campaign/1"
name = "bench"
vehicle = { name = "Crazyflie 2.0", rotors = 4, rotor_radius = "23 mm", rotor_spacing = "65 mm", mass = "27 g" }
rig = { held = "throttle", distance_datum = "rotor plane", distance_offset = "0 mm", arena = "1.5 m", gravity = "9.8 m/s^2" }
load_cell = { sample_rate = "200 Hz", tare = "0.5 s", range = "1 kgf", record = "2.5 s" }
records = { reader = "csv", files = "trials/{trial}.csv", force = { column = "force", unit = "mN", sign = 1 } }
[trials.units]
distance = "mm"
throttle = "percent"
supply = "V"
"""


def csv(force: Sequence[float]) -> bytes:
    return b"t,force\n" + b"".join(f"{i / 1000!r},{f!r}\n".encode() for i, f in enumerate(force))


def german(force: Sequence[float]) -> bytes:
    """What a spreadsheet in a German locale saves: semicolons, decimal commas, a row of units,
    UTF-16.
    """
    rows = "".join(f"{i / 1000!r};{f!r}\r\n".replace(".", ",") for i, f in enumerate(force))
    return ("Zeit;Kraft\r\ns;mN\r\n" + rows).encode("utf-16")


def _rows(header: str, row: str, force: Sequence[float]) -> bytes:
    """A header, and a row for each force, its time at 40 Hz and its number to be filled in."""
    lines = (row.format(t=repr(i / 40), f=repr(f)) for i, f in enumerate(force))
    return "\n".join([header, *lines, ""]).encode()


def rcbenchmark(force: Sequence[float]) -> bytes:
    return _rows(RC_HEADER, "{t},1500,,0.1,0.002,{f},4.01,9000,0.2,,", force)


def tyto(force: Sequence[float]) -> bytes:
    return _rows(TYTO_HEADER, "{t},1500,{f},0.1,9000", force)


def crazyflie(force: Sequence[float]) -> bytes:
    return _rows("weight[g],pwm,vbat[V],rpm1,rpm2", "{f},30000,3.9,9000,9100", force)


def lvm(
    force: Sequence[float], *, decimal: str = ",", columns: str = "One", segments: int = 1
) -> bytes:
    """LabVIEW's measurement text, each segment with all samples."""
    head = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\n"
        f"Decimal_Separator\t{decimal}\nMulti_Headings\tYes\nX_Columns\t{columns}\nTime_Pref\tRelative\n***End_of_Header***\t\n\t\n"
    )
    part = (
        f"Channels\t2\t\t\nSamples\t{len(force)}\t{len(force)}\t\nY_Unit_Label\tNewtons\tVolts\t\nX_Dimension\tTime\tTime\t\n"
        "X0\t0.0\t0.0\t\nDelta_X\t0.001\t0.001\t\n***End_of_Header***\t\t\t\nX_Value\tForce\tSupply\tComment\n"
    )
    clock = (repr(i / 1000) if columns == "One" else "" for i in range(len(force)))
    rows = "".join(f"{t}\t{f!r}\t4.0\n" for t, f in zip(clock, force, strict=True))
    return (head + segments * (part + rows + "\n")).replace(".", decimal).encode()


def tdms(force: Sequence[float]) -> bytes:
    from nptdms import ChannelObject, TdmsWriter

    sink = io.BytesIO()
    about = {"unit_string": "N", "wf_increment": 0.001}
    with TdmsWriter(sink) as writer:
        # a logger appends segments
        for part in np.array_split(np.asarray(force, dtype=float), 5):
            writer.write_segment([ChannelObject("daq", "force", part, properties=about)])
    return sink.getvalue()


def mat(force: Sequence[float], *, compressed: bool = True) -> bytes:
    import scipy.io

    sink = io.BytesIO()
    content = {"run": {"force": np.asarray(force, dtype=float)}}
    scipy.io.savemat(sink, content, do_compression=compressed)
    return sink.getvalue()


def hdf5(force: Sequence[float], *, fletcher: bool = False) -> bytes:
    import h5py

    sink = io.BytesIO()
    how = {"fletcher32": fletcher, "chunks": True if fletcher else None}
    with h5py.File(sink, "w") as file:
        item = file.create_dataset("daq/force", data=np.asarray(force, dtype=float), **how)
        item.attrs["units"] = "N"
        item.attrs["sample_rate"] = 1000.0
    return sink.getvalue()


def v73(force: Sequence[float]) -> bytes:
    """As MATLAB lays it out: a block of 512 bytes before the HDF5, arrays with their class."""
    import h5py

    sink = io.BytesIO()
    with h5py.File(sink, "w", userblock_size=512) as file:
        item = file.create_dataset("force", data=np.asarray(force, dtype=float)[:, None].T)
        item.attrs["MATLAB_class"] = np.bytes_("double")
    content = bytearray(sink.getvalue())
    content[:19] = b"MATLAB 7.3 MAT-file"
    return bytes(content)


#: Reader -> how to write, the column that holds the force, its unit in the manifest, and the file's
#: suffix.
WRITERS: dict[str, tuple[Callable[[Sequence[float]], bytes], str, str, str]] = {
    "csv": (csv, "force", "N", "csv"),
    "text": (german, "Kraft", "mN", "txt"),
    "rcbenchmark": (rcbenchmark, "Thrust", "gf", "csv"),
    "flight-stand": (tyto, "Powertrain 1 - force Fz (thrust)", "N", "csv"),
    "crazyflie": (crazyflie, "weight", "gf", "csv"),
    "lvm": (lvm, "Force", "N", "lvm"),
    "tdms": (tdms, "daq/force", "N", "tdms"),
    "mat": (mat, "run.force", "N", "mat"),
    "hdf5": (hdf5, "/daq/force", "N", "h5"),
}


def put(folder: Path, name: str, content: bytes) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


#: What somebody at the rig would write into the gaps of a manifest.
ANSWERS = {
    "name": '"Crazyflie 2.0"',
    "rotors": "4",
    "rotor_radius": '"23 mm"',
    "rotor_spacing": '"65 mm"',
    "mass": '"27 g"',
    "held": '"throttle"',
    "distance_datum": '"rotor plane"',
    "distance_offset": '"0 mm"',
    "gravity": '"9.80665 m/s^2"',
    "sample_rate": '"500 Hz"',
    "tare": '"0.1 s"',
    "accuracy": '"1.5 gf"',
    "force": '{ column = "force", unit = "mN", sign = 1 }',
}


def fill_in(folder: Path, **others: str) -> str:
    """The manifest of a folder with its gaps filled, written."""
    path = folder / "campaign.toml"
    text = path.read_text()
    for key, value in (ANSWERS | others).items():
        text = re.sub(rf"^({key} *= ).*FILL IN.*$", rf"\g<1>{value}", text, flags=re.M)
    path.write_text(text)
    return text
