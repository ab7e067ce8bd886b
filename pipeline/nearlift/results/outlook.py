"""What trials could not show, or could not if they were run as planned, and what to measure next:
blocks of diagnosis.json and of a design's outlook.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class UntestableEffect:
    """An effect that nothing can be said of, what it needs, and what to log next time."""

    effect: str
    needs: tuple[str, ...]
    log_next_time: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionLimit:
    """The size of an effect that would have shown; None where none that is possible would."""

    effect: str
    parameter: str
    unit: str
    size: float | None
    plausible: float
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensitivity:
    """What a diagnosis of few trials could have seen, each limit with that `chance`;
    `declared_share` of a trial's variance came with it.
    """

    trials: int
    families: tuple[str, ...]
    effects: tuple[str, ...]
    chance: float
    declared_share: float
    limits: tuple[DetectionLimit, ...]

    def __str__(self) -> str:
        seen = [row.text for row in self.limits if row.size is not None]
        unseen = list(dict.fromkeys(row.effect for row in self.limits if row.size is None))
        if not seen:
            return "could have seen no effect at any size that is possible"
        words = (
            f"could have seen {', '.join(seen)} (each with a chance of {100 * self.chance:.0f} %)"
        )
        if unseen:
            words += f"; not, at any size that is possible, {', '.join(unseen)}"
        return words


@dataclass(frozen=True, slots=True, kw_only=True)
class SilentEffect:
    """An effect that coefficients and L_inf absorb, and the bias that it may do unseen, in standard
    uncertainties `u` of the headline coefficient.
    """

    effect: str
    absorbed_by: str
    share_visible: float
    bias_at_detection_limit: float
    in_units_of: str
    u: float
    u_of: str
    hidden: bool

    @property
    def shift(self) -> float:
        """That bias in the coefficient's own unit."""
        return self.bias_at_detection_limit * self.u


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenBias:
    """How far an effect that goes unseen shifts a coefficient; `in_u` in its standard
    uncertainties.
    """

    shift: float
    in_u: float


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectOutlook:
    """What trials show of one effect of its plausible size, its likelier rivals with their chance,
    and the bias of the coefficients by the size that it `hides_up_to`.

    `detection_limit` is None where no size is seen.
    """

    effect: str
    parameter: str
    unit: str
    shape: Mapping[str, float]
    share_visible: float
    plausible_size: float
    detection_limit: float | None
    verdict: str
    seen: float
    within: float
    first: float
    alone: float
    rivals: Mapping[str, float]
    hides_up_to: float
    bias: Mapping[str, UnseenBias]

    @property
    def label(self) -> str:
        """The effect's name; its parameter's where it has several sizes."""
        return self.parameter if self.effect == "tilt" else self.effect

    @property
    def hidden(self) -> bool:
        """Whether it would go unseen."""
        return self.verdict in ("silent", "too small to see")


@dataclass(frozen=True, slots=True, kw_only=True)
class Alternative:
    """Another session that would part two explanations."""

    measure: str
    expected_evidence: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NextExperiment:
    """What to measure to part two explanations."""

    separates: tuple[str, ...]
    measure: str


@dataclass(frozen=True, slots=True, kw_only=True)
class NextSession(NextExperiment):
    """The same with the evidence that it is expected to bring."""

    trials: int
    expected_evidence: float
    trials_to_separate: int
    alternatives: tuple[Alternative, ...]
