"""What the next visits of a campaign are to be good for, as the user writes it."""

from __future__ import annotations

from dataclasses import dataclass

from nearlift.errors import UsageError

#: Of a batch, what goes round all stations, unless asked otherwise.
ROUNDS = 0.5
SEPARATE, DRIFT = "separate", "drift"
#: What `drift` tells apart: the supply, and time.
OF_DRIFT = ("supply_sag", "gain_drift")


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedQuestion:
    """The question in words: a coefficient; or two explanations, by default the diagnosis's; u of
    the coefficient at which to stop; and the share of a batch that goes round all stations.
    """

    coefficient: str = ""
    pair: tuple[str, ...] = ()
    drift: bool = False
    until: float | None = None
    rounds: float = ROUNDS

    @classmethod
    def parsed(cls, text: str, until: float | None = None, rounds: float = ROUNDS) -> AskedQuestion:
        """What ``--for TEXT`` asks.

        Raises
        ------
        UsageError
            Not two different effects, or a limit where no coefficient is asked for.
        """
        # the command line shows the defaults above without what the catalogue loads
        from nearlift import catalogue

        word, _, names = text.partition("=")
        if word in (SEPARATE, DRIFT):
            pair = tuple(n.strip() for n in names.split(",") if n.strip())
            if (word == DRIFT and names) or (pair and len(set(pair)) != 2):
                raise UsageError(
                    f"--for {text}",
                    "wants two different effects",
                    "separate=supply_sag,gain_drift, or separate alone for those that the diagnosis"
                    " could not distinguish",
                )
            if until is not None:
                raise UsageError(
                    "--until", "is u of a coefficient", "leave it out: rivals stop when they part"
                )
            for name in pair:
                catalogue.effect(name)
            return cls(pair=OF_DRIFT if word == DRIFT else pair, drift=word == DRIFT, rounds=rounds)
        return cls(coefficient=text, until=until, rounds=rounds)
