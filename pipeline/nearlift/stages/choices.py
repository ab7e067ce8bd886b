"""Models and options that a manifest chooses, and the findings that are on the disk."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from nearlift import catalogue
from nearlift.campaign.manifest import Campaign
from nearlift.declare import Boundary, LiftModel
from nearlift.errors import ManifestError
from nearlift.loop.search_problem import Options
from nearlift.results.diagnosis import NOTHING, BoundaryDiagnosis, DiagnosisResults
from nearlift.run import tables

#: What of the manifest gives a model the geometry that it needs; the rest is columns of trials.
GIVEN_BY = {
    **dict.fromkeys(("spacing_hat", "diagonal_hat", "layout_hat"), "rotor_spacing in [vehicle]"),
    "gap_hat": "gap in [rig]",
    "edge_hat": "edge in [rig]",
}


def choice(campaign: Campaign, boundary: Boundary) -> tuple[LiftModel, tuple[LiftModel, ...]]:
    """Base model and rivals of one boundary: the manifest's, else the vehicle's defaults."""
    chosen = campaign.fit.choice(boundary)
    vehicle, geometry = campaign.vehicle, campaign.geometry()
    base = catalogue.model(
        chosen.base if chosen and chosen.base else catalogue.default_base(boundary, vehicle.rotors)
    )
    names: Iterable[str] | None = chosen.rivals if chosen else None
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


def search_options(campaign: Campaign, seed: int) -> Options:
    """The search's options that a manifest may set."""
    asked = campaign.diagnose
    return Options(
        seed=seed,
        false_alarm_rate=asked.false_alarm_rate,
        not_feasible=tuple(asked.not_feasible),
    )


def diagnosed(processed: Path) -> dict[Boundary, BoundaryDiagnosis]:
    """Findings of the loop at each boundary that it could diagnose; none where it has not run."""
    diagnosis = tables.load_if_whole(processed / DiagnosisResults.file, NOTHING)
    return {b: d for b, d in diagnosis.boundaries.items() if isinstance(d, BoundaryDiagnosis)}
