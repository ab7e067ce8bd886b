"""What is fuzzed: each own parser, the manifest and the schedule. A target may end in our own
exceptions and in nothing else.
"""

from __future__ import annotations

import os
import tempfile
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.unit import written
from tests.unit.written import MANIFEST

import nearlift.campaign.manifest as manifests
from nearlift import units
from nearlift.campaign import parsing
from nearlift.errors import NearliftError
from nearlift.readers import lvm, stands, text
from nearlift.readers.guarded import Malformed
from nearlift.readers.piv import DIALECTS, Setting
from nearlift.readers.velocity_fields import to_si
from nearlift.reduction.conditions import Conditions
from nearlift.reduction.record import reduce_record
from nearlift.schedule import read_schedule

#: In memory where there is such a place.
SCRATCH = Path("/dev/shm") if Path("/dev/shm").is_dir() else Path(tempfile.gettempdir())


def _file(data: bytes) -> Path:
    path = SCRATCH / f"nearlift-fuzz-{os.getpid()}"
    path.write_bytes(data)
    return path


def csv(data: bytes) -> None:
    text.csv_contents(_file(data), {}, ("force", "t"))


def reduction(data: bytes) -> None:
    """Any numbers at all as a record, with and without a clock."""
    numbers = np.frombuffer(data[: len(data) // 8 * 8], dtype="<f8")
    half = len(numbers) // 2
    for range_N in (None, 9.8):
        given = {"rate_Hz": 100.0, "tare_s": 0.5, "range_N": range_N}
        reduce_record(numbers, Conditions(**given, settle_s=0.1))
        reduce_record(numbers[:half], Conditions(**given), time_s=numbers[half : 2 * half])


def dialects(data: bytes) -> None:
    text.contents(_file(data), {}, None)


def recipe(data: bytes) -> None:
    text.contents(_file(data), {"columns": ["a", "b"], "ignore": ["START"]}, ("a",))


def labels(data: bytes) -> None:
    text.contents(_file(data), {"labels": True}, None)


def stand_logs(data: bytes) -> None:
    path = _file(data)
    for stand in stands.STANDS:
        try:
            stands.contents(stand, path, {}, None)
        except NearliftError:
            continue


def labview(data: bytes) -> None:
    lvm.contents(_file(data), {}, None)


def manifest(data: bytes) -> None:
    manifests.parse(parsing.loads(data, "f"))


def schedule(data: bytes) -> None:
    folder = SCRATCH / f"nearlift-fuzz-{os.getpid()}.d"
    folder.mkdir(exist_ok=True)
    (folder / "trials.csv").write_bytes(data)
    read_schedule(manifests.parse(tomllib.loads(MANIFEST)), folder)


def grids(data: bytes) -> None:
    path = _file(data)
    for dialect in DIALECTS:
        if dialect.guarded:
            continue
        try:
            for raw in dialect.read(path):
                to_si(
                    raw,
                    (
                        SETTING
                        if raw.stated.length_unit
                        else replace(SETTING, length_unit="px", velocity_unit="px/frame")
                    ),
                    "f",
                )
        except NearliftError:
            continue


def _grid(header: str, separator: str, code: str, comma: bool = False) -> bytes:
    """Three by three vectors below a header, one of them missing."""
    rows = [f"{x}.5 {y}.5 {x + y}.25 {-y} {code}".split() for y in (1, 2, 3) for x in (1, 2, 3)]
    text = header + "".join(separator.join(row) + "\n" for row in rows)
    return (text.replace(".", ",") if comma else text).encode()


SETTING = Setting(scale_m=2e-5, frame_time_s=1e-4)
#: Headers of each text dialect, its separator, the codes of a good vector.
GRIDS = (
    ("# x\ty\tu\tv\tflags\tmask\n", "\t", "0 0"),
    ("PIVlab, ASCII chart output\nx [m],y [m],u [m/s],v [m/s],Vector type [-]\n", ",", "1"),
    ("x [px],y [px],u [px/frame],v [px/frame],Vector type [-]\n", ",", "1"),
    (
        'TITLE="a" VARIABLES="X mm", "Y mm", "U m/s", "V m/s", "CHC", ZONE I=3, J=3, F=POINT\n',
        ", ",
        "1",
    ),
    (
        '#DaVis 8.1.6 2D-vector 32 3 3 "position" "mm" "position" "mm" "velocity" "m/s"\n',
        "\t",
        "",
        True,
    ),
    (
        (
            ">>*HEADER*<<\nFileID:DSExport.CSV\nGridSize:{Width=3,Height=3}\n>>*DATA*<<\nx [mm],y"
            " [mm],U[m/s],V[m/s],Status\n"
        ),
        ",",
        "0",
    ),
)
FORCE = [1.5, -2.25, 3.125]
#: Target -> its function and what it starts from.
TARGETS: dict[str, tuple[Callable[[bytes], None], tuple[bytes, ...]]] = {
    "csv": (csv, (written.csv(FORCE), b"t,force\n0,OVER\n1,2")),
    "reduction": (
        reduction,
        tuple(np.random.default_rng(n).normal(0.2, 2e-3, n).tobytes() for n in (8, 80, 500)),
    ),
    "dialects": (
        dialects,
        (written.german(FORCE), b"a;b\n1,5;2\n", b"# x\na b\n1 2\n", b"t,F,\ns,mN,\n1,2,\n"),
    ),
    "recipe": (recipe, (b"START\r\n1, 2\r\n3, 4\r\n", b"1,5;2,5\n")),
    "labels": (labels, (b"T: 0.01 \t C: 0.65\nT: 0.02 \t C: 0.7\n",)),
    "stands": (
        stand_logs,
        (written.rcbenchmark(FORCE), written.tyto(FORCE), written.crazyflie(FORCE)),
    ),
    "labview": (
        labview,
        (written.lvm(FORCE), written.lvm(FORCE, decimal=".", columns="No", segments=2)),
    ),
    "manifest": (manifest, (MANIFEST.encode(),)),
    "grids": (grids, tuple(_grid(*form) for form in GRIDS)),
    "schedule": (schedule, (b"trial,boundary,distance,throttle\na,ground,30,50\nb,none,,50\n",)),
}


def ready() -> None:
    """Load what readers load on first use, which no input is to be blamed for."""
    units.to_si("furlong/fortnight", "velocity", "f")


def once(target: str, data: bytes) -> None:
    """Run a target; our own exceptions are answers."""
    try:
        TARGETS[target][0](data)
    except (NearliftError, Malformed):
        return
