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
from tests.calibration.peers import PEERS, Task
from tests.calibration.simulator import Campaign, base_jacobian, candidate_columns

SAME = 0.99  # a wrong name whose column runs so parallel to the true effect's is physically its equal on that bench
Row = dict[str, Any]
Diagnose = Callable[[Campaign], dict[str, Any]]


def engine(campaign: Campaign, *, confirm: bool = True, **options: Any) -> dict[str, Any]:
    """The library's diagnosis of a campaign, and under `quoted` each coefficient's 90 % interval in
    results.json.

    `options` are those of the search (`multiplicity=False`, `form_sd=0.0`, ...). A refusal is an
    answer, as in a run of the pipeline: the base fit then stands alone.
    """
    from nearlift import catalogue
    from nearlift.errors import NotConverged
    from nearlift.fit.estimator import Estimator
    from nearlift.fit.least_squares import fit
    from nearlift.loop.diagnose import diagnose
    from nearlift.loop.interim import InterimLook
    from nearlift.loop.search_problem import Options
    from nearlift.stages.diagnose import NOT_DIAGNOSED

    base = catalogue.model(catalogue.default_base(campaign.data.boundary, 4))
    try:
        n, scheduled = campaign.data.n, campaign.scheduled
        look = InterimLook(trials=n, scheduled=scheduled) if scheduled else None
        found = diagnose(
            campaign.data,
            base,
            campaign.parts,
            Options(**{"seed": campaign.seed, **options}),
            confirm=confirm,
            look=look,
        )
        return found.findings.content | {
            "quoted": {n: (c.lo90, c.hi90) for n, c in found.quoted.coefficients.items()},
            "result": found.quoted,
        }
    except NotConverged as fault:
        alone = fit(base, campaign.data, campaign.parts)
        spans = [
            [(float(t), float(u))]
            for t, u in zip(alone.theta, Estimator.from_fit(alone).u, strict=True)
        ]
        quoted = [Estimator.from_fit(alone).quoted(i, span, "", []) for i, span in enumerate(spans)]
        intervals = {n: (q.lo90, q.hi90) for n, q in zip(alone.names, quoted, strict=True)}
        return {"verdict": NOT_DIAGNOSED, "reason": str(fault), "effects": [], "quoted": intervals}


def assess(
    kind: str, boundary: str, seed: int, diagnose: Diagnose | None, peers: bool = False
) -> Row:
    """Simulate, diagnose, compare with the truth; a flat row of facts. A diagnosis that raises is a
    row with `failed` set.
    """
    campaign = draw(kind, boundary, seed)
    spec, truth = campaign.spec, campaign.truth
    row: Row = {
        "kind": kind,
        "boundary": boundary,
        "seed": seed,
        "design": spec.design,
        "realism": spec.realism,
        "foreign": spec.foreign and bool(spec.sink or truth.amplitudes),
        "truth": [k for k, _ in spec.effects],
        "rho": min(truth.rho.values(), default=0.0),
        "rho_beside": min(truth.rho_beside.values(), default=0.0),
        "sink": spec.sink,
        "trials": campaign.data.n,
        "noise_floor": truth.noise_floor,
    }
    if peers:
        row["peers"] = {name: list(method(task(campaign))) for name, method in PEERS.items()}
    row |= yardstick(campaign)
    if diagnose is None:
        return row
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        # a growing campaign is looked at until something is claimed
        for n in KINDS[kind].looks or (campaign.data.n,):
            seen = campaign if n == campaign.data.n else campaign.until(n)
            result = diagnose(seen)
            found = verdict(seen, result) | {"trials": n}
            if found["claimed"]:
                break
        row |= {"wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - cpu}
        held_out = errors(campaign, result) if spec.errors is None else {}
        return row | found | held_out | coverage(seen, result) | {"failed": ""}
    except Exception as fault:  # whatever breaks, in the loop or in reading its report, is a finding, and is counted
        return row | {"failed": f"{type(fault).__name__}: {fault}"}


def task(campaign: Campaign) -> Task:
    """What rival methods are given: the same trials, and the library in the referee's own forms
    (which flatters them).
    """
    base = oracle.fit(campaign, ())
    setting = replace(campaign.setting, theta=base.theta)
    return Task(
        lift_N=campaign.data.lift_N,
        z_hat=campaign.data.z_hat,
        level=campaign.data.level,
        ratio=setting.curve(setting.bench.z_hat)[campaign.keep],
        jacobian=base_jacobian(setting)[campaign.keep],
        whiten=campaign.whitener,
        candidates=candidate_columns(campaign),
    )


def yardstick(campaign: Campaign) -> Row:
    """What the one who knows the truth reaches: coverage of the headline coefficient, and of
    campaigns of records the held-out errors.
    """
    name = forms.HEADLINE[campaign.spec.boundary]
    true = campaign.truth.theta[name]
    best = oracle.fit(campaign)
    low, high = best.interval(name)
    row: Row = {"true_value": true, "cover_oracle": low <= true <= high, "oracle_width": high - low}
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
    """What was claimed, and whether it is so."""
    effects = result["effects"]
    names = [part for e in effects for part in _split(e["name"])]
    rivals = [part for e in effects for r in e["rivals"] for part in _split(r)]
    within = (result.get("within_trial") or {}).get("candidates", [])
    truth = set(campaign.truth.amplitudes)
    single = len(effects) == 1 and not rivals
    row: Row = {
        "verdict": result["verdict"],
        "names": names,
        "rivals": rivals,
        "within": list(within),
        "probabilities": result.get("probabilities", []),
        "partial": [p["name"] for p in result.get("partial", [])],
        "structure": [
            s["covariate"] for s in result.get("structure", []) if s.get("significant", True)
        ][:3],
        "undiagnosed": result.get("reason", "") if result["verdict"] == "not_diagnosed" else "",
        "claimed": result["verdict"] in ("effect", "unexplained") or bool(within),
        "named": bool(names) or bool(within and not campaign.spec.sink),
        "right": set(names) == truth and len(names) == len(truth),
        "inside": bool(truth) and truth <= {*names, *rivals},
        "single_wrong": bool(names) and not rivals and not truth & set(names),
        "set_size": len({*names, *rivals}),
    }
    row["single"] = single
    row["equal"] = row["inside"] or _equals(campaign, [*names, *rivals])
    return row


def _split(name: str) -> list[str]:
    """Names of a joint explanation such as "a + b"."""
    return [
        part.strip()
        for part in name.replace(" and ", "+").replace(",", "+").split("+")
        if part.strip()
    ]


def _equals(campaign: Campaign, names: Iterable[str]) -> bool:
    """Whether some named effect's column is, after theta and L_inf, parallel to the true effect."""
    if len(campaign.truth.contributions) != 1:
        return False
    (effect,) = campaign.truth.contributions.values()
    columns = candidate_columns(campaign)
    q, _ = np.linalg.qr(campaign.whitener(np.hstack([campaign.indicator, campaign.jacobian])))

    def left(x: np.ndarray) -> np.ndarray:
        white = campaign.whitener(x)
        return white - q @ (q.T @ white)

    e = left(effect)
    return any(
        abs(e @ (c := left(columns[n]))) >= SAME * np.linalg.norm(e) * np.linalg.norm(c)
        for n in names
        if n in columns
    )


def errors(campaign: Campaign, result: dict[str, Any]) -> Row:
    """Held-out error as reported, and as an independent repeat of the campaign would show it for
    the model reported.
    """
    before, after = (
        (float(result["error"][k]["held_out_rmse"]) for k in ("before", "after"))
        if "error" in result
        else (math.nan, math.nan)
    )
    row: Row = {
        "reported_before": before,
        "reported_after": after,
        "reported_floor": float(result.get("error", {}).get("noise_floor", math.nan)),
    }
    if result["verdict"] == "effect":
        row["expected_after"] = oracle.expected(campaign, rebuilt(campaign, result))
    return row


def rebuilt(campaign: Campaign, result: dict[str, Any]) -> np.ndarray:
    """Log lift of every trial from the model that a diagnosis names, with the sizes and shapes that
    it reports.

    Only the report is used: the named effects are composed with the base model, and the linear
    unknowns (L_inf per throttle, one Gauss-Newton step of the coefficients) are solved on the
    campaign's own trials.
    """
    from nearlift import catalogue
    from nearlift.declare import compose
    from nearlift.likelihood.covariates import derive

    data = campaign.data
    base = catalogue.model(result["base_model"])
    form = result["result"].form
    model = compose(
        base, *(catalogue.effect(n, form(n)) for n in (e["name"] for e in result["effects"]))
    )
    far = data.z_hat >= np.quantile(data.z_hat, 0.7)
    data = derive(
        data,
        np.array(
            [np.median(data.lift_N[(data.level == k) & far]) for k in range(len(data.levels))]
        )[data.level],
    )
    known = {
        **data.geometry,
        **data.covariates,
        "throttle": data.throttle,
        "session": data.session,
        "z_hat": data.z_hat,
    }
    values: dict[str, Any] = {n: known[n] for n in model.needs}
    reported = {n: v["value"] for e in result["effects"] for n, v in e["parameters"].items()}
    for p in model.parameters:
        if p.name in reported:
            values[p.name] = float(reported[p.name])
        elif p.per == "session":
            values[p.name] = np.array(
                [float(reported[f"{p.name}[{i}]"]) for i in range(data.session.max() + 1)]
            )[data.session]
    theta = {
        p.name: float(result["coefficients"]["after"][p.name]["value"]) for p in base.parameters
    }

    def log_ratio(at: dict[str, float]) -> np.ndarray:
        return np.log(np.asarray(model.evaluate(data.z_hat, **{**values, **at}), dtype=float))

    now = log_ratio(theta)
    steps = {n: 1e-4 * max(abs(v), 1e-2) for n, v in theta.items()}
    slopes = [
        (log_ratio({**theta, n: v + steps[n]}) - log_ratio({**theta, n: v - steps[n]}))
        / (2 * steps[n])
        for n, v in theta.items()
    ]
    design = np.column_stack([campaign.indicator, *slopes])
    x, y = campaign.whitener(design), campaign.whitener(np.log(data.lift_N) - now)
    solved = np.linalg.lstsq(x, y, rcond=None)[0]
    for _ in range(4):
        left = y - x @ solved
        limit = oracle.CLIP * 1.4826 * np.median(np.abs(left))
        solved = solved + np.linalg.lstsq(x, np.clip(left, -limit, limit), rcond=None)[0]
    return now + design @ solved


def headline(campaign: Campaign) -> float:
    """The true headline coefficient, at the speed for which the library states it.

    Where gain depends on speed (`reynolds`) a coefficient holds at one speed: the referee's at
    17000 rpm, the library's at the campaign's median throttle. The other is the one whose curve
    comes nearest over the stations, in log lift.
    """
    spec, truth, bench = campaign.spec, campaign.truth, campaign.setting.bench
    name = forms.HEADLINE[spec.boundary]
    size = truth.amplitudes.get("reynolds")
    if size is None:
        return truth.theta[name]
    throttle, first = np.unique(bench.throttle, return_index=True)
    speed = np.interp(np.median(campaign.data.throttle), throttle, bench.speed_rpm[first])
    z_hat = np.unique(bench.z_hat)
    there = replace(campaign.setting, bench=replace(bench, speed_rpm=speed))
    wanted = np.log(
        forms.form("reynolds", spec.foreign).apply(
            forms.ratio(spec.boundary, z_hat, truth.theta), there, size
        )
    )

    def miss(value: float) -> float:
        return float(
            np.sum(
                (np.log(forms.ratio(spec.boundary, z_hat, {**truth.theta, name: value})) - wanted)
                ** 2
            )
        )

    found = minimize_scalar(
        miss,
        bounds=(0.3 * truth.theta[name], 3 * truth.theta[name]),
        method="bounded",
        options={"xatol": 1e-9},
    )
    return float(found.x)


def coverage(campaign: Campaign, result: dict[str, Any]) -> Row:
    """Whether each 90 % interval on the headline coefficient holds the truth, and how
    wide it is.
    """
    name = forms.HEADLINE[campaign.spec.boundary]
    true = headline(campaign)
    intervals = {"quoted": result["quoted"][name]}
    if "coefficients" in result:
        before, after = (
            result["coefficients"]["before"][name],
            result["coefficients"]["after"][name],
        )
        intervals |= {
            "base": (before["lo90"], before["hi90"]),
            "refit": after.get("conditional"),
            "constrained": after.get("constrained"),
        }
    row: Row = {}
    for kind, interval in intervals.items():
        if interval is not None:
            row[f"cover_{kind}"] = bool(interval[0] <= true <= interval[1])
            row[f"width_{kind}"] = float(interval[1] - interval[0])
    return row
