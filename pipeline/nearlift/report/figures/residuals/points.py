"""Trial of each dot of the residuals, with its counts, uncertainty and quality; sums of means."""

from __future__ import annotations

import numpy as np

from nearlift import nomenclature
from nearlift.declare import Boundary
from nearlift.errors import UsageError
from nearlift.report.evidence import Columns, Evidence, stack
from nearlift.report.figures.fig2.points import force_unit, throttle_key
from nearlift.report.figures.residuals.table import bins, covariates, ordered, residuals
from nearlift.rounding import fixed, plain, plus_minus
from nearlift.stages.ingest import TRIALS

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
    """Covariates that vary near some boundary, in the order of the figure."""
    varying = (covariates(residuals(evidence, b)[0]) for b in evidence.boundaries)
    return ordered(dict.fromkeys(name for names in varying for name in names))


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
    keep = np.unique(np.linspace(0, data.n - 1, min(data.n, DRAWN)).round().astype(int))
    kept: list[dict[str, object]] = []
    throttles = data.levels[data.level]
    for i in keep.tolist():
        trial, z = str(data.trial[i]), float(data.z_hat[i])
        j = row[trial]
        percent, expected = 100 * float(residual[i]), 100 * float(sigma[i])
        lift = plus_minus(scale * float(data.lift_N[i]), scale * float(data.u_lift_N[i]))
        n, effective = int(table["n"][j]), plain(float(table["n_eff"][j]), 2)
        mm = plain(1e3 * z * data.radius_m, 3)
        kept.append(
            {
                "trial": trial,
                "throttle": throttle_key(float(throttles[i])),
                "residual": percent,
                "label": f"{100 * data.throttle[i]:.3g} %",
                "at": f"{plain(z)} ({mm} mm)" if np.isfinite(z) else "free air",
                "residual_text": f"{fixed(percent, 2)} %, where ± {expected:.2f} % is expected",
                "lift": f"{lift} {unit}",
                "samples": f"{n}, of which {effective} independent"
                if n > 1
                else "one mean, as published",
                "session": str(table["session"][j]) if "session" in table else "not recorded",
                "quality": str(table["quality"][j]) or "good",
            }
        )
    return stack(kept), {name: x[keep] for name, x in covariates(data).items()}, data.n


def sums(evidence: Evidence, boundary: Boundary, *, by_throttle: bool) -> Columns:
    """Sums over the trials of each bin and throttle, from which the means of any choice of
    throttles follow: `covariate`, `bin`, `throttle` (key; ``all`` unless `by_throttle`), `n`, and
    in percent the sums `x`, `r`, `rr` (of squares), `vv` (of variances in the noise model). The
    bins are those of the printed figure.
    """
    data, residual, sigma = residuals(evidence, boundary)
    throttles = data.levels[data.level].tolist()
    keys = np.array([throttle_key(t) if by_throttle else "all" for t in throttles])
    parts = []
    for name, x in covariates(data).items():
        keep = np.isfinite(x) & np.isfinite(residual)
        r, sd = 100 * residual[keep], 100 * sigma[keep]
        known, which = np.unique(keys[keep], return_inverse=True)
        group, index = np.unique(bins(x[keep]) * len(known) + which, return_inverse=True)
        parts.append(
            {
                "covariate": name,
                "bin": group // len(known),
                "throttle": known[group % len(known)].astype(object),
                "n": np.bincount(index),
                "x": np.bincount(index, x[keep]),
                "r": np.bincount(index, r),
                "rr": np.bincount(index, r**2),
                "vv": np.bincount(index, sd**2),
            }
        )
    return stack(parts)
