"""Evidence of a report: all products that some figure or chapter reads, in memory."""

from __future__ import annotations

from nearlift.observed import boundaries, observe
from nearlift.report.evidence import Evidence
from nearlift.results.document import Json
from nearlift.run import tables
from nearlift.run.engine import Job, versions
from nearlift.stages import PRODUCTS
from nearlift.stages.diagnose import QUOTED_POSTERIOR
from nearlift.stages.fit import FIT, RESULTS
from nearlift.stages.flow import FLOW_PRODUCTS
from nearlift.stages.ingest import TRIALS

#: Products without which there is nothing to report.
NEEDED = (TRIALS, FIT, RESULTS)


def gather(job: Job) -> Evidence:
    """The products of a campaign that the report shows, and what the page says of their making."""
    from nearlift.report.registry import CHAPTERS, FIGURES

    read = (
        {p for spec in FIGURES for p in spec.needs}
        | {p for chapter in CHAPTERS for p in chapter.needs}
        | {RESULTS, QUOTED_POSTERIOR}
    )
    read_tables: dict[str, tables.Table] = {}
    documents: dict[str, Json] = {}
    digests = {}
    for product in PRODUCTS:
        path = job.processed / product.file
        gone = product in FLOW_PRODUCTS and job.campaign.piv is None
        if product not in read or gone or (product not in NEEDED and not path.is_file()):
            continue
        if path.suffix == ".json":
            documents[product.file] = job.read_json(product)
        else:
            read_tables[product.file] = job.read(product)
        digests[product.file] = tables.sha256(path)
    trials = read_tables[TRIALS.file]
    fitted = documents[FIT.file]["boundaries"]
    return Evidence(
        campaign=job.campaign,
        tables=read_tables,
        documents=documents,
        observations={
            b: observe(trials, job.campaign, b) for b in boundaries(trials) if b in fitted
        },
        digests=digests,
        inputs=dict(job.inputs),
        versions=versions(),
        folder=job.root.resolve().name,
        seed=job.seed,
    )
