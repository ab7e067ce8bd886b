"""doctor: whether this machine is fit to run nearlift, line by line, with what to do where it is
not.
"""

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
    "casadi": ("casadi", "exporting CasADi expressions"),
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


def examine(out: Path) -> tuple[Finding, ...]:
    """Everything; `out` is where products would be written."""
    return (*_python(), *_packages(), *_plug_ins(), *_machine(), *_folder(out))


def _python() -> Iterator[Finding]:
    enough = sys.version_info >= (3, 11)
    yield Finding(
        what="Python",
        state="good" if enough else "bad",
        found=f"{platform.python_version()} on {platform.system()}",
        remedy="install Python 3.11 or newer",
    )


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
    remedy = "install nearlift again, or run `make` in its folder"
    yield Finding(
        what="packages",
        state="bad" if wrong else "good",
        found="; ".join(wrong) or f"all {len(core)} are there",
        remedy=remedy,
    )
    for name, (extra, use) in EXTRAS.items():
        try:
            yield Finding(what=name, state="good", found=metadata.version(name))
        except metadata.PackageNotFoundError:
            yield Finding(
                what=name,
                state="note",
                found=f"not installed: no {use}",
                remedy=f'pip install "nearlift[{extra}]"',
            )


def _plug_ins() -> Iterator[Finding]:
    """Declarations of other packages; a broken one is refused at import and would end every
    command.
    """
    from nearlift import catalogue
    from nearlift.errors import NearliftError

    try:
        models, effects = len(catalogue.models()), len(catalogue.effects())
    except NearliftError as fault:
        yield Finding(
            what="plug-ins",
            state="bad",
            found=str(fault).splitlines()[0],
            remedy="mend or remove the package that declares it",
        )
        return
    yield Finding(what="catalogue", state="good", found=f"{models} models, {effects} effects")


def _machine() -> Iterator[Finding]:
    cores = os.cpu_count() or 1
    yield Finding(
        what="processors",
        state="good",
        found=f"{cores}: --executor threads:{cores} for one campaign, processes:{cores} for many",
    )
    threads = {name: os.environ[name] for name in blas.VARIABLES if name in os.environ}
    single = all(value == "1" for value in threads.values())
    yield Finding(
        what="BLAS threads",
        state="good" if single else "note",
        found=", ".join(f"{name}={value}" for name, value in threads.items())
        or "left to the library",
        remedy=(
            "set them to 1: small fits are slowed down many times by threads that wait for each"
            " other"
        ),
    )
    entries = os.environ.get("PYTHONPATH", "")
    here = (
        [entry for entry in entries.split(os.pathsep) if not Path(entry).is_absolute()]
        if entries
        else []
    )
    yield Finding(
        what="PYTHONPATH",
        state="note" if here else "good",
        found=(
            f"{', '.join(map(repr, here))}: Python imports from the current folder"
            if here
            else "nothing is imported from the current folder"
        ),
        remedy=(
            "write whole paths, and no empty entry: whoever fills a folder of data could put code"
            " there"
        ),
    )
    kept = isolation.code_folder()
    yield Finding(
        what="compiled code",
        state="good" if kept else "note",
        found=(
            f"kept in {kept}"
            if kept
            else "not kept: there is no folder that only you can write, so every run compiles anew"
        ),
        remedy=(
            "delete ~/.cache/nearlift/code if its mode is not 0700 or it is not yours, or set"
            " XDG_CACHE_HOME to a folder of your own"
        ),
    )
    compiler = shutil.which("cc") or shutil.which("gcc")
    yield Finding(
        what="C compiler",
        state="good" if compiler else "note",
        found=compiler or "none",
        remedy="only for checking exported C headers",
    )


def _folder(out: Path) -> Iterator[Finding]:
    place = next(folder for folder in (out.absolute(), *out.absolute().parents) if folder.is_dir())
    try:
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as fault:
        yield Finding(
            what="output folder",
            state="bad",
            found=f"{place}: {fault.strerror}",
            remedy="say --out with a folder that may be written",
        )
        return
    free = shutil.disk_usage(place).free
    yield Finding(
        what="output folder",
        state="good" if free >= ENOUGH_DISK else "note",
        found=f"{place}, {free / 2**30:.1f} GiB free",
        remedy="products of a large campaign may need 1 GiB",
    )


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
