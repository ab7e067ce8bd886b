"""What the paper says of its Fig. 6, as numbers, beside what each preset gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

Levels = Mapping[tuple[str, float, float], float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """A statement: the paper's words, the number in them, how it is computed from levels, and when it holds."""

    name: str
    says: str
    paper: str
    value: Callable[[Levels], float]
    holds: Callable[[float], bool]


def _shift(levels: Levels, boundary: str, risk: float) -> float:
    """How much lower one may fly with the model than without."""
    return levels[boundary, 0.0, risk] - levels[boundary, 1.0, risk]


def _scaling(levels: Levels, boundary: str, risk: float) -> float:
    """How far the level moves from the power 0.6 to 1.4, with its sign."""
    return levels[boundary, 1.4, risk] - levels[boundary, 0.6, risk]


CLAIMS = (
    Claim(
        name="crashes_without_model",
        says="With no boundary model, crashes occur as high as this above ground (z_hat at 1 %)",
        paper="≈ 1.5",
        value=lambda v: v["ground", 0.0, 0.01],
        holds=lambda x: abs(x - 1.5) <= 0.15,
    ),
    Claim(
        name="closer_with_model",
        says="With a ground model the vehicle can be so much closer (rotor radii, at 50 %)",
        paper="≈ 0.5",
        value=lambda v: _shift(v, "ground", 0.5),
        holds=lambda x: 0.25 <= x <= 0.75,
    ),
    Claim(
        name="closer_with_model_rare",
        says="The same at 1 %",
        paper="≈ 0.5",
        value=lambda v: _shift(v, "ground", 0.01),
        holds=lambda x: 0.25 <= x <= 0.75,
    ),
    Claim(
        name="ceiling_crash",
        says="Likely to crash into the ceiling below this set-point (z_hat at 50 %)",
        paper="≈ 2",
        value=lambda v: v["ceiling", 1.0, 0.5],
        holds=lambda x: abs(x - 2.0) <= 0.15,
    ),
    Claim(
        name="ceiling_destabilises",
        says="The ceiling model makes crashes more likely: the 50 % level rises by so much (rotor radii)",
        paper="> 0",
        value=lambda v: -_shift(v, "ceiling", 0.5),
        holds=lambda x: x > 0,
    ),
    Claim(
        name="scaling_ground",
        says="Scaling the ground model by the powers 0.6 to 1.4 moves the 50 % level only slightly (rotor radii)",
        paper="slight",
        value=lambda v: _scaling(v, "ground", 0.5),
        holds=lambda x: abs(x) <= 0.1,
    ),
    Claim(
        name="scaling_ceiling",
        says="Scaling the ceiling model moves its 50 % level more (rotor radii)",
        paper="stronger",
        value=lambda v: _scaling(v, "ceiling", 0.5),
        holds=lambda x: abs(x) > 0.2,
    ),
    Claim(
        name="order_kept",
        says="More ground effect is safer: the 50 % level falls from the power 0.6 to 1.4, whatever gains and noise (change, rotor radii)",
        paper="< 0",
        value=lambda v: _scaling(v, "ground", 0.5),
        holds=lambda x: x < 0,
    ),
)


def table(presets: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A row for each claim that the risks flown allow to be computed, with a value and a verdict per preset."""
    levels = {
        name: {(b, e["exponent"], e["risk"]): e["value"] for b, own in p["boundaries"].items() for e in own["levels"]} for name, p in presets.items()
    }
    rows = []
    for claim in CLAIMS:
        try:
            values = {name: float(claim.value(own)) for name, own in levels.items()}
        except KeyError:
            continue
        rows.append(
            {
                "name": claim.name,
                "says": claim.says,
                "paper": claim.paper,
                "presets": {name: {"value": v, "holds": bool(claim.holds(v))} for name, v in values.items()},
            }
        )
    return rows
