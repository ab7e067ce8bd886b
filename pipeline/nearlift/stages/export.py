"""export: what was fitted, in forms that other programs read. A new format is one more entry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from nearlift.run.job import Job
from nearlift.stages import controller, netcdf


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """One form of export: its name on the command line, what it is, and what writes it and returns
    the path.
    """

    name: str
    meaning: str
    write: Callable[[Job], str]


FORMATS = (
    Format(
        name="netcdf",
        meaning="posterior.nc: draws of every model, for ArviZ and xarray",
        write=netcdf.write,
    ),
    Format(
        name="c",
        meaning="export/lift_model.h: a C99 header for firmware, floats only",
        write=controller.write_c,
    ),
    Format(
        name="document",
        meaning="export/lift_model.json, and its JSON Schema",
        write=controller.write_json,
    ),
    Format(
        name="python",
        meaning="export/lift_model.py: a module that needs nothing but Python",
        write=controller.write_python,
    ),
    Format(
        name="casadi",
        meaning="export/lift_model_casadi.py: a module of CasADi expressions",
        write=controller.write_casadi,
    ),
)


def export(job: Job, names: tuple[str, ...]) -> list[str]:
    """Write these formats; returns the paths."""
    return [f.write(job) for f in FORMATS if f.name in names]
