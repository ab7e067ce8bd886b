"""Upper limit of how often one effect can be named, by an ideal observer.

The observer knows the simulator's forms, the noise, the possible size of each effect, and that
there is one effect, but not which.

    python -m tests.calibration.ideal --count 201 --seed 840000

No search can find what this observer misses: other causes in other forms fit as well.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.optimize import minimize_scalar
from tests.calibration import forms, oracle, programs
from tests.calibration.kinds import REPORTED, draw
from tests.calibration.programs import Row
from tests.calibration.simulator import Campaign, log_lift

#: Sizes that are tried first, over the largest possible.
SHARES = (0.004, 0.015, 0.05, 0.12, 0.25, 0.45, 0.7, 1.0)
#: How often a campaign has the foreign form.
FOREIGN = 1 / 3
#: Largest 2 ln B of the likeliest explanation over one that is listed with it.
REACH = 9.0
WEAKEST = 0.2

Array = np.ndarray
Piece = tuple[forms.Form, float]
Job = tuple[str, int]


class Observer:
    """A campaign's trials against any form: coefficients and L_inf free, the noise known, its
    outliers winsorised about the truth.
    """

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign
        setting, white = campaign.setting, campaign.whitener
        self.log_inf = np.log(setting.levels_N)[setting.bench.level]
        fit = oracle.fit(campaign)
        left = white(fit.residuals)
        reach = oracle.CLIP * 1.4826 * np.median(np.abs(left))
        known = np.log(campaign.data.lift_N) - fit.residuals
        self.target = white(known) + np.clip(left, -reach, reach)
        self.flat = white(campaign.indicator)
        self.null = self.chi2(None)

    def chi2(self, piece: Piece | None) -> float:
        """Least sum of squared whitened residuals with an effect of this form and size."""
        names = tuple(self.campaign.truth.theta)
        limits = np.array([oracle.LIMITS[n] for n in names])
        theta = np.array(list(self.campaign.truth.theta.values()))
        white, left = self.campaign.whitener, self.target
        for _ in range(3):
            now = self._log_ratio(theta, piece)
            steps = 1e-4 * np.maximum(np.abs(theta), 1e-3)
            slopes = [
                (self._log_ratio(theta + s * e, piece) - now) / s
                for s, e in zip(steps, np.eye(len(theta)), strict=True)
            ]
            columns = np.hstack([self.flat, white(np.stack(slopes, axis=1))])
            y = self.target - white(now)
            found = np.linalg.lstsq(columns, y, rcond=1e-12)[0]
            left = y - columns @ found
            theta = np.clip(theta + found[self.flat.shape[1] :], *limits.T)
        return float(left @ left)

    def log_evidence(self, kind: str, foreign: bool) -> float:
        """Of one form, at its likeliest size of those that are possible and strong enough; sizes
        log-uniform in strength, as they are drawn.
        """
        form = forms.form(kind, foreign)
        most, best = form.most[self.campaign.spec.boundary], (np.inf, 0.0)
        for largest in (most, -most) if form.signed else (most,):

            def miss(share: float, largest: float = largest) -> float:
                return self.chi2((form, share * largest))

            tried = [miss(s) for s in SHARES]
            i = int(np.argmin(tried))
            span = (SHARES[i - 1] if i else 0.0, SHARES[min(i + 1, len(SHARES) - 1)])
            near = minimize_scalar(miss, bounds=span, method="bounded", options={"maxiter": 14})
            least = min((float(near.fun), float(near.x)), (tried[i], SHARES[i]))
            best = min(best, (least[0], least[1] * largest))
        left = self.campaign.left(self.campaign.effect((form, best[1])))
        rho = float(np.sqrt(np.mean(left**2)))
        if rho < WEAKEST / 2:
            return -math.inf
        price = math.log(max(rho, WEAKEST)) + form.signed * math.log(2)
        return 0.5 * (self.null - best[0]) - price

    def _log_ratio(self, theta: Array, piece: Piece | None) -> Array:
        campaign = self.campaign
        names = tuple(campaign.truth.theta)
        at = replace(campaign.setting, theta=dict(zip(names, theta.tolist(), strict=True)))
        lift = log_lift(at, (piece,) if piece else ())
        return np.asarray((lift - self.log_inf)[campaign.keep])


def assess(job: Job) -> list[Row]:
    """One campaign: the effect that the observer names, and its rivals, once with the printed forms
    alone and once with both.
    """
    boundary, seed = job
    campaign = draw("one", boundary, seed)
    observer, (truth,) = Observer(campaign), campaign.truth.amplitudes
    row: Row = {"boundary": boundary, "seed": seed, "foreign": campaign.spec.foreign}
    own, other = (
        {k: observer.log_evidence(k, foreign) for k in forms.names(boundary)}
        for foreign in (False, True)
    )
    weights = math.log(1 - FOREIGN), math.log(FOREIGN)
    both = {k: float(np.logaddexp(own[k] + weights[0], other[k] + weights[1])) for k in own}
    for known, found in (("own", own), ("both", both)):
        most = max(found.values())
        row[f"{known}_right"] = found[truth] == most
        row[f"{known}_inside"] = 2 * (most - found[truth]) <= REACH
        row[f"{known}_set"] = sum(2 * (most - v) <= REACH for v in found.values())
    return [row]


def main() -> None:
    """Run and print."""
    given = programs.parser(__doc__, REPORTED).parse_args()
    jobs: list[Job] = [(forms.BOUNDARIES[i % 3], given.seed + i) for i in range(given.count)]
    with programs.opened(given.executor) as executor:
        rows = programs.collect(executor, assess, jobs, ("boundary", "seed"), given.out)
    data = pd.DataFrame(rows)
    for known in ("own", "both"):
        right, inside, size = (
            data[f"{known}_{what}"].mean() for what in ("right", "inside", "set")
        )
        print(f"{known} forms known: {right:.1%} named right, {inside:.1%} within {size:.2f} names")


if __name__ == "__main__":
    # by the name that workers know this module by
    from tests.calibration.ideal import main as run_main

    run_main()
