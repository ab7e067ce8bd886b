"""export: what was fitted, in forms that other programs read. A new format is one more entry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from nearlift.stages import netcdf
from nearlift.stages.job import Job


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """One form of export: its name on the command line, what it is, and what writes it and returns the path."""

    name: str
    meaning: str
    write: Callable[[Job], str]


FORMATS = (Format(name="netcdf", meaning="posterior.nc: draws of every model, for ArviZ and xarray", write=netcdf.write),)


def export(job: Job, names: tuple[str, ...]) -> list[str]:
    """Write these formats; returns the paths."""
    return [f.write(job) for f in FORMATS if f.name in names]
