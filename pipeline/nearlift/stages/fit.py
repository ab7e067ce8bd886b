"""Stage fit: least squares, profiles, posteriors, and the result to quote."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nearlift.errors import InputRefused
from nearlift.run import tables
from nearlift.run.engine import Job, Outcome, Stage, subprogress
from nearlift.run.tables import Product, integer, real, text
from nearlift.stages.ingest import TRIALS

if TYPE_CHECKING:
    from nearlift.results.fit import FitResults

FIT = Product(
    file="fit.json", title="Fits: least squares and posterior", row="boundary, then model"
)
RESULTS = Product(
    file="results.json",
    title="The one result to quote",
    row=(
        "boundary: verdict, effects, and each coefficient with interval, budget, influence and"
        " doubts; by fit alone until diagnosed"
    ),
)
POSTERIOR = Product(
    file="posterior.parquet",
    title="Posterior draws",
    row="a draw of one parameter of one model at one boundary",
    columns=(
        text("boundary", "ground, ceiling or sidewall"),
        text("model", "name of the lift model"),
        integer("chain", "walker of emcee, or one of four parts of independent draws"),
        integer("draw", "position in the chain, thinned"),
        text(
            "parameter",
            "name of the parameter; for base models also L_inf_N[throttle], that throttle's"
            " lift far away",
        ),
        real("value", "", "value, in the parameter's unit (L_inf in N)"),
        real(
            "log_prob",
            "",
            "log posterior density of the draw's parameters, L_inf integrated out; not normalised",
        ),
    ),
)


def run(job: Job) -> Outcome:
    """Fit base and rivals of every boundary; a rival that fails is noted, a base that fails ends
    the run with exit code 5.
    """
    from nearlift.fit.models import Fits, fit_boundary
    from nearlift.observed import boundaries, choice, observe
    from nearlift.results.quotation import Results

    trials = job.read(TRIALS)
    digest = tables.sha256(job.processed / TRIALS.file)
    present = boundaries(trials)
    if not present:
        raise InputRefused(
            job.campaign.name,
            "no trial was accepted, so there is nothing to fit",
            "trials.parquet gives the reason for each",
        )
    outlying = [
        str(trial)
        for trial, codes in zip(trials["trial"], trials["quality"], strict=True)
        if "outlying" in codes.split()
    ]
    observed = {b: observe(trials, job.campaign, b) for b in present}
    # the fits need its memory
    del trials
    choices = {b: choice(job.campaign, b) for b in present}
    models = {b: (base, *rivals) for b, (base, rivals) in choices.items()}
    count, begun, fits = sum(map(len, models.values())), 0, Fits()
    for boundary, chosen in models.items():
        steps = {m.name: subprogress(job.say, begun + i, count) for i, m in enumerate(chosen)}
        fit_boundary(
            fits,
            observed[boundary],
            chosen,
            job.campaign,
            job.seed,
            digest,
            outlying=outlying,
            say=steps,
        )
        begun += len(chosen)
    draws = tables.stacked(POSTERIOR, fits.draws)
    job.write(POSTERIOR, draws)
    job.write(FIT, fits.results)
    job.write(RESULTS, Results(boundaries=fits.quoted))
    if job.campaign.fit.netcdf:
        write_netcdf(job, draws, fits.results)
    else:
        # draws of an earlier fit would be taken for this one's
        job.put("processed/posterior.nc", None)
    return Outcome(notes=tuple(fits.notes))


def write_netcdf(job: Job, draws: tables.Table, results: FitResults) -> str:
    """Write posterior.nc; returns its path."""
    from nearlift.fit import netcdf
    from nearlift.version import __version__

    about = {
        "created_by": f"nearlift {__version__}",
        "campaign": job.campaign.name,
        "data_sha256": tables.sha256(job.processed / TRIALS.file),
    }
    content = netcdf.content(draws, results, about)
    return str(job.put(f"processed/{netcdf.FILE}", content))


STAGE = Stage(
    name="fit",
    run=run,
    imports=("nearlift.compiler", "lmfit", "emcee", "nearlift.fit.models"),
    summary="fit lift models by least squares, with posteriors",
    reads=(TRIALS,),
    writes=(FIT, POSTERIOR, RESULTS),
    sections=("vehicle", "rig", "load_cell", "trials", "levels", "uncertainty", "fit"),
)
