"""How flights of one condition hover beside sound ones, part of results.json."""

from __future__ import annotations

from dataclasses import dataclass

#: What one rotor that is told more may be, and all rotors: in hover these cannot be told apart.
ONE_ROTOR = ("rotor_imbalance", "weight_at_rotor")
ALL_ROTORS = ("vehicle_mass", "session_gain")


@dataclass(frozen=True, slots=True, kw_only=True)
class HoverShift:
    """Relative difference of motor voltage: of all rotors (`rotor` 0), or of one, counted from 1,
    against the others; a difference is one from `limit` on.
    """

    rotor: int
    value: float
    limit: float

    @property
    def stands_out(self) -> bool:
        """Whether it is beyond the limit."""
        return abs(self.value) > self.limit

    @property
    def text(self) -> str:
        """``rotor 3 +7.5 % (limit 5.2 %)``"""
        what = f"rotor {self.rotor}" if self.rotor else "all rotors"
        return f"{what} {100 * self.value:+.1f} % (limit {100 * self.limit:.1f} %)"


@dataclass(frozen=True, slots=True, kw_only=True)
class HoverComparison:
    """Flights of one condition against sound ones, by log voltages of the motors in hover; of
    sound ones, one log against the others. `rivals` are what hover cannot tell from `effects`.
    """

    condition: str
    logs: tuple[str, ...]
    sound_logs: int
    shifts: tuple[HoverShift, ...]
    effects: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()

    @classmethod
    def compared(
        cls, condition: str, logs: tuple[str, ...], sound_logs: int, shifts: tuple[HoverShift, ...]
    ) -> HoverComparison:
        """With what stands out named: a rotor, or else all of them."""
        beyond = [s for s in shifts if s.stands_out]
        names = ONE_ROTOR if any(s.rotor for s in beyond) else ALL_ROTORS if beyond else ()
        return cls(
            condition=condition,
            logs=logs,
            sound_logs=sound_logs,
            shifts=shifts,
            effects=names[:1],
            rivals=names[1:],
        )

    @property
    def text(self) -> str:
        """In a sentence."""
        beyond = sorted(
            (s for s in self.shifts if s.stands_out), key=lambda s: -abs(s.value) / s.limit
        )
        logs = self.logs[0] if len(self.logs) == 1 else f"{self.condition} ({len(self.logs)} logs)"
        whose = f"{logs} against {self.sound_logs} sound logs"
        if not beyond:
            return f"in hover {whose} shows nothing"
        shown = ", ".join(s.text for s in beyond)
        names = " or ".join((*self.effects, *self.rivals))
        return (
            f"in hover {whose} differs in motor voltage: {shown}: {names}, which hover cannot tell"
            " apart"
        )
