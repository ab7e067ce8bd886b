"""The tare of a record: the trial's zero, how far it may be off, and whether it is one level."""

from __future__ import annotations

import math

from nearlift.declare import FloatArray
from nearlift.reduction import contamination
from nearlift.reduction.conditions import Conditions
from nearlift.reduction.mean_noise import RecordPart, outlasting, part_of
from nearlift.reduction.samples import FEWEST_REPEATS, stuck
from nearlift.reduction.stretch import Stretch

#: Single samples of a tare are left out that move the zero by more than this share of the lift's u;
#: a tare is refused that longer damage moves by more than u itself.
MATTERS = 0.5
#: Share of the lift by which a tare's ends may differ from its middle.
ROTORS = 0.1
#: Steps of the converter that a live part scatters by, from which on a tare would show some noise,
#: too.
COARSE = 100.0


def zero_of(
    at_rest: RecordPart, lifting: RecordPart, u2_live: float, conditions: Conditions
) -> tuple[float, float, list[str], int]:
    """The tare's mean, its variance, codes, and how many samples were left out: single samples that
    are far from the others. A tare that is not one level is refused.

    Both only where it matters against the lift's own uncertainty; the plain mean else, which is the
    better one. Where the level wanders from its middle, so far may the trial's zero be from the
    mean: that is in the variance.
    """
    tare, quiet, rest = at_rest
    live, _, run = lifting
    if rest.n == 0:
        return rest.mean, 0.0, [], 0
    rate_Hz = conditions.rate_Hz
    zero, u2, codes, left_out = rest.mean, quiet / rest.n, [], 0
    if _dead(tare, rest, live, run):
        return zero, u2, ["STUCK"], 0
    single, uneven = contamination.suspicious(tare, rest)
    single = single and bool(contamination.far_samples(tare, 0.0).any())
    step = contamination.step_of(live) if single or uneven else 0.0
    if single and (far := contamination.far_samples(tare, step)).any():
        _, density, kept = part_of(tare[~far], rate_Hz, tone=False)
        worth, u = zero - kept.mean, math.sqrt(u2_live + density / kept.n)
        isolated = contamination.are_single(far)
        if abs(worth) > u and not isolated:
            return zero, u2, ["TARE"], 0
        if abs(worth) > MATTERS * u and isolated:
            tare, zero, u2, codes = tare[~far], kept.mean, density / kept.n, ["spikes"]
            left_out = int(far.sum())
    if uneven:
        damaged = contamination.moved_by_segment(tare, step)[0] > math.sqrt(u2_live + u2)
        # rotors that run down or up need not have an edge
        if damaged or contamination.ends_apart(tare, step) > ROTORS * abs(run.mean - zero):
            return zero, u2, ["TARE"], 0
    means = contamination.blocks(tare)
    slow = outlasting(tare, means, u2, rate_Hz, tone=False)
    if (away := contamination.wander(tare, means, 0.0)) > MATTERS * math.sqrt(u2_live + u2) and (
        away := contamination.wander(tare, means, contamination.step_of(live))
    ):
        codes = [*codes, "DRIFT" if away > conditions.drift * abs(run.mean - zero) else "drift"]
        u2 += away**2
    if slow and slow.variance > u2:
        u2 = slow.variance
        if slow.is_too_long and not codes and u2 > MATTERS**2 * u2_live:
            codes.append("slow")
    return zero, u2, codes, left_out


def _dead(tare: FloatArray, rest: Stretch, live: FloatArray, run: Stretch) -> bool:
    """Whether the tare, or a part, repeats one value though its converter would show some noise."""
    few = rest.n < contamination.FEW or rest.repeats < FEWEST_REPEATS * rest.n
    if few or not stuck(tare, rest):
        return False
    return math.sqrt(run.squares / (run.n - 1)) > COARSE * contamination.step_of(live)
