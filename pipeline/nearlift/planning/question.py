"""Aim of the next visits, as the user writes it."""

from __future__ import annotations

from dataclasses import dataclass

from nearlift.errors import UsageError

#: Share of a batch that goes round all stations, unless asked otherwise.
ROUNDS = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class VisitQuestion:
    """A `coefficient`, or a `pair` of effects to distinguish: by default those of the diagnosis.

    Visits stop at the standard uncertainty `until` of the coefficient. `rounds` is the share of a
    batch that goes round all stations.
    """

    coefficient: str = ""
    pair: tuple[str, ...] = ()
    until: float | None = None
    rounds: float = ROUNDS

    @classmethod
    def parsed(cls, text: str, until: float | None = None, rounds: float = ROUNDS) -> VisitQuestion:
        """VisitQuestion of ``--for TEXT``.

        Raises
        ------
        UsageError
            Not two different effects, or a limit without a coefficient.
        """
        # the command line shows the defaults above without what the catalogue loads
        from nearlift import catalogue

        word, _, names = text.partition("=")
        if word != "separate":
            return cls(coefficient=text, until=until, rounds=rounds)
        pair = tuple(n.strip() for n in names.split(",") if n.strip())
        if pair and len(set(pair)) != 2:
            raise UsageError(
                f"--for {text}",
                "needs two different effects",
                "separate=supply_sag,gain_drift, or separate alone for those that the diagnosis"
                " could not distinguish",
            )
        if until is not None:
            raise UsageError(
                "--until",
                "is u of a coefficient",
                "leave it out: visits stop when the two are distinguished",
            )
        for name in pair:
            catalogue.effect(name)
        return cls(pair=pair, rounds=rounds)
