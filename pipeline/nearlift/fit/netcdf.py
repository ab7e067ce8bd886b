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
from nearlift.declare import BOUNDARIES
from nearlift.errors import InputRefused
from nearlift.results.fit import FitResults
from nearlift.results.posterior import LEVEL, split_level

Table = Mapping[str, NDArray[Any]]
FILE = "posterior.nc"
#: Of the draws, as attributes.
DIAGNOSTICS = ("ess", "tau", "acceptance", "noise_dof")


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
        for boundary in (b for b in BOUNDARIES if b in fits.boundaries):
            base = fits.base[boundary]
            for model in (base, *(m for m in fits.boundaries[boundary] if m != base)):
                mine = (draws["boundary"] == boundary) & (draws["model"] == model)
                if not mine.any():
                    continue
                chosen = {name: column[mine] for name, column in draws.items()}
                summary = fits.boundaries[boundary][model].posterior
                assert summary is not None
                known = ((name, getattr(summary, name)) for name in DIAGNOSTICS)
                notes = {
                    **about,
                    "boundary": boundary,
                    "model": model,
                    "sampler": summary.sampler,
                    **{n: float(x) for n, x in known if x is not None and math.isfinite(x)},
                }
                _model(file.create_group(f"{boundary}/{model}"), model, chosen, notes)
                if "posterior" not in file:
                    _model(file, model, chosen, notes)
    return sink.getvalue()


def _model(group: Any, model: str, draws: Table, notes: Mapping[str, object]) -> None:
    """Groups `posterior` and `sample_stats` of one model."""
    chains, length = int(draws["chain"].max()) + 1, int(draws["draw"].max()) + 1
    group.attrs.update(notes)
    posterior, stats = (
        _group(group, name, chains, length, notes) for name in ("posterior", "sample_stats")
    )
    by_name = {
        n: draws["value"][draws["parameter"] == n].reshape(chains, length)
        for n in dict.fromkeys(draws["parameter"].tolist())
    }
    declared = catalogue.model(model)
    levels = {split_level(n): values for n, values in by_name.items() if n.startswith(LEVEL)}
    for name, values in by_name.items():
        if name.startswith(LEVEL):
            continue
        variable = posterior.create_variable(name, ("chain", "draw"), data=values)
        parameter = declared.parameter(name)
        variable.attrs.update(
            {"units": parameter.unit, "long_name": parameter.meaning, "prior": str(parameter.prior)}
        )
    if levels:
        posterior.dimensions["throttle"] = len(levels)
        posterior.create_variable("throttle", ("throttle",), data=np.array(list(levels)))
        variable = posterior.create_variable(
            LEVEL, ("chain", "draw", "throttle"), data=np.stack(list(levels.values()), axis=-1)
        )
        variable.attrs.update({"units": "N", "long_name": "lift far from the boundary"})
    first = draws["parameter"] == draws["parameter"][0]
    stats.create_variable(
        "lp", ("chain", "draw"), data=draws["log_prob"][first].reshape(chains, length)
    )


def _group(parent: Any, name: str, chains: int, length: int, notes: Mapping[str, object]) -> Any:
    group = parent.create_group(name)
    group.attrs.update(notes)
    group.dimensions = {"chain": chains, "draw": length}
    group.create_variable("chain", ("chain",), data=np.arange(chains))
    group.create_variable("draw", ("draw",), data=np.arange(length))
    return group
