"""doctor: whether this machine is fit to run nearlift, with what to do where it is not."""

from __future__ import annotations

import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from nearlift import blas, isolation
from nearlift.commands.common import Call, declared
from nearlift.errors import UsageError

State = Literal["good", "note", "bad"]

#: Package of each extra, and what is lost without it.
EXTRAS = {
    "nptdms": ("tdms", "reading TDMS files"),
    "h5py": ("hdf5", "reading HDF5 files"),
    "mat-io": ("mat", "reading MATLAB timetables"),
    "pyulog": ("ulog", "reading ULog of PX4"),
    "mcap-ros2-support": ("mcap", "reading MCAP of ROS 2"),
    "h5netcdf": ("netcdf", "posterior.nc"),
    "distributed": ("dask", "running on a dask cluster"),
}
#: Bytes that a campaign's products and the compiled kernels' cache need at most, generously.
ENOUGH_DISK = 1 << 30


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One line: what was looked at, what was found, and what to do unless it is good."""

    what: str
    state: State
    found: str
    remedy: str = ""


def _judged(
    what: str, good: bool, text: str, remedy: str = "", otherwise: State = "note"
) -> Finding:
    """What was looked at, whether it is good, what was found, and what to do where it is not."""
    return Finding(what=what, state="good" if good else otherwise, found=text, remedy=remedy)


def examine(out: Path) -> tuple[Finding, ...]:
    """Everything; `out` is where products would be written."""
    return (*_python(), *_packages(), *_plug_ins(), *_machine(), *_folder(out))


def _python() -> Iterator[Finding]:
    version = f"{platform.python_version()} on {platform.system()}"
    enough = sys.version_info >= (3, 11)
    yield _judged("Python", enough, version, "install Python 3.11 or newer", "bad")


def _packages() -> Iterator[Finding]:
    """What pyproject.toml asks for and what is there, by the installed package's own metadata."""
    from packaging.requirements import Requirement

    wanted = [Requirement(text) for text in metadata.requires("nearlift") or ()]
    core = [r for r in wanted if r.marker is None or r.marker.evaluate({"extra": ""})]
    wrong = []
    for requirement in core:
        try:
            version = metadata.version(requirement.name)
        except metadata.PackageNotFoundError:
            wrong.append(f"{requirement.name} is missing")
            continue
        if not requirement.specifier.contains(version, prereleases=True):
            wrong.append(f"{requirement.name} {version} is not {requirement.specifier}")
    text = "; ".join(wrong) or f"all {len(core)} are there"
    remedy = "install nearlift again, or run `make` in its folder"
    yield _judged("packages", not wrong, text, remedy, "bad")
    for name, (extra, use) in EXTRAS.items():
        try:
            yield _judged(name, True, metadata.version(name))
        except metadata.PackageNotFoundError:
            remedy = f'pip install "nearlift[{extra}]"'
            yield _judged(name, False, f"not installed: no {use}", remedy)


def _plug_ins() -> Iterator[Finding]:
    """Other packages' declarations, of which a broken one would end every command."""
    from nearlift import catalogue
    from nearlift.errors import NearliftError

    try:
        models, effects = len(catalogue.models()), len(catalogue.effects())
    except NearliftError as fault:
        remedy = "mend or remove the package that declares it"
        yield _judged("plug-ins", False, str(fault).splitlines()[0], remedy, "bad")
        return
    yield _judged("catalogue", True, f"{models} models, {effects} effects")


def _machine() -> Iterator[Finding]:
    cores = os.cpu_count() or 1
    workers = f"--executor threads:{cores} for one campaign, processes:{cores} for many"
    yield _judged("processors", True, f"{cores}: {workers}")
    threads = {name: os.environ[name] for name in blas.VARIABLES if name in os.environ}
    yield _judged(
        "BLAS threads",
        all(value == "1" for value in threads.values()),
        ", ".join(f"{name}={value}" for name, value in threads.items()) or "left to the library",
        "set them to 1: small fits are slowed down many times by threads that wait for each other",
    )
    entries = os.environ.get("PYTHONPATH", "")
    listed = entries.split(os.pathsep) if entries else []
    here = [entry for entry in listed if not Path(entry).is_absolute()]
    yield _judged(
        "PYTHONPATH",
        not here,
        f"{', '.join(map(repr, here))}: Python imports from the current folder"
        if here
        else "nothing is imported from the current folder",
        "write whole paths, and no empty entry: whoever fills a folder of data could put code"
        " there",
    )
    kept = isolation.code_folder()
    yield _judged(
        "compiled code",
        bool(kept),
        f"kept in {kept}"
        if kept
        else "not kept: there is no folder that only you can write, so every run compiles anew",
        "delete ~/.cache/nearlift/code if its mode is not 0700 or it is not yours, or set"
        " XDG_CACHE_HOME to a folder of your own",
    )
    compiler = shutil.which("cc") or shutil.which("gcc")
    remedy = "only for checking exported C headers"
    yield _judged("C compiler", bool(compiler), compiler or "none", remedy)


def _folder(out: Path) -> Iterator[Finding]:
    place = next(folder for folder in (out.absolute(), *out.absolute().parents) if folder.is_dir())
    try:
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as fault:
        remedy = "say --out with a folder that may be written"
        yield _judged("output folder", False, f"{place}: {fault.strerror}", remedy, "bad")
        return
    free = shutil.disk_usage(place).free
    remedy = "products of a large campaign may need 1 GiB"
    text = f"{place}, {free / 2**30:.1f} GiB free"
    yield _judged("output folder", free >= ENOUGH_DISK, text, remedy)


@declared("doctor")
def command(call: Call) -> None:
    """Every line, and 2 where one is bad."""
    findings = examine(call.out)
    lines = [
        f"{f.state:<6}{f.what:<15}{f.found}"
        + (f"  ({f.remedy})" if f.state != "good" and f.remedy else "")
        for f in findings
    ]
    call.answer([asdict(f) for f in findings], "\n".join(lines))
    sys.exit(UsageError.exit_code if any(f.state == "bad" for f in findings) else 0)
