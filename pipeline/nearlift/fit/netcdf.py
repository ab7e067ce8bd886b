"""posterior.nc: the draws as netCDF-4, laid out as ArviZ wants them.

Every model of every boundary has a group, such as ``/ground/sanchez_cuevas``. In it `posterior`
holds each parameter by chain and draw, and L_inf by throttle; `sample_stats` the densities. The
first boundary's base model is in the root too, for readers that name no group.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import catalogue
from nearlift.errors import InputRefused
from nearlift.results.fit import LEVEL, FitResults, split_level

Table = Mapping[str, NDArray[Any]]
#: A variable: its dimensions, values and attributes.
Variable = tuple[tuple[str, ...], NDArray[Any], dict[str, str]]
FILE = "posterior.nc"


def content(draws: Table, fits: FitResults, about: Mapping[str, str]) -> bytes:
    """Draws of all models as a file, with attributes `about`.

    Raises
    ------
    InputRefused
        h5netcdf is not installed.
    """
    try:
        import h5netcdf
    except ImportError:
        raise InputRefused(
            FILE,
            "needs the package h5netcdf, which is not installed",
            "pip install 'nearlift[netcdf]'",
        ) from None
    sink = io.BytesIO()
    with h5netcdf.File(sink, "w") as file:
        for boundary, models in fits.boundaries.items():
            for model, entry in models.items():
                mine = (draws["boundary"] == boundary) & (draws["model"] == model)
                if (summary := entry.posterior) is None or not mine.any():
                    continue
                names = ("sampler", "ess", "tau", "acceptance", "noise_dof")
                diagnostics = {name: getattr(summary, name) for name in names}
                notes: dict[str, object] = {**about, "boundary": boundary, "model": model}
                notes |= {
                    name: x if isinstance(x, str) else float(x)
                    for name, x in diagnostics.items()
                    if isinstance(x, str) or (x is not None and math.isfinite(x))
                }
                groups = _groups(model, {name: x[mine] for name, x in draws.items()})
                _write(file.create_group(f"{boundary}/{model}"), groups, notes)
                if "posterior" not in file:
                    _write(file, groups, notes)
    return sink.getvalue()


def _groups(model: str, draws: Table) -> dict[str, dict[str, Variable]]:
    """Variables of the groups `posterior` and `sample_stats` of one model."""
    dims = ("chain", "draw")
    shape = tuple(int(draws[dim].max()) + 1 for dim in dims)
    index: dict[str, Variable] = {
        dim: ((dim,), np.arange(size), {}) for dim, size in zip(dims, shape, strict=True)
    }
    first = draws["parameter"] == draws["parameter"][0]
    stats = index | {"lp": (dims, draws["log_prob"][first].reshape(shape), {})}
    posterior, levels = dict(index), dict[float, NDArray[Any]]()
    for name in dict.fromkeys(draws["parameter"].tolist()):
        values = draws["value"][draws["parameter"] == name].reshape(shape)
        if name.startswith(LEVEL):
            levels[split_level(name)] = values
            continue
        p = catalogue.model(model).parameter(name)
        notes = {"units": p.unit, "long_name": p.meaning, "prior": str(p.prior)}
        posterior[name] = (dims, values, notes)
    if levels:
        notes = {"units": "N", "long_name": "lift far from the boundary"}
        posterior["throttle"] = (("throttle",), np.array(list(levels)), {})
        posterior[LEVEL] = ((*dims, "throttle"), np.stack(list(levels.values()), axis=-1), notes)
    return {"posterior": posterior, "sample_stats": stats}


def _write(
    parent: Any, groups: dict[str, dict[str, Variable]], notes: Mapping[str, object]
) -> None:
    parent.attrs.update(notes)
    for name, variables in groups.items():
        group = parent.create_group(name)
        group.attrs.update(notes)
        group.dimensions = {
            dims[0]: len(values) for dims, values, _ in variables.values() if len(dims) == 1
        }
        for variable, (dims, values, attributes) in variables.items():
            group.create_variable(variable, dims, data=values).attrs.update(attributes)
