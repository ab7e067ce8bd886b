"""One campaign, one row: simulate, diagnose, compare with the truth."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar
from tests.calibration import forms, oracle
from tests.calibration.kinds import KINDS, draw
from tests.calibration.programs import Row
from tests.calibration.simulator import Campaign, candidate_columns

SAME = 0.99  # a wrong effect whose column is so parallel to the true one is its equal on that bench
Diagnose = Callable[[Campaign], dict[str, Any]]


def engine(campaign: Campaign, *, confirm: bool = True, **options: Any) -> dict[str, Any]:
    """The library's diagnosis of a campaign, and under `quoted` each coefficient's 90 % interval in
    results.json.

    `options` are those of the search (`form_sd=0.0`, ...). A refusal is an
    answer, as in a run of the pipeline: the base fit is then quoted.
    """
    from nearlift import catalogue
    from nearlift.errors import NotConverged
    from nearlift.fit.estimator import Estimator
    from nearlift.fit.least_squares import fit
    from nearlift.loop.diagnose import diagnose
    from nearlift.loop.interim import InterimLook
    from nearlift.loop.search_problem import Options
    from nearlift.stages.diagnose import NOT_DIAGNOSED

    data, parts = campaign.data, campaign.parts
    base = catalogue.model(catalogue.default_base(data.boundary, 4))
    scheduled = campaign.scheduled
    look = InterimLook(trials=data.n, scheduled=scheduled) if scheduled else None
    asked = Options(**{"seed": campaign.seed, **options})
    try:
        found = diagnose(data, base, parts, asked, confirm=confirm, look=look)
    except NotConverged as fault:
        alone = fit(base, data, parts)
        estimator = Estimator.from_fit(alone)
        each = zip(alone.names, alone.theta, estimator.u, strict=True)
        quoted = {
            name: estimator.quoted(i, [(float(value), float(u))], "", [])
            for i, (name, value, u) in enumerate(each)
        }
        content = {"verdict": NOT_DIAGNOSED, "reason": str(fault), "effects": []}
    else:
        quoted = found.quoted.coefficients
        content = found.findings.content | {"result": found.quoted}
    return content | {"quoted": {name: (q.lo90, q.hi90) for name, q in quoted.items()}}


def assess(kind: str, boundary: str, seed: int, diagnose: Diagnose) -> Row:
    """Simulate, diagnose, compare with the truth; a flat row of facts. A diagnosis that raises is a
    row with `failed` set.
    """
    campaign = draw(kind, boundary, seed)
    spec, truth = campaign.spec, campaign.truth
    row: Row = {
        "kind": kind,
        "boundary": boundary,
        "seed": seed,
        "foreign": spec.foreign and bool(spec.sink or truth.amplitudes),
        "truth": list(truth.amplitudes),
        "rho": min(truth.rho.values(), default=0.0),
        "trials": campaign.data.n,
    }
    row |= yardstick(campaign)
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        # a growing campaign is analysed until something is claimed
        for n in KINDS[kind].looks or (campaign.data.n,):
            seen = campaign if n == campaign.data.n else campaign.until(n)
            result = diagnose(seen)
            found = verdict(seen, result) | {"trials": n}
            if found["claimed"]:
                break
        row |= {"wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - cpu}
        return row | found | coverage(seen, result) | {"failed": ""}
    except Exception as fault:  # whatever breaks is counted
        return row | {"failed": f"{type(fault).__name__}: {fault}"}


def yardstick(campaign: Campaign) -> Row:
    """Coverage of the headline coefficient by the true model, and of campaigns of records its
    held-out errors.
    """
    name = forms.HEADLINE[campaign.spec.boundary]
    best = oracle.fit(campaign)
    low, high = best.interval(name)
    holds = low <= campaign.truth.theta[name] <= high
    row: Row = {"cover_oracle": holds, "oracle_width": high - low}
    if campaign.spec.errors is not None:
        return row
    base = oracle.fit(campaign, ())
    return row | {
        "oracle_before": oracle.held_out(campaign, ()),
        "oracle_after": oracle.held_out(campaign),
        "expected_before": oracle.expected(campaign, base.predicted),
        "expected_oracle": oracle.expected(campaign, best.predicted),
    }


def verdict(campaign: Campaign, result: dict[str, Any]) -> Row:
    """What was claimed, whether it is so, and the held-out error as reported."""
    effects = result["effects"]
    # a joint explanation is "a + b"
    names = [part for e in effects for part in e["name"].split(" + ")]
    rivals = [part for e in effects for r in e["rivals"] for part in r.split(" + ")]
    within = (result.get("within_trial") or {}).get("candidates", [])
    truth, both = set(campaign.truth.amplitudes), {*names, *rivals}
    inside = bool(truth) and truth <= both
    error = result.get("error", {})
    reported = {
        f"reported_{k}": float(error[k]["held_out_rmse"]) if error else math.nan
        for k in ("before", "after")
    }
    return reported | {
        "verdict": result["verdict"],
        "names": names,
        "rivals": rivals,
        "within": list(within),
        "claimed": result["verdict"] in ("effect", "unexplained") or bool(within),
        "named": bool(names) or bool(within and not campaign.spec.sink),
        "right": set(names) == truth and len(names) == len(truth),
        "inside": inside,
        "equal": inside or _equals(campaign, both),
        "single_wrong": bool(names) and not rivals and not truth & set(names),
        "set_size": len(both),
    }


def _equals(campaign: Campaign, names: Iterable[str]) -> bool:
    """Whether some named effect's column is, after theta and L_inf, parallel to the true effect."""
    if len(campaign.truth.contributions) != 1:
        return False
    (effect,) = campaign.truth.contributions.values()
    columns, e = candidate_columns(campaign), campaign.left(effect)
    left = [campaign.left(columns[n]) for n in names if n in columns]
    return any(abs(e @ c) >= SAME * np.linalg.norm(e) * np.linalg.norm(c) for c in left)


def headline(campaign: Campaign) -> float:
    """The true headline coefficient, at the speed for which the library states it.

    Where gain depends on speed (`reynolds`) a coefficient holds at one speed: the simulator's at
    17000 rpm, the library's at the campaign's median throttle. The other is the one whose curve
    comes nearest over the stations, in log lift.
    """
    spec, truth, bench = campaign.spec, campaign.truth, campaign.setting.bench
    name = forms.HEADLINE[spec.boundary]
    true, size = truth.theta[name], truth.amplitudes.get("reynolds")
    if size is None:
        return true
    throttle, first = np.unique(bench.throttle, return_index=True)
    speed = np.interp(np.median(campaign.data.throttle), throttle, bench.speed_rpm[first])
    z_hat = np.unique(bench.z_hat)
    ratio = forms.ratio(spec.boundary, z_hat, truth.theta)
    there = forms.form("reynolds", spec.foreign).apply(
        ratio, replace(bench, speed_rpm=speed), campaign.setting, size
    )

    def miss(value: float) -> float:
        other = forms.ratio(spec.boundary, z_hat, {**truth.theta, name: value})
        return float(np.sum(np.log(other / there) ** 2))

    span = (0.3 * true, 3 * true)
    found = minimize_scalar(miss, bounds=span, method="bounded", options={"xatol": 1e-9})
    return float(found.x)


def coverage(campaign: Campaign, result: dict[str, Any]) -> Row:
    """Whether the 90 % intervals on the headline coefficient hold the truth, and their widths."""
    name, true = forms.HEADLINE[campaign.spec.boundary], headline(campaign)
    low, high = result["quoted"][name]
    row: Row = {"cover_quoted": bool(low <= true <= high), "width_quoted": float(high - low)}
    if "coefficients" in result:
        base = result["coefficients"]["before"][name]
        row["cover_base"] = bool(base["lo90"] <= true <= base["hi90"])
    return row
