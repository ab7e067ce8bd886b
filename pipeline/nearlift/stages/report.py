"""report: every figure as .pdf, .png and .csv, documents for papers, and index.html. matplotlib is
imported only here.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from nearlift.products import FIT, FLOW_PRODUCTS, PRODUCTS, RESULTS, TRIALS
from nearlift.report.evidence import Columns, Evidence
from nearlift.results.serial import Json
from nearlift.run import store
from nearlift.run.job import Job, Outcome
from nearlift.stages import overlays
from nearlift.stages.observe import boundaries, observe
from nearlift.stages.trial_table import trial_table

if TYPE_CHECKING:
    from nearlift.campaign.manifest import Campaign
    from nearlift.report.figures.files import Draw
    from nearlift.report.figures.spec import FigureSpec

#: Products without which there is nothing to report.
NEEDED = (TRIALS, FIT, RESULTS)


def run(job: Job) -> Outcome:
    """Make the whole report again; remove the files of a figure whose products are missing."""
    from nearlift.report.figures.files import render
    from nearlift.report.figures.style import style_of
    from nearlift.report.page.render import Picture, page
    from nearlift.report.registry import FIGURES, charts
    from nearlift.report.tidy import to_csv

    look = style_of(job.campaign)
    evidence = gather(job)
    pictures, missing = [], []
    for i, spec in enumerate(FIGURES):
        job.say(f"report {spec.name}", i / len(FIGURES))
        rows = spec.summarise(evidence) if evidence.has(*spec.needs) else {}
        if not any(len(column) for column in rows.values()):
            missing += [spec.name] if _expected(job, spec) else []
            for kind in ("pdf", "png", "csv"):
                job.remove(f"reports/{spec.name}.{kind}")
            continue
        files = render(spec.draw, rows, look) | {"csv": to_csv(rows)}
        for kind, content in files.items():
            job.publish(f"{spec.name}.{kind}", content)
        pictures.append(
            Picture(
                name=spec.name,
                title=spec.title,
                caption=spec.caption(evidence, rows),
                alt=spec.alt(evidence, rows),
                png=files["png"],
            )
        )
    _documents(job, evidence)
    job.publish("index.html", page(evidence, pictures, charts=charts(evidence)))
    return Outcome(
        notes=tuple(f"{name} was not drawn: its products are missing or empty" for name in missing)
    )


def _documents(job: Job, evidence: Evidence) -> None:
    """Texts and tables."""
    from nearlift.report.documents import methods, summary, tables
    from nearlift.report.tidy import to_csv

    for name in ("coefficients", "budget", "comparison"):
        job.publish(f"tables/{name}.tex", getattr(tables, f"{name}_table")(evidence).encode())
        job.publish(f"tables/{name}.csv", to_csv(getattr(tables, name)(evidence)))
    for name, written in (
        ("summary.txt", summary.summary),
        ("methods.md", methods.markdown),
        ("methods.tex", methods.tex),
        ("references.bib", methods.references),
    ):
        job.publish(name, written(evidence))


def gather(job: Job) -> Evidence:
    """Everything that some figure or chapter reads, in memory; provenance.json is not among it,
    since times stand there.
    """
    from nearlift.report.registry import CHAPTERS, FIGURES
    from nearlift.run.provenance import versions

    read = (
        {p for spec in FIGURES for p in spec.needs}
        | {p for chapter in CHAPTERS for p in chapter.needs}
        | {RESULTS}
    )
    tables: dict[str, store.Table] = {}
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
            tables[product.file] = job.read(product)
        digests[product.file] = store.sha256(path)
    trials = tables[TRIALS.file]
    fitted = documents[FIT.file]["boundaries"]
    return Evidence(
        campaign=job.campaign,
        tables=tables,
        documents=documents,
        observations={
            b: observe(trials, job.campaign, b) for b in boundaries(trials) if b in fitted
        },
        overlays=overlays.read(job.root, job.campaign),
        digests=digests,
        inputs=dict(job.inputs),
        versions=versions(),
        seed=job.seed,
        trial_table=partial(trial_table, job),
    )


def _expected(job: Job, spec: FigureSpec) -> bool:
    """Whether the campaign asks for the figure, and for every stage that makes what it shows."""
    from nearlift.run.registry import STAGES

    return spec.asked(job.campaign) and all(
        stage.configured(job) for stage in STAGES if not set(stage.writes).isdisjoint(spec.needs)
    )


def for_print(draw: Draw, table: Columns, campaign: Campaign | None = None) -> dict[str, bytes]:
    """The files of one figure that is not part of the report: pdf, png and csv, in the style that a
    campaign asks for.
    """
    from nearlift.report.figures.files import render
    from nearlift.report.figures.style import Style, style_of
    from nearlift.report.tidy import to_csv

    style = style_of(campaign) if campaign else Style()
    return render(draw, table, style) | {"csv": to_csv(table)}
