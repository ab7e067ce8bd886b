"""Claims of the paper on its Fig. 6 as numbers with intervals, judged under each preset.

A claim is a number computed from levels (set-points of a given risk), and a range within which it
holds. All levels of a preset come from one bootstrap of the same flights, so the interval of a
difference is that of paired flights. A claim holds where its 90 % interval lies within the range,
fails where it lies outside, and is undecided otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from nearlift.declare import FloatArray
from nearlift.flight.simulation.crash_rate import spread90

INF = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class CrashLevels:
    """Levels of one preset under resampling: arrays (m,), the first as flown; nan where the
    set-points flown do not hold the level. With the preset's own gains and noise by (boundary,
    exponent, risk), and with others, at a risk of 50 %, by (boundary, exponent, variant).
    """

    flown: dict[tuple[str, float, float], FloatArray] = field(default_factory=dict)
    varied: dict[tuple[str, float, str], FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperClaim:
    """A claim: statement, the paper's number, computation from levels, range where it holds."""

    name: str
    says: str
    paper: str
    value: Callable[[CrashLevels], FloatArray]
    holds: tuple[float, float]

    @property
    def tolerance(self) -> str:
        """The range in words."""
        low, high = self.holds
        if math.isinf(high):
            return f"above {low:g}"
        return f"below {high:g}" if math.isinf(low) else f"{low:g} to {high:g}"


def _apart(
    levels: CrashLevels, boundary: str, one: float, other: float, risk: float = 0.5
) -> FloatArray:
    """Level of one power of the model less that of another; 0 is no model."""
    return levels.flown[boundary, one, risk] - levels.flown[boundary, other, risk]


def _worst(levels: CrashLevels, boundary: str, one: float, other: float) -> FloatArray:
    """Least difference of the 50 % levels of two powers over all gains and noises flown, the
    preset's own included.
    """
    if not levels.varied:
        raise KeyError("variants")
    apart = [_apart(levels, boundary, one, other)]
    apart += [
        levels.varied[boundary, one, variant] - levels.varied[boundary, other, variant]
        for variant in dict.fromkeys(variant for _, _, variant in levels.varied)
    ]
    return np.asarray(np.min(apart, axis=0), dtype=np.float64)


CLAIMS = (
    PaperClaim(
        name="crashes_without_model",
        says="With no boundary model, crashes occur as high as this above ground (z_hat at 1 %)",
        paper="≈ 1.5",
        value=lambda v: v.flown["ground", 0.0, 0.01],
        holds=(1.35, 1.65),
    ),
    PaperClaim(
        name="closer_with_model",
        says="With a ground model the vehicle can be so much closer (rotor radii, at 50 %)",
        paper="≈ 0.5",
        value=lambda v: _apart(v, "ground", 0.0, 1.0),
        holds=(0.25, 0.75),
    ),
    PaperClaim(
        name="closer_with_model_rare",
        says="The same at 1 %",
        paper="≈ 0.5",
        value=lambda v: _apart(v, "ground", 0.0, 1.0, 0.01),
        holds=(0.25, 0.75),
    ),
    PaperClaim(
        name="ceiling_crash",
        says="Likely to crash into the ceiling below this set-point (z_hat at 50 %)",
        paper="≈ 2",
        value=lambda v: v.flown["ceiling", 1.0, 0.5],
        holds=(1.85, 2.15),
    ),
    PaperClaim(
        name="ceiling_destabilises",
        says=(
            "The ceiling model makes crashes more likely: the 50 % level rises by so much (rotor"
            " radii)"
        ),
        paper="> 0",
        value=lambda v: -_apart(v, "ceiling", 0.0, 1.0),
        holds=(0.0, INF),
    ),
    PaperClaim(
        name="scaling_ground",
        says=(
            "Scaling the ground model by the powers 0.6 to 1.4 moves the 50 % level only slightly"
            " (rotor radii)"
        ),
        paper="slight",
        value=lambda v: _apart(v, "ground", 1.4, 0.6),
        holds=(-0.1, 0.1),
    ),
    PaperClaim(
        name="scaling_ceiling",
        says=(
            "Scaling the ceiling model moves its 50 % level further than the ground's (by so many"
            " rotor radii)"
        ),
        paper="stronger",
        value=lambda v: (
            np.abs(_apart(v, "ceiling", 1.4, 0.6)) - np.abs(_apart(v, "ground", 1.4, 0.6))
        ),
        holds=(0.0, INF),
    ),
    PaperClaim(
        name="order_kept",
        says=(
            "More ground effect is safer: the 50 % level falls from the power 0.6 to 1.4, whatever"
            " gains and noise (least fall of all, rotor radii)"
        ),
        paper="> 0",
        value=lambda v: _worst(v, "ground", 0.6, 1.4),
        holds=(0.0, INF),
    ),
    PaperClaim(
        name="ground_helps_anywhere",
        says=(
            "The ground model lets the vehicle closer whatever gains and noise (least gain of all"
            " at 50 %, rotor radii)"
        ),
        paper="> 0",
        value=lambda v: _worst(v, "ground", 0.0, 1.0),
        holds=(0.0, INF),
    ),
    PaperClaim(
        name="ceiling_hurts_anywhere",
        says=(
            "The ceiling model makes crashes more likely whatever gains and noise (least rise of"
            " all at 50 %, rotor radii)"
        ),
        paper="> 0",
        value=lambda v: _worst(v, "ceiling", 1.0, 0.0),
        holds=(0.0, INF),
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedNumber:
    """A claim's number under one preset, and its verdict."""

    value: float
    lo90: float
    hi90: float
    verdict: str


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedClaim:
    """A claim with its number and verdict under each preset."""

    name: str
    says: str
    paper: str
    tolerance: str
    presets: Mapping[str, JudgedNumber]


def judge(presets: Mapping[str, CrashLevels]) -> tuple[JudgedClaim, ...]:
    """Verdicts on the claims that the risks flown allow to be computed."""
    judged = []
    for claim in CLAIMS:
        try:
            values = {name: claim.value(levels) for name, levels in presets.items()}
        except KeyError:
            continue
        judged.append(
            JudgedClaim(
                name=claim.name,
                says=claim.says,
                paper=claim.paper,
                tolerance=claim.tolerance,
                presets={name: _judged(v, claim.holds) for name, v in values.items()},
            )
        )
    return tuple(judged)


def _judged(values: FloatArray, holds: tuple[float, float]) -> JudgedNumber:
    # nan, where the set-points do not hold the level, leaves that end of the interval open, and any
    # comparison with it is false
    low, high = -spread90(-values)[1], spread90(values)[1]
    verdict = "undecided"
    if holds[0] <= low and high <= holds[1]:
        verdict = "holds"
    elif math.isfinite(low) and math.isfinite(high) and (high < holds[0] or low > holds[1]):
        verdict = "fails"
    return JudgedNumber(value=float(values[0]), lo90=low, hi90=high, verdict=verdict)
