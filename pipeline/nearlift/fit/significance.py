"""Significance of a test and the interval of an estimate, in numbers and in words."""

from __future__ import annotations

import numpy as np

from nearlift.results.assumptions import CollapseTest

#: Significance level of every test of an assumption (convention).
REJECTS = 0.05
#: Probability below which scatter is so small that the assumed noise is suspect.
SUSPECT = 1e-3


def f_test(gain: float, extra: int, noise_dof: float) -> CollapseTest | None:
    """F test of a fall of chi2 by `gain` for `extra` unknowns; chi-square for known noise."""
    from scipy.stats import chi2, f

    if extra < 1:
        return None
    gain = max(gain, 0.0)
    p = chi2.sf(gain, extra) if np.isinf(noise_dof) else f.sf(gain / extra, extra, noise_dof)
    return CollapseTest(
        statistic=gain / extra,
        dof=(extra, float(noise_dof)),
        p_value=float(p),
        quiet=bool(p > 1 - SUSPECT),
    )


def chance(p: float) -> str:
    """A p-value as text: ``p = 0.31``, or ``p < 0.001``."""
    return f"p = {p:.2g}" if p >= 1e-3 else "p < 0.001"


def percent(x: float) -> str:
    """A fraction in per cent: two digits, and whole numbers from ten on."""
    return f"{100 * x:.0f}" if x >= 0.1 else f"{100 * x:.2g}"
