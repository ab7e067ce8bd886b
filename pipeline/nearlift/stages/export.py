"""export: the posterior as netCDF, and the fitted lift models as C header, JSON and Python module.

Lift models are written to export/ in the campaign's folder of products. A new format is one more
entry of `FORMATS`, and a flag of the command.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import UTC, datetime

from nearlift.campaign.manifest import boundaries_of
from nearlift.flight.export.lift_model import SCHEMA, c_header, exported, python_module
from nearlift.results.document import as_json
from nearlift.results.fit import FitResults
from nearlift.results.quotation import Results
from nearlift.run import tables
from nearlift.run.engine import Job
from nearlift.stages.diagnose import quoted_lifts
from nearlift.stages.fit import POSTERIOR, write_netcdf
from nearlift.stages.ingest import TRIALS
from nearlift.version import __version__

DRAWS = 2000


def model_export(job: Job) -> dict[str, object]:
    """Exported lift models, dated by the newest raw file: the same data give the same bytes."""
    quoted = quoted_lifts(job)
    lifts = {b: quoted.lift(b, DRAWS) for b in boundaries_of(quoted.results.boundaries)}
    raw = [p for name in job.inputs if (p := job.root / name).is_file()]
    newest = max((p.stat().st_mtime for p in raw), default=None)
    return {
        "schema": SCHEMA,
        "campaign": job.campaign.name,
        "nearlift": __version__,
        "trials_sha256": tables.sha256(job.processed / TRIALS.file),
        "date": (
            "unknown" if newest is None else datetime.fromtimestamp(newest, UTC).date().isoformat()
        ),
        "rotor_radius_m": job.campaign.vehicle.rotor_radius,
        "held": job.campaign.rig.held,
        "boundaries": {b: exported(lift) for b, lift in lifts.items()},
        "source": Results.file,
    }


def _save(job: Job, name: str, text: str) -> str:
    return str(job.put(f"processed/export/{name}", text.encode()))


def write_c(job: Job) -> str:
    """lift_model.h."""
    return _save(job, "lift_model.h", c_header(model_export(job)))


def write_python(job: Job) -> str:
    """lift_model.py."""
    return _save(job, "lift_model.py", python_module(model_export(job)))


def write_json(job: Job) -> str:
    """lift_model.json."""
    content = as_json(model_export(job))
    return _save(job, "lift_model.json", json.dumps(content, indent=1, ensure_ascii=False) + "\n")


#: Writer of each format, which returns the path.
FORMATS: dict[str, Callable[[Job], str]] = {
    "netcdf": lambda job: write_netcdf(job, job.read(POSTERIOR), job.load(FitResults)),
    "c": write_c,
    "document": write_json,
    "python": write_python,
}


def export(job: Job, names: tuple[str, ...]) -> list[str]:
    """Write these formats; returns the paths."""
    return [FORMATS[name](job) for name in names]
