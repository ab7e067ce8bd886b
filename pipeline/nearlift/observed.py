"""Accepted trials of one boundary, and the models that a manifest chooses for it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import catalogue
from nearlift.campaign.choices import FitChoice
from nearlift.campaign.manifest import Campaign, boundaries_of
from nearlift.declare import Boundary, FloatArray, LiftModel
from nearlift.errors import ManifestError
from nearlift.flow.downwash import LEVEL_RAD, NOT_AT_THE_DISK
from nearlift.likelihood.level_curve import with_curve
from nearlift.loop.inflow import MeasuredDownwash
from nearlift.loop.interim import InterimLook
from nearlift.loop.search_problem import Options
from nearlift.nomenclature import CARRIED
from nearlift.reduction.quality import EXCLUDED, completeness, rejected
from nearlift.results import Observations
from nearlift.schedule import BY_NAME

#: Columns of trials.parquet.
Trials = Mapping[str, NDArray[Any]]
#: Columns of names that say how trials were run in two ways on purpose.
BINARY_COLUMNS = ("orientation", "propeller")
#: Numbers of trials.parquet that are the setting or the outcome of a trial: no covariates.
MEASURED = frozenset(
    {"z_hat", "z_m", "throttle", "lift_N", "u_lift_N", "u_zero_N", "n", "n_removed", "n_eff"}
    | {"sd_N", "visit", "samples"}
)
#: Keys of the manifest for the geometry that a model needs; the rest is columns of trials.
GIVEN_BY = {
    **dict.fromkeys(("spacing_hat", "diagonal_hat", "layout_hat"), "rotor_spacing in [vehicle]"),
    "gap_hat": "gap in [rig]",
    "edge_hat": "edge in [rig]",
}


def boundaries(trials: Trials) -> list[Boundary]:
    """The boundaries with at least one accepted trial, in the order ground, ceiling, sidewall."""
    good = set(trials["boundary"][~rejected(trials["quality"])])
    return boundaries_of(good)


def observe(trials: Trials, campaign: Campaign, boundary: Boundary) -> Observations:
    """The accepted trials of `boundary`, those in free air included, in run order."""
    mine = np.isin(trials["boundary"], [boundary, "none"]) & ~rejected(trials["quality"])
    covariates = {
        name: np.asarray(values[mine], dtype=float)
        for name, values in trials.items()
        if name not in MEASURED and values.dtype.kind in "fiu"
    }
    covariates |= _binary_covariates({k: v[mine] for k, v in trials.items() if k in BINARY_COLUMNS})
    for name in (*CARRIED, *CARRIED.values()):
        # an outcome measured with lift, and no condition of it
        covariates.pop(name, None)
    if campaign.load_cell.sample_rate is not None and "n" in trials:
        covariates["record_s"] = trials["n"][mine] / campaign.load_cell.sample_rate
    u_lift_N = np.nan_to_num(np.asarray(trials["u_lift_N"][mine], dtype=float))
    record = u_zero_N = None
    if campaign.cuts_records:
        # what pieces of a record share is no scatter of theirs, and what a column scatters by
        # within them is no condition that they were run under
        covariates = {k: v for k, v in covariates.items() if k != "piece" and k[:3] != "sd_"}
        record = _in_order(trials["record"][mine].astype(str))
        u_zero_N = np.nan_to_num(np.asarray(trials["u_zero_N"][mine], dtype=float))
        u_lift_N = np.sqrt(np.maximum(u_lift_N**2 - u_zero_N**2, 0.0))
    session = (
        trials["session"][mine].astype(str) if "session" in trials else np.zeros(int(mine.sum()))
    )
    data = Observations(
        boundary=boundary,
        trial=trials["trial"][mine],
        z_hat=np.asarray(trials["z_hat"][mine], dtype=float),
        lift_N=np.asarray(trials["lift_N"][mine], dtype=float),
        u_lift_N=u_lift_N,
        n_eff=np.nan_to_num(np.asarray(trials["n_eff"][mine], dtype=float), nan=1.0),
        throttle=np.asarray(trials["throttle"][mine], dtype=float),
        visit=np.asarray(trials["visit"][mine], dtype=np.int64),
        session=_in_order(session),
        radius_m=campaign.vehicle.rotor_radius,
        geometry=campaign.geometry(),
        covariates=covariates,
        record=record,
        u_zero_N=u_zero_N,
        ordered=campaign.trials.order == "run",
    )
    levels = campaign.levels
    if levels is None or levels.by == "throttle":
        return data
    names = [BY_NAME[name].inside if name in BY_NAME else name for name in levels.of]
    return with_curve(data, names, levels.degree)


def _binary_covariates(said: Trials) -> dict[str, FloatArray]:
    """`inverted` (0 upright) and `other_propeller` (0 with those of the first trial), each where
    its column is; nan where that says neither.
    """
    columns = {}
    if "orientation" in said:
        up = said["orientation"].astype(str)
        columns["inverted"] = np.select([up == "upright", up == "inverted"], [0.0, 1.0], np.nan)
    if "propeller" in said:
        on = said["propeller"].astype(str)
        columns["other_propeller"] = np.where(on == "", np.nan, np.sign(_in_order(on)))
    return columns


def _in_order(labels: np.ndarray) -> np.ndarray:
    """Labels counted 0, 1, ... in the order in which they first appear."""
    _, first, index = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return rank[index].astype(np.int64)


def interim_progress(trials: Trials, campaign: Campaign, boundary: Boundary) -> InterimLook | None:
    """Progress of the boundary's campaign, free air included; None where no trial is still to come.

    A trial is to come if neither it nor any later one has a record: what is missing between others
    was lost. In an unknown order, every missing trial is. ``[diagnose] planned_trials`` is the
    campaign's length where the schedule's is not.
    """
    coming = np.array(
        [completeness(text) in ("missing", "pending") for text in trials["quality"]], dtype=bool
    )
    if campaign.trials.order == "run":
        coming[: np.flatnonzero(~coming).max(initial=0)] = False
    coming &= np.array([EXCLUDED not in text.split() for text in trials["quality"]], dtype=bool)
    mine = np.isin(trials["boundary"], [boundary, "none"])
    past, unlisted = int((mine & ~coming).sum()), 0
    if (planned := campaign.diagnose.planned_trials) is not None:
        coming &= np.cumsum(coming) <= planned - (~coming).sum()
        unlisted = max(planned - len(coming), 0)
    left = int((mine & coming).sum()) + unlisted
    return InterimLook(trials=past, scheduled=past + left) if left else None


def choice(campaign: Campaign, boundary: Boundary) -> tuple[LiftModel, tuple[LiftModel, ...]]:
    """Base model and rivals of one boundary: the manifest's, else the vehicle's defaults."""
    chosen: FitChoice = getattr(campaign.fit, boundary)
    vehicle, geometry = campaign.vehicle, campaign.geometry()
    base = catalogue.model(chosen.base or catalogue.default_base(boundary, vehicle.rotors))
    names: Iterable[str] | None = chosen.rivals
    if names is None:
        names = catalogue.default_rivals(boundary, vehicle.rotors, geometry)
    rivals = tuple(catalogue.model(name) for name in names)
    for model in (base, *rivals):
        if model.boundary != boundary:
            raise ManifestError(
                f"fit.{boundary}",
                f"{model.name} is a {model.boundary} model",
                f"`nearlift describe` lists those of the {boundary}",
            )
        lacking = [n for n in model.needs if n in GIVEN_BY and n not in geometry]
        if lacking:
            raise ManifestError(
                f"fit.{boundary}",
                f"{model.name} needs {', '.join(lacking)}",
                f"give {', '.join(dict.fromkeys(GIVEN_BY[n] for n in lacking))}, or another model",
            )
    return base, tuple(m for m in rivals if m.name != base.name)


def search_options(campaign: Campaign, boundary: Boundary, seed: int) -> Options:
    """Options of the search at a boundary, of which a manifest may set some."""
    asked, touches = campaign.diagnose, boundary in campaign.vehicle.contact
    contact_m = campaign.contact_m(boundary) if touches else 0.0
    return Options(
        seed=seed,
        false_alarm_rate=asked.false_alarm_rate,
        not_feasible=tuple(asked.not_feasible),
        contact_z_hat=contact_m / campaign.vehicle.rotor_radius,
    )


def at_the_disk(cuts: Trials, boundary: Boundary) -> tuple[MeasuredDownwash, ...]:
    """Downwash of the level cuts near a boundary that measure the inflow at the disk.

    `cuts` are the columns of downwash.parquet.
    """
    level = (cuts["rotor"] == "all") & (cuts["boundary"] == boundary)
    level &= (np.abs(cuts["tilt_rad"]) < LEVEL_RAD) & np.isfinite(cuts["u_reduction"])
    inflow = [not {*str(w).split()} & {*NOT_AT_THE_DISK} for w in cuts["warnings"]]
    return tuple(
        MeasuredDownwash(z_hat=float(z), ratio=float(1 - reduction), u=float(u))
        for z, reduction, u in zip(
            *(cuts[n][level & inflow] for n in ("z_hat", "reduction", "u_reduction")), strict=True
        )
    )
