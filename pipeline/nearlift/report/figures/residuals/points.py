"""What stands behind each dot and each mean of the residuals: the trial, its counts, its
uncertainty, its quality; sums from which means follow.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import nomenclature
from nearlift.declare import Boundary
from nearlift.errors import UsageError
from nearlift.products import TRIALS
from nearlift.report.evidence import Columns, Evidence, stack, text_column
from nearlift.report.figures.fig2.points import force_unit, throttle_key
from nearlift.report.figures.residuals.table import bins, covariates, ordered, residuals
from nearlift.rounding import fixed, plain, plus_minus

#: More dots than this are drawn in part, evenly in run order; means are always of all trials.
DRAWN = 1000
WORDS = {
    "z_hat": "distance ẑ",
    "throttle_percent": "throttle (%)",
    "run_order": "run order",
    "session": "session, in order",
}


def word(covariate: str) -> str:
    """A covariate with its unit, as a screen shows it."""
    if covariate in WORDS:
        return WORDS[covariate]
    try:
        unit = nomenclature.symbol(covariate).unit
    except UsageError:
        return covariate.replace("_", " ")
    name = covariate.split("_")[0]
    return name if unit in ("", "1") else f"{name} ({unit})"


def every_covariate(evidence: Evidence) -> list[str]:
    """Those that vary near some boundary, in the order of the figure."""
    return ordered(
        dict.fromkeys(
            name for b in evidence.boundaries for name in covariates(residuals(evidence, b)[0])
        )
    )


def dots(evidence: Evidence, boundary: Boundary) -> tuple[Columns, Columns, int]:
    """Accepted trials, a row each, and how many there are.

    Returns
    -------
    dict of arrays
        `trial`, `throttle` (key), `residual` (percent), and as text `label` (throttle), `at`,
        `residual_text`, `lift`, `samples`, `session`, `quality`.
    dict of arrays
        The covariates that vary here, of the same rows.
    int
        Trials that the base model speaks about, drawn or not.
    """
    data, residual, sigma = residuals(evidence, boundary)
    table = evidence.table(TRIALS)
    row = {str(t): i for i, t in enumerate(table["trial"])}
    scale, unit = force_unit(evidence)
    keep = (
        np.unique(np.linspace(0, data.n - 1, min(data.n, DRAWN)).round().astype(int))
        if data.n
        else np.zeros(0, dtype=int)
    )
    kept: list[dict[str, object]] = []
    throttles = data.levels[data.level]
    for i in keep.tolist():
        j = row[str(data.trial[i])]
        z = float(data.z_hat[i])
        kept.append(
            {
                "trial": str(data.trial[i]),
                "throttle": throttle_key(float(throttles[i])),
                "residual": 100 * float(residual[i]),
                "label": f"{100 * data.throttle[i]:.3g} %",
                "at": (
                    f"{plain(z)} ({plain(1e3 * z * data.radius_m, 3)} mm)"
                    if np.isfinite(z)
                    else "free air"
                ),
                "residual_text": (
                    f"{fixed(100 * float(residual[i]), 2)} %, where ± {100 * float(sigma[i]):.2f} %"
                    " is expected"
                ),
                "lift": (
                    f"{plus_minus(scale * float(data.lift_N[i]), scale * float(data.u_lift_N[i]))}"
                    f" {unit}"
                ),
                "samples": _samples(int(table["n"][j]), float(table["n_eff"][j])),
                "session": str(table["session"][j]) if "session" in table else "not recorded",
                "quality": str(table["quality"][j]) or "good",
            }
        )
    return stack(kept), {name: x[keep] for name, x in covariates(data).items()}, data.n


def _samples(n: int, effective: float) -> str:
    return f"{n}, of which {plain(effective, 2)} independent" if n > 1 else "one mean, as published"


def sums(evidence: Evidence, boundary: Boundary, *, by_throttle: bool = True) -> Columns:
    """Sums over the trials of each bin and throttle, from which the means of any choice of
    throttles follow.

    Returns
    -------
    dict of arrays
        `covariate`, `bin`, `throttle` (key; ``all`` unless `by_throttle`), `n`, and in percent the
        sums `x`, `r`, `rr` (of squares), `vv` (of variances in the noise model). The bins are those
        of the printed figure.
    """
    data, residual, sigma = residuals(evidence, boundary)
    keys = (
        np.array([throttle_key(float(t)) for t in data.levels[data.level]], dtype=object)
        if by_throttle
        else text_column("all", data.n)
    )
    return stack(
        [_sums(name, x, 100 * residual, 100 * sigma, keys) for name, x in covariates(data).items()]
    )


def _sums(
    name: str, x: NDArray[Any], residual: NDArray[Any], sigma: NDArray[Any], throttle: NDArray[Any]
) -> dict[str, object]:
    keep = np.isfinite(x) & np.isfinite(residual)
    x, residual, sigma = x[keep], residual[keep], sigma[keep]
    keys, which = np.unique(throttle[keep].astype(str), return_inverse=True)
    label = bins(x)
    group, index = np.unique(label * len(keys) + which, return_inverse=True)
    return {
        "covariate": name,
        "bin": group // len(keys),
        "throttle": keys[group % len(keys)].astype(object),
        "n": np.bincount(index),
        "x": np.bincount(index, x),
        "r": np.bincount(index, residual),
        "rr": np.bincount(index, residual**2),
        "vv": np.bincount(index, sigma**2),
    }
