"""Stage fit: least squares, profiles, posteriors, and the result to quote."""

from __future__ import annotations

from nearlift.run.declarations.ingest import TRIALS
from nearlift.run.schema import Column, Product
from nearlift.run.stage import Option, Stage

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
        Column(name="boundary", kind="text", meaning="ground, ceiling or sidewall"),
        Column(name="model", kind="text", meaning="name of the lift model"),
        Column(name="parameter", kind="text", meaning="name of the coefficient"),
        Column(name="value", meaning="the value at which it is held, in the coefficient's unit"),
        Column(
            name="rise",
            unit="1",
            meaning="chi2 above its least, L_inf and the other coefficients optimised",
        ),
        Column(
            name="quadratic", unit="1", meaning="the same as the standard uncertainty would have it"
        ),
    ),
)
POSTERIOR = Product(
    file="posterior.parquet",
    title="Posterior draws",
    row="a draw of one parameter of one model at one boundary",
    columns=(
        Column(name="boundary", kind="text", meaning="ground, ceiling or sidewall"),
        Column(name="model", kind="text", meaning="name of the lift model"),
        Column(
            name="chain",
            kind="integer",
            meaning="walker of emcee, or one of four hands that independent draws were dealt to",
        ),
        Column(name="draw", kind="integer", meaning="position in the chain, thinned"),
        Column(
            name="parameter",
            kind="text",
            meaning=(
                "name of the parameter; for base models also L_inf_N[throttle], that throttle's"
                " lift far away"
            ),
        ),
        Column(name="value", meaning="value, in the parameter's unit (L_inf in N)"),
        Column(
            name="log_prob",
            meaning=(
                "log posterior density of the draw's parameters, L_inf integrated out; not"
                " normalised"
            ),
        ),
    ),
)
STAGE = Stage(
    name="fit",
    summary="lift models by least squares, and their posteriors",
    reads=(TRIALS,),
    writes=(FIT, PROFILES, POSTERIOR, RESULTS),
    sections=("vehicle", "rig", "load_cell", "trials", "uncertainty", "fit"),
    options=(
        Option(
            flag="--sampler",
            choices=("auto", "emcee", "importance"),
            help="Instead of the manifest's [fit] sampler, this once.",
        ),
        Option(
            flag="--ess",
            limits=(100, 1_000_000),
            help="Effective draws, instead of the manifest's [fit] ess, this once.",
        ),
    ),
)
