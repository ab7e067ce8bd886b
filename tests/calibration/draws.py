"""Which campaign a seed stands for: kinds of campaigns, and how their effects are drawn."""

from __future__ import annotations

import contextlib

import numpy as np
from tests.calibration import forms
from tests.calibration.bench import stream
from tests.calibration.simulator import Campaign, Spec, Unreachable, simulate

KINDS = ("null", "weak", "one", "two", "outside", "within")
REPORTED = 600_000  # seeds from here on are for reporting; tune on others
STRONG = 0.4
LEAST_BESIDE = 0.1  # what the weaker of two effects must keep beside the other; below, nothing could part them


def draw(kind: str, boundary: str, seed: int) -> Campaign:
    """The campaign of a seed: which effect, how strong, on which design. Effects that the bench cannot show are drawn anew.

    A seed means another bench and other noise for every kind and boundary, so that all rows are independent.
    """
    rng = stream(seed, "draw", kind, boundary)
    own = int(rng.integers(2**40))
    # three boundaries take three seeds in turn, so the seed's thirds decide what must not hang on the boundary
    common = {
        "boundary": boundary,
        "design": str(rng.choice(["from_one", "percent_diameter", "mm"], p=[0.5, 0.35, 0.15])),
        "realism": bool(seed // 3 % 2),
    }
    foreign = seed // 3 % 3 == 2
    if kind == "null":
        return simulate(Spec(**common), own)
    if kind == "within":
        return simulate(Spec(**common, sink=float(np.exp(rng.uniform(np.log(0.002), np.log(0.02)))), foreign=foreign), own)
    if kind == "outside":
        low, high = (0.2, STRONG) if rng.random() < 0.5 else (STRONG, 1.0)
        return simulate(Spec(**common, effects=((str(rng.choice(list(forms.UNNAMED))), float(rng.uniform(low, high))),)), own)
    names = [str(n) for n in rng.permutation(forms.names(boundary))]
    if kind == "two":
        pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
        for i in rng.permutation(len(pairs)):
            rho = float(rng.uniform(0.2, STRONG))
            with contextlib.suppress(Unreachable):
                first, second = pairs[i]
                campaign = simulate(Spec(**common, effects=((first, rho), (second, rho * float(rng.uniform(1, 2)))), foreign=foreign), own)
                if min(campaign.truth.rho_beside.values()) >= LEAST_BESIDE:
                    return campaign
        raise Unreachable("any pair", 0.2, 0.0)
    low, high = {"weak": (0.1, 0.2), "one": (0.2, 1.2)}[kind]
    for name in names:
        try:
            return simulate(Spec(**common, effects=((name, _between(rng, low, high)),), foreign=foreign), own)
        except Unreachable as limit:
            if limit.most > 1.1 * low:
                return simulate(Spec(**common, effects=((name, _between(rng, low, min(high, limit.most))),), foreign=foreign), own)
    raise Unreachable("any effect", low, 0.0)


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
