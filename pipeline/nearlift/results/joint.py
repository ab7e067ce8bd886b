"""joint.json: base models fitted to lift and downwash together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from nearlift.declare import Boundary
from nearlift.results.estimate import Estimate
from nearlift.results.fit import ParameterCovariance


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOutCase:
    """A case whose downwash does not stand for the inflow at the disk, and why."""

    case: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryJointFit:
    """One boundary's fit to both; `lift_alone` are its parameters without the downwash, `p_value`
    that of the two agreeing.
    """

    model: str
    title: str
    parameters: Mapping[str, Estimate]
    lift_alone: Mapping[str, Estimate]
    covariance: ParameterCovariance
    chi2_lift: float
    chi2_downwash: float
    n_downwash: int
    p_value: float
    used: tuple[str, ...]
    left_out: tuple[LeftOutCase, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class JointResults:
    """The whole file."""

    file: ClassVar[str] = "joint.json"

    schema: str = "nearlift.joint/1"
    boundaries: Mapping[Boundary, BoundaryJointFit]
