"""Stage fit: least squares, profiles, posteriors, and the result to quote."""

from __future__ import annotations

from nearlift.run import tables
from nearlift.run.engine import Job, Option, Outcome, Stage
from nearlift.run.tables import Product, integer, real, text
from nearlift.stages.ingest import TRIALS

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
PROFILES = Product(
    file="profiles.parquet",
    title="Profile likelihoods",
    row=(
        "a value of one coefficient of one model at one boundary, everything else at its best there"
    ),
    columns=(
        text("boundary", "ground, ceiling or sidewall"),
        text("model", "name of the lift model"),
        text("parameter", "name of the coefficient"),
        real("value", "", "the value at which it is held, in the coefficient's unit"),
        real("rise", "1", "chi2 above its least, L_inf and the other coefficients optimised"),
        real("quadratic", "1", "the same as the standard uncertainty would have it"),
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
    from nearlift.stages.model_fits import fit_boundaries

    trials = job.read(TRIALS)
    digest = tables.sha256(job.processed / TRIALS.file)
    fits = fit_boundaries(trials, job.campaign, job.seed, digest, job.say)
    job.write(POSTERIOR, tables.stacked(POSTERIOR, fits.draws))
    job.write(PROFILES, tables.stacked(PROFILES, fits.profiles))
    job.save(fits.results)
    job.save(fits.quoted)
    if job.campaign.fit.netcdf:
        write_netcdf(job)
    else:
        # draws of an earlier fit would be taken for this one's
        job.remove("processed/posterior.nc")
    return Outcome(notes=fits.notes)


def write_netcdf(job: Job) -> str:
    """Write posterior.nc; returns its path."""
    from nearlift.results.fit import FitResults
    from nearlift.stages import netcdf
    from nearlift.version import __version__

    about = {
        "created_by": f"nearlift {__version__}",
        "campaign": job.campaign.name,
        "data_sha256": tables.sha256(job.processed / TRIALS.file),
    }
    content = netcdf.content(job.read(POSTERIOR), job.load(FitResults), about)
    return str(job.put(f"processed/{netcdf.FILE}", content))


STAGE = Stage(
    name="fit",
    run=run,
    summary="lift models by least squares, and their posteriors",
    reads=(TRIALS,),
    writes=(FIT, PROFILES, POSTERIOR, RESULTS),
    sections=("vehicle", "rig", "load_cell", "trials", "levels", "uncertainty", "fit"),
    options=(
        Option(
            flag="--ess",
            limits=(100, 1_000_000),
            help="Effective draws, instead of the manifest's [fit] ess, this once.",
        ),
    ),
)
