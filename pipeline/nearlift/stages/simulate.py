"""simulate: flights near ground and ceiling, to crash_rates.parquet, flights.parquet,
crash_map.parquet and safety.json.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary, FloatArray
from nearlift.errors import ManifestError
from nearlift.flight.simulation import (
    claims,
    energy,
    groups,
    histories,
    maps,
    presets,
    roll,
    safety,
    variants,
)
from nearlift.flight.simulation.control import Gains, stable
from nearlift.flight.simulation.craft import Craft
from nearlift.flight.simulation.curve import tabulate
from nearlift.flight.simulation.disturbance import Disturbance
from nearlift.flight.simulation.flight import Map, steps_per_hold
from nearlift.flight.simulation.sweep import Sweep, sweep
from nearlift.manifest.campaign import boundaries_of
from nearlift.manifest.flight import Simulate
from nearlift.products import CRASH_MAP, CRASH_RATES, FIT, FLIGHTS, ROUTES, SAFETY
from nearlift.randomness import generator
from nearlift.run.job import Job, Outcome
from nearlift.stages.belief import Belief, believe
from nearlift.stages.route import plan

#: Air density where the manifest gives none, kg/m^3: the paper's.
AIR = 1.2
Rows = list[dict[str, Any]]


def run(job: Job) -> Outcome:
    """Fly the presets and this campaign's fitted models; every run tests its own time step, and
    says where it fails.
    """
    chosen = job.campaign.simulate or Simulate()
    for risk in chosen.risks:
        safety.refuse_few(risk, chosen.flights)
    key = int(generator(job.seed, "simulate").integers(2**63))
    rows: Rows = []
    notes: list[str] = []
    content: dict[str, Any] = {"schema": SAFETY.schema, "presets": {}, "fitted": {}}
    samples: list[dict[str, Any]] = []
    levels = {name: claims.Levels() for name in chosen.presets}
    for name in chosen.presets:
        preset = presets.preset(name)
        content["presets"][name] = {"meaning": preset.meaning, "boundaries": {}}
        for boundary in presets.MODELS:
            job.say(f"simulate {name} {boundary}")
            flown, varied, entry = _preset(
                preset, boundary, chosen, key, spread(job), rows, levels[name]
            )
            content["presets"][name]["boundaries"][boundary] = entry
            samples += histories.paper(preset, boundary, key) if name == "paper" else []
            _note(notes, f"{name} {boundary}", flown.convergence)
            if flown.convergence.converged:
                _note(notes, f"{name} {boundary}, other gains and noise", varied)
    fitted = boundaries_of([b for b in job.read_json(FIT)["boundaries"] if b in presets.MODELS])
    craft = vehicle(job, chosen)
    mapped: Rows = []
    flights: dict[Boundary, Sweep] = {}
    for boundary in fitted:
        job.say(f"simulate fitted {boundary}")
        belief = believe(job, boundary, chosen.draws)
        flown, entry = _fitted(job, belief, chosen, craft, key, rows)
        content["fitted"][boundary], flights[boundary] = entry, flown
        _note(notes, f"fitted {boundary}", flown.convergence)
        if chosen.maps:
            job.say(f"simulate map {boundary}")
            how = _how(chosen, boundary, craft)
            spacing = belief.arguments.get("spacing_hat")
            cells, tested = maps.scan(
                boundary,
                belief.spaced,
                belief.model.name,
                bound(belief, chosen),
                spacing,
                **how,
                flights=chosen.flights,
                key=key,
                spread=spread(job),
            )
            mapped += cells
            entry["maps"] = asdict(tested)
            _note(notes, f"map {boundary}", tested)
    content["route"], routes = (
        plan(job, chosen, craft, content["fitted"], flights) if chosen.route else (None, [])
    )
    content["claims"] = claims.table(levels)
    content["roll"] = _roll(job, chosen)
    job.write(CRASH_RATES, columns(CRASH_RATES, rows))
    job.write(FLIGHTS, columns(FLIGHTS, samples))
    job.write(CRASH_MAP, columns(CRASH_MAP, mapped))
    job.write(ROUTES, columns(ROUTES, routes))
    job.write_json(SAFETY, content)
    return Outcome(notes=tuple(notes))


def spread(job: Job) -> Map:
    """The executor's map: blocks of flights are plain values that threads, processes or a cluster
    may fly in any order.
    """
    return job.executor.map


def columns(product: Any, rows: Rows) -> dict[str, Any]:
    """Rows as the columns of a product."""
    kinds: dict[str, Any] = {"text": object, "integer": np.int64, "real": float}
    return {
        c.name: np.array([r[c.name] for r in rows], dtype=kinds[c.kind]) for c in product.columns
    }


def vehicle(job: Job, chosen: Simulate) -> Craft:
    """The campaign's vehicle as the simulation knows it."""
    v, rig = job.campaign.vehicle, job.campaign.rig
    return Craft(
        radius_m=v.rotor_radius,
        mass_kg=v.mass,
        gravity_m_s2=rig.gravity,
        density_kg_m3=rig.air_density or AIR,
        C_L=chosen.lift_coefficient,
        rotors=v.rotors,
    )


def _how(chosen: Simulate, boundary: Boundary, craft: Craft) -> dict[str, Any]:
    """Groups, scheme and step of this campaign's flights: the manifest's, else the paper's carried
    over to the vehicle.

    Raises
    ------
    ManifestError
        The gains make an unstable loop, or the step is no whole part of the gusts' hold.
    """
    like = presets.preset("converged")
    carried = groups.of(like.craft, like.gains(boundary), like.disturbance, like.duration_s)
    given = chosen.gains.get(boundary)
    gains = (
        Gains(kP=given.proportional, kD=given.derivative, kI=given.integral)
        if given
        else groups.gains_for(carried, craft)
    )
    stable(gains, craft, boundary)
    g = chosen.gusts
    gusts = (
        Disturbance(sd_N=g.sd, hold_s=g.hold, correlation_s=g.correlation)
        if g
        else groups.disturbance_for(carried, craft)
    )
    duration_s = chosen.duration or carried.duration * craft.time_s
    if duration_s < gusts.hold_s:
        raise ManifestError(
            "simulate.duration",
            f"{duration_s:g} s is shorter than one gust of {gusts.hold_s:g} s",
            "fly at least so long",
        )
    step_s = chosen.step or gusts.hold_s / steps_per_hold(like.disturbance.hold_s, like.step_s)
    own = groups.of(craft, gains, gusts, duration_s, chosen.contact_z_hat.get(boundary, 0.0))
    return {
        "groups": own,
        "scheme": chosen.scheme,
        "steps_per_hold": steps_per_hold(gusts.hold_s, step_s),
        "step_s": step_s,
    }


def bound(belief: Belief, chosen: Simulate) -> float:
    """The height below which L / L_inf is held constant: the manifest's, else that of the nearest
    station, since nothing is known below.
    """
    return chosen.bound_z_hat.get(belief.boundary, belief.measured_z_hat[0])


def _preset(
    preset: presets.Preset,
    boundary: Boundary,
    chosen: Simulate,
    key: int,
    over: Map,
    rows: Rows,
    levels: claims.Levels,
) -> tuple[Sweep, safety.Convergence, dict[str, Any]]:
    """The paper's models and powers under one preset; `levels` takes what its claims are judged by.
    Second: the step of the variants.
    """
    model = catalogue.model(presets.MODELS[boundary])
    geometry = {n: presets.GEOMETRY[n] for n in model.needs}
    curves = tabulate(
        [lambda z, k=k: model(z, **geometry) ** k for k in presets.EXPONENTS],  # type: ignore[misc]
        presets.BOUND_Z_HAT,
    )
    gains = stable(preset.gains(boundary), preset.craft, boundary)
    own = groups.of(preset.craft, gains, preset.disturbance, preset.duration_s)
    how: dict[str, Any] = {
        "scheme": preset.scheme,
        "step_s": preset.step_s,
        "steps_per_hold": steps_per_hold(preset.disturbance.hold_s, preset.step_s),
        "flights": chosen.flights,
        "key": key,
        "spread": over,
    }
    flown = sweep(boundary, curves, presets.TARGETS[boundary], own, **how)
    entry: dict[str, Any] = {
        "convergence": asdict(flown.convergence),
        "groups": asdict(own),
        "flights": flown.flights,
        "levels": [],
    }
    # one resampling for all curves: they met the same gusts
    weights = safety.resamples(
        flown.flights, generator(key % 2**32, "levels", preset.name, boundary)
    )
    for i, k in enumerate(presets.EXPONENTS):
        _rows(
            rows,
            preset.name,
            boundary,
            model.name if k else "none",
            k,
            -1,
            flown,
            i,
            energy.cost(flown.ratio[i], "thrust"),
        )
        for risk in chosen.risks:
            values = safety.levels(flown.target_z_hat, flown.crashed[i], risk, weights)
            levels.flown[boundary, k, risk] = safety.held(flown.target_z_hat, values)
            entry["levels"].append({"exponent": k, **_level(flown, values, risk)})
    rng = generator(key % 2**32, "variants", preset.name, boundary)
    varied, tested = variants.levels(boundary, curves, presets.EXPONENTS, own, **how, rng=rng)
    levels.varied.update(varied)
    entry["variants"] = asdict(tested)
    return flown, tested, entry


def _level(flown: Sweep, values: FloatArray, risk: float) -> dict[str, Any]:
    """The lowest set-point for a risk, with the flights' own uncertainty."""
    lo90, hi90 = safety.spread90(values)
    return {
        "risk": risk,
        "value": float(values[0]),
        "lo90": lo90,
        "hi90": hi90,
        "lowest_flown": float(flown.target_z_hat[0]),
    }


def _fitted(
    job: Job, belief: Belief, chosen: Simulate, craft: Craft, key: int, rows: Rows
) -> tuple[Sweep, dict[str, Any]]:
    """The campaign's model, its best estimate and every draw of it, and no model at all for
    comparison.
    """
    boundary = belief.boundary
    how = _how(chosen, boundary, craft)
    usual = presets.TARGETS[boundary]
    targets = np.array(
        chosen.set_points.get(boundary, usual[usual > how["groups"].contact].tolist())
    )
    members = range(-1, belief.number)
    curves = tabulate([np.ones_like, *(belief.ratio(m) for m in members)], bound(belief, chosen))
    droops = [0.0, *(belief.droop(chosen.supply_end, m) for m in members)]
    flown = sweep(
        boundary,
        curves,
        targets,
        how["groups"],
        scheme=how["scheme"],
        steps_per_hold=how["steps_per_hold"],
        step_s=how["step_s"],
        flights=chosen.flights,
        key=key,
        spread=spread(job),
        droops=droops,
        checked=(0, 1),
    )
    costs = [energy.cost(r, job.campaign.rig.held) for r in flown.ratio]
    _rows(rows, "fitted", boundary, "none", 0.0, -1, flown, 0, costs[0])
    for i, m in enumerate(members, start=1):
        _rows(rows, "fitted", boundary, belief.model.name, 1.0, m, flown, i, costs[i])
    rng = generator(job.seed, "levels", "fitted", boundary)
    entry: dict[str, Any] = {
        "model": belief.model.name,
        "title": belief.title,
        "parameters": dict(belief.best),
        "effects": list(belief.effects),
        "left_on_the_bench": list(belief.left),
        "draws_from": belief.source,
        "draws": belief.number,
        "bound_z_hat": curves.low,
        "measured_z_hat": list(belief.measured_z_hat),
        "droop": droops[1],
        "held": job.campaign.rig.held,
        "flights": flown.flights,
        "groups": asdict(how["groups"]),
        "spacing_hat": belief.arguments.get("spacing_hat"),
        "convergence": asdict(flown.convergence),
        "levels": [_levels_of_draws(flown, risk, rng) for risk in chosen.risks],
        "front_z_hat": flown.target_z_hat[energy.front(costs[1][1], flown.rate[1])].tolist(),
        "best_set_points": _best(flown, costs, chosen.crash_prices, rng),
    }
    return flown, entry


def _levels_of_draws(flown: Sweep, risk: float, rng: np.random.Generator) -> dict[str, Any]:
    """The lowest set-point for a risk with the model's uncertainty and the flights' together;
    without a model for comparison.
    """
    weights = safety.resamples(flown.flights, rng)
    per_draw = [
        safety.levels(flown.target_z_hat, c, risk, weights[: safety.PER_DRAW])
        for c in flown.crashed[2:]
    ]
    own, none = (safety.levels(flown.target_z_hat, flown.crashed[i], risk, weights) for i in (1, 0))
    lo90, hi90 = safety.spread90(np.concatenate(per_draw))
    model_lo, model_hi = safety.spread90(np.array([v[0] for v in per_draw]))
    return {
        **_level(flown, own, risk),
        "lo90": lo90,
        "hi90": hi90,
        "model_only": [model_lo, model_hi],
        "without_model": float(none[0]),
    }


def _best(
    flown: Sweep, costs: list[Any], prices: list[float], rng: np.random.Generator
) -> list[dict[str, Any]]:
    """For each price of a crash the set-point of least expected cost, over draws of the model and
    resamples of the flights; or a refusal.
    """
    z_hat = flown.target_z_hat
    drawn = [
        (c[1], safety.rate_draws(crashed, safety.PER_DRAW, rng))
        for c, crashed in zip(costs[2:], flown.crashed[2:], strict=True)
    ]
    found = []
    for price in prices:
        own = energy.choose(z_hat, costs[1][1], flown.crashed[1].sum(axis=1), flown.flights, price)
        each = [
            z_hat[energy.best_set_point(z_hat, c, r, price)[0]] for c, rates in drawn for r in rates
        ]
        lo90, hi90 = safety.spread90(np.array(each)) if own.resolved else (None, None)
        told = asdict(own)
        index = told.pop("index")
        found.append(
            {
                "price": price,
                "target_z_hat": float(z_hat[index]) if own.resolved else None,
                "lo90": lo90,
                "hi90": hi90,
                "farthest": index == len(z_hat) - 1,
                **told,
            }
        )
    return found


def _rows(
    rows: Rows,
    preset: str,
    boundary: Boundary,
    model: str,
    exponent: float,
    member: int,
    flown: Sweep,
    i: int,
    cost: tuple[FloatArray, ...],
) -> None:
    crashes = flown.crashed[i].sum(axis=1)
    low, high = safety.binomial90(crashes, flown.flights)
    for j, z in enumerate(flown.target_z_hat):
        rows.append(
            {
                "preset": preset,
                "boundary": boundary,
                "model": model,
                "exponent": exponent,
                "member": member,
                "target_z_hat": float(z),
                "flights": flown.flights,
                "crashes": int(crashes[j]),
                "rate": float(crashes[j] / flown.flights),
                "lo90": float(low[j]),
                "hi90": float(high[j]),
                "ratio": float(flown.ratio[i, j]),
                "cost_paper": float(energy.paper_cost(flown.ratio[i, j])),
                "cost": float(cost[1][j]),
                "cost_lo": float(cost[0][j]),
                "cost_hi": float(cost[2][j]),
            }
        )


def _roll(job: Job, chosen: Simulate) -> dict[str, Any]:
    """What a sidewall's differential lift does, from the paper's numbers and from this campaign's
    fit where it has a sidewall.
    """
    content: dict[str, Any] = {"paper": [asdict(r) for r in roll.PAPER_READINGS]}
    if (
        "sidewall" in job.read_json(FIT)["boundaries"]
        and job.campaign.vehicle.rotors == 4
        and job.campaign.vehicle.rotor_spacing
    ):
        belief = believe(job, "sidewall", 400)
        content["fitted"] = roll.of_belief(
            [belief.ratio(m) for m in range(-1, belief.number)],
            belief.measured_z_hat[0],
            mass_kg=job.campaign.vehicle.mass,
            gravity_m_s2=job.campaign.rig.gravity,
            arm_m=job.campaign.vehicle.rotor_spacing / 2,
            spacing_hat=job.campaign.vehicle.rotor_spacing / job.campaign.vehicle.rotor_radius,
            inertia_kg_m2=chosen.roll_inertia,
            u_inertia=(
                roll.INERTIA_SPREAD
                if chosen.roll_inertia_uncertainty is None
                else chosen.roll_inertia_uncertainty
            ),
            rng=generator(job.seed, "roll"),
        )
    return content


def _note(notes: list[str], what: str, c: safety.Convergence) -> None:
    if not c.converged:
        notes.append(
            f"{what}: a step of {c.step_s:g} s is too long: halving it changes the crash rate by"
            f" {c.worst:.2f} at z_hat {c.worst_target_z_hat:g} ({c.beyond} of {c.settings} settings"
            " leave their interval)"
        )
