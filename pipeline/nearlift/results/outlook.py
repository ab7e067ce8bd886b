"""Limits of existing or planned trials, and the next experiments: blocks of diagnosis.json and of
a design's outlook.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from nearlift.results.document import IfAny, Real


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
    plausible: Real
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensitivity:
    """Detection limits of a diagnosis of few trials; each is detected with the probability
    `chance`.
    """

    trials: int
    families: tuple[str, ...]
    effects: tuple[str, ...]
    chance: Real
    limits: tuple[DetectionLimit, ...]

    def __str__(self) -> str:
        seen = [row.text for row in self.limits if row.size is not None]
        unseen = list(dict.fromkeys(row.effect for row in self.limits if row.size is None))
        if not seen:
            return "could not have detected any effect of a possible size"
        words = f"could have detected {', '.join(seen)} ({100 * self.chance:.0f} % power each)"
        if unseen:
            words += f"; no possible size of {', '.join(unseen)}"
        return words


@dataclass(frozen=True, slots=True, kw_only=True)
class SilentEffect:
    """An effect that coefficients and L_inf absorb, and its bias while undetected, in standard
    uncertainties `u` of the headline coefficient by the base fit.
    """

    effect: str
    absorbed_by: str
    share_visible: Real
    bias_at_detection_limit: Real
    u: Real
    hidden: bool

    @property
    def shift(self) -> float:
        """Bias in the coefficient's unit."""
        return self.bias_at_detection_limit * self.u


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenBias:
    """Shift of a coefficient (its `value`, where that is known) by an undetected effect; `in_u` in
    its standard uncertainties.
    """

    value: IfAny[float] = None
    shift: Real
    in_u: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectOutlook:
    """Visibility of one effect of plausible size, its likelier rivals with their probability,
    and the bias of the coefficients by the size that it `hides_up_to`.

    `detection_limit` is None where no size is seen.
    """

    effect: str
    parameter: str
    unit: str
    shape: Mapping[str, Real]
    share_visible: Real
    plausible_size: Real
    detection_limit: float | None
    verdict: str
    seen: Real
    within: Real
    first: Real
    alone: Real
    rivals: Mapping[str, Real]
    hides_up_to: Real
    bias: Mapping[str, UnseenBias]

    @property
    def label(self) -> str:
        """The effect's name; its parameter's where it has several sizes."""
        return self.parameter if self.effect == "tilt" else self.effect

    @property
    def hidden(self) -> bool:
        """Whether it would be undetected."""
        return self.verdict in ("silent", "too small to see")


@dataclass(frozen=True, slots=True, kw_only=True)
class NextExperiment:
    """Experiment that distinguishes two explanations."""

    separates: tuple[str, ...]
    measure: str


@dataclass(frozen=True, slots=True, kw_only=True)
class NextSession(NextExperiment):
    """Experiment with its expected evidence."""

    trials: int
    expected_evidence: Real
    trials_to_separate: int
