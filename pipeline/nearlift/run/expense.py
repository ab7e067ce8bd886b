"""Time and memory that a fit or a diagnosis will take, told before it starts where it is much."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nearlift.likelihood.stations import MOST
from nearlift.results import Observations

#: What takes less of both than this is not worth a word.
LONG_S, LARGE_MB = 10.0, 1000.0
#: Blocks of a chain by which the time of all is told.
TELLING = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """Processor time in s and peak memory in MB: at the start, and per thousand trials at one
    boundary.

    `apart_s` is the time per thousand trials where they have more than `likelihood.stations.MOST`
    distances, so that every trial is whitened. Measured on the campaigns of docs/benchmarks.md
    ("Memory of a fit and a diagnosis").
    """

    start_s: float
    each_s: float
    apart_s: float
    start_MB: float
    each_MB: float

    def cost(self, data: Observations) -> tuple[float, float]:
        """Seconds and MB for these trials."""
        each = self.apart_s if len(np.unique(data.z_hat)) > MOST else self.each_s
        return self.start_s + each * data.n / 1000, self.start_MB + self.each_MB * data.n / 1000


FIT = Law(start_s=3.0, each_s=0.5, apart_s=7.0, start_MB=290.0, each_MB=10.0)
DIAGNOSE = Law(start_s=4.0, each_s=0.6, apart_s=0.6, start_MB=290.0, each_MB=17.0)


def announce(
    say: Callable[[str], None], what: str, law: Law, data: Observations, unless: str = ""
) -> None:
    """Say how many trials there are and what they will take, unless that is little."""
    seconds, megabytes = law.cost(data)
    if seconds > LONG_S or megabytes > LARGE_MB:
        say(
            f"{what}: {data.n} trials, about {_time(seconds)} and {megabytes / 1000:.1f} GB{unless}"
        )


@dataclass(kw_only=True)
class Chain:
    """Tells once what is left of a chain of up to `blocks` blocks, by the time of the first few,
    of which the very first begins with what no other does.
    """

    say: Callable[[str], None]
    what: str
    blocks: int
    began: float | None = None

    def done(self, count: int) -> None:
        """Block `count`, from 1, is done."""
        if count == 1:
            self.began = time.monotonic()
        elif count == TELLING and self.began is not None:
            left = (self.blocks - count) * (time.monotonic() - self.began) / (count - 1)
            if left > LONG_S:
                self.say(
                    f"{self.what}: by a chain, about {_time(left)} more if it takes all its steps"
                )


def _time(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"
