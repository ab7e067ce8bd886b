"""What stage fit does with posteriors: sample each model's, keep the draws as rows, and write its
part of fit.json.
"""

from __future__ import annotations

import functools
import hashlib
import json
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit import gum, posterior
from nearlift.fit.density import Density
from nearlift.fit.grid import grid
from nearlift.fit.learnt import beside_fit, learnt
from nearlift.fit.least_squares import Fit
from nearlift.fit.posterior import Posterior, Settings
from nearlift.products import POSTERIOR, TRIALS
from nearlift.run import store
from nearlift.run.checkpoint import Checkpoint
from nearlift.run.job import Job
from nearlift.run.store import Table


@dataclass(kw_only=True)
class Posteriors:
    """The posteriors of one campaign as they come."""

    job: Job
    parts: list[dict[str, Any]] = field(default_factory=list)

    @functools.cached_property
    def settings(self) -> Settings:
        """What the manifest asks for."""
        asked = self.job.campaign.fit
        return Settings(sampler=asked.sampler, ess=asked.ess, steps=asked.steps)

    @functools.cached_property
    def _key(self) -> str:
        """Digest of everything that decides the draws: as the ledger has it for stage fit."""
        from nearlift.run.provenance import Provenance
        from nearlift.run.registry import stage

        material = Provenance.open(self.job).material(stage("fit"))
        return hashlib.sha256(json.dumps(material, sort_keys=True).encode()).hexdigest()

    def add(self, fitted: Fit, base: bool) -> dict[str, Any]:
        """Sample one model's posterior; returns what fit.json says of it. L_inf of each throttle is
        kept for base models.
        """
        boundary, name = fitted.problem.data.boundary, fitted.model.name
        density = Density(problem=gum.stand_in(fitted), centre=fitted.theta, dof=fitted.dof_of_all)
        checkpoint = Checkpoint(
            folder=self.job.unfinished("fit"), name=f"{boundary}-{name}", key=self._key
        )
        found = posterior.sample(
            density,
            self.settings,
            self.job.seed,
            boundary,
            name,
            stored=checkpoint.read(),
            keep=checkpoint.keep,
        )
        throttles = fitted.problem.data.levels
        columns = {n: found.theta[:, :, i] for i, n in enumerate(found.names)}
        if base:
            columns |= {level_name(t): found.levels_N[:, :, i] for i, t in enumerate(throttles)}
        self.parts += [
            _rows(boundary, name, n, values, found.log_prob) for n, values in columns.items()
        ]
        entry = _record(density, found, fitted)
        for i, parameter in enumerate(fitted.names):
            if fitted.effective[i] == 0:
                # the draws know only what trials of one visit do not share
                entry["parameters"][parameter] |= {"lo90": -math.inf, "hi90": math.inf}
        return {"model": name, "data_sha256": self._data, **entry}

    @functools.cached_property
    def _data(self) -> str:
        return store.sha256(self.job.processed / TRIALS.file)

    def write(self) -> None:
        """All draws to posterior.parquet."""
        self.job.write(
            POSTERIOR,
            {c.name: np.concatenate([p[c.name] for p in self.parts]) for c in POSTERIOR.columns}
            if self.parts
            else _empty(),
        )


LEVEL = "L_inf_N"


def level_name(throttle: float) -> str:
    """How L_inf at a throttle (a fraction) is called in posterior.parquet."""
    return f"{LEVEL}[{throttle:g}]"


def split_level(name: str) -> float:
    """The throttle in such a name."""
    return float(name.removeprefix(f"{LEVEL}[").removesuffix("]"))


def _rows(boundary: str, model: str, name: str, values: FloatArray, log_prob: FloatArray) -> Table:
    chains, draws = values.shape
    n = values.size
    return {
        "boundary": np.full(n, boundary, dtype=object),
        "model": np.full(n, model, dtype=object),
        "chain": np.repeat(np.arange(chains), draws),
        "draw": np.tile(np.arange(draws), chains),
        "parameter": np.full(n, name, dtype=object),
        "value": values.ravel(),
        "log_prob": log_prob.ravel(),
    }


def _empty() -> Table:
    return {
        c.name: np.zeros(0, dtype=object if c.kind == "text" else float) for c in POSTERIOR.columns
    }


SHOWN = np.array([0.05, 0.5, 0.95])


def _spread(draws: FloatArray, unit: str) -> dict[str, Any]:
    return _entry(draws.mean(), draws.std(), np.quantile(draws, SHOWN), unit)


def _entry(mean: float, sd: float, quantiles: FloatArray, unit: str) -> dict[str, Any]:
    low, median, high = quantiles
    return {"value": mean, "u": sd, "median": median, "lo90": low, "hi90": high, "unit": unit}


def _marginal(density: Density, draws: FloatArray, unit: str) -> dict[str, Any]:
    """One parameter's spread: where it is the only one by the grid that judges the draws, which has
    no Monte Carlo error; else by the draws.
    """
    if len(density.problem.names) == 1 and draws.std() > 0:
        exact = grid(density, np.array([draws.mean()]), np.array([[draws.var()]]))
        if exact.resolved:
            return _entry(*exact.moments(0), exact.quantiles(SHOWN), unit)
    return _spread(draws, unit)


def _record(density: Density, found: Posterior, fitted: Fit) -> dict[str, Any]:
    throttles = fitted.problem.data.levels
    parameters = {}
    for i, belief in enumerate(density.beliefs.each):
        draws = found.theta[:, :, i].ravel()
        said = learnt(belief, draws)
        estimate = fitted.estimates[belief.parameter.name]
        over_fit, why = beside_fit(belief, draws, estimate.lo90, estimate.hi90)
        parameters[belief.parameter.name] = {
            **_marginal(density, draws, belief.parameter.unit),
            "ess": found.ess[i],
            "ess_tail": found.ess_tail[i],
            "r_hat": found.r_hat[i],
            "tau": found.tau[i],
            "prior": {
                "text": said.prior,
                "lo90": said.prior_lo90,
                "hi90": said.prior_hi90,
                "bounds": list(belief.parameter.bounds),
            },
            "width_ratio": said.ratio,
            "at_low": said.at_low,
            "at_high": said.at_high,
            "width_over_fit": over_fit,
            "words": "; ".join(filter(None, (said.words, why))),
            "unlike_fit": why,
        }
    return {
        "sampler": found.sampler,
        "chains": found.log_prob.shape[0],
        "draws": found.log_prob.shape[1],
        "ess": found.ess.min() if len(found.ess) else None,
        "r_hat": found.r_hat.max() if len(found.r_hat) else None,
        "tau": found.tau.max() if len(found.tau) else None,
        "acceptance": found.acceptance,
        "steps": found.steps,
        "pareto_k": found.pareto_k,
        "noise_dof": density.dof,
        "checks": [
            {"by": c.by, "apart": c.apart, "where": c.where, "unfit": c.unfit} for c in found.checks
        ],
        "parameters": parameters,
        "L_inf_N": {
            f"{t:g}": _spread(found.levels_N[:, :, i].ravel(), "N") for i, t in enumerate(throttles)
        },
        "log_evidence": {"value": found.log_evidence, "u": found.u_log_evidence},
    }
