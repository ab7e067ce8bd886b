"""joint: a boundary's base model fitted to lift and downwash together, where it is asked for."""

from __future__ import annotations

import numpy as np

from nearlift.declare import Boundary
from nearlift.errors import ManifestError, NearliftError
from nearlift.fit.joint import DownwashRatio, fit_joint
from nearlift.fit.least_squares import fit
from nearlift.flow.downwash import NOT_AT_THE_DISK
from nearlift.likelihood import budget
from nearlift.manifest.campaign import Campaign
from nearlift.products import DOWNWASH, TRIALS
from nearlift.results.joint import BoundaryJointFit, JointResults, LeftOutCase
from nearlift.run.job import Job, Outcome
from nearlift.run.store import Table
from nearlift.stages.fit import choice
from nearlift.stages.observe import boundaries, observe

LEVEL_RAD = 1e-3


def run(job: Job) -> Outcome:
    """Fit each boundary that asks for it; one that cannot be is noted."""
    asked = job.campaign.joint
    if asked is None:
        raise ManifestError(
            "fit.<boundary>.downwash",
            "is not asked for",
            "say downwash = true under [fit.ground] or [fit.ceiling]",
        )
    trials, table = job.read(TRIALS), job.read(DOWNWASH)
    parts = budget.components(job.campaign)
    fits: dict[Boundary, BoundaryJointFit] = {}
    notes = []
    for boundary in asked:
        if boundary not in boundaries(trials):
            notes.append(f"{boundary}: no joint fit: no trial was accepted")
            continue
        job.say(f"joint {boundary}")
        measured = select(table, job.campaign, boundary)
        data = observe(trials, job.campaign, boundary)
        base, _ = choice(job.campaign, boundary)
        try:
            fits[boundary] = fit_joint(fit(base, data, parts), data, measured, parts)
        except NearliftError as fault:
            notes.append(f"{boundary}: no joint fit: {fault.what}; {fault.remedy}")
    job.save(JointResults(boundaries=fits))
    return Outcome(notes=tuple(notes))


def select(table: Table, campaign: Campaign, boundary: Boundary) -> DownwashRatio:
    """The downwash of the untilted cases whose cut stands for the inflow at the disk."""
    assert campaign.piv is not None
    whole = table["rotor"] == "all"
    u_relative = (
        np.sqrt(sum(table[f"u_{part}_m_s"] ** 2 for part in ("noise", "mask", "position")))
        / table["downwash_m_s"]
    )
    (control,) = np.flatnonzero(whole & (table["case"] == campaign.piv.control))
    used, left_out = [], []
    for i in np.flatnonzero(whole & (table["boundary"] == boundary)):
        why = next((w for w in str(table["warnings"][i]).split() if w in NOT_AT_THE_DISK), "")
        if abs(table["tilt_rad"][i]) > LEVEL_RAD:
            why = "tilted"
        elif not why and not (table["downwash_m_s"][i] > 0 and np.isfinite(u_relative[i])):
            why = "no downwash, or no uncertainty"
        if why:
            left_out.append(LeftOutCase(case=str(table["case"][i]), reason=why.replace("_", " ")))
        else:
            used.append(i)
    at = np.array(used, dtype=np.int64)
    return DownwashRatio(
        z_hat=table["z_hat"][at],
        ratio=table["downwash_m_s"][at] / table["downwash_m_s"][control],
        u_own=u_relative[at],
        u_control=float(u_relative[control]),
        used=tuple(str(table["case"][i]) for i in used),
        left_out=tuple(left_out),
    )
