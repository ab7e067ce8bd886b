"""Sources of uncertainty in the budget and beyond it: unstated inputs and undetected effects."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from nearlift import catalogue
from nearlift.declare import Boundary, Effect
from nearlift.report.evidence import Evidence
from nearlift.report.phrases import SCALES
from nearlift.results import Observations
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.outlook import SilentEffect
from nearlift.results.quotation import CoefficientResult
from nearlift.rounding import plain

#: Least relative fall of u for which a source is listed, and most sources listed.
LEAST_FALL, MOST_SOURCES = 0.05, 3
#: A source with fewer degrees of freedom than this is poorly determined.
LEAST_DOF = 2.0
#: Part of its signal above which an effect differs from the coefficient that absorbs it.
LEAST_VISIBLE = 1e-3

STATION = re.compile(r"stations below z_hat = ([\d.]+)(?: and beyond ([\d.]+))?")
BEYOND = re.compile(r"stations beyond z_hat = ([\d.]+)")


TITLES = {
    "rotor_radius": "rotor radius",
    "rotor_spacing": "rotor spacing",
    "height": "distance datum",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class PlausibleError:
    """The `shift` of the headline, also `in_u`, by a plausible error of an input without a stated
    uncertainty, in `unit`. `at_most`: a larger error would have been detected.
    """

    on: str
    size: float
    unit: str
    shift: float
    in_u: float
    at_most: bool

    @property
    def title(self) -> str:
        """The input in words."""
        return TITLES[self.on]

    @property
    def text(self) -> str:
        """Its size with its unit."""
        scale, unit = SCALES[self.unit]
        return f"{plain(scale * self.size, 2)} {unit}"


def leads(c: CoefficientResult) -> list[tuple[str, float]]:
    """The largest sources of a coefficient's uncertainty and u without each; poorly determined
    sources and a sole source are left out.
    """
    sources = [
        (line.source, line.u_without)
        for line in sorted(c.budget, key=lambda line: line.u_without)
        if line.u_without > 0
        and 1 - line.u_without / c.u >= LEAST_FALL
        and line.source not in badly_known(c)
    ]
    return sources[:MOST_SOURCES]


def badly_known(coefficient: CoefficientResult) -> list[str]:
    """Sources of a coefficient's uncertainty with under `LEAST_DOF` degrees of freedom."""
    return [line.source for line in coefficient.budget if line.dof < LEAST_DOF]


def undeclared(evidence: Evidence, boundary: Boundary) -> list[PlausibleError]:
    """Errors of the inputs without a stated uncertainty, the largest first."""
    quoted, diagnosis = evidence.quoted(boundary), evidence.diagnosed(boundary)
    u = quoted.coefficients[quoted.headline].u if quoted.headline else math.inf
    if not (u > 0 and math.isfinite(u)):
        return []
    errors = []
    for error in evidence.base(boundary)[1].undeclared:
        shift = abs(error.shift[quoted.headline])
        part = min(1.0, _undetected_shift(diagnosis, error.on, u) / shift) if shift else 0.0
        if part:
            errors.append(
                PlausibleError(
                    on=error.on,
                    size=part * error.size,
                    unit=error.unit,
                    shift=part * shift,
                    in_u=part * shift / u,
                    at_most=part < 1,
                )
            )
    return sorted(errors, key=lambda error: -error.in_u)


def _undetected_shift(diagnosis: BoundaryDiagnosis | None, on: str, u: float) -> float:
    """Largest undetected shift of the headline by an error of that input: `u` where the diagnosis
    lists none, infinite where it cannot test the input.
    """
    names = {e.name for e in catalogue.effects() if e.error_of == on}
    if (
        not names
        or diagnosis is None
        or diagnosis.verdict != "adequate"
        or names & {*diagnosis.untestable}
    ):
        return math.inf
    hidden = [s for s in diagnosis.silent if s.effect in names]
    if any(s.hidden for s in hidden):
        return math.inf
    return max((s.shift for s in hidden), default=u)


def is_the_coefficient(silent: SilentEffect) -> bool:
    """Whether an effect of the vehicle's physics is what a coefficient measures.

    The trials then show none of it besides the coefficient. For example, the strength of the images
    is k of Cheeseman-Bennett.
    """
    effect = catalogue.effect(silent.effect)
    # a quantity to log would distinguish it, as rpm does the held quantity
    distinct = effect.belongs_to == "bench" or bool(effect.log_next_time)
    return silent.share_visible < LEAST_VISIBLE and not distinct


def undetected(evidence: Evidence, boundary: Boundary) -> tuple[float, str] | None:
    """The largest shift of the headline by an undetected effect, and the effect; None where that is
    below u.
    """
    quoted, diagnosis = evidence.quoted(boundary), evidence.diagnosed(boundary)
    headline = quoted.coefficients.get(quoted.headline)
    silent = [s for s in diagnosis.silent if not is_the_coefficient(s)] if diagnosis else []
    if not (headline and silent):
        return None
    most = max(silent, key=lambda s: s.bias_at_detection_limit)
    return (most.shift, most.effect) if headline.u < most.shift < math.inf else None


def missing_for(effect: Effect, data: Observations) -> str:
    """Measurements that would identify an effect, without stations that the trials have already."""
    z_hat = data.z_hat[(data.z_hat > 0) & (data.z_hat < math.inf)]
    nearest, farthest = (float(z_hat.min()), float(z_hat.max())) if len(z_hat) else (math.inf, 0.0)

    def near(match: re.Match[str]) -> str:
        below = f"stations below z_hat = {match[1]}" if nearest >= float(match[1]) else ""
        beyond = match[2] and farthest <= float(match[2])
        far = f"{'beyond' if below else 'stations beyond z_hat ='} {match[2]}" if beyond else ""
        return " and ".join(filter(None, (below, far)))

    def far(match: re.Match[str]) -> str:
        return match[0] if farthest <= float(match[1]) else ""

    text = BEYOND.sub(far, STATION.sub(near, effect.separated_by))
    # what is left of a list whose item went
    parts = [p.strip() for p in re.split(r",\s+", text)]
    parts = [p.removesuffix(" and").removesuffix(" or").strip() for p in parts]
    return ", ".join(p for p in parts if p and p not in ("and", "or"))
