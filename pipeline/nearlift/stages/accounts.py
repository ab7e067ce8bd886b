"""What fit.json says of a fit's uncertainty: its profiles, what would halve it, and how the models
compare.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from nearlift.fit import gum, inputs, remedies
from nearlift.fit.least_squares import Fit
from nearlift.fit.predictive import HeldOut, score
from nearlift.fit.profiles import LEVELS, Profile
from nearlift.products import PROFILES
from nearlift.run.store import Table


def entry(fit: Fit, profiled: Sequence[Profile]) -> dict[str, Any]:
    """One model's further keys in fit.json."""
    marginal = fit.marginal
    offset = (
        dict(zip(("value", "u"), marginal.offset(), strict=True)) | {"unit": "m"}
        if marginal
        else None
    )
    return {
        "profiles": {p.parameter: _profile(p) for p in profiled},
        "would_halve": _would_halve(fit),
        "undeclared": [
            {
                "on": u.on,
                "size": u.size,
                "unit": gum.UNITS[u.on],
                "shift": dict(zip(fit.names, u.shift, strict=True)),
            }
            for u in inputs.undeclared(fit)
        ],
        "heights": [asdict(m) for m in fit.plan.measures],
        **({"height_error": offset} if offset else {}),
    }


def _profile(profile: Profile) -> dict[str, Any]:
    ends = {
        f"{end}{level}": x
        for level in LEVELS
        for end, x in (("lo", profile.intervals[level].low), ("hi", profile.intervals[level].high))
    }
    return ends | {
        "open": {
            str(level): list(profile.intervals[level].open)
            for level in LEVELS
            if profile.intervals[level].open
        },
        "skew": profile.skew,
    }


def _would_halve(fit: Fit) -> dict[str, Any]:
    knowledge, repeats = remedies.of(fit)
    return {
        r.coefficient: {
            "knowledge": [
                {k: v for k, v in asdict(a).items() if k != "coefficient"}
                for a in knowledge
                if a.coefficient == r.coefficient
            ],
            "repeats": {k: v for k, v in asdict(r).items() if k != "coefficient"},
        }
        for r in repeats
    }


def profile_rows(boundary: str, fit: Fit, profiled: Sequence[Profile]) -> list[Mapping[str, Any]]:
    """One table for each coefficient."""
    same = {"boundary": boundary, "model": fit.model.name}
    return [
        {
            k: np.full(len(p.value), v, dtype=object)
            for k, v in (same | {"parameter": p.parameter}).items()
        }
        | {"value": p.value, "rise": p.rise, "quadratic": p.quadratic}
        for p in profiled
    ]


def profile_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """All profiles, one below the other."""
    empty = {
        c.name: np.zeros(0, dtype=object if c.kind == "text" else float) for c in PROFILES.columns
    }
    return {name: np.concatenate([none, *(r[name] for r in rows)]) for name, none in empty.items()}


def comparison(
    base: str, fits: Mapping[str, Any], held_out: Mapping[str, HeldOut]
) -> dict[str, Any]:
    """How the models of one boundary compare, each against the base."""
    reference = held_out[base]
    return {
        "blocks": "visits",
        "reference": base,
        "models": {
            name: asdict(score(own, reference))
            | {"aic": fits[name]["aic"], "bic": fits[name]["bic"], "r2": fits[name]["r2"]}
            for name, own in held_out.items()
        },
    }
