"""posterior.nc: the draws as ArviZ's InferenceData, by ArviZ.

Every model of every boundary has a group, such as ``/ground/sanchez_cuevas``. In it `posterior`
holds each parameter by chain and draw, and L_inf by throttle; `sample_stats` the densities. The
first boundary's base model is in the root too, for readers that name no group.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import catalogue
from nearlift.errors import InputRefused
from nearlift.results.fit import LEVEL, FitResults, PosteriorSummary, split_level

Table = Mapping[str, NDArray[Any]]
FILE = "posterior.nc"


def content(draws: Table, fits: FitResults, about: Mapping[str, str]) -> bytes:
    """Draws of all models as a file, with attributes `about`.

    Raises
    ------
    InputRefused
        ArviZ is not installed.
    """
    groups = list[tuple[str, Any]]()
    for boundary, models in fits.boundaries.items():
        for model, entry in models.items():
            mine = (draws["boundary"] == boundary) & (draws["model"] == model)
            if entry.posterior and mine.any():
                notes = {**about, "boundary": boundary, "model": model}
                notes |= _diagnostics(entry.posterior)
                data = _inference_data(model, {k: x[mine] for k, x in draws.items()}, notes)
                groups += [("/", data)] if not groups else []
                groups.append((f"{boundary}/{model}", data))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / FILE
        for group, data in groups:
            data.to_netcdf(str(path), base_group=group, overwrite_existing=group == "/")
        return path.read_bytes()


def _diagnostics(summary: PosteriorSummary) -> dict[str, Any]:
    """The sampler's diagnostics that have a value."""
    names = ("sampler", "ess", "tau", "acceptance", "noise_dof")
    values = {name: getattr(summary, name) for name in names}
    return {k: x for k, x in values.items() if isinstance(x, str) or math.isfinite(x or math.nan)}


def _inference_data(model: str, draws: Table, notes: Mapping[str, Any]) -> Any:
    """One model's draws as InferenceData, with `notes` as attributes of its groups."""
    try:
        import arviz
    except ImportError:
        raise InputRefused(
            FILE,
            "needs the package arviz, which is not installed",
            "pip install 'nearlift[arviz]'",
        ) from None
    shape = int(draws["chain"].max()) + 1, int(draws["draw"].max()) + 1
    posterior, levels = dict[str, NDArray[Any]](), dict[float, NDArray[Any]]()
    for name in dict.fromkeys(draws["parameter"].tolist()):
        values = draws["value"][draws["parameter"] == name].reshape(shape)
        if name.startswith(LEVEL):
            levels[split_level(name)] = values
        else:
            posterior[name] = values
    if levels:
        posterior[LEVEL] = np.stack(list(levels.values()), axis=-1)
    first = draws["parameter"] == draws["parameter"][0]
    data = arviz.from_dict(
        posterior=posterior,
        sample_stats={"lp": draws["log_prob"][first].reshape(shape)},
        coords={"throttle": list(levels)},
        dims={LEVEL: ["throttle"]},
    )
    for group in data.groups():
        # ArviZ adds the time of day, and the file would differ each time
        data[group].attrs = dict(notes)
    for name, variable in data.posterior.data_vars.items():
        if name == LEVEL:
            variable.attrs = {"units": "N", "long_name": "lift far from the boundary"}
        else:
            p = catalogue.model(model).parameter(str(name))
            variable.attrs = {"units": p.unit, "long_name": p.meaning, "prior": str(p.prior)}
    return data
