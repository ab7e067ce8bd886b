"""report: every figure as .pdf, .png and .csv, documents for papers, and index.html. matplotlib is
imported only here.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from nearlift.products import FIT, FLOW_PRODUCTS, PRODUCTS, RESULTS, TRIALS
from nearlift.report.evidence import Columns, Evidence
from nearlift.results.serial import Json
from nearlift.run import store
from nearlift.run.executors import Threads
from nearlift.run.job import Job, Outcome
from nearlift.stages import overlays
from nearlift.stages.observe import boundaries, observe
from nearlift.stages.trial_table import trial_table

if TYPE_CHECKING:
    from nearlift.report.drawers import Files, Give
    from nearlift.report.figures.encoding import Draw
    from nearlift.report.figures.spec import FigureSpec

#: Products without which there is nothing to report.
NEEDED = (TRIALS, FIT, RESULTS)


def run(job: Job) -> Outcome:
    """Make the whole report anew; what is left of a figure without its products is removed."""
    with _drawing(job) as give:
        return _run(job, give)


def _run(job: Job, give: Give) -> Outcome:
    from nearlift.report.figures.encoding import render
    from nearlift.report.figures.style import style
    from nearlift.report.registry import FIGURES, charts
    from nearlift.report.tidy import to_csv

    look = style(job.campaign.report.style)
    if job.campaign.report.units.distance == "mm":
        look = replace(look, radius_mm=1e3 * job.campaign.vehicle.rotor_radius)
    evidence = gather(job)
    made: list[tuple[FigureSpec, Columns, Callable[[], Files]]] = []
    left_out = []
    for spec in FIGURES:
        rows = spec.summarise(evidence) if evidence.has(*spec.needs) else {}
        if any(len(column) for column in rows.values()):
            made.append((spec, rows, give(partial(render, spec.draw, rows, look))))
            continue
        left_out += [spec.name] if _expected(job, spec) else []
        for kind in ("pdf", "png", "csv"):
            job.remove(f"reports/{spec.name}.{kind}")
    job.say(f"report {len(made)} figures", 0.0)
    # what needs no picture is written while others draw
    from nearlift.report.documents.pdf import Drawn, pdf
    from nearlift.report.page.render import Picture, page, with_images

    pictures = [
        Picture(name=s.name, title=s.title, caption=s.caption(evidence, r), alt=s.alt(evidence, r))
        for s, r, _ in made
    ]
    text = page(evidence, pictures, charts=charts(evidence))
    _documents(job, evidence)
    for spec, rows, _ in made:
        job.publish(f"{spec.name}.csv", to_csv(rows))
    images, printed = {}, list[Drawn]()
    for picture, (_, _, drawn) in zip(pictures, made, strict=True):
        files = drawn()
        for kind in ("pdf", "png"):
            job.publish(f"{picture.name}.{kind}", files[kind])
        images[picture.name] = files["page"]
        printed.append((picture, files["pdf"]))
        job.say(f"report {len(images)} of {len(made)} figures", len(images) / len(made))
    job.publish("report.pdf", pdf(evidence, printed))
    job.publish("index.html", with_images(text, images))
    return Outcome(
        notes=tuple(f"{name} was not drawn: its products are missing or empty" for name in left_out)
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


@contextlib.contextmanager
def _drawing(job: Job) -> Iterator[Give]:
    """What draws figures: the job's executor, or in place of threads processes, begun at once."""
    from nearlift.report.drawers import drawers

    if not isinstance(job.executor, Threads):
        yield lambda task: job.executor.submit(task).result
        return
    with drawers(job.executor.workers - 1) as give:
        yield give


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


def for_print(draw: Draw, table: Columns, look: str) -> dict[str, bytes]:
    """One figure beside the report: pdf, png and csv."""
    from nearlift.report.figures.encoding import render
    from nearlift.report.figures.style import style
    from nearlift.report.tidy import to_csv

    files = render(draw, table, style(look))
    return {"pdf": files["pdf"], "png": files["png"], "csv": to_csv(table)}
